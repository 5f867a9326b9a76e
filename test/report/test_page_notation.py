"""A report's page writes mathematics; its data, its metrics.json and its parameters stay code."""

import html
import re

import pytest

from cacc_platoon.report import report_run


@pytest.fixture(scope="module")
def reported(whole_run, tmp_path_factory):
    output = tmp_path_factory.mktemp("report")
    report_run(whole_run, runs=0, output=output)
    return output


def test_the_page_writes_mathematics_and_keeps_the_names_of_parameters(reported):
    text = (reported / "report.html").read_text(encoding="utf-8")
    text = text[: text.index("<script")]  # what follows is metrics.json once more
    words = re.sub(r"<(style|svg).*?</\1>", "", text, flags=re.DOTALL)
    rho = html.unescape("&rho;")
    for written in ("τ<sub>0</sub>", "|H(jω)| ≤ 1", "k<sub>a</sub>", "m/s²", f"1/{rho}", "√C"):
        assert written in words
    for name in ("vehicle.tau_max", "controller.k_a", "v2v.rho"):
        assert f'<td class="text">{name}</td>' in words
    left = r"(?<![.\w])(tau0?|rho|delta|jw|k_[avp]|sqrt|h_w|([A-Za-z]|delta|tau)_\d)\b|&lt;=|\^\d"
    assert not re.search(left, words)


def test_every_table_of_words_folds_on_a_narrow_screen(reported):
    text = (reported / "report.html").read_text(encoding="utf-8")
    for heading in ("What is guaranteed", "What the verdict rests on", "Scenario", "Provenance"):
        table = text[text.index(f"<h2>{heading}") :]
        assert table[table.index("<table") :].startswith('<table class="words">'), heading
    assert '<td class="code">0.95</td><td class="text" data-head="unit: ">s</td>' in text


def test_alternative_texts_and_file_names(reported):
    text = (reported / "report.html").read_text(encoding="utf-8")
    assert 'role="img" aria-label="Propagation |H(jω)|"' in text
    drawn = (reported / "figures" / "response.svg").read_text(encoding="utf-8")
    assert 'aria-label="Propagation |H(jω)|"' in drawn


def test_metrics_json_keeps_ascii(reported):
    assert "B + 2 tau sqrt(C) >= 0" in (reported / "metrics.json").read_text(encoding="ascii")

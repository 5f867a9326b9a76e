"""`platoon paper`: every statement of the paper that can be checked agrees, on computed numbers."""

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest

from cacc_platoon.cli import main
from cacc_platoon.notation import as_html
from cacc_platoon.reproduction.cases import CASES, case_scenario
from cacc_platoon.reproduction.mean_claims import ensemble_claims
from cacc_platoon.reproduction.paper_page import summary, write_reproduction
from cacc_platoon.reproduction.reproduce import reproduce
from cacc_platoon.scenario.file import load_scenario

CONFIG = Path(__file__).parents[2] / "config"


def test_every_statement_agrees(reports):
    result = reproduce(reports)
    assert result.agrees, [claim for claim in result.claims if not claim.agrees]
    assert len(result.claims) >= 20
    assert {"0.833333333", "0.937500000", "0.318305009", "0.872677996"} <= {
        claim.measured for claim in result.claims
    }


def test_the_paper_is_not_reproduced_from_data_that_do_not_stand(reports):
    """The statements are the same; the run they are measured on is not the one that was made."""
    altered = dataclasses.replace(reports["C"].run, digest_recorded="1" * 64)
    result = reproduce({**reports, "C": dataclasses.replace(reports["C"], run=altered)})
    assert all(claim.agrees for claim in result.claims)
    assert not result.agrees
    assert result.headline.endswith("statements of the paper agree, DATA ALTERED of case C")
    assert "data of case C: the messages do not have the digest" in summary(result)
    assert reproduce(reports).headline.endswith("statements of the paper agree")


def test_claims_can_fail(reports):
    """With B's gains in the place of A's the statements about A do not hold."""
    wrong = {**reports, "A": reports["B"]}
    failing = {claim.what for claim in reproduce(wrong).claims if not claim.agrees}
    assert "case A: max|delta_i| along the platoon [m]" in failing
    assert "case A: robustly string stable (L2)" in failing
    assert any("platoon length" in what for what in failing)
    result = reproduce(wrong)
    assert not result.agrees
    assert "\n! " in summary(result)


def test_the_journal_version_and_the_slips_count_too(reports):
    """What disagrees or is not shown is in headline and exit code; a question is in neither."""
    result = reproduce(reports)
    assert result.complete
    assert result.journal_line == (
        "5 of 5 figures of the journal version agree as read; "
        "1 cannot be compared and is a question"
    )
    far = [result.journal[0]._replace(agrees=False), *result.journal[1:]]
    other = dataclasses.replace(result, journal=far)
    assert not other.agrees
    assert other.headline.endswith("agree, 1 of its journal version do not")
    assert other.journal_line.startswith("4 of 5")
    unseen = [result.slips[0]._replace(shown=False), *result.slips[1:]]
    other = dataclasses.replace(result, slips=unseen)
    assert other.agrees
    assert not other.complete
    assert other.headline.endswith(f"1 of {len(unseen)} slips are not shown")
    assert "\n! Definition 2" in summary(other)


def test_mean_of_noisy_runs_is_compared_with_the_mean_system(reports):
    """Two runs agree; a mean that is eight standard errors away does not."""
    (claim,) = ensemble_claims(reports["A"])
    assert claim.agrees is True
    few = reports["A"].ensemble
    many = dataclasses.replace(few, runs=400, mean=few.mean + 8 * few.standard_error)
    (claim,) = ensemble_claims(dataclasses.replace(reports["A"], ensemble=many))
    assert claim.agrees is False
    assert not list(ensemble_claims(dataclasses.replace(reports["A"], ensemble=None)))


def test_tables_fit_into_a_terminal(reports):
    """No line is wider than the columns; every word of every cell is there."""
    result = reproduce(reports)
    text = summary(result)
    assert max(map(len, text.splitlines())) <= 140
    assert "\n? max|delta_1| and max|delta_12|" in text
    assert "\n! " not in text
    words = set(text.split())
    cells = [cell for claim in [*result.claims, *result.journal] for cell in claim[1:4]]
    cells += [cell for slip in result.slips for cell in slip[1:4]]
    assert {word for cell in cells for word in cell.split()} <= words


def test_published_numbers(reports):
    """docs/theory.md, section 1 (Setting), the line of 100 Hz."""
    peaks = {name: r.expected.max_abs_spacing_error for name, r in reports.items()}
    assert peaks["A"][[0, -1]] == pytest.approx([1.596227, 1.544609], abs=5e-7)
    assert peaks["B"][[0, -1]] == pytest.approx([0.882905, 0.888412], abs=5e-7)
    assert peaks["C"][[0, -1]] == pytest.approx([0.926459, 0.921985], abs=5e-7)


def test_cases_are_those_of_the_scenario_files():
    for case in CASES:
        file = load_scenario(CONFIG / f"paper_{case.name.lower()}.yaml")
        assert dataclasses.replace(case_scenario(case), name=file.name) == file


def test_page_and_figures(reports, tmp_path):
    page = write_reproduction(reproduce(reports), tmp_path).read_text(encoding="utf-8")
    drawn = {path.stem for path in (tmp_path / "figures").glob("*.svg")}
    assert drawn >= {
        "topology",
        "noise_cone",
        "noise_received",
        "headway_slope",
        "region_a",
        "region_c",
        "response_a",
        "response_b",
        "spacing_errors_a",
        "spacing_errors_b",
        "spacing_errors_c",
        "noise_link_1_2",
        "platoon_length",
    }
    assert "http" not in page
    document = json.loads((tmp_path / "paper.json").read_text())
    assert document["agrees"] is True
    shown = page[: page.index("<script")]  # what follows is paper.json once more
    for claim in document["claims"]:
        assert f">{as_html(claim['what'])}</td>" in shown
    assert document["journal"]["doi"] in page
    assert len(document["journal"]["claims"]) == 6
    assert len(document["slips"]) == shown.count('class="text">yes</td>') - sum(
        claim["agrees"] is True for claim in document["claims"] + document["journal"]["claims"]
    )
    assert shown.count('class="text">question</td>') == 1
    for fact in (
        "paper says",
        "we measured",
        "1.001163718",
        "0.872677996",
        "0.656130590",
        "|H(jω; τ<sub>0</sub>)|",
    ):
        assert fact in shown
    words = re.sub(r"<(svg|style).*?</\1>", "", shown, flags=re.DOTALL)
    assert not re.search(r"tau_?0|\brho\b|<=|&lt;=|\bjw\b|\^\d", words)


def test_noisy_runs_need_not_be_monotone(reports):
    """None of A's, B's, C's recorded noisy runs is what its verdict rests on."""
    for report in reports.values():
        growing = np.diff(report.measured.max_abs_spacing_error) > 0
        assert growing.any()
        assert not growing.all()


def test_folder_in_use_is_refused(tmp_path, capsys):
    (tmp_path / "something").write_text("")
    assert main(["paper", "--simulate", "-o", str(tmp_path)]) == 2
    assert "not empty" in capsys.readouterr().err

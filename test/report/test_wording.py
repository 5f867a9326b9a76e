"""Sentences of terminal and page that have to be true of every scenario that is accepted."""

import html
import re

import pytest

from cacc_platoon.analysis import analyse, judge
from cacc_platoon.cli.simulate import simulate_run
from cacc_platoon.notation import as_html
from cacc_platoon.report import metrics_document, summary, tables
from cacc_platoon.report.verdict_section import verdict_section
from cacc_platoon.scenario import Scenario

SHORT = {"platoon.followers": 2, "run.duration": 3.0, "leader.start": 0.0}
DARK = {"v2v.blackouts": [1.0, 2.0]}
RARE = {"v2v.period": 0.05}
UNEQUAL = {"vehicle_2.vehicle.tau": 0.4}


def scenario(values):
    return Scenario.from_values(SHORT).with_values(values)


@pytest.fixture
def told(tmp_path):
    """Return a function from values to a run's report, the terminal's text and the page's."""

    def tell(values):
        simulate_run(scenario(values), tmp_path / "run")
        report = analyse(tmp_path / "run", runs=0)
        metrics = metrics_document(report)
        page = verdict_section(report, metrics).replace("</td>", " | ")
        return report, summary(report, metrics), html.unescape(re.sub(r"<[^>]+>", "", page))

    return tell


def test_what_a_void_certificate_would_guarantee_is_not_said_of_the_run(told):
    report, text, page = told({**DARK, "v2v.reception": "fallback"})
    assert report.verdict.guarantee.startswith("by design, void for this run: in the mean")
    assert "What is guaranteed; void for this run" in page
    apart = "what voids the certificate apart"
    assert f"whatever the noise does, {apart}" in text
    assert f"in every run, {apart}, at most" in page
    assert f"at every instant, {apart}." in page


def test_a_run_that_keeps_its_premises_is_guaranteed_without_reserve(told):
    report, text, page = told({})
    assert report.verdict.guarantee.startswith("in the mean over the noise")
    assert "apart" not in text
    assert "void" not in page


def test_answers_about_a_law_of_ones_own_are_of_the_certified_law(told, tmp_path, monkeypatch):
    (tmp_path / "gentle.py").write_text(
        "class Gentle:\n"
        "    def __init__(self, follower):\n"
        "        self.command = follower.spacing_policy().command\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    report, text, page = told({"vehicle_2.controller.law": "gentle:Gentle"})
    assert report.verdict.guarantee == (
        "nothing is guaranteed: not every vehicle follows the law of headway and gains"
    )
    assert f"  {report.verdict.guarantee}" in text
    assert len(re.findall(r"passed, of the law of headway and gains", text)) == 2
    for question in ("String stable, robustly (L2)", "With the mean noise of this run"):
        assert f"{question} | yes, of the law of headway and gains | " in page


def test_nothing_is_said_to_hold_of_unequal_links_with_rare_packets(told):
    report, text, page = told({**RARE, **UNEQUAL})
    mean = {row.signal: row.mean for row in report.verdict.guarantees}
    assert mean["energy of a_i"] == mean["energy of delta_i"] == "not said of unequal links"
    assert "nothing is guaranteed of unequal links" in text
    assert "at most | 1, were all followers alike | packets come" in page


def test_the_weakest_is_one_whose_sampled_loop_grows():
    """Vehicle 2 alone is lost at 20 ms; sup|H| = 1 of both, and its least margin is larger."""
    values = {"vehicle_2.controller.k_v": 0.7, "run.step": 0.02, "run.duration": 2.0}
    verdict = judge(scenario(values))
    assert verdict.guarantee.startswith("nothing is guaranteed: sampled as slowly")
    assert verdict.weakest.follower == 2
    assert verdict.guarantees[0].mean.startswith("may grow: not string stable sampled every 0.02")


def test_the_weakest_is_one_with_whose_packets_errors_grow():
    verdict = judge(scenario({"vehicle_2.v2v.latency": 0.4}))
    assert verdict.string_stable
    assert verdict.weakest.follower == 2


@pytest.mark.parametrize(
    "values",
    [
        {"leader.profile": "constant", "platoon.followers": 1},
        {"v2v.quantum": 0.1, "v2v.noise": "none"},
        {"v2v.loss": 1.0},
    ],
    ids=["nobody accelerates", "rounded", "all lost"],
)
def test_packets_were_sent_though_none_tells_w(told, values):
    page = told(values)[2]
    assert "Channel assumption | no packet tells w | " in page
    assert "nothing was sent" not in page


def test_the_errors_of_one_follower_go_nowhere(told):
    report, text, _ = told({"platoon.followers": 1})
    peak = float(report.measured.max_abs_spacing_error[0])
    assert f"errors, this run:        {peak:.6f} m at most (one run proves nothing)" in text
    assert "->" not in text


@pytest.mark.parametrize("limits", [{"vehicle.limits": "iso15622"}, {"vehicle.stops": True}])
def test_the_least_gap_is_that_of_vehicles_without_limits(told, limits):
    report, _, page = told(limits)
    assert report.verdict.certified  # they did not act, but would in such a braking
    assert "in the mean without limits of actuators, in continuous time, from the equi" in page


def test_noise_that_never_changes_is_judged_in_continuous_time(told):
    page = told({})[2]
    assert "but for the mean square of noise that changes, which is of the sampled loop" in page
    assert "spacing errors may grow even where accelerations do not" in page


def test_unequal_followers_are_not_all_said_to_be_the_weakest(told):
    assert "What is guaranteed; none is weaker than vehicle " in told(UNEQUAL)[2]


def test_every_table_of_numbers_says_what_its_columns_are(told):
    report, _, page = told({**DARK, "v2v.reception": "fallback", "v2v.monitor": "report"})
    metrics = metrics_document(report)
    for table, note in (
        (tables.follower_table, tables.FOLLOWER_NOTE),
        (tables.noise_table, tables.NOISE_NOTE),
        (tables.reception_table, tables.RECEPTION_NOTE),
        (tables.fallback_table, tables.FALLBACK_NOTE),
        (tables.monitor_table, tables.MONITOR_NOTE),
    ):
        assert table(metrics).endswith(f"<p>{as_html(note)}</p>")
    assert "no gap falls below the parabola" in page


@pytest.mark.parametrize(
    "values",
    [
        {"controller.time_headway": 0.65},
        {"controller.k_p": 0.0001, "controller.time_headway": 0.8},
        {"controller.k_v": 0.9},
        {"controller.k_a": 0.9},
        {"v2v.loss": 1.0},
    ],
)
def test_nothing_grows_along_a_platoon_of_one(values):
    verdict = judge(scenario({"platoon.followers": 1, **values}))
    assert "along a platoon" in str(verdict.weakest.failure)
    assert "along the platoon" not in str(verdict.weakest.failure)

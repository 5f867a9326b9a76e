"""What a report says of a run that loses packets: of which loop, of whom, and only what is so."""

import html
import re

import pytest

from cacc_platoon.analysis import analyse
from cacc_platoon.cli.simulate import simulate_run
from cacc_platoon.notation import as_html
from cacc_platoon.report import figure_list, metrics_document, report_run, summary
from cacc_platoon.report.verdict_section import verdict_section
from cacc_platoon.scenario import Scenario
from cacc_platoon.theory import exact_region, paper_region
from cacc_platoon.theory.response_band import response_band

DAMPED = {
    "platoon.followers": 4,
    "run.duration": 6.0,
    "leader.start": 0.0,
    "controller.time_headway": 1.3,
    "controller.k_p": 0.1,
    "controller.k_v": 0.62,
}
MIXED = {
    "v2v.loss": 0.1,
    "vehicle_2.v2v.reception": "zero",
    "vehicle_2.v2v.loss": 0.3,
    "vehicle_3.v2v.loss": 0.4,
    "vehicle_4.v2v.loss": 0.0,
}
ZERO_FAILS = {**MIXED, "vehicle_2.controller.time_headway": 0.7}
HOLD_FAILS = {**MIXED, "vehicle_3.v2v.loss": 0.99}
TOO_SLOW = {"v2v.loss": 0.1, "run.step": 0.4, "vehicle_3.v2v.loss": 0.5}


@pytest.fixture
def made(tmp_path):
    """Return a function from values to the terminal's lines and the page's rows of a run."""

    def make(values):
        simulate_run(Scenario.from_values(DAMPED).with_values(values), tmp_path / "run")
        report = analyse(tmp_path / "run", runs=0)
        metrics = metrics_document(report)
        return report, summary(report, metrics), page_rows(verdict_section(report, metrics))

    return make


def bare(markup: str) -> str:
    """Return what is read of a piece of a page."""
    return html.unescape(re.sub(r"<[^>]+>", "", markup))


def page_rows(text: str) -> dict[str, list[str]]:
    """Return answer and basis of each question of a page; several to one question are joined."""
    rows: dict[str, list[str]] = {"": [html.unescape(re.sub(r"<[^>]+>", " ", text))]}
    for row in re.findall(r"<tr>(.*?)</tr>", text):
        found = re.findall(r'<td class="text"[^>]*>(.*?)</td>', row)
        cells = [bare(cell) for cell in found]
        if len(cells) == 3:
            rows.setdefault(cells[0], []).extend(cells[1:])
    return rows


def test_the_gain_shown_is_of_the_loop_without_loss_where_the_weakest_holds(made):
    report, text, _ = made(MIXED)
    assert report.verdict.weakest.follower == 3
    assert (
        "sup|H| = 1 (L2, in the mean) of the loop without loss (vehicle 3; none is weaker)" in text
    )
    assert "Theorem 2 (sufficient) of the loop without loss at vehicles 1, 3: " in text


def test_the_gain_shown_is_as_judged_where_the_weakest_counts_zero(made):
    """Others hold lost packets; the interval, the lag and the gain are those of vehicle 2."""
    report, text, rows = made(ZERO_FAILS)
    assert report.verdict.weakest.follower == 2
    assert "every p k_a E[w] in [0.28, 0.6] (vehicle 2): failed: time_headway = 0.7 s" in text
    gain = report.verdict.weakest.l2_gain
    assert gain > 1
    assert f"sup|H| = {gain:.9g} (L2, in the mean) (vehicle 2; none is weaker)" in text
    assert "vehicle 2, time_headway = 0.7 s is below" in rows[""][0]
    assert f"rad/s. {report.verdict.weakest.remedy}. In the expectation run" in rows[""][0]
    assert "Raise time_headway" in report.verdict.weakest.remedy
    assert f"\n  remedy: {report.verdict.weakest.remedy}\n" in text


def test_each_kind_of_loss_has_its_own_answer(made):
    _, text, rows = made(HOLD_FAILS)
    zero, zero_basis, hold, hold_basis = rows["With packet loss, in the mean"]
    assert (zero, hold) == ("yes", "no")
    assert "count as zero at vehicle 2: judged" in zero_basis
    assert "held at vehicles 1, 3 while others are lost" in hold_basis
    assert "least 0.01, vehicle 3" in hold_basis
    assert zero_basis in bare(as_html(text))
    assert hold_basis in bare(as_html(text))
    assert "in the mean of all losses: vehicle 3, with a share 0.01 of all packets" in rows[""][0]
    assert "rad/s of the loop without loss" in rows[""][0]
    exact = rows["String stable, robustly (L2)"]
    assert exact[0] == "no"
    assert "p = 0.7 at vehicle 2, and p = 1 elsewhere" in exact[1]
    assert "which no one gain describes" in rows["With the mean noise of this run"][1]


def test_a_loop_that_holds_and_is_sampled_too_slowly_has_no_yes(made):
    report, _, rows = made(TOO_SLOW)
    assert report.verdict.string_stable
    assert rows["With packet loss, in the mean"][0] == "no"
    assert rows["Sampled at the control period"][0] == "no"
    assert "Nothing is guaranteed: sampled as slowly as this errors may grow" in rows[""][0]


def test_a_run_without_loss_speaks_of_none(made):
    _, text, rows = made({})
    assert "loss" not in text.replace("packet loss", "").replace("% lost", "")
    assert "With packet loss, in the mean" not in rows
    assert "loss" not in rows[""][0]


def test_pictures_of_a_design_are_of_the_interval_that_is_judged(made, monkeypatch):
    asked = {}
    for drawer in (response_band, paper_region, exact_region):

        def noted(*question, drawer=drawer, **more):
            asked[drawer] = more["reception"]
            return drawer(*question, **more)

        monkeypatch.setattr(figure_list, drawer.__name__, noted)
    report, _, _ = made(ZERO_FAILS)
    drawn = {picture.name: picture for picture in figure_list.pictures(report)}
    assert asked == dict.fromkeys((response_band, paper_region, exact_region), 0.7)
    for name in ("response", "region"):
        caption = drawn[name].caption
        assert "Vehicle 2. Lost packets count as zero, I reaches down to p m k_a." in caption
    mean = report.measured.noise[1].expected_mean
    assert f"{0.7 * 0.5 * mean:.4g}" in drawn["response"].svg()


def test_pictures_of_a_design_that_holds_say_that_it_is_without_loss(made):
    report, _, _ = made(HOLD_FAILS)
    captions = [
        picture.caption for picture in figure_list.pictures(report) if picture.name == "response"
    ]
    assert "Vehicle 3. The loop without loss" in captions[0]


def row_of_agreement(report, **changes):
    metrics = metrics_document(report)
    metrics["ensemble"] |= changes
    return page_rows(verdict_section(report, metrics))["Mean of noisy runs"]


def test_whether_noisy_runs_agree_is_a_test_with_a_level(whole_run, tmp_path):
    report, metrics = report_run(whole_run, runs=20, output=tmp_path)
    found = metrics["ensemble"]["agreement"]
    assert found["level"] == 1e-3
    assert found["compared"] == 301 * 3
    share = found["largest_share_of_bound"]
    assert 0.0 < share < 1.0
    answer, basis = row_of_agreement(report)
    assert answer == f"agrees, {100 * share:.3g} % of the bound reached"
    assert "at all 903 pairs of vehicle and sample at once" in basis
    assert "with a probability of at most 0.001: Hoeffding's" in basis
    assert "standard error" not in basis
    answer, _ = row_of_agreement(report, agreement={**found, "largest_share_of_bound": 1.5})
    assert answer == "does not agree, 150 % of the bound reached"
    answer, _ = row_of_agreement(report, agreement={**found, "largest_share_of_bound": None})
    assert answer == "unknown, they overflow"
    answer, _ = row_of_agreement(report, max_abs_mean_minus_expectation=None)
    assert answer == "unknown, they overflow"
    answer, basis = row_of_agreement(report, agreement=None)
    assert answer == "not tested"
    assert "no test with a stated level" in basis


def test_what_is_guaranteed_without_losses_says_so(made):
    """The gains of the mean loop are of the one without losses where the last packet is held."""
    report, _, rows = made({"v2v.loss": 0.1})
    mean = {row.signal: row.mean for row in report.verdict.guarantees}
    for signal in ("energy of a_i", "peaks of a_i", "peaks of delta_i"):
        assert mean[signal].endswith(", of the loop without losses")
    assert "at every instant and any packets lost." in rows[""][0]
    assert "of every packet that arrived" in rows["Channel assumption"][1]
    assert "at 22 lags up to τ0" in rows["With packet loss, in the mean"][1]


def test_what_is_guaranteed_of_lost_packets_that_count_as_zero_includes_them(made):
    report, _, rows = made({"v2v.loss": 0.1, "v2v.reception": "zero"})
    assert "without losses" not in str(report.verdict.guarantees)
    sure = rows["Ratio of peaks of ai per hop between followers, in every run, at most"]
    assert "w = 0, which is a lost packet, and every w in [1 " in sure[1]


def test_a_single_follower_is_spoken_of_as_one(made):
    _, text, rows = made({"platoon.followers": 1})
    assert text.splitlines()[0].endswith(": scenario, 1 follower, 6 s")
    assert ": 1 follower, 6 s, seed 1" in rows[""][0]
    assert "the spacing error of the only follower is at most" in rows[""][0]
    braking = next(row[1] for name, row in rows.items() if name.startswith("Least gap over"))
    assert braking.endswith("and of the first follower")


BURSTS = {"v2v.loss": 0.0, "v2v.burst_begin": 0.02, "v2v.burst_end": 0.2, "v2v.burst_loss": 0.9}
DARK = {"v2v.blackouts": [1.0, 2.0]}


def test_what_is_judged_as_if_losses_were_independent_says_so_in_bursts(made):
    so = "if losses did not depend on each other"
    report, text, rows = made({**BURSTS, "v2v.period": 0.05})
    assert rows["With packet loss, in the mean"][0] == f"void: yes, {so}"
    assert rows["With packet loss, in the mean"][1].endswith(so)
    for question in ("Sampled at the control period", "Growth per hop with these packets, in the "):
        assert [1 for name, found in rows.items() if question in name and so in "".join(found)]
    assert report.verdict.guarantee.endswith(so)
    lines = [line for line in text.splitlines() if line.startswith(("  packet loss", "  packets:"))]
    assert len([line for line in lines if so in line]) == 2


def test_losses_in_bursts_that_count_as_zero_are_judged_exactly(made):
    report, text, rows = made({**BURSTS, "v2v.reception": "zero"})
    assert report.verdict.certified
    assert "depend on each other" not in text
    assert rows["With packet loss, in the mean"][0] == "yes"


def test_blackouts_are_set_apart_and_when_it_holds_again_is_said(made):
    report, text, rows = made({"v2v.loss": 0.1, **DARK, "vehicle_3.v2v.blackouts": [3.0, 4.5]})
    verdict = report.verdict
    apart = "what voids the certificate apart"
    assert verdict.apart == f", {apart}"
    assert rows["With packet loss, in the mean, blackouts apart"][0] == "yes"
    assert [name for name in rows if name.endswith(f"in every run, {apart}, at most")]
    assert "from 1 s on, until 4.5 s" in verdict.void[0]
    for found in (text, bare(rows[""][0])):
        assert "from 4.5 s on, when that is over, the statement about the mean" in found
    assert metrics_document(report)["verdict"]["holds_from"] == 4.5


@pytest.mark.parametrize(
    "values",
    [
        {"v2v.blackouts": [1.0, 6.0]},
        {**BURSTS, **DARK},
        {**DARK, "controller.time_headway": 0.65, "controller.k_p": 0.009, "controller.k_v": 0.63},
    ],
    ids=["to the end", "bursts too", "not string stable"],
)
def test_it_does_not_hold_again_where_it_does_not(made, values):
    report, text, _ = made(values)
    assert "blackout ends" not in text
    assert metrics_document(report)["verdict"]["holds_from"] is None


def test_a_blackout_after_the_run_voids_nothing(made):
    report, *_ = made({"v2v.blackouts": [6.0, 7.0]})
    assert report.verdict.certified
    assert "blackout" not in report.verdict.guarantee


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"v2v.loss": 0.1}, "in the mean without losses, in continuous time"),
        ({"v2v.loss": 0.1, "v2v.reception": "zero"}, "in the mean, in continuous time"),
        (DARK, "in the mean, what voids the certificate apart, in continuous time"),
    ],
)
def test_the_least_gap_says_which_losses_it_leaves_out(made, values, said):
    found = [row[1] for name, row in made(values)[2].items() if name.startswith("Least gap")]
    assert len(found) == 1
    assert found[0].startswith(said)


def test_packets_are_counted_in_words_and_in_the_table(made):
    report, text, rows = made({"v2v.period": 0.05, "v2v.jitter": 0.2, "v2v.loss": 0.2, **DARK})
    links = metrics_document(report)["reception"]
    sent, lost, dark, overtaken = (
        sum(link[key] for link in links) for key in ("sent", "lost", "in_blackouts", "overtaken")
    )
    longest = max(link["bursts"]["longest"] for link in links)
    assert (dark, longest > 1, overtaken > 20) == (80, True, True)
    assert (
        f"packets: {sent} sent, {lost} lost ({100.0 * lost / sent:.3g} %), at most {longest} in a "
        f"row, {overtaken} overtaken; 80 more in blackouts" in text
    )
    answer, basis = rows["Age of information"]
    assert re.match(r"above the latency margin of \S+ s for \S+ % of the time \(vehicle", answer)
    assert "the largest constant latency" in basis
    assert f"age beside the latency margin, which is of a constant latency: {answer}" in text
    names = [picture.name for picture in figure_list.pictures(report)]
    assert {"packets", "age"} < set(names)


def test_a_run_that_is_all_blackout_is_reported(made):
    report, text, rows = made({"v2v.blackouts": [0.0, 100.0]})
    assert f"packets: 0 sent, 0 lost, at most 0 in a row, 0 overtaken; {4 * 601} more in" in text
    assert rows["Age of information"][0] == "unknown"
    assert metrics_document(report)["loss"] is None
    assert all(
        picture.svg() for picture in figure_list.pictures(report) if "packet" in picture.name
    )


@pytest.mark.parametrize(
    ("values", "runs"),
    [
        (BURSTS, 3),
        ({"v2v.jitter": 0.1}, 3),
        ({"v2v.noise_std": 0.1}, 3),
        ({"sensing.range_std": 0.1}, 3),
        ({"v2v.bias": 0.1, "v2v.latency": 0.1}, None),
    ],
)
def test_random_runs_are_simulated_where_anything_is_random(values, runs, tmp_path):
    one = Scenario.from_values({**DAMPED, "v2v.noise": "none", **values})
    simulate_run(one, tmp_path / "run")
    ensemble = analyse(tmp_path / "run", runs=3).ensemble
    assert (ensemble.runs if ensemble else None) == runs
    assert ensemble is None or ensemble.standard_error.max() > 1e-6


def test_standard_messages_are_not_said_to_come_every_control_period(made):
    report, text, _ = made({"v2v.send_rule": "cam", "v2v.latency": 0.04})
    assert "every 0.01 s, 0.04 s late (so they are taken here: they are sent as" in text
    assert not report.verdict.certified


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"v2v.loss": 0.2}, ": the mean of all its random runs."),
        (
            {"v2v.jitter": 0.1, "v2v.quantum": 0.1},
            ": not quite the mean of all its random runs, since in it packets take the mean "
            "latency; packets are neither rounded nor cut.",
        ),
    ],
)
def test_the_picture_of_the_expectation_run_says_of_what_it_is_the_mean(made, values, words):
    report, _, _ = made(values)
    named = {picture.name: picture for picture in figure_list.pictures(report)}
    assert named["spacing_errors_expected"].caption.endswith(words)

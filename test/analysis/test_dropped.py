"""A lost packet that arrives as zero: covered where losses count as zero, a breach elsewhere."""

import dataclasses

import numpy as np
import pytest

from cacc_platoon.analysis import compute_metrics, judge
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import simulate

STABLE = {"controller.time_headway": 1.2, "controller.k_p": 0.1, "controller.k_v": 0.62}


def run_with_zeros(zeros, loss=0.3, reception="zero"):
    """Return a run whose relay to vehicle 2 delivers so many packets as zero."""
    scenario = Scenario.from_values(
        {"platoon.followers": 3, "run.duration": 20.0, "leader.start": 0.0, **STABLE}
    ).with_values({"v2v.loss": loss, "v2v.reception": reception})
    run = simulate(scenario)
    if run.arrivals is None:
        received = run.received.copy()
        received[np.flatnonzero(received[:, 1])[:zeros], 1] = 0.0
        return dataclasses.replace(run, received=received)
    first, link, last = run.arrivals
    value = link.value.copy()
    value[np.flatnonzero(value)[:zeros]] = 0.0
    return dataclasses.replace(run, arrivals=(first, link._replace(value=value), last))


def judged(run):
    measured = compute_metrics(run)
    return measured, judge(run.scenario, measured.noise, None, measured.reception)


def test_a_zero_is_a_lost_packet_where_the_certificate_counts_lost_ones_as_zero():
    plain, _ = judged(run_with_zeros(0))
    measured, verdict = judged(run_with_zeros(10))
    assert verdict.void == ()
    assert verdict.certified
    assert [link.breaches for link in measured.noise] == [0, 0, 0]
    assert measured.noise[1].low >= 0.8
    assert measured.noise[1].samples == plain.noise[1].samples - 10
    assert measured.reception[1].arrived == plain.reception[1].arrived - 10
    assert measured.reception[0] == plain.reception[0]


def test_more_zeros_than_losses_explain_void_the_certificate():
    _, verdict = judged(run_with_zeros(400))
    assert not verdict.certified
    assert "lost more packets than v2v.loss explains" in verdict.void[0]


@pytest.mark.parametrize(("loss", "reception"), [(0.3, "hold"), (0.0, "zero"), (0.0, "hold")])
def test_a_zero_that_no_theorem_covers_stays_a_breach(loss, reception):
    """It is used as it is where losses are held, and none is foreseen where nothing is lost."""
    measured, verdict = judged(run_with_zeros(10, loss, reception))
    assert measured.noise[1].breaches == 10
    assert "the channel left 1 - 1/rho <= w <= 1 + 1/rho on 1 of 3 links" in verdict.void[0]


@pytest.mark.parametrize("zeroed", [{"v2v.quantum": 0.5}, {"v2v.false_data": ("5 10 factor=0",)}])
def test_a_zero_that_its_packet_says_has_arrived(zeroed):
    """As many packets are lost as where none says zero."""
    lossy = {"platoon.followers": 2, "run.duration": 20.0, "leader.start": 0.0}
    plain = Scenario.from_values({**lossy, "v2v.loss": 0.1, "v2v.reception": "zero"})
    wanted, found = (
        compute_metrics(simulate(one)).reception for one in (plain, plain.with_values(zeroed))
    )
    assert [link.lost for link in found] == [link.lost for link in wanted]
    assert not any(link.loses_too_much for link in found)

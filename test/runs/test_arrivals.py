"""Bags of lossy runs that are not whole: what cannot be paired is named, never mis-paired."""

import numpy as np
import pytest

from cacc_platoon.analysis import analyse, check_consistency
from cacc_platoon.analysis.age import link_reception
from cacc_platoon.bags.rows import TopicRows
from cacc_platoon.model import ComposedChannel
from cacc_platoon.runs.recorded_run import read_run
from cacc_platoon.runs.recording import recording_of, with_deliveries
from cacc_platoon.simulation import simulate
from msg_adapters.topics import Graph, VehicleTopics

SECOND = VehicleTopics("/platoon", 2)
RECEIVED, COUNTS = SECOND.received.name, SECOND.complete.name
AT_ONCE = "packets count as delivered when they were sent"
ALL_LOST = {"v2v.loss": 1.0}


@pytest.fixture
def lossy(bags):
    return bags.scenario({"v2v.loss": 0.3})


def arrivals(trajectory):
    assert trajectory.arrivals is not None
    return trajectory.arrivals


def changed(recording, **rows):
    """Return a recording of which only some rows of some topics are left."""
    changed = dict(recording)
    for name, kept in (("accel", RECEIVED), ("complete", COUNTS)):
        if name in rows:
            kind, messages, delivered = recording[kept]
            part = None if delivered is None else delivered[rows[name]]
            changed[kept] = TopicRows(kind, messages[rows[name]], part)
    return changed


def test_a_whole_bag_says_what_arrived_and_when(bags, tmp_path, lossy):
    run = read_run(bags.bag(tmp_path / "bag", lossy, bags.record(lossy)))
    assert run.findings == ()
    for found, sent in zip(arrivals(run.trajectory), arrivals(simulate(lossy)), strict=True):
        for name in ("source", "sample", "value"):
            np.testing.assert_array_equal(getattr(found, name), getattr(sent, name))


@pytest.mark.parametrize("gap", [0, 40, 100])
def test_a_missing_packet_shifts_no_other(bags, tmp_path, lossy, gap):
    whole = bags.record(lossy)
    rows = np.delete(np.arange(len(whole[RECEIVED].messages)), gap)
    run = read_run(bags.bag(tmp_path / "bag", lossy, changed(whole, accel=rows)))
    assert f"{COUNTS}: does not fit the messages that it counts: {AT_ONCE}" in run.findings
    found, sent = arrivals(run.trajectory)[1], arrivals(simulate(lossy))[1]
    np.testing.assert_array_equal(found.source, np.delete(sent.source, gap))
    assert (found.sample == found.source).all()


def test_a_bag_that_lacks_the_last_packets_says_so(bags, tmp_path, lossy):
    whole = bags.record(lossy)
    n = len(whole[RECEIVED].messages)
    run = read_run(bags.bag(tmp_path / "bag", lossy, changed(whole, accel=np.arange(n - 3))))
    assert f"{RECEIVED}: lacks 3 of {n} packets that were delivered" in run.findings
    assert len(arrivals(run.trajectory)[1].source) == n - 3


def test_a_bag_that_begins_late_is_not_mispaired(bags, tmp_path, lossy):
    whole = bags.record(lossy)
    late = {}
    for name, (kind, messages, delivered) in whole.items():
        at = np.arange(len(messages)) if delivered is None else delivered // lossy.step_ns
        part = None if delivered is None else delivered[at >= 100]
        late[name] = TopicRows(kind, messages[at >= 100], part)
    report = analyse(bags.bag(tmp_path / "bag", lossy, late), runs=0)
    assert any("that it counts: " + AT_ONCE in line for line in report.run.findings)
    for found, sent in zip(arrivals(report.run.trajectory), arrivals(simulate(lossy)), strict=True):
        np.testing.assert_array_equal(found.source, sent.source[sent.sample >= 100])
    assert report.consistency.largest == 0.0


def test_missing_counts(bags, tmp_path, lossy):
    whole = {name: rows for name, rows in bags.record(lossy).items() if name != COUNTS}
    run = read_run(bags.bag(tmp_path / "bag", lossy, whole))
    assert f"{COUNTS}: is not in the bag: {AT_ONCE}" in run.findings


def test_missing_packets_are_no_lost_packets(bags, tmp_path, lossy):
    """The counts say that packets came; a link that lost all of them counts none."""
    whole = {name: rows for name, rows in bags.record(lossy).items() if name != RECEIVED}
    findings = read_run(bags.bag(tmp_path / "bag", lossy, whole)).findings
    assert any(RECEIVED in line for line in findings)
    nothing = bags.scenario(ALL_LOST)
    assert read_run(bags.bag(tmp_path / "all", nothing, bags.record(nothing))).findings == ()


def test_counts_that_end_early(bags, tmp_path, lossy):
    whole = bags.record(lossy)
    early = changed(whole, complete=np.arange(150))
    run = read_run(bags.bag(tmp_path / "bag", lossy, early))
    assert f"{COUNTS}: ends at sample 149 (1.49 s): from there on {AT_ONCE}" in run.findings
    found, sent = arrivals(run.trajectory)[1], arrivals(simulate(lossy))[1]
    for name in ("source", "sample", "value"):
        np.testing.assert_array_equal(getattr(found, name), getattr(sent, name))
    assert check_consistency(run.trajectory).largest == 0.0


@pytest.mark.parametrize(
    "change",
    [lambda x: 0 * x, lambda x: x // 2, lambda x: x + 0.5, lambda x: x + 7, lambda x: x * 1e300],
)
def test_counts_of_another_recording(bags, tmp_path, lossy, change):
    wrong = bags.rewritten(bags.record(lossy), SECOND.complete, change)
    run = read_run(bags.bag(tmp_path / "bag", lossy, wrong))
    assert f"{COUNTS}: does not fit the messages that it counts: {AT_ONCE}" in run.findings
    assert max(len(line) for line in run.findings) < 200


def test_packets_that_were_recorded_twice(bags, tmp_path, lossy):
    whole = bags.record(lossy)
    twice = changed(whole, accel=np.repeat(np.arange(len(whole[RECEIVED].messages)), 2))
    run = read_run(bags.bag(tmp_path / "bag", lossy, twice))
    assert f"{COUNTS}: does not fit the messages that it counts: {AT_ONCE}" in run.findings
    assert (run.trajectory.received[:, 1] == simulate(lossy).received[:, 1]).all()
    link = link_reception(run.trajectory)[1]
    assert link.arrived == len(arrivals(simulate(lossy))[1].source)


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_what_was_not_recorded_was_not_lost(bags, tmp_path, loss):
    """A bag that begins late, or in which v2v/accel ends early, says nothing of the channel."""
    scenario = bags.scenario({"v2v.loss": loss})
    whole, late = bags.record(scenario), {}
    for name, (kind, messages, delivered) in whole.items():
        at = np.arange(len(messages)) if delivered is None else delivered // scenario.step_ns
        part = None if delivered is None else delivered[at >= 100]
        late[name] = TopicRows(kind, messages[at >= 100], part)
    report = analyse(bags.bag(tmp_path / "late", scenario, late), runs=0)
    assert report.verdict.void == ()
    for link, sent in zip(
        report.measured.reception, link_reception(simulate(scenario)), strict=True
    ):
        assert (link.sent, sent.sent) == (201, 301)
        assert link.loss == pytest.approx(loss, abs=0.1)
    if not loss:
        short = changed(whole, accel=np.arange(200))
        report = analyse(bags.bag(tmp_path / "short", scenario, short), runs=0)
        assert (report.verdict.void, report.measured.reception[1].loss) == ((), 0.0)


@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0, 1e300])
def test_damaged_counts(bags, tmp_path, lossy, value):
    def spoil(rows):
        rows[50] = SECOND.complete.codec.encode_many([50 * lossy.step_ns], [value])[0]
        return rows

    damaged = bags.edited(bags.record(lossy), COUNTS, spoil)
    run = read_run(bags.bag(tmp_path / "bag", lossy, damaged))
    assert any(COUNTS in line for line in run.findings)
    assert np.isfinite(run.trajectory.received).all()


def test_late_packets_of_a_recording_that_begins_late_are_not_paired(lossy):
    """Each is delivered after it was sent, whatever count it is given."""

    class Late:
        prompt, longest_delay = False, 60

        def apply(self, packets):
            return packets._replace(delay=packets.delay + 60)

    whole = recording_of(simulate(lossy, channel=lambda _: ComposedChannel([Late()])))
    graph = Graph.of(lossy)
    assert with_deliveries(whole, graph)[RECEIVED].delivered is not None
    cut = changed(whole, accel=np.arange(20, 241), complete=np.arange(80, 301))
    cut[RECEIVED] = cut[RECEIVED]._replace(delivered=None)
    assert with_deliveries(cut, graph)[RECEIVED].delivered is None

"""What a recorder does with a message: writes the due one, refuses others, says how far it is."""

import errno
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cacc_platoon.runs.sample_recorder import NAMED, SampleRecorder
from cacc_platoon.scenario import Scenario
from msg_adapters.topics import Topic, VehicleTopics

SCENARIO = Scenario.from_values(
    {"platoon.followers": 1, "run.duration": 0.3, "run.window": 20}, None, "test"
)
STEP, STRIDE, LAST = SCENARIO.step_ns, 5, 30
LEADER = VehicleTopics("/platoon", 0)
POSE, TWIST = LEADER.pose, LEADER.twist
FOLDER = Path("/parts/host_0")


class Rig:
    """A recorder whose disk and whose listeners are lists."""

    def __init__(self, *topics: Topic, scenario: Scenario = SCENARIO) -> None:
        self.topics = topics or (POSE, TWIST)
        self.written: dict[str, list[bytes]] = {topic.name: [] for topic in self.topics}
        self.progress: list[int] = []
        writers = {name: messages.append for name, messages in self.written.items()}
        self.recorder = SampleRecorder(scenario, self.topics, writers, FOLDER, self.progress.append)
        self.receive = {topic.name: self.recorder.receiver(topic) for topic in self.topics}

    def give(self, topic: Topic, sample: int) -> bytes:
        """Give it the message of a sample and return that."""
        message = topic.codec.encode(sample * STEP, 0.5 * sample)
        self.receive[topic.name](message)
        return message


def test_messages_are_written_as_they_are() -> None:
    rig = Rig()
    messages = [rig.give(POSE, k) for k in range(LAST + 1)]
    assert rig.written == {POSE.name: messages, TWIST.name: []}
    assert rig.recorder.samples == {POSE.name: LAST + 1, TWIST.name: 0}
    assert rig.recorder.failures == []


@given(st.randoms(use_true_random=False))
def test_progress_is_what_every_topic_has_whatever_the_order(random) -> None:
    rig = Rig()
    turns = [topic for topic in rig.topics for _ in range(LAST + 1)]
    random.shuffle(turns)
    for topic in turns:
        rig.give(topic, rig.recorder.samples[topic.name])
        reached = min(rig.recorder.samples.values()) - 1
        assert rig.progress == [k for k in range(0, LAST + 1, STRIDE) if k <= reached]
    assert rig.progress[-1] == LAST


def test_the_last_sample_is_reported_though_no_stride_ends_there() -> None:
    scenario = Scenario.from_values({"run.duration": 0.13, "run.window": 20}, None, "test")
    progress: list[int] = []
    messages: list[bytes] = []
    writers = {POSE.name: messages.append}
    recorder = SampleRecorder(scenario, [POSE], writers, FOLDER, progress.append)
    receive = recorder.receiver(POSE)
    for k in range(14):
        receive(POSE.codec.encode(k * STEP, 0.0))
    assert progress == [0, 5, 10, 13]


def test_a_window_of_one_sample_reports_every_sample() -> None:
    scenario = Scenario.from_values({"run.duration": 0.1, "run.window": 1}, None, "test")
    progress: list[int] = []
    messages: list[bytes] = []
    writers = {POSE.name: messages.append}
    recorder = SampleRecorder(scenario, [POSE], writers, FOLDER, progress.append)
    for k in range(11):
        recorder.receiver(POSE)(POSE.codec.encode(k * STEP, 0.0))
    assert progress == list(range(11))


@pytest.mark.parametrize(
    ("sample", "due", "stamp"), [(0, 3, "0"), (2, 3, "0.02"), (4, 3, "0.04"), (99, 0, "0.99")]
)
def test_a_message_that_is_not_due_is_refused(sample: int, due: int, stamp: str) -> None:
    """A sample that comes twice may have come first from whom it should not come from."""
    rig = Rig()
    doubt = f"; everything from sample {sample} on may be wrong" if sample < due else ""
    for k in range(due):
        rig.give(POSE, k)
    rig.give(POSE, sample)
    size = POSE.codec.size
    assert rig.recorder.failures == [
        f"/platoon/vehicle_0/pose: a message of {size} bytes stamped {stamp} s where "
        f"{due * 0.01:.9g} s is due: a message was lost or comes from another publisher{doubt}"
    ]
    assert rig.recorder.samples[POSE.name] == len(rig.written[POSE.name]) == due


@pytest.mark.parametrize("size", [0, 3, 11, 12, 40, POSE.codec.size - 1, POSE.codec.size + 4])
def test_a_message_of_another_size_is_refused(size: int) -> None:
    rig = Rig()
    rig.receive[POSE.name](POSE.codec.encode(0, 0.0).ljust(size, b"\0")[:size])
    (failure,) = rig.recorder.failures
    assert failure.startswith(f"/platoon/vehicle_0/pose: a message of {size} bytes")
    assert failure.endswith("0 s is due: a message was lost or comes from another publisher")
    assert rig.written[POSE.name] == []


def test_what_stands_in_the_padding_is_not_recorded() -> None:
    padded = VehicleTopics("/platoon", 10).twist
    rig = Rig(padded)
    clean = padded.codec.encode(0, 1.0)
    begin, end = padded.codec.padding
    assert end > begin
    rig.receive[padded.name](clean[:begin] + b"\xa5" * (end - begin) + clean[end:])
    assert rig.written[padded.name] == [clean]


def test_a_full_disk_is_a_failure_and_no_sample() -> None:
    def full(_: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    progress: list[int] = []
    recorder = SampleRecorder(SCENARIO, [POSE], {POSE.name: full}, FOLDER, progress.append)
    recorder.receiver(POSE)(POSE.codec.encode(0, 0.0))
    assert recorder.failures == ["/parts/host_0: cannot be written: No space left on device"]
    assert recorder.samples[POSE.name] == 0
    assert progress == []


# A channel that may lose packets.

LOSSY = Scenario.from_values(
    {"platoon.followers": 1, "run.duration": 0.3, "run.window": 20, "v2v.loss": 0.5}, None, "test"
)
COUNTED = VehicleTopics("/platoon", 1)


def test_what_comes_over_a_lossy_channel_is_written_as_it_comes_and_counted() -> None:
    """Samples 0, 2 and 3 arrive, 1 is lost; messages and counts come in any order."""
    rig = Rig(COUNTED.received, COUNTED.complete, scenario=LOSSY)
    received, complete = (rig.receive[t.name] for t in (COUNTED.received, COUNTED.complete))
    complete(COUNTED.complete.codec.encode(0, 1.0))
    assert rig.progress == []
    received(COUNTED.received.codec.encode(0, 0.5))
    assert rig.progress == [0]
    for k in (2, 3):
        received(COUNTED.received.codec.encode(k * STEP, 0.5))
    for k, count in enumerate((1, 2, 3, 3, 3), start=1):
        complete(COUNTED.complete.codec.encode(k * STEP, count))
    assert rig.progress == [0, 5]
    assert len(rig.written[COUNTED.received.name]) == 3
    assert len(rig.written[COUNTED.complete.name]) == 6
    assert rig.recorder.samples == {COUNTED.received.name: 6, COUNTED.complete.name: 6}
    assert rig.recorder.failures == []


def test_a_count_stands_for_samples_that_follow() -> None:
    """Sample 0 has a packet, and 1 to 9 none: progress follows when the packet is here."""
    rig = Rig(COUNTED.received, COUNTED.complete, scenario=LOSSY)
    received, complete = (rig.receive[t.name] for t in (COUNTED.received, COUNTED.complete))
    complete(COUNTED.complete.codec.encode(0, 1.0, 9.0))
    assert rig.progress == []
    received(COUNTED.received.codec.encode(0, 0.5))
    stride = max(1, LOSSY.run.window // 4)
    assert rig.progress == list(range(0, 10, stride))
    assert rig.recorder.samples == {COUNTED.received.name: 10, COUNTED.complete.name: 10}
    more = min(LOSSY.run.window, LOSSY.samples - 11)
    complete(COUNTED.complete.codec.encode(10 * STEP, 1.0, more))
    assert rig.recorder.samples[COUNTED.received.name] == 11 + more
    assert rig.recorder.failures == []


@pytest.mark.parametrize("more", [0.5, -1.0, float("nan"), 1e300, float(LOSSY.samples)])
def test_a_count_of_samples_that_the_run_has_not_comes_from_another_publisher(more: float) -> None:
    rig = Rig(COUNTED.received, COUNTED.complete, scenario=LOSSY)
    rig.receive[COUNTED.complete.name](COUNTED.complete.codec.encode(0, 1.0, more))
    (failure,) = rig.recorder.failures
    assert "samples more: it comes from another publisher" in failure


@pytest.mark.parametrize("count", [0.0, 0.5, -1.0, float("nan"), float("inf")])
def test_a_count_that_is_none_comes_from_another_publisher(count: float) -> None:
    rig = Rig(COUNTED.received, COUNTED.complete, scenario=LOSSY)
    rig.receive[COUNTED.complete.name](COUNTED.complete.codec.encode(0, 1.0))
    rig.receive[COUNTED.complete.name](COUNTED.complete.codec.encode(STEP, count))
    (failure,) = rig.recorder.failures
    assert failure == (
        f"/platoon/vehicle_1/v2v/complete: counts {count:g} messages after 1: it comes from "
        "another publisher; everything from sample 1 on may be wrong"
    )


def test_messages_that_nobody_counted_are_named_at_the_end() -> None:
    """A message of another publisher is taken for the next packet, and one of ours is left over."""
    rig = Rig(COUNTED.received, COUNTED.complete, scenario=LOSSY)
    received, complete = (rig.receive[t.name] for t in (COUNTED.received, COUNTED.complete))
    last = LOSSY.samples - 1
    for k in range(LOSSY.samples):
        complete(COUNTED.complete.codec.encode(k * STEP, k + 1.0))
        received(COUNTED.received.codec.encode(max(0, k - 1) * STEP, 0.5))
    assert rig.recorder.failures == []
    received(COUNTED.received.codec.encode(last * STEP, 0.5))
    assert rig.recorder.failures == [
        f"{COUNTED.received.name}: has more messages than {COUNTED.complete.name} counts: one "
        "comes from another publisher; everything from sample 0 on may be wrong"
    ]


def test_a_message_that_is_delivered_before_it_was_sent_is_named() -> None:
    rig = Rig(COUNTED.received, COUNTED.complete, scenario=LOSSY)
    rig.receive[COUNTED.received.name](COUNTED.received.codec.encode(9 * STEP, 0.5))
    rig.receive[COUNTED.complete.name](COUNTED.complete.codec.encode(0, 1.0))
    assert rig.recorder.failures == [
        f"{COUNTED.received.name}: a message was delivered before it was sent: one comes from "
        "another publisher; everything from sample 0 on may be wrong"
    ]


def test_of_a_flood_of_failures_the_first_ones_are_kept() -> None:
    rig = Rig(COUNTED.received, COUNTED.complete, scenario=LOSSY)
    for k in range(1000):
        rig.receive[COUNTED.complete.name](COUNTED.complete.codec.encode((k + 5) * STEP, 1.0))
    assert rig.recorder.failures[0].startswith(f"{COUNTED.complete.name}: a message of")
    assert len(rig.recorder.failures) == NAMED


@pytest.mark.parametrize("size", [0, 40])
def test_a_received_message_of_another_size_is_refused(size: int) -> None:
    rig = Rig(COUNTED.received, COUNTED.complete, scenario=LOSSY)
    rig.receive[COUNTED.received.name](bytes(size))
    (failure,) = rig.recorder.failures
    assert failure.startswith(f"/platoon/vehicle_1/v2v/accel: a message of {size} bytes")


def test_a_full_disk_is_a_failure_over_a_lossy_channel_too() -> None:
    def full(_: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    topics = [COUNTED.received, COUNTED.complete]
    writers = {topic.name: full for topic in topics}
    recorder = SampleRecorder(LOSSY, topics, writers, FOLDER, lambda _: None)
    for topic in topics:
        recorder.receiver(topic)(topic.codec.encode(0, 0.0))
    assert recorder.failures == 2 * ["/parts/host_0: cannot be written: No space left on device"]
    assert recorder.samples == {topic.name: 0 for topic in topics}

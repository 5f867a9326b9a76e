"""What a replay is compared with: what was recorded, what is missing, what may be changed."""

import dataclasses
import struct

import numpy as np
import pytest

from cacc_platoon.bags.write import write_bag
from cacc_platoon.errors import UserError
from cacc_platoon.replay import (
    Difference,
    changed_scenario,
    comparison_document,
    first_difference,
    possible_causes,
    read_node,
    what_if,
    what_if_figure,
)
from cacc_platoon.runs.info import RunInfo
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import format_scenario
from cacc_platoon.simulation import simulate
from msg_adapters.topics import VehicleTopics

VALUES = {
    "platoon.followers": 3,
    "run.duration": 2.0,
    "leader.start": 0.2,
    "leader.amplitude": 2.0,
}
SCENARIO = Scenario.from_values(VALUES)
TWO_DIGITS = Scenario.from_values(VALUES | {"platoon.first_follower": 10})
OWN, AHEAD = VehicleTopics("/platoon", 2), VehicleTopics("/platoon", 1)


def make_bag(path, scenario=SCENARIO, **changes):
    """Write the run with some topics changed: a function of the messages, or None for none."""
    recording = recording_of(simulate(scenario))
    for topic, change in changes.items():
        name = f"/platoon/vehicle_{topic[1]}/{topic[3:].replace('__', '/')}"
        record = recording.pop(name)
        if change:
            messages = change(record.messages.copy())
            recording[name] = record._replace(messages=messages, delivered=None)
    write_bag(
        path,
        recording,
        step_ns=SCENARIO.step_ns,
        depth=100,
        scenario_topic="/platoon/scenario",
        scenario_text=format_scenario(scenario),
        custom_data={},
    )
    return path


def answers(record, scenario=SCENARIO):
    """Return what a node that works says: what the simulation says."""
    recording = recording_of(simulate(scenario))
    return {
        stream.topic.name: [
            row.tobytes() for row in recording[stream.topic.name].messages[: record.samples]
        ]
        for stream in record.outputs
    }


def lossy_answers(record):
    """Return what a relay says that loses packets, every message of the run."""
    recording = recording_of(simulate(record.scenario))
    return {
        stream.topic.name: [row.tobytes() for row in recording[stream.topic.name].messages]
        for stream in record.outputs
    }


def found_difference(record, replayed) -> Difference:
    difference = first_difference(record, replayed)
    assert difference is not None
    return difference


def test_inputs_and_outputs_of_every_node(tmp_path):
    bag = make_bag(tmp_path / "bag")
    own = [topic.name for topic in (OWN.pose, OWN.twist, OWN.accel)]
    subscribed = [topic.name for topic in (AHEAD.pose, AHEAD.twist, OWN.received)]
    for node, inputs, outputs in (
        ("vehicle", subscribed, own),
        ("noise_relay", [AHEAD.accel.name], [OWN.received.name]),
    ):
        record = read_node(bag, 2, node)
        assert [stream.topic.name for stream in record.inputs] == inputs
        assert [stream.topic.name for stream in record.outputs] == outputs
        assert (record.samples, record.notes) == (201, ())
        assert first_difference(record, answers(record)) is None
    leader = read_node(bag, 0)
    assert (leader.node, leader.inputs, leader.samples) == ("leader", (), 201)


@pytest.mark.parametrize("name", ["pose", "twist", "accel"])
@pytest.mark.parametrize("sample", [0, 57, 200])
@pytest.mark.parametrize("bit", [0, 51])
def test_one_mantissa_bit_is_seen(tmp_path, name, sample, bit):
    topic = getattr(OWN, name)

    def flip(rows):
        at = topic.codec.size - 8 * topic.kind.doubles
        (number,) = struct.unpack_from("<Q", rows[sample].tobytes(), at)
        rows[sample, at : at + 8] = np.frombuffer(struct.pack("<Q", number ^ 1 << bit), np.uint8)
        return rows

    record = read_node(make_bag(tmp_path / "bag", **{f"v2_{name}": flip}), 2)
    difference = found_difference(record, answers(record))
    assert (difference.topic, difference.sample) == (topic.name, sample)
    assert difference.time == sample * 0.01
    assert repr(difference.recorded) in str(difference)
    assert repr(difference.replayed) in str(difference)


def test_a_byte_that_is_no_number_is_seen(tmp_path):
    def change(rows):
        rows[9, 20] ^= 1  # inside the frame_id
        return rows

    record = read_node(make_bag(tmp_path / "bag", v2_accel=change), 2)
    assert "byte 20 of the message is" in str(first_difference(record, answers(record)))


def test_padding_does_not_count(tmp_path):
    """The frame vehicle_11/base_link ends at byte 37, the numbers begin at byte 44."""
    record = read_node(make_bag(tmp_path / "bag", TWO_DIGITS), 11)
    replayed = answers(record, TWO_DIGITS)
    name = VehicleTopics("/platoon", 11).twist.name
    replayed[name] = [data[:37] + b"\x5a" * 7 + data[44:] for data in replayed[name]]
    assert first_difference(record, replayed) is None
    replayed[name][4] = replayed[name][4][:36] + b"\x5a" + replayed[name][4][37:]
    assert found_difference(record, replayed).sample == 4


def test_the_first_difference_in_time_is_reported(tmp_path):
    record = read_node(make_bag(tmp_path / "bag"), 2)
    replayed = answers(record)
    for topic, sample in ((OWN.pose, 120), (OWN.accel, 60), (OWN.twist, 61)):
        data = topic.codec.encode(sample * SCENARIO.step_ns, 99.0)
        replayed[topic.name][sample] = data
    difference = found_difference(record, replayed)
    assert (difference.topic, difference.sample) == (OWN.accel.name, 60)


def test_another_length_is_a_difference(tmp_path):
    record = read_node(make_bag(tmp_path / "bag"), 2)
    replayed = answers(record)
    replayed[OWN.pose.name][3] += b"\0"
    assert "bytes replayed" in str(first_difference(record, replayed))


@pytest.mark.parametrize(
    ("topic", "length", "samples"),
    [("v2_pose", 100, 100), ("v1_pose", 100, 101), ("v2_v2v__accel", 100, 101)],
)
def test_it_goes_as_far_as_the_bag(tmp_path, topic, length, samples):
    bag = make_bag(tmp_path / "bag", **{topic: lambda rows: rows[:length]})
    record = read_node(bag, 2)
    assert record.samples == samples
    assert record.notes == (
        f"/platoon/vehicle_{topic[1]}/{topic[3:].replace('__', '/')} ends at sample 99",
    )
    assert first_difference(record, answers(record)) is None
    answer = what_if(record, record.scenario, answers(record))
    assert answer.recorded == answer.replayed


def test_a_gap_in_what_the_vehicle_published_is_a_difference(tmp_path):
    record = read_node(make_bag(tmp_path / "bag", v2_twist=lambda r: np.delete(r, 70, axis=0)), 2)
    difference = found_difference(record, answers(record))
    assert (difference.topic, difference.sample) == (OWN.twist.name, 70)
    assert difference.what == "/platoon/vehicle_2/twist lacks sample 70"


def test_what_the_channel_lost_is_fed_as_lost(tmp_path):
    lossy = Scenario.from_values(VALUES | {"v2v.loss": 0.3})
    run = simulate(lossy)
    assert run.arrivals is not None
    record = read_node(make_bag(tmp_path / "bag", lossy), 2)
    feed = {topic.name: samples for topic, samples in record.feed()}
    delivered = [k for k, messages in enumerate(feed[OWN.received.name]) if messages]
    assert delivered == run.arrivals[1].sample.tolist()
    assert all(len(messages) == 1 for messages in feed[OWN.complete.name])
    assert record.samples == 201
    relay = read_node(tmp_path / "bag", 2, "noise_relay")
    assert [stream.count(201) for stream in relay.outputs] == [len(delivered), 201]


def test_a_link_that_loses_everything_is_replayed(tmp_path):
    lossy = Scenario.from_values(VALUES | {"v2v.loss": 1.0})
    record = read_node(make_bag(tmp_path / "bag", lossy), 2)
    assert record.samples == 201
    feed = {topic.name: samples for topic, samples in record.feed()}
    assert feed[OWN.received.name] == [[]] * 201


def test_a_gap_in_what_no_channel_loses_ends_the_replay(tmp_path):
    bag = make_bag(tmp_path / "bag", v2_v2v__accel=lambda rows: np.delete(rows, 50, axis=0))
    record = read_node(bag, 2)
    assert record.samples == 51
    assert record.notes == ("/platoon/vehicle_2/v2v/accel lacks sample 50",)


def counting(change):
    """Return a change of messages that changes the counts in them, an array of floats."""

    def changed(rows):
        at = OWN.complete.codec.size - 8 * OWN.complete.kind.doubles
        counts = rows[:, at : at + 8].copy().view("<f8")[:, 0]
        change(counts)
        rows[:, at : at + 8] = counts[:, None].view(np.uint8)
        return rows

    return changed


def put(sample, count):
    """Return a change of counts: another one at a sample."""

    def change(counts):
        counts[sample] = count

    return counting(change)


def lossy_bag(path, **changes):
    """Write a run of which a third of the packets is lost, with some topics changed."""
    return make_bag(path, Scenario.from_values(VALUES | {"v2v.loss": 0.3}), **changes)


DAMAGED = [
    (put(200, 1e300), 200, "counts 1e+300 messages at sample 200 after "),
    (put(60, np.nan), 60, "counts nan messages at sample 60 after "),
    (put(60, np.inf), 60, "counts inf messages at sample 60 after "),
    (put(60, 30.5), 60, "counts 30.5 messages at sample 60 after "),
    (put(60, 3.0), 60, "counts 3 messages at sample 60 after "),
    (put(60, -1.0), 60, "counts -1 messages at sample 60 after "),
    (lambda rows: np.delete(rows, 50, axis=0), 50, "lacks sample 50"),
    (lambda rows: np.insert(rows, 50, rows[50], axis=0), 51, "has sample 50 twice"),
]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("change", "known", "words"), DAMAGED)
def test_a_vehicle_is_replayed_as_far_as_the_counts_are_counts(tmp_path, change, known, words):
    record = read_node(lossy_bag(tmp_path / "bag", v2_v2v__complete=change), 2)
    assert record.samples == known + 1
    (note,) = record.notes
    assert note.startswith(f"{OWN.complete.name} {words}")
    (counts,) = (fed for topic, fed in record.feed() if topic.name == OWN.complete.name)
    assert [len(messages) for messages in counts] == [1] * known + [0]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("change", "known", "words"), DAMAGED)
def test_counts_that_no_relay_publishes_are_a_difference(tmp_path, change, known, words):
    record = read_node(lossy_bag(tmp_path / "bag", v2_v2v__complete=change), 2, "noise_relay")
    assert record.samples == known
    difference = found_difference(record, lossy_answers(record))
    assert (difference.topic, difference.sample) == (OWN.complete.name, known)
    assert difference.what.startswith(f"{OWN.complete.name} {words}")


@pytest.mark.parametrize("count", [1.5, -1.0, np.nan, 1e300])
@pytest.mark.parametrize("node", ["vehicle", "noise_relay"])
def test_counts_that_are_none_from_the_beginning_are_refused(tmp_path, count, node):
    bag = lossy_bag(tmp_path / "bag", v2_v2v__complete=put(0, count))
    with pytest.raises(UserError, match=r"complete counts \S+ messages at sample 0") as refusal:
        read_node(bag, 2, node)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(("sample", "count"), [(60, 500.0), (0, 300.0)])
def test_more_are_counted_than_there_are(tmp_path, sample, count):
    bag = lossy_bag(tmp_path / "bag", v2_v2v__complete=put(sample, count))
    words = (
        f"{OWN.complete.name} counts {count:.0f} messages up to sample {sample}, but "
        f"{OWN.received.name} has "
    )
    if not sample:
        with pytest.raises(UserError, match=words):
            read_node(bag, 2)
        return
    record = read_node(bag, 2)
    assert record.samples == 61
    assert record.notes[0].startswith(words)


def test_messages_that_no_sample_counts_are_a_difference(tmp_path):
    def twice(rows):
        return np.concatenate([rows, rows[-1:]])

    record = read_node(lossy_bag(tmp_path / "bag", v2_v2v__accel=twice), 2, "noise_relay")
    assert (record.samples, record.notes) == (201, ())
    difference = found_difference(record, lossy_answers(record))
    assert difference.topic == OWN.received.name
    counted = record.outputs[0].count(201)
    assert difference.what == (
        f"{OWN.complete.name} counts {counted} messages up to sample 200, but "
        f"{OWN.received.name} has {counted + 1}"
    )


@pytest.mark.parametrize(("topic", "last"), [("accel", OWN.received), ("complete", OWN.complete)])
def test_a_counted_link_that_was_cut_short_is_replayed_so_far(tmp_path, topic, last):
    bag = lossy_bag(tmp_path / "bag", **{f"v2_v2v__{topic}": lambda rows: rows[:80]})
    record = read_node(bag, 2, "noise_relay")
    assert 79 < record.samples < 130
    assert last.name in record.notes[0]
    assert first_difference(record, lossy_answers(record)) is None


def test_a_relay_that_delivers_nothing_is_compared(tmp_path):
    lossy = Scenario.from_values(VALUES | {"v2v.loss": 1.0})
    record = read_node(make_bag(tmp_path / "bag", lossy), 2, "noise_relay")
    assert first_difference(record, answers(record, lossy)) is None


def test_what_json_does_not_have_is_null(tmp_path):
    record = read_node(make_bag(tmp_path / "bag"), 2)
    difference = Difference(OWN.pose.name, 3, 0.03, float("nan"), 1.5, "recorded nan")
    document = comparison_document(record, difference, [])
    found = document["first_difference"]
    assert (found["recorded"], found["replayed"]) == (None, 1.5)


@pytest.mark.parametrize("topic", ["v1_pose", "v1_twist", "v2_v2v__accel", "v2_accel"])
def test_a_missing_topic_is_refused_in_one_line(tmp_path, topic):
    name = f"/platoon/vehicle_{topic[1]}/{topic[3:].replace('__', '/')}"
    with pytest.raises(UserError, match=f"lacks {name}, without which vehicle") as refusal:
        read_node(make_bag(tmp_path / "bag", **{topic: None}), 2)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("index", "node", "message"),
    [
        (4, None, "has no vehicle of vehicle_4; vehicle_0 leads and 1 to 3 follow"),
        (0, "noise_relay", "has no noise_relay of vehicle_0"),
        (2, "leader", "vehicle_2 does not lead"),
    ],
)
def test_a_node_that_was_not_there_is_refused(tmp_path, index, node, message):
    with pytest.raises(UserError, match=message):
        read_node(make_bag(tmp_path / "bag"), index, node)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rows: rows[5:], "does not begin with sample 0"),
        (lambda rows: rows[:, :-8], "has messages of another layout"),
    ],
)
def test_a_topic_that_cannot_be_replayed_is_refused(tmp_path, change, message):
    with pytest.raises(UserError, match=message):
        read_node(make_bag(tmp_path / "bag", v2_pose=change), 2)


@pytest.mark.parametrize("setting", ["controller.k_v=0.7", "vehicle_2.controller.k_v=0.7"])
def test_a_setting_is_for_the_replayed_vehicle(tmp_path, setting):
    record = read_node(make_bag(tmp_path / "bag"), 2)
    scenario = changed_scenario(record, [setting])
    assert [follower.gains.k_v for follower in scenario.followers] == [0.63, 0.7, 0.63]


@pytest.mark.parametrize(
    "setting", ["v2v.rho=3", "run.step=0.02", "leader.amplitude=1", "vehicle_3.controller.k_v=1"]
)
def test_a_setting_without_effect_is_refused(tmp_path, setting):
    record = read_node(make_bag(tmp_path / "bag"), 2)
    with pytest.raises(UserError, match="the replay would not change"):
        changed_scenario(record, [setting])


def test_only_a_follower_is_asked_what_it_would_have_done(tmp_path):
    with pytest.raises(UserError, match="vehicle_0/leader is none"):
        changed_scenario(read_node(make_bag(tmp_path / "bag"), 0), ["controller.k_v=1"])


def test_what_if_nothing_had_changed(tmp_path):
    record = read_node(make_bag(tmp_path / "bag"), 2)
    answer = what_if(record, record.scenario, answers(record))
    assert answer.recorded == answer.replayed
    run = simulate(SCENARIO)
    assert answer.recorded.max_abs_spacing_error == np.abs(run.spacing_error[:, 1]).max()
    assert answer.recorded.min_gap == np.min(run.gap[:, 1])
    assert (answer.recorded_error == run.spacing_error[:, 1]).all()
    figure = what_if_figure(answer, 2, ["controller.k_v=0.7"])
    assert "with controller.k_v=0.7" in figure
    assert figure.startswith("<svg xmlns")


def test_a_replay_tells_how_the_data_of_the_run_stand(tmp_path):
    """All that this vehicle said is the same, and yet the run is not the one that was recorded."""
    record = read_node(make_bag(tmp_path / "bag"), 2)
    assert first_difference(record, answers(record)) is None
    assert comparison_document(record)["standing"]["state"] == "intact"
    run = dataclasses.replace(record.run, digest_recorded="1" * 64)
    altered = dataclasses.replace(record, run=run)
    assert first_difference(altered, answers(altered)) is None
    assert comparison_document(altered)["standing"]["state"] == "altered"
    assert not comparison_document(altered)["standing"]["stands"]


def test_causes_begin_with_what_is_known(tmp_path):
    record = read_node(make_bag(tmp_path / "bag"), 2)
    assert "carries no digest" in possible_causes(record)[0]
    info = RunInfo(fingerprint={"math": "0", "machine": "riscv64"}, versions={"numpy": "1.0"})
    run = dataclasses.replace(record.run, info=info)
    first, second, *_ = possible_causes(dataclasses.replace(record, run=run))
    assert "recorded on riscv64" in first
    assert "numpy 1.0 then" in second


@pytest.mark.parametrize("values", [{"v2v.reception": "fallback"}, {"record.command": True}])
def test_what_is_for_viewers_alone_need_not_be_in_the_bag(tmp_path, values):
    """A simulated run and a bag of another tool have neither commands nor states of reception."""
    one = SCENARIO.with_values({**values, "v2v.loss": 0.3})
    record = read_node(make_bag(tmp_path / "bag", one), 2, "vehicle")
    assert [stream.topic for stream in record.outputs] == list(OWN.motion)
    assert record.samples == one.samples
    with pytest.raises(UserError, match="lacks /platoon/vehicle_2/twist"):
        read_node(make_bag(tmp_path / "other", one, v2_twist=None), 2, "vehicle")

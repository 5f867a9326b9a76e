"""The first message in which a replay differs from its recording, and what may have caused it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from cacc_platoon.bags.raw import Bytes
from cacc_platoon.replay.node_record import NodeRecord, Stream
from cacc_platoon.runs.folder import fingerprint, versions
from cacc_platoon.scenario.names import vehicle_name
from msg_adapters.topics import Topic

_UNITS = {"PoseStamped": "m", "TwistStamped": "m/s", "AccelStamped": "m/s^2"}


class Difference(NamedTuple):
    """A message that was replayed differently.

    Attributes
    ----------
    topic : str
        Its topic.
    sample : int
        Its sample.
    time : float
        Its stamp [s].
    recorded, replayed : float or None
        The position [m], velocity [m/s] or acceleration [m/s^2] in it; None when there is none.
    what : str
        The difference in words.
    """

    topic: str
    sample: int
    time: float
    recorded: float | None
    replayed: float | None
    what: str

    def __str__(self) -> str:
        return f"{self.topic} differs first at sample {self.sample} ({self.time:g} s): {self.what}"


def first_difference(
    record: NodeRecord, replayed: Mapping[str, Sequence[bytes]]
) -> Difference | None:
    """Compare what a node published with what was recorded, every byte of every message.

    Parameters
    ----------
    record : NodeRecord
        What was recorded.
    replayed : mapping of str to sequence of bytes
        By topic the CDR bytes of the messages of `record.samples` samples.

    Returns
    -------
    Difference or None
        The first one in time; None when all messages are identical.
    """
    found = [
        (stream.sample_of(row), order, row, stream)
        for order, stream in enumerate(record.outputs)
        if (row := _first_row(record, stream, replayed[stream.topic.name])) is not None
    ]
    if not found:
        return None
    _, _, row, stream = min(found, key=lambda one: one[:2])
    return _describe(record, stream, row, replayed[stream.topic.name])


def _first_row(record: NodeRecord, stream: Stream, replayed: Sequence[bytes]) -> int | None:
    """Return the number of the first message that differs."""
    size, count = stream.messages.shape[1], stream.count(record.samples)
    for row in range(count):
        if len(replayed[row]) != size:
            return row
    same = (_rows(stream.topic, replayed[:count]) == stream.messages[:count]).all(axis=1)
    if not same.all():
        return int(same.argmin())
    return count if stream.gap and stream.unbroken == record.samples else None


def _rows(topic: Topic, messages: Sequence[bytes]) -> Bytes:
    """Return messages of one length as rows, padding zeroed."""
    clean = b"".join(map(topic.codec.zero_padding, messages))
    return np.frombuffer(clean, np.uint8).reshape(len(messages), topic.codec.size)


def _describe(
    record: NodeRecord, stream: Stream, row: int, replayed: Sequence[bytes]
) -> Difference:
    topic, sample = stream.topic, stream.sample_of(row)
    place = (topic.name, sample, sample * record.scenario.run.step)
    if sample >= record.samples:
        return Difference(*place, None, None, stream.end)
    recorded = stream.messages[row].tobytes()
    answer = topic.codec.zero_padding(replayed[row])
    (stamp, before), unit = (
        topic.codec.decode(recorded),
        _UNITS.get(topic.kind.type_name.split("/")[-1], ""),
    )
    if len(answer) != len(recorded):
        what = f"{len(recorded)} bytes were recorded, {len(answer)} bytes replayed"
        return Difference(*place, before, None, what)
    replayed_stamp, now = topic.codec.decode(answer)
    if before != now:
        what = (
            f"recorded {before!r} {unit}, replayed {now!r} {unit}, difference {now - before:.3g} "
            f"{unit}"
        )
    elif stamp != replayed_stamp:
        what = f"recorded stamp {stamp} ns, replayed {replayed_stamp} ns"
    else:
        at = next(k for k, (a, b) in enumerate(zip(recorded, answer, strict=True)) if a != b)
        what = f"byte {at} of the message is {recorded[at]:#04x}, replayed {answer[at]:#04x}"
    return Difference(*place, before, now, what)


def possible_causes(record: NodeRecord) -> list[str]:
    """Return what may have made the difference, what is known to differ first."""
    run = record.run
    if run.digest_recorded and run.digest != run.digest_recorded:
        return ["the bag was altered after the run: its digest is not the one that was recorded"]
    causes = []
    then, now = run.info.fingerprint if run.info else {}, fingerprint()
    if then and then.get("math") != now["math"]:
        there = f"{then.get('machine')}, {then.get('libc')}"
        causes.append(
            f"another platform: recorded on {there} and replayed on {now['machine']}, "
            f"{now['libc']}, whose sin and exp differ"
        )
    recorded = run.info.versions if run.info else {}
    changed = [
        f"{name} {recorded[name]} then, {version} now"
        for name, version in versions().items()
        if recorded.get(name, version) != version
    ]
    if changed:
        causes.append("other versions: " + ", ".join(changed))
    if not run.digest_recorded:
        causes.append("the bag was altered, it carries no digest")
    node = f"{vehicle_name(record.index)}/{record.node}"
    causes.append(f"the code has changed, or {node} ran with other parameters than its scenario's")
    return causes

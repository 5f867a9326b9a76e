"""Does a fault to a running platoon: each kind is one function."""

from __future__ import annotations

import contextlib
import fcntl
import random
import resource
import shutil
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from geometry_msgs.msg import Vector3Stamped
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from std_msgs.msg import Bool, Int64, String

from cacc_platoon.campaign.messages import (
    forged_state,
    forged_status,
    malformed,
    of_another_version,
    oversized,
    type_of,
)
from cacc_platoon.campaign.plan import Fault
from cacc_platoon.campaign.witness import LIMIT, Witness, signal_to
from cacc_platoon.nodes import qos
from cacc_platoon.nodes.node import MESSAGE_TYPES
from cacc_platoon.testing import Platoon
from msg_adapters.topics import Graph, Topic

TYPES = {**MESSAGE_TYPES, "std_msgs/msg/String": String, "std_msgs/msg/Int64": Int64}
NO_ROOM = 20_000
"""No file grows beyond this on a disk that is full [bytes]."""
OBSERVER = "/observer"
"""The node that publishes what is foreign."""
AT_ONCE = 500
"""Messages of a flood between two looks at whether the run goes on."""
TWICE = 0.1
"""How long after the first a signal is repeated [s]."""
_SIOCGIFFLAGS, _SIOCSIFFLAGS, _UP = 0x8913, 0x8914, 1


class Deed:
    """One fault and the platoon that it happens to.

    Parameters
    ----------
    fault : Fault
        What happens.
    witness : Witness
        The platoon.
    elsewhere : Path
        A folder for what is forged.

    Attributes
    ----------
    suspects : tuple of str
        What the run may call who or what it was.
    late : bool
        Whether the run was over before.
    others : list of subprocess.Popen
        Processes besides the platoon's.
    """

    def __init__(self, fault: Fault, witness: Witness, elsewhere: Path) -> None:
        self._fault, self._witness, self._elsewhere = fault, witness, elsewhere
        self._run: Platoon = witness.run
        self._graph = Graph.of(self._run.scenario)
        self.suspects: tuple[str, ...] = (fault.target, OBSERVER, "supervisor")
        self.late = False
        self.others: list[subprocess.Popen[str]] = []

    def do(self) -> None:
        """Let the fault happen; it has happened when this returns."""
        self.late = self._witness.over
        getattr(self, f"_{self._fault.kind}")()

    # Processes.

    def _aim(self) -> int:
        pid = self._witness.process(self._fault)
        self.late = self.late or not pid
        self.suspects = self._witness.names(pid) if pid else self.suspects
        return pid

    def _kill(self) -> None:
        signal_to(self._aim(), signal.SIGKILL)

    _kill_restarted = _kill

    def _signal(self) -> None:
        signal_to(self._aim(), signal.Signals[self._fault.variant])

    def _signal_twice(self) -> None:
        self._signal()
        self._witness.let_pass(TWICE)
        self._signal()

    def _freeze(self) -> None:
        pid = self._aim()
        signal_to(pid, signal.SIGSTOP)
        try:
            self._witness.let_pass(self._fault.amount)
        finally:
            signal_to(pid, signal.SIGCONT)

    _freeze_long = _freeze_supervisor = _freeze

    # Messages.

    def _publisher(self, topic: str, profile: QoSProfile | None = None) -> Publisher:
        """Return a publisher of a topic that somebody hears, unless the run ends before."""
        data = topic in [known.name for known in self._graph.recorded]
        usual = qos.stream(self._run.scenario) if data else qos.latched(1000)
        message_type = TYPES[type_of(self._graph, topic)]
        publisher = self._run.advertise(message_type, topic, profile or usual)
        deaf = {self._graph.platoon.events, self._graph.platoon.scenario}
        if topic not in deaf:  # nobody of the platoon listens to these
            self._witness.wait(
                lambda: publisher.get_subscription_count() > 0 or self._witness.over,
                LIMIT,
                f"a subscriber of {topic}",
            )
        self.late = self.late or self._witness.over
        return publisher

    def _publish(self, messages: Iterator[Any], most: int) -> None:
        """Publish so many messages, as long as there is somebody to hear them."""
        publisher = self._publisher(self._fault.target)
        for count, message in enumerate(messages):
            if count >= most or (count % AT_ONCE == 0 and self._witness.ended):
                return
            publisher.publish(message)

    def _flood(self) -> None:
        self._publish(self._flooding(), int(self._fault.amount))

    def _flooding(self) -> Iterator[bytes]:
        """Yield the messages of a flood, in CDR."""
        topic, draw = self._fault.target, random.Random(self._fault.index)
        strange = self._fault.variant == "nonsense"
        known = [one for one in self._graph.recorded if one.name == topic]
        step, sample = self._run.scenario.step_ns, max(self._witness.sample, 0)
        text = serialize_message(String(data=self._genuine(topic)))
        nonsense = serialize_message(String(data="nonsense" * 20))
        while True:
            sample += 1
            if known:
                stamp = draw.randrange(2**62) if strange else sample * step
                yield known[0].codec.encode(stamp, draw.gauss(0.0, 1.0))
            elif type_of(self._graph, topic).endswith("Int64"):
                value = draw.randrange(-(2**62), 2**62) if strange else sample
                yield serialize_message(Int64(data=value))
            else:
                yield nonsense if strange else text

    def _genuine(self, topic: str) -> str:
        """Return a text as the platoon itself has sent it on a topic."""
        status = self._witness.status
        if topic == self._graph.platoon.host_state and self._witness.states:
            return self._witness.states[min(self._witness.states)].to_json()
        return status.to_json() if status else "{}"

    def _say(self, texts: Iterator[str]) -> None:
        self._publish((String(data=text) for text in texts), 1000)

    def _forged_state(self) -> None:
        self._witness.wait(lambda: bool(self._witness.states), LIMIT, "the state of a host")
        state = self._witness.states[min(self._witness.states)]
        forged = forged_state(state, self._fault.variant, self._elsewhere)
        self.suspects += (f"host {forged.host}",)
        self._say(iter([forged.to_json()]))

    def _forged_status(self) -> None:
        self._witness.wait(lambda: self._witness.status is not None, LIMIT, "a status")
        assert self._witness.status is not None
        self._say(iter([forged_status(self._witness.status, self._fault.variant).to_json()]))

    def _forged_progress(self) -> None:
        self.suspects += ("host 0",)
        sample = 10**9 if self._fault.variant == "ahead" else -5
        self._publish(iter([Int64(data=sample)]), 1)

    def _forged_count(self) -> None:
        ahead = 1000 if self._fault.variant == "ahead" else 0
        message = Vector3Stamped()
        at = (max(self._witness.sample, 0) + ahead) * self._run.scenario.step_ns
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(at, 10**9)
        message.vector.x = 1e6
        self._publish(iter([message]), 1)

    def _malformed(self) -> None:
        draw = random.Random(self._fault.index)
        genuine = self._genuine(self._fault.target)
        self._say(malformed(draw, genuine, max(1, int(self._fault.amount))))

    def _oversized(self) -> None:
        self._say(iter([oversized(self._genuine(self._fault.target), self._fault.amount)]))

    def _other_version(self) -> None:
        text = self._genuine(self._fault.target)
        self._say(iter([of_another_version(text, max(1, int(self._fault.amount)))]))

    def _foreign_data(self) -> None:
        topic = next(one for one in self._graph.recorded if one.name == self._fault.target)
        self._publish(self._samples(topic), max(1, int(self._fault.amount)))

    def _samples(self, topic: Topic) -> Iterator[Any]:
        """Yield samples that are not due, or messages that are no samples of this topic."""
        step = self._run.scenario.step_ns
        sample = max(self._witness.sample, 0) + 1000 if self._fault.variant == "ahead" else 0
        garbage = TYPES[topic.kind.type_name]()
        garbage.header.frame_id = "nonsense"
        while True:
            sample += 1
            strange = self._fault.variant == "garbage"
            yield garbage if strange else topic.codec.encode(sample * step, 0.25)

    def _foreign_silent(self) -> None:
        self._publisher(self._fault.target)

    def _foreign_deaf(self) -> None:
        self._run.advertise(Bool, self._fault.target, 1)

    # Surroundings.

    def _second_platoon(self) -> None:
        command = [sys.executable, "-m", "cacc_platoon", "run", str(self._run.scenario_file)]
        other = subprocess.Popen(
            [*command, "-o", str(self._elsewhere / "second"), "--no-report"],
            env=self._run.environment(),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.others.append(other)

    def _full_disk(self) -> None:
        everybody = self._fault.target == "everybody"
        for pid in self._run.living() if everybody else [self._run.pid("supervisor")]:
            with contextlib.suppress(ProcessLookupError):
                _, hard = resource.prlimit(pid, resource.RLIMIT_FSIZE)
                resource.prlimit(pid, resource.RLIMIT_FSIZE, (NO_ROOM, hard))

    def _deleted(self) -> None:
        folder = self._run.folder
        self.suspects = ("deleted",)
        shutil.rmtree(folder.parts if self._fault.target == "parts" else folder.path, True)

    def _cut(self) -> None:
        self.suspects = ("vehicle_", "host ")
        loopback(up=False)
        try:
            self._witness.let_pass(self._fault.amount)
        finally:
            loopback(up=True)

    _cut_long = _cut


def loopback(*, up: bool) -> None:
    """Take the loopback link of this network down, or bring it up again."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        asked = struct.pack("16sH14x", b"lo", 0)
        (flags,) = struct.unpack("16xH14x", fcntl.ioctl(any_socket, _SIOCGIFFLAGS, asked))
        wanted = flags | _UP if up else flags & ~_UP
        fcntl.ioctl(any_socket, _SIOCSIFFLAGS, struct.pack("16sH14x", b"lo", wanted))

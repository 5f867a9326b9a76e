"""What a vehicle by a clock says of itself on /diagnostics: lateness and ages, once a second."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

TOPIC = "/diagnostics"
PERIOD = 1.0
"""How often it is said [s]."""


class Summary(NamedTuple):
    """What some samples were like.

    Attributes
    ----------
    samples : int
        How many there were.
    latest : float
        The largest lateness [control periods].
    overruns : int
        How many came a control period late, or more.
    oldest : int
        The largest age of the predecessor's pose that was used [samples].
    packets : int
        Packets that were used.
    """

    samples: int
    latest: float
    overruns: int
    oldest: int
    packets: int

    @property
    def level(self) -> bytes:
        """How serious it is."""
        if not self.samples:
            return bytes(DiagnosticStatus.STALE)
        return bytes(DiagnosticStatus.WARN if self.overruns else DiagnosticStatus.OK)

    @property
    def message(self) -> str:
        """It in a few words."""
        if not self.samples:
            return "no sample was taken"
        if not self.overruns:
            return "in time"
        return f"{self.overruns} of {self.samples} samples a period late, or more"


class ClockDiagnostics:
    """Sums up the samples of a vehicle from one message to the next.

    Parameters
    ----------
    name : str
        Of the vehicle, as far as the platoon's prefix is concerned too.
    step, period : float
        Control period, and how long it takes by the clock [s].
    """

    def __init__(self, name: str, step: float, period: float) -> None:
        self._name, self._step, self._period = name, step, period
        self._timing: list[tuple[float, float]] = []
        self._packets: dict[int, int] = {}
        self._told = 0

    def take_timing(self, stamp: int, age: float, lateness: float) -> None:
        """Take note of a sample: age of the pose and lateness [control periods]."""
        self._timing.append((age, lateness))

    def take_count(self, link: int, count: int) -> None:
        """Take note of how many packets of a link were used in all."""
        self._packets[link] = count

    def summary(self) -> Summary:
        """Return what the samples since the last time were like."""
        timing, used = self._timing, sum(self._packets.values())
        packets = used - self._told
        self._timing, self._told = [], used
        late = [lateness for _, lateness in timing]
        return Summary(
            len(timing),
            max(late, default=0.0),
            sum(1 for lateness in late if lateness >= 1.0),
            int(max((age for age, _ in timing), default=0.0)),
            packets,
        )

    def message(self, sec: int, nanosec: int) -> DiagnosticArray:
        """Return what there is to say, stamped with a time."""
        found = self.summary()
        status = DiagnosticStatus(
            level=found.level,
            name=f"{self._name}: clock",
            message=found.message,
            hardware_id=self._name,
            values=_key_values(
                [
                    ("samples", f"{found.samples}"),
                    ("largest lateness [s]", f"{found.latest * self._period:.6f}"),
                    ("samples a period late or more", f"{found.overruns}"),
                    ("oldest pose used [s]", f"{found.oldest * self._step:g}"),
                    ("packets used", f"{found.packets}"),
                ]
            ),
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp.sec, array.header.stamp.nanosec = sec, nanosec
        return array


def _key_values(values: Sequence[tuple[str, str]]) -> list[KeyValue]:
    return [KeyValue(key=key, value=value) for key, value in values]

"""When packets come, as a certificate is asked."""

from __future__ import annotations

from typing import NamedTuple

from cacc_platoon.scenario import Follower, Scenario


class PacketRate(NamedTuple):
    """When a follower's packets come, as a certificate is asked.

    Attributes
    ----------
    period : float or None
        Time from packet to packet [s]; None where one comes every control period, at once.
    latency : float
        Time from sending to arrival [s].
    """

    period: float | None
    latency: float

    def __str__(self) -> str:
        """Say it in words, without a full stop."""
        late = f", {self.latency:g} s late" if self.latency else ""
        return f"a packet every {self.period:g} s{late}"


def packet_times(follower: Follower, step: float) -> PacketRate:
    """Return when a follower's packets come; a custom channel's own times are not known.

    Examples
    --------
    >>> scenario = Scenario.from_values({"v2v.period": 0.1, "v2v.latency": 0.02})
    >>> str(packet_times(scenario.follower(1), scenario.run.step))
    'a packet every 0.1 s, 0.02 s late'
    """
    if follower.timing().prompt:
        return PacketRate(None, 0.0)
    return PacketRate(
        round(follower.send_times.interval * step, 12), round(follower.latency_steps * step, 12)
    )


def send_together(scenario: Scenario) -> bool:
    """Return whether all links send at the same instants.

    Examples
    --------
    >>> send_together(Scenario.from_values({"v2v.period": 0.1, "v2v.phase": "random"}))
    False
    """
    return len({follower.send_times for follower in scenario.receivers}) == 1

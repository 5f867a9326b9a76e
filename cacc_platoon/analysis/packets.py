"""What rare and late packets make of a verdict: growth per hop, and what no theorem covers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from cacc_platoon.analysis.follower_verdict import FollowerVerdict
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


def growth_with_packets(
    scenario: Scenario, verdicts: Sequence[FollowerVerdict], *, equal: bool
) -> Iterator[str]:
    """Say where the packets of a run make errors grow, or where no theorem covers them."""
    rare = [one for one in verdicts if one.certificate is not None and one.certificate.rare]
    if rare and not equal:
        yield (
            "packets have a period of their own on unequal links: growth per hop is proven of "
            "equal ones alone"
        )
    elif rare and not send_together(scenario):
        yield (
            "packets have a period of their own and links send at different instants (v2v.phase): "
            "growth per hop is proven where all send at the same ones"
        )
    growing = {
        one.follower: one.certificate.v2v_growth
        for one in verdicts
        if one.certificate is not None
        and one.certificate.v2v_growth is not None
        and one.certificate.v2v_growth.growth > 1.0
    }
    if not growing:
        return
    worst = max(growing, key=lambda follower: growing[follower].growth)
    follower = scenario.follower(worst)
    times = packet_times(follower, scenario.run.step)
    bursts = follower.v2v.burst_begin and follower.holds
    were = ", if losses did not depend on each other" if bursts else ""
    count = "" if len(growing) == len(verdicts) else f" (vehicle {worst}, {len(growing)} in all)"
    found = growing[worst]
    yield (
        f"with {times}{were}, accelerations grow in the mean by {found.growth:.6g} per hop at "
        f"{found.omega:.4g} rad/s, lag {found.tau:g} s and k = {found.k_effective:.4g}{count}: "
        "send more often, or take gains that bear it (platoon design --v2v-period)"
    )

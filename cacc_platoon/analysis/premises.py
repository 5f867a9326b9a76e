"""What a certificate takes for granted of a run, and where the run broke it."""

from __future__ import annotations

from cacc_platoon.analysis.consistency import Consistency
from cacc_platoon.analysis.noise import LinkNoise


def broken_premises(noise: list[LinkNoise], consistency: Consistency | None) -> list[str]:
    """Say why a certificate does not cover the run."""
    reasons = []
    broken = [link for link in noise if link.breaches]
    if broken:
        first = min(broken, key=lambda link: link.first_breach)
        samples = sum(link.breaches for link in broken)
        reasons.append(
            f"the channel left 1 - 1/rho <= w <= 1 + 1/rho on {len(broken)} of {len(noise)} links "
            f"({samples} samples), first on link {first.follower - 1} -> {first.follower} at "
            f"{first.first_breach:g} s"
        )
    if consistency and consistency.departures:
        follower, time, apart = min(consistency.departures, key=lambda item: item[1])
        reasons.append(
            f"vehicle {follower} departs from its scenario's equations at {time:g} s by "
            f"{apart:.3g} ({len(consistency.departures)} vehicles in all): other gains, another "
            "law, or data that were altered"
        )
    return reasons

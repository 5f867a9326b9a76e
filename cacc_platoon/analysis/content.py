"""What a verdict loses where packets say something else than noise times an acceleration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from cacc_platoon.model.keyed_random import LARGEST_NORMAL
from cacc_platoon.scenario import Follower, Scenario

_NAMES = ("bias", "noise_std", "quantum", "saturation")


def content_premises(scenario: Scenario) -> Iterator[str]:
    """Say where packets say, or take, what no theorem knows of."""
    receivers = scenario.receivers
    yield from _errors([follower for follower in receivers if follower.errs])
    yield from _false_data([follower for follower in receivers if follower.v2v.false_data])
    if any(follower.triggered for follower in receivers):
        yield (
            "packets are sent as the sender moves (v2v.send_rule = cam), 0.1 to 1 s apart: what is "
            "proven is of packets at fixed times; in the expectation run they are sent as the "
            "sender moves in the mean"
        )
    late = [follower.v2v for follower in receivers if follower.v2v.jitter]
    if late:
        least, most = min(v2v.latency for v2v in late), max(v2v.jitter for v2v in late)
        yield (
            f"packets take different times (v2v.jitter, up to {most:g} s beside a latency of "
            f"{least:g} s): what is proven is of one latency for all; the expectation run takes "
            "the mean one"
        )


def _errors(receivers: Sequence[Follower]) -> Iterator[str]:
    """Name errors that are added to accelerations; the largest, where there is one."""
    if not receivers:
        return
    given = [name for name in _NAMES if any(getattr(one.v2v, name) for one in receivers)]
    largest = max(
        abs(one.v2v.bias) + LARGEST_NORMAL * one.v2v.noise_std + 0.5 * one.v2v.quantum
        for one in receivers
    )
    limits = [one.v2v.saturation for one in receivers if one.v2v.saturation]
    cut = f", and cut at {min(limits):g} m/s^2" if limits else ""
    rounded = "quantum" in given or limits
    yield (
        f"packets have errors that multiply nothing ({', '.join(f'v2v.{name}' for name in given)}: "
        f"up to {largest:g} m/s^2{cut}): each vehicle adds some to what it is sent, and what is "
        "proven, that nothing grows, is of packets without them"
        + ("; the expectation run neither rounds nor cuts" if rounded else "")
    )


def _false_data(receivers: Sequence[Follower]) -> Iterator[str]:
    """Name times of false data."""
    if not receivers:
        return
    step = receivers[0].step
    times = [one for follower in receivers for one in follower.forgeries]
    begin, end = min(one.begin for one in times), max(one.end for one in times)
    count = len({follower.link for follower in receivers})
    yield (
        f"packets carry false data between {begin * step:g} and {end * step:g} s on {count} "
        f"link{'s' * (count > 1)} (v2v.false_data): nothing is proven of what they do to a platoon"
    )

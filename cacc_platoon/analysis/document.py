"""The numbers of a run and of a verdict by the names that metrics.json gives them."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from cacc_platoon.model import ReceptionState

if TYPE_CHECKING:
    from cacc_platoon.analysis.age import LinkReception
    from cacc_platoon.analysis.clocks import ClockUse
    from cacc_platoon.analysis.fallback import FallbackUse
    from cacc_platoon.analysis.follower_verdict import FollowerVerdict
    from cacc_platoon.analysis.metrics import Metrics
    from cacc_platoon.analysis.monitor import MonitorUse
    from cacc_platoon.analysis.verdict import Verdict


def plain_values(value: Any, *, infinite: bool = False) -> Any:
    """Return arrays as lists, numpy numbers as Python's, what is not finite as None.

    With `infinite`, what is infinite stays as it is.
    """
    plain = partial(plain_values, infinite=infinite)
    match value:
        case dict():
            return {str(key): plain(item) for key, item in value.items()}
        case list() | tuple():
            return [plain(item) for item in value]
        case np.ndarray():
            return plain(value.tolist())
        case np.generic():
            return plain(value.item())
        case float() if math.isnan(value) or not (infinite or math.isfinite(value)):
            return None
    return value


def run_document(metrics: Metrics) -> dict[str, Any]:
    """Return the numbers of one run; lists are over followers 1..N unless the name says more."""
    length, collided = metrics.platoon_length, metrics.first_collision
    return {
        "duration": metrics.duration,
        "max_abs_spacing_error": metrics.max_abs_spacing_error,
        "time_of_max": metrics.time_of_max,
        "rms_spacing_error": metrics.rms_spacing_error,
        "l2_spacing_error": metrics.l2_spacing_error,
        "final_spacing_error": metrics.final_spacing_error,
        "settling_time": metrics.settling_time,
        "max_abs_acceleration": metrics.max_abs_acceleration,
        "rms_acceleration": metrics.rms_acceleration,
        "max_abs_jerk": metrics.max_abs_jerk,
        "rms_jerk": metrics.rms_jerk,
        "min_time_headway": metrics.min_time_headway,
        "mean_time_headway": metrics.mean_time_headway,
        "min_time_to_collision": metrics.min_time_to_collision,
        "platoon_length": {"initial": length.initial, "max": length.max, "final": length.final},
        "collision": metrics.collision,
        "hop_ratio": {"max": metrics.hop_ratio_max, "l2": metrics.hop_ratio_l2},
        "min_gap": _smallest(metrics.min_gap),
        "min_gap_per_follower": metrics.min_gap,
        "sure_min_gap": _smallest(metrics.sure_min_gap),
        "first_collision": {"follower": collided[0], "time": collided[1]} if collided else None,
        **_reception(metrics.reception),
        "fallback": [_fallback(one) for one in metrics.fallback],
        "limits": [
            {
                "follower": one.follower,
                "share": one.share,
                "begin": one.begin,
                "end": one.end,
            }
            for one in metrics.limits
        ],
        "monitor": [_monitor(one) for one in metrics.monitor],
        "clocks": [_clock(one) for one in metrics.clocks],
    }


def _reception(links: list[LinkReception]) -> dict[str, Any]:
    """All links together, the ages of the worst one, and one by one."""
    sent = sum(link.sent for link in links)
    return {
        "loss": 1.0 - sum(link.arrived for link in links) / sent if sent else math.nan,
        "age": {
            "median": max((link.age_median for link in links), default=math.nan),
            "p99": max((link.age_p99 for link in links), default=math.nan),
            "max": max((link.age_max for link in links), default=math.nan),
        },
        "reception": [_link_reception(link) for link in links],
    }


def _link_reception(link: LinkReception) -> dict[str, Any]:
    return {
        "sender": link.sender,
        "follower": link.follower,
        "sent": link.sent,
        "arrived": link.arrived,
        "lost": link.lost,
        "in_blackouts": link.dark,
        "late": link.late,
        "overtaken": link.overtaken,
        "loss": link.loss,
        "loss_probability": link.loss_probability,
        "bursts": {
            "number": link.bursts.number,
            "longest": link.bursts.longest,
            "mean": link.bursts.mean,
        },
        "age": {"median": link.age_median, "p99": link.age_p99, "max": link.age_max},
    }


def _fallback(one: FallbackUse) -> dict[str, Any]:
    shares = zip(ReceptionState, one.shares, strict=True)
    return {
        "follower": one.follower,
        "shares": {state.name.lower(): share for state, share in shares},
        "begin": one.begin,
        "end": one.end,
        "turns": one.turns,
    }


def _monitor(one: MonitorUse) -> dict[str, Any]:
    return {
        "follower": one.follower,
        "share": one.share,
        "begin": one.begin,
        "end": one.end,
        "alarms": one.alarms,
        "false_alarms": one.false_alarms,
        "detections": [
            {"begin": found.begin, "end": found.end, "delay": found.delay}
            for found in one.detections
        ],
    }


def _clock(one: ClockUse) -> dict[str, Any]:
    return {
        "follower": one.follower,
        "lateness": {"median": one.late_median, "p99": one.late_p99, "max": one.late_max},
        "overruns": one.overruns,
        "unknown": one.unknown,
        "begin": one.begin,
        "end": one.end,
        "pose_age": {"median": one.age_median, "p99": one.age_p99, "max": one.age_max},
    }


def _smallest(values: Any) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.min()) if finite.size else math.nan


def verdict_document(verdict: Verdict) -> dict[str, Any]:
    """Return the verdict with the basis of every statement."""
    weakest = verdict.weakest
    realised = [one.realised_stable for one in verdict.followers]
    return {
        "string_stable": verdict.string_stable,
        "certified": verdict.certified,
        "headline": verdict.headline,
        "guarantee": verdict.guarantee,
        "guarantees": [row._asdict() for row in verdict.guarantees],
        "basis": verdict.basis,
        "void": list(verdict.void),
        "holds_from": verdict.holds_from,
        "paper": {"string_stable": verdict.in_paper_region, "basis": verdict.bases.paper},
        "loop": weakest.loop,
        "l2_gain": weakest.l2_gain,
        "peak_frequency": weakest.peak_frequency,
        "margins": {"C": weakest.margins[0], "margin": weakest.margins[1]},
        "linf_gain": verdict.linf_gain,
        "linf_basis": verdict.bases.linf,
        "sure_gain": verdict.sure_gain,
        "sure_basis": verdict.bases.sure,
        "sampled_string_stable": all(one.sampled for one in verdict.followers),
        "realised_string_stable": None if None in realised else all(realised),
        "end_to_end_gain": verdict.end_to_end_gain,
        "weakest_follower": weakest.follower,
        "reason": weakest.reason,
        "remedy": weakest.remedy,
        "equal_links": verdict.equal_links,
        "per_follower": [_follower(one) for one in verdict.followers],
    }


def _follower(verdict: FollowerVerdict) -> dict[str, Any]:
    return {
        "follower": verdict.follower,
        "string_stable": verdict.string_stable,
        "in_paper_region": verdict.in_paper_region,
        "internally_stable": verdict.internally_stable,
        "sampled": verdict.sampled,
        "loop": verdict.loop,
        "l2_gain": verdict.l2_gain,
        "peak_frequency": verdict.peak_frequency,
        "linf_gain": verdict.linf_gain,
        "sure_gain": verdict.sure_gain,
        "realised_k": verdict.realised_k,
        "realised_stable": verdict.realised_stable,
        "reason": verdict.reason,
        "decided": verdict.decided,
    }

"""metrics.json: every number of a report, by name; NaN and infinity become null."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from cacc_platoon.analysis.course import course_of
from cacc_platoon.analysis.document import plain_values, run_document, verdict_document
from cacc_platoon.formats import Format
from cacc_platoon.runs.folder import versions

if TYPE_CHECKING:
    from cacc_platoon.analysis.analyse import Report
    from cacc_platoon.analysis.consistency import Consistency
    from cacc_platoon.analysis.noise import LinkNoise

FORMAT = Format("metrics.json", 2)

_ROUNDING = 1e-9
"""Below this standard error [m] the spread of noisy runs is rounding."""


def metrics_document(report: Report) -> dict[str, Any]:
    """Return what metrics.json holds; lists are over followers 1..N unless the name says more."""
    run, scenario = report.run, report.run.trajectory.scenario
    plain: dict[str, Any] = plain_values(
        {
            "format": FORMAT.version,
            "scenario": scenario.name,
            "headline": report.headline,
            "worst_braking": report.worst_braking._asdict() if report.worst_braking else None,
            "proven": report.proven,
            "standing": report.standing.to_json(),
            "followers": scenario.platoon.followers,
            "first_follower": scenario.platoon.first_follower,
            **run_document(report.measured),
            "age_margins": [
                {
                    "sender": one.sender,
                    "follower": one.follower,
                    "margin": one.margin,
                    "share_above": one.share_above,
                }
                for one in report.age_margins
            ],
            "events": [
                {"time": round(event.sample * scenario.run.step, 9), **event._asdict()}
                for event in course_of(run.trajectory)
            ],
            "noise": _noise(report.measured.noise),
            "expected": run_document(report.expected),
            "expected_without": report.run.trajectory.scenario.custom_code,
            "ensemble": _ensemble(report),
            "distance": _distance(report),
            "verdict": verdict_document(report.verdict),
            "consistency": _consistency(report.consistency),
            "leader_consistency": _consistency(report.recomputed.leader),
            "link_consistency": _consistency(report.recomputed.links),
            "findings": list(run.findings),
            "provenance": {
                "bag": run.bag.name,
                "namespace": scenario.platoon.namespace,
                "status": run.info and str(run.info.status),
                "message": run.info and run.info.message,
                "messages": run.messages,
                "samples": run.grid.samples,
                "step": run.grid.step / 1e9,
                "seed": scenario.run.seed,
                "digest": run.digest,
                "digest_recorded": run.digest_recorded,
                "recorded_with": (run.info and dict(run.info.versions)) or None,
                "fingerprint": (run.info and dict(run.info.fingerprint)) or None,
                "analysed_with": versions(),
            },
        }
    )
    return plain


def _consistency(found: Consistency) -> dict[str, Any]:
    return {
        "steps": found.steps,
        "largest_difference": found.largest,
        "departures": [
            {"follower": vehicle, "time": time, "difference": difference}
            for vehicle, time, difference in found.departures
        ],
        "unknown": found.unknown,
    }


def _distance(report: Report) -> dict[str, Any]:
    """Return how far the run was from its expectation run."""
    found = report.distance
    return {"largest": found.largest, "vehicle": found.vehicle, "time": found.time}


def _noise(links: list[LinkNoise]) -> dict[str, Any]:
    """All links together, weighted by their samples, and one by one."""
    used = [link for link in links if link.samples]
    weight = np.array([link.samples for link in used]) / max(1, sum(n.samples for n in used))
    means = np.array([link.mean for link in used])
    with np.errstate(all="ignore"):
        mean = float(weight @ means) if used else math.nan
        variances = np.array([link.variance for link in used])
        variance = float(weight @ (variances + (means - mean) ** 2)) if used else math.nan
    return {
        "mean_w": mean,
        "variance_w": variance,
        "min_w": min((link.low for link in used), default=math.nan),
        "max_w": max((link.high for link in used), default=math.nan),
        "snr_db": min((link.snr_db for link in used), default=math.nan),
        "links": [_link(link) for link in links],
    }


def _link(link: LinkNoise) -> dict[str, Any]:
    return {
        "sender": link.sender,
        "follower": link.follower,
        "samples": link.samples,
        "mean": link.mean,
        "variance": link.variance,
        "low": link.low,
        "high": link.high,
        "expected_mean": link.expected_mean,
        "expected_variance": link.expected_variance,
        "snr_db": link.snr_db,
        "first_breach": link.first_breach,
        "breaches": link.breaches,
    }


@np.errstate(all="ignore")  # an unstable platoon overflows
def _ensemble(report: Report) -> dict[str, Any] | None:
    """Return what many noisy runs say; the largest deviation shows that their mean is E[X]."""
    ensemble = report.ensemble
    if ensemble is None:
        return None
    deviation = np.abs(ensemble.mean - report.expectation.spacing_error)
    errors = np.where(ensemble.standard_error > _ROUNDING, ensemble.standard_error, np.inf)
    peaks = ensemble.max_abs_spacing_error
    return {
        "runs": ensemble.runs,
        "seed": report.run.trajectory.scenario.run.seed,
        "max_abs_mean_minus_expectation": float(np.max(deviation)),
        "max_standard_errors_from_expectation": float(np.max(deviation / errors)),
        "agreement": report.agreement
        and {
            "level": report.agreement.level,
            "compared": report.agreement.bound.size,
            "largest_share_of_bound": report.agreement.largest_share,
        },
        "max_abs_spacing_error": {
            "mean": peaks.mean(axis=0),
            "min": peaks.min(axis=0),
            "max": peaks.max(axis=0),
        },
        "runs_without_growth": int((np.diff(peaks, axis=1) <= 0).all(axis=1).sum()),
    }

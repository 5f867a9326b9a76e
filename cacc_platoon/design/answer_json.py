"""The records of an answer as plain data for `platoon design --json`, key by key."""

from __future__ import annotations

from typing import Any

from cacc_platoon.design.requirements import Design
from cacc_platoon.formats import Format
from cacc_platoon.model.control import Gains
from cacc_platoon.theory.certificate import Certificate
from cacc_platoon.theory.guarantees import guarantees
from cacc_platoon.theory.human_driver import HumanDriver
from cacc_platoon.theory.mixed_traffic import LeastShare
from cacc_platoon.theory.region import Conservatism, ExactRegion
from cacc_platoon.theory.several_predecessors import MultiPredecessorBounds
from cacc_platoon.theory.theorem2 import PaperRegion

FORMAT = Format("design --json", 2)
VEHICLES = 12
"""Hops of the end-to-end gain."""


def gains_document(gains: Gains) -> dict[str, Any]:
    """Return a design as plain data."""
    return {
        "time_headway": gains.time_headway,
        "k_a": gains.k_a,
        "k_v": gains.k_v,
        "k_p": gains.k_p,
    }


def certificate_document(certificate: Certificate) -> dict[str, Any]:
    """Return what a design guarantees as plain data."""
    gain_range = certificate.gain_range
    rate = {} if certificate.v2v_period is None else {"v2v_period": _rate_document(certificate)}
    return {
        "internally_stable": certificate.internally_stable,
        "in_paper_region": certificate.in_paper_region,
        "string_stable": certificate.string_stable,
        "l2_gain": certificate.l2_gain,
        "peak_frequency": certificate.peak_frequency,
        "margins": {"C": certificate.margins[0], "margin": certificate.margins[1]},
        "linf_gain": certificate.linf_gain,
        "peaks": {
            "mean": certificate.worst_linf_gain._asdict(),
            "sure": certificate.worst_sure_gain._asdict(),
            "sure_error": certificate.worst_sure_error_gain._asdict(),
            "sure_sampled": certificate.sampled_sure_gain,
            "lag_free": certificate.keeps_peaks_without_lag,
        },
        "sampled": {
            "period": certificate.period,
            "string_stable": certificate.sampled_string_stable,
            "critical_period": certificate.critical_period,
        },
        "latency_margin": certificate.latency_margin,
        "joint": {
            "period": certificate.period,
            "latency": certificate.latency,
            "latency_margin": certificate.joint_latency_margin,
            "critical_period": certificate.joint_critical_period,
        },
        **rate,
        "ring": _ring_document(certificate),
        "mean_square_index": certificate.mean_square_index,
        "frozen_noise_margin": certificate.frozen_noise_margin,
        "slowest_time_constant": certificate.slowest_time_constant,
        "leader_error_norm": certificate.leader_error_norm,
        "leader_error_gain": certificate.leader_error_gain,
        "gain_range": None if gain_range is None else list(gain_range),
        "guarantees": [row._asdict() for row in guarantees(certificate)],
    }


def _ring_document(certificate: Certificate) -> dict[str, Any]:
    stable = certificate.internally_stable
    first = certificate.first_unstable_ring if stable else None
    return {"every_number": stable and first is None, "first_unstable": first}


def _rate_document(certificate: Certificate) -> dict[str, Any]:
    growth, phases = certificate.v2v_growth, certificate.v2v_phase_growth
    return {
        "period": certificate.v2v_period,
        "growth_per_hop": growth.growth if growth else None,
        "frequency": growth.omega if growth else None,
        "phases": {
            "growth_per_hop": phases.growth.growth if phases else None,
            "step": phases.step if phases else None,
        },
        "critical_period": certificate.critical_v2v_period,
        "end_to_end_gain": certificate.v2v_end_to_end_gain(VEHICLES),
    }


def mixed_traffic_document(human: HumanDriver, least: LeastShare | None) -> dict[str, Any]:
    """Return from which share of connected vehicles on mixed traffic does not grow."""
    return {
        "human": human._asdict(),
        "least_share": None if least is None else least.share,
        "frequency": None if least is None else least.omega,
    }


def design_document(design: Design, gains: Gains) -> dict[str, Any]:
    """Return a recommended design as plain data, with its gains as the platoon applies them."""
    certificate = design.certificate
    asked = certificate.v2v_period is not None
    return {
        "name": design.name,
        "gains": gains_document(gains),
        "string_stable": certificate.string_stable,
        "latency_margin": certificate.joint_latency_margin,
        "critical_period": certificate.joint_critical_period,
        **({"critical_v2v_period": certificate.critical_v2v_period} if asked else {}),
        "linf_gain": certificate.linf_gain,
        "slowest_time_constant": certificate.slowest_time_constant,
        "reason": design.reason,
        "unmet": list(design.unmet),
    }


def region_document(region: PaperRegion) -> dict[str, Any]:
    """Return the paper's region S as plain data."""
    return {
        "a1": region.a1,
        "b1": region.b1,
        "a2": region.a2,
        "b2": region.b2,
        "polygon": [list(corner) for corner in region.polygon],
        "area": region.area,
        "nonempty": region.nonempty,
    }


def exact_region_document(region: ExactRegion) -> dict[str, Any]:
    """Return the exact region as plain data."""
    return {"nonempty": region.nonempty, "k_p_min": region.k_p_min}


def conservatism_document(conservatism: Conservatism) -> dict[str, Any]:
    """Return what the paper's conditions give away as plain data."""
    return {"headway": conservatism.headway, "area": conservatism.area}


def predecessors_document(count: int, k_a: float, bounds: MultiPredecessorBounds) -> dict[str, Any]:
    """Return the bounds for several predecessors as plain data."""
    return {
        "count": count,
        "k_a": k_a,
        "paper": bounds.paper,
        "exact": bounds.exact,
        "optimal_k_a": bounds.optimal_k_a,
        "optimal_headway": bounds.optimal_headway,
        "k_a_max": bounds.k_a_max,
    }

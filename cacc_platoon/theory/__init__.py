"""What is proven about a platoon: bounds, regions, exact tests and what a design tolerates."""

from cacc_platoon.theory.certificate import (
    Certificate,
    certify,
)
from cacc_platoon.theory.errors import DesignError
from cacc_platoon.theory.exact import (
    TOLERANCE,
    L2Gain,
    Margins,
    is_robustly_string_stable,
    is_string_stable,
    l2_gain,
    propagation_margins,
    robust_string_stability_map,
    string_stability_map,
    worst_l2_gain,
)
from cacc_platoon.theory.explanation import (
    Failure,
    explain_bounds,
    explain_design,
    explain_failure,
    explain_verdict,
    rounded_down,
)
from cacc_platoon.theory.guarantees import Guarantee, guarantees
from cacc_platoon.theory.human_driver import HumanDriver, longest_delay
from cacc_platoon.theory.joint_loop import joint_critical_period, joint_latency_margin
from cacc_platoon.theory.lag_free_peaks import keeps_peaks_without_lag
from cacc_platoon.theory.latency import headway_for_latency, latency_margin
from cacc_platoon.theory.mean_square import (
    NoiseStatistics,
    largest_variance,
    leader_error_gain,
    leader_error_norm,
    mean_square_index,
    uniform_error_bound,
)
from cacc_platoon.theory.mixed_traffic import (
    ConnectedVehicles,
    LeastShare,
    least_connected_share,
    mixed_traffic_growth,
)
from cacc_platoon.theory.noise_growth import frozen_noise_margin, sampled_mean_square_index
from cacc_platoon.theory.noise_interval import (
    EffectiveInterval,
    effective_interval,
    k_a_max,
    rho_from_snr_db,
    snr_db_from_rho,
)
from cacc_platoon.theory.packet_loss import (
    fallback_headway,
    hold_last_response,
    is_reception_string_stable,
    reception_interval,
    reception_minimum_headway,
)
from cacc_platoon.theory.peak_gains import (
    WorstGain,
    linf_gain,
    sampled_sure_gain,
    sure_error_gain,
    sure_gain,
    worst_linf_gain,
    worst_sure_error_gain,
    worst_sure_gain,
)
from cacc_platoon.theory.region import (
    Conservatism,
    ExactRegion,
    conservatism,
    exact_region,
    infimum_headway,
    minimum_headway,
    stable_gain_range,
)
from cacc_platoon.theory.ring import first_unstable_ring, unstable_turns
from cacc_platoon.theory.sampled import is_sampled_string_stable, sampled_stability_map
from cacc_platoon.theory.sampling_limits import critical_loss, critical_period
from cacc_platoon.theory.several_predecessors import (
    MultiPredecessorBounds,
    equivalent_gains,
    first_followers_gains,
    multi_predecessor_bounds,
    multi_predecessor_gains,
    several_predecessors_growth,
)
from cacc_platoon.theory.theorem2 import (
    Optimum,
    PaperRegion,
    headway_bound,
    headway_slope,
    headway_slope_roots,
    in_paper_region,
    optimum,
    paper_region,
)
from cacc_platoon.theory.transfer import (
    frequency_response,
    gamma,
    is_internally_stable,
    poles,
    slowest_time_constant,
)
from cacc_platoon.theory.unequal_links import (
    ChainCertificate,
    Hop,
    certify_chain,
    slow_error_ratio,
)
from cacc_platoon.theory.worst_braking import worst_spacing

__all__ = [
    "TOLERANCE",
    "Certificate",
    "ChainCertificate",
    "ConnectedVehicles",
    "Conservatism",
    "DesignError",
    "EffectiveInterval",
    "ExactRegion",
    "Failure",
    "Guarantee",
    "Hop",
    "HumanDriver",
    "L2Gain",
    "LeastShare",
    "Margins",
    "MultiPredecessorBounds",
    "NoiseStatistics",
    "Optimum",
    "PaperRegion",
    "WorstGain",
    "certify",
    "certify_chain",
    "conservatism",
    "critical_loss",
    "critical_period",
    "effective_interval",
    "equivalent_gains",
    "exact_region",
    "explain_bounds",
    "explain_design",
    "explain_failure",
    "explain_verdict",
    "fallback_headway",
    "first_followers_gains",
    "first_unstable_ring",
    "frequency_response",
    "frozen_noise_margin",
    "gamma",
    "guarantees",
    "headway_bound",
    "headway_for_latency",
    "headway_slope",
    "headway_slope_roots",
    "hold_last_response",
    "in_paper_region",
    "infimum_headway",
    "is_internally_stable",
    "is_reception_string_stable",
    "is_robustly_string_stable",
    "is_sampled_string_stable",
    "is_string_stable",
    "joint_critical_period",
    "joint_latency_margin",
    "k_a_max",
    "keeps_peaks_without_lag",
    "l2_gain",
    "largest_variance",
    "latency_margin",
    "leader_error_gain",
    "leader_error_norm",
    "least_connected_share",
    "linf_gain",
    "longest_delay",
    "mean_square_index",
    "minimum_headway",
    "mixed_traffic_growth",
    "multi_predecessor_bounds",
    "multi_predecessor_gains",
    "optimum",
    "paper_region",
    "poles",
    "propagation_margins",
    "reception_interval",
    "reception_minimum_headway",
    "rho_from_snr_db",
    "robust_string_stability_map",
    "rounded_down",
    "sampled_mean_square_index",
    "sampled_stability_map",
    "sampled_sure_gain",
    "several_predecessors_growth",
    "slow_error_ratio",
    "slowest_time_constant",
    "snr_db_from_rho",
    "stable_gain_range",
    "string_stability_map",
    "sure_error_gain",
    "sure_gain",
    "uniform_error_bound",
    "unstable_turns",
    "worst_l2_gain",
    "worst_linf_gain",
    "worst_spacing",
    "worst_sure_error_gain",
    "worst_sure_gain",
]

"""What is proven about a platoon: bounds, regions, exact tests and what a design tolerates."""

from cacc_platoon.theory.certificate import (
    Certificate,
    NoiseStatistics,
    certify,
    worst_l2_gain,
)
from cacc_platoon.theory.errors import DesignError
from cacc_platoon.theory.exact import (
    TOLERANCE,
    L2Gain,
    Margins,
    is_robustly_string_stable,
    is_string_stable,
    l2_gain,
    linf_gain,
    propagation_margins,
    robust_string_stability_map,
    string_stability_map,
)
from cacc_platoon.theory.explanation import (
    Failure,
    explain_bounds,
    explain_design,
    explain_failure,
    explain_verdict,
    rounded_down,
)
from cacc_platoon.theory.joint_loop import joint_critical_period, joint_latency_margin
from cacc_platoon.theory.latency import headway_for_latency, latency_margin
from cacc_platoon.theory.mean_square import (
    largest_variance,
    leader_error_norm,
    mean_square_index,
    uniform_error_bound,
)
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
from cacc_platoon.theory.region import (
    Conservatism,
    ExactRegion,
    conservatism,
    exact_region,
    infimum_headway,
    minimum_headway,
    stable_gain_range,
)
from cacc_platoon.theory.sampled import is_sampled_string_stable, sampled_stability_map
from cacc_platoon.theory.sampling_limits import critical_loss, critical_period
from cacc_platoon.theory.several_predecessors import (
    MultiPredecessorBounds,
    equivalent_gains,
    multi_predecessor_bounds,
    multi_predecessor_gains,
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
)

__all__ = [
    "TOLERANCE",
    "Certificate",
    "ChainCertificate",
    "Conservatism",
    "DesignError",
    "EffectiveInterval",
    "ExactRegion",
    "Failure",
    "Hop",
    "L2Gain",
    "Margins",
    "MultiPredecessorBounds",
    "NoiseStatistics",
    "Optimum",
    "PaperRegion",
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
    "frequency_response",
    "gamma",
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
    "l2_gain",
    "largest_variance",
    "latency_margin",
    "leader_error_norm",
    "linf_gain",
    "mean_square_index",
    "minimum_headway",
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
    "sampled_stability_map",
    "slowest_time_constant",
    "snr_db_from_rho",
    "stable_gain_range",
    "string_stability_map",
    "uniform_error_bound",
    "worst_l2_gain",
]

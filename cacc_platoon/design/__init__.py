"""Which headway and gains are string stable, how much they tolerate, and which to choose."""

from cacc_platoon.design.answer import (
    Question,
    answer,
)
from cacc_platoon.design.certificate import (
    Certificate,
    NoiseStatistics,
    SampledCertificate,
    certify,
    worst_l2_gain,
)
from cacc_platoon.design.chain import (
    ChainCertificate,
    LagEffect,
    Link,
    certify_chain,
    effect_of_lag,
)
from cacc_platoon.design.designs import (
    Design,
    Recommendation,
    Requirements,
    assess,
    paper_design,
)
from cacc_platoon.design.errors import (
    DesignError,
)
from cacc_platoon.design.exact import (
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
from cacc_platoon.design.explain import (
    explain_bounds,
    explain_design,
    verdict,
)
from cacc_platoon.design.extensions import (
    MultiPredecessorBounds,
    equivalent_gains,
    fallback_headway,
    hold_last_response,
    is_reception_string_stable,
    multi_predecessor_bounds,
    multi_predecessor_gains,
    reception_interval,
    reception_minimum_headway,
)
from cacc_platoon.design.latency import (
    headway_for_latency,
    latency_margin,
)
from cacc_platoon.design.noise import (
    largest_variance,
    leader_error_norm,
    mean_square_index,
    uniform_error_bound,
)
from cacc_platoon.design.paper import (
    EffectiveInterval,
    Optimum,
    PaperRegion,
    effective_interval,
    headway_bound,
    headway_slope,
    headway_slope_roots,
    in_paper_region,
    k_a_max,
    optimum,
    paper_region,
    rho_from_snr_db,
    snr_db_from_rho,
)
from cacc_platoon.design.recommend import (
    recommend,
)
from cacc_platoon.design.region import (
    Conservatism,
    ExactRegion,
    conservatism,
    exact_region,
    infimum_headway,
    minimum_headway,
    stable_gain_range,
)
from cacc_platoon.design.sampled import (
    critical_period,
    is_sampled_string_stable,
    sampled_stability_map,
)
from cacc_platoon.design.text import (
    render,
)
from cacc_platoon.design.transfer import (
    frequency_response,
    gamma,
    is_internally_stable,
    poles,
    slowest_time_constant,
)

__all__ = [
    "TOLERANCE",
    "Certificate",
    "ChainCertificate",
    "Conservatism",
    "Design",
    "DesignError",
    "EffectiveInterval",
    "ExactRegion",
    "L2Gain",
    "LagEffect",
    "Link",
    "Margins",
    "MultiPredecessorBounds",
    "NoiseStatistics",
    "Optimum",
    "PaperRegion",
    "Question",
    "Recommendation",
    "Requirements",
    "SampledCertificate",
    "answer",
    "assess",
    "certify",
    "certify_chain",
    "conservatism",
    "critical_period",
    "effect_of_lag",
    "effective_interval",
    "equivalent_gains",
    "exact_region",
    "explain_bounds",
    "explain_design",
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
    "paper_design",
    "paper_region",
    "poles",
    "propagation_margins",
    "reception_interval",
    "reception_minimum_headway",
    "recommend",
    "render",
    "rho_from_snr_db",
    "robust_string_stability_map",
    "sampled_stability_map",
    "slowest_time_constant",
    "snr_db_from_rho",
    "stable_gain_range",
    "string_stability_map",
    "uniform_error_bound",
    "verdict",
    "worst_l2_gain",
]

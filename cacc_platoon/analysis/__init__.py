"""A recorded run measured and judged; no drawing, no text, no ROS."""

from cacc_platoon.analysis.analyse import Report, analyse
from cacc_platoon.analysis.consistency import (
    Consistency,
    check_consistency,
    check_leader,
    check_links,
)
from cacc_platoon.analysis.metrics import Metrics, compute_metrics
from cacc_platoon.analysis.noise import LinkNoise, link_noise, noise_factor
from cacc_platoon.analysis.standing import (
    DataState,
    Recomputation,
    Standing,
    recompute,
    standing_of,
)
from cacc_platoon.analysis.verdict import Verdict, judge, warn_if_not_string_stable

__all__ = [
    "Consistency",
    "DataState",
    "LinkNoise",
    "Metrics",
    "Recomputation",
    "Report",
    "Standing",
    "Verdict",
    "analyse",
    "check_consistency",
    "check_leader",
    "check_links",
    "compute_metrics",
    "judge",
    "link_noise",
    "noise_factor",
    "recompute",
    "standing_of",
    "warn_if_not_string_stable",
]

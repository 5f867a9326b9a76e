"""From a bag to metrics, a verdict, figures and a report; no ROS needed.

`report_run` does it all; `analyse` does it without writing anything.
"""

from cacc_platoon.analysis.consistency import Consistency, check_consistency
from cacc_platoon.analysis.metrics import Metrics, compute_metrics
from cacc_platoon.analysis.noise import LinkNoise, link_noise, noise_factor
from cacc_platoon.analysis.report import Report, analyse, report_run, write_report
from cacc_platoon.analysis.verdict import Verdict, judge, warn_if_not_string_stable
from cacc_platoon.bags import BagError
from cacc_platoon.runs import RecordedRun, read_run

__all__ = [
    "BagError",
    "Consistency",
    "LinkNoise",
    "Metrics",
    "RecordedRun",
    "Report",
    "Verdict",
    "analyse",
    "check_consistency",
    "compute_metrics",
    "judge",
    "link_noise",
    "noise_factor",
    "read_run",
    "report_run",
    "warn_if_not_string_stable",
    "write_report",
]

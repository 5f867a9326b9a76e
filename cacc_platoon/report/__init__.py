"""A judged run for people and scripts: metrics.json, terminal, HTML page; no ROS needed."""

from cacc_platoon.report.metrics_json import metrics_document
from cacc_platoon.report.terminal import summary
from cacc_platoon.report.write import WrittenReport, report_run, write_report

__all__ = ["WrittenReport", "metrics_document", "report_run", "summary", "write_report"]

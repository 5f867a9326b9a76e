"""Any rosbag2 bag as the arrays of a run, without ROS; every fault is named, none is fatal."""

from cacc_platoon.analysis.reading.raw import BagError
from cacc_platoon.analysis.reading.run import RecordedRun, read_run

__all__ = ["BagError", "RecordedRun", "read_run"]

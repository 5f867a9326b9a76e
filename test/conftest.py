"""What every test needs before ROS or matplotlib is imported: a home of its own, strict fields."""

import os
import tempfile

_home = tempfile.mkdtemp(prefix="cacc_platoon_test_")
os.environ["ROS_LOG_DIR"] = _home
os.environ["MPLCONFIGDIR"] = _home
os.environ["MPLBACKEND"] = "agg"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"

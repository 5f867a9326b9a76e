"""What every test needs before ROS or matplotlib is imported: a home of its own, strict fields."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

ROOT = Path(__file__).parents[1]

# The same examples every time, at any speed of the machine; to look for new ones:
# pytest --hypothesis-profile=default
settings.register_profile("project", derandomize=True, deadline=None)
settings.load_profile("project")

_home = tempfile.mkdtemp(prefix="cacc_platoon_test_")
os.environ["ROS_LOG_DIR"] = _home
os.environ["MPLCONFIGDIR"] = _home
os.environ["MPLBACKEND"] = "agg"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"


@pytest.fixture(scope="session")
def copy_source() -> Callable[[Path], None]:
    """Return a function that copies the project's files, those that git knows or would add."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listing = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout

    def copy(target: Path) -> None:
        for name in filter(None, listing.split("\0")):
            if (ROOT / name).is_file():
                (target / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, target / name)

    return copy

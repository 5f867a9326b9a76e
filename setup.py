"""Build and install with colcon (ament_python) or pip.

pyproject.toml says what the project is and needs. Here is what colcon needs to find here:

- name and version, because `colcon build --symlink-install` runs this file in a folder of its own
  that has no pyproject.toml;
- the Python versions, because colcon reads the arguments as literals and setuptools makes an object
  of `requires-python`; the licence, whose form in pyproject.toml differs between the setuptools
  of Ubuntu 24.04 and of today;
- the executables, which differ between colcon and pip, and the files that it shares.
"""

import re
import sys
from pathlib import Path

from setuptools import find_packages, setup

NAME = "cacc_platoon"
NODES = ("leader", "vehicle", "noise_relay", "recorder", "markers")
PIP_COMMANDS = {"dist_info", "bdist_wheel", "editable_wheel"}

here = Path(__file__).resolve().parent
version = re.search(r'__version__ = "(.+)"', (here / NAME / "__init__.py").read_text())[1]

executables = [f"platoon = {NAME}.__main__:main"]
if not PIP_COMMANDS.intersection(sys.argv):  # colcon: lib/cacc_platoon, where `ros2 run` looks
    executables += [f"{node} = {NAME}.supervision.entry_points:{node}" for node in NODES]
    executables += [f"{name} = {NAME}.cli.{name}:main" for name in ("supervisor", "host")]


def files(pattern):
    """Return the matching files, relative as setuptools wants them."""
    return sorted(str(path.relative_to(here)) for path in here.glob(pattern))


setup(
    name=NAME,
    version=version,
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*", "msg_adapters", "msg_adapters.*"]),
    package_data={
        NAME: [
            "py.typed",
            "dds/*.xml",
            "live/page/*",
            "report/*.css",
            "scenario/channels/*.yaml",
        ],
        "msg_adapters": ["py.typed"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", files("launch/*.launch.py")),
        (f"share/{NAME}/config", files("config/*.yaml")),
        (f"share/{NAME}/config/plans", files("config/plans/*.yaml")),
    ],
    zip_safe=False,  # colcon installs unpacked
    entry_points={"console_scripts": executables},
)

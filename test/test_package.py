"""package.xml, setup.py and the code say the same."""

import ast
import importlib
import re
import runpy
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
import setuptools

import cacc_platoon

ROOT = Path(__file__).parents[1]
MANIFEST = ET.parse(ROOT / "package.xml").getroot()

ROSDEP_KEYS = {
    "matplotlib": "python3-matplotlib",
    "numpy": "python3-numpy",
    "rosbags": "python3-rosbags-pip",
    "ruamel": "python3-ruamel.yaml",
    "launch": "ros2launch",
    "launch_ros": "ros2launch",
    "pytest": "python3-pytest",
    "hypothesis": "python3-hypothesis",
    "scipy": "python3-scipy",
}


def imported(*folders: str) -> set[str]:
    """Return the packages of others that the Python files of some folders import."""
    found = set()
    for folder in folders:
        for path in (ROOT / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Import):
                    found |= {name.name.partition(".")[0] for name in node.names}
                elif isinstance(node, ast.ImportFrom) and node.module:
                    found.add(node.module.partition(".")[0])
    return found - set(sys.stdlib_module_names) - {"cacc_platoon", "msg_adapters", "mpl_toolkits"}


@pytest.fixture
def setup_arguments(monkeypatch):
    """Return a function that gives what setup.py hands to setuptools when run with a command."""

    def arguments(command: str = "install") -> dict[str, Any]:
        found: dict[str, Any] = {}
        monkeypatch.setattr(setuptools, "setup", found.update)
        monkeypatch.setattr(sys, "argv", ["setup.py", command])
        runpy.run_path(str(ROOT / "setup.py"))
        return found

    return arguments


def project(requirement: str) -> str:
    """Return a requirement's project, without extras and version."""
    return re.split(r"[^\w.-]", requirement)[0]


def depends(kind: str) -> set[str]:
    return {element.text for element in MANIFEST.findall(kind)}


def test_the_version_is_one(setup_arguments):
    assert MANIFEST.findtext("version") == cacc_platoon.__version__
    assert setup_arguments()["version"] == cacc_platoon.__version__
    changelog = (ROOT / "CHANGELOG.rst").read_text()
    [newest, *_] = re.findall(r"^(\d+\.\d+\.\d+|Forthcoming)\b", changelog, re.MULTILINE)
    assert newest in (cacc_platoon.__version__, "Forthcoming")


def test_the_manifest_is_an_ament_python_package_of_format_3():
    assert MANIFEST.get("format") == "3"
    assert MANIFEST.findtext("name") == "cacc_platoon"
    assert MANIFEST.findtext("export/build_type") == "ament_python"
    assert MANIFEST.findtext("license") == "Apache-2.0"
    assert (ROOT / "resource" / "cacc_platoon").is_file()


def test_exec_depends_are_what_the_code_imports():
    packages = imported("cacc_platoon", "msg_adapters", "launch")
    assert {ROSDEP_KEYS.get(name, name) for name in packages} == depends("exec_depend")


def test_pip_requirements_are_what_the_code_imports(setup_arguments):
    ros = {name for name in depends("exec_depend") if not name.startswith(("python3-", "ros2"))}
    packages = imported("cacc_platoon", "msg_adapters") - ros
    required = {project(text) for text in setup_arguments()["install_requires"]}
    assert {"ruamel.yaml" if name == "ruamel" else name for name in packages} == required
    extra = {project(text) for text in setup_arguments()["extras_require"]["ros"]}
    follows_from_rclpy = {"rcl_interfaces"}
    assert extra == {f"ros-jazzy-{name.replace('_', '-')}" for name in ros - follows_from_rclpy}


def test_every_executable_has_its_function(setup_arguments):
    executables = setup_arguments()["entry_points"]["console_scripts"]
    names = {entry.partition(" = ")[0] for entry in executables}
    assert names == {
        *("leader", "vehicle", "noise_relay", "recorder", "markers", "supervisor", "platoon"),
    }
    for entry in executables:
        module, _, function = entry.partition(" = ")[2].partition(":")
        assert callable(getattr(importlib.import_module(module), function))


@pytest.mark.parametrize("command", ["dist_info", "bdist_wheel", "editable_wheel"])
def test_pip_installs_the_platoon_command_alone(setup_arguments, command):
    [entry] = setup_arguments(command)["entry_points"]["console_scripts"]
    assert entry.startswith("platoon = ")


def test_test_depends_that_rosdep_knows_are_declared():
    known = {ROSDEP_KEYS[name] for name in imported("test") & ROSDEP_KEYS.keys()}
    assert known - depends("exec_depend") == depends("test_depend")

"""package.xml, pyproject.toml, setup.py, CITATION.cff, CHANGELOG.rst and the code say the same."""

import ast
import importlib
import re
import runpy
import sys
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
import setuptools
from ruamel.yaml import YAML

import cacc_platoon

ROOT = Path(__file__).parents[1]
MANIFEST = ET.parse(ROOT / "package.xml").getroot()
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CITATION = YAML(typ="safe", pure=True).load(ROOT / "CITATION.cff")
OLDEST = (ROOT / "test" / "oldest.txt").read_text()

OPTIONAL = {
    "distributed": ("cluster", "distributed"),
    "foxglove": ("live", "foxglove-sdk"),
    "pyarrow": ("sweep", "pyarrow"),
    "scipy": ("sweep", "scipy"),
}
"""What is imported only where an extra is installed: which one, and the project there."""

ROSDEP_KEYS = {
    "matplotlib": "python3-matplotlib",
    "numpy": "python3-numpy",
    "rosbags": "python3-rosbags-pip",
    "ruamel": "python3-ruamel.yaml",
    "launch": "ros2launch",
    "launch_ros": "ros2launch",
    "pytest": "python3-pytest",
    "hypothesis": "python3-hypothesis",
    "jsonschema": "python3-jsonschema",
    "yaml": "python3-yaml",
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
    return {str(element.text) for element in MANIFEST.findall(kind)}


def test_the_version_is_one(setup_arguments):
    assert MANIFEST.findtext("version") == cacc_platoon.__version__
    assert setup_arguments()["version"] == cacc_platoon.__version__
    assert CITATION["version"] == cacc_platoon.__version__
    changelog = (ROOT / "CHANGELOG.rst").read_text()
    [newest, *_] = re.findall(r"^(\d+\.\d+\.\d+)\b", changelog, re.MULTILINE)
    assert newest == cacc_platoon.__version__


def test_the_name_stands_twice_and_is_one(setup_arguments):
    assert PROJECT["name"] == setup_arguments()["name"] == MANIFEST.findtext("name")


def test_setup_py_repeats_nothing_that_pyproject_has(setup_arguments):
    """Setuptools would ignore it there; what is dynamic must be there."""
    arguments = setup_arguments()
    assert not {"install_requires", "extras_require", "description", "keywords"} & arguments.keys()
    assert set(PROJECT["dynamic"]) == {"version", "license", "requires-python", "scripts"}
    dynamic = {"version", "license", "python_requires", "entry_points"}
    assert dynamic < arguments.keys()


def test_python_versions_are_those_of_the_classifiers(setup_arguments):
    versions = [text for text in PROJECT["classifiers"] if re.search(r"Python :: 3\.", text)]
    assert setup_arguments()["python_requires"] == f">={versions[0].rpartition(' ')[2]}"


def test_the_oldest_versions_that_are_tested_are_the_lower_bounds():
    pinned = dict(re.findall(r"^([\w.-]+)==([\d.]+)$", OLDEST, re.MULTILINE))
    bounds = dict(text.split(">=") for text in PROJECT["dependencies"])
    assert {name: pinned.get(name) for name in bounds} == bounds


def test_the_citation_has_what_the_format_asks_for():
    """https://citation-file-format.github.io, version 1.2.0."""
    assert CITATION["cff-version"] == "1.2.0"
    assert {"message", "title", "authors", "type", "license", "references"} <= CITATION.keys()
    assert CITATION["title"] == MANIFEST.findtext("name")
    assert CITATION["license"] == MANIFEST.findtext("license")
    assert CITATION["authors"] == [{"name": MANIFEST.findtext("maintainer")}]
    assert PROJECT["authors"] == CITATION["authors"]


def test_the_citation_names_the_paper_as_the_theory_does():
    [paper] = CITATION["references"]
    theory = " ".join((ROOT / "docs" / "theory.md").read_text().split())
    assert f"*{paper['title']}*" in theory
    assert [author["family-names"] for author in paper["authors"]] == ["Ma", "Pagilla", "Darbha"]


def test_the_manifest_is_an_ament_python_package_of_format_3():
    assert MANIFEST.get("format") == "3"
    assert MANIFEST.findtext("name") == "cacc_platoon"
    assert MANIFEST.findtext("export/build_type") == "ament_python"
    assert MANIFEST.findtext("license") == "Apache-2.0"
    assert (ROOT / "resource" / "cacc_platoon").is_file()


@pytest.mark.slow
def test_exec_depends_are_what_the_code_imports():
    packages = imported("cacc_platoon", "msg_adapters", "launch") - OPTIONAL.keys()
    assert {ROSDEP_KEYS.get(name, name) for name in packages} == depends("exec_depend")


def test_pip_requirements_are_what_the_code_imports():
    ros = {name for name in depends("exec_depend") if not name.startswith(("python3-", "ros2"))}
    packages = imported("cacc_platoon", "msg_adapters") - ros - OPTIONAL.keys()
    extras = PROJECT["optional-dependencies"]
    found = {(name, project(text)) for name in extras for text in extras[name]}
    assert {one for one in found if one[0] not in ("ros", "test")} == set(OPTIONAL.values())
    required = {project(text) for text in PROJECT["dependencies"]}
    assert {"ruamel.yaml" if name == "ruamel" else name for name in packages} == required
    extra = {project(text) for text in extras["ros"]}
    follows_from_rclpy = {"builtin_interfaces", "rcl_interfaces", "rosgraph_msgs"}
    assert extra == {f"ros-jazzy-{name.replace('_', '-')}" for name in ros - follows_from_rclpy}


def test_every_executable_has_its_function(setup_arguments):
    executables = setup_arguments()["entry_points"]["console_scripts"]
    names = {entry.partition(" = ")[0] for entry in executables}
    assert names == {
        *("leader", "vehicle", "noise_relay", "recorder", "markers", "supervisor", "host"),
        "platoon",
    }
    for entry in executables:
        module, _, function = entry.partition(" = ")[2].partition(":")
        assert callable(getattr(importlib.import_module(module), function))


@pytest.mark.parametrize("command", ["dist_info", "bdist_wheel", "editable_wheel"])
def test_pip_installs_the_platoon_command_alone(setup_arguments, command):
    [entry] = setup_arguments(command)["entry_points"]["console_scripts"]
    assert entry.startswith("platoon = ")


@pytest.mark.slow
def test_test_depends_that_rosdep_knows_are_declared():
    known = {ROSDEP_KEYS[name] for name in imported("test") & ROSDEP_KEYS.keys()}
    assert known - depends("exec_depend") == depends("test_depend")

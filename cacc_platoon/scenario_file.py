"""Scenario files: ROS parameter files, read with the same rules as `--params-file`, and written."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from cacc_platoon.parameters import ScenarioError, flatten, nest
from cacc_platoon.scenario import Scenario

SECTION = "ros__parameters"
OVERRIDABLE_NODES = ("vehicle", "noise_relay")


def load_scenario(path: str | Path, settings: Iterable[str] = ()) -> Scenario:
    """Read and check a scenario file.

    Parameters
    ----------
    path : str or Path
        A ROS 2 parameter file.
    settings : iterable of str
        `key=value` texts that replace values of the file; `vehicle_5.controller.k_v=0.7` sets a
        value of one vehicle.

    Raises
    ------
    ScenarioError
        One line that names file, key, value, rule and remedy.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "is not a text file"
        raise ScenarioError(f"{path}: cannot be read: {reason}. Give a scenario file.") from error
    return parse_scenario(text, source=str(path), folder=path.parent, settings=settings)


def parse_scenario(
    text: str, source: str, folder: Path = Path(), settings: Iterable[str] = ()
) -> Scenario:
    """Build a checked scenario from the text of a ROS parameter file; see `load_scenario`."""
    sections = list(_sections(_parse_yaml(text, source), source))
    prefix = _namespace(sections)
    values: dict[str, Any] = {}
    overrides: dict[int, dict[str, Any]] = {}
    for pattern, section in sections:
        if _matches(pattern, f"{prefix}/supervisor"):
            values.update(section)
            continue
        vehicles = list(_vehicles_matching(pattern, prefix, section))
        if not vehicles and not _matches(pattern, f"{prefix}/vehicle_0/leader"):
            raise ScenarioError(
                f"{source}: section {pattern} is for no node of the platoon {prefix}, its values "
                f"would be ignored. Use /** or {prefix}/vehicle_<i>/*."
            )
        for index in vehicles:
            overrides.setdefault(index, {}).update(section)
    for setting in settings:
        _apply_setting(setting, values, overrides)
    return Scenario.from_values(values, overrides, source, folder)


def format_scenario(scenario: Scenario) -> str:
    """Write a scenario as a ROS parameter file that `load_scenario` reads back."""
    common = {
        name: value
        for name, value in scenario.values().items()
        if value != () and name != "leader.file"
    }
    document: dict[str, Any] = {"/**": {SECTION: nest(common)}}
    for index, section in scenario.overrides.items():
        pattern = f"{scenario.platoon.namespace}/vehicle_{index}/*"
        document[pattern] = {SECTION: nest(section)}
    buffer = io.StringIO()
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = None
    yaml.width = 100
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.dump(document, buffer)
    return buffer.getvalue()


def _parse_yaml(text: str, source: str) -> Mapping[str, Any]:
    try:
        document = YAML(typ="safe", pure=True).load(text)
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f" line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or "it is no YAML document"
        problem = " ".join(str(problem).split())
        raise ScenarioError(f"{source}:{line} cannot be read as YAML: {problem}.") from error
    if not isinstance(document, Mapping):
        raise ScenarioError(f"{source}: holds no parameters. Begin with /**: {SECTION}:.")
    return document


def _sections(
    tree: Mapping[str, Any], source: str, path: str = ""
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield each node name pattern of the file with its flat parameters."""
    for key, value in tree.items():
        if key == SECTION and path and isinstance(value, Mapping):
            yield path, flatten(value)
        elif key != SECTION and isinstance(value, Mapping):
            yield from _sections(value, source, f"{path}/{str(key).strip('/')}")
        else:
            raise ScenarioError(
                f"{source}: {path.strip('/') or 'the file'} has {key} outside of {SECTION}, it "
                f"would be ignored. Put parameters under /**: {SECTION}:."
            )


def _namespace(sections: list[tuple[str, dict[str, Any]]]) -> str:
    names = [flat["platoon.namespace"] for _, flat in sections if "platoon.namespace" in flat]
    return names[-1] if names and isinstance(names[-1], str) else "/platoon"


def _matches(pattern: str, node: str) -> bool:
    """Whether a ROS section name, with its wildcards * and **, is for the node."""
    expression = re.escape(pattern)
    expression = expression.replace(r"/\*\*", "(/[^/]+)*").replace(r"\*", "[^/]+")
    return re.fullmatch(expression, node) is not None


def _vehicles_matching(pattern: str, prefix: str, section: Mapping[str, Any]) -> Iterator[int]:
    """Yield the followers one of whose nodes the section is for."""
    named = re.search(r"vehicle_(\d+)", pattern)
    candidates = [int(named[1])] if named else range(1, 501)
    for index in candidates:
        nodes = (f"{prefix}/vehicle_{index}/{name}" for name in OVERRIDABLE_NODES)
        if section and any(_matches(pattern, node) for node in nodes):
            yield index


def _apply_setting(
    setting: str, values: dict[str, Any], overrides: dict[int, dict[str, Any]]
) -> None:
    name, equals, text = setting.partition("=")
    if not equals:
        raise ScenarioError(f"--set {setting}: has no value. Write key=value.")
    value = YAML(typ="safe", pure=True).load(text) if text else ""
    vehicle = re.match(r"vehicle_(\d+)\.", name)
    target = overrides.setdefault(int(vehicle[1]), {}) if vehicle else values
    if name == "v2v.snr_db":
        target.pop("v2v.rho", None)
    if name == "v2v.rho":
        target.pop("v2v.snr_db", None)
    target[name[vehicle.end() :] if vehicle else name] = value

"""Scenario files: ROS parameter files, read with the same rules as `--params-file`, and written."""

from __future__ import annotations

import dataclasses
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from cacc_platoon.errors import one_line
from cacc_platoon.formats import Format
from cacc_platoon.scenario.checks import check_namespace
from cacc_platoon.scenario.names import vehicle_index, vehicle_name
from cacc_platoon.scenario.parameter import ScenarioError, nest
from cacc_platoon.scenario.ros_sections import (
    SECTION,
    SectionTargets,
    Values,
    assign,
    read_sections,
    replace,
)
from cacc_platoon.scenario.scenario import Scenario
from cacc_platoon.scenario.table import TABLE
from cacc_platoon.scenario.yaml_text import YamlTextError, load_yaml
from cacc_platoon.texts import TextError, read_text

FORMAT = Format("cacc_platoon scenario", 1)
_LONGEST_NAME = 100
_HEAD = re.compile(r"(?:[ \t]*(?:#.*)?\n)*")
_VERSION = re.compile(rf"^# {FORMAT.name}, format (\S+)\r?$", re.MULTILINE)


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
    UserError
        When the file's format is newer than ours.
    """
    path = Path(path)
    text = read_scenario(path)
    return parse_scenario(text, source=str(path), folder=path.parent, settings=settings)


def read_scenario(path: Path) -> str:
    """Return the text of a scenario file.

    Raises
    ------
    ScenarioError
        When it cannot be read.
    """
    try:
        return read_text(path)
    except TextError as error:
        raise ScenarioError(f"{path}: cannot be read: {error}. Give a scenario file.") from error


def parameter_files(arguments: Sequence[str]) -> list[Path]:
    """Return the files that ROS command-line arguments name with --params-file.

    Examples
    --------
    >>> parameter_files(["vehicle", "--ros-args", "--params-file", "a.yaml"])
    [PosixPath('a.yaml')]
    """
    return [Path(value) for flag, value in pairwise(arguments) if flag == "--params-file"]


def parse_scenario(
    text: str, source: str, folder: Path = Path(), settings: Iterable[str] = ()
) -> Scenario:
    """Build a checked scenario from the text of a ROS parameter file; see `load_scenario`."""
    scenario_version(text, source)
    sections = list(read_sections(_parse_yaml(text, source), source))
    if not sections:
        raise ScenarioError(f"{source}: holds no parameters. Begin with /**: {SECTION}:.")
    set_values = dict(parse_setting(setting) for setting in settings)
    given = [*(section for _, section in sections), set_values]
    prefix = _last(given, "platoon.namespace", source)
    check_namespace(prefix, source)
    followers = _last(given, "platoon.followers", source)
    first = _last(given, "platoon.first_follower", source)
    values = assign(sections, SectionTargets(prefix, range(first, first + followers)), source)
    for name, value in set_values.items():
        _apply_setting(name, value, values)
    scenario = Scenario.from_values(values.common, values.overrides, source, folder)
    return dataclasses.replace(scenario, name=scenario_name(text) or scenario.name)


def scenario_version(text: str, source: str) -> int:
    """Return the version of a scenario's format, 0 where its head does not say one.

    It is a comment, since a ROS parameter file has no place of its own for it.

    Raises
    ------
    UserError
        When it is newer than ours.
    """
    found = _VERSION.search(_head(text))
    if not found:
        return 0
    return FORMAT.check(Format.number(found[1]), source)


def _head(text: str) -> str:
    """Return the comments with which a file begins."""
    head = _HEAD.match(text)
    return head[0] if head else ""


def scenario_name(text: str) -> str | None:
    """Return the name that `format_scenario` gave a scenario, None for any other file."""
    named = re.match(r"# Scenario (\S.*)\n", text)
    return one_line(named[1], _LONGEST_NAME).replace("/", "_") if named else None


def format_scenario(scenario: Scenario) -> str:
    """Write a scenario as a ROS parameter file that `load_scenario` reads back."""
    common = {
        name: value
        for name, value in scenario.values().items()
        if value != () and (name != "leader.file" or scenario.leader.profile == "bag")
    }
    document: dict[str, Any] = {"/**": {SECTION: nest(common)}}
    for index, section in scenario.overrides.items():
        pattern = f"{scenario.platoon.namespace}/{vehicle_name(index)}/*"
        document[pattern] = {SECTION: nest(section)}
    buffer = io.StringIO()
    buffer.write(f"# Scenario {scenario.name}\n# {FORMAT.name}, format {FORMAT.version}\n")
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = None
    yaml.width = 100
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.dump(document, buffer)
    return buffer.getvalue()


def _parse_yaml(text: str, source: str) -> Mapping[str, Any]:
    try:
        document = load_yaml(text)
    except YamlTextError as error:
        line = f" line {error.line}" if error.line else ""
        raise ScenarioError(f"{source}:{line} cannot be read as YAML: {error}.") from error
    if not isinstance(document, Mapping):
        raise ScenarioError(f"{source}: holds no parameters. Begin with /**: {SECTION}:.")
    return document


def _last(given: list[dict[str, Any]], name: str, source: str) -> Any:
    """Return the value that a parameter has in the end, or its default."""
    row = TABLE[name]
    return row.check(next((g[name] for g in reversed(given) if name in g), row.default), source)


def parse_setting(setting: str) -> tuple[str, Any]:
    """Return name and value of a `key=value` text.

    Raises
    ------
    ScenarioError
        When it is none.
    """
    name, equals, text = setting.partition("=")
    if not equals:
        raise ScenarioError(f"--set {setting}: has no value. Write key=value.")
    try:
        return name, load_yaml(text) if text else ""
    except YamlTextError as error:
        raise ScenarioError(
            f"--set {setting}: {text} cannot be read as a YAML value. Write key=value."
        ) from error


def apply_settings(settings: Iterable[str], values: Values) -> None:
    """Replace values by those of `key=value` texts, as `load_scenario` does.

    Raises
    ------
    ScenarioError
        For a text that is none.
    """
    for setting in settings:
        _apply_setting(*parse_setting(setting), values)


def _apply_setting(name: str, value: Any, values: Values) -> None:
    vehicle, _, own = name.partition(".")
    index = vehicle_index(vehicle)
    if index is not None:
        replace(values.overrides.setdefault(index, {}), own, value)
    else:
        replace(values.common, name, value)

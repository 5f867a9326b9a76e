"""A study: one scenario, what varies, how, and what is asked of every row."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from cacc_platoon.errors import UserError
from cacc_platoon.formats import Format
from cacc_platoon.runs.recorded_leader import with_recorded_leader
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import load_scenario, parse_setting
from cacc_platoon.scenario.plugin import source_of
from cacc_platoon.scenario.yaml_text import YamlTextError, load_yaml
from cacc_platoon.sweep.axes import CHANNEL, DESIGN, SAMPLE, Axis, axes_of
from cacc_platoon.sweep.criterion import Criterion, Value
from cacc_platoon.sweep.reading import MOST_ROWS, group, text, texts
from cacc_platoon.sweep.recommended import with_design
from cacc_platoon.texts import TextError, read_text

FORMAT = Format("a plan", 1)
COLUMNS = (
    *("string_stable", "verdict.headline", "l2_gain", "linf_gain", "max_abs_spacing_error[0]"),
    *("max_abs_spacing_error[-1]", "expected.max_abs_spacing_error[0]"),
    *("expected.max_abs_spacing_error[-1]", "max(hop_ratio.max)", "min_gap", "collision", "loss"),
)
"""What a table says of every row unless the plan names something else."""
_KEYS = (
    *("format", "scenario", "settings", "designs", "matrix", "random", "seeds"),
    *("criteria", "columns"),
)
_OWN_CODE = ("controller.law", "v2v.channel", "v2v.receiver")
"""Parameters that name code of the user's own."""


class Point(NamedTuple):
    """A row of the study before it is evaluated.

    Attributes
    ----------
    row : int
        Its number.
    labels : dict of str to value
        What the table says of where it is: the axes, and the parameters of a random place.
    settings : dict of str to value
        The parameters that differ from the plan's scenario.
    """

    row: int
    labels: dict[str, Any]
    settings: dict[str, Any]

    def of(self, scenario: Scenario) -> Scenario:
        """Return the row's scenario, made of that of the plan; a recommended design comes last."""
        settings = dict(self.settings)
        design = settings.pop(DESIGN, "")
        made = scenario.with_values(settings)
        return with_design(made, design) if design else made


@dataclass(frozen=True)
class Plan:
    """A study.

    Attributes
    ----------
    name : str
        That of its file.
    scenario : Scenario
        What all rows have in common.
    axes : tuple of Axis
        What varies; the last one fastest.
    columns : tuple of Value
        What the table says of every row.
    criteria : tuple of Criterion
        What is asked of every row.
    """

    name: str
    scenario: Scenario
    axes: tuple[Axis, ...]
    columns: tuple[Value, ...]
    criteria: tuple[Criterion, ...]

    @property
    def rows(self) -> int:
        """How many rows it has."""
        return math.prod(len(axis.choices) for axis in self.axes)

    def points(self) -> Iterator[Point]:
        """Yield the rows in order."""
        for row, choices in enumerate(itertools.product(*(axis.choices for axis in self.axes))):
            labels, settings = dict[str, Any](), dict[str, Any]()
            for axis, choice in zip(self.axes, choices, strict=True):
                labels[axis.name] = choice.label
                if axis.name == SAMPLE:
                    labels |= choice.settings
                settings |= choice.settings
            yield Point(row, labels, settings)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the columns that say where a row is."""
        return tuple(next(self.points()).labels)

    @property
    def fingerprint(self) -> str:
        """What tells a study from every other: all that its rows depend on."""
        described = {
            "scenario": self.scenario.values(),
            "overrides": {f"{index}": own for index, own in self.scenario.overrides.items()},
            "axes": [[axis.name, [list(choice) for choice in axis.choices]] for axis in self.axes],
            "own_code": _own_code(self),
            "columns": [value.text for value in self.columns],
            "criteria": [criterion.text for criterion in self.criteria],
        }
        return hashlib.sha256(json.dumps(described, default=str).encode()).hexdigest()


def _own_code(plan: Plan) -> list[str]:
    """Return the texts of modules of the user's own that rows may run."""
    settings = [choice.settings for axis in plan.axes for choice in axis.choices]
    values = [plan.scenario.values(), *plan.scenario.overrides.values(), *settings]
    named = {
        str(value).partition(":")[0]
        for one in values
        for key, value in one.items()
        if key.endswith(_OWN_CODE) and value
    }
    return [source_of(module) for module in sorted(named)]


def load_plan(path: Path, settings: Sequence[str] = ()) -> Plan:
    """Read and check a plan.

    Parameters
    ----------
    path : Path
        A YAML file; scenario files that it names are looked for beside it.
    settings : sequence of str, optional
        `key=value` texts that replace values of its scenario.

    Raises
    ------
    UserError
        One line that says what is wrong with it, before anything is evaluated.
    """
    try:
        found = load_yaml(read_text(path))
    except (TextError, YamlTextError) as error:
        raise UserError(f"{path}: {error}. Give a plan, such as those in config/plans.") from error
    return parse_plan(found, path.stem, path.parent, settings)


def parse_plan(found: Any, name: str, folder: Path, settings: Sequence[str] = ()) -> Plan:
    """Return the plan that a document describes; see `load_plan`.

    Examples
    --------
    >>> plan = parse_plan(
    ...     {"matrix": {"controller.time_headway": [0.9, 1.0]}, "seeds": {"from": 1, "count": 2}},
    ...     "mine", Path())
    >>> [list(point.labels.values()) for point in plan.points()]
    [[0.9, 1], [0.9, 2], [1.0, 1], [1.0, 2]]
    """
    document = group(found, name, _KEYS)
    FORMAT.check(document.get("format"), name)
    file = document.get("scenario")
    scenario = load_scenario(folder / text(file, f"{name}: scenario")) if file else Scenario()
    fixed = group(document.get("settings") or {}, f"{name}: settings")
    for setting in settings:
        key, value = parse_setting(setting)
        fixed[key] = value
    scenario = with_recorded_leader(scenario.with_values(fixed) if fixed else scenario)
    plan = Plan(
        name,
        scenario,
        tuple(axes_of(document, name, folder)),
        tuple(map(Value.parse, texts(document, "columns", name) or COLUMNS)),
        tuple(map(Criterion.parse, texts(document, "criteria", name))),
    )
    if not plan.axes:
        raise UserError(f"{name}: nothing varies. Give it a matrix, random, designs or seeds.")
    if plan.rows > MOST_ROWS:
        raise UserError(
            f"{name}: has {plan.rows} rows, more than {MOST_ROWS}, which no table holds. Let less "
            "vary at once, or draw a random design."
        )
    _check_overlap(plan, fixed)
    return plan


def _check_overlap(plan: Plan, fixed: Mapping[str, Any]) -> None:
    """Refuse a parameter that two axes set, or that is fixed and varies: one would do nothing."""
    names = [sorted({key for one in axis.choices for key in one.settings}) for axis in plan.axes]
    found = [key for own in names for key in own]
    if doubled := sorted({one for one in found if found.count(one) > 1}):
        raise UserError(f"{plan.name}: {doubled[0]} varies twice. Take it out of one of them.")
    for axis, own in zip(plan.axes, names, strict=True):
        both = [key for key in own if key in fixed]
        if both and axis.name not in (CHANNEL, DESIGN):
            raise UserError(
                f"{plan.name}: {both[0]} varies, and is set to {fixed[both[0]]} for all rows. Take "
                "it out of one of them."
            )

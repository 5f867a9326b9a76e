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

import numpy as np
import numpy.typing as npt

from cacc_platoon.errors import UserError, one_line
from cacc_platoon.formats import Format
from cacc_platoon.runs.recorded_leader import with_recorded_leader
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.channel_presets import channel_names, channel_settings
from cacc_platoon.scenario.file import load_scenario, parse_setting
from cacc_platoon.scenario.names import vehicle_index
from cacc_platoon.scenario.plugin import source_of
from cacc_platoon.scenario.table import TABLE
from cacc_platoon.scenario.yaml_text import YamlTextError, load_yaml
from cacc_platoon.sweep.criterion import Criterion, Value
from cacc_platoon.sweep.recommended import NAMES, with_design
from cacc_platoon.texts import TextError, read_text

FORMAT = Format("a plan", 1)
MOST_ROWS = 1_000_000
CHANNEL, DESIGN, SEED, SAMPLE = "channel", "design", "run.seed", "sample"
"""Axes that are no parameter, and the one of seeds."""
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
_DIGITS = 12
_OWN_CODE = ("controller.law", "v2v.channel", "v2v.receiver")
"""Parameters that name code of the user's own."""


class Choice(NamedTuple):
    """One place on an axis: what the table says there, and the parameters that it stands for."""

    label: str | float | int | bool
    settings: Mapping[str, Any]


class Axis(NamedTuple):
    """Something that varies.

    Attributes
    ----------
    name : str
        A parameter, `channel`, `design`, or `sample` for random places.
    choices : tuple of Choice
        What it may be.
    """

    name: str
    choices: tuple[Choice, ...]

    @property
    def numeric(self) -> bool:
        """Whether its places can be drawn along a line: at least two different numbers."""
        labels = [choice.label for choice in self.choices]
        numbers = all(type(label) in (int, float) for label in labels)
        return numbers and len(set(labels)) > 1

    @property
    def places(self) -> npt.NDArray[np.float64]:
        """The numbers of a numeric axis, shape (n,)."""
        return np.array([choice.label for choice in self.choices], dtype=float)


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
    document = _group(found, name, _KEYS)
    FORMAT.check(document.get("format"), name)
    file = document.get("scenario")
    scenario = load_scenario(folder / _text(file, f"{name}: scenario")) if file else Scenario()
    fixed = _group(document.get("settings") or {}, f"{name}: settings")
    for setting in settings:
        key, value = parse_setting(setting)
        fixed[key] = value
    scenario = with_recorded_leader(scenario.with_values(fixed) if fixed else scenario)
    plan = Plan(
        name,
        scenario,
        tuple(_axes(document, name, folder)),
        tuple(map(Value.parse, _texts(document, "columns", name) or COLUMNS)),
        tuple(map(Criterion.parse, _texts(document, "criteria", name))),
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


def _axes(document: Mapping[str, Any], name: str, folder: Path) -> Iterator[Axis]:
    designs = document.get("designs")
    if isinstance(designs, list):
        _check_doubles(designs, f"{name}: designs")
        yield Axis(DESIGN, tuple(_recommended(one, f"{name}: designs") for one in designs))
    elif designs:
        own = _group(designs, f"{name}: designs").items()
        yield Axis(DESIGN, tuple(Choice(key, _design(key, one, name, folder)) for key, one in own))
    for parameter, values in _group(document.get("matrix") or {}, f"{name}: matrix").items():
        where = f"{name}: matrix: {parameter}"
        if parameter == CHANNEL:
            channels = tuple(_channel(one, where) for one in _several(values, where))
            _check_doubles([channel.label for channel in channels], where)
            yield Axis(CHANNEL, channels)
        else:
            yield _parameter_axis(parameter, _places(values, where), where)
    if drawn := document.get("random"):
        yield _random_axis(_group(drawn, f"{name}: random", _RANDOM_KEYS), f"{name}: random")
    if (seeds := document.get("seeds")) is not None:
        yield _parameter_axis(SEED, _seeds(seeds, f"{name}: seeds"), f"{name}: seeds")


def _parameter_axis(parameter: str, values: Sequence[Any], where: str) -> Axis:
    for value in values:
        _check_value(parameter, value, where)
    _check_doubles(values, where)
    return Axis(
        parameter,
        tuple(
            Choice(str(value) if isinstance(value, list) else value, {parameter: value})
            for value in values
        ),
    )


def _check_doubles(values: Sequence[Any], where: str) -> None:
    seen = sorted(map(str, (float(v) if type(v) is int else v for v in values)))
    if any(one == other for one, other in itertools.pairwise(seen)):
        raise UserError(f"{where}: has a value twice, and so rows twice. Leave one out.")


def _check_value(parameter: str, value: Any, where: str) -> None:
    vehicle, _, own = parameter.partition(".")
    known = own if vehicle_index(vehicle) is not None else parameter
    if known not in TABLE:
        raise UserError(
            f"{where}: {parameter} is no parameter, and nothing would vary. `platoon parameters` "
            "lists them."
        )
    TABLE[known].check(value, where)


def _places(given: Any, where: str) -> Sequence[Any]:
    """Return the values that a list names, or a range."""
    if not isinstance(given, dict):
        return _several(given, where)
    span = _group(given, where, ("from", "to", "count", "scale"))
    low, high = (_number(span.get(key), f"{where}: {key}") for key in ("from", "to"))
    count = _count(span.get("count"), f"{where}: count", least=2)
    if span.get("scale", "linear") not in ("linear", "log"):
        raise UserError(f"{where}: scale = {span['scale']} must be linear or log.")
    if span.get("scale") == "log":
        if min(low, high) <= 0.0:
            raise UserError(f"{where}: a log scale has no place for {min(low, high):g}.")
        return _rounded(np.geomspace(low, high, count))
    return _rounded(np.linspace(low, high, count))


def _rounded(values: Any) -> list[float]:
    """Return numbers as people would write them: 0.65 in place of 0.6499999999999999."""
    return [float(f"{value:.{_DIGITS}g}") for value in values]


def _seeds(given: Any, where: str) -> Sequence[Any]:
    if isinstance(given, dict):
        span = _group(given, where, ("from", "count"))
        first = _count(span.get("from", 1), f"{where}: from", least=0)
        return range(first, first + _count(span.get("count"), f"{where}: count"))
    return _several(given, where)


def _channel(given: Any, where: str) -> Choice:
    if given not in channel_names():
        raise UserError(f"{where}: {given} is no channel. Take {', '.join(channel_names())}.")
    return Choice(given, dict(map(parse_setting, channel_settings(given))))


def _recommended(given: Any, where: str) -> Choice:
    if given not in NAMES:
        text = one_line(str(given), 80)
        raise UserError(f"{where}: {text} is none of the recommended ones, {', '.join(NAMES)}.")
    return Choice(given, {DESIGN: given})


def _design(name: str, given: Any, plan: str, folder: Path) -> Mapping[str, Any]:
    """Return gains and headway of a design: given ones, or those of a scenario file."""
    where = f"{plan}: designs: {name}"
    if isinstance(given, str):
        own = load_scenario(folder / given).values()
        return {key: value for key, value in own.items() if key.startswith("controller.")}
    settings = _group(given, where)
    for parameter, value in settings.items():
        _check_value(parameter, value, where)
    return settings


_RANDOM_KEYS = ("method", "count", "seed", "over")
_METHODS = {"latin_hypercube": "LatinHypercube", "sobol": "Sobol"}


def _random_axis(given: Mapping[str, Any], where: str) -> Axis:
    """Draw places with little left empty between them, by scipy.stats.qmc."""
    method = _text(given.get("method", "latin_hypercube"), f"{where}: method")
    count = given.get("count")
    if method not in _METHODS:
        raise UserError(f"{where}: method = {method} must be one of {', '.join(_METHODS)}.")
    number, seed = _count(count, f"{where}: count"), _count(given.get("seed", 1), where, least=0)
    over = _group(given.get("over") or {}, f"{where}: over")
    if not over:
        raise UserError(f"{where}: over names no parameter. Write over: {{NAME: [LOW, HIGH]}}.")
    try:
        from scipy.stats import qmc  # noqa: PLC0415  (an extra, and slow to import)
    except ModuleNotFoundError as error:
        raise UserError(
            f"{where}: drawing takes scipy, which is not installed. pip install "
            "'cacc_platoon[sweep]', or write a matrix."
        ) from error
    if method == "sobol" and number & (number - 1):
        raise UserError(f"{where}: count = {number}: a Sobol sequence has 2, 4, 8, ... places.")
    spans = [_span(one, f"{where}: over: {name}") for name, one in over.items()]
    for name, (low, high) in zip(over, spans, strict=True):
        for end in (low, high):
            _check_value(name, end, f"{where}: over: {name}")
    drawn = getattr(qmc, _METHODS[method])(len(over), seed=seed).random(number)
    low, high = np.array(spans).T
    places = low + drawn * (high - low)
    return Axis(
        SAMPLE,
        tuple(
            Choice(index, dict(zip(over, _rounded(place), strict=True)))
            for index, place in enumerate(places)
        ),
    )


def _span(given: Any, where: str) -> tuple[float, float]:
    if not isinstance(given, list) or len(given) != 2:
        raise UserError(f"{where} = {given} is no interval. Write [LOW, HIGH].")
    low, high = (_number(end, where) for end in given)
    if not low < high:
        raise UserError(f"{where} = {given} is empty. The first end must be below the second.")
    return low, high


def _group(given: Any, where: str, keys: Sequence[str] = ()) -> dict[str, Any]:
    if not isinstance(given, dict) or not all(isinstance(key, str) for key in given):
        raise UserError(f"{where}: is no group of names and values. Write name: value.")
    for key in given:
        if keys and key not in keys:
            raise UserError(f"{where}: {one_line(key, 80)} is none of {', '.join(keys)}.")
    return dict(given)


def _several(given: Any, where: str) -> list[Any]:
    if not isinstance(given, list) or not given:
        raise UserError(f"{where}: {one_line(str(given), 80)} is no list of values. Write [A, B].")
    return given


def _texts(document: Mapping[str, Any], key: str, name: str) -> list[str]:
    given = document.get(key) or []
    if not isinstance(given, list):
        raise UserError(f"{name}: {key} is no list. Write one text a line, each after a dash.")
    return [_text(one, f"{name}: {key}") for one in given]


def _text(given: Any, where: str) -> str:
    if not isinstance(given, str):
        raise UserError(f"{where}: {one_line(str(given), 80)} is no text. Put it in quotes.")
    return given


def _number(given: Any, where: str) -> float:
    if isinstance(given, bool) or not isinstance(given, (int, float)) or not math.isfinite(given):
        raise UserError(f"{where} = {one_line(str(given), 80)} must be a finite number.")
    return float(given)


def _count(given: Any, where: str, least: int = 1) -> int:
    if isinstance(given, bool) or not isinstance(given, int) or given < least:
        text = one_line(str(given), 80)
        raise UserError(f"{where} = {text} must be a whole number >= {least}.")
    if given > MOST_ROWS:
        raise UserError(f"{where} = {given} is more than {MOST_ROWS}, which no table holds.")
    return given

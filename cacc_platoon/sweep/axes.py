"""What varies in a study: parameters, channels, designs, seeds, random places."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from cacc_platoon.errors import UserError, one_line
from cacc_platoon.scenario.channel_presets import channel_names, channel_settings
from cacc_platoon.scenario.file import load_scenario, parse_setting
from cacc_platoon.scenario.names import vehicle_index
from cacc_platoon.scenario.table import TABLE
from cacc_platoon.sweep.reading import count, group, number, several, text
from cacc_platoon.sweep.recommended import NAMES

CHANNEL, DESIGN, SEED, SAMPLE = "channel", "design", "run.seed", "sample"
"""Axes that are no parameter, and the one of seeds."""
_DIGITS = 12


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
    def title(self) -> str:
        """Its name with its unit, where that is known."""
        unit = TABLE[self.name].unit if self.name in TABLE else ""
        return f"{self.name} [{unit}]" if unit else self.name

    @property
    def places(self) -> npt.NDArray[np.float64]:
        """The numbers of a numeric axis, shape (n,)."""
        return np.array([choice.label for choice in self.choices], dtype=float)


def axes_of(document: Mapping[str, Any], name: str, folder: Path) -> Iterator[Axis]:
    """Yield what varies in the plan of a document, in its order.

    Parameters
    ----------
    document : mapping
        The plan.
    name : str
        What it is called.
    folder : Path
        Where scenario files that it names are looked for.

    Raises
    ------
    UserError
        One line that says what is wrong.
    """
    designs = document.get("designs")
    if isinstance(designs, list):
        _check_doubles(designs, f"{name}: designs")
        yield Axis(DESIGN, tuple(_recommended(one, f"{name}: designs") for one in designs))
    elif designs:
        own = group(designs, f"{name}: designs").items()
        yield Axis(DESIGN, tuple(Choice(key, _design(key, one, name, folder)) for key, one in own))
    for parameter, values in group(document.get("matrix") or {}, f"{name}: matrix").items():
        where = f"{name}: matrix: {parameter}"
        if parameter == CHANNEL:
            channels = tuple(_channel(one, where) for one in several(values, where))
            _check_doubles([channel.label for channel in channels], where)
            yield Axis(CHANNEL, channels)
        else:
            yield _parameter_axis(parameter, _places(values, where), where)
    if drawn := document.get("random"):
        yield _random_axis(group(drawn, f"{name}: random", _RANDOM_KEYS), f"{name}: random")
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
        return several(given, where)
    span = group(given, where, ("from", "to", "count", "scale"))
    low, high = (number(span.get(key), f"{where}: {key}") for key in ("from", "to"))
    places = count(span.get("count"), f"{where}: count", least=2)
    if span.get("scale", "linear") not in ("linear", "log"):
        raise UserError(f"{where}: scale = {span['scale']} must be linear or log.")
    if span.get("scale") == "log":
        if min(low, high) <= 0.0:
            raise UserError(f"{where}: a log scale has no place for {min(low, high):g}.")
        return _rounded(np.geomspace(low, high, places))
    found = _rounded(np.linspace(low, high, places))
    whole = all(type(span[key]) is int for key in ("from", "to"))
    return [int(one) for one in found] if whole and all(map(float.is_integer, found)) else found


def _rounded(values: Any) -> list[float]:
    """Return numbers as people would write them: 0.65 in place of 0.6499999999999999."""
    return [float(f"{value:.{_DIGITS}g}") for value in values]


def _seeds(given: Any, where: str) -> Sequence[Any]:
    if isinstance(given, dict):
        span = group(given, where, ("from", "count"))
        first = count(span.get("from", 1), f"{where}: from", least=0)
        return range(first, first + count(span.get("count"), f"{where}: count"))
    return several(given, where)


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
    settings = group(given, where)
    for parameter, value in settings.items():
        _check_value(parameter, value, where)
    return settings


_RANDOM_KEYS = ("method", "count", "seed", "over")
_METHODS = {"latin_hypercube": "LatinHypercube", "sobol": "Sobol"}


def _random_axis(given: Mapping[str, Any], where: str) -> Axis:
    """Draw places with little left empty between them, by scipy.stats.qmc."""
    method = text(given.get("method", "latin_hypercube"), f"{where}: method")
    if method not in _METHODS:
        raise UserError(f"{where}: method = {method} must be one of {', '.join(_METHODS)}.")
    places = count(given.get("count"), f"{where}: count")
    seed = count(given.get("seed", 1), f"{where}: seed", least=0)
    over = group(given.get("over") or {}, f"{where}: over")
    if not over:
        raise UserError(f"{where}: over names no parameter. Write over: {{NAME: [LOW, HIGH]}}.")
    try:
        from scipy.stats import qmc  # noqa: PLC0415  (an extra, and slow to import)
    except ModuleNotFoundError as error:
        raise UserError(
            f"{where}: drawing takes scipy, which is not installed. pip install "
            "'cacc_platoon[sweep]', or write a matrix."
        ) from error
    if method == "sobol" and places & (places - 1):
        raise UserError(f"{where}: count = {places}: a Sobol sequence has 2, 4, 8, ... places.")
    spans = [_span(one, f"{where}: over: {name}") for name, one in over.items()]
    for name, (low, high) in zip(over, spans, strict=True):
        for end in (low, high):
            _check_value(name, end, f"{where}: over: {name}")
    drawn = getattr(qmc, _METHODS[method])(len(over), seed=seed).random(places)
    low, high = np.array(spans).T
    drawn = low + drawn * (high - low)
    return Axis(
        SAMPLE,
        tuple(
            Choice(index, dict(zip(over, _rounded(place), strict=True)))
            for index, place in enumerate(drawn)
        ),
    )


def _span(given: Any, where: str) -> tuple[float, float]:
    if not isinstance(given, list) or len(given) != 2:
        raise UserError(f"{where} = {given} is no interval. Write [LOW, HIGH].")
    low, high = (number(end, where) for end in given)
    if not low < high:
        raise UserError(f"{where} = {given} is empty. The first end must be below the second.")
    return low, high

"""Signals on one grid of samples, and what is wrong with them: nothing is hidden, all is named."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cacc_platoon.bags.decode import Floats, Signal
from cacc_platoon.bags.raw import Integers

Booleans = npt.NDArray[np.bool_]
_NEAR = 100  # samples
_ABSURD = 1e100  # only damaged bytes are so large; squares of less do not overflow
_NAMED_RUNS = 3  # so many gaps of one topic are named one by one
_PLURALS = {"is": "are", "does": "do", "lacks": "lack", "begins": "begin", "ends": "end"}


class Fault(NamedTuple):
    """One thing wrong with one topic, `what` being the same text wherever it is the same."""

    topic: str
    what: str


class Grid(NamedTuple):
    """The samples of a run: sample k is stamped origin + k step.

    Attributes
    ----------
    origin, step : int
        Stamp of sample 0 and control period [ns].
    samples : int
        Number of samples.
    exact : bool
        Whether every stamp is on the grid; otherwise values are interpolated to it.
    """

    origin: int
    step: int
    samples: int
    exact: bool

    def say(self, sample: int) -> str:
        """Name a sample and its time."""
        return f"sample {sample} ({sample * self.step / 1e9:g} s)"


def lay_grid(signals: Iterable[Signal], step: int | None) -> Grid:
    """Return the grid that the signals share.

    Parameters
    ----------
    signals : iterable of Signal
        All signals of a platoon, at least one with a message.
    step : int or None
        Control period of the scenario [ns]; measured from the stamps where they disagree with it.
    """
    filled = [signal.stamps for signal in signals if len(signal.stamps)]
    every: Integers = np.concatenate(filled)
    steps: Integers = np.concatenate([np.diff(np.sort(stamps)) for stamps in filled])
    steps = steps[steps > 0]
    measured = int(np.median(steps)) if steps.size else step or 1
    if step is None or not (0.5 * step <= measured <= 2 * step):
        step = measured
    low, high = _plausible_span(every, step, max(len(stamps) for stamps in filled))
    every = _shared(every[(every >= low) & (every <= high)], step, alone=len(filled) == 1)
    begin = int(np.min(every))
    exact = bool((every % step == begin % step).mean() > 0.99)
    origin = begin
    if exact and begin % step == 0 and begin <= high - low:
        origin = 0  # a run of ours counts from zero, also when its beginning was not recorded
    samples = (int(np.max(every)) - origin + step // 2) // step + 1
    return Grid(origin, step, samples, exact)


def _plausible_span(stamps: Integers, step: int, count: int) -> tuple[int, int]:
    """Return the first and last stamp that belong together; a damaged stamp must not stretch it."""
    middle = int(np.median(stamps))
    reach = 4 * step * (count + 1000)
    return middle - reach, middle + reach


def _shared(stamps: Integers, step: int, alone: bool) -> Integers:
    """Leave out single messages far from all others: their stamps are damaged."""
    first = int(np.min(stamps))
    index = (stamps - first) // step
    counts = np.bincount(index)
    often = np.flatnonzero(counts > 1)
    if alone or not often.size:
        return stamps
    low, high = int(often[0]), int(often[-1])
    single = np.flatnonzero(counts == 1)
    for k in single[single > high].tolist():
        high = k if k - high <= _NEAR else high
    for k in single[single < low][::-1].tolist():
        low = k if low - k <= _NEAR else low
    return np.asarray(stamps[(index >= low) & (index <= high)])


def sample(signal: Signal, grid: Grid) -> tuple[Floats, list[Fault]]:
    """Return a signal on the grid, NaN where there is none, and its faults.

    Of several messages with one stamp the first is taken.
    """
    faults = _Faults(signal.topic)
    if signal.unreadable:
        faults.add(f"unreadable messages, left out: {signal.unreadable}")
    stamps, values = signal.stamps, signal.values
    within = (stamps >= grid.origin - grid.step // 2) & (
        stamps <= grid.origin + (grid.samples - 1) * grid.step + grid.step // 2
    )
    if not within.all():
        faults.add(
            f"stamps outside of the run, left out: {int((~within).sum())}, the first "
            f"{int(stamps[~within][0])} ns"
        )
        stamps, values = stamps[within], values[within]
    column = np.full(grid.samples, np.nan)
    if not len(stamps):
        faults.add("no message")
        return column, faults.found
    index = (stamps - grid.origin + grid.step // 2) // grid.step
    if grid.exact:
        off = (stamps - grid.origin) % grid.step != 0
        if off.any():
            where = grid.say(int(index[off][0]))
            faults.add(f"stamps between two samples: {int(off.sum())}, the first near {where}")
            stamps, values, index = stamps[~off], values[~off], index[~off]
    _name_disorder(index, values, grid, faults)
    _name_not_finite(index, values, grid, faults)
    if grid.exact:
        column[index[::-1]] = values[::-1]
    else:
        column = _interpolated(stamps, values, grid)
    column[~_usable(column)] = np.nan
    present = np.zeros(grid.samples, np.bool_)
    present[index] = True
    if not grid.exact:  # jitter leaves a sample without a stamp of its own at times
        present[1:-1] |= present[:-2] & present[2:]
    _name_gaps(present, grid, faults)
    return column, faults.found


class _Faults:
    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.found: list[Fault] = []

    def add(self, what: str) -> None:
        self.found.append(Fault(self.topic, what))


def _name_disorder(index: Integers, values: Floats, grid: Grid, faults: _Faults) -> None:
    back = np.flatnonzero(np.diff(index) < 0)
    if back.size:
        first = int(back[0])
        faults.add(
            f"out of order: {grid.say(int(index[first + 1]))} stands after sample "
            f"{int(index[first])}" + (f", and {back.size - 1} more" if back.size > 1 else "")
        )
    if not grid.exact:
        return
    order = np.argsort(index, kind="stable")
    ordered, sorted_values = index[order], values[order]
    again = np.flatnonzero(np.diff(ordered) == 0)
    if not again.size:
        return
    differ = sorted_values[again] != sorted_values[again + 1]
    where = grid.say(int(ordered[again[0]]))
    more = f", and {again.size - 1} more" if again.size > 1 else ""
    if differ.any():
        where = grid.say(int(ordered[again[differ][0]]))
        faults.add(
            f"two publishers: {where} is there more than once with different values{more}; a "
            "second platoon of the same name was recorded, or a message was altered"
        )
    else:
        faults.add(f"duplicate: {where} is there more than once{more}")


def _name_not_finite(index: Integers, values: Floats, grid: Grid, faults: _Faults) -> None:
    bad = np.flatnonzero(~_usable(values))
    if bad.size:
        where = grid.say(int(index[bad[0]]))
        more = f", and {bad.size - 1} more" if bad.size > 1 else ""
        kind = "absurd" if np.isfinite(values[bad[0]]) else "not finite"
        faults.add(f"{kind}: {where} is {values[bad[0]]}{more}")


def _usable(values: Floats) -> Booleans:
    return np.abs(values) < _ABSURD


def _name_gaps(present: Booleans, grid: Grid, faults: _Faults) -> None:
    edges = np.flatnonzero(np.diff(np.concatenate(([0], ~present, [0])).astype(np.int8)))
    holes = [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
    if holes and holes[0][0] == 0:
        faults.add(f"begins late: at {grid.say(holes.pop(0)[1])}")
    if holes and holes[-1][1] == grid.samples:
        faults.add(f"ends early: at {grid.say(holes.pop()[0] - 1)}")
    for begin, end in holes[:_NAMED_RUNS]:
        if end - begin == 1:
            faults.add(f"gap: {grid.say(begin)} is missing")
        else:
            faults.add(f"gap: {grid.say(begin)} to {grid.say(end - 1)} are missing")
    if len(holes) > _NAMED_RUNS:
        lost = sum(end - begin for begin, end in holes[_NAMED_RUNS:])
        faults.add(f"{len(holes) - _NAMED_RUNS} more gaps, {lost} samples in all")


def _interpolated(stamps: Integers, values: Floats, grid: Grid) -> Floats:
    """Return values between the stamps; nothing is made up outside of them."""
    usable = _usable(values)
    stamps, values = stamps[usable], values[usable]
    if not len(stamps):
        return np.full(grid.samples, np.nan)
    unique, first = np.unique(stamps, return_index=True)
    times = grid.origin + np.arange(grid.samples) * grid.step
    column = np.interp(
        (times - grid.origin).astype(np.float64),
        (unique - grid.origin).astype(np.float64),
        values[first],
    )
    half = grid.step // 2
    column[(times < unique[0] - half) | (times > unique[-1] + half)] = np.nan
    return np.asarray(column, np.float64)


def group(faults: Iterable[Fault]) -> list[str]:
    """Return one line for each fault, the topics that share it together."""
    topics: Mapping[str, list[str]] = defaultdict(list)
    for fault in faults:
        topics[fault.what].append(fault.topic)
    lines = []
    for what, names in topics.items():
        if len(names) == 1:
            lines.append(f"{names[0]}: {what}")
        else:
            lines.append(f"{len(names)} topics ({names[0]}, ...): {_of_several(what)}")
    return lines


def _of_several(what: str) -> str:
    """Return what is said of one topic as it is said of several."""
    verb, space, rest = what.partition(" ")
    return f"{_PLURALS.get(verb, verb)}{space}{rest}"

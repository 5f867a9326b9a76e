"""A picture of a platoon as lines of a terminal: as much as fits, and never wrapped."""

from __future__ import annotations

import unicodedata
from collections.abc import Callable, Iterator, Sequence
from enum import Enum
from typing import NamedTuple

from cacc_platoon.errors import one_line
from cacc_platoon.live.picture import Picture, VehicleNow

BEHIND = 1.0
"""From so much simulated time on a vehicle is shown as one of which nothing is heard [s]."""
SILENT = 2.0
"""From so long on it is said that nothing is heard of the platoon [s]."""
EVENTS_SHOWN = 3
_GAP = "  "
_ALWAYS = 4
"""Columns of a lower rank are there even as long as they are empty."""


class Mood(Enum):
    """How a text is meant, as the number that makes a terminal show it so."""

    PLAIN = 0
    STRONG = 1
    FAINT = 2
    WARNING = 33
    ALARM = 31

    def paint(self, text: str) -> str:
        """Return a text with what makes a terminal show it like this."""
        return f"\033[{self.value}m{text}\033[0m" if self.value and text else text


class Cell(NamedTuple):
    """A piece of a line."""

    text: str
    mood: Mood = Mood.PLAIN


class Column(NamedTuple):
    """A column of the table.

    Attributes
    ----------
    name, unit : str
        What stands above it.
    width : int
        Letters of it.
    rank : int
        The less, the longer it is kept where the terminal is narrow.
    cell : callable
        Returns what a vehicle has in it, of the picture.
    """

    name: str
    unit: str
    width: int
    rank: int
    cell: Callable[[VehicleNow, Picture], Cell]


def table_lines(picture: Picture, width: int, height: int, *, coloured: bool = False) -> list[str]:
    """Return a picture as lines.

    Parameters
    ----------
    picture : Picture
        What the platoon looks like.
    width, height : int
        Letters of a line and lines that there are; more vehicles are counted in one line.
    coloured : bool, optional
        Whether to mark what stands out, for a terminal.
    """
    head = [[Cell(_cut(line, width), mood)] for line, mood in _head(picture)]
    events = [[Cell(_cut(line, width), Mood.FAINT)] for line in _events(picture)]
    if height < len(head) + len(events) + 6:
        events = events[-1:] if height >= len(head) + 6 else []
    table = _table(picture, width, height - len(head) - len(events))
    lines = [*head, *table, *events][: max(height, 1)]
    return ["".join(_shown(cell, coloured) for cell in line).rstrip() for line in lines]


def _shown(cell: Cell, coloured: bool) -> str:
    return cell.mood.paint(cell.text) if coloured else cell.text


def _head(picture: Picture) -> Iterator[tuple[str, Mood]]:
    yield "  ".join([picture.namespace, *progress(picture)]), Mood.STRONG
    if picture.message:
        yield one_line(picture.message), Mood.ALARM


def progress(picture: Picture) -> Iterator[str]:
    """Yield how far a platoon is, piece by piece."""
    yield picture.phase or "nothing heard yet"
    if picture.sample >= 0 and picture.samples:
        yield f"sample {picture.sample} of {picture.samples - 1}, {picture.time:.1f} s"
    if picture.factor is not None:
        yield f"real-time factor {picture.factor:.1f}"
    if picture.left is not None:
        yield f"{picture.left:.0f} s left"
    if picture.silence > SILENT:
        yield f"silent for {picture.silence:.0f} s"


def _events(picture: Picture) -> list[str]:
    return [
        f"{event.sample * picture.step:8.2f} s  "
        + one_line(f"{event.node} {event.kind} {event.text}")
        for event in picture.events[-EVENTS_SHOWN:]
    ]


def _table(picture: Picture, width: int, height: int) -> list[list[Cell]]:
    """Return the rows of the vehicles that fit, with their head."""
    if not picture.vehicles or height < 2:
        return []
    columns = _columns(picture, width)
    names = [_head_cell(name, width) for name, _, width, _, _ in columns]
    units = [_head_cell(unit, width) for _, unit, width, _, _ in columns]
    lines = [_spaced(names), _spaced(units)] if height >= 6 else [_spaced(names)]
    room = height - len(lines)
    vehicles = picture.vehicles
    if len(vehicles) > room:
        vehicles = vehicles[: room - 1]
    for vehicle in vehicles:
        lines.append(_spaced([_aligned(one, vehicle, picture) for one in columns]))
    if more := len(picture.vehicles) - len(vehicles):
        lines.append([Cell(_cut(f"... and {more} more vehicles", width), Mood.FAINT)])
    return lines


def _head_cell(text: str, width: int) -> Cell:
    return Cell(_cut(text, width).rjust(width), Mood.FAINT)


def _columns(picture: Picture, width: int) -> list[Column]:
    """Return the columns that have something to show and fit."""
    kept: list[Column] = []
    room = width + len(_GAP)
    for column in sorted(COLUMNS, key=lambda one: one.rank):
        shown = any(column.cell(vehicle, picture).text for vehicle in picture.vehicles)
        if column.width + len(_GAP) <= room and (shown or column.rank < _ALWAYS):
            kept.append(column)
            room -= column.width + len(_GAP)
    return [column for column in COLUMNS if column in kept] or [COLUMNS[0]._replace(width=width)]


def _aligned(column: Column, vehicle: VehicleNow, picture: Picture) -> Cell:
    text, mood = column.cell(vehicle, picture)
    return Cell(_cut(text, column.width).rjust(column.width), mood)


def _spaced(cells: Sequence[Cell]) -> list[Cell]:
    return [*(part for cell in cells[:-1] for part in (cell, Cell(_GAP))), *cells[-1:]]


def _cut(text: str, width: int) -> str:
    """Return as much of a text as takes so many columns of a terminal."""
    taken = 0
    for count, letter in enumerate(text):
        taken += 2 if unicodedata.east_asian_width(letter) in "WF" else 1
        if taken > width:
            return text[:count]
    return text


def _number(form: str, value: float | None, mood: Mood = Mood.PLAIN) -> Cell:
    return Cell("" if value is None else format(value, form), mood)


def _index(vehicle: VehicleNow, picture: Picture) -> Cell:
    return Cell(str(vehicle.index), Mood.STRONG)


def _gap(vehicle: VehicleNow, picture: Picture) -> Cell:
    touches = vehicle.gap is not None and vehicle.gap <= 0.0
    return _number(".2f", vehicle.gap, Mood.ALARM if touches else Mood.PLAIN)


def _state(vehicle: VehicleNow, picture: Picture) -> Cell:
    """Return what a follower makes of V2V, or that nothing is heard of a vehicle."""
    behind = None if vehicle.sample is None else (picture.seen - vehicle.sample) * picture.step
    if behind is None or behind > BEHIND:
        return Cell("not heard" if behind is None else f"{behind:.0f} s behind", Mood.WARNING)
    if vehicle.alarm:
        return Cell("alarm", Mood.ALARM)
    moods = {"normal": Mood.PLAIN, "": Mood.PLAIN, "fallback": Mood.ALARM}
    received = "received" if vehicle.received is not None else ""
    return Cell(vehicle.reception or received, moods.get(vehicle.reception, Mood.WARNING))


COLUMNS = (
    Column("vehicle", "", 7, 0, _index),
    Column("gap", "[m]", 8, 1, _gap),
    Column("speed", "[m/s]", 7, 2, lambda one, _: _number(".3f", one.velocity)),
    Column("error", "[m]", 8, 3, lambda one, _: _number("+.4f", one.spacing_error)),
    Column("accel", "[m/s^2]", 7, 6, lambda one, _: _number("+.3f", one.acceleration)),
    Column("V2V", "", 11, 4, _state),
    Column("age", "[s]", 6, 5, lambda one, _: _number(".2f", one.packet_age)),
    Column("received", "[m/s^2]", 8, 7, lambda one, _: _number("+.3f", one.received)),
    Column("late", "periods", 7, 8, lambda one, _: _number(".2f", one.lateness)),
    Column("position", "[m]", 10, 9, lambda one, _: _number(".2f", one.position)),
)

"""Tables of the report's page: each cell names the key of metrics.json that it shows."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from cacc_platoon.analysis.metrics import SETTLING_FRACTION
from cacc_platoon.notation import as_html, as_text
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import vehicle_name
from cacc_platoon.scenario.table import TABLE

UNKNOWN = "-"

FOLLOWER_NOTE = (
    "At control instants, between which peaks may be a little larger. Expected: of the "
    "expectation run. Hop ratio: a norm of delta_i over that of delta_{i-1}. Settled: from then on "
    f"|delta| stays within {100 * SETTLING_FRACTION:g} % of its peak. Gap: less the length of the "
    "vehicle ahead. Headway kept: (x_{i-1} - x_i - d)/v_i while the vehicle moves. TTC: gap over "
    "closing speed, where the vehicle closes in. Jerk: (a(k+1) - a(k))/T. "
    f"{UNKNOWN}: not known, or never so."
)
"""What its columns are."""
NOISE_NOTE = (
    "w is what arrived over what was sent, wherever the sender accelerated, the packet arrived and "
    "nothing but w changes what it says. E[w] and Var[w] are of the link's parameters. SNR: the "
    "least 20 log10(|a|/|w a - a|), the paper's definition 2.3. Breaches: how often w left "
    "[1 - 1/rho, 1 + 1/rho]."
)
RECEPTION_NOTE = (
    "Sent: blackouts apart. Bursts: losses in a row, how many, how long in the mean and at most, "
    "in packets. Late: delivered after the sample it was sent at. Overtaken: delivered after one "
    "that was sent later. Age: how long ago the newest packet that has arrived was sent. Latency "
    "margin: of a constant latency, as the table of what the verdict rests on says."
)
FALLBACK_NOTE = (
    "Shares of all samples in each state, when the vehicle first left the normal one and was last "
    "out of it, and how many times it left."
)
MONITOR_NOTE = (
    "Share of samples with an alarm, when the first one began and the last one ended, how many "
    "there were, and how many of them began neither during false data nor while the window that "
    "the monitor looks back still held some."
)

MOST_EVENTS = 100
"""So many are on the page."""


class Column(NamedTuple):
    """One column: heading, unit, the key of its list in metrics.json, the number format.

    `first` is the vehicle that the list begins with.
    """

    heading: str
    unit: str
    key: str
    form: str = ".4f"
    first: int = 1


FOLLOWER_COLUMNS = (
    Column("max|delta|", "m", "max_abs_spacing_error", ".6f"),
    Column("expected max|delta|", "m", "expected.max_abs_spacing_error", ".6f"),
    Column("hop ratio, max", "-", "hop_ratio.max", ".5f", 2),
    Column("expected", "-", "expected.hop_ratio.max", ".5f", 2),
    Column("RMS delta", "m", "rms_spacing_error"),
    Column("L2 delta", "m s^0.5", "l2_spacing_error"),
    Column("hop ratio, L2", "-", "hop_ratio.l2", ".5f", 2),
    Column("expected", "-", "expected.hop_ratio.l2", ".5f", 2),
    Column("settled after", "s", "settling_time", ".1f"),
    Column("min gap", "m", "min_gap_per_follower", ".2f"),
    Column("headway kept, min", "s", "min_time_headway", ".4f"),
    Column("mean", "s", "mean_time_headway", ".4f"),
    Column("min TTC", "s", "min_time_to_collision", ".1f"),
    Column("max|a|", "m/s^2", "max_abs_acceleration", ".4f", 0),
    Column("max|jerk|", "m/s^3", "max_abs_jerk", ".4f", 0),
)
NOISE_COLUMNS = (
    Column("samples", "-", "samples", "d"),
    Column("mean w", "-", "mean", ".6f"),
    Column("E[w]", "-", "expected_mean", ".6f"),
    Column("variance", "-", "variance", ".6f"),
    Column("Var[w]", "-", "expected_variance", ".6f"),
    Column("smallest", "-", "low", ".6f"),
    Column("largest", "-", "high", ".6f"),
    Column("SNR", "dB", "snr_db", ".3f"),
    Column("breaches", "-", "breaches", "d"),
)
RECEPTION_COLUMNS = (
    Column("sent", "-", "sent", "d"),
    Column("arrived", "-", "arrived", "d"),
    Column("lost", "-", "lost", "d"),
    Column("share", "-", "loss", ".4f"),
    Column("probability of loss", "-", "loss_probability", ".4f"),
    Column("bursts", "-", "bursts.number", "d"),
    Column("mean", "-", "bursts.mean", ".3f"),
    Column("longest", "-", "bursts.longest", "d"),
    Column("in blackouts", "-", "in_blackouts", "d"),
    Column("late", "-", "late", "d"),
    Column("overtaken", "-", "overtaken", "d"),
    Column("age, median", "s", "age.median", ".4f"),
    Column("99 %", "s", "age.p99", ".4f"),
    Column("at most", "s", "age.max", ".4f"),
)
MARGIN_COLUMNS = (
    Column("latency margin", "s", "margin", ".4f"),
    Column("older than that", "-", "share_above", ".4f"),
)
FALLBACK_COLUMNS = (
    Column("normal", "-", "shares.normal", ".4f"),
    Column("degrading", "-", "shares.degrading", ".4f"),
    Column("fallback", "-", "shares.fallback", ".4f"),
    Column("recovering", "-", "shares.recovering", ".4f"),
    Column("first", "s", "begin", "g"),
    Column("last", "s", "end", "g"),
    Column("times", "-", "turns", "d"),
)

CLOCK_COLUMNS = (
    Column("lateness, median", "s", "lateness.median", ".5f"),
    Column("99 %", "s", "lateness.p99", ".5f"),
    Column("at most", "s", "lateness.max", ".5f"),
    Column("a period late or more", "-", "overruns", "d"),
    Column("unknown", "-", "unknown", "d"),
    Column("first", "s", "begin", "g"),
    Column("last", "s", "end", "g"),
    Column("age of the pose used, median", "s", "pose_age.median", ".4f"),
    Column("99 %", "s", "pose_age.p99", ".4f"),
    Column("at most", "s", "pose_age.max", ".4f"),
)
MONITOR_COLUMNS = (
    Column("time with an alarm", "-", "share", ".4f"),
    Column("first", "s", "begin", "g"),
    Column("last", "s", "end", "g"),
    Column("alarms", "-", "alarms", "d"),
    Column("false ones", "-", "false_alarms", "d"),
)


def _note(text: str) -> str:
    return f"<p>{as_html(text)}</p>"


def look_up(document: Any, key: str) -> Any:
    """Return what a dotted key such as `hop_ratio.max.3` means in metrics.json."""
    for part in key.split("."):
        document = document[int(part) if isinstance(document, list) else part]
    return document


def cell(document: dict[str, Any], key: str, form: str) -> str:
    """Return a table cell with the number that `key` means."""
    value = look_up(document, key)
    if value is None:
        return f'<td data-key="{key}">{UNKNOWN}</td>'
    return f'<td data-key="{key}" data-form="{form}">{value:{form}}</td>'


def follower_table(document: dict[str, Any]) -> str:
    """Return the table of metrics, one row per follower."""
    rows = []
    offset = document["first_follower"] - 1
    for vehicle in range(1, document["followers"] + 1):
        cells = [f"<td>{vehicle + offset}</td>"]
        for column in FOLLOWER_COLUMNS:
            known = vehicle >= column.first
            key = f"{column.key}.{vehicle - column.first}"
            cells.append(cell(document, key, column.form) if known else "<td></td>")
        rows.append("".join(cells))
    heads = [_heading("follower"), *(_heading(c.heading, c.unit) for c in FOLLOWER_COLUMNS)]
    return _table(heads, rows) + _note(FOLLOWER_NOTE)


def noise_table(document: dict[str, Any]) -> str:
    """Return the realised noise, one row per link."""
    return _link_table(document, {"noise.links": NOISE_COLUMNS}) + _note(NOISE_NOTE)


def reception_table(document: dict[str, Any]) -> str:
    """Return packet loss and age of information, one row per link."""
    both = {"reception": RECEPTION_COLUMNS, "age_margins": MARGIN_COLUMNS}
    return _link_table(document, both) + _note(RECEPTION_NOTE)


def fallback_table(document: dict[str, Any]) -> str:
    """Return the shares of time in each state of reception, one row per vehicle."""
    return _vehicle_table(document, "fallback", FALLBACK_COLUMNS) + _note(FALLBACK_NOTE)


def event_table(document: dict[str, Any]) -> str:
    """Return what happened in the run, one row an event, the first ones of many."""
    events = document["events"]
    rows = []
    for event in events[:MOST_EVENTS]:
        words = (as_html(event[key]) for key in ("node", "kind", "text"))
        cells = "".join(f'<td class="text">{word}</td>' for word in words)
        rows.append(f"<td>{event['time']:g}</td>{cells}")
    left = len(events) - len(rows)
    more = f"<p>and {left} more; metrics.json has all of them</p>" if left else ""
    names = [_heading(name, left=True) for name in ("node", "what", "to what")]
    headings = [_heading("time", "s"), *names]
    return _table(headings, rows) + more


def monitor_table(document: dict[str, Any]) -> str:
    """Return what monitors said, one row per vehicle."""
    return _vehicle_table(document, "monitor", MONITOR_COLUMNS) + _note(MONITOR_NOTE)


def clock_table(document: dict[str, Any]) -> str:
    """Return how samples came by clocks, one row per vehicle."""
    return _vehicle_table(document, "clocks", CLOCK_COLUMNS)


def _vehicle_table(document: dict[str, Any], vehicles: str, columns: Sequence[Column]) -> str:
    rows = []
    for number, one in enumerate(document[vehicles]):
        cells = [f"<td>{one['follower']}</td>"]
        cells += [cell(document, f"{vehicles}.{number}.{c.key}", c.form) for c in columns]
        rows.append("".join(cells))
    headings = (_heading(c.heading, c.unit) for c in columns)
    return _table([_heading("follower"), *headings], rows)


def _link_table(document: dict[str, Any], parts: Mapping[str, Sequence[Column]]) -> str:
    """Return columns of lists that go over the same links, one row per link."""
    columns = [(links, column) for links, some in parts.items() for column in some]
    rows = []
    for number, link in enumerate(look_up(document, next(iter(parts)))):
        cells = [f"<td>{link['sender']} to {link['follower']}</td>"]
        cells += [cell(document, f"{links}.{number}.{c.key}", c.form) for links, c in columns]
        rows.append("".join(cells))
    return _table([_heading("link"), *(_heading(c.heading, c.unit) for _, c in columns)], rows)


def scenario_table(scenario: Scenario) -> str:
    """Return every parameter of the run with unit and meaning, a vehicle's own ones at the end."""
    rows = []
    for name, value in scenario.values().items():
        row = TABLE[name]
        rows.append(_parameter(name, value, row.unit, row.meaning))
    for index, own in scenario.overrides.items():
        for name, value in own.items():
            rows.append(
                _parameter(f"{vehicle_name(index)}: {name}", value, TABLE[name].unit, "own value")
            )
    heads = [_heading(text, left=True) for text in ("parameter", "value", "unit", "meaning")]
    return _table(heads, rows, kind="words")


def text_table(heads: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return rows of words."""
    body = ["".join(map(_words, ("", *heads[1:]), row)) for row in rows]
    return _table([_heading(text, left=True) for text in heads], body, kind="words")


def _words(head: str, item: object) -> str:
    """Return a cell that knows its heading, for screens too narrow to show it above."""
    label = f' data-head="{html.escape(as_text(head))}: "' if head else ""
    return f'<td class="text"{label}>{as_html(str(item))}</td>'


def fact_table(facts: Sequence[tuple[str, object]]) -> str:
    """Return names and values, one per row."""
    rows = [
        f'<td class="text">{html.escape(name)}</td><td class="code">{html.escape(str(value))}</td>'
        for name, value in facts
    ]
    return _table([], rows, kind="words")


def _parameter(name: str, value: object, unit: str, meaning: str) -> str:
    items = value if isinstance(value, tuple) else (value,)
    words = [f"{item:g}" if isinstance(item, float) else str(item) for item in items]
    shown = ", ".join(words) if words else "none"
    return (
        f'<td class="text">{html.escape(name)}</td><td class="code">{html.escape(shown)}</td>'
        f"{_words('unit', unit)}{_words('', meaning)}"
    )


def _heading(text: str, unit: str = "", *, left: bool = False) -> str:
    small = f"<small>[{as_html(unit)}]</small>" if unit else ""
    return f"<th{' class=text' if left else ''}>{as_html(text)}{small}</th>"


def _table(heads: Sequence[str], rows: Sequence[str], kind: str = "") -> str:
    head = f"<thead><tr>{''.join(heads)}</tr></thead>" if heads else ""
    body = "".join(f"<tr>{row}</tr>" for row in rows)
    named = f' class="{kind}"' if kind else ""
    return f'<div class="scroll"><table{named}>{head}<tbody>{body}</tbody></table></div>'

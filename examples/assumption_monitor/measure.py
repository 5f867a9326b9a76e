"""Measure the assumption monitor: python examples/assumption_monitor/measure.py.

Counts false alarms over many seeds, and times how soon false data are noticed. Prints tables;
writes measured.json, and puts the tables into the README.md of its folder, if it has one.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from cacc_platoon.analysis.monitor import MonitorUse, monitor_use
from cacc_platoon.cli.progress import ProgressLine
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.channel_presets import channel_settings
from cacc_platoon.simulation import Trajectory, simulate
from cacc_platoon.simulation.platoon import arrivals_of

HERE = Path(__file__).parent
DATA, PAGE = "measured.json", "README.md"
BEGIN, END = "<!-- measure.py -->", "<!-- end of measure.py -->"

Values = Mapping[str, Any]

CYCLE = (
    *((10.0, 0.0), (8.0, -1.0), (5.0, 0.0), (10.0, 0.8), (10.0, 0.0)),
    *((5.0, -3.0), (6.0, 0.0), (10.0, 1.5), (6.0, 0.0)),
)
"""What the leader does over and over: for how long [s], and its acceleration [m/s^2]."""

LOSSY = {"v2v.loss": 0.3, "v2v.latency": 0.05, "v2v.jitter": 0.05}


def preset(name: str) -> Values:
    """Return the values of a channel of the package."""
    pairs = (text.split("=", 1) for text in channel_settings(name))
    return {key: json.loads(value) for key, value in pairs}


CHANNELS: dict[str, Values] = {
    "rho = 2": {"v2v.rho": 2.0},
    "rho = 5": {},
    "rho = 20": {"v2v.rho": 20.0},
    "rho = 5, 30 % lost, 50 to 100 ms late": LOSSY,
    "CAM": preset("cam"),
    "CAM, 10 % lost": preset("cam_lossy"),
}
SENSORS: dict[str, Values] = {
    "perfect": {},
    "0.1 m/s": {"sensing.range_rate_std": 0.1},
    "0.1 m/s, 50 ms late": {"sensing.range_rate_std": 0.1, "sensing.delay": 0.05},
}
MARGIN = Scenario.from_values({}).follower(1).v2v.monitor_margin
QUIET = (
    *(("rho = 5", sensor, MARGIN) for sensor in SENSORS),
    *(("rho = 2", "0.1 m/s", MARGIN), ("rho = 20", "0.1 m/s", MARGIN)),
    ("rho = 5, 30 % lost, 50 to 100 ms late", "0.1 m/s, 50 ms late", MARGIN),
    *(("CAM", "perfect", MARGIN), ("CAM, 10 % lost", "0.1 m/s, 50 ms late", MARGIN)),
    *(("rho = 5", "0.1 m/s", margin) for margin in (5.0, 4.0, 3.0)),
)
"""Packets, sensors and v2v.monitor_margin of the runs in which nothing is false."""

TIMED = (("rho = 5", "perfect"), ("rho = 5", "0.1 m/s"), ("CAM, 10 % lost", "0.1 m/s, 50 ms late"))
ATTACKS = ("factor=3", "factor=1.5", "factor=-1", "replay=3", "frozen")
ATTACKED = 2
ATTACK = (15.0, 35.0)
"""When the packets to vehicle ATTACKED are false [s]."""

MOVES = 0.5
"""Acceleration of the vehicle ahead [m/s^2] above which it counts as moving."""


class Size(NamedTuple):
    """How much is measured.

    Attributes
    ----------
    seeds, followers : int
        Runs in which nothing is false, and followers of each.
    duration : float
        Of each [s].
    begins : int
        Runs of each kind of false data, which begin at other times of the cycle.
    """

    seeds: int = 15
    followers: int = 12
    duration: float = 120.0
    begins: int = 28


class Watched(NamedTuple):
    """A run, and what its monitors said."""

    run: Trajectory
    monitors: list[MonitorUse]


def drive(offset: float, duration: float) -> Values:
    """Return the leader's motion from a time of the cycle on."""
    repeats = math.ceil((offset + duration) / sum(lasts for lasts, _ in CYCLE)) + 1
    lasts, accelerations = np.array(CYCLE * repeats).T
    times = np.concatenate(([0.0], np.cumsum(lasts)))
    speeds = 25.0 + np.concatenate(([0.0], np.cumsum(lasts * accelerations))).round(9)
    first = float(np.interp(offset, times, speeds))
    later = times > offset
    return {
        "leader.profile": "csv",
        "leader.times": (0.0, *(times[later] - offset).tolist()),
        "leader.speeds": (first, *speeds[later].tolist()),
        "platoon.initial_speed": first,
        "run.duration": duration,
        "run.stop_on_collision": False,
        "v2v.monitor": "report",
    }


def watched(values: Values) -> Watched:
    """Return what the monitors of a run say; reporting changes nothing, so it is added after."""
    one = Scenario.from_values({}).with_values(values)
    run = simulate(one.with_values({"v2v.monitor": "none"}))
    motion = np.stack(run.motion)
    arrivals = tuple(
        arrivals_of(receiver, motion[:, :, sender])
        for receiver, sender in zip(one.receivers, one.topology.senders, strict=True)
    )
    return Watched(run, monitor_use(dataclasses.replace(run, scenario=one, arrivals=arrivals)))


def false_alarms(size: Size, channel: str, sensor: str, margin: float) -> dict[str, Any]:
    """Count the alarms of runs in which nothing is false."""
    values = {**CHANNELS[channel], **SENSORS[sensor], **drive(0.0, size.duration)}
    values |= {"platoon.followers": size.followers, "v2v.monitor_margin": margin}
    used = [
        one
        for seed in range(1, size.seeds + 1)
        for one in watched({**values, "run.seed": seed}).monitors
    ]
    return {
        "channel": channel,
        "sensor": sensor,
        "margin": margin,
        "hours": len(used) * size.duration / 3600.0,
        "alarms": sum(one.alarms for one in used),
    }


def detection(size: Size, channel: str, sensor: str, attack: str) -> dict[str, Any]:
    """Time how soon false data on one link are noticed, wherever in the cycle they begin."""
    begin, end = ATTACK
    false = (f"{begin:g} {end:g} {attack}",)
    values = {
        **{**CHANNELS[channel], **SENSORS[sensor], "platoon.followers": ATTACKED},
        f"vehicle_{ATTACKED}.v2v.false_data": false,
    }
    cycle = sum(lasts for lasts, _ in CYCLE)
    delays, moving = [], []
    for number in range(size.begins):
        motion = drive(number * cycle / size.begins, end + 5.0)
        run, monitors = watched({**motion, **values, "run.seed": number + 1})
        delays.append(monitors[-1].detections[0].delay)
        ahead = run.acceleration[round(begin / run.scenario.run.step), ATTACKED - 1]
        moving.append(abs(float(ahead)) > MOVES)
    found = np.where(np.isnan(delays), np.inf, delays)
    return {
        "channel": channel,
        "sensor": sensor,
        "attack": attack,
        "runs": size.begins,
        "noticed": int(np.isfinite(found).sum()),
        "median": _quantile(found, 0.5),
        "ninth": _quantile(found, 0.9),
        "moving": _quantile(found[moving], 0.5),
    }


def _quantile(values: npt.NDArray[np.float64], share: float) -> float | None:
    """Return the value that this share of them does not exceed, None where it is infinite."""
    if not len(values):
        return None
    found = np.sort(values)[math.ceil(share * len(values)) - 1]
    return round(float(found), 3) if np.isfinite(found) else None


def measure(size: Size, progress: ProgressLine | None = None) -> dict[str, Any]:
    """Return all that is measured."""
    timed = [(*where, attack) for where in TIMED for attack in ATTACKS]
    steps: Iterator[int] = iter(range(len(QUIET) + len(timed)))

    def said() -> None:
        if progress:
            progress("rows", next(steps), len(QUIET) + len(timed))

    found: dict[str, Any] = {"size": size._asdict(), "false_alarms": [], "detection": []}
    for row in QUIET:
        said()
        found["false_alarms"].append(false_alarms(size, *row))
    for case in timed:
        said()
        found["detection"].append(detection(size, *case))
    return found


def tables(found: Mapping[str, Any]) -> str:
    """Return both tables as Markdown."""
    lines = [
        "| packets | range rate measured | margin | vehicle hours | false alarms |",
        "|---|---|---|---|---|",
    ]
    lines += [
        f"| {one['channel']} | {one['sensor']} | {one['margin']:g} | {one['hours']:g} | "
        f"{one['alarms']} |"
        for one in found["false_alarms"]
    ]
    lines += [
        "",
        "| packets | range rate measured | false data | noticed | delay, median | 90 % | "
        "median where it moves |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {one['channel']} | {one['sensor']} | {one['attack']} | "
        f"{one['noticed']} of {one['runs']} | "
        + " | ".join(_seconds(one[key]) for key in ("median", "ninth", "moving"))
        + " |"
        for one in found["detection"]
    ]
    return "\n".join(lines)


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f} s"


def with_tables(page: str, found: Mapping[str, Any]) -> str:
    """Return a page with the tables between its markers."""
    head, _, rest = page.partition(BEGIN)
    return f"{head}{BEGIN}\n{tables(found)}\n{END}{rest.partition(END)[2]}"


def main(arguments: Sequence[str] | None = None, size: Size | None = None) -> int:
    """Measure and return an exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument(
        "-o", "--output", type=Path, default=HERE, metavar="DIR", help="where files go"
    )
    options = parser.parse_args(arguments)
    try:
        options.output.mkdir(parents=True, exist_ok=True)
        with ProgressLine() as progress:
            found = measure(size or Size(), progress)
        text = json.dumps(found, indent=1, allow_nan=False) + "\n"
        (options.output / DATA).write_text(text, encoding="utf-8")
        page = options.output / PAGE
        if page.is_file():
            page.write_text(with_tables(page.read_text(encoding="utf-8"), found), encoding="utf-8")
    except OSError as error:
        print(f"measure: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("measure: interrupted", file=sys.stderr)
        return 130
    print(tables(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())

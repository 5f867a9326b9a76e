"""Every channel under load, frozen processes and other start orders: always one digest.

    python test/campaign/channels.py [--seed 1] [--count 45] [--first 0]

Each try is a real platoon of three followers: a channel preset, or all parts of a channel together,
often with sensors, limits, a fallback, a monitor and a timeline, on any number of hosts, and one
disturbance. Nothing may come of it: exit code 0, the digest of the simulation, a bag that can be
read and whose data stand, every recorded value the one that is due to the last bit. Any 45 tries in
a row put every channel under every disturbance.
"""

from __future__ import annotations

import argparse
import contextlib
import random
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from frame import busy_loops  # type: ignore[import-not-found]

from cacc_platoon.analysis import DataState, analyse
from cacc_platoon.bags.digest import run_digest
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario.channel_presets import channel_names, channel_settings
from cacc_platoon.scenario.file import load_scenario
from cacc_platoon.simulation import simulate
from cacc_platoon.testing import Platoon
from msg_adapters.topics import Graph

PAPER_A = Path(__file__).parents[2] / "config" / "paper_a.yaml"
SHORT = ("run.duration=30", "platoon.followers=3", "leader.start=1")
PACED = "run.real_time_factor=8"
"""Slow enough for a process to be frozen in the middle of the run."""
LIMIT = 120.0
"""How long a run may take to end [s]."""
ALL = "all parts"
ALL_PARTS = (
    *("v2v.latency=0.013", "v2v.jitter=0.1", "v2v.loss=0.2"),
    *("v2v.burst_begin=0.1", "v2v.burst_end=0.3", "v2v.blackouts=[4, 5.5]"),
    *("v2v.bias=0.05", "v2v.noise_std=0.02", "v2v.quantum=0.1", "v2v.saturation=0.4"),
    'v2v.false_data=["6 9 factor=3", "12 15 replay=2.5", "20 24 frozen"]',
)
SEND_RULES = (
    ("v2v.period=0.05", "v2v.phase=random"),
    ("v2v.send_rule=cam", "v2v.phase=random"),
)
LEADERS = (("leader.profile=sine",), ("leader.profile=brake", "leader.deceleration=2"))
EXTRAS = {
    "sensors": ("sensing.range_std=0.05", "sensing.range_rate_std=0.02", "sensing.delay=0.03"),
    "limits": ("vehicle.limits=iso15622", "vehicle.stops=true", "vehicle.length=4.5"),
    "fallback": (
        *("v2v.reception=fallback", "v2v.fallback_after=0.4"),
        "vehicle_2.v2v.blackouts=[3, 7]",
    ),
    "monitor": ("v2v.reception=fallback", "v2v.monitor=fallback"),
}
CHANGES = {
    "link": ("v2v.loss=0.3", "v2v.loss=1", "v2v.loss=0", "v2v.latency=0.04", "v2v.bias=0.1"),
    "vehicle": ("controller.time_headway=1.2", "controller.time_headway=1.5"),
}


@contextlib.contextmanager
def nothing(_run: Platoon, _samples: int, _draw: random.Random) -> Iterator[None]:
    """Let the run alone."""
    yield


def busy_cores(_run: Platoon, _samples: int, draw: random.Random) -> AbstractContextManager[None]:
    """Keep every core busy with something else."""
    return busy_loops(draw.randint(3, 6), LIMIT)


@contextlib.contextmanager
def frozen_node(run: Platoon, samples: int, draw: random.Random) -> Iterator[None]:
    """Freeze the process of a node for a while, in the middle of the run."""
    _freeze(run, draw.choice(run.scenario.node_names), samples, draw)
    yield


@contextlib.contextmanager
def frozen_supervisor(run: Platoon, samples: int, draw: random.Random) -> Iterator[None]:
    """Freeze the supervisor for a while, in the middle of the run."""
    _freeze(run, "supervisor", samples, draw)
    yield


def _freeze(run: Platoon, node: str, samples: int, draw: random.Random) -> None:
    run.wait_sample(int(draw.uniform(0.05, 0.6) * samples), LIMIT)
    run.freeze(node, draw.uniform(1.0, 2.0))


@contextlib.contextmanager
def start_order(run: Platoon, _samples: int, draw: random.Random) -> Iterator[None]:
    """Start the manually started nodes one after the other, or all at once."""
    one_by_one = draw.random() < 0.5
    for node in run.scenario.run.manual_nodes:
        run.start(node)
        if one_by_one:
            run.wait_node(node, LIMIT)
    yield


DISTURBANCES: dict[str, Callable[[Platoon, int, random.Random], AbstractContextManager[None]]] = {
    "frozen node": frozen_node,
    "start order": start_order,
    "busy loops": busy_cores,
    "frozen supervisor": frozen_supervisor,
    "none": nothing,
}
CHANNELS = (ALL, *channel_names())


@dataclass(frozen=True)
class Try:
    """One platoon and what disturbs it.

    Attributes
    ----------
    number : int
        Which of the campaign.
    channel, disturbance : str
        One of CHANNELS and a key of DISTURBANCES.
    settings : tuple of str
        What makes the scenario of case A.
    what : str
        The rest of it, in words.
    seed : str
        Of what the disturbance draws.
    """

    number: int
    channel: str
    disturbance: str
    settings: tuple[str, ...]
    what: str
    seed: str

    def __str__(self) -> str:
        """Return the try as a line."""
        return f"{self.number:4d} {self.channel:13} {self.disturbance:17} {self.what}"


def tries(seed: int, first: int, count: int) -> Iterator[Try]:
    """Yield the tries of a campaign; each depends on the seed and its number alone."""
    for number in range(first, first + count):
        draw = random.Random(f"{seed}.{number}")
        channel = CHANNELS[number % len(CHANNELS)]
        disturbance = list(DISTURBANCES)[number % len(DISTURBANCES)]
        own = (
            (*ALL_PARTS, *draw.choice(SEND_RULES)) if channel == ALL else channel_settings(channel)
        )
        extras = [name for name in EXTRAS if draw.random() < 0.5]
        changes = _timeline(draw) if draw.random() < 0.5 else []
        hosts = draw.choice(["1", "2", "3", "per_node"])
        settings = [*SHORT, f"run.seed={draw.randrange(1000)}", *draw.choice(LEADERS), *own]
        for name in extras:
            settings += EXTRAS[name]
        settings += [f"run.timeline=[{', '.join(changes)}]", f"run.hosts={hosts}"]
        if disturbance.startswith("frozen"):
            settings.append(PACED)
        if disturbance == "start order":
            nodes = load_scenario(PAPER_A, settings).node_names
            manual = draw.sample(nodes, draw.randint(2, len(nodes)))
            settings.append(f"run.manual_nodes=[{', '.join(manual)}]")
        what = ", ".join([f"hosts={hosts}", *extras, *changes])
        yield Try(number, channel, disturbance, tuple(settings), what, f"{seed}.{number}.run")


def _timeline(draw: random.Random) -> list[str]:
    """Return one to four changes."""
    changes = []
    for _ in range(draw.randint(1, 4)):
        kind = draw.choice(list(CHANGES))
        change = draw.choice(CHANGES[kind])
        changes.append(f"{draw.uniform(1.0, 25.0):.2f} {kind}_{draw.randint(1, 3)} {change}")
    return changes


def wrong(one: Try) -> Iterator[str]:
    """Let a platoon run and say what does not hold; nothing when all is well."""
    expected = simulate(load_scenario(PAPER_A, one.settings))
    scenario = expected.scenario
    with tempfile.TemporaryDirectory(prefix="campaign_") as folder:
        run = Platoon(PAPER_A, settings=one.settings, folder=Path(folder))
        draw = random.Random(one.seed)
        disturbance = DISTURBANCES[one.disturbance]
        with run:
            try:
                with disturbance(run, len(expected.time), draw):
                    result = run.result(LIMIT)
            except (TimeoutError, LookupError, ProcessLookupError) as error:
                yield f"{type(error).__name__}: {error}"
                return
        if result.exit_code != 0 or "Traceback" in result.errors:
            yield f"exit code {result.exit_code}: {result.message}, {result.errors[-600:]}"
        digest = run_digest(recording_of(expected), Graph.of(scenario))
        if result.digest != digest:
            yield f"digest {result.digest[:12]} instead of {digest[:12]}"
        yield from _data(run.folder.path)


def _data(folder: Path) -> Iterator[str]:
    """Say what is wrong with the data, as a report sees them."""
    try:
        report = analyse(folder)
    except Exception as error:  # whatever it is, the other tries go on
        yield f"it cannot be reported on: {error!r}"
        return
    if report.standing.state is not DataState.INTACT or report.run.findings:
        yield f"the data are {report.standing.line}: {report.run.findings}"
    for name, check in report.recomputed._asdict().items():
        if check.largest != 0.0 or check.unknown:
            yield f"{name} depart by {check.largest:g} {check.unknown}"


def table(held: Counter[tuple[str, str]], tried: Counter[tuple[str, str]]) -> str:
    """Return how many tries of each channel held under each disturbance, of how many."""
    lines = [f"{'held/tried':13}" + "".join(f"{name:>19}" for name in DISTURBANCES)]
    for channel in CHANNELS:
        pairs = [(channel, name) for name in DISTURBANCES]
        cells = (f"{held[pair]}/{tried[pair]}" if tried[pair] else "-" for pair in pairs)
        lines.append(f"{channel:13}" + "".join(f"{cell:>19}" for cell in cells))
    return "\n".join(lines)


def main() -> int:
    """Run a campaign; exit with 1 when something did not hold."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=len(CHANNELS) * len(DISTURBANCES))
    parser.add_argument("--first", type=int, default=0, help="number of the first try")
    options = parser.parse_args()
    held: Counter[tuple[str, str]] = Counter()
    tried: Counter[tuple[str, str]] = Counter()
    for one in tries(options.seed, options.first, options.count):
        found = list(wrong(one))
        tried[one.channel, one.disturbance] += 1
        held[one.channel, one.disturbance] += not found
        print(one, "" if found else "ok", flush=True)
        for line in found:
            print("     ", line, flush=True)
    print(table(held, tried))
    bad = tried.total() - held.total()
    print(f"{options.count} tries, {bad} with something wrong")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())

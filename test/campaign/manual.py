"""The paper's platoon with every node started manually, again and again: always one digest.

    python test/campaign/manual.py [--tries 10] [--busy 2] [--seed 1]

The 26 processes of the README, supervisor, leader and 12 followers with their relays, are started
one after the other in an order of their own, beside as many busy loops as are asked for. Each
try has to end with exit code 0 and the digest of the simulation.
"""

from __future__ import annotations

import argparse
import random
import sys
import time
from pathlib import Path

from frame import busy_loops  # type: ignore[import-not-found]

from cacc_platoon.bags.digest import run_digest
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario.file import load_scenario
from cacc_platoon.simulation import simulate
from cacc_platoon.testing import Platoon
from msg_adapters.topics import Graph

PAPER_A = Path(__file__).parents[2] / "config" / "paper_a.yaml"
SETTINGS = ("run.spawn=false", "run.duration=20", "run.start_timeout=120")
LIMIT = 300.0
"""How long a try may take [s]."""


def one_try(draw: random.Random, digest: str) -> str:
    """Start everything in an order of its own; return what did not hold, if anything."""
    with Platoon(PAPER_A, settings=SETTINGS) as run:
        nodes = list(run.scenario.node_names)
        draw.shuffle(nodes)
        for node in nodes:
            run.start(node)
        try:
            result = run.result(LIMIT)
        except TimeoutError as error:
            return f"it did not end: {error}"
    if (result.exit_code, result.digest) != (0, digest):
        return f"exit code {result.exit_code}, {result.digest}: {result.message}{result.errors}"
    return ""


def main() -> int:
    """Try; exit with 1 when something did not hold."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--tries", type=int, default=10)
    parser.add_argument("--busy", type=int, default=0, help="busy loops beside each try")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    scenario = load_scenario(PAPER_A, SETTINGS)
    digest = run_digest(recording_of(simulate(scenario)), Graph.of(scenario))
    failed = 0
    for number in range(options.tries):
        begun = time.monotonic()
        with busy_loops(options.busy, LIMIT):
            trouble = one_try(random.Random(f"{options.seed}.{number}"), digest)
        failed += bool(trouble)
        print(f"try {number}: {time.monotonic() - begun:.0f} s {trouble or 'ok'}", flush=True)
    print(f"{options.tries - failed} of {options.tries} with {options.busy} busy loops")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

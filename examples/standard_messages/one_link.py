"""Ten seconds without V2V on one link: python examples/standard_messages/one_link.py.

Prints a table of the smallest gaps with each reception, and puts it into the README.md of its
folder. Every other packet is lost in bursts (the channel gilbert_tamu), those that arrive take
0.1 to 0.15 s, and the link from vehicle 2 to 3 is silent while the leader moves.
"""

from __future__ import annotations

import sys
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from compute import BRAKE, CARS, SINE, settings_of
from show import between, markdown

from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import simulate

PAGE = Path(__file__).with_name("README.md")
BEGIN, END = "<!-- one_link.py -->", "<!-- end of one_link.py -->"
MOTIONS = {"sine": SINE, "brake": BRAKE}
RECEPTIONS = "hold", "zero", "fallback"
SEEDS = range(1, 4)
LATE = {"v2v.latency": 0.1, "v2v.jitter": 0.05}
SILENT, DARK = 3, (10.0, 20.0)


class Row(NamedTuple):
    """Of all seeds: the smallest gap [m], whose it is, and the largest spacing error [m]."""

    motion: str
    reception: str
    gap: float
    vehicle: int
    error: float


def scenario(motion: str, reception: str, seed: int) -> Scenario:
    """Return what is simulated: case A of the paper, of six cars."""
    channel: dict[str, Any] = settings_of("gilbert_tamu") | LATE | {"v2v.reception": reception}
    size = {"platoon.followers": 6, "run.duration": 45.0, "run.seed": seed}
    own = {SILENT: {"v2v.blackouts": DARK}}
    return Scenario.from_values({**CARS, **channel, **size, **MOTIONS[motion]}, own)


def row(motion: str, reception: str) -> Row:
    """Simulate one motion with one reception."""
    runs = [simulate(scenario(motion, reception, seed)) for seed in SEEDS]
    gaps = np.min([run.gap.min(axis=0) for run in runs], axis=0)
    error = max(float(np.max(np.abs(run.spacing_error))) for run in runs)
    return Row(motion, reception, float(np.min(gaps)), int(np.argmin(gaps)) + 1, error)


def rows() -> list[Row]:
    """Return the whole table."""
    return [row(motion, reception) for motion, reception in product(MOTIONS, RECEPTIONS)]


def table(found: list[Row]) -> str:
    """Return it as Markdown."""
    heads = "leader", "reception", "smallest gap", "in front of vehicle", "largest spacing error"
    lines = [
        (
            *(one.motion, one.reception),
            f"**{one.gap:.2f} m**" if one.gap <= 0.0 else f"{one.gap:.2f} m",
            *(str(one.vehicle), f"{one.error:.2f} m"),
        )
        for one in found
    ]
    return markdown(heads, lines)


def main() -> int:
    """Print the table and put it into the page."""
    made = table(rows())
    PAGE.write_text(between(PAGE.read_text("utf-8"), BEGIN, END, made), encoding="utf-8")
    print(made)
    return 0


if __name__ == "__main__":
    sys.exit(main())

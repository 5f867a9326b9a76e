"""Speed of the design theory against its goals: `python test/benchmark/bench_design.py`.

Prints the best of several repeats, as a loaded machine only ever makes things slower, and exits
with 1 when a goal is missed.
"""

import sys
import timeit

import numpy as np

from cacc_platoon.design import Requirements, recommend
from cacc_platoon.model import Gains
from cacc_platoon.theory import (
    certify,
    critical_period,
    is_robustly_string_stable,
    l2_gain,
    latency_margin,
    linf_gain,
    robust_string_stability_map,
)

A = Gains(0.95, 0.5, 0.63, 0.009)
K_P, K_V = np.linspace(0, 1, 500)[:, np.newaxis], np.linspace(0, 1, 500)


def gain_map():
    return robust_string_stability_map(0.5, 0.95, K_V, K_P, rho=5, tau_max=0.5)


DENSE = Requirements(period=0.002, v2v_period=0.2)
RARE = Requirements(v2v_period=0.9, max_headway=2.0)
GAP = Requirements(min_gap=3.0)

TASKS = (
    ("exact robust test", lambda: is_robustly_string_stable(A, 5, 0.5), 2000, 0.1e-3),
    ("full certificate", lambda: certify(A, 5, 0.5).parts(), 3, 0.2),
    ("500 x 500 map of the exact robust test", gain_map, 1, 0.1),
    ("Pareto set of recommended designs", lambda: recommend(5.0, 0.5), 1, 3.0),
    ("  packets every 0.2 s, control every 2 ms", lambda: recommend(5.0, 0.5, DENSE), 1, 3.0),
    ("  packets every 0.9 s", lambda: recommend(5.0, 0.5, RARE), 1, 3.0),
    ("  least gap in a braking", lambda: recommend(5.0, 0.5, GAP), 1, 3.0),
    ("  L2 gain", lambda: l2_gain(A, 0.5, 0.5), 200, None),
    ("  L-infinity gain", lambda: linf_gain(A, 0.5, 0.5), 5, None),
    ("  latency margin", lambda: latency_margin(A, 5, 0.5), 5, None),
    ("  critical period", lambda: critical_period(A, 5, 0.5), 5, None),
)


def main() -> int:
    """Measure every task and compare it with its goal."""
    missed = 0
    for name, task, number, goal in TASKS:
        best = min(timeit.repeat(task, number=number, repeat=5)) / number
        verdict = "" if goal is None else f"goal {goal * 1e3:8.2f} ms"
        if goal is not None and best > goal:
            missed += 1
            verdict += "  MISSED"
        print(f"{name:40s} {best * 1e3:10.4f} ms  {verdict}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())

"""Random design questions: test/campaign/designs.py --seed 1 --count 200.

Every recommended design has to meet all that was asked, jointly: by brute force on the unit circle
over lags, ends of I, ages and receptions, and in the time domain along 40 vehicles.
"""

from __future__ import annotations

import argparse
import math
import random
import time
from collections.abc import Iterator

import numpy as np

from cacc_platoon.design import Requirements, recommend
from cacc_platoon.model import Gains
from cacc_platoon.simulation.brute_force import largest_growth, lifted_growth, norm_ratios
from cacc_platoon.theory import DesignError

LAGS = np.array([1e-3, 0.05, 0.2, 0.4, 0.6, 0.8, 1.0])
ROUNDING = 1e-7
VEHICLES, SAMPLES = 40, 1500

Question = tuple[float, float, Requirements]


def question(seed: int, number: int) -> Question:
    """Return signal-to-noise ratio, largest lag and requirements number `number` of a seed."""
    rng = random.Random(f"{seed}/{number}")
    tau_max = rng.choice((0.1, 0.3, 0.5, 0.8))
    period = rng.choice((0.005, 0.01, 0.02, 0.05))
    ask = Requirements(
        period=period,
        latency=rng.choice((0.0, 0.0, rng.uniform(0.0, 0.2 * tau_max))),
        reception=rng.choice((1.0, 1.0, rng.uniform(0.3, 1.0))),
        hold=rng.random() < 0.5,
        max_headway=rng.choice((None, None, rng.uniform(1.5, 3.0) * tau_max)),
        max_time_constant=rng.choice((None, None, None, rng.uniform(4.0, 40.0) * tau_max)),
        v2v_period=rng.choice((None, None, period * rng.randint(2, 20))),
    )
    return rng.choice((1.5, 3.0, 5.0, 20.0, 200.0)), tau_max, ask


def missed(gains: Gains, rho: float, tau_max: float, ask: Requirements) -> Iterator[str]:
    """Say what a design does not keep; nothing when all is well."""
    oldest = math.floor(ask.latency / ask.period + 1e-9) + 1
    receptions = {1.0, ask.reception}
    for age in sorted({0, 1, oldest // 2, oldest}):
        for share in receptions if not ask.hold else {ask.reception}:
            known = {"held": share} if ask.hold else {"reception": share}
            growth, omega = largest_growth(gains, rho, LAGS * tau_max, ask.period, age=age, **known)
            if growth > 1.0 + ROUNDING:
                where = f"{omega:.4g} rad/s, {age} periods old, {known}"
                yield f"grows by {growth - 1.0:.3g} at {where}"
    yield from _grows_with_packets(gains, rho, tau_max, ask)
    commands = np.random.default_rng(1).standard_normal(SAMPLES)
    ends = (ask.counted_as_zero * (1.0 - 1.0 / rho), 1.0 + 1.0 / rho)
    for end in ends:
        for share in (0.2, 1.0):
            ratios = norm_ratios(
                gains,
                share * tau_max,
                end * gains.k_a,
                ask.period,
                commands,
                vehicles=VEHICLES,
                age=oldest,
                held=ask.held,
            )
            if np.max(ratios) > 1.0 + ROUNDING:
                yield f"|a_i|_2 grows by {np.max(ratios) - 1.0:.3g} in time, tau {share} tau_max"
    for name, value, limit in (
        ("headway", gains.time_headway, ask.max_headway),
        ("slowest mode", _slowest(gains, tau_max), ask.max_time_constant),
    ):
        if limit is not None and value > limit * (1.0 + 1e-9):
            yield f"{name} {value} is above {limit}"


def _grows_with_packets(
    gains: Gains, rho: float, tau_max: float, ask: Requirements
) -> Iterator[str]:
    if ask.v2v_period is None:
        return
    interval = round(ask.v2v_period / ask.period)
    age = math.ceil(ask.latency / ask.period - 1e-9)
    low, high = ask.counted_as_zero * (1.0 - 1.0 / rho), 1.0 + 1.0 / rho
    for end in (low, 0.5 * (low + high), high):
        for tau in (LAGS * tau_max).tolist():
            growth = lifted_growth(
                gains, tau, end * gains.k_a, ask.period, interval, age=age, held=ask.held
            )
            if growth > 1.0 + ROUNDING:
                yield f"grows by {growth - 1.0:.3g} with a packet every {interval} periods"


def _slowest(gains: Gains, tau: float) -> float:
    h, _, k_v, k_p = gains
    return float(-1.0 / np.max(np.roots([tau, 1.0, k_v + h * k_p, k_p]).real))


def main() -> int:
    """Ask; exit with 1 when a recommended design does not keep what it promises."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="number of the first question")
    options = parser.parse_args()
    bad = refused = designs = 0
    slowest = 0.0
    for number in range(options.first, options.first + options.count):
        rho, tau_max, ask = question(options.seed, number)
        began = time.process_time()
        try:
            found = recommend(rho, tau_max, ask)
        except DesignError as error:
            refused += 1
            print(f"{number}: {error}", flush=True)
            continue
        finally:
            slowest = max(slowest, time.process_time() - began)
        unique = {design.gains for design in found.designs if design.name != "paper"}
        designs += len(unique)
        for gains in unique:
            for line in missed(gains, rho, tau_max, ask):
                bad += 1
                print(f"BROKEN {number}: rho {rho}, tau_max {tau_max}, {ask}, {gains}: {line}")
    print(
        f"{options.count} questions, {refused} out of reach, {designs} designs, {bad} broken; "
        f"slowest answer {slowest:.2f} s of processor time"
    )
    return 1 if bad else 0


if __name__ == "__main__":
    raise SystemExit(main())

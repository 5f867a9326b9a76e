"""What the study is about, in numbers: designs, channels, theory and runs; nothing is drawn."""

from __future__ import annotations

import json
import math
import os
import signal
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import cache, partial
from multiprocessing import active_children
from typing import Any, NamedTuple

import numpy as np

from cacc_platoon.analysis import compute_metrics
from cacc_platoon.design import Requirements, recommend
from cacc_platoon.model import Gains
from cacc_platoon.model.send_rule import CamRule
from cacc_platoon.reproduction.cases import CASES, FOLLOWERS, RHO, TAU_0
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.channel_presets import channel_settings
from cacc_platoon.simulation import Trajectory, simulate, simulate_mean
from cacc_platoon.theory import worst_l2_gain
from cacc_platoon.theory.multirate import worst_multirate_growth

STEP, SPEED = 0.01, 25.0
CARS = {"run.stop_on_collision": False, "vehicle.length": 4.5, "platoon.standstill_distance": 7.0}
BEGIN, DARK = 10.0, 20.0
SINE = {"leader.profile": "sine", "leader.start": BEGIN}
BRAKE = {"leader.profile": "brake", "leader.start": BEGIN, "leader.deceleration": 6.0}
LONGER = 1.2
"""Longest headway of the design that may have another than case A [s]."""

SHOWN, EVERY = (10.0, 34.0), 0.2
PERIODS = (0.01, *(round(0.05 * n, 2) for n in range(1, 13)))
DIGITS = 6

Values = dict[str, Any]
Progress = Callable[[str, int, int], None]


class Size(NamedTuple):
    """How much is simulated: followers, and how long each motion of the leader lasts [s]."""

    followers: int = FOLLOWERS
    sine: float = 120.0
    brake: float = 60.0
    periods: tuple[float, ...] = PERIODS


class Packets(NamedTuple):
    """What a theorem takes of a channel: V2V period [s], latency [s], share that arrives."""

    period: float
    latency: float = 0.0
    held: float = 1.0


_KEPT = ("hold", "zero")


class Channel(NamedTuple):
    """What becomes of packets: its name, its parameters, and the packets that a theorem judges."""

    name: str
    settings: Values
    packets: Packets | None


class Design(NamedTuple):
    """One of the designs that are compared, and where it is from."""

    name: str
    gains: Gains
    origin: str


def settings_of(name: str) -> Values:
    """Return a channel by name as parameters of a scenario."""
    pairs = (setting.partition("=") for setting in channel_settings(name))
    return {key: json.loads(text) for key, _, text in pairs}


def cam_period(cam: Values) -> float:
    """Return the time from message to message at a constant speed [s]."""
    rule = CamRule(STEP, round(cam["v2v.cam_check"] / STEP))
    sent = [k for k in range(round(2.0 / STEP)) if rule.sends(k, SPEED * STEP * k, SPEED)]
    return round((sent[-1] - sent[-2]) * STEP, DIGITS)


def channels() -> list[Channel]:
    """Return the channels, the last of them without V2V while the leader brakes."""
    ideal, cam, lossy = (settings_of(name) for name in ("ideal", "cam", "cam_lossy"))
    period = cam_period(cam)
    latest = lossy["v2v.latency"] + lossy["v2v.jitter"]
    late = Packets(period, round(latest, DIGITS), 1.0 - lossy["v2v.loss"])
    dark = lossy | {"v2v.blackouts": [BEGIN, BEGIN + DARK]}
    usual = Scenario.from_values({}).follower(1).v2v.fallback_after
    waits = {lossy["v2v.fallback_after"], usual}
    return [
        Channel("ideal", ideal, Packets(STEP)),
        Channel("CAM", cam, Packets(period)),
        Channel(f"CAM, {100.0 * lossy['v2v.loss']:g} % lost", lossy, late),
        *(Channel(f"blackout, {kind}", dark | {"v2v.reception": kind}, None) for kind in _KEPT),
        *(
            Channel(f"blackout, fallback after {wait:g} s", dark | _fallback(wait), None)
            for wait in sorted(waits, reverse=True)
        ),
    ]


def _fallback(wait: float) -> Values:
    return {"v2v.reception": "fallback", "v2v.fallback_after": wait}


def paper_designs() -> list[Design]:
    """Return cases A and C."""
    return [
        Design(f"case {c.name}", Gains(c.time_headway, c.k_a, c.k_v, c.k_p), "the paper")
        for c in CASES
        if c.name in "AC"
    ]


@cache
def our_design(same_headway: bool) -> Design:
    """Return the recommended design that bears the lossy channel and leans least on V2V.

    What a blackout takes away is what the received acceleration brings, and k_a is its gain.
    """
    late = channels()[2].packets
    assert late is not None
    headway = CASES[0].time_headway
    ask = Requirements(
        period=STEP,
        v2v_period=late.period,
        latency=late.latency,
        reception=late.held,
        hold=True,
        time_headway=headway if same_headway else None,
        max_headway=None if same_headway else LONGER,
    )
    named = {one.name: one.gains for one in recommend(RHO, TAU_0, ask).designs[1:]}
    pick = min(named, key=lambda name: named[name].k_a)
    limit = f"--time-headway {headway:g}" if same_headway else f"--max-headway {LONGER:g}"
    command = (
        f"platoon design --rho {RHO:g} --tau-max {TAU_0:g} --v2v-period {late.period:g} "
        f"--latency {late.latency:g} --reception {late.held:g} --lost hold {limit} --pick {pick}"
    )
    gains = Gains(*(round(value, DIGITS) for value in named[pick]))
    return Design(_name(same_headway=same_headway), gains, f"`{command}`")


def _name(*, same_headway: bool) -> str:
    return f"ours, headway of {CASES[0].name}" if same_headway else "ours, longer headway"


def scenario(design: Design, channel: Channel, motion: Mapping[str, Any], size: Size) -> Scenario:
    """Return what is simulated, and can be run on nodes."""
    duration = size.sine if motion is SINE else size.brake
    values = {
        "platoon.followers": size.followers,
        "platoon.initial_speed": SPEED,
        "vehicle.tau": TAU_0,
        "vehicle.tau_max": TAU_0,
        **{f"controller.{key}": value for key, value in design.gains._asdict().items()},
        "v2v.rho": RHO,
        "run.step": STEP,
        "run.duration": duration,
    }
    return Scenario.from_values({**values, **CARS, **channel.settings, **motion}, source="blackout")


def theory(gains: Gains, packets: Packets, *, noisy: bool) -> float:
    """Return the proven growth per hop, 1 where nothing grows.

    Parameters
    ----------
    gains : Gains
        The design.
    packets : Packets
        Fresh ones are judged by the exact test in continuous time, others by the lifted hop.
    noisy : bool
        Whether any E[w] of the paper's noise is allowed, else w = 1.
    """
    known = None if noisy else gains.k_a
    if packets == Packets(STEP):
        return worst_l2_gain(gains, RHO, TAU_0, k_effective=known).gain
    interval = round(packets.period / STEP)
    return worst_multirate_growth(
        *(gains, RHO, TAU_0, STEP, interval),
        latency=packets.latency,
        held=packets.held,
        k_effective=known,
    ).growth


def row(design: Design, channel: Channel, size: Size) -> Values:
    """Return what is found of one design on one channel."""
    found: Values = {"channel": channel.name, "theory": None, "theory_noisy": None, "sine": None}
    if channel.packets:
        found["theory"] = _rounded(theory(design.gains, channel.packets, noisy=False))
        found["theory_noisy"] = _rounded(theory(design.gains, channel.packets, noisy=True))
        found["sine"] = growth(simulate_mean(scenario(design, channel, SINE, size)))
    brake = scenario(design, channel, BRAKE, size)
    run, mean = simulate(brake), simulate_mean(brake)
    return found | {
        "brake": growth(mean),
        "gap": _rounded(np.min(compute_metrics(run).min_gap)),
        "gap_mean": _rounded(np.min(compute_metrics(mean).min_gap)),
        "hardest": _rounded(-np.min(run.acceleration[:, 1:])),
        "backwards": _rounded(-np.min(run.velocity)),
        "nearest": nearest(run),
    }


def growth(run: Trajectory) -> Values:
    """Return |delta|_2 of the last over that of the first follower, and the largest hop."""
    norms = compute_metrics(run).l2_spacing_error
    return {
        "platoon": _rounded(norms[-1] / norms[0]),
        "hop": _rounded(np.max(norms[1:] / norms[:-1])),
    }


def nearest(run: Trajectory) -> list[float]:
    """Return the smallest of all gaps over the time that the figure shows [m]."""
    times = np.round(np.arange(*SHOWN, EVERY) / STEP).astype(np.int64)
    return [round(float(gap), 3) for gap in run.gap[times[times < len(run.time)]].min(axis=1)]


def growth_curves(design: Design, size: Size) -> Values:
    """Return the growth per hop over the time from packet to packet, of the lossy channel."""
    late = channels()[2].packets
    assert late is not None
    judged = [late._replace(period=period) for period in size.periods]
    return {
        "theory": [_rounded(theory(design.gains, one, noisy=False)) for one in judged],
        "theory_noisy": [_rounded(theory(design.gains, one, noisy=True)) for one in judged],
    }


def _rounded(value: float) -> float | None:
    """Return a number without the digits in which machines differ; none where it is infinite."""
    return round(float(value), DIGITS) if math.isfinite(value) else None


def compute(size: Size, progress: Progress, workers: int) -> Values:
    """Return the whole study."""
    with _workers(workers or cores()) as spread:
        ours = list(_followed(spread(our_design, (True, False)), "designs", 2, progress))
        designs = [*paper_designs(), *ours]
        ways = channels()
        jobs = [partial(row, one, way, size) for one in designs for way in ways]
        jobs += [partial(growth_curves, one, size) for one in designs]
        found = list(_followed(spread(_call, jobs), "runs", len(jobs), progress))
    rows, curves = found[: -len(designs)], found[-len(designs) :]
    late = ways[2].packets
    assert late is not None
    return {
        "rho": RHO,
        "tau_max": TAU_0,
        **size._asdict(),
        "standstill_gap": CARS["platoon.standstill_distance"] - CARS["vehicle.length"],
        "packets": late._asdict(),
        "shown": [*SHOWN, EVERY],
        "designs": [
            {
                "name": one.name,
                "origin": one.origin,
                "gains": {key: _rounded(value) for key, value in one.gains._asdict().items()},
                "rows": rows[i * len(ways) : (i + 1) * len(ways)],
                "growth": curves[i],
            }
            for i, one in enumerate(designs)
        ],
    }


def runnable(study: Values) -> Scenario:
    """Return the blackout that our design of the paper's headway bears with fallback."""
    [ours] = [one for one in study["designs"] if one["name"] == _name(same_headway=True)]
    way = next(one for one in channels() if "fallback" in one.name)
    size = Size(study["followers"], study["sine"], study["brake"])
    return scenario(Design(ours["name"], Gains(**ours["gains"]), ""), way, BRAKE, size)


def _call(job: Callable[[], Values]) -> Values:
    return job()


@contextmanager
def _workers(count: int) -> Iterator[Callable[..., Iterable[Any]]]:
    """Give a map that uses other processes; what ends it ends them."""
    if count < 2:
        yield map
        return
    pool = ProcessPoolExecutor(count, initializer=_leave_signals)
    try:
        yield pool.map
    except BaseException:
        for worker in active_children():
            worker.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _leave_signals() -> None:
    """Leave Ctrl-C to the process that gives out work."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def _followed(found: Iterable[Any], what: str, total: int, progress: Progress) -> Iterator[Any]:
    progress(what, 0, total)
    for done, one in enumerate(found, 1):
        progress(what, done, total)
        yield one


def cores() -> int:
    """Return how many processes can work at once."""
    return len(os.sched_getaffinity(0))

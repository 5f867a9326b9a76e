"""What a scenario must be before anything starts: types, ranges, values that fit together."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

from cacc_platoon.errors import UserError
from cacc_platoon.model import (
    LeaderProfile,
    PiecewiseConstantAcceleration,
    SinePulse,
    read_speed_profile,
)
from cacc_platoon.model.noise import MAX_BITS
from cacc_platoon.scenario.false_data import RULE, forgery
from cacc_platoon.scenario.follower import WHOLE, Follower
from cacc_platoon.scenario.names import vehicle_name
from cacc_platoon.scenario.parameter import ScenarioError, refuse_unknown
from cacc_platoon.scenario.plugin import check_plugin
from cacc_platoon.scenario.table import FORMER_NAMES, SNR_DB, TABLE, Leader, Platoon, Run, Vehicle
from cacc_platoon.scenario.timeline import read_change
from cacc_platoon.scenario.v2v_parameters import V2V

MAX_SAMPLES = 10**8
"""More would neither fit into memory nor end."""

MAX_NAMESPACE = 150
SHORTEST_PERIOD = 1e-3
"""Of samples by clocks [s]: no process keeps a shorter one."""
MOST_CHANGES = 1000
MAX_INDEX = 500
"""Of the last vehicle; readers of bags take a higher one for damage."""


def checked_values(
    values: Mapping[str, Any], source: str, per_vehicle: bool = False
) -> dict[str, Any]:
    """Return checked values; v2v.snr_db becomes v2v.rho."""
    refuse_unknown(values, [*TABLE, SNR_DB.name, *FORMER_NAMES], source)
    checked: dict[str, Any] = {}
    for given, value in values.items():
        name = FORMER_NAMES.get(given, given)
        if name != given and name in values:
            raise ScenarioError(
                f"{source}: {given} is the former name of {name}, which is given too: one of the "
                f"two would be ignored. Give {name} alone."
            )
        row = TABLE.get(name, SNR_DB)
        if per_vehicle and row is not SNR_DB and not row.per_vehicle:
            raise row.refusal(value, source, "is common to the platoon; set it under /**")
        checked[name] = row.check(value, source)
        if per_vehicle and name == "vehicle.tau" and isinstance(checked[name], tuple):
            raise row.refusal(value, source, "must be one number in a vehicle's own section")
    if SNR_DB.name in checked:
        if "v2v.rho" in checked:
            rho, snr_db = checked["v2v.rho"], checked[SNR_DB.name]
            raise ScenarioError(
                f"{source}: v2v.rho = {rho:g} and v2v.snr_db = {snr_db:g} dB are two values for "
                "one signal-to-noise ratio. Give one of them."
            )
        rho = 10.0 ** (checked.pop(SNR_DB.name) / 20.0)
        checked["v2v.rho"] = TABLE["v2v.rho"].check(rho, source)
    return checked


def with_leader_file(leader: Leader, source: str, folder: Path) -> Leader:
    """Read a table of speeds once, so that the resolved scenario stands alone; locate a bag."""
    if leader.profile not in ("csv", "bag") or leader.times:
        return leader
    if not leader.file:
        raise TABLE["leader.file"].refusal(
            "", source, f"must name a file when profile is {leader.profile}"
        )
    if leader.profile == "bag":
        return dataclasses.replace(leader, file=str((folder / leader.file).absolute()))
    try:
        times, speeds = read_speed_profile(folder / leader.file)
    except UserError as error:
        raise ScenarioError(f"{source}: leader.file = {leader.file!r}: {error}") from error
    return dataclasses.replace(leader, times=times, speeds=speeds)


def check_namespace(namespace: str, source: str) -> None:
    """Refuse a platoon.namespace that ROS would refuse; the error line begins with `source`."""
    if len(namespace) > MAX_NAMESPACE or not re.fullmatch(r"(/[A-Za-z_][A-Za-z0-9_]*)+", namespace):
        rule = f"must be a ROS name such as /platoon, up to {MAX_NAMESPACE} characters"
        raise TABLE["platoon.namespace"].refusal(namespace, source, rule)


def check_run(run: Run, node_names: list[str], source: str) -> None:
    """Refuse how a run is carried out where its values contradict each other."""

    def refuse(name: str, value: object, rule: str) -> ScenarioError:
        return TABLE[name].refusal(value, source, rule)

    if isinstance(run.hosts, str) and run.hosts not in ("auto", "per_node"):
        raise refuse("run.hosts", run.hosts, "must be auto, per_node or a whole number")
    for node in run.manual_nodes:
        if node not in node_names:
            raise refuse("run.manual_nodes", node, "is no node of this platoon")
    if run.seed >= 2**63:
        raise refuse("run.seed", run.seed, "must be < 2^63")
    if not _is_multiple(run.step, 1e-9):
        raise refuse("run.step", run.step, "must be a whole number of nanoseconds")
    if not _is_multiple(run.duration, run.step):
        raise refuse(
            "run.duration", run.duration, f"must be a whole number of steps of {run.step:g} s"
        )
    _check_clocks(run, refuse)
    if round(run.duration / run.step) >= MAX_SAMPLES:
        raise refuse("run.duration", run.duration, f"must be at most {MAX_SAMPLES} steps")


def _check_clocks(run: Run, refuse: Callable[[str, object, str], ScenarioError]) -> None:
    """Refuse what clocks cannot do, or lockstep."""
    if run.sync != "wall":
        if run.restarts:
            rule = "must be 0 in lockstep, which ends when a process does"
            raise refuse("run.restarts", run.restarts, rule)
        return
    for name in ("adjustable", "remote_hosts"):
        if run.restarts and getattr(run, name):
            rule = f"must be 0 with run.{name}, of which a process that starts again knows nothing"
            raise refuse("run.restarts", run.restarts, rule)
    if run.pause_at >= 0.0:
        rule = "must be -1 by clocks (run.sync = wall), which cannot be stopped"
        raise refuse("run.pause_at", run.pause_at, rule)
    if run.clock_period < SHORTEST_PERIOD:
        rule = (
            f"gives each vehicle a sample every {run.clock_period:g} s of its clock, which must be "
            f"at least {SHORTEST_PERIOD:g} s"
        )
        name = "run.real_time_factor" if run.step >= SHORTEST_PERIOD else "run.step"
        raise refuse(name, getattr(run, name.partition(".")[2]), rule)


def check_leader(platoon: Platoon, leader: Leader, source: str) -> None:
    """Refuse a leader's motion that contradicts itself or the platoon's start."""
    if leader.profile == "brake" and leader.final_speed >= platoon.initial_speed:
        raise TABLE["leader.final_speed"].refusal(
            leader.final_speed,
            source,
            f"must be below platoon.initial_speed = {platoon.initial_speed:g} m/s",
        )
    if len(leader.times) != len(leader.speeds):
        raise TABLE["leader.times"].refusal(
            list(leader.times), source, "must be as many as leader.speeds"
        )
    steps = [after - before for before, after in pairwise(leader.times)]
    if leader.times and (leader.times[0] != 0.0 or not steps or min(steps) <= 0.0):
        raise TABLE["leader.times"].refusal(
            list(leader.times), source, "must be two or more, increase, and begin with 0"
        )
    if leader.profile == "csv" and leader.speeds[0] != platoon.initial_speed:
        raise TABLE["platoon.initial_speed"].refusal(
            platoon.initial_speed,
            source,
            f"must be the first speed of the leader's table, {leader.speeds[0]:g} m/s",
        )


def check_overrides(
    overrides: Iterable[int], indices: range, vehicle: Vehicle, source: str
) -> None:
    """Refuse parameters of vehicles that are not there, and lists of another length."""
    if indices[-1] > MAX_INDEX:
        raise TABLE["platoon.first_follower"].refusal(
            indices[0],
            source,
            f"makes {vehicle_name(indices[-1])} the last of {len(indices)} followers, "
            f"beyond {MAX_INDEX}",
        )
    for index in overrides:
        if index not in indices:
            raise ScenarioError(
                f"{source}: {vehicle_name(index)} has parameters of its own but the platoon has "
                f"followers {indices[0]} to {indices[-1]}; they would be ignored. "
                "Correct the index."
            )
    tau = vehicle.tau
    if isinstance(tau, tuple) and len(tau) != len(indices):
        raise TABLE["vehicle.tau"].refusal(
            list(tau), source, f"has {len(tau)} values for {len(indices)} followers"
        )


def check_timeline(run: Run, indices: range, source: str) -> None:
    """Refuse changes that cannot be read, come too late, or are those of nobody."""
    row, seen = TABLE["run.timeline"], set[tuple[int, int, str]]()
    if len(run.timeline) > MOST_CHANGES:
        rule = f"must have {MOST_CHANGES} entries at most, not {len(run.timeline)}"
        raise row.refusal(list(run.timeline[:1]), source, rule)
    for text in run.timeline:
        change = read_change(text, run.step, source)
        if change.vehicle not in indices:
            known = f"{vehicle_name(indices[0])} to {vehicle_name(indices[-1])}"
            rule = f"names no follower of this platoon, which has {known}"
            raise row.refusal(text, source, rule)
        if change.sample * run.step > run.duration:
            rule = f"must be within the run, which ends at run.duration = {run.duration:g} s"
            raise row.refusal(text, source, rule)
        if change[:3] in seen:
            raise row.refusal(text, source, "must be the only one of its time, target and KEY")
        seen.add(change[:3])


def check_start(
    platoon: Platoon, run: Run, follower: Follower, length_ahead: float, source: str
) -> None:
    """Refuse a vehicle that would touch the one ahead from the first sample on."""
    spacing = platoon.standstill_distance + follower.gains.time_headway * platoon.initial_speed
    if run.stop_on_collision and spacing <= length_ahead:
        raise TABLE["platoon.standstill_distance"].refusal(
            platoon.standstill_distance,
            source,
            f"and the time headway leave {vehicle_name(follower.index)} {spacing:g} m to the front "
            f"of the vehicle ahead, which must be more than its length of {length_ahead:g} m",
        )


def check_topology(
    platoon: Platoon, leader: Leader, followers: Iterable[Follower], source: str
) -> None:
    """Refuse several predecessors where a law would ignore them or they are not in the run."""
    predecessors = platoon.predecessors
    if predecessors == 1:
        return
    if leader.profile == "bag":
        raise TABLE["platoon.predecessors"].refusal(
            predecessors,
            source,
            "must be 1 where leader.profile is bag: what the vehicles before the leader sent "
            "is not in the run",
        )
    for follower in followers:
        if not follower.law_name:
            raise TABLE["platoon.predecessors"].refusal(
                predecessors,
                source,
                "needs a controller.law that uses them all, "
                f"{vehicle_name(follower.index)} has none",
            )


def check_limits(
    motion: LeaderProfile, duration: float, followers: Iterable[Follower], source: str
) -> None:
    """Refuse a leader that does what a follower with limits cannot."""
    if not isinstance(motion, SinePulse | PiecewiseConstantAcceleration):
        return
    low, high = motion.acceleration_range(0.0, duration)
    for follower in followers:
        limits = follower.limits()
        if limits is None:
            continue
        for asked, limit, does in (
            (-low, max(limits.deceleration), "brakes"),
            (high, max(limits.acceleration), "accelerates"),
        ):
            if asked > limit:
                raise TABLE["vehicle.limits"].refusal(
                    follower.body.limits,
                    source,
                    f"lets {vehicle_name(follower.index)} do {limit:g} m/s^2, which must not be "
                    f"less than the leader does: it {does} with {asked:g} m/s^2",
                )


def check_follower(follower: Follower, step: float, source: str) -> None:
    """Refuse parameters of one follower that are right alone and wrong together."""
    v2v = follower.v2v
    if follower.tau > follower.tau_max:
        raise TABLE["vehicle.tau"].refusal(
            follower.tau, source, f"must be <= vehicle.tau_max = {follower.tau_max:g} s"
        )
    if not 1 <= len(v2v.bit_probabilities) <= MAX_BITS:
        raise TABLE["v2v.bit_probabilities"].refusal(
            list(v2v.bit_probabilities), source, f"must have 1 to {MAX_BITS} values"
        )
    _check_changes(follower, step, source)
    check_plugin(v2v.channel, TABLE["v2v.channel"], source)
    check_plugin(v2v.receiver, TABLE["v2v.receiver"], source)
    check_plugin(follower.law_name, TABLE["controller.law"], source)
    if follower.triggered and v2v.period:
        raise TABLE["v2v.period"].refusal(
            v2v.period, source, "must be 0 where v2v.send_rule is cam, which has times of its own"
        )
    if 0.0 < v2v.fallback_headway <= 2.0 * follower.tau_max:
        rule = f"must be above 2 vehicle.tau_max = {2.0 * follower.tau_max:g} s, or 0"
        raise TABLE["v2v.fallback_headway"].refusal(v2v.fallback_headway, source, rule)
    for name in ("hold", "period", *(("cam_check",) if follower.triggered else ())):
        value = getattr(v2v, name)
        if value and not _is_multiple(value, step):
            raise TABLE[f"v2v.{name}"].refusal(value, source, f"must be a multiple of {step:g} s")
    if v2v.best_effort and not follower.course.clocked:
        rule = "must be false in lockstep, where losses belong to the relay and never to DDS"
        raise TABLE["v2v.best_effort"].refusal(v2v.best_effort, source, rule)
    _check_phase(v2v, step, source)
    ends = v2v.blackouts
    if len(ends) % 2 or any(end <= begin for begin, end in pairwise(ends)):
        rule = "must be pairs of increasing times, the end of each after its beginning"
        raise TABLE["v2v.blackouts"].refusal(list(ends), source, rule)
    _check_false_data(v2v.false_data, step, source)
    _check_monitor(follower, step, source)
    if v2v.quantum and v2v.saturation and v2v.saturation < v2v.quantum:
        rule = f"must be at least v2v.quantum = {v2v.quantum:g} m/s^2, or nothing but 0 is sent"
        raise TABLE["v2v.saturation"].refusal(v2v.saturation, source, rule)


def _check_changes(follower: Follower, step: float, source: str) -> None:
    """Refuse changes of what a custom channel or law stands in for."""
    for change in follower.course.changes:
        own = follower.law_name if change.name.startswith("controller.") else follower.v2v.channel
        if own:
            rule = f"changes {change.name} of {vehicle_name(follower.index)}, which {own} ignores"
            raise TABLE["run.timeline"].refusal(change.text(step), source, rule)


def _check_false_data(texts: Iterable[str], step: float, source: str) -> None:
    """Refuse times of false data that cannot be read or that overlap."""
    row, read = TABLE["v2v.false_data"], []
    for text in texts:
        try:
            read.append(forgery(text, step))
        except ValueError:
            raise row.refusal(text, source, RULE) from None
    for before, after in pairwise(sorted(read)):
        if after.begin < before.end:
            rule = f"must not overlap, as they do at {after.begin * step:g} s"
            raise row.refusal(list(texts), source, rule)


def _check_monitor(follower: Follower, step: float, source: str) -> None:
    """Refuse a monitor that could never compare anything, or never act."""
    v2v = follower.v2v
    if v2v.monitor == "none":
        return

    def refuse(name: str, value: object, rule: str) -> ScenarioError:
        return TABLE[name].refusal(value, source, rule)

    if v2v.monitor == "fallback" and not follower.fallback_law():
        raise refuse("v2v.monitor", v2v.monitor, "needs v2v.reception = fallback to act by")
    late, apart = follower.longest_latency_steps, follower.longest_interval
    if follower.triggered:
        check = max(1, round(v2v.cam_check / step))
        apart = -(-apart // check) * check
    if v2v.monitor_window <= (late + apart) * step * (1.0 + WHOLE):
        rule = (
            f"must be above {(late + apart) * step:g} s: packets are up to {apart * step:g} s "
            f"apart and take up to {late * step:g} s"
        )
        raise refuse("v2v.monitor_window", v2v.monitor_window, rule)


def _check_phase(v2v: V2V, step: float, source: str) -> None:
    """Refuse a phase that is no control instant of the first period."""
    phase, period = v2v.phase, v2v.period or step
    if v2v.send_rule == "cam":
        period = v2v.cam_check
    if isinstance(phase, str):
        return
    if phase >= period or (phase and not _is_multiple(phase, step)):
        rule = f"must be a multiple of {step:g} s below the period, {period:g} s"
        raise TABLE["v2v.phase"].refusal(phase, source, rule)


def _is_multiple(value: float, unit: float) -> bool:
    """Whether `value` is a whole number >= 1 of `unit`, up to the rounding of decimals."""
    ratio = value / unit
    if not math.isfinite(ratio):
        return False
    whole = round(ratio)
    return whole >= 1 and math.isclose(ratio, whole, rel_tol=1e-12, abs_tol=1e-9)

"""Everything that defines a run, checked once, before anything starts."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from cacc_platoon.errors import UserError
from cacc_platoon.model import (
    BitChannel,
    Channel,
    ConstantChannel,
    ConstantTimeHeadway,
    Gains,
    LeaderProfile,
    PiecewiseConstantAcceleration,
    RecordedMotion,
    SinePulse,
    ThirdOrderPlant,
    brake_profile,
    expected_factor,
    read_speed_profile,
    speed_profile,
    step_profile,
)
from cacc_platoon.model.channel import MAX_BITS
from cacc_platoon.parameter_table import (
    GROUPS,
    SNR_DB,
    TABLE,
    V2V,
    Controller,
    Leader,
    Platoon,
    Record,
    Run,
    Vehicle,
)
from cacc_platoon.parameters import ScenarioError, refuse_unknown

MAX_SAMPLES = 10**8
"""More would neither fit into memory nor end."""

MAX_NAMESPACE = 150
MAX_INDEX = 500
"""Of the last vehicle; readers of bags take a higher one for damage."""


@dataclass(frozen=True)
class Follower:
    """One follower's own parameters, and the model objects made from them."""

    index: int
    tau: float
    tau_max: float
    gains: Gains
    standstill_distance: float
    v2v: V2V
    seed: int
    hold_steps: int

    def plant(self, step: float) -> ThirdOrderPlant:
        """Return the vehicle's dynamics at the control period `step` [s]."""
        return ThirdOrderPlant(self.tau, step)

    def law(self) -> ConstantTimeHeadway:
        """Return the vehicle's control law."""
        return ConstantTimeHeadway(self.gains, self.standstill_distance)

    def channel(self, noise: str | None = None) -> Channel:
        """Return the channel of the link from the predecessor, with its own `noise` by default."""
        v2v = self.v2v
        match noise or v2v.noise:
            case "bits":
                return BitChannel(
                    v2v.rho, v2v.bit_probabilities, self.seed, self.index, self.hold_steps
                )
            case "expected":
                return ConstantChannel(expected_factor(v2v.rho, v2v.bit_probabilities))
        return ConstantChannel(1.0)


@dataclass(frozen=True)
class Scenario:
    """A checked run definition.

    Attributes
    ----------
    platoon, vehicle, controller, v2v, leader, run, record
        The groups of the parameter table.
    overrides : Mapping of int to Mapping of str to value
        By follower index: the parameters of groups vehicle, controller and v2v that differ there.
    name : str
        Short name, the scenario file's stem.
    recorded_leader : RecordedMotion or None
        The leader's motion when leader.profile is bag, once it has been read.

    Examples
    --------
    >>> Scenario.from_values({"controller.time_headway": 1}).controller.time_headway
    1.0
    """

    platoon: Platoon = dataclasses.field(default_factory=Platoon)
    vehicle: Vehicle = dataclasses.field(default_factory=Vehicle)
    controller: Controller = dataclasses.field(default_factory=Controller)
    v2v: V2V = dataclasses.field(default_factory=V2V)
    leader: Leader = dataclasses.field(default_factory=Leader)
    run: Run = dataclasses.field(default_factory=Run)
    record: Record = dataclasses.field(default_factory=Record)
    overrides: Mapping[int, Mapping[str, Any]] = dataclasses.field(default_factory=dict)
    name: str = "scenario"
    recorded_leader: RecordedMotion | None = dataclasses.field(
        default=None, compare=False, repr=False
    )

    @classmethod
    def from_values(
        cls,
        values: Mapping[str, Any],
        overrides: Mapping[int, Mapping[str, Any]] | None = None,
        source: str = "scenario",
        folder: Path = Path(),
    ) -> Scenario:
        """Build a scenario from dotted names; `folder` is where leader.file is looked for.

        Raises
        ------
        ScenarioError
            For an unknown key, a wrong type, a value out of range or values that contradict
            each other; one line that begins with `source`.
        """
        common = _checked(values, source)
        own = {
            index: _checked(section, f"{source}: vehicle_{index}", per_vehicle=True)
            for index, section in sorted((overrides or {}).items())
        }
        groups = {
            group: owner(
                **{
                    name.partition(".")[2]: value
                    for name, value in common.items()
                    if name.startswith(f"{group}.")
                }
            )
            for group, owner in GROUPS.items()
        }
        groups["leader"] = _with_leader_file(groups["leader"], source, folder)
        scenario = cls(**groups, overrides=own, name=Path(source).stem or "scenario")
        _check_consistency(scenario, source)
        return scenario

    def values(self) -> dict[str, Any]:
        """Return every common parameter by its dotted name."""
        return {name: _read(self, name) for name in TABLE}

    def follower(self, index: int) -> Follower:
        """Return the follower of an index, one of `indices`, with its overrides applied."""
        own = self.overrides.get(index, {})
        picked = {name: own.get(name, _read(self, name)) for name in TABLE}
        tau = picked["vehicle.tau"]
        v2v = V2V(**{f.name: picked[f"v2v.{f.name}"] for f in dataclasses.fields(V2V)})
        return Follower(
            index,
            tau[self.indices.index(index)] if isinstance(tau, tuple) else tau,
            picked["vehicle.tau_max"],
            Gains(*(picked[f"controller.{name}"] for name in Gains._fields)),
            self.platoon.standstill_distance,
            v2v,
            self.run.seed,
            max(1, round(v2v.hold / self.run.step)),
        )

    @property
    def indices(self) -> range:
        """The indices of the followers, 1..N unless platoon.first_follower says otherwise."""
        first = self.platoon.first_follower
        return range(first, first + self.platoon.followers)

    @property
    def leader_index(self) -> int:
        """The index of the leader, 0 unless platoon.first_follower says otherwise."""
        return self.platoon.first_follower - 1

    @property
    def vehicles(self) -> range:
        """The indices of all vehicles, the leader's first."""
        return range(self.leader_index, self.indices.stop)

    @property
    def followers(self) -> list[Follower]:
        """All followers, from front to rear."""
        return [self.follower(index) for index in self.indices]

    @property
    def node_names(self) -> list[str]:
        """The nodes that make up the platoon, relative to its namespace."""
        names = [f"vehicle_{self.leader_index}/leader"]
        for index in self.indices:
            names += [f"vehicle_{index}/vehicle", f"vehicle_{index}/noise_relay"]
        return names

    @property
    def step_ns(self) -> int:
        """The control period in nanoseconds; sample k is stamped k times this."""
        return round(self.run.step * 1e9)

    @property
    def samples(self) -> int:
        """The number of samples, both ends included."""
        return round(self.run.duration / self.run.step) + 1

    def leader_profile(self) -> LeaderProfile:
        """Return the leader's motion.

        Raises
        ------
        UserError
            When it is that of a bag which has not been read.
        """
        leader, speed = self.leader, self.platoon.initial_speed
        match leader.profile:
            case "sine":
                return SinePulse(speed, leader.amplitude, leader.angular_frequency, leader.start)
            case "step":
                return step_profile(speed, leader.acceleration, leader.start, leader.hold)
            case "brake":
                return brake_profile(speed, leader.deceleration, leader.start, leader.final_speed)
            case "csv":
                return speed_profile(leader.times, leader.speeds)
            case "bag" if self.recorded_leader:
                return self.recorded_leader
            case "bag":
                raise UserError(
                    f"{self.name}: leader.file = {leader.file} has not been read, so the leader's "
                    "motion is unknown. Read it with msg_adapters.chaining.with_recorded_leader."
                )
        return PiecewiseConstantAcceleration(speed, [], [])


def _read(scenario: Scenario, name: str) -> Any:
    group, _, field = name.partition(".")
    return getattr(getattr(scenario, group), field)


def _checked(values: Mapping[str, Any], source: str, per_vehicle: bool = False) -> dict[str, Any]:
    """Return checked values; v2v.snr_db becomes v2v.rho."""
    refuse_unknown(values, [*TABLE, SNR_DB.name], source)
    checked: dict[str, Any] = {}
    for name, value in values.items():
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


def _with_leader_file(leader: Leader, source: str, folder: Path) -> Leader:
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


def _check_consistency(scenario: Scenario, source: str) -> None:
    """Refuse values that are right alone and wrong together."""
    run = scenario.run

    def refuse(name: str, value: object, rule: str) -> ScenarioError:
        return TABLE[name].refusal(value, source, rule)

    check_namespace(scenario.platoon.namespace, source)
    if isinstance(run.hosts, str) and run.hosts not in ("auto", "per_node"):
        raise refuse("run.hosts", run.hosts, "must be auto, per_node or a whole number")
    for node in run.by_hand:
        if node not in scenario.node_names:
            raise refuse("run.by_hand", node, "is no node of this platoon")
    if run.seed >= 2**63:
        raise refuse("run.seed", run.seed, "must be < 2^63")
    if not _is_multiple(run.step, 1e-9):
        raise refuse("run.step", run.step, "must be a whole number of nanoseconds")
    if not _is_multiple(run.duration, run.step):
        raise refuse(
            "run.duration", run.duration, f"must be a whole number of steps of {run.step:g} s"
        )
    if scenario.samples > MAX_SAMPLES:
        raise refuse("run.duration", run.duration, f"must be at most {MAX_SAMPLES} steps")
    _check_leader(scenario, source)
    _check_overrides(scenario, source)
    for follower in scenario.followers:
        where = f"vehicle_{follower.index}: " if follower.index in scenario.overrides else ""
        _check_follower(follower, run.step, f"{source}: {where}".rstrip(": "))


def _check_leader(scenario: Scenario, source: str) -> None:
    platoon, leader = scenario.platoon, scenario.leader
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


def _check_overrides(scenario: Scenario, source: str) -> None:
    count, indices = scenario.platoon.followers, scenario.indices
    if indices[-1] > MAX_INDEX:
        raise TABLE["platoon.first_follower"].refusal(
            indices[0],
            source,
            f"makes vehicle_{indices[-1]} the last of {count} followers, beyond {MAX_INDEX}",
        )
    for index in scenario.overrides:
        if index not in indices:
            raise ScenarioError(
                f"{source}: vehicle_{index} has parameters of its own but the platoon has "
                f"followers {indices[0]} to {indices[-1]}; they would be ignored. "
                "Correct the index."
            )
    tau = scenario.vehicle.tau
    if isinstance(tau, tuple) and len(tau) != count:
        raise TABLE["vehicle.tau"].refusal(
            list(tau), source, f"has {len(tau)} values for {count} followers"
        )


def _check_follower(follower: Follower, step: float, source: str) -> None:
    v2v = follower.v2v
    if follower.tau > follower.tau_max:
        raise TABLE["vehicle.tau"].refusal(
            follower.tau, source, f"must be <= vehicle.tau_max = {follower.tau_max:g} s"
        )
    if not 1 <= len(v2v.bit_probabilities) <= MAX_BITS:
        raise TABLE["v2v.bit_probabilities"].refusal(
            list(v2v.bit_probabilities), source, f"must have 1 to {MAX_BITS} values"
        )
    if v2v.hold and not _is_multiple(v2v.hold, step):
        raise TABLE["v2v.hold"].refusal(v2v.hold, source, f"must be a multiple of {step:g} s")


def _is_multiple(value: float, unit: float) -> bool:
    """Whether `value` is a whole number >= 1 of `unit`, up to the rounding of decimals."""
    ratio = value / unit
    whole = round(ratio)
    return whole >= 1 and math.isclose(ratio, whole, rel_tol=1e-12, abs_tol=1e-9)

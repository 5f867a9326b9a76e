"""Everything that defines a run, checked once, before anything starts."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from cacc_platoon.errors import UserError
from cacc_platoon.model import (
    Gains,
    LeaderProfile,
    Link,
    PiecewiseConstantAcceleration,
    RecordedMotion,
    SinePulse,
    Topology,
    brake_profile,
    speed_profile,
    step_profile,
)
from cacc_platoon.scenario.checks import (
    check_follower,
    check_leader,
    check_limits,
    check_namespace,
    check_overrides,
    check_run,
    check_start,
    check_timeline,
    check_topology,
    checked_values,
    with_leader_file,
)
from cacc_platoon.scenario.follower import Follower
from cacc_platoon.scenario.names import NodeKind, NodeName, vehicle_index, vehicle_name
from cacc_platoon.scenario.own_code import try_channel, try_law, try_reception
from cacc_platoon.scenario.parameter import ScenarioError
from cacc_platoon.scenario.receiver import Course
from cacc_platoon.scenario.remote_hosts import RemoteHost, check_remote_hosts, remote_hosts
from cacc_platoon.scenario.ros_sections import forget, replace
from cacc_platoon.scenario.table import (
    FORMER_NAMES,
    GROUPS,
    TABLE,
    Controller,
    Leader,
    Platoon,
    Record,
    Run,
    Sensing,
    Vehicle,
)
from cacc_platoon.scenario.timeline import Change, timeline
from cacc_platoon.scenario.v2v_parameters import V2V

_FIELDS = {
    group: [field.name for field in dataclasses.fields(owner)] for group, owner in GROUPS.items()
}


@dataclass(frozen=True)
class Scenario:
    """A checked run definition.

    Attributes
    ----------
    platoon, vehicle, sensing, controller, v2v, leader, run, record
        The groups of the parameter table.
    overrides : Mapping of int to Mapping of str to value
        By follower index: the parameters of groups vehicle, sensing, controller and v2v that differ
        there.
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
    sensing: Sensing = dataclasses.field(default_factory=Sensing)
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
        common = checked_values(values, source)
        own = {
            index: checked_values(section, f"{source}: {vehicle_name(index)}", per_vehicle=True)
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
        groups["leader"] = with_leader_file(groups["leader"], source, folder)
        scenario = cls(**groups, overrides=own, name=Path(source).stem or "scenario")
        scenario._check(source)
        return scenario

    def _check(self, source: str) -> None:
        """Refuse values that are right alone and wrong together."""
        check_namespace(self.platoon.namespace, source)
        check_run(self.run, self.node_names, source)
        check_remote_hosts(self.run, self.vehicles, source)
        check_leader(self.platoon, self.leader, source)
        check_overrides(self.overrides, self.indices, self.vehicle, source)
        check_timeline(self.run, self.indices, source)
        check_topology(self.platoon, self.leader, self.followers, source)
        for follower in self.followers:
            where = f"{vehicle_name(follower.index)}: " if follower.index in self.overrides else ""
            check_follower(follower, self.run.step, f"{source}: {where}".rstrip(": "))
            check_start(self.platoon, self.run, follower, self.length_ahead(follower.index), source)
        if self.leader.profile != "bag":
            check_limits(self.leader_profile(), self.run.duration, self.followers, source)

    def with_values(self, values: Mapping[str, Any]) -> Scenario:
        """Return this scenario with some values replaced, checked anew.

        Parameters
        ----------
        values : Mapping of str to value
            By dotted name, `vehicle_<i>.` before it for one follower alone. A value for all
            replaces those of single followers too.

        Raises
        ------
        ScenarioError
            As from `from_values`.

        Examples
        --------
        >>> scenario = Scenario().with_values({"run.seed": 2, "vehicle_3.controller.k_v": 0.7})
        >>> scenario.run.seed, scenario.follower(3).gains.k_v, scenario.follower(4).gains.k_v
        (2, 0.7, 0.63)
        """
        common = self.values()
        overrides = {index: dict(own) for index, own in self.overrides.items()}
        leader = self.recorded_leader
        for given, new in values.items():
            if not isinstance(given, str):
                raise ScenarioError(
                    f"{self.name}: {given!r} is no name of a parameter, the value would have no "
                    "reader. Give names such as run.seed."
                )
            name = FORMER_NAMES.get(given, given)
            value = new.tolist() if hasattr(new, "tolist") else new  # numpy's numbers, arrays
            if name == "leader.file":
                leader, common["leader.times"], common["leader.speeds"] = None, (), ()
            vehicle, _, rest = name.partition(".")
            index = vehicle_index(vehicle)
            if index is not None:
                replace(overrides.setdefault(index, {}), rest, value)
                continue
            replace(common, name, value)
            for own in overrides.values():
                forget(own, name)
        overrides = {index: own for index, own in overrides.items() if own}
        changed = Scenario.from_values(common, overrides, self.name)
        return dataclasses.replace(changed, name=self.name, recorded_leader=leader)

    def values(self) -> dict[str, Any]:
        """Return every common parameter by its dotted name."""
        return {name: _read(self, name) for name in TABLE}

    def follower(self, index: int) -> Follower:
        """Return the follower of an index, one of `indices`, with its overrides applied."""
        return self.followers[self.indices.index(index)]

    @cached_property
    def followers(self) -> tuple[Follower, ...]:
        """All followers, from front to rear."""
        common, changes = self.values(), self.changes
        return tuple(
            self._follower(index, {**common, **self.overrides.get(index, {})}, changes)
            for index in self.indices
        )

    def _follower(self, index: int, values: dict[str, Any], changes: list[Change]) -> Follower:
        tau = values["vehicle.tau"]

        def own_group(group: str) -> dict[str, Any]:
            return {name: values[f"{group}.{name}"] for name in _FIELDS[group]}

        return Follower(
            link=Link(index - 1, index),
            v2v=V2V(**own_group("v2v")),
            seed=self.run.seed,
            step=self.run.step,
            tau=tau[self.indices.index(index)] if isinstance(tau, tuple) else tau,
            tau_max=values["vehicle.tau_max"],
            gains=Gains(*(values[f"controller.{name}"] for name in Gains._fields)),
            standstill_distance=self.platoon.standstill_distance,
            law_name=values["controller.law"],
            body=Vehicle(**own_group("vehicle")),
            sensors=Sensing(**own_group("sensing")),
            course=Course(
                tuple(change for change in changes if change.vehicle == index),
                values["controller.headway_rate"],
                self.run.adjustable,
                self.clocked,
            ),
        )

    @property
    def clocked(self) -> bool:
        """Whether nodes keep time by clocks of their own rather than in lockstep."""
        return self.run.sync == "wall"

    @property
    def stops_on_collision(self) -> bool:
        """Whether a collision is the end of the run; by clocks the others have gone on."""
        return self.run.stop_on_collision and not self.clocked

    @property
    def in_lockstep(self) -> Scenario:
        """The same scenario in lockstep."""
        return dataclasses.replace(self, run=dataclasses.replace(self.run, sync="lockstep"))

    @property
    def changes(self) -> list[Change]:
        """What changes in the course of the run, in order."""
        return timeline(self.run.timeline, self.run.step)

    @property
    def at_first(self) -> Scenario:
        """The scenario as it is at the beginning: without changes in the course of the run."""
        if not self.run.timeline:
            return self
        return dataclasses.replace(self, run=dataclasses.replace(self.run, timeline=()))

    def with_changes(self, changes: Iterable[Change]) -> Scenario:
        """Return the scenario with changes more, as they happened; the last of a time counts."""
        latest = {change[:3]: change for change in (*self.changes, *changes)}
        texts = tuple(change.text(self.run.step) for change in latest.values())
        run = dataclasses.replace(self.run, timeline=texts)
        return dataclasses.replace(self, run=run)

    @cached_property
    def lengths(self) -> tuple[float, ...]:
        """The lengths of all vehicles [m], the leader's first: the common one."""
        return (self.vehicle.length, *(follower.length for follower in self.followers))

    def length_ahead(self, index: int) -> float:
        """Return the length of the vehicle ahead of a follower [m]."""
        return self.lengths[self.indices.index(index)]

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
    def custom_code(self) -> list[str]:
        """What channels and laws the scenario names, as `parameter = module:Class`."""
        named = {pair for follower in self.followers for pair in follower.own_code.items()}
        return sorted(f"{name} = {text}" for name, text in named)

    def check_own_code(self) -> None:
        """Make and try every custom channel, reception and law once, before anything starts.

        Raises
        ------
        UserError
            When one cannot be made, as from `make_plugin`, or does not do what it must.
        """
        topology, speed = self.topology, self.platoon.initial_speed
        for follower in self.followers:
            if follower.law_name:
                try_law(follower, speed, len(topology.links_to(follower.index)))
        for receiver in self.receivers:
            if receiver.v2v.channel:
                try_channel(receiver, self.samples)
            if receiver.v2v.receiver:
                try_reception(receiver)

    @property
    def topology(self) -> Topology:
        """Who receives from whom."""
        return Topology(self.indices, self.platoon.predecessors)

    @property
    def receivers(self) -> list[Follower]:
        """The follower at the end of every link of the topology, in its order."""
        topology = self.topology
        return [
            follower.on(link)
            for follower in self.followers
            for link in topology.links_to(follower.index)
        ]

    @property
    def nodes(self) -> list[NodeName]:
        """The nodes that make up the platoon, from front to rear."""
        names = [NodeName(NodeKind.LEADER, self.leader_index)]
        for index in self.indices:
            names += [NodeName(kind, index) for kind in (NodeKind.VEHICLE, NodeKind.NOISE_RELAY)]
        return names

    @property
    def node_names(self) -> list[str]:
        """The names of the nodes, relative to the platoon's namespace."""
        return [str(node) for node in self.nodes]

    @property
    def remote_hosts(self) -> tuple[RemoteHost, ...]:
        """The hosts that others start, each with its vehicles."""
        return remote_hosts(self.run)

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
                    "motion is unknown. Read it with runs.recorded_leader.with_recorded_leader."
                )
        return PiecewiseConstantAcceleration(speed, [], [])


def _read(scenario: Scenario, name: str) -> Any:
    group, _, field = name.partition(".")
    return getattr(getattr(scenario, group), field)

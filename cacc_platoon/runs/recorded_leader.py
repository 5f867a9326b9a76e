"""Bag chaining: a vehicle recorded in one run leads another; its values are given back as they are.

A platoon can so be grown piece by piece: run 6 vehicles, then let number 6 lead 7 to 12.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cacc_platoon.bags.decode import rows_in_stamp_order
from cacc_platoon.bags.digest import digest_of
from cacc_platoon.bags.raw import RawTopic
from cacc_platoon.bags.read import read_bag
from cacc_platoon.bags.rows import Recording, TopicRows
from cacc_platoon.errors import UserError
from cacc_platoon.model import RecordedMotion
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import vehicle_index, vehicle_name
from msg_adapters.stamped import SECOND
from msg_adapters.topics import Topic, VehicleTopics, role_of


def with_recorded_leader(scenario: Scenario) -> Scenario:
    """Return the scenario with its leader's motion read from leader.file, if it comes from a bag.

    The vehicle and the digest of its topics are filled in, so that the scenario says exactly what
    led the run; a scenario that has them is held to them.

    Raises
    ------
    UserError
        When the bag is gone or changed, or the recorded vehicle cannot lead this run.
    """
    leader = scenario.leader
    if leader.profile != "bag" or scenario.recorded_leader:
        return scenario
    bag = read_bag(_locate(scenario)).topics
    vehicle = _recorded_vehicle(bag, scenario)
    topics = vehicle.motion
    recording = _rows(bag, topics)
    for topic in topics:
        _check_grid(topic, recording, scenario)
    found = digest_of(recording, recording)
    if leader.digest not in ("", found):
        raise _refusal(
            scenario,
            f"has changed: {vehicle.namespace} has the digest {found[:12]} and the scenario says "
            f"{leader.digest[:12]}, so this would be another run. Put the bag back, or set "
            "leader.digest to nothing to take it as it is",
        )
    columns = [topic.codec.values(recording[topic.name].messages) for topic in topics]
    _check_start(scenario, *columns)
    number = vehicle_index(vehicle.namespace.rpartition("/")[2])
    assert number is not None
    return dataclasses.replace(
        scenario,
        leader=dataclasses.replace(leader, vehicle=number, digest=found),
        recorded_leader=RecordedMotion(scenario.run.step, *columns),
    )


def _refusal(scenario: Scenario, why: str) -> UserError:
    return UserError(f"{scenario.name}: leader.file = {scenario.leader.file} {why}.")


def _locate(scenario: Scenario) -> Path:
    """Return the bag that leader.file names itself or has inside, as a run folder does."""
    path = Path(scenario.leader.file)
    if not path.exists():
        digest = scenario.leader.digest
        known = (
            f" ({vehicle_name(scenario.leader.vehicle)}, digest {digest[:12]})" if digest else ""
        )
        raise _refusal(
            scenario,
            f"is not there, and only it holds the leader's motion{known}. Put it back or name "
            "another run or bag",
        )
    return path / "bag" if (path / "bag").is_dir() else path


def _rows(bag: Mapping[str, list[RawTopic]], topics: Iterable[Topic]) -> Recording:
    """Return the messages of some topics in stamp order; those that have none are left out."""
    found = {}
    for topic in topics:
        parts = bag.get(topic.name, [])
        rows = rows_in_stamp_order(parts)
        if rows is not None:
            found[topic.name] = TopicRows(parts[0].type_name, rows)
    return found


def _recorded_vehicle(bag: Iterable[str], scenario: Scenario) -> VehicleTopics:
    """Return the topics of the vehicle that leads, in the platoon of the same name or the only one.

    The last vehicle is the last one that has a pose.
    """
    vehicles: dict[str, list[int]] = {}
    for name in bag:
        found = role_of(name)
        if found and found[1].quantity == "pose":
            vehicles.setdefault(found[0], []).append(found[1].vehicle)
    prefix = scenario.platoon.namespace
    if prefix not in vehicles:
        if len(vehicles) != 1:
            names = ", ".join(sorted(vehicles)) or "none"
            raise _refusal(
                scenario,
                f"holds no platoon {prefix}, only {names}. Give its name in platoon.namespace",
            )
        (prefix,) = vehicles
    number = scenario.leader.vehicle
    if number == -1:
        number = max(vehicles[prefix])
    if number not in vehicles[prefix]:
        low, high = min(vehicles[prefix]), max(vehicles[prefix])
        raise _refusal(
            scenario,
            f"holds vehicles {low} to {high} of {prefix} and not leader.vehicle = {number}. "
            "Give one of them",
        )
    return VehicleTopics(prefix, number)


def _check_grid(topic: Topic, recording: Recording, scenario: Scenario) -> None:
    """Refuse messages that are not those of samples 0, 1, 2, ... of this run."""
    record = recording.get(topic.name)
    if record is None or record.type_name != topic.kind.type_name:
        raise _refusal(scenario, f"has no {topic.name} of type {topic.kind.type_name}")
    if record.messages.shape[1] != topic.codec.size:
        raise _refusal(
            scenario,
            f"has messages of another frame than {topic.frame_id} on {topic.name}. "
            "Record the leader with this package",
        )
    stamps = topic.codec.stamps(record.messages)
    step = scenario.run.step
    if len(stamps) > 1 and int(np.median(np.diff(stamps))) != scenario.step_ns:
        recorded = int(np.median(np.diff(stamps))) / SECOND
        raise _refusal(
            scenario,
            f"was recorded with run.step = {recorded:g} s and this run has {step:g} s. "
            "Give the same",
        )
    due: npt.NDArray[np.int64] = np.arange(len(stamps)) * scenario.step_ns
    if (stamps != due).any():
        k = int(np.flatnonzero(stamps != due)[0])
        raise _refusal(
            scenario, f"lacks sample {k} of {topic.name}, the leader would jump. Record it again"
        )
    if len(stamps) < scenario.samples:
        last = (len(stamps) - 1) * step
        raise _refusal(
            scenario,
            f"ends at {last:g} s and run.duration = {scenario.run.duration:g} s. Give {last:g} s "
            "or less",
        )


def _check_start(scenario: Scenario, *columns: npt.NDArray[np.float64]) -> None:
    """Refuse a start at which followers in equilibrium would be out of it at once."""
    _, velocity, acceleration = (float(column[0]) for column in columns)
    if acceleration != 0.0:
        raise _refusal(
            scenario,
            f"has its vehicle accelerate at {acceleration:g} m/s^2 at time 0, where a run begins "
            "in equilibrium. Record one that begins at constant speed",
        )
    if velocity != scenario.platoon.initial_speed:
        raise _refusal(
            scenario,
            f"begins at {velocity!r} m/s and platoon.initial_speed = "
            f"{scenario.platoon.initial_speed!r} m/s. Give the same",
        )
    for name, column in zip(("pose", "twist", "accel"), columns, strict=True):
        if not np.isfinite(column[: scenario.samples]).all():
            raise _refusal(scenario, f"has a {name} that is not finite. Record it again")

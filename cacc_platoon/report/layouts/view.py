"""Whose platoon the layouts show: that of a scenario file, a run folder or any bag."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from cacc_platoon.bags.raw import Progress
from cacc_platoon.bags.read import read_bag
from cacc_platoon.errors import UserError
from cacc_platoon.figures.style import vehicle_colours
from cacc_platoon.runs.folder import SCENARIO_FILE, RunFolder
from cacc_platoon.runs.locate import locate
from cacc_platoon.runs.recorded_scenario import identify
from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.scenario.file import load_scenario
from msg_adapters.topics import Graph, VehicleTopics

SCENARIO_SUFFIXES = (".yaml", ".yml")


@dataclass(frozen=True)
class View:
    """What the layouts are for.

    Attributes
    ----------
    scenario : Scenario
        Whose platoon is shown.
    graph : Graph
        Its topics.
    storage : Path or None
        The MCAP file to show; None for a run that has not been recorded yet.
    """

    scenario: Scenario
    graph: Graph
    storage: Path | None = None

    @classmethod
    def of_scenario(cls, scenario: Scenario, storage: Path | None = None) -> View:
        """Return the view of a platoon that publishes what its scenario asks for."""
        return cls(scenario, Graph.of(scenario), storage)

    def vehicle(self, index: int) -> VehicleTopics:
        """Return the topics of a vehicle."""
        return self.graph.vehicles[index]

    def follower(self, index: int) -> Follower:
        """Return the parameters of a follower."""
        return self.scenario.follower(index)

    @property
    def length(self) -> float:
        """From the leader to the last vehicle at the start [m]."""
        speed = self.scenario.platoon.initial_speed
        return sum(
            follower.standstill_distance + follower.gains.time_headway * speed
            for follower in self.scenario.followers
        )

    def colours(self) -> dict[int, str]:
        """Return one colour a vehicle as #rrggbb, from the leader's dark to the last one's light.

        They are those of the report's figures.
        """
        vehicles = self.scenario.vehicles
        return dict(zip(vehicles, map(_hexadecimal, vehicle_colours(len(vehicles))), strict=True))


def view_of(
    path: Path,
    *,
    settings: Iterable[str] = (),
    scenario: Scenario | None = None,
    namespace: str | None = None,
    progress: Progress | None = None,
) -> View:
    """Return what a scenario file, a run folder or a bag shows.

    Parameters
    ----------
    path : Path
        A scenario file (.yaml), a run folder, a bag's folder or a storage file.
    settings : iterable of str, optional
        `key=value` texts that replace values of a scenario file.
    scenario : Scenario, optional
        Parameters of a bag, instead of those in it.
    namespace : str, optional
        Which platoon, when the bag holds several.
    progress : callable, optional
        Called periodically with what is being done, how much is done and how much there is.

    Raises
    ------
    UserError
        When there is no platoon to show, or nothing says what its parameters are.
    """
    if path.suffix in SCENARIO_SUFFIXES and not path.is_dir():
        return View.of_scenario(load_scenario(path, settings))
    if settings:
        raise UserError(
            f"{path}: was recorded with its own parameters, --set cannot change them. Leave it "
            "out, or give a scenario file."
        )
    bag, folder = locate(path)
    if folder and scenario is None and namespace is None and (folder / SCENARIO_FILE).is_file():
        return View.of_scenario(RunFolder(folder).scenario(), _storage(bag))
    raw = read_bag(bag, progress)
    known = identify(raw, folder, scenario, namespace, [])
    graph = Graph.of(known)
    first = graph.vehicles[known.indices[0]]
    graph = dataclasses.replace(
        graph,
        command=first.command.name in raw.topics,
        spacing_error=first.spacing_error.name in raw.topics,
    )
    return View(known, graph, _storage(bag))


def _storage(bag: Path) -> Path | None:
    """Return the one MCAP file of a bag, None when there is none or more."""
    files = [bag] if bag.is_file() else sorted(bag.glob("*.mcap"))
    return files[0] if len(files) == 1 and files[0].suffix == ".mcap" else None


def _hexadecimal(colour: tuple[float, ...]) -> str:
    return "#" + "".join(f"{round(255 * part):02x}" for part in colour[:3])

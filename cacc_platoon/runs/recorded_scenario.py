"""The parameters of a recorded run: where a bag tells them, and how they fit what is there."""

from __future__ import annotations

import contextlib
import dataclasses
from itertools import islice
from pathlib import Path

from cacc_platoon.bags.read import RawBag
from cacc_platoon.runs.find_platoons import FoundPlatoon
from cacc_platoon.runs.folder import SCENARIO_FILE
from cacc_platoon.runs.sample_grid import Grid
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import parse_scenario, scenario_name, scenario_version
from cacc_platoon.scenario.parameter import ScenarioError
from cacc_platoon.texts import TextError, read_text
from msg_adapters.text import decode_string
from msg_adapters.topics import PlatoonTopics

_MOST_TEXTS = 3
"""Of one topic, which is latched and has one."""


def recorded_scenario(
    raw: RawBag, prefix: str | None, folder: Path | None, notes: list[str]
) -> Scenario | None:
    """Return the scenario that the bag, its metadata or its folder carries, the first readable."""
    names = [name for name in raw.topics if name.endswith("/scenario")]
    prefixes = [name.removesuffix("/scenario") for name in names] if prefix is None else [prefix]
    texts = [(PlatoonTopics(one).scenario, text) for one in prefixes for text in _texts(raw, one)]
    if "scenario" in raw.custom_data:
        texts.append(("metadata.yaml: scenario", raw.custom_data["scenario"]))
    file = folder / SCENARIO_FILE if folder else None
    if file and file.is_file():
        with contextlib.suppress(TextError):
            texts.append((str(file), read_text(file)))
            if texts[0][1] != texts[-1][1]:
                notes.append(f"{SCENARIO_FILE} is not the scenario in the bag, which is judged")
    for source, text in texts:
        scenario_version(text, f"{raw.path}: {source}")
        try:
            scenario = parse_scenario(text, source)
        except ScenarioError as error:
            notes.append(f"the scenario in the bag is damaged: {error}")
            continue
        name = folder.resolve().name if folder else raw.path.resolve().name
        return dataclasses.replace(scenario, name=scenario_name(text) or name)
    return None


def _texts(raw: RawBag, prefix: str) -> list[str]:
    """Return the texts on a platoon's latched topic; of the right sort there is one."""
    parts = raw.topics.get(PlatoonTopics(prefix).scenario, [])
    messages = (data for part in parts for data in part.messages())
    return [decode_string(data) for data in islice(messages, _MOST_TEXTS)]


def altered_scenario(raw: RawBag, prefix: str) -> str:
    """Say so where a bag's copies of its scenario differ; no digest covers them."""
    described = raw.custom_data.get("scenario")
    published = _texts(raw, prefix)
    if described is None or not published or published[0] == described:
        return ""
    return (
        "the scenario in the bag is not the one that metadata.yaml has: one of them was altered, "
        "and which numbers the platoon had is not known"
    )


def fit_to_topics(
    scenario: Scenario, platoon: FoundPlatoon, notes: list[str], given: bool
) -> Scenario:
    """Return the scenario with the topics' namespace, and as many vehicles when it was given."""
    found, followers, indices = max(platoon.vehicles), scenario.platoon.followers, scenario.indices
    first, last = indices[0], indices[-1]
    if given and found != last and found >= first and not isinstance(scenario.vehicle.tau, tuple):
        overrides = {i: own for i, own in scenario.overrides.items() if i <= found}
        scenario = dataclasses.replace(scenario, overrides=overrides)
        followers = found - first + 1
    elif found > last:
        notes.append(
            f"vehicles {last + 1} to {found} are in the bag but not in the scenario; left out"
        )
    place = dataclasses.replace(scenario.platoon, namespace=platoon.prefix, followers=followers)
    return dataclasses.replace(scenario, platoon=place)


def cut_to_samples(scenario: Scenario, grid: Grid, notes: list[str]) -> Scenario:
    """Return the scenario with the step and the duration of what is there."""
    run = scenario.run
    if grid.step != scenario.step_ns:
        notes.append(
            f"stamps are {grid.step / 1e9:g} s apart where the scenario has {run.step:g} s"
        )
        run = dataclasses.replace(run, step=grid.step / 1e9)
    elif not grid.exact:
        notes.append("stamps are on no common grid (wall time); values are interpolated to one")
    elif grid.samples != scenario.samples:
        notes.append(
            f"the run has {grid.samples} samples ({(grid.samples - 1) * run.step:g} s) of the "
            f"scenario's {scenario.samples} ({run.duration:g} s)"
        )
    if grid.samples != scenario.samples:
        run = dataclasses.replace(run, duration=(grid.samples - 1) * run.step)
    return dataclasses.replace(scenario, run=run)

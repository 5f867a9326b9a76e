"""The parameters of a recorded run: where a bag tells them, and how they fit what is there."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from cacc_platoon.bags.raw import BagError
from cacc_platoon.bags.read import RawBag
from cacc_platoon.runs.find_platoons import FoundPlatoon, find_platoons
from cacc_platoon.runs.folder import SCENARIO_FILE
from cacc_platoon.runs.sample_grid import Grid
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import parse_scenario, scenario_name, scenario_version
from cacc_platoon.scenario.parameter import ScenarioError
from cacc_platoon.texts import TextError, read_text
from msg_adapters.text import decode_string
from msg_adapters.topics import PlatoonTopics

_NAMED_TOPICS = 3
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
    if grid.samples != scenario.samples:
        run = dataclasses.replace(run, duration=(grid.samples - 1) * run.step)
    return dataclasses.replace(scenario, run=run)


def cut_short(scenario: Scenario, cut: Scenario) -> str:
    """Say how much of its scenario a run has; empty where it has all, or another grid."""
    if cut.samples == scenario.samples or cut.run.step != scenario.run.step:
        return ""
    return (
        f"the run has {cut.samples} samples ({(cut.samples - 1) * cut.run.step:g} s) of the "
        f"scenario's {scenario.samples} ({scenario.run.duration:g} s)"
    )


def identify(
    raw: RawBag,
    folder: Path | None,
    given: Scenario | None,
    namespace: str | None,
    notes: list[str],
) -> Scenario:
    """Return the parameters of the platoon of a bag that is meant.

    Parameters
    ----------
    raw : RawBag
        The bag.
    folder : Path or None
        The run folder around it.
    given : Scenario or None
        Parameters to use instead of those in the bag.
    namespace : str or None
        Which platoon, when the bag holds several.
    notes : list of str
        What is wrong or left out is appended, one line each.

    Raises
    ------
    BagError
        When there is no platoon in the bag, or nothing says what its parameters are.
    """
    platoons = find_platoons(raw.topics)
    if not any(platoon.messages for platoon in platoons):
        raise BagError(f"{raw.path}: {_why_no_platoon(raw)}")
    hint = given or recorded_scenario(raw, None, None, [])
    platoon = _choose(platoons, raw.path, namespace, hint)
    notes += _other_platoons(platoons, platoon, raw)
    return _scenario(raw, platoon, folder, given, notes)


def _scenario(
    raw: RawBag,
    platoon: FoundPlatoon,
    folder: Path | None,
    given: Scenario | None,
    notes: list[str],
) -> Scenario:
    """Return the parameters of the chosen platoon."""
    scenario = given or recorded_scenario(raw, platoon.prefix, folder, notes)
    if scenario is None:
        why = next((f" ({note})" for note in notes if "scenario" in note), "")
        raise BagError(
            f"{raw.path}: holds no scenario that can be read{why}, so d, h_w and the gains are "
            "unknown. Give the run's parameters with --scenario FILE."
        )
    return fit_to_topics(scenario, platoon, notes, given is not None)


def _why_no_platoon(raw: RawBag) -> str:
    damage = f" ({raw.damage[0]})" if raw.damage else ""
    names = sorted(raw.topics)
    if not names:
        return f"holds no message{damage}. Record it again."
    shown = ", ".join(names[:_NAMED_TOPICS]) + (", ..." if len(names) > _NAMED_TOPICS else "")
    return (
        f"holds no platoon, only {shown}{damage}. A platoon's topics are called "
        "<prefix>/vehicle_<i>/pose, twist, accel and v2v/accel."
    )


def _choose(
    platoons: list[FoundPlatoon], bag: Path, namespace: str | None, scenario: Scenario | None
) -> FoundPlatoon:
    by_prefix = {platoon.prefix: platoon for platoon in platoons}
    if namespace is not None:
        if namespace not in by_prefix:
            raise BagError(
                f"{bag}: has no platoon {namespace}. It has {', '.join(sorted(by_prefix))}."
            )
        return by_prefix[namespace]
    if scenario is not None and scenario.platoon.namespace in by_prefix:
        return by_prefix[scenario.platoon.namespace]
    return platoons[0]


def _other_platoons(
    platoons: list[FoundPlatoon], chosen: FoundPlatoon, raw: RawBag
) -> Iterator[str]:
    for platoon in platoons:
        if platoon is not chosen:
            yield (
                f"a second platoon, {platoon.prefix or '/'} ({len(platoon.vehicles)} vehicles, "
                f"{platoon.messages} messages), is in the bag and left out; --namespace chooses it"
            )

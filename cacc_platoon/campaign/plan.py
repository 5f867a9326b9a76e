"""Which fault happens to which platoon, when: a pure function of a seed and a number."""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

from cacc_platoon.errors import UserError
from cacc_platoon.scenario import Scenario
from msg_adapters.topics import Graph


class Moment(StrEnum):
    """What the platoon is doing when the fault comes."""

    START = "start"
    MATCH = "match"
    RUN = "run"
    MERGE = "merge"
    REPORT = "report"


LATE = (Moment.MERGE, Moment.REPORT)
EARLY = (Moment.START, Moment.MATCH, Moment.RUN)
ALWAYS = tuple(Moment)
PROCESSES = ("supervisor", "forkserver", "host")
LOCKSTEP, WALL = "lockstep", "wall"
STALL = 3.0
"""run.stall_timeout where a fault lasts for longer [s]; elsewhere it stays what it is."""
SILENCE = 2.0 * STALL + 5.0
"""So long after its last word hosts take the supervisor for gone [s]."""


class Kind(NamedTuple):
    """What may happen.

    Attributes
    ----------
    what : str
        In a few words.
    targets : tuple of str
        To whom: processes, "topic" for any topic of the platoon, "control" for those that are not
        recorded, "data" for those that are, or a topic's last names.
    moments : tuple of Moment
        When.
    amounts : tuple of float
        Between which limits the amount is drawn: seconds, or messages.
    variants : tuple of str
        How.
    syncs : tuple of str
        In which kinds of run.
    lossy : bool, optional
        Whether the platoon has to lose packets; by default either.
    """

    what: str
    targets: tuple[str, ...]
    moments: tuple[Moment, ...]
    amounts: tuple[float, float] = (0.0, 0.0)
    variants: tuple[str, ...] = ("",)
    syncs: tuple[str, ...] = (LOCKSTEP, WALL)
    lossy: bool | None = None


IN_RUN = (Moment.RUN,)
SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
FORGED_STATES = ("part", "process", "stranger", "node", "record", "event", "closed")
FORGED_STATUSES = ("finished", "failed", "rival", "start")

KINDS: Mapping[str, Kind] = {
    "kill": Kind("kill -9", PROCESSES, ALWAYS),
    "kill_restarted": Kind("kill -9 with run.restarts", ("host",), IN_RUN, syncs=(WALL,)),
    "signal": Kind(
        "a signal that asks for the end", ("supervisor", "host"), ALWAYS, (0, 0), SIGNALS
    ),
    "signal_twice": Kind("the same twice within 0.1 s", ("supervisor",), ALWAYS, (0, 0), SIGNALS),
    "freeze": Kind("a pause shorter than run.stall_timeout", PROCESSES, ALWAYS, (0.2, 1.2)),
    "freeze_long": Kind("a longer one", ("host",), IN_RUN, (STALL + 1.0, STALL + 2.0)),
    "freeze_supervisor": Kind(
        "one so long that hosts give it up", ("supervisor",), IN_RUN, (SILENCE + 1, SILENCE + 2)
    ),
    "flood": Kind(
        "10^4 to 10^5 messages", ("topic",), IN_RUN, (1e4, 1e5), ("like ours", "nonsense")
    ),
    "forged_state": Kind(
        "a host_state of the right shape", ("host_state",), IN_RUN, (0, 0), FORGED_STATES
    ),
    "forged_status": Kind(
        "a status of the right shape", ("status",), IN_RUN, (0, 0), FORGED_STATUSES
    ),
    "forged_progress": Kind(
        "progress that nobody can have made", ("recorded",), IN_RUN, (0, 0), ("ahead", "negative")
    ),
    "forged_count": Kind(
        "a count of packets", ("complete",), IN_RUN, (0, 0), ("ahead", "behind"), lossy=True
    ),
    "malformed": Kind("texts that are none of ours", ("texts",), IN_RUN, (5, 50)),
    "oversized": Kind("a text of some MB", ("texts",), IN_RUN, (5, 12)),
    "other_version": Kind("a text of another version", ("texts",), IN_RUN, (1, 100)),
    "foreign_data": Kind(
        "samples from elsewhere", ("data",), IN_RUN, (1, 300), ("ahead", "past", "garbage")
    ),
    "foreign_silent": Kind("a publisher that says nothing", ("topic",), (Moment.MATCH, Moment.RUN)),
    "foreign_deaf": Kind("one of another type", ("topic",), (Moment.MATCH, Moment.RUN)),
    "second_platoon": Kind(
        "a second platoon of the name", ("platoon",), (Moment.START, Moment.RUN)
    ),
    "full_disk": Kind(
        "no file grows any more", ("supervisor", "everybody"), (Moment.MATCH, Moment.RUN)
    ),
    "deleted": Kind("the records are removed", ("parts", "folder"), (Moment.RUN, *LATE)),
    "cut": Kind(
        "the loopback is down for a while",
        ("link",),
        IN_RUN,
        (0.3, 1.2),
        ("short",),
        (LOCKSTEP,),
    ),
    "cut_long": Kind(
        "and for longer than run.stall_timeout",
        ("link",),
        IN_RUN,
        (STALL + 1.0, STALL + 2.0),
        ("long",),
        (LOCKSTEP,),
    ),
}
NEEDS_NAMESPACE = ("cut", "cut_long")
"""Kinds that need a network of their own, which not every machine lets a user make."""


@dataclass(frozen=True)
class Fault:
    """What happens to one platoon; seed and index say all of it.

    Attributes
    ----------
    seed, index : int
        Of the campaign, and which of its faults.
    kind : str
        One of KINDS.
    target : str
        To whom: "supervisor", "forkserver", a node for the host that runs it, a topic, or what else
        the kind names.
    moment : Moment
        When.
    fraction : float
        How far into the moment, 0 to 1.
    amount : float
        Seconds or messages, as the kind has it.
    variant : str
        How.
    sync, hosts : str
        run.sync and run.hosts of the platoon.
    lossy : bool
        Whether it loses packets.
    """

    seed: int
    index: int
    kind: str
    target: str
    moment: Moment
    fraction: float
    amount: float
    variant: str
    sync: str
    hosts: str
    lossy: bool

    @property
    def needs_namespace(self) -> bool:
        """Whether it takes a network of its own."""
        return self.kind in NEEDS_NAMESPACE

    @property
    def process(self) -> str:
        """Which kind of process is meant: one of PROCESSES, empty for another target."""
        if "/" in self.target and not self.target.startswith("/"):
            return "host"
        return self.target if self.target in PROCESSES else ""

    @property
    def how(self) -> str:
        """Variant and amount in a few letters."""
        amount = f"{self.amount:.3g}" if KINDS[self.kind].amounts[1] else ""
        return " ".join(filter(None, [self.variant, amount]))


def scenario_of(fault: Fault, given: Scenario | None = None) -> Scenario:
    """Return the platoon that a fault happens to: short, and paced so that there is time.

    Parameters
    ----------
    fault : Fault
        What will happen to it.
    given : Scenario, optional
        Whose platoon it is; by default a leader and three followers.
    """
    values: dict[str, Any] = {} if given else {"platoon.followers": 3}
    values["run.sync"] = fault.sync
    if fault.kind in ("freeze_long", "freeze_supervisor", "cut_long"):
        values["run.stall_timeout"] = STALL
    values["run.hosts"] = int(fault.hosts) if fault.hosts.isdecimal() else fault.hosts
    if fault.sync == WALL:
        values |= {"run.duration": 8.0, "v2v.reception": "fallback", "v2v.fallback_after": 0.3}
    else:
        values |= {"run.duration": 20.0, "run.real_time_factor": 5.0}
    if fault.kind == "kill_restarted":
        values["run.restarts"] = 1
    if fault.lossy:
        values["v2v.loss"] = 0.2
    return given.with_values(values) if given else Scenario.from_values(values)


def plan(
    seed: int,
    index: int,
    *,
    only: str = "",
    sync: str = "",
    given: Scenario | None = None,
    namespaces: bool = True,
) -> Fault:
    """Return fault `index` of a campaign; it depends on nothing else.

    Parameters
    ----------
    seed, index : int
        Which campaign, and which of its faults.
    only : str, optional
        Draw this kind alone.
    sync : str, optional
        Draw this kind of run alone.
    given : Scenario, optional
        Whose platoon it is.
    namespaces : bool, optional
        Whether a network of its own can be made; without, a fault that needs one is another one.

    Raises
    ------
    UserError
        When there is no such kind, or none for such a run.

    Examples
    --------
    >>> plan(1, 7) == plan(1, 7), plan(1, 7) == plan(2, 7)
    (True, False)
    """
    draw = random.Random(f"{seed}.{index}")
    name = draw.choice(_kinds(only, sync))
    if name in NEEDS_NAMESPACE and not namespaces:
        name = random.Random(f"{seed}.{index}.here").choice(_kinds(only, sync, here=True))
    kind = KINDS[name]
    fault = Fault(
        seed,
        index,
        name,
        draw.choice(kind.targets),
        draw.choice(kind.moments),
        draw.random(),
        draw.uniform(*kind.amounts),
        draw.choice(kind.variants),
        draw.choice([one for one in kind.syncs if sync in ("", one)]),
        draw.choice(["1", "2", "2", "per_node"]),
        draw.random() < 0.5 if kind.lossy is None else kind.lossy,
    )
    return _aimed(fault, Graph.of(scenario_of(fault, given)), draw)


def _kinds(only: str, sync: str, *, here: bool = False) -> list[str]:
    """Return the kinds to draw from; `here`, those that need no network of their own."""
    if only and only not in KINDS:
        raise UserError(f"{only} is no kind of fault. Take one of {', '.join(KINDS)}.")
    found = [name for name in KINDS if only in ("", name)]
    if sync:
        found = [name for name in found if sync in KINDS[name].syncs]
    if not found:
        raise UserError(f"{only} does not happen to runs with run.sync = {sync}. Leave one out.")
    if here:
        found = [name for name in found if name not in NEEDS_NAMESPACE]
    if not found:
        raise UserError(f"{only} needs a network of its own, and `unshare -r -n` fails here.")
    return found


def topics_of(graph: Graph, host: str = "0") -> tuple[list[str], list[str]]:
    """Return the topics of a platoon that are not recorded, and those that are."""
    of = graph.platoon
    control = [of.status, of.host_state, of.horizon, of.recorded(host), of.events, of.scenario]
    return control, [topic.name for topic in graph.recorded]


def _aimed(fault: Fault, graph: Graph, draw: random.Random) -> Fault:
    """Return a fault with the node or the topic that it happens to."""
    control, data = topics_of(graph)
    counts = [links.complete.name for links in graph.counted_links.values()]
    choices: dict[str, list[str]] = {
        "host": [str(node) for node in graph.nodes],
        "control": control,
        "data": data,
        "topic": [draw.choice(control), draw.choice(data)],
        "texts": [graph.platoon.status, graph.platoon.host_state],
        "status": [graph.platoon.status],
        "host_state": [graph.platoon.host_state],
        "recorded": [graph.platoon.recorded("0")],
        "complete": counts,
    }
    target = draw.choice(choices.get(fault.target, [fault.target]))
    return Fault(**{**vars(fault), "target": target})

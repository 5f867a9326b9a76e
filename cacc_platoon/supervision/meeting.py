"""How a host that was started on its own meets a run, and whether it does its part in it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from cacc_platoon.errors import UserError
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import parse_scenario
from cacc_platoon.scenario.remote_hosts import RemoteHost, vehicles_text
from cacc_platoon.supervision.protocol import ProtocolError, RunPhase, RunStatus, text_digest


@dataclass(frozen=True)
class Wishes:
    """What whoever starts a host wants of it.

    Attributes
    ----------
    name : str
        By which it meets the supervisor.
    namespace : str
        Of the platoon.
    vehicles : tuple of int
        What it has to run; empty for whatever the supervisor's scenario says.
    parts : Path, optional
        The folder in which it records, in one of its own. By default one below runs/, which goes
        when the supervisor has everything.
    timeout : float
        How long a run may take to come [s].
    own_code : bool
        Whether the scenario may name code of this machine.
    attached : bool
        Whether the host ends when its standard input does.
    """

    name: str
    namespace: str
    vehicles: tuple[int, ...] = ()
    parts: Path | None = None
    timeout: float = 300.0
    own_code: bool = False
    attached: bool = False


class Met(NamedTuple):
    """A run that waits for hosts, and what it runs."""

    run: str
    scenario: Scenario


class Matchmaker:
    """Pairs what a supervisor says of its run with the scenario of that run.

    Of two supervisors, one of which has ended and not left, the scenario of the other one counts.

    Parameters
    ----------
    source : str
        Name of the scenario's topic, for error lines.
    """

    def __init__(self, source: str) -> None:
        self._source = source
        self._texts: dict[str, str] = {}
        self._waiting: RunStatus | None = None

    def take_scenario(self, text: str) -> None:
        """Take note of a scenario's text; the last few count."""
        self._texts = {**dict([*self._texts.items()][-3:]), text_digest(text): text}

    def take_status(self, text: str) -> None:
        """Take note of a supervisor's status; what is none is nobody's."""
        try:
            status = RunStatus.from_json(text)
        except ProtocolError:
            return
        if status.phase is RunPhase.WAITING:
            self._waiting = status
        elif self._waiting and status.run == self._waiting.run:
            self._waiting = None

    def met(self) -> Met | None:
        """Return the run that waits and its scenario, once both are known.

        Raises
        ------
        UserError
            When the scenario is none.
        """
        if self._waiting is None or self._waiting.scenario not in self._texts:
            return None
        text = self._texts[self._waiting.scenario]
        return Met(self._waiting.run, parse_scenario(text, self._source))


def own_host(wishes: Wishes, scenario: Scenario) -> RemoteHost:
    """Return what the scenario gives to the host.

    Raises
    ------
    UserError
        When that is nothing.
    """
    for host in scenario.remote_hosts:
        if host.name == wishes.name:
            return host
    known = ", ".join(map(str, scenario.remote_hosts)) or "none"
    raise UserError(
        f"the run of {wishes.namespace} has no host {wishes.name}, it waits for: {known}. Name one "
        f"of those, or give the supervisor run.remote_hosts with {wishes.name}=VEHICLES."
    )


def objection(wishes: Wishes, host: RemoteHost, scenario: Scenario) -> str:
    """Say why a host does not do its part in a run; empty when it does."""
    if wishes.vehicles and wishes.vehicles != host.vehicles:
        return (
            f"host {host.name} was started for the vehicles {vehicles_text(wishes.vehicles)}, but "
            f"run.remote_hosts gives it {vehicles_text(host.vehicles)}. Give both the same"
        )
    own = [one for one in scenario.followers if one.index in host.vehicles]
    code = sorted({f"{name} = {text}" for one in own for name, text in one.own_code.items()})
    if code and not wishes.own_code:
        return (
            f"host {host.name}: the scenario names code, {code[0]}, which comes over the network. "
            "Start the host with --own-code if it may run what this machine has of that name"
        )
    return ""

"""The rules of a run whose vehicles keep time by clocks: nobody waits for anybody."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from cacc_platoon.runs.info import ClockOffset, EndStatus
from cacc_platoon.scenario.run_event import EventKind, RunEvent
from cacc_platoon.supervision.ending import leave
from cacc_platoon.supervision.pacing import end_by_clocks, sample_by_clocks, start_by_clocks
from cacc_platoon.supervision.pausing import Asked
from cacc_platoon.supervision.protocol import HostState
from cacc_platoon.supervision.run_events import Action, EndRun, HostReported, RestartHost, Tell
from cacc_platoon.supervision.run_machine import RunMachine, Step
from cacc_platoon.supervision.run_state import OWN_HOST, Run, Stage, joined, some, warn

Value = TypeVar("Value")


def system_ahead() -> float:
    """Return by how much the system's clock is ahead of the steady one [s]."""
    return time.time() - time.monotonic()


class ClockMachine(RunMachine):
    """As `RunMachine`; but the run goes on when a process ends or stops, to its planned end.

    Parameters
    ----------
    arguments
        As there.
    ahead : callable
        Returns by how much the clock of the machine, by which hosts agree on a start, is ahead of
        that by which `step` is told the time [s]; asked when the start is told.
    """

    asks_clocks = True

    def __init__(self, *arguments: Any, ahead: Callable[[], float], **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._ahead = ahead

    def _start(self, run: Run) -> float:
        """Return when sample 0 is due [s]."""
        assert run.started is not None
        return start_by_clocks(self.scenario, run.started)

    def _pace(self, run: Run, now: float) -> Step:
        """Say when the run starts, and note how far anybody can be."""
        start = run.start or round((self._start(run) + self._ahead()) * 1e9)
        reach = min(self.samples - 1, sample_by_clocks(self.scenario, now - self._start(run)))
        return run._replace(start=start, reach=max(run.reach, reach)), []

    def refuses(self, _run: Run, _asked: Asked) -> str:
        """Say that there is no pause."""
        return "vehicles keep time by clocks (run.sync = wall), which cannot be stopped"

    def simulated(self, run: Run, now: float) -> int:
        """Return the simulated time [ns] by the clocks; 0 before they begin."""
        if run.started is None:
            return 0
        due = int((now - self._start(run)) / self.scenario.run.clock_period)
        return self.scenario.step_ns * max(0, min(due, self.samples - 1))

    def _take_host(self, run: Run, report: HostReported) -> Step:
        """Measure the clock of a host too that answers; its shortest round trip counts."""
        state = report.state
        if state.pid in run.gone:
            return run, []
        run, actions = super()._take_host(run, report)
        if run.hosts.get(state.host) is not state or not 0 < state.answers <= report.returned:
            return run, actions
        offset = ClockOffset.measured(state.answers, state.answered, report.returned)
        known = run.offsets.get(state.host)
        if known and known.uncertainty <= offset.uncertainty:
            return run, actions
        run = run._replace(offsets={**run.offsets, state.host: offset})
        beginning = f"host {state.host}: its clock is "
        told = any(line.startswith(beginning) for line in run.warned)
        if told or offset.least <= 0.5 * self.scenario.run.clock_period:
            return run, actions
        run, warnings = warn(run, [beginning + _apart(offset)])
        return run, [*actions, *warnings]

    def _doubt(self, run: Run, state: HostState) -> str:
        return "" if state.pid in run.gone else super()._doubt(run, state)

    def _take_recorded(self, run: Run, host: str, sample: int, now: float) -> Step:
        if run.stage is Stage.RUNNING:
            run, _ = self._pace(run, now)
        return super()._take_recorded(run, host, sample, now)

    def _stop(self, run: Run, now: float) -> Step | None:
        """End a run that cannot go on: while it runs, a process that has ended is none such."""
        if run.stage is not Stage.RUNNING:
            return super()._stop(run, now)
        stopped = super()._stop(run._replace(ended_processes={}), now)
        if stopped is None:
            return None
        after, actions = stopped
        return after._replace(ended_processes=run.ended_processes), actions

    def _go_on(self, run: Run, now: float) -> Step:
        run, _ = self._pace(run, now)
        run, told = self._without_ended(run)
        lost = [self.process_ended(run, one) for one in run.ended_processes.values()]
        end = None
        awaited = [host for host in run.restarts if _is_awaited(run, host)]
        slowest = min(run.recorded.values(), default=self.last_sample(run))
        if slowest >= self.last_sample(run) and not awaited:
            end = EndRun(EndStatus.FAILED, joined(lost)) if lost else EndRun(EndStatus.FINISHED)
        elif now - self._start(run) > end_by_clocks(self.scenario, restarted=bool(run.restarts)):
            away = [f"host {host}, which was started again, is not there" for host in awaited]
            over = "not everything was recorded when the run had to be over"
            message = joined([*lost, *away, over])
            end = EndRun(EndStatus.FAILED, message, stalled=True)
        if end:
            run, actions = leave(run._replace(ended=now), end, now)
            return run, [*told, *actions]
        return run, [*told, *self._look_now_and_then(run, now)]

    def _without_ended(self, run: Run) -> Step:
        """Wait no longer for hosts whose processes are gone, and tell everybody once."""
        told: list[Action] = []
        run, again = self._restarted(run)
        for host, ended in run.ended_processes.items():
            line = self.process_ended(run, ended)
            run, warnings = warn(run, [line])
            if warnings or host in run.recorded:
                event = RunEvent(EventKind.FAULT, max(run.progress, 0), OWN_HOST, line)
                told += [*warnings, Tell(event)]
            recorded = _without(run.recorded, host)
            progress = min(recorded.values(), default=run.progress)
            run = run._replace(recorded=recorded, progress=max(run.progress, progress))
        return run, [*again, *told]

    def _restarted(self, run: Run) -> Step:
        """Start processes again that have ended, as often as the user wants that."""
        told: list[Action] = []
        for host, ended in run.ended_processes.items():
            times = run.restarts.get(host, 0)
            if host not in run.processes or times >= self.scenario.run.restarts:
                continue
            run, warnings = warn(run, [f"{self.process_ended(run, ended)}, and is started again"])
            sample = max(run.progress, 0)
            fault = RunEvent(EventKind.FAULT, sample, OWN_HOST, self.process_ended(run, ended))
            again = RunEvent(EventKind.RESTART, sample, OWN_HOST, _named(run, host))
            told += [*warnings, Tell(fault), RestartHost(host), Tell(again)]
            run = run._replace(
                gone=(*run.gone, ended.pid),
                restarts={**run.restarts, host: times + 1},
                ended_processes=_without(run.ended_processes, host),
                processes=_without(run.processes, host),
                recorded=_without(run.recorded, host),
            )
        return run, told


def _is_awaited(run: Run, host: str) -> bool:
    """Return whether a host is being started again and has not appeared."""
    if host in run.ended_processes:
        return False
    return host not in run.hosts or run.hosts[host].pid in run.gone


def _named(run: Run, host: str) -> str:
    """Name a host and its nodes."""
    return f"host {host}: {some(run.hosts[host].nodes)}" if host in run.hosts else f"host {host}"


def _without(those: Mapping[str, Value], host: str) -> dict[str, Value]:
    """Return a mapping without a host."""
    return {name: value for name, value in those.items() if name != host}


def _apart(offset: ClockOffset) -> str:
    """Say how far a clock is from ours, and what that means."""
    way = "ahead of" if offset.offset > 0 else "behind"
    return (
        f"{1e3 * abs(offset.offset):.3g} ms {way} the supervisor's (to within "
        f"{1e3 * offset.uncertainty:.2g} ms), more than half a control period: its vehicles take "
        "their samples at other times than the others. Synchronise the clocks (chrony, PTP)"
    )

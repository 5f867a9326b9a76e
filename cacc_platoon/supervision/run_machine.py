"""What happens in a run, and what is to be done then, without a clock, a process or a message.

`RunMachine.step` takes the state of a run, an event and the time, and returns the next state and
the actions to carry out. Only a Tick and a GraphObserved decide; other events are taken down, and
answered where an answer cannot wait (the horizon, a new recorder). So events may be fed from
anywhere, at any time, and actions carried out at once. A run of actions and states follows from
the list of events and times alone, and can be repeated from it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

from cacc_platoon.runs.info import EndStatus
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.run_event import EventKind, RunEvent
from cacc_platoon.supervision.agreement import disagreements
from cacc_platoon.supervision.belief import FOREIGN, Belief, beyond
from cacc_platoon.supervision.newcomers import (
    ADVICE,
    NEWCOMER_WAIT,
    looked_enough,
    met,
    without_rival,
)
from cacc_platoon.supervision.pacing import furthest_sample, horizon, stall_limit, start_limit
from cacc_platoon.supervision.protocol import HostState, RunPhase, RunStatus, sendable
from cacc_platoon.supervision.run_events import (
    Action,
    Announce,
    CloseOwnHost,
    EndRun,
    Event,
    FollowRecorder,
    GraphObserved,
    HostReported,
    HostsStarted,
    MeansLost,
    MessageRefused,
    ObserveGraph,
    ProcessEnded,
    PublishHorizon,
    PublishStatus,
    Recorded,
    RecordersConnected,
    RecordTheRest,
    RivalHeard,
    StartHosts,
    Tell,
    Tick,
)
from cacc_platoon.supervision.run_state import (
    NAMED_FAILURES,
    Run,
    Stage,
    connections_left,
    joined,
    not_in_time,
    refuse,
    silent_hosts,
    some,
    spoiled,
    summaries,
    unmatched,
    wanted_subscribers,
    warn,
    whose_process,
    with_news,
)
from msg_adapters.topics import PlatoonTopics

GOODBYE_TIMEOUT = 3.0
"""How long hosts may take to close their parts [s]."""
GRAPH_PERIOD = 0.5
"""How often the graph is looked at [s]; every look takes time."""
HEARTBEAT_PERIOD = 0.2
"""How often the supervisor says that it lives [s]."""
OWN_HOST = "supervisor"
"""Name of the host in the supervisor's process."""


Step = tuple[Run, list[Action]]


class RunMachine:
    """The rules of a run.

    Parameters
    ----------
    scenario : Scenario
        What is run.
    topics : iterable of str
        What has to be recorded.
    belief : Belief
        Whose word counts.
    nodes : iterable of str, optional
        Which nodes have to appear; those of the scenario by default.
    samples : int, optional
        How many samples it takes; those of the scenario by default.
    newcomer_wait : float, optional
        How long to look around before hosts are started [s].
    """

    def __init__(
        self,
        scenario: Scenario,
        topics: Iterable[str],
        belief: Belief,
        *,
        nodes: Iterable[str] | None = None,
        samples: int | None = None,
        newcomer_wait: float = NEWCOMER_WAIT,
    ) -> None:
        self.scenario = scenario
        self.samples = scenario.samples if samples is None else samples
        self._topics, self._belief = tuple(topics), belief
        self._nodes = tuple(scenario.node_names if nodes is None else nodes)
        self._newcomer_wait = newcomer_wait
        self._start_limit, self._stall_limit = start_limit(scenario), stall_limit(scenario)
        platoon = PlatoonTopics(scenario.platoon.namespace)
        self._changes = scenario.changes
        self._control = (platoon.status, platoon.horizon, platoon.scenario)

    def begin(self, run_id: str, now: float) -> Run:
        """Return the state of a run that begins."""
        return Run(run_id, Stage.LOOKING, now)

    def publishers(self, run: Run) -> Mapping[str, frozenset[str]]:
        """Return which nodes may publish each topic of the platoon by now."""
        return self._belief.publishers(run.hosts, started=run.stage is not Stage.LOOKING)

    def status(self, run: Run, outside: Mapping[str, int] | None = None) -> RunStatus:
        """Return the status to publish.

        Parameters
        ----------
        run : Run
            The state of the run.
        outside : mapping of str to int, optional
            While matching: subscribers outside of the platoon for each data topic. They are
            waited for too, so they miss nothing.
        """
        return RunStatus(
            run=run.id,
            phase=run.phase,
            sample=run.progress,
            samples=self.last_sample(run) + 1,
            message=sendable(run.end.message) if run.end else "",
            hosts=summaries(run),
            subscribers=wanted_subscribers(run, outside) if outside else {},
        )

    def last_sample(self, run: Run) -> int:
        """Return the sample at which a run ends, as far as that is known."""
        return self.samples - 1 if run.collided is None else min(self.samples - 1, run.collided)

    def step(self, run: Run, event: Event, now: float) -> Step:
        """Return the next state of a run and what is to be done.

        Parameters
        ----------
        run : Run
            The state so far.
        event : Event
            What happened.
        now : float
            When, by a clock that never goes back [s].
        """
        step: Step
        match event:
            case Recorded(host, sample):
                step = self._take_recorded(run, host, sample, now)
            case Tick():
                step = self._with_heartbeat(*self._judge(run, now), now)
            case HostReported(state):
                step = self._take_host(run, state)
            case GraphObserved():
                warned, warnings = warn(run, event.harmless)
                run, actions = self._judge_graph(warned, event, now)
                step = run, [*warnings, *actions]
            case RivalHeard():
                step = met(run, event, now, self._control[0]), []
            case HostsStarted(processes):
                step = self._take_processes(run, processes), []
            case RecordersConnected(hosts):
                step = run._replace(connected=hosts), []
            case MessageRefused(reason) | MeansLost(reason):
                step = refuse(run, reason), []
            case ProcessEnded():
                ended = {**run.ended_processes, event.host: event}
                step = run._replace(ended_processes=ended), []
            case _:
                step = run._replace(signal=run.signal or event.name), []
        return step

    # What happens is taken down ...

    def _take_recorded(self, run: Run, host: str, sample: int, now: float) -> Step:
        if host not in run.recorded:
            return run, []
        if sample > run.reach:
            return refuse(run, beyond(host, sample, run.reach)), []
        recorded = {**run.recorded, host: max(sample, run.recorded[host])}
        progress = min(recorded.values())
        if progress <= run.progress or run.phase is not RunPhase.RUNNING:
            return run._replace(recorded=recorded), []
        return self._pace(run._replace(recorded=recorded, progress=progress, moved=now), now)

    def _take_host(self, run: Run, state: HostState) -> Step:
        if state.run != run.id:
            return run, []
        if doubt := self._doubt(run, state):
            return refuse(run, doubt), []
        actions: list[Action] = []
        recorded = run.recorded
        if state.records and state.host not in recorded:
            recorded = {**recorded, state.host: -1}
            actions = [FollowRecorder(state.host)]
        run, news = with_news(run, state, stops=self.scenario.run.stop_on_collision)
        run = run._replace(hosts={**run.hosts, state.host: state}, recorded=recorded)
        return run, [*news, *actions]

    def _doubt(self, run: Run, state: HostState) -> str:
        waiting = run.phase is RunPhase.WAITING
        return self._belief.doubt(state, run.hosts, run.processes, waiting=waiting)

    def _take_processes(self, run: Run, processes: Mapping[str, int]) -> Run:
        """Take note of who was started; who has spoken for them before is judged again."""
        run = run._replace(processes=processes)
        doubts = (self._doubt(run, state) for state in run.hosts.values())
        return refuse(run, *filter(None, doubts))

    # ... and judged at the next tick.

    def _judge(self, run: Run, now: float) -> Step:
        judges: dict[Stage, Callable[[Run, float], Step]] = {
            Stage.STARTING: self._await_nodes,
            Stage.RECORDING: self._await_own_host,
            Stage.MATCHING: self._await_connections,
            Stage.RUNNING: self._watch,
            Stage.NAMING: self._name,
            Stage.LEAVING: self._take_leave,
        }
        judge = judges.get(run.stage, self._look)
        if run.stage in (Stage.NAMING, Stage.LEAVING, Stage.OVER):
            return judge(run, now)
        return self._stop(run, now) or judge(run, now)

    def _stop(self, run: Run, now: float) -> Step | None:
        """End a run that cannot go on."""
        if run.signal:
            return self._fail(run, now, [f"stopped by {run.signal}"])
        if failures := run.failures[:NAMED_FAILURES]:
            if any(FOREIGN in failure for failure in failures) and run.stage is not Stage.LOOKING:
                return run._replace(stage=Stage.NAMING, since=now), [ObserveGraph()]
            return self._fail(run, now, failures)
        for ended in run.ended_processes.values():
            return self._fail(run, now, [self.process_ended(run, ended)])
        return None

    def _name(self, run: Run, now: float) -> Step:
        """Give the graph some time to show who sent a message that is none of ours."""
        if now - run.since > GRAPH_PERIOD:
            return self._fail(run, now, [*run.failures[:NAMED_FAILURES], ADVICE])
        return run, [ObserveGraph()]

    @staticmethod
    def _look(run: Run, _now: float) -> Step:
        return run, [] if run.stage is Stage.OVER else [ObserveGraph()]

    def _judge_graph(self, run: Run, graph: GraphObserved, now: float) -> Step:
        run = run._replace(graph_checked=now, looks=run.looks + graph.settled)
        if run.stage in (Stage.LEAVING, Stage.OVER):
            return run, []
        foreign = without_rival(run, graph.foreign, now, self._control)
        if foreign and run.stage is Stage.NAMING:
            return self._fail(run, now, [*run.failures[:NAMED_FAILURES], foreign[0], ADVICE])
        if foreign:
            return self._fail(run, now, [f"{foreign[0]}. {ADVICE}"])
        if run.stage is Stage.LOOKING and looked_enough(run, now, self._newcomer_wait):
            run = run._replace(stage=Stage.STARTING, since=now, status_published=now)
            return run, [Announce(), PublishStatus(), StartHosts()]
        if run.stage is Stage.CHECKING:
            run = run._replace(stage=Stage.RUNNING, phase=RunPhase.RUNNING, started=now, moved=now)
            run, actions = self._pace(run, now)
            begun = RunEvent(EventKind.START, 0, OWN_HOST)
            return run, [Tell(begun), PublishStatus(), *actions]
        return run, []

    def _await_nodes(self, run: Run, now: float) -> Step:
        present = {node for host in run.hosts.values() for node in host.nodes}
        if missing := [node for node in self._nodes if node not in present]:
            return self._wait_for(run, now, missing, len(missing))
        parameters = {n: p for host in run.hosts.values() for n, p in host.parameters.items()}
        if differing := disagreements(self.scenario, parameters):
            return self._fail(run, now, [f"{some(differing)}. Start it with the run's parameters"])
        covered = {topic for host in run.hosts.values() for topic in host.records}
        if rest := tuple(topic for topic in self._topics if topic not in covered):
            run = run._replace(stage=Stage.RECORDING, since=now, remaining=None)
            return run, [RecordTheRest(rest)]
        return self._match(run, now)

    def _await_own_host(self, run: Run, now: float) -> Step:
        if OWN_HOST not in run.hosts:
            return self._wait_for(run, now, ["recorder"], 1)
        return self._match(run, now)

    @staticmethod
    def _match(run: Run, now: float) -> Step:
        run = run._replace(stage=Stage.MATCHING, since=now, remaining=None)
        return run._replace(phase=RunPhase.MATCHING), [PublishStatus()]

    def _await_connections(self, run: Run, now: float) -> Step:
        if missing := unmatched(run):
            return self._wait_for(run, now, missing, connections_left(run))
        return run._replace(stage=Stage.CHECKING), [ObserveGraph()]

    def _wait_for(self, run: Run, now: float, missing: Sequence[str], remaining: int) -> Step:
        if run.remaining is None or remaining < run.remaining:
            run = run._replace(remaining=remaining, since=now)
        if now - run.since > self._start_limit:
            return self._fail(run, now, [self.late(run, missing, self._start_limit)])
        return run, self._look_now_and_then(run, now)

    def _watch(self, run: Run, now: float) -> Step:
        due = [one for one in self._changes if run.told < one.sample <= run.progress]
        told: list[Action] = [Tell(change.event) for change in due]
        run, actions = self._go_on(run._replace(told=run.progress), now)
        return run, [*told, *actions]

    def _go_on(self, run: Run, now: float) -> Step:
        if run.progress >= self.last_sample(run):
            return self._leave(run._replace(ended=now), EndRun(EndStatus.FINISHED), now)
        if now - run.moved > self._stall_limit:
            message = self.stalled(run, self._stall_limit)
            return self._leave(run, EndRun(EndStatus.FAILED, message, stalled=True), now)
        actions = self._look_now_and_then(run, now)
        if not self.scenario.run.real_time_factor:
            return run, actions
        run, pace = self._pace(run, now)
        return run, [*pace, *actions]

    def _pace(self, run: Run, now: float) -> Step:
        elapsed = 0.0 if run.started is None else now - run.started
        sample = horizon(self.scenario, run.progress, elapsed)
        reach = max(run.reach, furthest_sample(self.scenario, sample))
        return run._replace(reach=reach), [PublishHorizon(sample)]

    @staticmethod
    def _look_now_and_then(run: Run, now: float) -> list[Action]:
        return [ObserveGraph()] if now - run.graph_checked > GRAPH_PERIOD else []

    @staticmethod
    def _with_heartbeat(run: Run, actions: list[Action], now: float) -> Step:
        silent = run.stage in (Stage.LOOKING, Stage.OVER)
        due = now - run.status_published > HEARTBEAT_PERIOD and not silent
        if due and PublishStatus() not in actions:
            actions = [PublishStatus(), *actions]
        if PublishStatus() in actions:
            run = run._replace(status_published=now)
        return run, actions

    # How a run ends.

    def _fail(self, run: Run, now: float, reasons: Sequence[str]) -> Step:
        status = EndStatus.INTERRUPTED if run.signal else EndStatus.FAILED
        end = EndRun(status, joined(reasons))
        if run.stage is Stage.LOOKING:  # nobody knows of this run
            return run._replace(stage=Stage.OVER, phase=RunPhase.FAILED, end=end), [end]
        return self._leave(run, end, now)

    @staticmethod
    def _leave(run: Run, end: EndRun, now: float) -> Step:
        finished = end.status is EndStatus.FINISHED
        phase = RunPhase.FINISHED if finished else RunPhase.FAILED
        run = run._replace(stage=Stage.LEAVING, since=now, phase=phase, end=end)
        return run, [PublishStatus(), CloseOwnHost()]

    def _take_leave(self, run: Run, now: float) -> Step:
        run, actions = spoiled(run)
        assert run.end is not None
        waited_for = silent_hosts(run)
        if waited_for and now - run.since <= GOODBYE_TIMEOUT:
            return run, actions
        end = replace(run.end, silent=tuple(waited_for))
        how = ": ".join(filter(None, [end.status, end.message]))
        over = RunEvent(EventKind.END, max(run.progress, 0), OWN_HOST, sendable(how))
        return run._replace(stage=Stage.OVER, end=end), [*actions, Tell(over), end]

    # The texts; a replay has others.

    def late(self, run: Run, missing: Sequence[str], limit: float) -> str:
        """Say what has not come in time."""
        return not_in_time(run, missing, limit)

    def stalled(self, run: Run, limit: float) -> str:
        """Say that nothing moves on."""
        return f"no progress for {limit:g} s"

    def process_ended(self, run: Run, ended: ProcessEnded) -> str:
        """Say whose process is gone."""
        return whose_process(run, ended)

"""What happens in a run, and what is to be done then, without a clock, a process or a message.

`RunMachine.step` takes the state of a run, an event and the time, and returns the next state and
the actions to carry out. Only a Tick and a GraphObserved decide; other events are taken down, and
answered where an answer cannot wait (the horizon, a new recorder). So events may be fed from
anywhere, at any time, and actions carried out at once. A run of actions and states follows from
the list of events and times alone, and can be repeated from it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from cacc_platoon.runs.info import EndStatus
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.run_event import EventKind, RunEvent
from cacc_platoon.supervision import pausing
from cacc_platoon.supervision.agreement import disagreements
from cacc_platoon.supervision.belief import ADVICE, FOREIGN, Belief, beyond
from cacc_platoon.supervision.ending import fail, leave, take_leave
from cacc_platoon.supervision.newcomers import (
    NEWCOMER_WAIT,
    looked_enough,
    met,
    without_rival,
)
from cacc_platoon.supervision.pacing import (
    furthest_sample,
    horizon,
    known_ahead,
    stall_limit,
    start_limit,
)
from cacc_platoon.supervision.protocol import HostState, RunPhase, RunStatus
from cacc_platoon.supervision.run_events import (
    Action,
    Announce,
    EndRun,
    Event,
    FollowRecorder,
    GraphObserved,
    HostReported,
    HostsStarted,
    MeansLost,
    MessageRefused,
    ObserveGraph,
    PauseAsked,
    ProcessEnded,
    PublishHorizon,
    PublishStatus,
    Recorded,
    RecordersConnected,
    RecordTheRest,
    ResumeAsked,
    RivalHeard,
    SignalReceived,
    StartHosts,
    StepAsked,
    Tell,
    Tick,
)
from cacc_platoon.supervision.run_state import (
    OWN_HOST,
    Run,
    Stage,
    connections_left,
    named_failures,
    not_in_time,
    refuse,
    some,
    status,
    unmatched,
    warn,
    whose_process,
    with_changes,
    with_heartbeat,
    with_news,
)
from msg_adapters.topics import PlatoonTopics

GRAPH_PERIOD = 0.5
"""How often the graph is looked at [s]; every look takes time."""

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
        self._changes, self._known_ahead = scenario.changes, known_ahead(scenario)
        self._control = (platoon.status, platoon.horizon, platoon.scenario)

    asks_clocks = False
    """Whether it matters what the clocks of hosts show."""

    def begin(self, run_id: str, now: float) -> Run:
        """Return the state of a run that begins."""
        return Run(run_id, Stage.LOOKING, now, held=pausing.planned_pause(self.scenario))

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
        return status(run, self.last_sample(run) + 1, outside or {})

    def last_sample(self, run: Run) -> int:
        """Return the sample at which a run ends, as far as that is known."""
        return self.samples - 1 if run.collided is None else min(self.samples - 1, run.collided)

    def refuses(self, run: Run, asked: pausing.Asked) -> str:
        """Say why nothing comes of what a user asks for; empty when something does."""
        return pausing.refused(run, asked)

    def doing(self, run: Run) -> str:
        """Say what a run is doing, for whoever watches it."""
        return f"paused at sample {run.held}" if pausing.rests(run, self.scenario) else run.stage

    def simulated(self, run: Run, _now: float) -> int:
        """Return the simulated time [ns] up to which everything has happened."""
        rests = run.held is not None and pausing.rests(run, self.scenario)
        return self.scenario.step_ns * max((run.held or 0) if rests else run.progress, 0)

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
                step = with_heartbeat(*self._judge(run, now), now)
            case HostReported():
                step = self._take_host(run, event)
            case GraphObserved():
                warned, warnings = warn(run, event.harmless)
                run, actions = self._judge_graph(warned, event, now)
                step = run, [*warnings, *actions]
            case RivalHeard():
                step = met(run, event, now, self._control[0]), []
            case PauseAsked() | ResumeAsked() | StepAsked():
                step = self._heed(run, event, now)
            case _:
                step = self._take_down(run, event), []
        return step

    # What happens is taken down ...

    def _take_down(self, run: Run, event: Event) -> Run:
        match event:
            case HostsStarted(processes):
                return self._take_processes(run, processes)
            case RecordersConnected(hosts):
                return run._replace(connected=hosts)
            case MessageRefused(reason) | MeansLost(reason):
                return refuse(run, reason)
            case ProcessEnded(host):
                return run._replace(ended_processes={**run.ended_processes, host: event})
            case SignalReceived(name):
                return run._replace(signal=run.signal or name)
            case _:
                raise TypeError(f"{event} is no event of a run")

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

    def _take_host(self, run: Run, report: HostReported) -> Step:
        state = report.state
        if state.run != run.id:
            return run, []
        if doubt := self._doubt(run, state):
            return refuse(run, doubt), []
        actions: list[Action] = []
        recorded = run.recorded
        if state.records and state.host not in recorded:
            recorded = {**recorded, state.host: -1}
            actions = [FollowRecorder(state.host)]
        run, news = with_news(run, state, stops=self.scenario.stops_on_collision)
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

    def _heed(self, run: Run, asked: pausing.Asked, now: float) -> Step:
        run, told = pausing.heed(run, asked, self.scenario, now)
        run, actions = self._pace(run, now)
        return run, [*told, *actions]

    # ... and judged at the next tick.

    def _judge(self, run: Run, now: float) -> Step:
        judges: dict[Stage, Callable[[Run, float], Step]] = {
            Stage.STARTING: self._await_nodes,
            Stage.RECORDING: self._await_own_host,
            Stage.MATCHING: self._await_connections,
            Stage.RUNNING: self._watch,
            Stage.NAMING: self._name,
            Stage.LEAVING: take_leave,
        }
        judge = judges.get(run.stage, self._look)
        if run.stage in (Stage.NAMING, Stage.LEAVING, Stage.OVER):
            return judge(run, now)
        return self._stop(run, now) or judge(run, now)

    def _stop(self, run: Run, now: float) -> Step | None:
        """End a run that cannot go on."""
        if run.signal:
            return fail(run, now, [f"stopped by {run.signal}"])
        if failures := named_failures(run):
            if any(FOREIGN in failure for failure in failures) and run.stage is not Stage.LOOKING:
                return run._replace(stage=Stage.NAMING, since=now), [ObserveGraph()]
            return fail(run, now, failures)
        for ended in run.ended_processes.values():
            return fail(run, now, [self.process_ended(run, ended)])
        return None

    def _name(self, run: Run, now: float) -> Step:
        """Give the graph some time to show who sent a message that is none of ours."""
        if now - run.since > GRAPH_PERIOD:
            return fail(run, now, [*named_failures(run), ADVICE])
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
            return fail(run, now, [*named_failures(run), foreign[0], ADVICE])
        if foreign:
            return fail(run, now, [f"{foreign[0]}. {ADVICE}"])
        if run.stage is Stage.LOOKING and looked_enough(run, now, self._newcomer_wait):
            run = run._replace(stage=Stage.STARTING, since=now, status_published=now)
            return run, [Announce(), PublishStatus(), StartHosts()]
        if run.stage is Stage.CHECKING:
            run = run._replace(stage=Stage.RUNNING, phase=RunPhase.RUNNING, started=now, moved=now)
            run, actions = self._pace(run, now)
            begun = Tell(RunEvent(EventKind.START, 0, OWN_HOST))
            return run, [begun, PublishStatus(), *actions]
        return run, []

    def _await_nodes(self, run: Run, now: float) -> Step:
        if missing := self._belief.missing(self._nodes, run.hosts):
            return self._wait_for(run, now, missing, len(missing))
        parameters = {n: p for host in run.hosts.values() for n, p in host.parameters.items()}
        if differing := disagreements(self.scenario, parameters):
            return fail(run, now, [f"{some(differing)}. Start it with the run's parameters"])
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
            return fail(run, now, [self.late(run, missing, self._start_limit)])
        return run, self._look_now_and_then(run, now)

    def _watch(self, run: Run, now: float) -> Step:
        run, told = with_changes(run, self._changes)
        run, actions = self._go_on(run, now)
        return run, [*told, *actions]

    def _go_on(self, run: Run, now: float) -> Step:
        if run.progress >= self.last_sample(run):
            return leave(run._replace(ended=now), EndRun(EndStatus.FINISHED), now)
        rests = pausing.rests(run, self.scenario)
        if now - run.moved > self._stall_limit and not rests:
            message = self.stalled(run, self._stall_limit)
            return leave(run, EndRun(EndStatus.FAILED, message, stalled=True), now)
        actions = self._look_now_and_then(run, now)
        if not self.scenario.run.real_time_factor:
            return run, actions
        run, pace = self._pace(run, now)
        return run, [*pace, *actions]

    def _pace(self, run: Run, now: float) -> Step:
        elapsed = 0.0 if run.started is None else now - run.started
        run, told = pausing.allow(run, horizon(self.scenario, run.progress, elapsed), now)
        reach = max(run.reach, furthest_sample(self.scenario, run.allowed) + self._known_ahead)
        return run._replace(reach=reach), [PublishHorizon(run.allowed), *told]

    @staticmethod
    def _look_now_and_then(run: Run, now: float) -> list[Action]:
        return [ObserveGraph()] if now - run.graph_checked > GRAPH_PERIOD else []

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

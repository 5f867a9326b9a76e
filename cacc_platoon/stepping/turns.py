"""What a follower tells of its own course: when its reception turns, and when limits act."""

from __future__ import annotations

from collections.abc import Callable

from cacc_platoon.model import MonitoredReception, ReceptionState, State, ThirdOrderPlant
from cacc_platoon.model.limits import Body
from cacc_platoon.scenario import Follower
from cacc_platoon.scenario.names import NodeKind, NodeName
from cacc_platoon.scenario.run_event import ACTS, MOST_TURNS, RESTS, EventKind, RunEvent

Tell = Callable[[RunEvent], None]
PublishReception = Callable[[int, int, float], None]
PublishMonitor = Callable[[int, bool, float], None]


class Turns:
    """Tells when a state turns into another; of one that chatters, the first `MOST_TURNS` times.

    Parameters
    ----------
    kind : EventKind
        Of what.
    node : str
        Whose, relative to the platoon's namespace.
    first : str
        The state before sample 0.
    tell : callable
        Called with each turn.

    Examples
    --------
    >>> turns = Turns(EventKind.LIMIT, "vehicle_1/vehicle", RESTS, tell=print)
    >>> for sample, state in enumerate((RESTS, ACTS, ACTS)):
    ...     turns.take(sample, state)
    RunEvent(kind=<EventKind.LIMIT: 'limit'>, sample=1, node='vehicle_1/vehicle', text='acts')
    """

    def __init__(self, kind: EventKind, node: str, first: str, tell: Tell) -> None:
        self._kind, self._node, self._tell = kind, node, tell
        self._state, self._left = first, MOST_TURNS

    def take(self, sample: int, state: str) -> None:
        """Go on to a sample at which the state is this."""
        if state != self._state:
            self._state = state
            if self._left:
                self._left -= 1
                self._tell(RunEvent(self._kind, sample, self._node, state))


class TellingBody:
    """A `Body` that tells when its limits begin to act and when they rest.

    Parameters
    ----------
    body : Body
        What carries out commands, from sample 0 on.
    limited, stops : bool
        Whether its actuator has limits, and whether it stands where it would drive backwards.
    turns : Turns
        Tells it.
    """

    def __init__(self, body: Body, limited: bool, stops: bool, turns: Turns) -> None:
        self._body, self._limited, self._stops = body, limited, stops
        self._turns, self._sample = turns, 0
        self.advance = body.advance

    def command(self, command: float, state: State[float]) -> float:
        """Return the command [m/s^2] that is carried out in a state."""
        done = self._body.command(command, state.velocity)
        stands = self._stops and state.velocity == 0.0 and state.acceleration == 0.0
        acts = stands or (self._limited and done != command)
        self._turns.take(self._sample, ACTS if acts else RESTS)
        self._sample += 1
        return done


def telling_body(
    follower: Follower, plant: ThirdOrderPlant, tell: Tell, *, own_law: bool
) -> TellingBody | None:
    """Return what limits the plant of a follower; None for nothing.

    What limits make of the commands of a law of one's own is not told: no record shows it.
    """
    limits = follower.limits()
    if limits is None and not follower.stops:
        return None
    node = str(NodeName(NodeKind.VEHICLE, follower.index))
    known = limits is not None and not (own_law or follower.law_name)
    turns = Turns(EventKind.LIMIT, node, RESTS, tell)
    return TellingBody(Body(plant, limits, follower.stops), known, follower.stops, turns)


def reception_turns(follower: Follower, tell: Tell) -> Turns:
    """Return what tells the turns of a follower's reception."""
    node = str(NodeName(NodeKind.VEHICLE, follower.index))
    return Turns(EventKind.RECEPTION, node, ReceptionState.NORMAL.name.lower(), tell)


def saying(
    step_ns: int,
    publish_reception: PublishReception | None,
    publish_monitor: PublishMonitor | None,
    watching: MonitoredReception | None,
    turns: Turns | None,
) -> PublishReception | None:
    """Return what publishes the state of a reception and its monitor's alarm, and tells its turns.

    The state that is told is that of the share of the control law, of all links together.
    """
    monitor = watching.monitor if watching and publish_monitor else None
    if turns is None and monitor is None:
        return publish_reception
    before = 1.0

    def say(stamp: int, state: int, share: float) -> None:
        nonlocal before
        if publish_reception:
            publish_reception(stamp, state, share)
        if monitor and publish_monitor:
            publish_monitor(stamp, monitor.alarm, monitor.excess)
        if turns and (share != 1.0 or before != 1.0):
            turns.take(stamp // step_ns, ReceptionState.of_share(before, share).name.lower())
            before = share

    return say

"""Received accelerations, paired with the sample at which the channel delivers them.

Where every packet is delivered at the sample it was sent at, its stamp says which that is. Where
packets may be lost or late, the relay says on v2v/complete up to which sample it is done and how
many messages it has published by then: messages and counts are two topics and have no order. Where
it knows that nothing more is delivered at some samples that follow, it says so in the same message.
"""

from __future__ import annotations

from collections import deque
from typing import Generic, NamedTuple, Protocol, TypeAlias, TypeVar

from cacc_platoon.model import Reception
from cacc_platoon.scenario import Scenario

DOUBT = "may be wrong"
"""In a line on a message of another publisher that may have been used in place of ours."""

MOST = 2.0**53
"""Beyond, a float counts no messages."""

OTHERS = "a message was lost or comes from another publisher"

Message = TypeVar("Message")


class LockstepError(Exception):
    """A message that must not be used: the run ends, the line says which and why."""


def lost_or_foreign(stamp: int, due: int, step_ns: int) -> str:
    """Say what it means that a message is not the one that is due.

    A sample that comes once more was answered already: one of the two is not from who should send
    it, and nobody can tell which one was used.
    """
    if stamp >= due:
        return OTHERS
    return f"{OTHERS}; {doubtful_from(max(stamp, 0) // step_ns)}"


def doubtful_from(sample: int) -> str:
    """Say from which sample on what was recorded is not to be trusted.

    Examples
    --------
    >>> doubtful_from(7)
    'everything from sample 7 on may be wrong'
    """
    return f"everything from sample {sample} on {DOUBT}"


def seconds(stamp: int) -> str:
    """Return a stamp [ns] for a line of text."""
    return f"{stamp / 1e9:.9g} s"


class Sequence:
    """The stamps of one topic, which must come one step apart from 0 on."""

    def __init__(self, what: str, step_ns: int) -> None:
        self._what, self._step = what, step_ns
        self.due = 0

    def take(self, stamp: int, more: int = 0) -> None:
        """Accept the next stamp, which stands for `more` samples more, or raise LockstepError."""
        if stamp != self.due:
            raise LockstepError(
                f"{self._what} is stamped {seconds(stamp)} where {seconds(self.due)} is due: "
                f"{lost_or_foreign(stamp, self.due, self._step)}"
            )
        self.due += self._step * (1 + more)


class Counts(Sequence):
    """The counts of a relay: their stamps, and how many messages it has published.

    One stands for at most as many samples more as the window of the run has, and the run.
    """

    def __init__(self, what: str, scenario: Scenario) -> None:
        super().__init__(what, scenario.step_ns)
        self.published = 0
        self._window, self._last = scenario.run.window, scenario.samples - 1

    def fits(self, stamp: int, count: float, more: float) -> bool:
        """Return whether a message can be one of the relay, but for its stamp."""
        counts = is_count(count) and self.published <= count and is_count(more)
        return counts and more <= min(self._window, self._last - stamp // self._step)


def is_count(value: float) -> bool:
    """Return whether a number in a message can count something.

    Examples
    --------
    >>> is_count(2.0), is_count(2), is_count(0.5), is_count(-1.0), is_count(1e300)
    (True, True, False, False, False)
    """
    return 0.0 <= value < MOST and float(value).is_integer()


class Delivered(NamedTuple, Generic[Message]):
    """The messages that are delivered at one sample, and the last one at which none follow."""

    stamp: int
    messages: list[Message]
    last: int


class CountedDeliveries(Generic[Message]):
    """Pairs messages, in the order of their publication, with the samples that counts give them.

    Examples
    --------
    >>> deliveries = CountedDeliveries()
    >>> deliveries.count(0, 1, last=0)
    >>> deliveries.message("a")
    >>> deliveries.count(10, 1, last=30)
    >>> [tuple(one) for one in deliveries.settled()]
    [(0, ['a'], 0), (10, [], 30)]
    """

    def __init__(self) -> None:
        self._messages: deque[Message] = deque()
        self._counts: deque[tuple[int, int, int]] = deque()
        self._given = 0

    @property
    def waiting(self) -> int:
        """How many messages are here that no count covers yet."""
        return len(self._messages)

    def message(self, message: Message) -> None:
        """Take the next message."""
        self._messages.append(message)

    def count(self, stamp: int, count: int, last: int) -> None:
        """Take note that `count` messages in all are delivered up to a sample, and to `last`."""
        self._counts.append((stamp, count, last))

    def settled(self) -> list[Delivered[Message]]:
        """Return the samples of which every message is here, in order; each is returned once."""
        found = []
        while self._counts and self._counts[0][1] - self._given <= len(self._messages):
            stamp, count, last = self._counts.popleft()
            messages = [self._messages.popleft() for _ in range(count - self._given)]
            self._given = count
            found.append(Delivered(stamp, messages, last))
        return found


Used: TypeAlias = tuple[tuple[float, ...], float, int]
"""What is used of links at one sample.

Accelerations [m/s^2] of each link; the share of the control law in the command, the rest being that
of a law without V2V; the `ReceptionState` of the nearest link.
"""


class Inbox(Protocol):
    """The received accelerations to use at each sample, by stamp [ns]."""

    def __contains__(self, stamp: int) -> bool:
        """Whether it is known what to use at a sample."""
        ...

    def take(self, stamp: int, acceleration: float) -> None:
        """Accept a message, stamped with the sample it was sent at."""
        ...

    def count(self, stamp: int, count: int, last: int) -> None:
        """Accept how many messages the relay has published by a sample, and up to `last`."""
        ...

    def pop(self, stamp: int) -> Used:
        """Return what to use at a sample, and forget it."""
        ...


class PromptInbox(dict[int, Used]):
    """For a channel that delivers every packet at the sample it was sent at."""

    def take(self, stamp: int, acceleration: float) -> None:
        """Accept a message, stamped with the sample it was sent at."""
        self[stamp] = ((acceleration,), 1.0, 0)

    def count(self, stamp: int, count: int, last: int) -> None:
        """Accept what such a channel need not say."""


class CountedInbox:
    """For a channel that may lose or delay packets, and counts them.

    Parameters
    ----------
    reception : Reception
        What the vehicle makes of what is delivered.
    step_ns : int
        Control period [ns].
    receiver : str, optional
        Whose inbox it is, for the error line.
    """

    def __init__(self, reception: Reception, step_ns: int, receiver: str = "receiver") -> None:
        self._receiver = receiver
        self._reception, self._step = reception, step_ns
        self._deliveries: CountedDeliveries[tuple[int, float]] = CountedDeliveries()
        self._known = -1
        self._ready: dict[int, list[tuple[int, float]]] = {}

    def __contains__(self, stamp: int) -> bool:
        """Whether it is known what to use at a sample."""
        return stamp <= self._known

    def take(self, stamp: int, acceleration: float) -> None:
        """Accept a message, stamped with the sample it was sent at."""
        self._deliveries.message((stamp // self._step, acceleration))
        self._settle()

    def count(self, stamp: int, count: int, last: int) -> None:
        """Accept how many messages the relay has published by a sample, and up to `last`."""
        self._deliveries.count(stamp, count, last)
        self._settle()

    def pop(self, stamp: int) -> Used:
        """Return what to use at a sample, and forget it."""
        reception = self._reception
        value = reception.use(self._ready.pop(stamp, ()))
        return (value,), getattr(reception, "share", 1.0), getattr(reception, "state", 0)

    def _settle(self) -> None:
        for stamp, packets, last in self._deliveries.settled():
            if any(source * self._step > stamp for source, _ in packets):
                raise LockstepError(
                    f"{self._receiver}: v2v/accel was delivered at {seconds(stamp)}, before it was "
                    "sent: a message comes from another publisher; "
                    f"{doubtful_from(stamp // self._step)}"
                )
            if packets:
                self._ready[stamp] = packets
            self._known = last


class JointInbox:
    """What is used of several links together; messages go to the inboxes of the links."""

    def __init__(self, inboxes: list[Inbox]) -> None:
        self._inboxes = inboxes

    def __contains__(self, stamp: int) -> bool:
        """Whether it is known what to use of every link."""
        return all(stamp in inbox for inbox in self._inboxes)

    def pop(self, stamp: int) -> Used:
        """Return what to use of each link at a sample, and forget it."""
        accelerations, shares, states = zip(
            *(inbox.pop(stamp) for inbox in self._inboxes), strict=True
        )
        return tuple(value for one in accelerations for value in one), min(shares), states[0]

"""What goes wrong, and what may then come of it: the table that every run is checked against.

The first row that fits a fault counts. What holds whatever happens (limits of time, no traceback,
nothing left behind, no wrong data that nobody names) is in `check`.
"""

from __future__ import annotations

from typing import NamedTuple

from cacc_platoon.campaign.plan import EARLY, LATE, WALL, Fault, Moment

SIGNALLED = "128+n"
"""An exit code: 128 and the number of the signal."""
BY_SIGNAL = "-n"
"""The end of a process that the signal has killed."""


class Ending(NamedTuple):
    """How a run may end.

    Attributes
    ----------
    state : str
        What run.json says once `platoon report` has looked at it; "none" without a run.json.
    codes : tuple of int or str
        Exit codes of the command.
    words : tuple of str
        Each has to match, as a regular expression, what the command and run.json say.
    named : bool
        Whether they have to name who or what it was.
    """

    state: str
    codes: tuple[int | str, ...]
    words: tuple[str, ...] = ()
    named: bool = False


class Row(NamedTuple):
    """Faults, and the endings that they may have; an empty tuple stands for all."""

    kinds: tuple[str, ...]
    endings: tuple[Ending, ...]
    targets: tuple[str, ...] = ()
    moments: tuple[Moment, ...] = ()
    syncs: tuple[str, ...] = ()
    variants: tuple[str, ...] = ()

    def fits(self, fault: Fault) -> bool:
        """Whether the row is about a fault."""
        return all(
            not wanted or given in wanted
            for wanted, given in (
                (self.kinds, fault.kind),
                (self.targets, fault.process or fault.target.rpartition("/")[2]),
                (self.moments, fault.moment),
                (self.syncs, fault.sync),
                (self.variants, fault.variant),
            )
        )


FINISHED = Ending("finished", (0,))


def _failed(*words: str, named: bool = True) -> Ending:
    return Ending("failed", (1,), words, named)


def _refused(*words: str) -> Ending:
    return _failed("publisher", *words)


KILLED = "was killed by SIG"
ROWS: tuple[Row, ...] = (
    # The supervisor is gone: the hosts notice, and `platoon report` finishes the folder.
    Row(
        ("kill",),
        (
            Ending("failed", (BY_SIGNAL,), ("process was killed|not written yet",)),
            Ending("none", (BY_SIGNAL,)),
        ),
        ("supervisor",),
        (Moment.START, Moment.MATCH),
    ),
    Row(
        ("kill",),
        (Ending("failed", (BY_SIGNAL,), ("process was killed",)),),
        ("supervisor",),
        (Moment.RUN,),
    ),
    Row(
        ("kill",),
        (Ending("finished", (BY_SIGNAL, 0)), Ending("failed", (BY_SIGNAL,), ("was killed",))),
        ("supervisor",),
        LATE,
    ),
    # A host, or who starts the hosts.
    Row(("kill",), (_failed(KILLED),), ("host", "forkserver"), EARLY),
    Row(("kill",), (FINISHED, _failed(KILLED)), ("host", "forkserver"), LATE),
    Row(("kill_restarted",), (Ending("finished", (0,), ("is started again",)),)),
    # Signals.
    Row(
        ("signal", "signal_twice"),
        (
            Ending("interrupted", (SIGNALLED,), ("stopped by SIG",)),
            Ending("none", (SIGNALLED, BY_SIGNAL)),
        ),
        ("supervisor",),
        (Moment.START,),
    ),
    Row(
        ("signal", "signal_twice"),
        (Ending("interrupted", (SIGNALLED,), ("stopped by SIG",)),),
        ("supervisor",),
        (Moment.MATCH, Moment.RUN),
    ),
    Row(
        ("signal", "signal_twice"),
        (Ending("finished", (SIGNALLED, BY_SIGNAL, 0)), Ending("interrupted", (SIGNALLED,))),
        ("supervisor",),
        LATE,
    ),
    Row(("signal",), (FINISHED,), ("host",), variants=("SIGINT", "SIGHUP")),
    Row(("signal",), (_failed("SIGTERM"),), ("host",), EARLY),
    Row(("signal",), (FINISHED, _failed("SIGTERM")), ("host",), LATE),
    # Who is frozen for less than the limits is waited for, and by clocks whoever it is.
    Row(("freeze", "cut", "foreign_deaf"), (FINISHED,)),
    Row(("freeze_long",), (FINISHED,), syncs=(WALL,)),
    Row(("freeze_long", "cut_long"), (_failed("no progress for"),)),
    Row(
        ("freeze_supervisor",),
        (_failed("had to be over", named=False), _failed("silent for too long|ended with")),
        syncs=(WALL,),
    ),
    Row(("freeze_supervisor",), (_failed("silent for too long|ended with|no progress for"),)),
    # Others in the domain: the run stops and names them, or goes on unharmed.
    Row(("foreign_silent",), (_refused(), FINISHED)),
    Row(("forged_status",), (_refused(), FINISHED), variants=("rival",)),  # has to give way
    Row(("second_platoon",), (FINISHED, _failed("Another platoon", named=False))),
    Row(
        ("flood", "forged_state", "forged_status", "forged_progress", "forged_count"),
        (_refused(),),
    ),
    Row(("other_version",), (_failed("format|version|publisher"),)),
    Row(("malformed", "oversized", "foreign_data"), (_refused(),)),
    # The disk.
    Row(
        ("full_disk",),
        (
            Ending("finished", (1,), ("cannot be written|not written yet",)),
            _failed("cannot be written|not written yet", named=False),
        ),
    ),
    Row(
        ("deleted",),
        (_failed("deleted", named=False), Ending("none", (1,), ("deleted",))),
        moments=(Moment.RUN,),
    ),
    Row(
        ("deleted",),
        (
            FINISHED,
            _failed(named=False),
            Ending("none", (0, 1, 2)),
            Ending("finished", (1, 2)),
        ),
        moments=LATE,
    ),
)


def row_of(fault: Fault) -> Row:
    """Return what may come of a fault.

    Raises
    ------
    LookupError
        When no row is about it.
    """
    for row in ROWS:
        if row.fits(fault):
            return row
    raise LookupError(f"no row of the table is about {fault}")

"""Evaluates the rows of a study on any executor, and again those that an executor lost."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import suppress
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection
from typing import Any, NamedTuple, ParamSpec, TypeVar

from cacc_platoon.errors import UserError, one_line
from cacc_platoon.scenario import Scenario
from cacc_platoon.sweep.criterion import Criterion, Value
from cacc_platoon.sweep.evaluate import document_of, parameters_of
from cacc_platoon.sweep.plan import Plan, Point
from cacc_platoon.sweep.rows import RowResult

ATTEMPTS = 3
"""So often a row is tried whose process ends or whose executor breaks."""
AHEAD = 4
"""Rows that are handed out for each process at once."""
_STOP = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
Given = ParamSpec("Given")
Result = TypeVar("Result")
ENDED = "the process that evaluates it ended every time. Is there memory enough?"
"""Why a row failed that is tried anew when its study goes on."""
LOSSES = (BrokenExecutor, CancelledError, OSError)
"""What a row ends with that was lost with its process; an executor may name more as `losses`."""

Evaluate = Callable[[Scenario, int], dict[str, Any]]
"""Returns the numbers of the scenario of a row by the names of metrics.json."""


def simulated(scenario: Scenario, _row: int) -> dict[str, Any]:
    """Evaluate a scenario in arrays; see `document_of`."""
    return document_of(scenario)


def evaluate_point(
    scenario: Scenario,
    point: Point,
    columns: Sequence[Value],
    criteria: Sequence[Criterion],
    evaluate: Evaluate = simulated,
) -> RowResult:
    """Evaluate one row; what makes it fail is its result.

    Parameters
    ----------
    scenario : Scenario
        What all rows have in common.
    point : Point
        The row.
    columns, criteria
        What is wanted of it, see `Plan`.
    evaluate : callable, optional
        How.
    """
    try:
        own = point.of(scenario)
        document = parameters_of(own) | evaluate(own, point.row)
        values = {value.text: value.of(document) for value in columns}
        met = {criterion.text: criterion.holds(document) for criterion in criteria}
    except UserError as error:
        return RowResult(point.row, {}, {}, str(error))
    except (ArithmeticError, ValueError, MemoryError, OSError) as error:
        return RowResult(point.row, {}, {}, one_line(f"{type(error).__name__}: {error}", 300))
    return RowResult(point.row, values, met)


class _Try(NamedTuple):
    """A row that is given to an executor, for the first time or again."""

    point: Point
    number: int


class Evaluation:
    """Evaluates rows on executors; one that breaks, since a process was killed, is made anew.

    A row that was lost with others is tried again, at last alone: if it is lost then, it is what
    ends the process, and a failed row.

    Parameters
    ----------
    plan : Plan
        The study.
    points : iterable of Point
        Which of its rows.
    make_executor : callable
        Makes any executor of `concurrent.futures`.
    workers : int, optional
        How many rows it evaluates at once; by default what it says as its `workers`.
    evaluate : callable, optional
        As of `evaluate_point`; it has to be picklable where processes evaluate.
    """

    def __init__(
        self,
        plan: Plan,
        points: Iterable[Point],
        make_executor: Callable[[], Executor],
        *,
        workers: int | None = None,
        evaluate: Evaluate = simulated,
    ) -> None:
        self._plan, self._points, self._make_executor = plan, iter(points), make_executor
        self._workers, self._evaluate = workers, evaluate
        self._lost: list[_Try] = []
        self._suspect = True
        self._asked: dict[Future[RowResult], _Try] = {}

    def rows(self) -> Iterator[RowResult]:
        """Yield rows as they come."""
        over = False
        while not over:
            executor = self._make_executor()
            try:
                over = yield from self._rows_of(executor)
            finally:
                with suppress(BrokenExecutor, OSError):
                    executor.shutdown(wait=False, cancel_futures=True)
            self._lost += [self._again(one) for one in self._asked.values()]
            self._asked.clear()

    def _rows_of(self, executor: Executor) -> Generator[RowResult, None, bool]:
        """Yield the rows of an executor; return whether all are here, or it broke."""
        losses = (*LOSSES, *getattr(executor, "losses", ()))
        while self._hand_out(executor):
            if not self._asked:
                return True
            done, _ = wait(self._asked, timeout=1.0, return_when=FIRST_COMPLETED)
            broken = False
            for future in done:
                one = self._asked.pop(future)
                try:
                    yield future.result()
                except losses as error:
                    broken = True
                    self._suspect = not isinstance(error, CancelledError)
                    if self._suspect and one.number >= ATTEMPTS:
                        yield RowResult(one.point.row, {}, {}, ENDED)
                    else:
                        self._lost.append(self._again(one))
            if broken:
                break
        return False

    def _again(self, one: _Try) -> _Try:
        """Return the next try of a row, which counts where a row may be what broke the executor."""
        return one._replace(number=one.number + 1) if self._suspect else one

    def _hand_out(self, executor: Executor) -> bool:
        """Hand rows out, first those that were lost; return whether the executor takes them."""
        workers: Any = self._workers or getattr(executor, "workers", 1)
        most = AHEAD * workers
        while len(self._asked) < most and (one := self._next()):
            arguments = self._plan.scenario, one.point, self._plan.columns, self._plan.criteria
            try:
                future = executor.submit(evaluate_point, *arguments, self._evaluate)
            except (BrokenExecutor, RuntimeError):
                self._lost.insert(0, one)
                return False
            self._asked[future] = one
            if one.number == ATTEMPTS:
                break
        return True

    def _next(self) -> _Try | None:
        """Return what is tried next, if anything may be now: a last try is made alone."""
        if any(one.number == ATTEMPTS for one in self._asked.values()):
            return None
        if self._lost:
            if self._lost[0].number == ATTEMPTS and self._asked:
                return None
            return self._lost.pop(0)
        point = next(self._points, None)
        return None if point is None else _Try(point, 1)


class Processes(ProcessPoolExecutor):
    """Processes of this machine, which end when this one does, or needs them no longer.

    Parameters
    ----------
    workers : int
        How many.
    """

    def __init__(self, workers: int) -> None:
        resource_tracker.ensure_running()  # unblocks signals, so before they are blocked
        context = get_context("forkserver")
        context.set_forkserver_preload(["cacc_platoon.sweep.engine"])
        lifeline, self._held = context.Pipe(duplex=False)
        super().__init__(workers, context, initializer=_begin_process, initargs=(lifeline,))

    def submit(
        self, fn: Callable[Given, Result], /, *args: Given.args, **kwargs: Given.kwargs
    ) -> Future[Result]:
        """Hand a call to a process, which may be started for it: no signal comes in between."""
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _STOP)
        try:
            return super().submit(fn, *args, **kwargs)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes, in the middle of what they do; that takes no time to wait for."""
        self._held.close()
        super().shutdown(wait=True, cancel_futures=cancel_futures)


def _begin_process(lifeline: Connection) -> None:
    """Leave Ctrl-C to the process that gives the work, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(lifeline,), daemon=True).start()


def _end_with(lifeline: Connection) -> None:
    lifeline.poll(None)
    os._exit(1)

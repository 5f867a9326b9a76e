"""A signal ends what is being done, wherever Python was when it came."""

import contextlib
import os
import signal
import sys
import time

import pytest

from cacc_platoon.stop_signal import AGAIN, EndedError, ended_by

pytestmark = pytest.mark.unit


def terminate() -> None:
    """Send this process a signal, which it takes before it goes on."""
    os.kill(os.getpid(), signal.SIGTERM)


class Finalized:
    """Is hit by a signal while it goes, where Python drops every exception."""

    def __init__(self, number: signal.Signals) -> None:
        self.number = number

    def __del__(self) -> None:
        os.kill(os.getpid(), self.number)


def in_a_library(number: signal.Signals) -> None:
    """Be hit by a signal where everything is caught."""
    with contextlib.suppress(BaseException):
        os.kill(os.getpid(), number)


def work_on(number: signal.Signals) -> None:
    """Compute for longer than signals may take that hit finalizers and libraries."""
    Finalized(number)
    in_a_library(number)
    Finalized(number)
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline:
        sum(range(1000))
    pytest.fail("the signal was forgotten")


def test_a_signal_ends_what_is_being_done() -> None:
    with pytest.raises(EndedError) as caught, ended_by(signal.SIGTERM):
        terminate()
    assert caught.value.signal is signal.SIGTERM
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "error"), [(signal.SIGTERM, EndedError), (signal.SIGINT, KeyboardInterrupt)]
)
def test_a_signal_that_is_lost_on_its_way_is_not_forgotten(
    number: signal.Signals, error: type[BaseException]
) -> None:
    with pytest.raises(error), ended_by(signal.SIGTERM):
        work_on(number)


def test_tidying_up_is_not_cut_short() -> None:
    tidied = []

    def work() -> None:
        try:
            terminate()
        finally:
            deadline = time.monotonic() + 5 * AGAIN
            while time.monotonic() < deadline:
                sum(range(1000))
            tidied.append("all of it")

    with pytest.raises(EndedError), ended_by(signal.SIGTERM):
        work()
    assert tidied


def test_a_context_that_ends_at_once_does_not_forget_either() -> None:
    with pytest.raises(EndedError), ended_by(signal.SIGTERM):
        Finalized(signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_other_faults_of_finalizers_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    class Faulty:
        def __del__(self) -> None:
            raise ValueError("told")

    told = []
    monkeypatch.setattr(sys, "unraisablehook", lambda what: told.append(str(what.exc_value)))
    with ended_by(signal.SIGTERM):
        Faulty()
    assert told == ["told"]

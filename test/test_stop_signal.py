"""A signal ends what is being done, wherever Python was when it came."""

import os
import signal

import pytest

from cacc_platoon.stop_signal import EndedError, ended_by

pytestmark = pytest.mark.unit


def terminate() -> None:
    """Send this process a signal, which it takes before it goes on."""
    os.kill(os.getpid(), signal.SIGTERM)


class Finalized:
    """Is hit by a signal while it goes, where Python drops every exception."""

    def __del__(self) -> None:
        terminate()


def test_a_signal_ends_what_is_being_done() -> None:
    with pytest.raises(EndedError) as caught, ended_by(signal.SIGTERM):
        terminate()
    assert caught.value.signal is signal.SIGTERM
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_signal_that_hits_a_finalizer_is_not_forgotten() -> None:
    with pytest.raises(EndedError), ended_by(signal.SIGTERM):
        Finalized()

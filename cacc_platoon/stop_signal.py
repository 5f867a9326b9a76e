"""Ctrl-C, SIGTERM and SIGHUP, remembered and acted on where the run can be ended cleanly."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import time
import weakref
from collections.abc import Iterator

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
REPEATED = 1.0
"""So soon after the first a signal is the same wish: ros2 launch repeats that of a terminal [s]."""
PATIENCE = 10.0
"""How long a signal may wait until somebody asks for it [s]; then the process ends at once."""

AGAIN = 0.05
"""How long after what a signal has raised is lost it is sent again [s]."""


class EndedError(BaseException):
    """A signal that ends what is being done, as Ctrl-C does, and which it was."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.signal = signal.Signals(number)


class _InterruptedError(EndedError, KeyboardInterrupt):
    """Ctrl-C."""


@contextlib.contextmanager
def ended_by(*signals: signal.Signals) -> Iterator[None]:
    """Within, Ctrl-C and signals that would end the process raise, so that it can tidy up.

    What they raise, `EndedError` or KeyboardInterrupt, is lost in a finalizer, where Python drops
    it, and in a library that catches everything. So it is watched: when it is gone before the
    context is, the signal is sent again.
    """
    received: list[int] = []
    again: list[threading.Timer] = []

    def send_again(number: int) -> None:
        again.append(threading.Timer(AGAIN, os.kill, (os.getpid(), number)))
        again[-1].daemon = True
        again[-1].start()

    def watched(number: int) -> EndedError:
        error = _ending(number)
        watching.append(weakref.finalize(error, send_again, number))
        watching[-1].atexit = False
        return error

    def end(number: int, _frame: object) -> None:
        received.append(number)
        raise watched(number)

    watching: list[weakref.finalize[..., EndedError]] = []
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, *signals)}
    usual = (signal.SIG_DFL, signal.default_int_handler)
    taken = {number: handler for number, handler in before.items() if handler in usual}
    if threading.current_thread() is not threading.main_thread():
        taken = {}
    for number in taken:
        signal.signal(number, end)
    try:
        with _dropped_in_silence():
            yield
        if received:
            raise _ending(received[0])
    finally:
        for one in watching:
            one.detach()
        for timer in again:
            timer.cancel()
        for number, handler in taken.items():
            signal.signal(number, handler)


def _ending(number: int) -> EndedError:
    return _InterruptedError(number) if number == signal.SIGINT else EndedError(number)


@contextlib.contextmanager
def _dropped_in_silence() -> Iterator[None]:
    """Within, Python does not tell of the signals that it drops."""
    before = sys.unraisablehook

    def dropped(what: sys.UnraisableHookArgs) -> None:
        if not isinstance(what.exc_value, EndedError):
            before(what)

    sys.unraisablehook = dropped
    try:
        yield
    finally:
        sys.unraisablehook = before


class StopSignal:
    """Remembers the first of some signals; a later one never undoes what it began.

    A process that hangs where nobody asks for the signal is ended by it all the same, though not
    cleanly, after PATIENCE.

    Parameters
    ----------
    *signals : signal.Signals
        What to listen to. A SIGHUP that is ignored, as nohup does, stays ignored.
    """

    def __init__(self, *signals: signal.Signals) -> None:
        self._received: signal.Signals | None = None
        self._received_at = 0.0
        self._insisted = self._released = False
        self._asked = threading.Event()
        self._reader, self._writer = os.pipe()
        os.set_blocking(self._writer, False)
        signal.set_wakeup_fd(self._writer, warn_on_full_buffer=False)
        threading.Thread(target=self._watch, daemon=True).start()
        self._before = {number: signal.getsignal(number) for number in signals}
        for number, handler in self._before.items():
            if number != signal.SIGHUP or handler is not signal.SIG_IGN:
                signal.signal(number, self._on_signal)

    def __enter__(self) -> StopSignal:
        """Listen until the end of the context."""
        return self

    def __exit__(self, *_: object) -> None:
        """Leave signals to whoever listened before."""
        for number, handler in self._before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(-1)
        os.close(self._writer)

    def release(self) -> None:
        """From now on the first signal interrupts at once, with KeyboardInterrupt."""
        self._asked.set()
        self._released = True

    def received(self) -> str | None:
        """Return the name of the signal that came, or None."""
        if self._received is None:
            return None
        self._asked.set()
        return self._received.name

    def insisted(self) -> bool:
        """Return whether another signal came later: what can be done later is left for later."""
        return self._insisted

    @property
    def exit_code(self) -> int:
        """128 plus the signal, as shells do; 0 when none came."""
        return 128 + self._received if self._received else 0

    def _on_signal(self, number: int, _frame: object) -> None:
        now = time.monotonic()
        if self._received is None:
            self._received, self._received_at = signal.Signals(number), now
            if self._released:
                raise KeyboardInterrupt
        elif now - self._received_at > REPEATED:
            self._insisted = True

    def _watch(self) -> None:
        """End the process when a signal has come and nobody asks for it."""
        numbers = os.read(self._reader, 1)
        if numbers and not self._asked.wait(PATIENCE):
            os._exit(128 + numbers[0])
        while numbers:  # until the writer is closed: without a reader, a signal is an error
            numbers = os.read(self._reader, 1)
        os.close(self._reader)

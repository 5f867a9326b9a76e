"""Ctrl-C and SIGTERM, remembered and acted on where the run can be ended cleanly."""

from __future__ import annotations

import signal


class StopSignal:
    """Remembers the first of some signals.

    Parameters
    ----------
    *signals : signal.Signals
        What to listen to.
    insist : bool, optional
        Whether a second signal interrupts whatever is running, with KeyboardInterrupt.
    """

    def __init__(self, *signals: signal.Signals, insist: bool = False) -> None:
        self._received: signal.Signals | None = None
        self._insist = insist
        for number in signals:
            signal.signal(number, self._on_signal)

    def release(self) -> None:
        """From now on a Ctrl-C interrupts at once, as everywhere."""
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)

    def received(self) -> str | None:
        """Return the name of the signal that came, or None."""
        return self._received.name if self._received else None

    @property
    def exit_code(self) -> int:
        """128 plus the signal, as shells do; 0 when none came."""
        return 128 + self._received if self._received else 0

    def _on_signal(self, number: int, _frame: object) -> None:
        if self._received and self._insist:
            raise KeyboardInterrupt
        self._received = signal.Signals(number)

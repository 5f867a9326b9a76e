"""Watch a running platoon: one row a vehicle, on a terminal, in lines, as JSON or in a browser.

It holds nobody up: the run goes on as if nobody looked, whatever becomes of whoever does.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, TextIO

from cacc_platoon.cli.console import answers_apart, say
from cacc_platoon.cli.exit_codes import DONE, FAILED
from cacc_platoon.cli.ros import require_ros
from cacc_platoon.dds.domain import domain_of
from cacc_platoon.dds.environment import set_up
from cacc_platoon.errors import UserError
from cacc_platoon.scenario.checks import check_namespace
from cacc_platoon.stop_signal import STOP_SIGNALS, StopSignal

if TYPE_CHECKING:
    from cacc_platoon.live.picture import Picture
    from cacc_platoon.live.watch import Watch
    from cacc_platoon.supervision.watch_node import WatchNode

PAGE_PORT, FOXGLOVE_PORT = 8780, 8765
_SPIN = 0.05
_LOOK_AROUND = 1.0
"""So long other platoons may take to be seen, too [s]."""
_PERIOD, _LINE_PERIOD = 0.2, 2.0
"""How often a picture is drawn or written, and a line of a log [s]."""
_WAIT = 5.0
"""How long --once waits for a platoon, and for something to see of it [s]."""
_GONE = 1.0
"""How often it is looked whether the supervisor is still there [s]."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("--namespace", help="which platoon, where several run: its prefix")
    parser.add_argument("--once", action="store_true", help="show one picture and end")
    parser.add_argument("--json", action="store_true", help="print one JSON object a line")
    parser.add_argument(
        "--web",
        action="store_true",
        help="serve a page on this machine, and with the extra [live] what Foxglove, Lichtblick "
        "and PlotJuggler connect to; until Ctrl-C",
    )
    parser.add_argument(
        "--port",
        type=_port,
        default=PAGE_PORT,
        help="of the page, 0 for any (default: %(default)s)",
    )
    parser.add_argument(
        "--foxglove-port",
        type=_port,
        default=FOXGLOVE_PORT,
        help="of what viewers connect to, 0 for any (default: %(default)s)",
    )


def _port(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and len(text) <= 5 and int(text) < 2**16):
        raise argparse.ArgumentTypeError(f"{text!r} is no port, a number from 0 to 65535")
    return int(text)


def run(options: argparse.Namespace) -> int:
    """Show the platoon until its run ends."""
    if options.namespace is not None:
        check_namespace(options.namespace, "platoon watch --namespace")
    if options.web and (options.once or options.json):
        raise UserError("--web serves a page, which --once and --json have no part in. Leave one.")
    require_ros("watch", "platoon report shows a run that has ended")
    for line in set_up(os.environ):
        say(f"warning: {line}")
    with StopSignal(*STOP_SIGNALS) as stop, answers_apart() as answers:
        code = _watch(options, answers, stop)
    if stop.received():
        say("interrupted")
    return stop.exit_code or code


def _watch(options: argparse.Namespace, answers: TextIO, stop: StopSignal) -> int:
    from cacc_platoon.live.watch import Watch  # noqa: PLC0415  (needs ROS)
    from cacc_platoon.supervision.watch_node import watching  # noqa: PLC0415  (needs ROS)

    with watching() as (node, spin):
        waiter = _Waiter(node, spin, stop)
        prefix = waiter.platoon(options.namespace, _WAIT if options.once else None)
        if not prefix:
            return FAILED
        node.follow(prefix)
        viewer = _Viewer(Watch(prefix), node, spin, stop)
        if options.once:
            return _show_once(viewer, options, answers)
        if options.web:
            return _serve(viewer, options)
        show, period = _shower(options, answers)
        return viewer.show(show, period)


class _Waiter:
    """Looks for platoons in this domain."""

    def __init__(self, node: WatchNode, spin: Callable[[float], None], stop: StopSignal) -> None:
        self._node, self._spin, self._stop = node, spin, stop

    def platoon(self, namespace: str | None, patience: float | None) -> str:
        """Return the namespace of the platoon that is to be watched; empty when there is none.

        Raises
        ------
        UserError
            When there are several.
        """
        began, told = time.monotonic(), False
        while not self._stop.received():
            self._spin(_SPIN)
            waited = time.monotonic() - began
            found = self._node.running_platoons()
            if namespace in found:
                return str(namespace)
            if namespace is None and found and waited > _LOOK_AROUND:
                return _only(found)
            if patience is not None and waited > patience:
                say(f"{_none(namespace)}")
                return ""
            if not told and patience is None and waited > _LOOK_AROUND:
                say(f"{_none(namespace)}; waiting for one")
                told = True
        return ""


def _only(found: list[str]) -> str:
    if len(found) > 1:
        raise UserError(
            f"{len(found)} platoons run in this domain: {', '.join(found)}. Name one of them with "
            "--namespace."
        )
    return found[0]


def _none(namespace: str | None) -> str:
    return f"no platoon {namespace or ''} runs in domain {domain_of(os.environ)}".replace("  ", " ")


class _Viewer:
    """Hears a platoon and shows it now and then."""

    def __init__(
        self, watch: Watch, node: WatchNode, spin: Callable[[float], None], stop: StopSignal
    ) -> None:
        self.watch, self._node, self._spin, self._stop = watch, node, spin, stop

    def look(self) -> Picture:
        """Hear for a moment, and return what the platoon looks like then."""
        self._spin(_SPIN)
        now = time.monotonic()
        self.watch.hear(self._node.take(), now)
        return self.watch.picture(now)

    def show(self, show: Callable[[Picture], None], period: float) -> int:
        """Show the platoon until its run ends; return the exit code."""
        shown_at, seen_at = 0.0, time.monotonic()
        while not self._stop.received():
            picture, now = self.look(), time.monotonic()
            if self.watch.ended:
                show(picture)
                return FAILED if self.watch.failed else DONE
            if now - seen_at > _GONE:
                seen_at = now
                if not self._node.is_there(picture.namespace):
                    say(f"{picture.namespace}: its supervisor is gone")
                    return FAILED
            if now - shown_at >= period:
                shown_at = now
                show(picture)
        return DONE

    def until(self, condition: Callable[[Picture], bool], seconds: float) -> Picture:
        """Hear until a picture is as it should be, or for so long; return the last one."""
        deadline = time.monotonic() + seconds
        while True:
            picture = self.look()
            if condition(picture) or self._stop.received() or time.monotonic() > deadline:
                return picture

    def serve(self, show: Callable[[Picture], None]) -> int:
        """Show the platoon, and the ones of its name after it, until a signal comes."""
        shown_at = 0.0
        while not self._stop.received():
            picture, now = self.look(), time.monotonic()
            if now - shown_at >= _PERIOD:
                shown_at = now
                show(picture)
        return DONE


def _show_once(viewer: _Viewer, options: argparse.Namespace, answers: TextIO) -> int:
    from cacc_platoon.live.table import table_lines  # noqa: PLC0415

    def complete(picture: Picture) -> bool:
        known = [vehicle.sample is not None for vehicle in picture.vehicles]
        return viewer.watch.ended or (bool(known) and all(known))

    picture = viewer.until(complete, _WAIT)
    if options.json:
        _write_json(answers, picture)
    else:
        from cacc_platoon.live.screen import Screen  # noqa: PLC0415

        columns = Screen(answers).size.columns
        for line in table_lines(picture, columns, len(picture.vehicles) + 20):
            print(line, file=answers)
        answers.flush()
    return DONE


def _shower(
    options: argparse.Namespace, answers: TextIO
) -> tuple[Callable[[Picture], None], float]:
    """Return what shows a picture, and how often [s]."""
    from cacc_platoon.live.screen import Screen, coloured, is_screen  # noqa: PLC0415
    from cacc_platoon.live.summary import summary_line  # noqa: PLC0415
    from cacc_platoon.live.table import table_lines  # noqa: PLC0415

    if options.json:
        return lambda picture: _write_json(answers, picture), _PERIOD
    if not is_screen(answers, os.environ):
        return lambda picture: print(summary_line(picture), file=answers, flush=True), _LINE_PERIOD
    screen, colours = Screen(answers), coloured(os.environ)

    def draw(picture: Picture) -> None:
        columns, lines = screen.size
        screen.draw(table_lines(picture, columns, lines - 1, coloured=colours))

    return draw, _PERIOD


def _write_json(answers: TextIO, picture: Picture) -> None:
    print(json.dumps(picture.to_json()), file=answers, flush=True)


def _serve(viewer: _Viewer, options: argparse.Namespace) -> int:
    """Serve the page and, where that is installed, what other viewers connect to."""
    from cacc_platoon.live.page_server import PageServer  # noqa: PLC0415

    with PageServer(options.port) as page, contextlib.ExitStack() as stack:
        say(f"the page is {page.url}")
        shows: list[Callable[[Picture], None]] = [page.show]
        if show := _foxglove(options.foxglove_port, stack):
            shows.append(show)

        def show_all(picture: Picture) -> None:
            for show in shows:
                show(picture)

        return viewer.serve(show_all)


def _foxglove(port: int, stack: contextlib.ExitStack) -> Callable[[Picture], None] | None:
    """Serve other viewers too, where what that needs is there; say where, or what is missing."""
    from cacc_platoon.live.foxglove_server import foxglove_server  # noqa: PLC0415

    try:
        served_at, show = stack.enter_context(foxglove_server(port))
    except ModuleNotFoundError:
        say(
            "Foxglove, Lichtblick and PlotJuggler cannot connect: pip install foxglove-sdk (the "
            "extra [live]) lets them"
        )
        return None
    say(f"Foxglove, Lichtblick and PlotJuggler connect to ws://127.0.0.1:{served_at}")
    return show

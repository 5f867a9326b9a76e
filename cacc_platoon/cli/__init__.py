"""The `platoon` command: one file per verb, one place that maps errors to exit codes."""

from __future__ import annotations

import argparse
import errno
import importlib
import signal
import sys
from collections.abc import Sequence
from types import ModuleType
from typing import Any, NoReturn

from cacc_platoon import __version__
from cacc_platoon.cli.console import give_up_output, open_standard_streams, say
from cacc_platoon.cli.exit_codes import BAD_INPUT, FAILED, INTERRUPTED
from cacc_platoon.errors import UserError, one_line
from cacc_platoon.stop_signal import EndedError, ended_by

VERBS = (
    "design",
    "run",
    "host",
    "simulate",
    "sweep",
    "report",
    "merge",
    "control",
    "replay",
    "watch",
    "layout",
    "paper",
    "campaign",
    "policy",
    "parameters",
    "doctor",
)
_OF_A_PATH = (
    errno.ENOENT,
    errno.ENOTDIR,
    errno.EISDIR,
    errno.EACCES,
    errno.EPERM,
    errno.ELOOP,
    errno.ENAMETOOLONG,
    errno.EEXIST,
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb and return its exit code."""
    open_standard_streams()
    given = sys.argv[1:] if arguments is None else arguments
    try:
        with ended_by(signal.SIGTERM, signal.SIGHUP):
            try:
                options = _parser(_asked(given)).parse_args(given)
                code: int = options.verb.run(options)
            finally:
                sys.stdout.flush()
    except UserError as error:
        say(str(error))
        return BAD_INPUT
    except BrokenPipeError:  # the reader of our output has seen enough
        give_up_output()
        return FAILED
    except OSError as error:
        return _of_the_system(error)
    except KeyboardInterrupt:
        say("interrupted")
        return INTERRUPTED
    except EndedError as error:
        say(f"stopped by {error.signal.name}")
        return 128 + error.signal
    return code


def _of_the_system(error: OSError) -> int:
    """Say what the system refuses; a path that cannot be used is bad input."""
    if error.filename is None:
        give_up_output()
        say(f"standard output cannot be written: {error.strerror}. Its answer is lost.")
        return FAILED
    say(f"{error.filename}: {error.strerror}. Give a path that can be used.")
    return BAD_INPUT if error.errno in _OF_A_PATH else FAILED


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        """Say what is wrong with the arguments in a line that can be shown."""
        super().error(one_line(message))

    def _print_message(self, message: str, file: Any = None) -> None:
        """Write a message; that it cannot be written is not passed over, as argparse does."""
        (file or sys.stderr).write(message)


def _asked(arguments: Sequence[str]) -> Sequence[str]:
    """Return the verb that is asked for, or all of them for help and for errors."""
    return arguments[:1] if arguments and arguments[0] in VERBS else VERBS


def _parser(names: Sequence[str]) -> argparse.ArgumentParser:
    """Return a parser of these verbs; each costs the import of its module."""
    parser = _Parser(
        prog="platoon",
        description="Choose, run, record and judge a platoon under noisy V2V communication.",
        epilog="Exit codes: 0 done, 1 a run failed, 2 bad input, 3 not proven string "
        "stable, or not from complete and intact data (--check).",
    )
    parser.add_argument("--version", action="version", version=f"cacc_platoon {__version__}")
    verbs = parser.add_subparsers(required=True, metavar="VERB")
    for name in names:
        module = importlib.import_module(f"cacc_platoon.cli.{name}")
        summary = _summary(module)
        verb = verbs.add_parser(name, help=summary, description=summary)
        module.add_arguments(verb)
        verb.set_defaults(verb=module)
    return parser


def _summary(module: ModuleType) -> str:
    return (module.__doc__ or "").partition("\n")[0]

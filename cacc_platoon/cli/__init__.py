"""The `platoon` command: one file per verb, one place that maps errors to exit codes."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from types import ModuleType

from cacc_platoon import __version__
from cacc_platoon.cli.exit_codes import BAD_INPUT, FAILED, INTERRUPTED
from cacc_platoon.errors import UserError

VERBS = ("design", "run", "simulate", "report", "replay", "layout", "paper", "parameters", "doctor")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb and return its exit code."""
    given = sys.argv[1:] if arguments is None else arguments
    try:
        options = _parser(_asked(given)).parse_args(given)
        code: int = options.verb.run(options)
        sys.stdout.flush()
    except UserError as error:
        print(f"platoon: {error}", file=sys.stderr)
        return BAD_INPUT
    except BrokenPipeError:  # the reader of our output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except KeyboardInterrupt:
        print("platoon: interrupted", file=sys.stderr)
        return INTERRUPTED
    return code


def _asked(arguments: Sequence[str]) -> Sequence[str]:
    """Return the verb that is asked for, or all of them for help and for errors."""
    return arguments[:1] if arguments and arguments[0] in VERBS else VERBS


def _parser(names: Sequence[str]) -> argparse.ArgumentParser:
    """Return a parser of these verbs; each costs the import of its module."""
    parser = argparse.ArgumentParser(
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

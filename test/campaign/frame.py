"""The frame of a seeded search: makes cases, runs a command on each, names what breaks a rule.

A search is a function from a random generator and a folder to a `Case`; `search` does the rest.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
EXIT_CODES = (0, 1, 2, 3, 130, 143)
MEMORY = 2**30
PATIENCE = 90.0  # s
MOST_STDERR = 10_000


class Case(NamedTuple):
    """What is tried: a name that says what it is, and the arguments of `platoon`."""

    name: str
    arguments: Sequence[str]


@contextlib.contextmanager
def busy_loops(count: int, limit: float) -> Iterator[None]:
    """Keep cores busy with something else; each loop ends by itself, too, after a limit [s]."""
    loop = f"import time\nend = time.monotonic() + {limit}\nwhile time.monotonic() < end: pass"
    loops = [subprocess.Popen([sys.executable, "-c", loop]) for _ in range(count)]
    try:
        yield
    finally:
        for one in loops:
            one.kill()
            one.wait()


Search = Callable[[random.Random, Path], Case]


def search(searches: Sequence[Search], description: str) -> int:
    """Run `--count` cases of every search from `--seed` on; the exit code is 1 if any broke a rule.

    Case k of a search depends on the seed and on k alone: `--first k --count 1` repeats it.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    options = parser.parse_args()
    broken = 0
    for make in searches:
        codes: dict[int, int] = {}
        for number in range(options.first, options.first + options.count):
            code, line = _try(make, f"{options.seed}/{make.__name__}/{number}")
            codes[code] = codes.get(code, 0) + 1
            broken += bool(line)
            if line:
                print(f"BROKEN {make.__name__} --seed {options.seed} --first {number}: {line}")
        print(f"{make.__name__}: {options.count} cases, exit codes {dict(sorted(codes.items()))}")
    return 1 if broken else 0


def _try(make: Search, seed: str) -> tuple[int, str]:
    """Return the exit code of one case and which rule it broke, empty when none."""
    folder = Path(tempfile.mkdtemp(prefix="cacc_platoon_campaign_"))
    try:
        case = make(random.Random(seed), folder)
        code, errors, memory = run_platoon(case.arguments, folder)
        broken = rule_broken(code, errors, memory)
        return code, broken and f"{case.name}: {broken}"
    finally:
        shutil.rmtree(folder)


def run_platoon(arguments: Sequence[str], folder: Path) -> tuple[int, bytes, int]:
    """Run `platoon` in a folder; return its exit code, what it said and its memory at most [bytes].

    A command that does not end is killed with all it has started; its code is -9 then.
    """
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "agg"}
    with (folder / "stdout").open("wb") as out, (folder / "stderr").open("wb") as err:
        process = subprocess.Popen(
            [sys.executable, "-m", "cacc_platoon", *arguments],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            env=environment,
            start_new_session=True,
        )
    resource.prlimit(process.pid, resource.RLIMIT_DATA, (MEMORY, MEMORY))
    patience = threading.Timer(PATIENCE, os.killpg, (process.pid, signal.SIGKILL))
    patience.start()
    _, status, used = os.wait4(process.pid, 0)
    patience.cancel()
    process.returncode = os.waitstatus_to_exitcode(status)
    return process.returncode, (folder / "stderr").read_bytes(), used.ru_maxrss * 1024


def rule_broken(code: int, errors: bytes, memory: int) -> str:
    """Say which rule a command broke, empty when none."""
    text = errors.decode(errors="replace")
    strange = {letter for letter in text if not letter.isprintable() and letter != "\n"}
    rules = {
        f"did not end within {PATIENCE:g} s": code == -signal.SIGKILL,
        f"traceback: {text[-200:]!r}": "Traceback" in text or "MemoryError" in text,
        f"took {memory / 2**20:.0f} MiB": memory > MEMORY,
        f"exit code {code}: {text[-200:]!r}": code not in EXIT_CODES,
        f"said {len(errors)} bytes on standard error": len(errors) > MOST_STDERR,
        f"said control characters: {sorted(strange)!r}": bool(strange),
        "refused without a word": code == 2 and not text.strip(),
    }
    return next((what for what, broken in rules.items() if broken), "")

"""Real platoons for tests: small, short, and watched for what they leave behind."""

import contextlib
import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from cacc_platoon.testing import Platoon
from cacc_platoon.testing.leftovers import unowned_files

CONFIG = Path(__file__).parents[2] / "config"
PAPER_A = CONFIG / "paper_a.yaml"
PATIENCE = 60.0


@pytest.fixture
def nothing_left() -> Iterator[None]:
    """Nothing stays in shared memory; what others use there at the moment comes and goes."""
    before, pause = unowned_files(), threading.Event()
    yield
    deadline = time.monotonic() + PATIENCE
    while left := unowned_files(before):
        assert time.monotonic() < deadline, left
        pause.wait(0.2)


@pytest.fixture
def platoon(nothing_left: None, tmp_path: Path) -> Iterator[Callable[..., Platoon]]:
    """Start platoons of case A; afterwards nothing of them may be left."""
    with contextlib.ExitStack() as stack:
        platoons: list[Platoon] = []

        def start(*settings: str, **options: Any) -> Platoon:
            folder = tmp_path / f"platoon_{len(platoons)}"
            folder.mkdir()
            made = Platoon(PAPER_A, settings=settings, folder=folder, **options)
            stack.enter_context(made)
            platoons.append(made)
            return made

        yield start
    for made in platoons:
        made.wait_gone()


@pytest.fixture
def replay() -> Callable[..., dict[str, Any]]:
    """Replay one node of a platoon's run by the command, and return its answer."""

    def answer(run: Platoon, vehicle: int, node: str, *options: str) -> dict[str, Any]:
        command = [sys.executable, "-m", "cacc_platoon", "replay", str(run.folder.path), "--json"]
        result = subprocess.run(
            [*command, "--vehicle", str(vehicle), "--node", node, *options],
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
            env=run.environment(),
        )
        assert result.returncode == 0, result.stderr
        return dict(json.loads(result.stdout))

    return answer

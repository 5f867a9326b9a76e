"""Real platoons for tests: small, short, and watched for what they leave behind."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from cacc_platoon.nodes.shared_memory import leftovers
from cacc_platoon.testing import Platoon

CONFIG = Path(__file__).parents[2] / "config"
PAPER_A = CONFIG / "paper_a.yaml"


@pytest.fixture
def platoon(tmp_path: Path) -> Iterator[Callable[..., Platoon]]:
    """Start platoons of case A; afterwards nothing of them may be left."""
    before = leftovers()
    with ExitStack() as stack:
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
    assert leftovers() - before == set()

"""The published cases keep their bits: a change of a digest is a change of a result."""

from pathlib import Path

import pytest

from cacc_platoon.bags.digest import run_digest
from cacc_platoon.runs.folder import fingerprint
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario.file import load_scenario
from cacc_platoon.simulation import simulate
from msg_adapters.topics import Graph

CONFIG = Path(__file__).parents[2] / "config"
MATH = "f2dea44ba4ab072d"
"""How sin, cos and exp round on the machines that gave the digests, Python 3.11 and 3.12."""

CASES = {
    "paper_a": (
        "54480c0cb671f0ec4165131560c48ab3ca97825790c21abf11cd5fafa7761336",
        4967.834157179255,
    ),
    "paper_b": (
        "6784f854e28b128ab547bd59f9d0220067c606c85021407518cdf1090a2b6406",
        5059.805068659839,
    ),
    "paper_c": (
        "9fdc469d0a7611a7d3a1f4356bb47371fdcf3429a4ae31326a27bf59ede5a088",
        4989.361439761094,
    ),
}
"""Digest of the run of a scenario file as it is, and x_12 [m] at its end; since 0.1.0."""


@pytest.mark.parametrize("case", CASES)
def test_the_digest_is_that_of_every_version_before(case: str) -> None:
    scenario = load_scenario(CONFIG / f"{case}.yaml")
    run = simulate(scenario)
    digest, position = CASES[case]
    assert run.position[-1, -1] == pytest.approx(position, abs=1e-9)
    if fingerprint()["math"] == MATH:  # elsewhere the last bits may differ
        assert run_digest(recording_of(run), Graph.of(scenario)) == digest

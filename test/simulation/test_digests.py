"""The published cases keep their bits: a change of a digest is a change of a result."""

from pathlib import Path

import pytest

from cacc_platoon.runs.folder import fingerprint
from cacc_platoon.runs.recording import digest_of, recording_of
from cacc_platoon.scenario.file import load_scenario
from cacc_platoon.simulation import simulate

CONFIG = Path(__file__).parents[2] / "config"
MATH = "f2dea44ba4ab072d"  # of the machine that noted the digests: its sin, cos and exp
DIGESTS = {
    "paper_a": "54480c0cb671f0ec4165131560c48ab3ca97825790c21abf11cd5fafa7761336",
    "paper_b": "6784f854e28b128ab547bd59f9d0220067c606c85021407518cdf1090a2b6406",
    "paper_c": "9fdc469d0a7611a7d3a1f4356bb47371fdcf3429a4ae31326a27bf59ede5a088",
}
LAST = {"paper_a": 0.0, "paper_b": 0.0, "paper_c": 0.0}

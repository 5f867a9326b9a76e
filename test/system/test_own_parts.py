"""Parts of one's own among ours: a controller, a channel that loses messages."""

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from cacc_platoon.scenario_file import load_scenario
from cacc_platoon.simulation import channel_factors, propagate
from cacc_platoon.testing import Platoon

ROOT = Path(__file__).parents[2]


def test_the_example_of_the_readme_runs(tmp_path: Path) -> None:
    blocks = re.findall(r"```python\n# (\w+\.py)\n(.*?)```", (ROOT / "README.md").read_text(), re.S)
    assert [name for name, _ in blocks] == ["my_vehicle.py", "test_my_vehicle.py"]
    for name, code in blocks:
        (tmp_path / name).write_text(code)
    (tmp_path / "config").symlink_to(ROOT / "config")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert "1 passed" in done.stdout, done.stdout


def test_what_the_channel_does_not_deliver_counts_as_zero(platoon: Callable[..., Platoon]) -> None:
    settings = ("run.duration=20", "platoon.followers=2", "record.command=true")
    relay = [sys.executable, str(Path(__file__).with_name("lossy_relay.py"))]
    run = platoon(*settings, by_hand={"vehicle_2/noise_relay": relay})
    result = run.result()
    scenario = load_scenario(ROOT / "config" / "paper_a.yaml", settings)
    factors = channel_factors(scenario)
    factors[::3, 1] = 0.0
    position, _, _ = propagate(scenario, factors[:, np.newaxis, :])
    assert result.status == "finished", result.message
    assert (result.trajectory().position == position[:, 0]).all()

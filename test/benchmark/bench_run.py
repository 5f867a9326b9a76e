"""How fast the paper's platoon runs on real nodes on this machine, everything recorded.

    python test/benchmark/bench_run.py [--runs 3] [--hosts 1 2] [--followers 12 50]

Prints the median, smallest and largest of several runs: real-time factor from the first to the
last sample, time from the command to the first sample, and vehicle-samples per second.
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from cacc_platoon.dds.domain import own_domain

PAPER_A = Path(__file__).parents[2] / "config" / "paper_a.yaml"


def run_once(hosts: str, followers: int, duration: float) -> dict[str, float]:
    """Run the command once and return what run.json says of its speed."""
    with tempfile.TemporaryDirectory() as folder, own_domain() as domain:
        command = [sys.executable, "-m", "cacc_platoon", "run", str(PAPER_A), "--no-report"]
        command += ["-o", f"{folder}/run", "--set", f"run.hosts={hosts}"]
        command += ["--set", f"platoon.followers={followers}", "--set", f"run.duration={duration}"]
        environment = {"ROS_DOMAIN_ID": str(domain)}
        subprocess.run(["env", *(f"{k}={v}" for k, v in environment.items()), *command], check=True)
        info = json.loads(Path(folder, "run", "run.json").read_text())
    rate = (followers + 1) * info["samples"] / info["wall_time"]
    return {
        "real-time factor": info["real_time_factor"],
        "command to first sample [s]": info["start_time"],
        "vehicle-samples/s": rate,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--hosts", nargs="+", default=["1", "2"])
    parser.add_argument("--followers", type=int, nargs="+", default=[12])
    parser.add_argument("--duration", type=float, default=100.0, help="simulated time [s]")
    options = parser.parse_args()
    for followers in options.followers:
        for hosts in options.hosts:
            results = [run_once(hosts, followers, options.duration) for _ in range(options.runs)]
            print(f"N = {followers}, {hosts} hosts, {options.duration:g} s, {options.runs} runs")
            for name in results[0]:
                values = sorted(result[name] for result in results)
                low, middle, high = values[0], statistics.median(values), values[-1]
                print(f"  {name:30} {middle:10.4g}   ({low:.4g} to {high:.4g})")


if __name__ == "__main__":
    main()

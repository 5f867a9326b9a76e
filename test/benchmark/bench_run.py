"""How fast the paper's platoon runs on real nodes on this machine, everything recorded.

    python test/benchmark/bench_run.py [--runs 3] [--hosts 1 2] [--followers 12 50] [--set K=V]
    python test/benchmark/bench_run.py --against ../checkout_of_before --runs 5
    python test/benchmark/bench_run.py --over ideal --channel cam_lossy --runs 7

Prints the median, smallest and largest of several runs: real-time factor from the first to the
last sample, time from the command to the first sample, vehicle-samples per second, and the CPU
time of the command with its hosts, which a busy machine changes least. With --against another
checkout, or with --over another channel, runs in turn with this one, and the ratio of each pair
follows; --cpu 0 keeps everything on one processor, where pairs differ least.
"""

import argparse
import contextlib
import ctypes
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from cacc_platoon.dds.domain import own_domain

PR_SET_CHILD_SUBREAPER = 36  # orphans of the command, its hosts, are then waited for here
HERE = Path(__file__).resolve().parents[2]


def run_once(
    checkout: Path, settings: Sequence[str], followers: int, channel: str
) -> dict[str, float]:
    """Run the command of a checkout once and return how fast it was."""
    with tempfile.TemporaryDirectory() as folder, own_domain() as domain:
        command = [sys.executable, "-m", "cacc_platoon", "run", "config/paper_a.yaml"]
        command += ["--no-report", "-o", f"{folder}/run"]
        command += ["--channel", channel] if channel else []
        for setting in settings:
            command += ["--set", setting]
        environment = {"PYTHONPATH": str(checkout), "ROS_DOMAIN_ID": str(domain)}
        before = cpu_time()
        subprocess.run(command, check=True, cwd=checkout, env=os.environ | environment)
        cpu = cpu_time() - before
        info = json.loads(Path(folder, "run", "run.json").read_text())
    rate = (followers + 1) * info["samples"] / info["wall_time"]
    return {
        "real-time factor": info["real_time_factor"],
        "command to first sample [s]": info["start_time"],
        "vehicle-samples/s": rate,
        "CPU time [s]": cpu,
    }


def cpu_time() -> float:
    """Return the CPU time of all processes that have ended so far, hosts too [s]."""
    with contextlib.suppress(ChildProcessError):
        while True:
            os.waitpid(-1, 0)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def show(name: str, values: Sequence[float]) -> None:
    middle = statistics.median(values)
    print(f"  {name:30} {middle:10.4g}   ({min(values):.4g} to {max(values):.4g})")


def measure(options: argparse.Namespace, followers: int, hosts: str) -> None:
    settings = [f"run.hosts={hosts}", f"platoon.followers={followers}", *options.set]
    settings.append(f"run.duration={options.duration}")
    tried = [(HERE, options.channel)]
    if options.against or options.over:
        tried.append((options.against or HERE, options.over or options.channel))
    results: list[list[dict[str, float]]] = [[] for _ in tried]
    for _ in range(options.runs):
        for found, (checkout, channel) in zip(results, tried, strict=True):
            found.append(run_once(checkout, settings, followers, channel))
    print(f"N = {followers}, {hosts} hosts, {options.duration:g} s, {options.runs} runs")
    for name in results[0][0]:
        show(name, [result[name] for result in results[0]])
        if len(tried) > 1:
            show("  the other", [result[name] for result in results[1]])
            pairs = zip(*results, strict=True)
            show("  ratio, this over the other", [one[name] / two[name] for one, two in pairs])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--hosts", nargs="+", default=["1", "2"])
    parser.add_argument("--followers", type=int, nargs="+", default=[12])
    parser.add_argument("--duration", type=float, default=100.0, help="simulated time [s]")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--against", type=Path, help="another checkout, run in turn with this one")
    parser.add_argument("--channel", default="", help="a channel by name")
    parser.add_argument("--over", default="", help="another one, run in turn with it")
    parser.add_argument("--cpu", type=int, help="run everything on this processor alone")
    options = parser.parse_args()
    if options.cpu is not None:
        os.sched_setaffinity(0, {options.cpu})
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1)
    for followers in options.followers:
        for hosts in options.hosts:
            measure(options, followers, hosts)


if __name__ == "__main__":
    main()

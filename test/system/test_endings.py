"""However a run ends, its folder says so, and its processes come to an end."""

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader

from cacc_platoon.dds import shared_memory
from cacc_platoon.runs.info import NO_BAG, EndStatus, RunInfo
from cacc_platoon.runs.locate import locate
from cacc_platoon.stop_signal import REPEATED
from cacc_platoon.testing import Platoon
from msg_adapters.topics import VehicleTopics

SMALL = ("run.duration=60", "platoon.followers=3", "run.real_time_factor=10")
"""Six seconds of wall time, slow enough to interfere."""
QUICK = ("run.duration=20", "platoon.followers=3", "run.real_time_factor=4")
"""Five seconds: a run that is over before the graph has told of it is not to be seen."""
LENGTH = 20_000
"""More than a part has after a second of SMALL, less than after three [bytes]."""
HANGS = """
import ctypes
import rclpy.node
ends = rclpy.node.Node.destroy_node
def hangs(self):
    return ends(self) if self.get_name().startswith("_") else ctypes.PyDLL(None).pause()
rclpy.node.Node.destroy_node = hangs  # with the lock held, but for the hidden one of a start
"""

LATE = """
import multiprocessing, os, signal, threading
from types import SimpleNamespace
from cacc_platoon.supervision.launcher import HostProcesses, _forkserver_pid, prepare

def sleep(plan, lifeline):
    threading.Event().wait(600)

if __name__ == "__main__":
    prepare()
    first = multiprocessing.get_context("forkserver").Process(target=os.getpid)
    first.start()
    first.join()
    server = _forkserver_pid()
    os.kill(server, signal.SIGSTOP)
    processes = HostProcesses()
    processes.start([SimpleNamespace(name="late"), SimpleNamespace(name="later")], sleep)
    threading.Timer(0.3, os.kill, (server, signal.SIGCONT)).start()
    processes.stop(patience=0.1)
"""

Start = Callable[..., Platoon]


def said(run: Platoon) -> RunInfo:
    """Return what run.json says, which has to be there."""
    info = RunInfo.read(run.folder.path)
    assert info
    return info


def report(run: Platoon) -> "subprocess.CompletedProcess[str]":
    """Let the command report on a run."""
    command = [sys.executable, "-m", "cacc_platoon", "report", str(run.folder.path)]
    return subprocess.run(command, capture_output=True, text=True, timeout=180, check=False)


def parent(pid: int) -> int:
    """Return the parent of a process."""
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


def is_forkserver(pid: int) -> bool:
    """Return whether a process is the one that starts the hosts."""
    return "forkserver" in Path(f"/proc/{pid}/cmdline").read_text()


def fill_disk(pid: int) -> None:
    """From now on no file of a process grows beyond LENGTH, as on a disk that is full."""
    _, hard = resource.prlimit(pid, resource.RLIMIT_FSIZE)
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (LENGTH, hard))


def hanging(folder: Path) -> dict[str, str]:
    """Return an environment in which nodes never end, as with a mutex that a dead process holds."""
    (folder / "sitecustomize.py").write_text(HANGS)
    paths = [str(folder), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {"PYTHONPATH": os.pathsep.join(paths)}


def test_a_run_that_goes_on_says_so_and_is_left_alone(platoon: Start) -> None:
    run = platoon(*SMALL, hosts=2)
    run.wait(run.folder.path.is_dir, 30, "the folder")
    run.wait((run.folder.path / "run.json").is_file, 1, "run.json")
    assert said(run).status is EndStatus.RUNNING
    run.wait_sample(200)
    answer = report(run)
    assert answer.returncode == 2
    assert f"process {said(run).pid} is at it" in answer.stderr
    assert run.result().status == "finished"
    locate(run.folder.path)


def test_a_run_whose_supervisor_is_killed_says_so_in_its_report(platoon: Start) -> None:
    run = platoon(*SMALL, hosts=2)
    run.wait_sample(200)
    run.kill("supervisor")
    run.wait_gone(timeout=10)
    assert not run.folder.bag.exists()
    assert said(run).status is EndStatus.RUNNING
    versions = said(run).versions
    answer = report(run)
    assert answer.returncode == 0, answer.stderr
    assert "its process was killed" in answer.stdout
    info = said(run)
    assert (info.status, info.versions) == (EndStatus.FAILED, versions)
    assert len(info.digest) == 64
    assert min(info.messages.values()) > 100
    with Reader(run.folder.bag) as reader:
        assert {c.topic: c.msgcount for c in reader.connections}.items() >= info.messages.items()
    assert (run.folder.path / "report.html").exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_the_second_signal_undoes_nothing(platoon: Start, number: signal.Signals) -> None:
    run = platoon(*SMALL, hosts=2)
    run.wait_sample(200)
    for _ in range(3):
        os.kill(said(run).pid or 0, number)
    result = run.result()
    assert (result.exit_code, result.status) == (128 + number, "interrupted")
    assert result.message == f"stopped by {number.name}"
    assert "Traceback" not in result.errors
    with Reader(run.folder.bag) as reader:
        assert reader.message_count > 15 * 100


def test_a_full_disk_is_said_in_run_json(platoon: Start) -> None:
    run = platoon(*SMALL, hosts=2)
    run.wait_sample(20)
    for pid in run.living():
        fill_disk(pid)
    result = run.result()
    assert (result.exit_code, result.status) == (1, "failed")
    assert "cannot be written: File too large" in result.message
    assert NO_BAG in result.message
    assert not run.folder.bag.exists()
    locate(run.folder.path)
    info = said(run)
    assert info.status is EndStatus.FAILED
    assert NO_BAG not in info.message
    assert "cannot be written: File too large" in info.message


def test_a_bag_that_cannot_be_written_is_written_later(platoon: Start) -> None:
    run = platoon(*QUICK, hosts=2)
    run.wait_sample(20)
    fill_disk(said(run).pid or 0)
    result = run.result()
    assert (result.exit_code, result.status) == (1, "failed")
    assert result.message == f"{NO_BAG} (File too large)"
    locate(run.folder.path)
    info = said(run)
    assert (info.status, info.message) == (EndStatus.FINISHED, "")
    assert set(info.messages.values()) == {2001}


@pytest.mark.parametrize("what", ["parts", "folder"])
def test_what_is_deleted_in_mid_run_is_noticed_at_once(platoon: Start, what: str) -> None:
    run = platoon(*SMALL, hosts=2)
    run.wait_sample(100)
    shutil.rmtree(run.folder.parts if what == "parts" else run.folder.path)
    begun = time.monotonic()
    result = run.result()
    assert time.monotonic() - begun < 5.0
    assert result.exit_code == 1
    assert "deleted" in result.errors
    assert "Traceback" not in result.errors
    if what == "parts":
        assert result.status == "failed"
        assert "deleted" in result.message
        answer = report(run)
        assert answer.returncode == 2
        assert result.message.partition(";")[0] in answer.stderr


def test_a_run_without_samples_is_reported_as_what_it_was(platoon: Start) -> None:
    run = platoon(*SMALL, "run.manual_nodes=[vehicle_2/vehicle]", "run.start_timeout=2")
    result = run.result()
    assert result.status == "failed"
    answer = report(run)
    assert answer.returncode == 2
    assert f"the run failed before anything was recorded: {result.message}" in answer.stderr
    assert "vehicle_2/vehicle" in answer.stderr


def test_a_run_whose_nodes_never_end_ends(platoon: Start, tmp_path: Path) -> None:
    run = platoon(*QUICK, hosts=2, environment=hanging(tmp_path))
    run.wait((run.folder.path / "run.json").is_file, 30, "run.json")
    run.wait(lambda: said(run).digest != "", 60, "the bag")
    result = run.result()
    assert (result.exit_code, result.status) == (0, "finished")
    assert run.folder.bag.is_dir()
    run.wait_gone()
    shared_memory.sweep()


def test_a_node_that_never_ends_is_ended(platoon: Start, tmp_path: Path) -> None:
    run = platoon(
        *SMALL, "run.manual_nodes=[vehicle_2/vehicle]", environment=hanging(tmp_path), hosts=2
    )
    run.start("vehicle_2/vehicle")
    run.wait_sample(100)
    run.kill("vehicle_2/vehicle", signal.SIGTERM)
    result = run.result()
    assert (result.exit_code, result.status) == (1, "failed")
    assert "vehicle_2/vehicle) was stopped by SIGTERM" in result.message
    run.wait_gone(timeout=15)
    shared_memory.sweep()


def after(run: Platoon, seconds: float) -> None:
    """Wait for some time."""
    begun = time.monotonic()
    run.wait(lambda: time.monotonic() - begun > seconds, seconds + 5, "a while")


def test_whoever_insists_leaves_the_bag_for_later(platoon: Start) -> None:
    run = platoon("run.duration=120", "platoon.followers=3", hosts=2)
    run.wait((run.folder.path / "run.json").is_file, 30, "run.json")
    run.wait(lambda: NO_BAG in said(run).message, 120, "the writing of the bag")
    run.kill("supervisor", signal.SIGINT)
    after(run, 0.1)
    run.kill("supervisor", signal.SIGSTOP)  # so that the bag is not written meanwhile
    after(run, REPEATED)
    assert not run.folder.bag.exists()
    run.kill("supervisor", signal.SIGINT)
    run.kill("supervisor", signal.SIGCONT)
    result = run.result()
    assert (result.exit_code, result.status) == (130, "interrupted")
    assert result.message == f"{NO_BAG} (stopped meanwhile)"
    locate(run.folder.path)
    assert (said(run).status, said(run).message) == (EndStatus.FINISHED, "")


def test_a_run_killed_while_it_writes_the_bag_is_complete_after_a_report(platoon: Start) -> None:
    run = platoon("run.duration=80", "platoon.followers=3", hosts=2)
    run.wait((run.folder.path / "run.json").is_file, 30, "run.json")
    run.wait(lambda: NO_BAG in said(run).message, 60, "the writing of the bag")
    run.kill("supervisor")
    run.wait_gone(timeout=10)
    assert report(run).returncode == 0
    assert (said(run).status, said(run).message) == (EndStatus.FINISHED, "")
    assert set(said(run).messages.values()) == {8001}


def test_a_failure_that_the_graph_shows_names_no_innocent_node(platoon: Start) -> None:
    run = platoon(*SMALL, hosts=2)
    run.wait_sample(100)
    run.publisher(VehicleTopics("/platoon", 1).pose)
    result = run.result()
    assert result.exit_code == 1
    assert "/platoon/vehicle_1/pose has 2 publishers" in result.message
    assert "stopped at sample" not in result.message


def test_a_killed_forkserver_is_named(platoon: Start) -> None:
    run = platoon(*SMALL, hosts=2)
    run.wait_sample(100)
    server = parent(run.pid("vehicle_1/vehicle"))
    os.kill(server, signal.SIGKILL)
    result = run.result()
    assert (result.exit_code, result.status) == (1, "failed")
    assert result.message.startswith(f"the forkserver (process {server})")
    assert "was killed by SIGKILL" in result.message
    assert "host " not in result.message


def test_a_stopped_forkserver_keeps_nothing_from_ending(platoon: Start) -> None:
    run = platoon(*QUICK, hosts=2)
    run.wait_sample(100)
    os.kill(parent(run.pid("vehicle_1/vehicle")), signal.SIGSTOP)
    result = run.result()
    assert (result.exit_code, result.status) == (0, "finished")


@pytest.mark.parametrize(("stopped", "limit"), [("the forkserver", 15), ("a host", 8)])
def test_who_does_not_start_the_hosts_is_named_and_ended(
    platoon: Start, stopped: str, limit: int
) -> None:
    """A host may be stopped before it has told its number to anybody."""
    run = platoon(*SMALL, f"run.start_timeout={limit}", hosts=2)
    supervisor = run.pid("supervisor")
    found: list[int] = []

    def comes() -> bool:
        living = [pid for pid in run.living() if pid != supervisor]
        servers = [pid for pid in living if parent(pid) == supervisor and is_forkserver(pid)]
        hosts = [pid for pid in living if parent(pid) in servers]
        found[:] = servers if stopped == "the forkserver" else hosts
        return bool(found)

    run.wait(comes, 30, stopped)
    os.kill(found[0], signal.SIGSTOP)
    result = run.result()
    assert (result.exit_code, result.status) == (1, "failed")
    named = "the forkserver (process" if stopped == "the forkserver" else ""
    assert named in result.message
    assert "answer" in result.message or "appear" in result.message, result.message
    run.wait_gone()


def test_a_host_that_starts_while_the_run_ends_is_ended(tmp_path: Path) -> None:
    script = tmp_path / "late.py"
    script.write_text(LATE)
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, timeout=120, check=False
    )
    assert (done.returncode, done.stderr) == (0, b"")


def test_run_json_is_never_half_written(platoon: Start) -> None:
    run = platoon(*QUICK, hosts=2)
    file, states = run.folder.path / "run.json", set()

    def read() -> bool:
        if file.exists():
            states.add(json.loads(file.read_text())["status"])
        return "finished" in states

    run.wait(read, 60, "the end of the run")
    assert states == {"running", "finished"}
    assert run.result().exit_code == 0

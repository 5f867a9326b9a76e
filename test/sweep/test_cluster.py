"""A study on a Dask scheduler and its workers: the same table, whoever is killed meanwhile."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from cacc_platoon.cli import main
from cacc_platoon.sweep.rows import ROWS_FILE

pytest.importorskip("distributed")
pytestmark = pytest.mark.slow

PLAN = """
settings: {run.duration: 20.0, platoon.followers: 4}
matrix: {controller.time_headway: [0.8, 0.95], v2v.rho: [3.0, 5.0, 9.0, 20.0]}
seeds: [1, 2]
criteria: [string_stable]
"""
ROWS = 16
PATIENCE = 120.0


class Cluster:
    """A scheduler and workers on the loopback interface, in processes of their own."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self._folder, self._processes = folder, list[subprocess.Popen[bytes]]()

    def start(self, *arguments: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "distributed.cli.dask_" + arguments[0], *arguments[1:]]
        process = subprocess.Popen(
            command,
            cwd=self._folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self._processes.append(process)
        return process

    def scheduler(self) -> subprocess.Popen[bytes]:
        place = ("--host", "127.0.0.1", "--port", f"{self.port}", "--no-dashboard")
        return self.start("scheduler", *place)

    def worker(self) -> subprocess.Popen[bytes]:
        own = ("--no-dashboard", "--no-nanny", "--nthreads", "1", "--host", "127.0.0.1")
        return self.start("worker", self.address, *own, "--death-timeout", "100")

    def end(self) -> None:
        for process in self._processes:
            process.kill()
            process.wait()


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    (tmp_path / "dask").mkdir()
    made = Cluster(tmp_path / "dask")
    yield made
    made.end()


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("plans") / "mine.yaml"
    file.write_text(PLAN)
    return file


@pytest.fixture(scope="module")
def table(plan: Path, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    folder = tmp_path_factory.mktemp("study") / "one"
    assert main(["sweep", str(plan), "-o", str(folder), "--workers", "2"]) == 0
    return (folder / "table.csv").read_bytes()


@pytest.fixture
def sweep(plan: Path, tmp_path: Path, cluster: Cluster) -> Callable[[], subprocess.Popen[str]]:
    def start() -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "cacc_platoon", "sweep", str(plan)]
        command += ["-o", str(tmp_path / "study"), "--scheduler", cluster.address]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    return start


def rows_of(study: Path) -> list[int]:
    file = study / ROWS_FILE
    lines = file.read_bytes().split(b"\n")[:-1] if file.exists() else []
    return [json.loads(line)["row"] for line in lines]


def wait_rows(study: Path, number: int) -> None:
    deadline = time.monotonic() + PATIENCE
    while len(rows_of(study)) < number:
        assert time.monotonic() < deadline, rows_of(study)


def test_a_worker_that_is_killed_and_a_scheduler_that_is_started_again_lose_nothing(
    cluster: Cluster, sweep: Callable[[], subprocess.Popen[str]], table: bytes, tmp_path: Path
) -> None:
    study = tmp_path / "study"
    scheduler = cluster.scheduler()
    first, *_ = [cluster.worker() for _ in range(4)]
    process = sweep()
    wait_rows(study, 2)
    first.kill()
    wait_rows(study, 6)
    scheduler.kill()
    scheduler.wait()
    cluster.scheduler()
    cluster.worker()
    out, err = process.communicate(timeout=PATIENCE)
    assert (process.returncode, err, f"{ROWS} rows" in out) == (0, "", True)
    assert (study / "table.csv").read_bytes() == table
    assert sorted(rows_of(study)) == [*range(ROWS)]


def test_where_no_scheduler_is_it_is_one_line(
    plan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cacc_platoon.sweep.cluster.PATIENCE", 0.5)
    for address in ("tcp://127.0.0.1:9", "nowhere at all"):
        folder = tmp_path / "study"
        arguments = ["sweep", str(plan), "-o", str(folder), "--scheduler", address]
        assert main(arguments) == 2
        assert "no scheduler answers there. Start `dask scheduler`" in capsys.readouterr().err
    assert main([*arguments, "--workers", "2"]) == 2
    assert "Leave --workers and --backend out" in capsys.readouterr().err

"""From where a platoon can be reached, how it does with little shared memory, what a kill leaves.

Two machines are made of namespaces. Where the kernel or a container forbids these, the same tests
look at the sockets of the platoon alone, and print that.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

from cacc_platoon.dds import shared_memory
from cacc_platoon.dds.domain import own_domain
from cacc_platoon.runs.info import RunInfo
from cacc_platoon.testing import Platoon

HERE, ELSEWHERE = "10.77.0.1", "10.77.0.2"
STRANGER = Path(__file__).with_name("stranger.py")
PAPER_A = Path(__file__).parents[2] / "config" / "paper_a.yaml"
TWO = ("platoon.followers=2", "run.hosts=2")
LOOKS = 25  # of 0.2 s each; where it can, a stranger has heard from a platoon after two or three
PATIENCE = 90.0


class Machine:
    """A machine, which lives as long as a process that has namespaces of its own.

    Parameters
    ----------
    command : sequence of str
        Makes the namespaces; OSError when it cannot.
    memory : str, optional
        What is mounted as shared memory.
    """

    def __init__(self, command: Sequence[str], memory: str = "tmpfs") -> None:
        boot = f"mount -t {memory} tmpfs /dev/shm && ip link set lo up && echo up && exec cat"
        self.process = subprocess.Popen(
            [*command, "sh", "-c", boot],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        assert self.process.stdout is not None
        if (said := self.process.stdout.readline()) != "up\n":
            self.process.wait(PATIENCE)
            raise OSError(f"{' '.join(command)}: {said.strip()}")

    def command(self, *command: str) -> list[str]:
        """Return a command as it runs on this machine."""
        inside = ["nsenter", "--preserve-credentials", "-U", "-n", "-m"]
        return [*inside, "-t", str(self.process.pid), "--", *command]

    def run(self, *command: str) -> str:
        """Run a command on this machine and return what it prints; OSError when it fails."""
        done = subprocess.run(
            self.command(*command), capture_output=True, text=True, timeout=PATIENCE, check=False
        )
        if done.returncode:
            raise OSError(f"{' '.join(command)}: {done.stderr.strip()}")
        return done.stdout

    def joined(self) -> Machine:
        """Return another machine at the other end of a cable."""
        other = Machine(self.command("unshare", "-n", "-m"))
        peer = ["peer", "name", "cable", "netns", str(other.process.pid)]
        self.run("ip", "link", "add", "cable", "type", "veth", *peer)
        for machine, address in ((self, HERE), (other, ELSEWHERE)):
            machine.run("ip", "address", "add", f"{address}/24", "dev", "cable")
            machine.run("ip", "link", "set", "cable", "up")
        for machine in (self, other):
            machine.wait_cable()
        return other

    def wait_cable(self) -> None:
        """Wait until the network is up: DDS leaves out what is not when it starts."""
        wait(lambda: " UP " in self.run("ip", "-br", "link", "show", "cable"), "the cable")

    def end(self) -> None:
        """End the machine; its network goes with it."""
        self.process.communicate(timeout=PATIENCE)


class ThisMachine:
    """Stands in for the first machine where none can be made."""

    def command(self, *command: str) -> list[str]:
        """Return the command."""
        return list(command)


@pytest.fixture
def boot(capsys: pytest.CaptureFixture[str]) -> Iterator[Callable[..., list[Machine]]]:
    """Return a function that makes machines, none where that is forbidden, which is printed."""
    with contextlib.ExitStack() as stack:

        def make(count: int, memory: str = "tmpfs") -> list[Machine]:
            try:
                machines = [Machine(["unshare", "-r", "-n", "-m"], memory)]
                stack.callback(machines[0].end)
                if count > 1:
                    machines.append(machines[0].joined())
                    stack.callback(machines[1].end)
            except OSError as error:
                with capsys.disabled():
                    print(f"\ntest_network.py: looks at sockets alone, no machines: {error}")
                return []
            return machines

        yield make


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen[bytes]]]:
    """Start processes of a platoon, which has nothing of ours in its environment."""
    started: list[subprocess.Popen[bytes]] = []
    with own_domain() as domain:

        def begin(machine: Machine | ThisMachine, *command: str, **variables: str):
            environment = {**os.environ, "ROS_DOMAIN_ID": str(domain), "MARK": str(tmp_path)}
            with (tmp_path / f"{len(started)}.txt").open("wb") as output:
                started.append(
                    subprocess.Popen(
                        machine.command(*command),
                        stdout=output,
                        stderr=subprocess.STDOUT,
                        env={**environment, **variables},
                    )
                )
            return started[-1]

        yield begin
        for process in started:
            process.terminate()
        for process in started:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(PATIENCE)
            process.kill()


def wait(condition: Callable[[], object], what: str) -> None:
    deadline, pause = time.monotonic() + PATIENCE, threading.Event()
    while not condition():
        assert time.monotonic() < deadline, what
        pause.wait(0.01)


def marked(mark: str) -> list[Path]:
    """Return the processes, below /proc, that were started with a mark."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if f"MARK={mark}".encode() in (process / "environ").read_bytes().split(b"\0"):
                found.append(process)
    return found


def addresses(process: Path) -> set[str]:
    """Return the addresses at which the numbered ports of a process's DDS receive.

    Ports that are only sent from have numbers that the kernel has chosen.
    """
    found = set()
    with contextlib.suppress(OSError):
        inodes = {os.readlink(fd) for fd in (process / "fd").iterdir()}  # noqa: PTH115
        for line in (process / "net" / "udp").read_text().splitlines()[1:]:
            fields = line.split()
            address, port = fields[1].split(":")
            if f"socket:[{fields[9]}]" in inodes and 7000 <= int(port, 16) < 32768:
                found.add(socket.inet_ntoa(bytes.fromhex(address)[::-1]))
    return found


def receiving(mark: str) -> list[set[str]]:
    """Return the addresses of each process with a mark that receives."""
    return [found for found in map(addresses, marked(mark)) if found]


def run_command(folder: Path, *settings: str) -> list[str]:
    command = [sys.executable, "-m", "cacc_platoon", "run", str(PAPER_A)]
    for setting in (*TWO, *settings):
        command += ["--set", setting]
    return [*command, "-o", str(folder), "--no-report"]


def manual_commands(folder: Path) -> list[list[str]]:
    """Return what `ros2 run` executes: the supervisor and the nodes of a platoon."""

    def executable(module: str, name: str, namespace: str, *parameters: str) -> list[str]:
        code = f"import sys; from cacc_platoon.{module} import {name} as run; sys.exit(run())"
        command = [sys.executable, "-c", code, "--ros-args", "-r", f"__ns:=/platoon{namespace}"]
        command += ["--params-file", str(PAPER_A), "-p", "platoon.followers:=2"]
        command += ["-p", "run.duration:=3000.0"]
        return [*command, *(word for text in parameters for word in ("-p", text))]

    nodes = [("vehicle_0", "leader")]
    nodes += [(f"vehicle_{i}", kind) for i in (1, 2) for kind in ("vehicle", "noise_relay")]
    supervisor = [f"record.directory:={folder}", "run.spawn:=false"]
    return [
        executable("cli.supervisor", "main", "", *supervisor),
        *(executable("supervision.entry_points", kind, f"/{vehicle}") for vehicle, kind in nodes),
    ]


def commands(way: str, folder: Path) -> list[list[str]]:
    if way == "started by hand":
        return manual_commands(folder)
    return [run_command(folder, "run.duration=3000")]


@pytest.mark.parametrize("way", ["run", "started by hand"])
@pytest.mark.parametrize("opened", [False, True])
def test_a_platoon_is_reached_from_elsewhere_only_when_opened(
    boot, start, tmp_path: Path, way: str, opened: bool
) -> None:
    here, elsewhere = boot(2) or (ThisMachine(), None)
    looked, run = tmp_path / "0.txt", tmp_path / "run"
    opening = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
    if elsewhere:
        start(elsewhere, sys.executable, str(STRANGER), ROS_STATIC_PEERS=HERE, MARK="", **opening)
        wait(lambda: "looking" in looked.read_text(), "the stranger")
    opening = opening if opened else {}
    processes = [start(here, *command, **opening) for command in commands(way, run)]
    wait((run / "parts").is_dir, "the platoon's run folder")
    nodes = 6 if way == "started by hand" else 3
    wait(lambda: len(receiving(str(tmp_path))) >= nodes, "the platoon's sockets")
    before = looked.read_text().count("\n")
    if elsewhere and opened:
        wait(lambda: "heard" in looked.read_text(), "the stranger hears")
    elif elsewhere:
        wait(lambda: looked.read_text().count("\n") > before + LOOKS, "the stranger looks")
        assert set(looked.read_text().splitlines()) == {"looking", "publishers 0"}
    found = set().union(*receiving(str(tmp_path)))
    assert ("0.0.0.0" in found) if opened else (found == {"127.0.0.1"})
    wait(lambda: sum(map(os.path.getsize, run.glob("parts/*/*"))) > 300_000, "samples")
    processes[0].send_signal(signal.SIGINT)
    assert processes[0].wait(PATIENCE) == 130
    info = RunInfo.read(run)
    assert info is not None
    assert info.samples, info.message


@pytest.mark.parametrize("memory", ["64k", "4m"])
def test_with_little_shared_memory_nodes_use_udp(boot, start, tmp_path: Path, memory: str) -> None:
    (here,) = boot(1, f"tmpfs -o size={memory}") or (ThisMachine(),)
    said, run = tmp_path / "0.txt", tmp_path / "run"
    variables = {}
    if isinstance(here, ThisMachine):
        variables = {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
    process = start(here, *run_command(run, "run.duration=20"), **variables)
    used: set[str] = set()

    def ended() -> bool:
        for path in marked(str(tmp_path)):
            with contextlib.suppress(OSError):
                used.update(shared_memory.used_segments(path.name))
        return process.poll() is not None

    wait(ended, "the end of the run")
    assert process.returncode == 0, said.read_text()
    assert used == set()
    lines = said.read_text().splitlines()
    assert isinstance(here, ThisMachine) or len(lines) == 1, lines
    assert all(line.startswith("platoon: warning: /dev/shm has ") for line in lines)


PLANTED = """<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"><log>
<use_default>FALSE</use_default><consumer><class>FileConsumer</class>
<property><name>filename</name><value>{victim}</value></property>
<property><name>append</name><value>FALSE</value></property>
</consumer></log></dds>
"""
PLATOON = (sys.executable, "-m", "cacc_platoon", "run", str(PAPER_A))
LEADER = (
    *(sys.executable, "-c", "from cacc_platoon.supervision.entry_points import *; exit(leader())"),
    *("--ros-args", "-r", "__ns:=/platoon/vehicle_0", "--params-file", str(PAPER_A)),
)


@pytest.mark.parametrize("command", [PLATOON, LEADER], ids=["platoon run", "a leader"])
@pytest.mark.parametrize(
    ("trouble", "words"),
    [
        ("ip link set lo down", "127.0.0.1 cannot be reached ("),
        ("cat /dev/zero >/dev/shm/full || true", "/dev/shm is full: ROS cannot be loaded"),
    ],
)
def test_where_ros_cannot_start_nothing_is_started(
    boot, tmp_path: Path, trouble: str, words: str, command: Sequence[str]
) -> None:
    for here in boot(1, "tmpfs -o size=1m"):
        here.run("sh", "-c", trouble)
        done = subprocess.run(
            here.command(*command),
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
            cwd=tmp_path,
        )
        assert done.returncode == 2, done
        (line,) = done.stderr.splitlines()
        assert line.removeprefix("platoon: ").startswith(words)
        assert not list(tmp_path.iterdir())


def test_a_profile_in_the_working_folder_is_not_read(tmp_path: Path) -> None:
    """Anybody may have put it there, in /tmp for instance, and it could empty any file of ours."""
    victim = tmp_path / "victim"
    victim.write_text("precious")
    (tmp_path / "DEFAULT_FASTRTPS_PROFILES.xml").write_text(PLANTED.format(victim=victim))
    command = [sys.executable, "-m", "cacc_platoon", "doctor", "--json"]
    environment = {k: v for k, v in os.environ.items() if k != "SKIP_DEFAULT_XML_FILE"}
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, timeout=PATIENCE, check=False
    )
    assert json.loads(done.stdout)["DDS"]["ok"]
    assert victim.read_text() == "precious"


def test_a_host_killed_in_its_first_moments_leaves_nothing(
    platoon: Callable[..., Platoon],
) -> None:
    run = platoon("run.duration=60", *TWO)
    supervisor = run.pid("supervisor")

    def hosts_that_use_memory() -> list[int]:
        found = []
        for pid in run.living():
            with contextlib.suppress(OSError):
                if pid != supervisor and shared_memory.used_segments(pid):
                    found.append(pid)
        return found

    wait(hosts_that_use_memory, "a host")
    for pid in hosts_that_use_memory():
        os.kill(pid, signal.SIGKILL)
    result = run.result()
    assert (result.exit_code, result.status) == (1, "failed"), result


@pytest.fixture
def own_folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Give platoons of this test a folder of their own, near enough for the name of a socket."""
    with tempfile.TemporaryDirectory() as folder:
        monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
        yield Path(folder)


def test_a_killed_command_leaves_no_temporary_files(
    own_folder: Path, platoon: Callable[..., Platoon], tmp_path: Path
) -> None:
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    run = platoon("run.duration=6000", *TWO, environment={"TMPDIR": str(temporary)})
    run.wait_sample(10)
    run.kill("supervisor")
    run.wait_gone()
    assert list(temporary.iterdir()) == []
    shared_memory.sweep()
    assert not list(own_folder.rglob("pymp-*"))


def test_a_profile_that_is_removed_opens_nothing(own_folder: Path, start, tmp_path: Path) -> None:
    start(ThisMachine(), *run_command(tmp_path / "run", "run.duration=3000"))

    def written() -> list[Path]:
        return list(own_folder.rglob("loopback-*.xml"))

    wait(written, "the profile")
    removed = written()[0]
    removed.unlink()
    wait(lambda: len(receiving(str(tmp_path))) >= 3, "the platoon's sockets")
    assert set().union(*receiving(str(tmp_path))) == {"127.0.0.1"}
    assert written() == [removed]


@pytest.mark.parametrize("domain", ["100000", "233", "one"])
def test_a_domain_that_there_is_not_is_refused_at_once(tmp_path: Path, domain: str) -> None:
    run, hand = run_command(tmp_path / "run"), manual_commands(tmp_path / "run")
    for command in (run, hand[0], hand[1], [sys.executable, "-m", "cacc_platoon", "doctor"]):
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
            env={**os.environ, "ROS_DOMAIN_ID": domain},
        )
        told = done.stdout + done.stderr
        assert done.returncode == (1 if command[-1] == "doctor" else 2), told
        assert f"ROS_DOMAIN_ID = '{domain}' is no DDS domain, a number from 0 to 232" in told
        assert command[-1] == "doctor" or told.count("\n") == 1, told
    assert not (tmp_path / "run").exists()

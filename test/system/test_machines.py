"""A platoon on three machines, made of namespaces: the same digest as the simulation, on any wire.

Where the kernel or a container forbids namespaces there is nothing to look at, which is printed.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from cacc_platoon.bags.digest import run_digest
from cacc_platoon.runs.info import ELSEWHERE, RunInfo
from cacc_platoon.runs.recorded_run import read_run
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario.file import load_scenario
from cacc_platoon.simulation import simulate
from msg_adapters.topics import Graph

PAPER_A = Path(__file__).parents[2] / "config" / "paper_a.yaml"
WIRE = Path(__file__).with_name("lossy_wire.py")
PATIENCE = 90.0
HOSTS = {"east": "2-3", "west": "4-5"}
ADDRESSES = {"home": "10.78.0.1", "east": "10.78.0.2", "west": "10.78.0.3"}
SETTINGS = (
    *("platoon.followers=5", "run.duration=2", "leader.start=0.2", "run.hosts=1"),
    "run.remote_hosts=[" + ", ".join(f"{name}={text}" for name, text in HOSTS.items()) + "]",
)
OPEN = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "ROS_DOMAIN_ID": "7"}


def wait(condition: Callable[[], object], what: str) -> None:
    deadline, pause = time.monotonic() + PATIENCE, threading.Event()
    while not condition():
        assert time.monotonic() < deadline, what
        pause.wait(0.02)


class Machine:
    """A machine, which lives as long as a process that has namespaces and a name of its own."""

    def __init__(self, name: str, unshare: Sequence[str]) -> None:
        self.name = name
        boot = "mount -t tmpfs tmpfs /dev/shm && ip link set lo up && hostname $0 && echo up && cat"
        self.process = subprocess.Popen(
            [*unshare, "sh", "-c", boot, name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        assert self.process.stdout is not None
        if (said := self.process.stdout.readline()) != "up\n":
            self.end()
            raise OSError(said.strip())

    def command(self, *command: str) -> list[str]:
        """Return a command as it runs on this machine."""
        inside = ["nsenter", "--preserve-credentials", "-U", "-n", "-m", "-u"]
        return [*inside, "-t", str(self.process.pid), "--", *command]

    def run(self, *commands: str) -> str:
        """Run commands on this machine and return what they print; OSError when one fails."""
        script = " && ".join(commands)
        done = subprocess.run(
            self.command("sh", "-c", script), capture_output=True, text=True, timeout=PATIENCE
        )
        if done.returncode:
            raise OSError(f"{script}: {done.stderr.strip()}")
        return done.stdout

    def is_connected(self) -> bool:
        """Whether its network is up: DDS leaves out what is not when it starts."""
        return "LOWER_UP" in self.run("ip -br link show cable")

    def end(self) -> None:
        """End the machine; its network goes with it."""
        self.process.communicate(timeout=PATIENCE)


class Lab:
    """Three machines on one wire, and the processes of a platoon on them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.stack = contextlib.ExitStack()
        self.wire = self._boot("wire", ["unshare", "-r", "-n", "-m", "-u"])
        self.wire.run("ip link add name wire type bridge mcast_snooping 0", "ip link set wire up")
        unshare = self.wire.command("unshare", "-n", "-m", "-u")
        self.machines = {name: self._boot(name, unshare) for name in ADDRESSES}
        self.processes: dict[str, subprocess.Popen[bytes]] = {}

    def _boot(self, name: str, unshare: Sequence[str]) -> Machine:
        machine = Machine(name, unshare)
        self.stack.callback(machine.end)
        return machine

    def connect(self, *lossy: str, multicast: bool = True) -> None:
        """Connect the machines, some by a cable that delays, loses and reorders packets."""
        for seed, (name, machine) in enumerate(self.machines.items()):
            port, pid = f"port_{name}", machine.process.pid
            if name in lossy:
                self._lossy(port, seed)
                self.wire.run(f"ip link set far_{name} netns {pid}")
                machine.run(f"ip link set far_{name} name cable")
            else:
                self.wire.run(f"ip link add {port} type veth peer name cable netns {pid}")
            self.wire.run(f"ip link set {port} master wire up")
            if not multicast:
                self.wire.run(f"ip link set dev {port} type bridge_slave mcast_flood off")
            machine.run(f"ip address add {ADDRESSES[name]}/24 dev cable", "ip link set cable up")
        for machine in self.machines.values():
            wait(machine.is_connected, "the cable")

    def _lossy(self, port: str, seed: int) -> None:
        """Make both ends of a cable in user space."""
        options = ["--loss", "0.05", "--delay", "0.0005", "0.005", "--seed", str(seed)]
        carrier = subprocess.Popen(
            self.wire.command(
                sys.executable, str(WIRE), port, port.replace("port", "far"), *options
            ),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.stack.callback(carrier.communicate, timeout=PATIENCE)
        assert carrier.stdout is not None
        if (said := carrier.stdout.readline()) != "up\n":
            raise OSError(f"no TAP device: {said.strip()} {carrier.stdout.read()}")

    def start_program(self, name: str, *words: str) -> None:
        """Start a program on a machine, which is ended with it."""
        process = subprocess.Popen(self.machines[name].command(*words), stdout=subprocess.DEVNULL)
        self.stack.callback(process.wait, PATIENCE)
        self.stack.callback(process.terminate)

    def start(self, name: str, words: Sequence[str], variables: Mapping[str, str]) -> None:
        """Start a command of the package on a machine."""
        with (self.folder / f"{name}.txt").open("wb") as output:
            self.processes[name] = subprocess.Popen(
                self.machines[name].command(sys.executable, "-m", "cacc_platoon", *words),
                stdout=output,
                stderr=subprocess.STDOUT,
                env={**os.environ, **OPEN, **variables},
            )

    def start_platoon(
        self, *settings: str, hosts: Sequence[str] = tuple(HOSTS), **variables: str
    ) -> None:
        """Start the supervisor at home, and hosts on the other machines."""
        given = [word for text in (*SETTINGS, *settings) for word in ("--set", text)]
        self.settings = (*SETTINGS, *settings)
        words = ["run", str(PAPER_A), *given, "-o", str(self.run), "--no-report"]
        self.start("home", words, variables)
        for name in hosts:
            self.start(name, ["host", name, "--part", str(self.folder / "parts")], variables)

    @property
    def run(self) -> Path:
        """The run folder."""
        return self.folder / "run"

    def said(self) -> str:
        """Return what all processes have said."""
        return "\n".join(
            f"{name}: {(self.folder / f'{name}.txt').read_text()}" for name in self.processes
        )

    def result(self) -> RunInfo:
        """Wait for the end of the run and return what run.json says."""
        wait(lambda: self.processes["home"].poll() is not None, self.said())
        info = RunInfo.read(self.run)
        assert info is not None, self.said()
        return info

    def recorded(self) -> int:
        """Return how many bytes are recorded on the machine of the supervisor."""
        return sum(map(os.path.getsize, self.run.glob("parts/*/*.cdr")))

    def wait_recorded(self, size: int) -> None:
        """Wait until so many bytes are recorded on the machine of the supervisor."""
        wait(lambda: self.recorded() > size, "samples")

    def pause(self, seconds: float) -> None:
        """Let a fault last."""
        threading.Event().wait(seconds)

    def simulated(self) -> str:
        """Return the digest of the simulation."""
        scenario = load_scenario(PAPER_A, self.settings)
        return run_digest(recording_of(simulate(scenario)), Graph.of(scenario))

    def close(self) -> None:
        """End what is left."""
        for process in self.processes.values():
            process.terminate()
        for process in self.processes.values():
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(20.0)
            process.kill()
        self.stack.close()


Labs = Callable[..., list[Lab]]


@pytest.fixture
def labs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Iterator[Callable[..., list[Lab]]]:
    """Return a function that makes three machines and connects them; none where that cannot be."""
    with contextlib.ExitStack() as stack:

        def make(*lossy: str, multicast: bool = True) -> list[Lab]:
            try:
                lab = Lab(tmp_path)
                stack.callback(lab.close)
                lab.connect(*lossy, multicast=multicast)
            except OSError as error:
                with capsys.disabled():
                    print(f"\ntest_machines.py: looks at nothing, no machines: {error}")
                return []
            return [lab]

        yield make


def assert_same(lab: Lab, info: RunInfo) -> None:
    """The run is whole, and what the simulation is; it says which machines it was on."""
    assert info.status == "finished", f"{info.message}\n{lab.said()}"
    assert info.digest == lab.simulated()
    machines = {host.name: host.machine for host in info.hosts}
    assert machines == {"0": "home", "east": "east", "west": "west"}
    for name in HOSTS:
        assert lab.processes[name].wait(PATIENCE) == 0, lab.said()
    assert {path.name for path in (lab.folder / "parts").iterdir()} == {"host_east", "host_west"}


def test_over_multicast_while_one_machine_is_cut_off_for_a_while(labs: Labs) -> None:
    for lab in labs():
        lab.start_platoon("run.real_time_factor=1")
        lab.wait_recorded(10_000)
        lab.wire.run("ip link set port_east down")
        cut = lab.recorded()
        lab.pause(2.0)
        still = lab.recorded()
        lab.pause(0.5)
        assert cut <= still == lab.recorded(), "nobody goes on without it"
        lab.wire.run("ip link set port_east up")
        assert_same(lab, lab.result())


def test_over_static_peers_on_a_wire_that_delays_loses_and_reorders(labs: Labs) -> None:
    for lab in labs("east", "west", multicast=False):
        lab.start_platoon(ROS_STATIC_PEERS=";".join(ADDRESSES.values()))
        assert_same(lab, lab.result())


def test_through_a_discovery_server(labs: Labs) -> None:
    for lab in labs(multicast=False):
        server = shutil.which("fast-discovery-server", path=Path(sys.executable).parent)
        server = server or shutil.which("fast-discovery-server")
        assert server is not None, "fast-discovery-server comes with rclpy"
        lab.start_program("home", server, "-i", "0", "-l", ADDRESSES["home"], "-p", "11811")
        lab.start_platoon(
            ROS_DISCOVERY_SERVER=f"{ADDRESSES['home']}:11811", ROS_SUPER_CLIENT="TRUE"
        )
        assert_same(lab, lab.result())


def test_a_machine_that_is_cut_off_for_good_is_named_and_its_part_can_be_added(labs: Labs) -> None:
    for lab in labs():
        lab.start_platoon("run.real_time_factor=1", "run.stall_timeout=2")
        lab.wait_recorded(10_000)
        lab.wire.run("ip link set port_east down")
        info = lab.result()
        assert (lab.processes["home"].returncode, info.status) == (1, "failed")
        assert info.message.startswith("no progress for 2")
        assert "host east (process " in info.message
        assert "does not answer" in info.message
        (east,) = (host for host in info.hosts if host.name == "east")
        assert f"{ELSEWHERE}: host east, {east.part} on east" in info.message
        before = read_run(lab.run / "bag", lab.run).trajectory.position
        assert np.isfinite(before[:10, 5]).all()
        assert np.isnan(before[:, 2]).all()
        assert lab.processes["east"].wait(PATIENCE) == 1
        merge = [sys.executable, "-m", "cacc_platoon", "merge", str(lab.run), east.part]
        done = subprocess.run(merge, capture_output=True, text=True, timeout=PATIENCE)
        assert done.returncode == 1, done
        assert ELSEWHERE not in done.stderr
        after = read_run(lab.run / "bag", lab.run).trajectory.position
        assert np.isfinite(after[:10]).all()

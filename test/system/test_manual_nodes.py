"""A manually started node among supervisors that are not its own: it goes on waiting."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeAlias

import pytest
import rclpy
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import String

from cacc_platoon.dds.domain import own_domain
from cacc_platoon.nodes import qos
from cacc_platoon.supervision.protocol import VERSION, RunPhase, RunStatus

CODE = "import sys; from cacc_platoon.supervision.entry_points import vehicle; sys.exit(vehicle())"
PATIENCE = 90.0
NEWER = VERSION + 1
LAST = RunStatus("last", RunPhase.FINISHED, 200, 201).to_json()

Process: TypeAlias = subprocess.Popen[bytes]

pytestmark = pytest.mark.usefixtures("nothing_left")


@pytest.fixture
def domain() -> Iterator[int]:
    with own_domain() as number:
        yield number


@pytest.fixture
def status(domain: int) -> Iterator[Publisher]:
    """Publish what a supervisor would."""
    context = Context()
    rclpy.init(args=[], context=context, domain_id=domain)
    node = Node("supervisor", namespace="/platoon", context=context, use_global_arguments=False)
    yield node.create_publisher(String, "/platoon/status", qos.latched())
    node.destroy_node()
    rclpy.shutdown(context=context)


def start(domain: int, log: Path, *arguments: str) -> Process:
    """Start a vehicle that logs to a file."""
    ros = ["--ros-args", "-r", "__ns:=/platoon/vehicle_2", *arguments]
    with log.open("wb") as output:
        return subprocess.Popen(
            [sys.executable, "-c", CODE, *ros],
            env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
            stderr=output,
        )


def wait(condition: Callable[[], bool], node: Process, log: Path) -> None:
    """Wait for a condition; the node has to live on."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        with pytest.raises(subprocess.TimeoutExpired):
            node.wait(timeout=0.1)
        assert time.monotonic() < deadline, log.read_text()


def test_a_node_waits_for_a_run_that_goes_on_and_that_it_understands(
    domain: int, status: Publisher, tmp_path: Path
) -> None:
    log = tmp_path / "log"
    status.publish(String(data=LAST))
    node = start(domain, log)
    newer = RunStatus("newer").to_json().replace(f'"format": {VERSION}', f'"format": {NEWER}')

    def say_until(text: str, words: str) -> None:
        def said() -> bool:
            status.publish(String(data=text))
            return words in log.read_text()

        wait(said, node, log)

    try:
        wait(lambda: status.get_subscription_count() > 0, node, log)
        assert status.wait_for_all_acked(Duration(seconds=PATIENCE))
        say_until(LAST, "waiting for the supervisor")
        say_until(newer, f"/platoon/status: the message is of format {NEWER}")
        say_until(RunStatus("next").to_json(), "run next: waiting")
    finally:
        node.terminate()
        node.wait(PATIENCE)
    text = log.read_text()
    assert "run last" not in text
    assert text.count("of format") == 1, text
    assert f"understands format {VERSION}." in text


def test_a_node_that_no_supervisor_comes_for_ends(domain: int, tmp_path: Path) -> None:
    log = tmp_path / "log"
    node = start(domain, log, "-p", "run.start_timeout:=0.2")
    assert node.wait(PATIENCE) == 1
    assert "no supervisor has come for 2 s" in log.read_text()


def test_a_node_that_comes_after_the_run_ends(
    domain: int, status: Publisher, tmp_path: Path
) -> None:
    log = tmp_path / "log"
    status.publish(String(data=LAST))
    node = start(domain, log, "-p", "run.start_timeout:=3.0")
    assert node.wait(PATIENCE) == 1
    assert "no supervisor has come for 3 s" in log.read_text()


def handled(pid: int, number: signal.Signals) -> bool:
    """Return whether a process handles a signal."""
    status = Path(f"/proc/{pid}/status").read_text()
    (caught,) = re.findall(r"^SigCgt:\s*(\w+)", status, re.M)
    return bool(int(caught, 16) & 1 << (number - 1))


@pytest.mark.parametrize("seconds", [0.01, 0.1, 0.2, 0.3, 0.4, 0.5])
def test_an_early_signal_is_not_lost(domain: int, tmp_path: Path, seconds: float) -> None:
    """Once Python runs our code, a Ctrl-C ends it without a traceback, whatever it is loading."""
    log = tmp_path / "log"
    node = start(domain, log)
    wait(lambda: handled(node.pid, signal.SIGTERM), node, log)
    with pytest.raises(subprocess.TimeoutExpired):
        node.wait(seconds)
    node.send_signal(signal.SIGINT)
    assert node.wait(PATIENCE) == 130
    assert "Traceback" not in log.read_text()

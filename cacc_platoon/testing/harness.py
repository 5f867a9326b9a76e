"""Scripted multi-node tests: start a real platoon, wait, kill, freeze, inject, look at the result.

    with Platoon("config/paper_a.yaml", settings=["run.duration=20"], hosts=2) as platoon:
        platoon.wait_sample(500)
        platoon.freeze("vehicle_3/vehicle", seconds=1.0)
        result = platoon.result()
    assert result.status == "finished"

Every platoon is the `platoon run` command in a process of its own and in a DDS domain of its own;
what the harness knows it has from topics and from the run folder. To test a controller of your
own, start its node yourself: see `manual_nodes`.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from cacc_platoon.dds.domain import own_domain
from cacc_platoon.dds.environment import over_udp_alone, prefer_local
from cacc_platoon.dds.shared_memory import cleared_segments
from cacc_platoon.nodes import qos
from cacc_platoon.nodes.node import MESSAGE_TYPES
from cacc_platoon.runs.folder import RunFolder
from cacc_platoon.runs.info import HostInfo, RunInfo
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import format_scenario, load_scenario
from cacc_platoon.supervision.protocol import ProtocolError, RunStatus
from cacc_platoon.supervision.supervisor_node import MANY
from cacc_platoon.testing.result import Result
from msg_adapters.topics import PlatoonTopics, Topic

PATIENCE = 60.0
GOODBYE = 10.0
MARK = "CACC_PLATOON_TEST"
ENTRY_POINTS = "cacc_platoon.supervision.entry_points"


class Platoon:
    """A platoon of real nodes in processes and a DDS domain of its own.

    Parameters
    ----------
    scenario : Scenario, str or Path
        What to run, or its file.
    settings : sequence of str, optional
        `key=value` texts, as for `platoon run --set`.
    hosts : int or str, optional
        Replaces run.hosts.
    manual_nodes : mapping of str to sequence of str, optional
        Commands that start nodes instead of ours, by node name such as "vehicle_3/vehicle"; the
        harness adds --ros-args with the node's namespace and the scenario. An empty command is
        left to `start`.
    environment : mapping of str to str, optional
        Added to the environment of all processes.
    folder : Path, optional
        Where to put the run folder; by default a temporary one that goes with the last result.
    report : bool, optional
        Whether the command judges the run at the end, as `platoon run` does by default.

    Attributes
    ----------
    events : list of dict
        What has happened so far, as in events.jsonl.
    """

    def __init__(
        self,
        scenario: Scenario | str | Path,
        *,
        settings: Sequence[str] = (),
        hosts: int | str | None = None,
        manual_nodes: Mapping[str, Sequence[str]] | None = None,
        environment: Mapping[str, str] | None = None,
        folder: Path | None = None,
        report: bool = False,
    ) -> None:
        base = folder or Path(tempfile.mkdtemp(prefix="cacc_platoon_"))
        self.folder = RunFolder(base / "run")
        if folder is None:
            weakref.finalize(self.folder, shutil.rmtree, base, ignore_errors=True)
        self._flags = [] if report else ["--no-report"]
        self._manual_nodes = dict(manual_nodes or {})
        settings = list(settings)
        if hosts is not None:
            settings.append(f"run.hosts={hosts}")
        if manual_nodes:
            settings.append(f"run.manual_nodes=[{', '.join(manual_nodes)}]")
        self.scenario_file = base / "scenario.yaml"
        if isinstance(scenario, Scenario):
            self.scenario_file.write_text(format_scenario(scenario), encoding="utf-8")
            self.scenario = load_scenario(self.scenario_file, settings)
        else:
            self.scenario = load_scenario(scenario, settings)
        self.scenario_file.write_text(format_scenario(self.scenario), encoding="utf-8")
        self._environment = dict(environment or {})
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._status: RunStatus | None = None
        self.events: list[dict[str, Any]] = []
        self._output, self._errors = base / "output.txt", base / "errors.txt"
        self._mark = f"{MARK}={os.getpid()}-{id(self)}"

    def __enter__(self) -> Platoon:
        """Start the supervisor, the hosts and the manually started nodes."""
        self._stack = contextlib.ExitStack()
        self.domain = self._stack.enter_context(own_domain())
        try:
            self._start()
        except BaseException:
            self._stack.close()
            raise
        return self

    def _start(self) -> None:
        self._observe()
        self._stack.callback(self._end_processes)
        self._run(
            "supervisor",
            [
                *(sys.executable, "-m", "cacc_platoon", "run", str(self.scenario_file)),
                *("-o", str(self.folder.path), *self._flags),
            ],
            self._output,
            self._errors,
        )
        for node, command in self._manual_nodes.items():
            if command:
                self.start(node, command)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End every process that is left, cleanly where possible."""
        with cleared_segments():
            self._stack.close()

    def start(self, node: str, command: Sequence[str] = (), parameters: Iterable[str] = ()) -> int:
        """Start a node and return its process id; without a command it is one of ours.

        `parameters` are `name:=value` texts.
        """
        namespace, _, kind = node.rpartition("/")
        own = f"import sys; from {ENTRY_POINTS} import {kind}; sys.exit({kind}())"
        arguments = [*(command or (sys.executable, "-c", own)), "--ros-args"]
        arguments += ["-r", f"__ns:={self.scenario.platoon.namespace}/{namespace}".rstrip("/")]
        arguments += ["--params-file", str(self.scenario_file)]
        for parameter in parameters:
            arguments += ["-p", parameter]
        log = self._output.with_name(f"{node.replace('/', '_')}.txt")
        return self._run(node, arguments, log, log)

    def wait_state(self, state: str, timeout: float = PATIENCE) -> None:
        """Wait until the run is in a state: waiting, matching, running, finished or failed."""
        self.wait(lambda: self._phase == state, timeout, f"state {state}")

    def wait_sample(self, sample: int, timeout: float = PATIENCE) -> None:
        """Wait until everything is recorded up to and including a sample."""
        self.wait(lambda: self._sample >= sample, timeout, f"sample {sample}")

    def wait_event(self, kind: str, timeout: float = PATIENCE) -> dict[str, Any]:
        """Wait until something of a kind has happened, and return the first such event."""
        self.wait(lambda: any(e["kind"] == kind for e in self.events), timeout, f"a {kind}")
        return next(event for event in self.events if event["kind"] == kind)

    def set_parameter(self, node: str, name: str, value: Any) -> str:
        """Set a parameter of a running node as `ros2 param set` does; return why not, if so."""
        full = f"{self.scenario.platoon.namespace}/{node}/set_parameters"
        client = self._node.create_client(SetParameters, full)
        self.wait(client.service_is_ready, PATIENCE, full)
        parameter = Parameter(name, value=value).to_parameter_msg()
        answer = client.call_async(SetParameters.Request(parameters=[parameter]))
        self.wait(answer.done, PATIENCE, f"an answer of {full}")
        (result,) = answer.result().results
        return "" if result.successful else str(result.reason)

    def wait(self, condition: Callable[[], bool], timeout: float, what: str) -> None:
        """Wait for a condition; messages are received meanwhile.

        Raises
        ------
        TimeoutError
            When it does not come true in time; the line says how far the run is.
        """
        deadline = time.monotonic() + timeout
        while not condition():
            self._executor.spin_once(timeout_sec=0.05)
            if time.monotonic() > deadline:
                raise TimeoutError(
                    f"{what} did not come within {timeout:g} s: the run is "
                    f"{self._phase or 'not to be seen'} at sample {self._sample}; "
                    f"its output: {self._errors.read_text().strip() or 'nothing'}"
                )

    def environment(self) -> dict[str, str]:
        """Return the environment in which a process of yours meets this platoon."""
        environment = {
            **os.environ,
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_PYTHON_CHECK_FIELDS": "1",
            **self._environment,
            **dict([self._mark.split("=")]),
            "ROS_DOMAIN_ID": str(self.domain),
        }
        prefer_local(environment)
        return environment

    def wait_node(self, node: str, timeout: float = PATIENCE) -> None:
        """Wait until the supervisor knows a node."""
        self.wait(lambda: any(node in host.nodes for host in self._hosts), timeout, node)

    def pid(self, node: str) -> int:
        """Return the process of a node, such as "vehicle_3/vehicle", or of "supervisor"."""
        if node in self._processes:
            return self._processes[node].pid
        for host in self._hosts:
            if node in host.nodes:
                return host.pid
        raise LookupError(f"{node} is in none of the hosts that have appeared: {self._hosts}")

    def living(self) -> list[int]:
        """Return the ids of all processes of this platoon that live, whoever started them."""
        found = []
        for process in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                if self._mark.encode() in (process / "environ").read_bytes().split(b"\0"):
                    found.append(int(process.name))
        return found

    def wait_gone(self, timeout: float = GOODBYE) -> None:
        """Wait until no process of this platoon lives.

        Raises
        ------
        TimeoutError
            When some still do.
        """
        deadline = time.monotonic() + timeout
        while living := self.living():
            if time.monotonic() > deadline:
                raise TimeoutError(f"processes {living} live on after {timeout:g} s")
            time.sleep(0.05)

    def kill(self, node: str, number: signal.Signals = signal.SIGKILL) -> None:
        """Send a signal to a node's process."""
        os.kill(self.pid(node), number)

    def freeze(self, node: str, seconds: float) -> None:
        """Stop a node's process for a while, as a debugger or a swapping machine does."""
        self.kill(node, signal.SIGSTOP)
        time.sleep(seconds)
        self.kill(node, signal.SIGCONT)

    def publisher(self, topic: Topic) -> Callable[[int, float], None]:
        """Return a function that publishes (stamp [ns], x) on a topic, as a foreign publisher."""
        message_type = MESSAGE_TYPES[topic.kind.type_name]
        publisher = self._node.create_publisher(message_type, topic.name, qos.stream(self.scenario))
        self._wait_matched(publisher)
        return lambda stamp, x: publisher.publish(topic.codec.encode(stamp, x))

    def _wait_matched(self, publisher: Publisher) -> None:
        """Wait for a subscriber, or for the end: a foreign publisher may be noticed at once."""
        self.wait(
            lambda: publisher.get_subscription_count() > 0 or self._ended,
            PATIENCE,
            "a subscriber",
        )

    def send(self, message: Any, topic: str) -> None:
        """Publish a message, or a list of them, on any topic, as a foreign publisher would."""
        messages = message if isinstance(message, list) else [message]
        profile = qos.latched()
        profile.depth = len(messages)
        publisher = self.advertise(type(messages[0]), topic, profile)
        self._wait_matched(publisher)
        for each in messages:
            publisher.publish(each)

    def advertise(self, message_type: type, topic: str, profile: QoSProfile | int) -> Publisher:
        """Return a publisher on any topic that has sent nothing yet, as a foreign one."""
        return self._node.create_publisher(message_type, topic, profile)

    def subscribe(
        self,
        message_type: type,
        topic: str,
        receive: Callable[[Any], None],
        profile: QoSProfile | int = 10,
    ) -> None:
        """Call a function with the messages of any topic, while the harness waits."""
        self._node.create_subscription(message_type, topic, receive, profile)

    def publishers_of(self, topic: str) -> int:
        """Return how many publishers a topic has."""
        return int(self._node.count_publishers(topic))

    def result(self, timeout: float = 2 * PATIENCE) -> Result:
        """Wait until the command has ended and return how."""
        process = self._processes["supervisor"]
        self.wait(lambda: process.poll() is not None, timeout, "the end of the run")
        info = RunInfo.read(self.folder.path)
        return Result(
            process.returncode,
            info.status if info else "",
            info.message if info else "",
            info.digest if info else "",
            info,
            self.folder,
            self._output.read_text(),
            self._errors.read_text(),
        )

    def _observe(self) -> None:
        """Listen to the status from a context of this process's own."""
        context = Context()
        rclpy.init(args=[], context=context, domain_id=self.domain)
        self._stack.callback(rclpy.try_shutdown, context=context)
        with over_udp_alone(os.environ):  # nobody can remove a socket of this process
            self._node = Node("observer", context=context, use_global_arguments=False)
        self._stack.callback(self._node.destroy_node)
        self._executor = SingleThreadedExecutor(context=context)
        self._stack.callback(self._executor.shutdown)
        self._executor.add_node(self._node)
        topics = PlatoonTopics(self.scenario.platoon.namespace)
        self._node.create_subscription(String, topics.status, self._on_status, qos.latched())
        self.subscribe(
            String,
            topics.events,
            lambda message: self.events.append(json.loads(message.data)),
            qos.latched(MANY),
        )

    def _on_status(self, message: String) -> None:
        with contextlib.suppress(ProtocolError):  # a test may send nonsense there
            self._status = RunStatus.from_json(message.data)

    @property
    def _ended(self) -> bool:
        return self._processes["supervisor"].poll() is not None

    @property
    def _phase(self) -> str:
        return self._status.phase if self._status else ""

    @property
    def _sample(self) -> int:
        return self._status.sample if self._status else -1

    @property
    def _hosts(self) -> tuple[HostInfo, ...]:
        return self._status.hosts if self._status else ()

    def _run(self, name: str, command: Sequence[str], output: Path, errors: Path) -> int:
        with output.open("wb") as out, errors.open("ab") as err:
            process = subprocess.Popen(
                list(command),
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                env=self.environment(),
            )
        self._processes[name] = process
        return process.pid

    def _end_processes(self) -> None:
        for number in (signal.SIGTERM, signal.SIGKILL):
            for process in self._processes.values():
                if process.poll() is None:
                    process.send_signal(signal.SIGCONT)
                    process.send_signal(number)
            deadline = time.monotonic() + GOODBYE
            for process in self._processes.values():
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(max(0.0, deadline - time.monotonic()))

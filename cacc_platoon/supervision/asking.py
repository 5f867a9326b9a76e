"""Asks the supervisor of a running platoon for something, as a client of its services."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import rclpy
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from std_srvs.srv import Trigger

from cacc_platoon.dds import shared_memory
from cacc_platoon.errors import UserError
from cacc_platoon.nodes.executor import create_executor, spin_for
from cacc_platoon.supervision.participant import start_ros, taking_part
from cacc_platoon.supervision.pause_services import STEP_SAMPLES, Heeded
from msg_adapters.topics import PlatoonTopics

LIMIT = 10.0
"""How long the supervisor may take to appear, and to answer [s]."""
_POLL = 0.02


class Asker:
    """Asks for a pause, and for its end.

    Parameters
    ----------
    namespace : str
        The platoon's.
    stopped : callable
        Returns whether not to wait any longer.

    Raises
    ------
    UserError
        By any method, when the supervisor does not answer.
    """

    def __init__(self, namespace: str, stopped: Callable[[], object]) -> None:
        self._topics, self._stopped = PlatoonTopics(namespace), stopped
        start_ros([])
        with taking_part():
            self._node = Node("asker", use_global_arguments=False)
        self._executor = create_executor()
        self._executor.add_node(self._node)

    def ask(self, what: str, samples: int) -> Heeded:
        """Ask to "pause", to "resume", or to "step" by some samples."""
        match what:
            case "pause":
                return self._trigger(self._topics.pause)
            case "resume":
                return self._trigger(self._topics.resume)
            case _:
                return self._step(samples)

    def _step(self, samples: int) -> Heeded:
        """Say how far a step goes, and ask for one."""
        value = ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=samples)
        request = SetParameters.Request(parameters=[Parameter(name=STEP_SAMPLES, value=value)])
        result = self._call(SetParameters, self._topics.set_parameters, request).results[0]
        if not result.successful:
            return Heeded(False, str(result.reason))
        return self._trigger(self._topics.step)

    def close(self) -> None:
        """Leave DDS."""
        with shared_memory.cleared_segments():
            self._executor.shutdown()
            self._node.destroy_node()
            rclpy.try_shutdown()

    def _trigger(self, service: str) -> Heeded:
        answer = self._call(Trigger, service, Trigger.Request())
        return Heeded(bool(answer.success), str(answer.message))

    def _call(self, kind: type, service: str, request: object) -> Any:
        """Return the answer to a request."""
        client = self._node.create_client(kind, service)
        self._await(client.service_is_ready, service, "is not there")
        future = client.call_async(request)
        self._await(future.done, service, "does not answer")
        return future.result()

    def _await(self, arrived: Callable[[], bool], service: str, what: str) -> None:
        deadline = time.monotonic() + LIMIT
        while not arrived():
            if self._stopped():
                raise KeyboardInterrupt
            if time.monotonic() > deadline:
                raise UserError(
                    f"{service}: {what} for {LIMIT:g} s. Is a platoon running in this domain "
                    "(ROS_DOMAIN_ID) and under this --namespace?"
                )
            spin_for(self._executor, _POLL)

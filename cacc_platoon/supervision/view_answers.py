"""A host answers what viewers want to know of its vehicles, while there is one."""

from __future__ import annotations

import time
from collections.abc import Callable

from std_msgs.msg import Int64, String

from cacc_platoon.nodes import qos
from cacc_platoon.nodes.recorder import RecorderNode
from cacc_platoon.supervision.view_message import HostView
from msg_adapters.topics import PlatoonTopics

LEAST_PERIOD = 0.05
"""Whoever asks more often is not answered more often [s]."""


class ViewAnswers:
    """Publishes the view of a host at each sample that is asked for, if anybody sees it.

    It costs a run nothing as long as nobody looks: what is shown is read from what is recorded.

    Parameters
    ----------
    recorder : RecorderNode
        Has what the host records, and carries the messages.
    host : str
        Name of the host.
    run : callable
        Returns which run the host belongs to, empty as long as it has met none.
    """

    def __init__(self, recorder: RecorderNode, host: str, run: Callable[[], str]) -> None:
        self._recorder, self._host, self._run = recorder, host, run
        self._answered = 0.0
        topics = PlatoonTopics(recorder.scenario.platoon.namespace)
        self._publisher = recorder.create_publisher(String, topics.view, qos.glimpse())
        recorder.create_subscription(Int64, topics.view_request, self._answer, qos.glimpse())

    def _answer(self, request: Int64) -> None:
        now, run = time.monotonic(), self._run()
        seen = run and self._publisher.get_subscription_count()
        if request.data < 0 or now - self._answered < LEAST_PERIOD or not seen:
            return
        self._answered = now
        readings = self._recorder.readings(request.data)
        view = HostView(run, self._host, request.data, readings)
        self._publisher.publish(String(data=view.to_json()))

"""The services with which a user lets a run pause, go on, and go on by some samples."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from rclpy.node import Node
from std_srvs.srv import Trigger

from cacc_platoon.supervision.pausing import Asked
from cacc_platoon.supervision.run_events import PauseAsked, ResumeAsked, StepAsked
from msg_adapters.topics import PlatoonTopics

STEP_SAMPLES = "run.step_samples"
"""The parameter that says how far a step goes."""


class Heeded(NamedTuple):
    """What came of what a user asked for.

    Attributes
    ----------
    heeded : bool
        Whether it is done.
    text : str
        What the run does now, or why it is not done.
    """

    heeded: bool
    text: str


def offer_services(node: Node, topics: PlatoonTopics, ask: Callable[[Asked], Heeded]) -> None:
    """Offer pause, resume and step in the namespace of a platoon."""

    def offer(name: str, asked: Callable[[], Asked]) -> None:
        def answer(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            response.success, response.message = ask(asked())
            return response

        node.create_service(Trigger, name, answer)

    offer(topics.pause, PauseAsked)
    offer(topics.resume, ResumeAsked)
    offer(topics.step, lambda: StepAsked(int(node.get_parameter(STEP_SAMPLES).value)))

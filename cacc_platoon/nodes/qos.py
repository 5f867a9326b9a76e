"""Quality of service of every topic; losses and delays belong to the relay, never to DDS."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from cacc_platoon.scenario import Scenario
from msg_adapters.topics import queue_depth


def stream(scenario: Scenario, *, best_effort: bool = False) -> QoSProfile:
    """Return the profile of data topics: reliable, volatile, deeper than the lockstep window.

    A subscriber may settle for `best_effort`.
    """
    reliable, lossy = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=queue_depth(scenario),
        reliability=lossy if best_effort else reliable,
        durability=DurabilityPolicy.VOLATILE,
    )


def glimpse() -> QoSProfile:
    """Return the profile of what viewers see: best effort, so that no viewer holds anybody up."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=100,
        reliability=ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.VOLATILE,
    )


def latched(depth: int = 1) -> QoSProfile:
    """Return the profile of topics whose last messages, so many, are for latecomers too."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )

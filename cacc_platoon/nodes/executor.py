"""The executor of a host: events where rclpy has them, a wait set otherwise."""

from __future__ import annotations

from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.task import Future


def create_executor() -> Executor:
    """Return the fastest single-threaded executor this rclpy has."""
    try:
        from rclpy.experimental.events_executor import EventsExecutor  # noqa: PLC0415
    except ImportError:
        return SingleThreadedExecutor()
    return EventsExecutor()


def spin_for(executor: Executor, seconds: float) -> None:
    """Run callbacks for a while.

    Waiting for a future that never comes lets the events executor run callback after callback
    without returning to Python in between, unlike spin_once.
    """
    executor.spin_until_future_complete(Future(executor=executor), timeout_sec=seconds)

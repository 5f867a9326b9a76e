"""Two processes that exchange a message over DDS, to see whether anything is in the way."""

from __future__ import annotations

import multiprocessing
import os
import time
from multiprocessing.connection import Connection

import rclpy
from rclpy.node import Node
from std_msgs.msg import Int64

from cacc_platoon.dds import shared_memory
from cacc_platoon.nodes import qos
from cacc_platoon.nodes.executor import create_executor, spin_for
from cacc_platoon.supervision.participant import start_ros

PERIOD = 0.02


def measure_round_trip(timeout: float) -> float | None:
    """Return how long a new process took to answer [s], or None after `timeout` [s]."""
    topic = f"/cacc_platoon_doctor_{os.getpid()}"
    context = multiprocessing.get_context("spawn")
    reader, writer = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(topic, reader, timeout), daemon=True)
    process.start()
    answers: list[int] = []
    start_ros([])
    node = Node("doctor", use_global_arguments=False)
    publisher = node.create_publisher(Int64, f"{topic}/question", qos.latched())
    node.create_subscription(
        Int64, f"{topic}/answer", lambda message: answers.append(message.data), qos.latched()
    )
    executor = create_executor()
    executor.add_node(node)
    began = time.monotonic()
    publisher.publish(Int64(data=1))
    while not answers and time.monotonic() - began < timeout:
        spin_for(executor, PERIOD)
    elapsed = time.monotonic() - began
    writer.close()
    with shared_memory.cleared_segments():
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
    process.join(timeout)
    return elapsed if answers else None


def _answer(topic: str, lifeline: Connection, timeout: float) -> None:
    start_ros([])
    node = Node("doctor_echo", use_global_arguments=False)
    publisher = node.create_publisher(Int64, f"{topic}/answer", qos.latched())
    node.create_subscription(Int64, f"{topic}/question", publisher.publish, qos.latched())
    executor = create_executor()
    executor.add_node(node)
    deadline = time.monotonic() + timeout
    while not lifeline.poll() and time.monotonic() < deadline:
        spin_for(executor, PERIOD)
    with shared_memory.cleared_segments():
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()

"""What `ros2 bag play --topics` does, where there is none: publishes messages as stored.

    bag_player.py BAG PACE TOPIC...

PACE is a rate (1 is real time, inf as fast as possible) or `by-topic`: one topic after the other.
Publishers have the recorded QoS. Waits for a subscriber of every topic before and for every
acknowledgement afterwards.
"""

import importlib
import sys
import threading
import time

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosbags.interfaces import ConnectionExtRosbag2
from rosbags.rosbag2 import Reader


def main() -> None:
    bag, pace, *topics = sys.argv[1:]
    with Reader(bag) as reader:
        connections = [c for c in reader.connections if c.topic in topics]
        messages = [
            (
                topics.index(connection.topic) if pace == "by-topic" else 0,
                log_time,
                connection,
                data,
            )
            for connection, log_time, data in reader.messages(connections=connections)
        ]
    messages.sort(key=lambda message: message[:2])
    rclpy.init()
    node = Node("bag_player")
    publishers = {}
    for connection in connections:
        package, _, name = connection.msgtype.split("/")
        kind = getattr(importlib.import_module(f"{package}.msg"), name)
        assert isinstance(connection.ext, ConnectionExtRosbag2)
        depth = connection.ext.offered_qos_profiles[0].depth
        publishers[connection.topic] = node.create_publisher(
            kind, connection.topic, QoSProfile(depth=depth)
        )
    pause = threading.Event()
    while not all(publisher.get_subscription_count() for publisher in publishers.values()):
        pause.wait(0.02)
    rate, began = float("inf" if pace == "by-topic" else pace), time.monotonic()
    for _, log_time, connection, data in messages:
        pause.wait(max(0.0, log_time / 1e9 / rate - (time.monotonic() - began)))
        publishers[connection.topic].publish(bytes(data))
    for publisher in publishers.values():
        publisher.wait_for_all_acked(Duration(seconds=60))
    rclpy.shutdown()


if __name__ == "__main__":
    main()

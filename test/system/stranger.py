"""A participant on another machine that looks for a platoon: prints what it sees, line by line."""

import sys

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import String

from cacc_platoon.nodes import qos


def main() -> None:
    """Look until standard input closes or something has been heard."""
    rclpy.init()
    node = Node("stranger")
    heard: list[str] = []
    node.create_subscription(
        String, "/platoon/status", lambda message: heard.append(message.data), qos.latched()
    )
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    print("looking", flush=True)
    while True:
        executor.spin_once(timeout_sec=0.2)
        print("heard" if heard else f"publishers {node.count_publishers('/platoon/status')}")
        sys.stdout.flush()


if __name__ == "__main__":
    main()

"""A process of its own: subscribes to a platoon's topics by itself and writes down their digest.

Uses nothing of the package: names, order and hash are written down here a second time.
"""

import hashlib
import sys
from pathlib import Path

import rclpy
from geometry_msgs.msg import AccelStamped, PoseStamped, TwistStamped
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.task import Future


def main() -> None:
    followers, samples = int(sys.argv[1]), int(sys.argv[2])
    kinds = {"pose": PoseStamped, "twist": TwistStamped, "accel": AccelStamped}
    topics = {
        f"/platoon/vehicle_{i}/{k}": t for i in range(followers + 1) for k, t in kinds.items()
    }
    topics |= {f"/platoon/vehicle_{i}/v2v/accel": AccelStamped for i in range(1, followers + 1)}
    hashes = {name: hashlib.sha256() for name in topics}
    counts = dict.fromkeys(topics, 0)
    rclpy.init()
    node = Node("listener")

    def subscribe(name: str, kind: type) -> None:
        def receive(data: bytes) -> None:
            hashes[name].update(data)
            counts[name] += 1

        node.create_subscription(kind, name, receive, QoSProfile(depth=samples), raw=True)

    for name, kind in topics.items():
        subscribe(name, kind)
    executor = EventsExecutor()
    executor.add_node(node)
    subscriptions = list(node.subscriptions)
    others = len(topics) - 1  # the run starts with the node that publishes the last one
    while sum(subscription.get_publisher_count() > 0 for subscription in subscriptions) < others:
        executor.spin_once(timeout_sec=0.1)
    Path(sys.argv[3]).touch()
    while not sum(counts.values()):  # on a loaded machine the run may take a while to start
        executor.spin_once(timeout_sec=0.1)
    received = -1
    while min(counts.values()) < samples and sum(counts.values()) > received:
        received = sum(counts.values())
        executor.spin_until_future_complete(Future(), timeout_sec=5.0)
    lines = sorted(f"{name} {value.hexdigest()}\n" for name, value in hashes.items())
    Path(sys.argv[4]).write_text(hashlib.sha256("".join(lines).encode()).hexdigest())


if __name__ == "__main__":
    main()

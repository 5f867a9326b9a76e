"""10^5 messages at once, and one of megabytes: the run stops and names who sent them."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from geometry_msgs.msg import TwistStamped
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from cacc_platoon.nodes import qos
from cacc_platoon.testing import Platoon, Result
from msg_adapters.topics import VehicleTopics

MANY = 100_000
SMALL = ("run.duration=60", "platoon.followers=3", "run.real_time_factor=10")
"""Six seconds of wall time, slow enough to interfere."""
STATE = "/platoon/host_state"
TWIST = VehicleTopics("/platoon", 2).twist
MOST_MEMORY = 300e6
"""What the supervisor takes with a queue of such messages, at most [bytes]."""

Start = Callable[..., Platoon]


def peak(pid: int) -> int:
    """Return the most memory that a process has had [bytes]."""
    status = Path(f"/proc/{pid}/status").read_text()
    found = re.search(r"VmHWM:\s+(\d+) kB", status)  # none of a process that has ended
    return 1024 * int(found[1]) if found else 0


def assert_refused(result: Result, *words: str) -> None:
    assert (result.exit_code, result.status) == (1, "failed"), result.message
    assert "Traceback" not in result.errors + result.output
    for log in result.folder.logs.glob("*"):
        assert "Traceback" not in log.read_text()
    for word in words:
        assert word in result.message


KINDS = {STATE: String, TWIST.name: TwistStamped}
MESSAGES = {
    STATE: serialize_message(String(data="nonsense")),
    TWIST.name: TWIST.codec.encode(10**15, 1.0),
}


@pytest.mark.parametrize("topic", KINDS, ids=["texts", "data"])
def test_a_flood_is_refused_by_name_and_takes_no_memory(platoon: Start, topic: str) -> None:
    run = platoon(*SMALL, hosts=2)
    run.wait_sample(100)
    profile = qos.stream(run.scenario) if topic == TWIST.name else qos.latched(1000)
    publisher = run.advertise(KINDS[topic], topic, profile)
    run.wait(lambda: publisher.get_subscription_count() > 0, 20.0, "a subscriber")
    supervisor, most = run.pid("supervisor"), 0
    for count in range(MANY):
        publisher.publish(MESSAGES[topic])
        if count % 1000 == 0:
            most = max(most, peak(supervisor))
    result = run.result()
    assert_refused(result, "publisher", "/observer")
    assert 0 < most < MOST_MEMORY
    if "a message from another publisher" in result.message:  # seen before the endpoint was
        assert re.search(r"; \d+ messages of another publisher were refused; ", result.message)


def test_a_message_of_megabytes_is_refused_by_name(platoon: Start) -> None:
    run = platoon(*SMALL, hosts=2)
    run.wait_sample(100)
    run.send(String(data="x" * 8_000_000), STATE)
    assert_refused(run.result(), STATE, "publisher")

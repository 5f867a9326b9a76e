"""A host's answers and what a viewer hears, on real topics: asked for, seldom, and bounded."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import Int64, String

from cacc_platoon.dds.domain import own_domain
from cacc_platoon.live.watch import Watch
from cacc_platoon.nodes import qos
from cacc_platoon.nodes.recorder import RecorderNode
from cacc_platoon.scenario import Scenario
from cacc_platoon.supervision.supervisor_node import SupervisorNode
from cacc_platoon.supervision.view_answers import ViewAnswers
from cacc_platoon.supervision.watch_node import KEPT, WatchNode
from msg_adapters.topics import Graph

PATIENCE = 30.0
SCENARIO = Scenario.from_values({"platoon.followers": 1, "run.duration": 1.0})
Wait = Callable[[Callable[[], bool]], None]


@pytest.fixture
def executor(monkeypatch: pytest.MonkeyPatch) -> Iterator[SingleThreadedExecutor]:
    with own_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        rclpy.init(args=[])
        made = SingleThreadedExecutor()
        yield made
        for node in list(made.get_nodes()):
            if isinstance(node, SupervisorNode):
                node.lock.drop()
            if isinstance(node, RecorderNode):
                node.close()
            node.destroy_node()
        made.shutdown()
        rclpy.shutdown()


@pytest.fixture
def wait(executor: SingleThreadedExecutor) -> Wait:
    def until(condition: Callable[[], bool]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline
            executor.spin_once(timeout_sec=0.05)

    return until


@pytest.fixture
def supervisor(executor: SingleThreadedExecutor) -> SupervisorNode:
    made = SupervisorNode(SCENARIO)
    made.announce()
    executor.add_node(made)
    return made


@pytest.fixture
def recorder(executor: SingleThreadedExecutor, tmp_path: Path) -> RecorderNode:
    """Two samples of the leader are recorded."""
    topics = list(Graph.of(SCENARIO).vehicles[0].motion)
    made = RecorderNode(SCENARIO, "0", topics, tmp_path / "part")
    for k in (0, 1):
        for number, topic in enumerate(topics):
            message = topic.codec.encode(k * SCENARIO.step_ns, 10.0 * k + number)
            made._part.writers[topic.name](message)
    executor.add_node(made)
    return made


def test_who_watches_sees_what_a_host_has_recorded(
    executor: SingleThreadedExecutor, wait: Wait, supervisor: SupervisorNode, recorder: RecorderNode
) -> None:
    answers = ViewAnswers(recorder, "0", lambda: "f00d")
    supervisor.ask_for_view(1)  # nobody looks: nobody is asked
    watcher = WatchNode()
    executor.add_node(watcher)
    watcher.follow("/platoon")
    wait(lambda: watcher.running_platoons() == ["/platoon"])
    watch = Watch("/platoon")

    def seen() -> bool:
        supervisor.ask_for_view(1)
        watch.hear(watcher.take(), time.monotonic())
        return any(one.sample == 1 for one in watch.picture(0.0).vehicles)

    wait(seen)
    leader, follower = watch.picture(0.0).vehicles
    assert (leader.position, leader.velocity, leader.acceleration) == (10.0, 11.0, 12.0)
    assert follower.sample is None
    assert answers is not None


def test_a_flood_of_requests_is_answered_now_and_then(
    executor: SingleThreadedExecutor, wait: Wait, supervisor: SupervisorNode, recorder: RecorderNode
) -> None:
    answers = ViewAnswers(recorder, "0", lambda: "f00d")
    heard: list[float] = []
    supervisor.create_subscription(
        String, "/platoon/view", lambda _: heard.append(time.monotonic()), qos.glimpse()
    )
    wait(lambda: supervisor.count_subscribers("/platoon/view") == 1)
    wait(lambda: answers._publisher.get_subscription_count() == 1)
    began = time.monotonic()
    while len(heard) < 4:
        for _ in range(20):
            answers._answer(Int64(data=1))
        executor.spin_once(timeout_sec=0.01)
    assert time.monotonic() - began > 0.1
    before = len(heard)
    answers._answer(Int64(data=-1))
    assert len(heard) == before


def test_a_run_does_not_wait_for_who_watches(
    executor: SingleThreadedExecutor, wait: Wait, supervisor: SupervisorNode
) -> None:
    """As it waits for a volatile subscriber of a data topic, which would miss something."""
    watcher = WatchNode()
    executor.add_node(watcher)
    watcher.follow("/platoon")
    wait(lambda: supervisor.count_subscribers("/platoon/view") == 1)
    assert set(supervisor.outside_subscribers(()).values()) == {0}
    assert supervisor.look({}).foreign == ()


def test_what_nobody_takes_is_dropped(executor: SingleThreadedExecutor) -> None:
    watcher = WatchNode()
    executor.add_node(watcher)
    for number in range(10):
        watcher._on_view(bytes([number]) * (KEPT // 4))
    views = watcher.take().views
    assert [view[0] for view in views] == [6, 7, 8, 9]
    assert watcher.take().views == ()
    watcher._on_view(bytes(2 * KEPT))
    assert watcher.take().views == ()

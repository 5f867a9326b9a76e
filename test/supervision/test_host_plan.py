"""What hosts run, what has to be recorded of them, and when a run is complete."""

from pathlib import Path

import pytest

from cacc_platoon.errors import UserError
from cacc_platoon.runs.folder import RunFolder
from cacc_platoon.runs.info import EndStatus
from cacc_platoon.scenario import Scenario
from cacc_platoon.supervision.host_plan import HostPlan, divide, plan_hosts
from cacc_platoon.supervision.outcome import conclude, lacking
from cacc_platoon.supervision.run_events import EndRun
from msg_adapters.topics import Graph

FOLDER = RunFolder(Path("run"))


def scenario(**values: object) -> Scenario:
    given = {name.replace("__", "."): value for name, value in values.items()}
    return Scenario.from_values({"run.duration": 1.0, "platoon.followers": 2, **given}, None, "t")


SCENARIO = scenario()
NODES = SCENARIO.node_names
TOPICS = [topic.name for topic in Graph.of(SCENARIO).recorded]
WHOLE = dict.fromkeys(TOPICS, 101)


def plans(scenario: Scenario, cores: int = 2, local: bool = False) -> list[HostPlan]:
    return plan_hosts(scenario, FOLDER, "f00d", cores=cores, local=local)


# Which host gets which nodes.


def test_neighbours_share_a_host_and_a_relay_goes_with_its_receiver() -> None:
    assert divide(scenario(run__hosts=2, platoon__followers=3), cores=99) == [
        [("leader", 0), ("vehicle", 1), ("noise_relay", 1)],
        [("vehicle", 2), ("noise_relay", 2), ("vehicle", 3), ("noise_relay", 3)],
    ]


@pytest.mark.parametrize(
    ("hosts", "cores", "count"), [("auto", 2, 2), ("auto", 1, 1), ("auto", 64, 3), (3, 1, 3)]
)
def test_there_are_as_many_hosts_as_asked_for_but_none_without_a_vehicle(
    hosts: str | int, cores: int, count: int
) -> None:
    groups = divide(scenario(run__hosts=hosts), cores)
    assert len(groups) == count
    assert [str(node) for group in groups for node in group] == NODES


def test_every_node_may_be_a_host_of_its_own() -> None:
    groups = divide(scenario(run__hosts="per_node"), cores=2)
    assert groups[:2] == [[("leader", 0)], [("vehicle", 1)]]
    assert len(groups) == len(NODES)


@pytest.mark.parametrize("hosts", ["auto", "per_node", 2])
def test_manually_started_nodes_are_in_no_host(hosts: str | int) -> None:
    manual = ("vehicle_1/noise_relay", "vehicle_2/vehicle", "vehicle_2/noise_relay")
    groups = divide(scenario(run__manual_nodes=manual, run__hosts=hosts), cores=2)
    assert groups == [[("leader", 0)], [("vehicle", 1)]]
    assert divide(scenario(run__manual_nodes=NODES, run__hosts=hosts), cores=2) == []


def test_a_platoon_that_begins_at_another_index_has_its_leader_before_it() -> None:
    groups = divide(scenario(platoon__first_follower=7, platoon__followers=1), cores=1)
    assert groups == [[("leader", 6), ("vehicle", 7), ("noise_relay", 7)]]


def test_a_plan_says_where_a_host_records_and_logs() -> None:
    first, second = plans(SCENARIO)
    assert (first.run, first.name, second.name) == ("f00d", "0", "1")
    assert first.part == Path("run/parts/host_0")
    assert second.log == Path("run/logs/host_1.log")
    assert first.nodes + second.nodes == tuple(
        node for group in divide(SCENARIO, cores=2) for node in group
    )
    assert not first.verbose


def test_processes_that_would_not_find_each_other_are_refused() -> None:
    many = scenario(platoon__followers=50, run__hosts="per_node")
    with pytest.raises(UserError, match="per_node makes 101 processes, but DDS connects fewer"):
        plans(many, local=True)
    assert len(plans(many)) == 101
    assert len(plans(scenario(platoon__followers=49, run__hosts="per_node"), local=True)) == 99


# What has to be recorded.


def test_what_a_vehicle_publishes_when_asked_belongs_to_the_run() -> None:
    asked = scenario(record__command=True, record__spacing_error=True)
    names = {topic.name for topic in Graph.of(asked).recorded}
    assert {"/platoon/vehicle_1/command", "/platoon/vehicle_1/spacing_error"} < names
    assert names - set(TOPICS) == {
        f"/platoon/vehicle_{i}/{kind}" for i in (1, 2) for kind in ("command", "spacing_error")
    }


# How it ended.


def test_a_whole_run_lacks_nothing() -> None:
    assert lacking(TOPICS, 101, WHOLE) == ""
    end = EndRun(EndStatus.FINISHED)
    assert conclude(SCENARIO, TOPICS, end, WHOLE, 101) == (EndStatus.FINISHED, "")


@pytest.mark.parametrize("topic", TOPICS)
@pytest.mark.parametrize("count", [100, 0, None])
def test_a_topic_that_lacks_samples_fails_the_run_by_name(topic: str, count: int | None) -> None:
    counts = {name: n for name, n in {**WHOLE, topic: count}.items() if n is not None}
    status, message = conclude(SCENARIO, TOPICS, EndRun(EndStatus.FINISHED), counts, 101)
    assert status is EndStatus.FAILED
    assert message.startswith(f"{topic}: only {count or 0} of 101 samples were recorded; ")
    assert "the last complete sample is" in message


def test_a_failed_run_says_who_was_silent_and_what_it_had() -> None:
    end = EndRun(EndStatus.FAILED, "no progress for 2 s", ("host 1 does not answer",))
    assert conclude(SCENARIO, TOPICS, end, dict.fromkeys(TOPICS, 31), 101) == (
        EndStatus.FAILED,
        "no progress for 2 s; host 1 does not answer; the last complete sample is 30 (0.3 s)",
    )


def test_a_stalled_run_in_which_all_stopped_together_names_those_it_may_have_been() -> None:
    """A host with all nodes that was frozen, and is there again when the run ends."""
    counts = dict.fromkeys(TOPICS, 31)
    stalled = EndRun(EndStatus.FAILED, "no progress for 2 s", stalled=True)
    _, message = conclude(SCENARIO, TOPICS, stalled, counts, 101)
    assert (
        "vehicle_0/leader, the recorder of a host or the supervisor stopped, at sample 30"
        in message
    )
    silent = EndRun(EndStatus.FAILED, "no progress for 2 s", ("host 1 is silent",), stalled=True)
    _, message = conclude(SCENARIO, TOPICS, silent, counts, 101)
    assert "vehicle_0/leader" not in message


def test_an_interrupted_run_says_who_interrupted_it_and_no_more() -> None:
    end = EndRun(EndStatus.INTERRUPTED, "stopped by SIGINT", ("host 1 does not answer",))
    assert conclude(SCENARIO, TOPICS, end, {}, 101) == (EndStatus.INTERRUPTED, "stopped by SIGINT")


def test_a_reason_that_is_a_sentence_goes_on_without_its_full_stop() -> None:
    end = EndRun(EndStatus.FAILED, "it is late. Raise run.start_timeout.")
    _, message = conclude(SCENARIO, TOPICS, end, WHOLE, 101)
    assert message.startswith("it is late. Raise run.start_timeout; the last complete sample is ")

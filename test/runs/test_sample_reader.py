"""What a part that is still being written holds of one sample: of real topics, row by row."""

import contextlib

import pytest

from cacc_platoon.runs.parts import PartWriter
from cacc_platoon.runs.sample_reader import Reading, SampleReader, shown_topics
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import simulate
from msg_adapters.topics import Graph


@pytest.fixture
def made(tmp_path):
    """Make scenario, graph, an empty part of some or all of its topics, and its reader."""
    with contextlib.ExitStack() as stack:

        def make(values, only=None):
            scenario = Scenario.from_values({"platoon.followers": 2, "run.duration": 1.0, **values})
            graph = Graph.of(scenario)
            topics = only(graph) if only else graph.recorded
            part = PartWriter(tmp_path / "part", topics)
            stack.callback(part.close)
            return scenario, graph, part, SampleReader(part, topics, graph, scenario.step_ns)

        yield make


def test_the_row_of_a_sample_is_read_while_it_is_written(made, tmp_path):
    scenario, graph, part, reader = made({})
    pose = graph.vehicles[1].pose
    assert reader.at(0) == {}
    for k in range(5):
        part.writers[pose.name](pose.codec.encode(k * scenario.step_ns, 0.5 * k))
    assert reader.at(3) == {}  # not flushed
    part.flush()
    assert reader.at(3) == {pose.name: Reading(3, 1.5)}
    assert reader.at(100) == {pose.name: Reading(4, 2.0)}
    part.close()
    assert reader.at(3) == {}
    assert (tmp_path / "part" / "0000.cdr").stat().st_size == 0


def test_a_message_that_is_not_there_is_none(made):
    _, graph, part, _ = made({})
    name = graph.vehicles[0].pose.name
    for number in (-1, 0, 3):
        with pytest.raises(LookupError, match="has no message"):
            part.message(name, number)


def test_a_packet_is_the_last_one_delivered_by_then(made, bags):
    """Of a link that loses packets: its rows are no samples, the counts say which one it is."""
    scenario, graph, part, reader = made({"v2v.loss": 0.6, "v2v.latency": 0.03})
    for name, rows in bags.record(scenario).items():
        for row in rows.messages:
            part.writers[name](row.tobytes())
    part.flush()
    arrivals = simulate(scenario).arrivals
    assert arrivals
    source, sample, value = arrivals[1]
    for k in (0, 2, 3, 10, 57, 100):
        by_then = [n for n, at in enumerate(sample) if at <= k]
        found = reader.at(k).get(graph.vehicles[2].received.name)
        last = by_then[-1] if by_then else None
        assert found == (None if last is None else Reading(source[last], value[last]))
    assert any(reader.at(k) for k in (57, 100))


def test_only_what_is_recorded_here_is_looked_for(made):
    def own(graph):
        return [graph.vehicles[2].pose, graph.vehicles[2].link(0).accel]

    _, graph, part, reader = made({"platoon.predecessors": 1}, own)
    for topic in own(graph):
        part.writers[topic.name](topic.codec.encode(0, 7.0))
    part.flush()
    assert reader.at(0) == {graph.vehicles[2].pose.name: Reading(0, 7.0)}


def test_every_shown_topic_is_one_of_a_vehicle():
    graph = Graph.of(Scenario.from_values({"platoon.followers": 1}))
    names = [topic.name.removeprefix("/platoon/") for topic in shown_topics(graph)]
    assert names == [
        *(f"vehicle_{index}/{what}" for index in (0, 1) for what in ("pose", "twist", "accel")),
        *(f"vehicle_1/{what}" for what in ("v2v/accel", "reception", "monitor", "timing")),
    ]

"""A seed and a number say all of a fault, and every fault is one that can happen."""

from collections import Counter

import pytest

from cacc_platoon.campaign.plan import (
    KINDS,
    NEEDS_NAMESPACE,
    Fault,
    Moment,
    plan,
    scenario_of,
    topics_of,
)
from cacc_platoon.errors import UserError
from cacc_platoon.scenario import Scenario
from msg_adapters.topics import Graph

MANY = 600


@pytest.fixture(scope="module")
def faults() -> list[Fault]:
    return [plan(1, index) for index in range(MANY)]


def test_a_fault_depends_on_seed_and_number_alone(faults):
    assert [plan(1, index) for index in (7, 3)] == [faults[7], faults[3]]
    assert plan(2, 7) != faults[7]
    assert all((fault.seed, fault.index) == (1, place) for place, fault in enumerate(faults))


@pytest.mark.slow
def test_every_kind_moment_variant_and_kind_of_run_comes(faults):
    assert Counter(fault.kind for fault in faults).keys() == KINDS.keys()
    assert {fault.moment for fault in faults} == set(Moment)
    for name, kind in KINDS.items():
        own = [plan(1, index, only=name) for index in range(200)]
        assert {fault.variant for fault in own} == set(kind.variants)
        assert {fault.sync for fault in own} == set(kind.syncs)
        assert {fault.moment for fault in own} == set(kind.moments)
        assert all(kind.amounts[0] <= fault.amount <= kind.amounts[1] for fault in own)


def test_every_target_is_there(faults):
    for fault in faults:
        graph = Graph.of(scenario_of(fault))
        control, data = topics_of(graph)
        words = {"supervisor", "forkserver", "platoon", "everybody", "parts", "folder", "link"}
        assert fault.target in {*map(str, graph.nodes), *control, *data, *words}
        assert (fault.process == "host") == (fault.target in map(str, graph.nodes))


def test_every_topic_is_flooded():
    own = [plan(3, index, only="flood") for index in range(MANY)]
    for sync in ("lockstep", "wall"):
        here = [fault for fault in own if fault.sync == sync]
        control, data = topics_of(Graph.of(scenario_of(here[0])))
        assert {fault.target for fault in here} >= {*control, *data}
    assert min(fault.amount for fault in own) >= 1e4


def test_without_namespaces_the_other_faults_stay_what_they_are(faults):
    for fault in faults:
        here = plan(1, fault.index, namespaces=False)
        assert here.kind not in NEEDS_NAMESPACE
        assert fault.needs_namespace or here == fault


def test_a_platoon_of_ones_own_is_shortened_and_aimed_at():
    given = Scenario.from_values({"platoon.followers": 9, "v2v.rho": 4.0, "run.duration": 500.0})
    faults = [plan(1, index, only="kill", given=given) for index in range(100)]
    assert any(fault.target.startswith("vehicle_9/") for fault in faults)
    scenario = scenario_of(faults[0], given)
    assert (scenario.platoon.followers, scenario.v2v.rho) == (9, 4.0)
    assert scenario.run.duration <= 20.0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"only": "rust"}, "is no kind of fault. Take one of kill, "),
        ({"only": "cut", "sync": "wall"}, "cut does not happen to runs with run.sync = wall"),
        ({"only": "cut", "namespaces": False}, "cut needs a network of its own"),
    ],
)
def test_what_cannot_be_is_refused(options, words):
    with pytest.raises(UserError, match=words):
        plan(1, 0, **options)

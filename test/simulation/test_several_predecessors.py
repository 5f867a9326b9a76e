"""Platoons in which a follower receives from several vehicles ahead, against a scalar loop."""

import numpy as np
import pytest

from cacc_platoon.model import Link, Topology
from cacc_platoon.scenario import Scenario, ScenarioError
from cacc_platoon.simulation import simulate, simulate_mean

SHORT = {"run.duration": 12.0, "platoon.followers": 4, "leader.start": 1.0, "vehicle.tau": 0.4}
TWO = {**SHORT, "platoon.predecessors": 2, "controller.law": "my_laws:Shared"}

CODE = """
class Shared:
    def __init__(self, follower):
        self._law = follower.spacing_policy()

    def command(self, *inputs):
        x, v, x_ahead, v_ahead, *received = inputs
        total = received[0]
        for value in received[1:]:
            total = total + value
        return self._law.command(x, v, x_ahead, v_ahead, total / len(received))

class Nearest(Shared):
    def command(self, x, v, x_ahead, v_ahead, received):
        return self._law.command(x, v, x_ahead, v_ahead, received)
"""


@pytest.fixture(autouse=True)
def my_laws(tmp_path, monkeypatch):
    (tmp_path / "my_laws.py").write_text(CODE)
    monkeypatch.syspath_prepend(str(tmp_path))


def test_links_are_those_of_the_topology():
    topology = Scenario.from_values(TWO).topology
    assert topology == Topology(range(1, 5), 2)
    assert topology.links[:4] == ((0, 1), (1, 2), (0, 2), (2, 3))
    assert topology.senders == [0, 1, 0, 2, 1, 3, 2]
    assert topology.columns == [slice(0, 1), slice(1, 3), slice(3, 5), slice(5, 7)]


@pytest.mark.parametrize(
    ("predecessors", "loss", "reception"),
    [(2, 0.0, "hold"), (2, 0.4, "hold"), (2, 0.4, "zero"), (3, 0.4, "hold")],
)
def test_a_run_equals_a_scalar_loop(predecessors, loss, reception):
    """Every link noise and loss of its own, keyed by itself; vehicle by vehicle, step by step."""
    scenario = Scenario.from_values(
        {
            **TWO,
            "platoon.predecessors": predecessors,
            "v2v.loss": loss,
            "v2v.reception": reception,
        }
    )
    run = simulate(scenario)
    for follower in scenario.followers:
        i, law, plant = follower.index, follower.law(), follower.plant(scenario.run.step)
        links = [follower.on(link) for link in scenario.topology.links_to(i)]
        receptions = [link.reception() for link in links]
        delivered = [packets_by_sample(link.channel(), scenario.samples) for link in links]
        state = (run.position[0, i], run.velocity[0, i], run.acceleration[0, i])
        for k in range(scenario.samples - 1):
            assert (run.position[k, i], run.velocity[k, i], run.acceleration[k, i]) == state
            received = [
                use.use(
                    (source, factor * run.acceleration[source, link.link.sender])
                    for source, factor in packets.get(k, [])
                )
                for use, link, packets in zip(receptions, links, delivered, strict=True)
            ]
            ahead = run.position[k, i - 1], run.velocity[k, i - 1]
            u = law.command(state[0], state[1], *ahead, *received)
            state = plant.advance(type(scenario.leader_profile().at(0.0))(*state), u)


def packets_by_sample(channel, samples):
    found: dict[int, list[tuple[int, float]]] = {}
    for source, sample, factor in zip(*channel.delivery(0, samples)[:3], strict=True):
        found.setdefault(int(sample), []).append((int(source), float(factor)))
    return found


def test_links_of_one_receiver_are_independent():
    scenario = Scenario.from_values({**TWO, "v2v.loss": 0.5, "run.duration": 100.0})
    near, far = (scenario.follower(3).on(Link(sender, 3)) for sender in (2, 1))
    factors = [link.noise().factors(0, 10_000) for link in (near, far)]
    assert abs(np.corrcoef(*factors)[0, 1]) < 4 / np.sqrt(10_000)
    sources = [link.channel().delivery(0, 10_000).source for link in (near, far)]
    lost = [np.bincount(source, minlength=10_000) for source in sources]
    assert abs(np.corrcoef(*lost)[0, 1]) < 4 / np.sqrt(10_000)
    keys = {link.key for link in Topology(range(1, 501), 500).links}
    assert len(keys) == 500 * 501 // 2


def test_the_nearest_link_has_the_noise_of_a_platoon_with_one_predecessor():
    one = Scenario.from_values({**TWO, "platoon.predecessors": 1})
    two = Scenario.from_values(TWO)
    for i in (1, 2, 3):
        noises = [scenario.follower(i).noise().factors(0, 500) for scenario in (one, two)]
        assert (noises[0] == noises[1]).all()
    assert (simulate(one).position != simulate(two).position).any()


def test_the_mean_system_has_every_link():
    """Its law is the one of headway and gains, which uses the nearest vehicle alone."""
    mean = simulate_mean(Scenario.from_values(TWO))
    assert mean.received.shape == mean.sent.shape == (1201, 7)
    alone = simulate_mean(Scenario.from_values({**TWO, "platoon.predecessors": 1}))
    assert (mean.position == alone.position).all()


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"controller.law": ""}, "needs a controller.law that uses them all, vehicle_1 has none"),
        (
            {"leader.profile": "bag", "leader.file": "run"},
            "what the vehicles before the leader sent is not in the run",
        ),
    ],
)
def test_predecessors_that_nobody_would_use_are_refused(values, words):
    with pytest.raises(ScenarioError, match=words):
        Scenario.from_values({**TWO, **values})


def test_a_law_that_takes_one_value_is_refused_before_anything_starts():
    scenario = Scenario.from_values({**TWO, "controller.law": "my_laws:Nearest"})
    with pytest.raises(ScenarioError, match=r"law of vehicle_2 raised TypeError.* with 2 received"):
        scenario.check_own_code()
    Scenario.from_values(TWO).check_own_code()

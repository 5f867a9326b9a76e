"""Impairments that follow each other, and a time headway that moves."""

import numpy as np
import pytest

from cacc_platoon.model import AdditiveNoise, ComposedChannel, ConstantLatency, IndependentLoss
from cacc_platoon.model.latency import InOrder, RandomLatency
from cacc_platoon.model.packets import Impairment
from cacc_platoon.model.successive import Successive, moving_headway

LATE: list[Impairment] = [RandomLatency([0.5, 0.3, 0.2], seed=1, link=1), InOrder(2)]
STAGES: list[tuple[int, list[Impairment]]] = [
    (0, [IndependentLoss(0.2, 1, 1), ConstantLatency(3)]),
    (40, [AdditiveNoise(0.1, 0.0, 1, 1), *LATE]),
    (95, []),
]
CHANNEL = ComposedChannel([Successive(STAGES)])


@pytest.mark.parametrize("size", [1, 7, 40, 95])
def test_slices_equal_the_whole(size):
    whole = CHANNEL.delivery(0, 150)
    parts = [CHANNEL.delivery(k, min(k + size, 150)) for k in range(0, 150, size)]
    for number, column in enumerate(whole[:3]):
        np.testing.assert_array_equal(np.concatenate([part[number] for part in parts]), column)


def test_each_packet_suffers_what_is_there_when_it_is_sent():
    whole = CHANNEL.delivery(0, 150)
    assert whole.offset is not None
    for (start, stage), stop in zip(STAGES, (40, 95, 150), strict=True):
        alone = ComposedChannel(stage).delivery(0, 160)
        sent = (whole.source >= start) & (whole.source < stop)
        wanted = (alone.source >= start) & (alone.source < stop) & (alone.sample < 150)
        for column in ("source", "sample", "factor"):
            np.testing.assert_array_equal(
                getattr(whole, column)[sent], getattr(alone, column)[wanted]
            )
        offset = np.zeros(160) if alone.offset is None else alone.offset
        np.testing.assert_array_equal(whole.offset[sent], offset[: len(wanted)][wanted])


def test_all_that_any_stage_does_is_promised():
    assert not CHANNEL.prompt
    assert CHANNEL.longest_delay == 4
    assert ComposedChannel([Successive([(0, []), (3, [AdditiveNoise(1.0, 0.0, 1, 1)])])]).prompt


def test_a_headway_moves_no_faster_than_its_rate_and_arrives():
    changes = [(5, 1.4), (10, 0.7), (90, 1.0)]
    headway = moving_headway(0.95, changes, rate=0.01, samples=150)
    assert headway[4] == 0.95
    assert headway[5] == 0.95 + 0.01
    assert np.abs(np.diff(headway)).max() <= 0.01 + 1e-15
    assert headway[89] == 0.7
    assert headway[-1] == 1.0
    assert headway.max() == pytest.approx(1.0)
    np.testing.assert_array_equal(
        headway[:60], moving_headway(0.95, changes[:2], rate=0.01, samples=60)
    )

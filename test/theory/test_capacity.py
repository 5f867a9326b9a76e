"""Throughput of a lane."""

import math

import numpy as np
import pytest

from cacc_platoon.theory import DesignError, headway_bound, minimum_headway, optimum
from cacc_platoon.theory.capacity import capacity

RHO, TAU = 5.0, 0.5


def test_figures_at_30_m_per_s():
    headways = [
        headway_bound(0.5, RHO, TAU),
        optimum(RHO, TAU).time_headway,
        minimum_headway(0.5, RHO, TAU),
        TAU * (1 + 1 / RHO),
    ]
    assert [round(capacity(h, 30.0, 5.0)) for h in headways] == [3260, 3464, 4086, 4696]


def test_vehicles_that_pass_a_point_in_an_hour_are_counted():
    """Positions of a platoon in equilibrium, moved on for an hour."""
    speed, headway, distance = 20.0, 1.1, 6.5
    start = -np.arange(4000) * (distance + headway * speed)
    passed = ((start < 0) & (start + speed * 3600.0 >= 0)).sum()
    assert math.floor(capacity(headway, speed, distance)) == passed


def test_what_overlaps_is_refused():
    for values in ((-1.0, 30.0, 5.0), (1.0, 0.0, 5.0), (1.0, 30.0, -5.0), (0.0, 30.0, 0.0)):
        with pytest.raises(DesignError):
            capacity(*values)

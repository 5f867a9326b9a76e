"""Names are written and parsed in one place, and what is written is parsed back."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cacc_platoon.scenario.names import (
    split_vehicle,
    vehicle_index,
    vehicle_name,
)

PREFIXES = st.from_regex(r"(/[A-Za-z_][A-Za-z0-9_]{0,8}){1,3}", fullmatch=True)


@given(PREFIXES, st.integers(0, 500))
def test_a_vehicle_is_found_in_a_path(prefix, index):
    path = f"{prefix}/{vehicle_name(index)}/v2v/accel"
    assert split_vehicle(path) == (prefix, index, "v2v/accel")


@pytest.mark.parametrize("text", ["vehicle_", "vehicle_-1", "vehicle_1x", "x_vehicle_1", ""])
def test_what_is_no_vehicle(text):
    assert vehicle_index(text) is None

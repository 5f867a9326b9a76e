"""Names are written and parsed in one place, and what is written is parsed back."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cacc_platoon.scenario.names import (
    NodeKind,
    NodeName,
    host_name,
    host_of,
    split_vehicle,
    vehicle_index,
    vehicle_name,
)

PREFIXES = st.from_regex(r"(/[A-Za-z_][A-Za-z0-9_]{0,8}){1,3}", fullmatch=True)


@given(st.sampled_from(NodeKind), st.integers(0, 500))
def test_a_node_name_is_parsed_back(kind, index):
    assert NodeName.parse(str(NodeName(kind, index))) == (kind, index)


@given(PREFIXES, st.integers(0, 500))
def test_a_vehicle_is_found_in_a_path(prefix, index):
    path = f"{prefix}/{vehicle_name(index)}/v2v/accel"
    assert split_vehicle(path) == (prefix, index, "v2v/accel")


@pytest.mark.parametrize("text", ["vehicle_", "vehicle_-1", "vehicle_1x", "x_vehicle_1", ""])
def test_what_is_no_vehicle(text):
    assert vehicle_index(text) is None
    with pytest.raises(ValueError, match="does not begin with"):
        NodeName.parse(f"{text}/vehicle")


def test_a_host_is_parsed_back_and_nothing_else_is():
    assert host_of(host_name("7")) == "7"
    assert host_of("vehicle_7") is None

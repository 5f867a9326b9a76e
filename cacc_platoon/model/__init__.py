"""The paper's equations: vehicle, control law, V2V channel and leader profiles; numpy only."""

from cacc_platoon.model.channel import (
    BitChannel,
    Channel,
    ConstantChannel,
    FactorStream,
    expected_factor,
    factor_variance,
)
from cacc_platoon.model.control import ConstantTimeHeadway, ControlLaw, Gains
from cacc_platoon.model.leader import (
    LeaderProfile,
    PiecewiseConstantAcceleration,
    RecordedMotion,
    SinePulse,
    brake_profile,
    read_speed_profile,
    sample_profile,
    speed_profile,
    step_profile,
)
from cacc_platoon.model.topology import Link, Topology
from cacc_platoon.model.vehicle import State, ThirdOrderPlant

__all__ = [
    "BitChannel",
    "Channel",
    "ConstantChannel",
    "ConstantTimeHeadway",
    "ControlLaw",
    "FactorStream",
    "Gains",
    "LeaderProfile",
    "Link",
    "PiecewiseConstantAcceleration",
    "RecordedMotion",
    "SinePulse",
    "State",
    "ThirdOrderPlant",
    "Topology",
    "brake_profile",
    "expected_factor",
    "factor_variance",
    "read_speed_profile",
    "sample_profile",
    "speed_profile",
    "step_profile",
]

"""The platoon's world: vehicle, control law, V2V link and leader, scalar and array; numpy only."""

from cacc_platoon.model.control import ConstantTimeHeadway, ControlLaw, Gains
from cacc_platoon.model.impairment import (
    Channel,
    ComposedChannel,
    ConstantLatency,
    ContentNoise,
    Delivery,
    Impairment,
    Packets,
    SendTimes,
)
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
from cacc_platoon.model.losses import Blackouts, BurstLoss, IndependentLoss
from cacc_platoon.model.noise import (
    BitNoise,
    ConstantNoise,
    Noise,
    expected_factor,
    factor_variance,
)
from cacc_platoon.model.reception import HoldReception, Reception, ZeroReception
from cacc_platoon.model.topology import Link, Topology
from cacc_platoon.model.vehicle import State, ThirdOrderPlant

__all__ = [
    "BitNoise",
    "Blackouts",
    "BurstLoss",
    "Channel",
    "ComposedChannel",
    "ConstantLatency",
    "ConstantNoise",
    "ConstantTimeHeadway",
    "ContentNoise",
    "ControlLaw",
    "Delivery",
    "Gains",
    "HoldReception",
    "Impairment",
    "IndependentLoss",
    "LeaderProfile",
    "Link",
    "Noise",
    "Packets",
    "PiecewiseConstantAcceleration",
    "Reception",
    "RecordedMotion",
    "SendTimes",
    "SinePulse",
    "State",
    "ThirdOrderPlant",
    "Topology",
    "ZeroReception",
    "brake_profile",
    "expected_factor",
    "factor_variance",
    "read_speed_profile",
    "sample_profile",
    "speed_profile",
    "step_profile",
]

"""The platoon's world: vehicle, control law, V2V link and leader, scalar and array; numpy only."""

from cacc_platoon.model.channel import Channel, ChannelSource, ComposedChannel, PacketSource
from cacc_platoon.model.content import AdditiveNoise, ContentNoise, FalseData, Forgery
from cacc_platoon.model.control import ConstantTimeHeadway, ControlLaw, Gains
from cacc_platoon.model.fallback import FallbackReception, ReceptionState
from cacc_platoon.model.latency import ConstantLatency, InOrder, RandomLatency
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
from cacc_platoon.model.limits import ISO_15622, Limits
from cacc_platoon.model.losses import Blackouts, BurstLoss, IndependentLoss
from cacc_platoon.model.monitor import Allowances, AssumptionMonitor, MonitoredReception
from cacc_platoon.model.noise import (
    BitNoise,
    ConstantNoise,
    Noise,
    expected_factor,
    factor_interval,
    factor_variance,
)
from cacc_platoon.model.packets import (
    Delivery,
    Impairment,
    Lattice,
    Packets,
    SendTimes,
)
from cacc_platoon.model.reception import ChoosingReception, HoldReception, Reception, ZeroReception
from cacc_platoon.model.send_rule import CamRule, SendRule, TriggeredChannel
from cacc_platoon.model.sensing import Sensing, Sensor
from cacc_platoon.model.topology import Link, Topology
from cacc_platoon.model.vehicle import State, ThirdOrderPlant

__all__ = [
    "ISO_15622",
    "AdditiveNoise",
    "Allowances",
    "AssumptionMonitor",
    "BitNoise",
    "Blackouts",
    "BurstLoss",
    "CamRule",
    "Channel",
    "ChannelSource",
    "ChoosingReception",
    "ComposedChannel",
    "ConstantLatency",
    "ConstantNoise",
    "ConstantTimeHeadway",
    "ContentNoise",
    "ControlLaw",
    "Delivery",
    "FallbackReception",
    "FalseData",
    "Forgery",
    "Gains",
    "HoldReception",
    "Impairment",
    "InOrder",
    "IndependentLoss",
    "Lattice",
    "LeaderProfile",
    "Limits",
    "Link",
    "MonitoredReception",
    "Noise",
    "PacketSource",
    "Packets",
    "PiecewiseConstantAcceleration",
    "RandomLatency",
    "Reception",
    "ReceptionState",
    "RecordedMotion",
    "SendRule",
    "SendTimes",
    "Sensing",
    "Sensor",
    "SinePulse",
    "State",
    "ThirdOrderPlant",
    "Topology",
    "TriggeredChannel",
    "ZeroReception",
    "brake_profile",
    "expected_factor",
    "factor_interval",
    "factor_variance",
    "read_speed_profile",
    "sample_profile",
    "speed_profile",
    "step_profile",
]

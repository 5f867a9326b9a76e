"""The whole platoon in arrays: the reference, expectation runs and Monte Carlo; numpy only."""

from cacc_platoon.simulation.monte_carlo import Ensemble, monte_carlo, with_seed
from cacc_platoon.simulation.platoon import (
    channel_factors,
    initial_positions,
    propagate,
    simulate,
)
from cacc_platoon.simulation.trajectory import Trajectory

__all__ = [
    "Ensemble",
    "Trajectory",
    "channel_factors",
    "initial_positions",
    "monte_carlo",
    "propagate",
    "simulate",
    "with_seed",
]

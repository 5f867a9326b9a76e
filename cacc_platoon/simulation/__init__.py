"""The whole platoon in arrays: the reference, expectation runs and Monte Carlo; numpy only."""

from cacc_platoon.simulation.monte_carlo import Ensemble, chance_deviation, monte_carlo
from cacc_platoon.simulation.platoon import (
    initial_positions,
    propagate,
    simulate,
    simulate_mean,
)
from cacc_platoon.simulation.trajectory import Arrivals, Trajectory

__all__ = [
    "Arrivals",
    "Ensemble",
    "Trajectory",
    "chance_deviation",
    "initial_positions",
    "monte_carlo",
    "propagate",
    "simulate",
    "simulate_mean",
]

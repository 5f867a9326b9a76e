"""The whole platoon in arrays: the reference, expectation runs and Monte Carlo; numpy only."""

from cacc_platoon.simulation.agreement import Agreement, mean_agreement
from cacc_platoon.simulation.monte_carlo import Ensemble, monte_carlo
from cacc_platoon.simulation.platoon import (
    initial_positions,
    propagate,
    simulate,
    simulate_mean,
)
from cacc_platoon.simulation.trajectory import Arrivals, Trajectory

__all__ = [
    "Agreement",
    "Arrivals",
    "Ensemble",
    "Trajectory",
    "initial_positions",
    "mean_agreement",
    "monte_carlo",
    "propagate",
    "simulate",
    "simulate_mean",
]

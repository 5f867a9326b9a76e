"""What the channel really did: w on every link, its statistics, and the paper's assumption."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cacc_platoon.analysis.dropped import delivered_as_zero
from cacc_platoon.model import expected_factor, factor_variance
from cacc_platoon.scenario import Follower
from cacc_platoon.simulation import Trajectory
from cacc_platoon.simulation.trajectory import Array

SILENCE = 1e-250
"""Below this acceleration [m/s^2] the quotient w loses digits; such samples are left out."""

ROUNDING = 4e-16
"""Relative error of w = (w a)/a: two roundings."""

BREACH_SLACK = 1e-12
"""How far w may be outside of its interval before the assumption counts as broken."""


class LinkNoise(NamedTuple):
    """The realised noise factor of one link.

    Attributes
    ----------
    sender, follower : int
        Index of the sender, and of the receiver.
    samples : int
        Samples at which the sender accelerated, so that w can be determined.
    mean, variance, low, high : float
        Of w over them; NaN when there are none.
    expected_mean, expected_variance : float
        E[w] and Var[w] of the link's parameters.
    snr_db : float
        min_t 20 log10(|a| / |w a - a|) [dB], the paper's definition 2.3; infinite without noise.
    first_breach : float
        First time [s] at which w left [1 - 1/rho, 1 + 1/rho], NaN when it never did.
    breaches : int
        Samples at which it did.
    """

    sender: int
    follower: int
    samples: int
    mean: float
    variance: float
    low: float
    high: float
    expected_mean: float
    expected_variance: float
    snr_db: float
    first_breach: float
    breaches: int


def noise_factor(run: Trajectory) -> Array:
    """Return w = received / sent of every link, NaN where there is none, shape (samples, L).

    There is none where a_j is zero, where the packet is lost, and on links whose packets have
    errors that multiply nothing.

    Examples
    --------
    >>> from cacc_platoon.scenario import Scenario
    >>> from cacc_platoon.simulation import simulate
    >>> run = simulate(Scenario.from_values({"run.duration": 11.0}), "none")
    >>> np.unique(noise_factor(run)[1050]).tolist()
    [1.0]
    """
    sent = run.sent
    loud = np.abs(sent) > SILENCE
    factor = np.full(sent.shape, np.nan)
    exact = np.array([not receiver.errs for receiver in run.scenario.receivers])
    np.divide(run.arrived, sent, out=factor, where=loud & ~delivered_as_zero(run) & exact)
    return factor


def link_noise(run: Trajectory) -> list[LinkNoise]:
    """Return the realised noise of every link, in the order of the topology.

    Where the sender's acceleration is zero, the received one must be zero too; anything else
    breaks the multiplicative model and counts as a breach.
    """
    factors = noise_factor(run)
    columns = zip(run.scenario.receivers, factors.T, run.sent.T, run.arrived.T, strict=True)
    return [_link(run.time, *column) for column in columns]


def _link(
    time: Array, receiver: Follower, factor: Array, sent: Array, received: Array
) -> LinkNoise:
    v2v = receiver.v2v
    values = factor[np.isfinite(factor)]
    slack = BREACH_SLACK
    outside = (factor < 1.0 - 1.0 / v2v.rho - slack) | (factor > 1.0 + 1.0 / v2v.rho + slack)
    if not receiver.errs:
        outside |= (sent == 0.0) & np.isfinite(received) & (received != 0.0)
    breaches = np.flatnonzero(outside)
    mean, variance = _theory(v2v.noise, v2v.rho, v2v.bit_probabilities)
    largest = float(np.abs(values - 1.0).max()) if values.size else math.nan
    return LinkNoise(
        *receiver.link,
        int(values.size),
        float(values.mean()) if values.size else math.nan,
        float(values.var()) if values.size else math.nan,
        float(np.min(values)) if values.size else math.nan,
        float(np.max(values)) if values.size else math.nan,
        mean,
        variance,
        _snr_db(largest),
        float(time[breaches[0]]) if breaches.size else math.nan,
        int(breaches.size),
    )


def _theory(noise: str, rho: float, bits: tuple[float, ...]) -> tuple[float, float]:
    if noise == "none":
        return 1.0, 0.0
    mean = expected_factor(rho, bits)
    return mean, factor_variance(rho, bits) if noise == "bits" else 0.0


def _snr_db(largest: float) -> float:
    """SNR [dB] of the largest |w - 1|; rounding of (w a)/a is not noise."""
    if math.isnan(largest):
        return math.nan
    return math.inf if largest <= ROUNDING else -20.0 * math.log10(largest)

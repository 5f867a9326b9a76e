"""Whether the mean of noisy runs is the expectation run: a test with a proven level.

The spacing error of a noisy run less that of the expectation run is a sum over links and samples of
a pulse response of the mean system times what a draw of the channel differs from its mean. Taken
link by link from the front, and in time within a link, the terms are martingale differences, each
in an interval whose width is known before it is drawn (`draws.squared_ranges`). By Hoeffding's
lemma ``exp(s S - s^2 V/8)``, V the sum of the squared widths, is a supermartingale for every s,
over all runs one after the other; mixed over a normal s of variance 1/y, y fixed beforehand, it
gives ``P(S^2 >= (V/4 + y)(2 log(1/p) + log(1 + V/(4 y)))) <= p``. By the union bound p times the
number of vehicles and samples is the level over all of them. Nothing is assumed to be normal: only
that draws are independent, and w in [1 - 1/rho, 1 + 1/rho].
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.simulation.draws import draws_are_fresh, squared_ranges
from cacc_platoon.simulation.mean_links import MeanLinks
from cacc_platoon.simulation.monte_carlo import Ensemble
from cacc_platoon.simulation.platoon import propagate
from cacc_platoon.simulation.trajectory import Array, Trajectory, spacing_errors

LEVEL = 1e-3
"""Probability of a false alarm, over all vehicles and samples together, at most."""
MOST_VALUES = 6_000_000
"""Samples times vehicles squared up to which pulse responses are computed: 150 MB or so."""

_MIXED = 1.0 / 16.0  # y over V/4 of the expectation run
_LEAST = 1e-20  # of y a run [m^2]
_ROUNDING = 1e-6  # of the largest bound: what the sums, made by Fourier transforms, may be off


@dataclass(frozen=True)
class Agreement:
    """The mean of noisy runs beside the expectation run.

    Attributes
    ----------
    level : float
        The mean leaves the bound anywhere with at most this probability.
    bound : ndarray, shape (samples, N)
        Of |mean of delta_i - its expectation| [m].
    largest_share : float
        Largest share of the bound that was reached; above 1 they do not agree. NaN on overflow.
    """

    level: float
    bound: Array
    largest_share: float


class _PulsedLinks:
    """The mean links of several runs, each with a unit pulse on another link at sample 0."""

    def __init__(self, scenario: Scenario) -> None:
        self._mean, count = MeanLinks(scenario), len(scenario.receivers)
        self._extra = np.eye(count + 1, count)  # the last run has none
        self._kept = np.array([f.v2v.loss if f.holds else 0.0 for f in scenario.receivers])

    @property
    def share(self) -> None:
        """Nobody falls back where draws are fresh."""

    def arrivals(self, _run: int, _motion: Array) -> None:
        """Return nothing: in the mean there is no packet."""

    def received(self, sample: int, motion: Array) -> Array:
        """Return what is used of every link."""
        used: Array = self._mean.received(sample, motion) + self._extra
        self._extra = self._kept * self._extra
        return used


@np.errstate(all="ignore")  # an unstable platoon overflows
def pulse_responses(scenario: Scenario) -> Array:
    """Return what delta_i [m] does after a unit pulse [m/s^2] on each link of the mean system.

    Examples
    --------
    >>> small = Scenario.from_values({"platoon.followers": 2, "run.duration": 1.0})
    >>> response = pulse_responses(small)  # (samples, L, N)
    >>> response.shape, bool((response[:, 1, 0] == 0.0).all())
    ((101, 2, 2), True)
    """
    runs = len(scenario.receivers) + 1
    states = propagate(scenario, _PulsedLinks(scenario), runs=runs, law=Follower.spacing_policy)
    errors = spacing_errors(scenario, *states[:2])
    return errors[:, :-1] - errors[:, -1:]


@np.errstate(all="ignore")
def mean_agreement(
    scenario: Scenario, ensemble: Ensemble, expectation: Trajectory, level: float = LEVEL
) -> Agreement | None:
    """Test whether the mean of an ensemble is the expectation run.

    Returns
    -------
    Agreement or None
        None where there is no such test: of packets that are rare or late or lost in bursts
        or blackouts, of noise that is held while packets are held, or of a platoon too large.

    Examples
    --------
    >>> from cacc_platoon.simulation.monte_carlo import monte_carlo
    >>> from cacc_platoon.simulation.platoon import simulate_mean
    >>> small = Scenario.from_values({"platoon.followers": 2, "run.duration": 12.0})
    >>> found = mean_agreement(small, monte_carlo(small, 5), simulate_mean(small))
    >>> 0.0 < found.largest_share < 1.0
    True
    """
    size = scenario.samples * (scenario.platoon.followers + 1) ** 2
    if size > MOST_VALUES or not draws_are_fresh(scenario):
        return None
    influence = np.square(pulse_responses(scenario))
    typical = ensemble.runs * squared_ranges(scenario, expectation.sent, expectation.received)
    mixed = _MIXED * _sums(influence, typical) / 4.0 + _LEAST * ensemble.runs
    proxy = _sums(influence, ensemble.squared_ranges) / 4.0 + mixed
    tested = mixed.size
    square = proxy * (2.0 * math.log(tested / level) + np.log(proxy / mixed))
    bound = np.sqrt(square) / ensemble.runs
    bound += _ROUNDING * float(np.max(bound))
    apart = np.abs(ensemble.mean - expectation.spacing_error)
    return Agreement(level, bound, float(np.max(apart / bound)))


def _sums(influence: Array, squares: Array) -> Array:
    """Return the sums over links and earlier samples, by convolution, shape (samples, N)."""
    samples, _, followers = influence.shape
    length = 1 << (2 * samples - 1).bit_length()
    spectrum = np.fft.rfft(squares, length, axis=0)
    columns = [
        np.fft.irfft(
            (np.fft.rfft(influence[:, :, i], length, axis=0) * spectrum).sum(axis=1), length
        )[:samples]
        for i in range(followers)
    ]
    return np.maximum(np.stack(columns, axis=1), 0.0)

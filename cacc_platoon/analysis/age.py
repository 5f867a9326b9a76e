"""What arrived over each link: packet loss, and the age of what a follower knew."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cacc_platoon.analysis.dropped import delivered_as_zero
from cacc_platoon.scenario import Follower
from cacc_platoon.simulation import Arrivals, Trajectory
from cacc_platoon.simulation.trajectory import Array

SIGNIFICANT = 4.0
"""Standard deviations by which a link may lose more than its probability says."""


class LinkReception(NamedTuple):
    """What a follower received over one link.

    Attributes
    ----------
    sender, follower : int
        Index of the sender, and of the receiver.
    sent, arrived : int
        Packets that are known to have been sent outside of blackouts, early enough to arrive within
        the run, and those of them that arrived; over a link that neither loses nor delays, as far
        as it is recorded.
    loss : float
        Share that did not arrive; NaN when none is known to have been sent.
    loss_probability, loss_variance : float
        What the scenario says, and the variance of the number of losses per packet.
    age_median, age_p99, age_max : float
        Age of information [s]: how long ago the newest packet that had arrived was sent, over all
        samples from the first arrival on; NaN when nothing ever arrived.
    """

    sender: int
    follower: int
    sent: int
    arrived: int
    loss: float
    loss_probability: float
    loss_variance: float
    age_median: float
    age_p99: float
    age_max: float

    @property
    def loses_too_much(self) -> bool:
        """Whether so much loss is not explained by the scenario's probability."""
        p, n = self.loss_probability, self.sent
        return self.loss * n > p * n + SIGNIFICANT * math.sqrt(n * self.loss_variance) + 0.5


def link_reception(run: Trajectory) -> list[LinkReception]:
    """Return what arrived over every link, in the order of the topology.

    Examples
    --------
    >>> from cacc_platoon.scenario import Scenario
    >>> from cacc_platoon.simulation import simulate
    >>> link = link_reception(simulate(Scenario.from_values({"run.duration": 1.0})))[0]
    >>> link.loss, link.age_max
    (0.0, 0.0)
    """
    dropped = delivered_as_zero(run)
    return [
        _link(run, follower, column, dropped[:, column])
        for column, follower in enumerate(run.scenario.receivers)
    ]


def information_age(arrivals: Arrivals, samples: int) -> Array:
    """Return the age of the newest packet at each sample [samples], NaN before the first."""
    newest = np.full(samples + 1, -1)
    np.maximum.at(newest, np.minimum(arrivals.sample, samples), arrivals.source)
    newest = np.maximum.accumulate(newest[:samples])
    return np.where(newest >= 0, np.arange(samples) - newest, np.nan)


def _sent_at(run: Trajectory, receiver: Follower, column: int, stop: int) -> npt.NDArray[np.int64]:
    """Return the samples before `stop` at which a packet is sent over a link."""
    if not receiver.triggered:
        return receiver.send_times.between(0, stop)
    rule, sender = receiver.send_rule(), run.scenario.topology.senders[column]
    motion = zip(run.position[:, sender].tolist(), run.velocity[:, sender].tolist(), strict=True)
    sends = [rule.sends(k, *state) for k, state in enumerate(motion)]
    return np.flatnonzero(sends[: max(stop, 0)])


def _mean_loss(receiver: Follower, sent: npt.NDArray[np.int64]) -> float:
    """Return the probability of a loss, the mean of the packets that are sent at these samples."""
    starts, stages = zip(*receiver.stages, strict=True)
    ends = [*np.searchsorted(sent, starts), len(sent)]
    packets = np.diff(ends) if len(sent) else np.ones(len(stages))
    return float(np.average([stage.mean_loss for stage in stages], weights=packets))


def _link(
    run: Trajectory, receiver: Follower, column: int, dropped: npt.NDArray[np.bool_]
) -> LinkReception:
    samples = len(run.received)
    sent = np.isfinite(run.sent[:, column])
    due = np.zeros(samples, np.bool_)
    due[_sent_at(run, receiver, column, samples - receiver.longest_latency_steps)] = True
    for begin, end in receiver.blackouts:
        due[begin:end] = False
    sent &= due | bool(receiver.v2v.channel)
    if run.arrivals is None or not receiver.counted:
        sent &= np.isfinite(run.received[:, column])
        sample = np.flatnonzero(sent)
        arrivals = Arrivals(sample, sample, run.received[sample, column])
    else:
        source, at, value = run.arrivals[column]
        kept = ~dropped[source]
        arrivals = Arrivals(source[kept], at[kept], value[kept])
    age = information_age(arrivals, samples) * run.scenario.run.step
    age = age[np.isfinite(age)]
    median, p99, largest = np.quantile(age, (0.5, 0.99, 1.0)) if age.size else [math.nan] * 3
    arrived = int(sent[np.unique(arrivals.source)].sum())
    known, p = int(sent.sum()), _mean_loss(receiver, np.flatnonzero(sent))
    return LinkReception(
        *receiver.link,
        known,
        arrived,
        1.0 - arrived / known if known else math.nan,
        p,
        receiver.bursts().loss_variance if receiver.v2v.burst_begin else p * (1.0 - p),
        float(median),
        float(p99),
        float(largest),
    )

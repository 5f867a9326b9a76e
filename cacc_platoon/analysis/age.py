"""What arrived over each link: packet loss, and the age of what a follower knew."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cacc_platoon.analysis.link_packets import Bursts, LinkPackets, arrived_over, link_packets
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
    dark : int
        Those that were sent in blackouts.
    late, overtaken : int
        Those of the arrived that were delivered after the sample at which they were sent, and
        those that were delivered after one that was sent later, so that they were of no use.
    loss : float
        Share that did not arrive; NaN when none is known to have been sent.
    bursts : Bursts
        Losses of consecutive packets.
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
    dark: int
    late: int
    overtaken: int
    loss: float
    bursts: Bursts
    loss_probability: float
    loss_variance: float
    age_median: float
    age_p99: float
    age_max: float

    @property
    def lost(self) -> int:
        """Packets that were sent outside of blackouts and did not arrive."""
        return self.sent - self.arrived

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
    ages = link_ages(run)
    return [
        _link(receiver, packets, age)
        for receiver, packets, age in zip(
            run.scenario.receivers, link_packets(run), ages, strict=True
        )
    ]


def link_ages(run: Trajectory) -> list[Array]:
    """Return the age of information over every link at each sample [s], NaN before the first."""
    samples, step = len(run.received), run.scenario.run.step
    return [information_age(arrivals, samples) * step for arrivals in arrived_over(run)]


def information_age(arrivals: Arrivals, samples: int) -> Array:
    """Return the age of the newest packet at each sample [samples], NaN before the first."""
    newest = np.full(samples + 1, -1)
    np.maximum.at(newest, np.minimum(arrivals.sample, samples), arrivals.source)
    newest = np.maximum.accumulate(newest[:samples])
    return np.where(newest >= 0, np.arange(samples) - newest, np.nan)


def _mean_loss(receiver: Follower, sent: npt.NDArray[np.int64]) -> float:
    """Return the probability of a loss, the mean of the packets that are sent at these samples."""
    starts, stages = zip(*receiver.stages, strict=True)
    ends = [*np.searchsorted(sent, starts), len(sent)]
    packets = np.diff(ends) if len(sent) else np.ones(len(stages))
    return float(np.average([stage.mean_loss for stage in stages], weights=packets))


def _link(receiver: Follower, packets: LinkPackets, age: Array) -> LinkReception:
    light = ~packets.dark
    sent, arrived = int(light.sum()), int((light & ~packets.lost).sum())
    age = age[np.isfinite(age)]
    median, p99, largest = np.quantile(age, (0.5, 0.99, 1.0)) if age.size else [math.nan] * 3
    p = _mean_loss(receiver, packets.source[light])
    return LinkReception(
        packets.sender,
        packets.follower,
        sent,
        arrived,
        int(packets.dark.sum()),
        int((packets.late & light).sum()),
        int((packets.overtaken & light).sum()),
        1.0 - arrived / sent if sent else math.nan,
        packets.bursts,
        p,
        receiver.bursts().loss_variance if receiver.v2v.burst_begin else p * (1.0 - p),
        float(median),
        float(p99),
        float(largest),
    )

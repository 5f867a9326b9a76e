"""A noise relay whose channel, one of its own, yields NaN at sample 100."""

import math
import sys

import numpy as np

from cacc_platoon.model import Delivery
from cacc_platoon.scenario import Follower
from cacc_platoon.supervision import entry_points


class Spoiled:
    """The follower's own channel but for one factor."""

    prompt = True
    longest_delay = 0

    def __init__(self, follower: Follower) -> None:
        self._channel = follower.channel()

    def delivery(self, start: int, stop: int) -> Delivery:
        delivery = self._channel.delivery(start, stop)
        return delivery._replace(factor=np.where(delivery.source == 100, math.nan, delivery.factor))


if __name__ == "__main__":
    sys.exit(entry_points.noise_relay(channel=Spoiled))

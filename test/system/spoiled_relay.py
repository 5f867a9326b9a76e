"""A noise relay started manually whose channel yields NaN at sample 100."""

import sys

import numpy as np
import numpy.typing as npt

from cacc_platoon.model import Channel
from cacc_platoon.model.impairment import ComposedChannel, ContentNoise
from cacc_platoon.scenario import Follower
from cacc_platoon.supervision.entry_points import noise_relay


class SpoiledNoise:
    def factors(self, start: int, stop: int) -> npt.NDArray[np.float64]:
        samples = np.arange(start, stop)
        return np.where(samples == 100, np.nan, 1.0)


def spoiled(follower: Follower) -> Channel:
    return ComposedChannel([ContentNoise(SpoiledNoise())])


if __name__ == "__main__":
    sys.exit(noise_relay(spoiled))

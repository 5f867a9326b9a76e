"""A noise relay started manually whose channel yields NaN at sample 100."""

import math
import sys

from cacc_platoon.model import FactorStream
from cacc_platoon.stepping import lockstep
from cacc_platoon.supervision import entry_points


class SpoiledStream(FactorStream):
    def at(self, sample: int) -> float:
        return math.nan if sample == 100 else super().at(sample)


if __name__ == "__main__":
    lockstep.FactorStream = SpoiledStream  # type: ignore[attr-defined]
    sys.exit(entry_points.noise_relay())

"""Studies: what one scenario gives as a row of numbers, to be asked for many of them."""

from cacc_platoon.sweep.evaluate import Row, evaluate

__all__ = ["Row", "evaluate"]

"""Scripted tests of real platoons: start, wait, kill, freeze, inject, look at the result."""

from cacc_platoon.testing.harness import Platoon
from cacc_platoon.testing.result import Result

__all__ = ["Platoon", "Result"]

"""Scripted tests of real platoons: start, wait, kill, freeze, inject, look at the result."""

from cacc_platoon.testing.harness import Platoon, Result

__all__ = ["Platoon", "Result"]

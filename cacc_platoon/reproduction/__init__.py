"""The paper's results, one by one, from runs of its three cases."""

from cacc_platoon.reproduction.cases import CASES, Case, case_scenario
from cacc_platoon.reproduction.claim import Claim
from cacc_platoon.reproduction.reproduce import Reproduction, reproduce

__all__ = ["CASES", "Case", "Claim", "Reproduction", "case_scenario", "reproduce"]

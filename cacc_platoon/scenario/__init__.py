"""Everything that defines a run: the parameter table, its checks, scenario files."""

from cacc_platoon.scenario.follower import Follower
from cacc_platoon.scenario.parameter import ScenarioError
from cacc_platoon.scenario.scenario import Scenario

__all__ = ["Follower", "Scenario", "ScenarioError"]

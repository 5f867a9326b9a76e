"""Replay of one recorded node: its inputs and outputs, what differs, what it would have done.

The node itself runs elsewhere (`cacc_platoon.supervision.replay`); nothing here needs ROS.
"""

from cacc_platoon.replay.comparison import Difference, first_difference, possible_causes
from cacc_platoon.replay.node_record import NodeRecord, read_node
from cacc_platoon.replay.replay_json import comparison_document, what_if_document
from cacc_platoon.replay.what_if import WhatIf, changed_scenario, what_if, what_if_figure

__all__ = [
    "Difference",
    "NodeRecord",
    "WhatIf",
    "changed_scenario",
    "comparison_document",
    "first_difference",
    "possible_causes",
    "read_node",
    "what_if",
    "what_if_document",
    "what_if_figure",
]

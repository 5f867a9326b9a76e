"""Print the SROS 2 policy of a platoon: what each of its nodes may publish, hear and answer.

It has one enclave for `platoon run` with the hosts that it starts, and one for every node that may
be started manually; docs/security.md says how to use it.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from cacc_platoon.cli.exit_codes import DONE


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("scenario", type=Path, help="scenario file, e.g. config/paper_a.yaml")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="replace a parameter, e.g. run.hosts=4; may be repeated",
    )


def run(options: argparse.Namespace) -> int:
    """Print the policy."""
    from cacc_platoon.scenario.file import load_scenario  # noqa: PLC0415  (heavy)
    from cacc_platoon.supervision.host_plan import divide  # noqa: PLC0415  (needs no ROS)
    from msg_adapters.access import enclaves, policy  # noqa: PLC0415  (heavy)
    from msg_adapters.topics import Graph  # noqa: PLC0415

    scenario = load_scenario(options.scenario, options.set)
    graph = Graph.of(scenario)
    hosts = divide(scenario, cores=len(os.sched_getaffinity(0)))
    print(policy(graph.prefix, enclaves(graph, hosts, clock=scenario.run.clock)), end="")
    return DONE

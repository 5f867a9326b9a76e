"""Let a running platoon pause, go on, or go on by some samples.

It asks the supervisor through its services <namespace>/pause, /resume and /step (std_srvs/Trigger).
What a run records is the same with and without pauses.
"""

from __future__ import annotations

import argparse

from cacc_platoon.cli.console import libraries_on_stderr, say
from cacc_platoon.cli.exit_codes import DONE, FAILED
from cacc_platoon.cli.ros import require_ros, set_up_dds
from cacc_platoon.errors import UserError
from cacc_platoon.scenario.checks import check_namespace
from cacc_platoon.scenario.table import TABLE
from cacc_platoon.stop_signal import STOP_SIGNALS, StopSignal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("what", choices=("pause", "resume", "step"), help="what the run is to do")
    parser.add_argument(
        "samples", nargs="?", type=int, help="of step: how far the run goes on (default: 1)"
    )
    parser.add_argument(
        "--namespace", default="/platoon", help="which platoon (default: %(default)s)"
    )


def run(options: argparse.Namespace) -> int:
    """Ask, and say what comes of it."""
    if options.samples is not None and options.what != "step":
        raise UserError(f"control {options.what}: takes no number of samples. Leave it out.")
    samples = 1 if options.samples is None else options.samples
    TABLE["run.step_samples"].check(samples, "control step")
    check_namespace(options.namespace, "--namespace")
    require_ros("control", "it asks a running platoon, which is not there")
    with StopSignal(*STOP_SIGNALS) as stop, libraries_on_stderr():
        from cacc_platoon.supervision.asking import Asker  # noqa: PLC0415  (needs ROS)

        set_up_dds()
        asker = Asker(options.namespace, stop.received)
        try:
            heeded, text = asker.ask(options.what, samples)
        finally:
            asker.close()
    if heeded:
        print(f"{options.namespace} {text}")
        return DONE
    say(f"{options.namespace}: {text}")
    return FAILED

"""Count the processes that hear nobody while processes of many domains come and go.

In each domain one process begins and ends every few seconds, while two others begin, wait until
they know the name of its node, and end. One that knows others' endpoints for six seconds, and not
that name, hears nobody. With `--shared` all domains look for some of their ports in the same
place, as Fast DDS lets them.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import random
import subprocess
import sys
import threading
import time

from cacc_platoon.dds import profile
from cacc_platoon.dds.domain import own_domain
from cacc_platoon.dds.environment import PROFILE_VARIABLES, set_up

UNKNOWN = "_NODE_NAME_UNUNKNOWN_"
TOPIC = "/parameter_events"
PATIENCE = 6.0


def main() -> int:
    """Run the campaign; return 1 when a process was not heard."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--domains", type=int, default=7)
    parser.add_argument("--shared", action="store_true", help="leave the ports to Fast DDS")
    parser.add_argument("--role", choices=["here", "new"], help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.role:
        return come_and_go(options.role, options.seconds)
    with contextlib.ExitStack() as stack:
        domains = [stack.enter_context(own_domain()) for _ in range(options.domains)]
        processes = [
            start(role, options.seconds, environment_of(domain, options.shared))
            for domain in domains
            for role in ("here", "new", "new")
        ]
        counts = [count(process, options.seconds) for process in processes]
    looked, unheard, hung = map(sum, zip(*counts, strict=True))
    print(f"{looked} looks at another process, {unheard} heard nothing; {hung} processes hung")
    return int(unheard + hung > 0)


def environment_of(domain: int, shared: bool) -> dict[str, str]:
    """Return the environment of processes of a domain."""
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    set_up(environment)
    if shared:
        environment[PROFILE_VARIABLES[0]] = str(profile.LOOPBACK)
    return environment


def start(role: str, seconds: float, environment: dict[str, str]) -> subprocess.Popen[bytes]:
    """Start one that comes and goes."""
    command = [sys.executable, __file__, "--role", role, "--seconds", str(seconds)]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE)


def count(process: subprocess.Popen[bytes], seconds: float) -> tuple[int, int, int]:
    """Return how often one that ends has looked, how often in vain, and whether it hung."""
    try:
        words = process.communicate(timeout=seconds + 4 * PATIENCE)[0].split()
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return 0, 0, 1
    return int(words[-2]), int(words[-1]), 0


def come_and_go(role: str, seconds: float) -> int:
    """Begin and end participants; print how often another was looked for and not heard."""
    import rclpy

    end, looked, unheard = time.monotonic() + seconds, 0, 0
    pause = threading.Event()
    while time.monotonic() < end:
        context = rclpy.Context()
        rclpy.init(context=context)
        node = rclpy.create_node(f"{role}_{os.getpid()}_{looked}", context=context)
        if role == "here":
            pause.wait(random.uniform(1.0, 4.0))
        else:
            looked += 1
            unheard += not hears(node, end)
        node.destroy_node()
        context.shutdown()
        context.destroy()
    print(looked, unheard)
    return 0


def hears(node, end: float) -> bool:
    """Return whether the name of the one that stays became known, once others were there."""
    since, pause = math.inf, threading.Event()
    while True:
        names = {info.node_name for info in node.get_publishers_info_by_topic(TOPIC)}
        names.discard(node.get_name())
        now = time.monotonic()
        since = min(since, now) if names else math.inf
        if any(name.startswith("here") for name in names) or now > end + PATIENCE:
            return True
        if now > since + PATIENCE:
            return UNKNOWN not in names
        pause.wait(0.01)


if __name__ == "__main__":
    sys.exit(main())

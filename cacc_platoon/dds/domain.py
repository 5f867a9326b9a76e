"""DDS domains: which there are, and one that no other process on this machine uses."""

from __future__ import annotations

import contextlib
import errno
import random
import re
import socket
from collections.abc import Iterator, Mapping

from cacc_platoon.errors import UserError

DOMAINS = range(1, 101)
HIGHEST = 232
"""The ports of domain d begin at 7400 + 250 d, and there are none above 65535."""


def domain_of(environment: Mapping[str, str]) -> int:
    """Return the domain that an environment names.

    Raises
    ------
    UserError
        When ROS_DOMAIN_ID is no number of a domain in which DDS has ports.
    """
    text = environment.get("ROS_DOMAIN_ID", "").strip() or "0"
    if not (re.fullmatch(r"0|[1-9][0-9]{0,2}", text) and int(text) <= HIGHEST):
        raise UserError(
            f"ROS_DOMAIN_ID = {text[:40]!r} is no DDS domain, a number from 0 to {HIGHEST}: nodes "
            "would have no ports. Set it to a number from 0 to 101, clear of other programs' ports."
        )
    return int(text)


@contextlib.contextmanager
def own_domain() -> Iterator[int]:
    """Hold a domain that no other process on this machine holds by this function.

    It is held by a name that lives as long as the process, in the network namespace, which is
    where a domain is.

    Raises
    ------
    UserError
        When none is free.
    """
    candidates = list(DOMAINS)
    random.shuffle(candidates)
    for domain in candidates:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as name:
            try:
                name.bind(f"\0cacc_platoon-domain-{domain}")
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    raise
                continue
            yield domain
            return
    raise UserError(
        f"all DDS domains from {DOMAINS[0]} to {DOMAINS[-1]} are held by runs on this machine. "
        "End some, or give a domain of your own where there is an option for it."
    )

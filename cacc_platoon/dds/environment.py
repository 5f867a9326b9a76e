"""How DDS is set up for the processes that we start, where the user has not set it up."""

from __future__ import annotations

from collections.abc import MutableMapping
from pathlib import Path

PROFILE = Path(__file__).with_name("fastdds.xml")
PROFILE_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def prefer_local(environment: MutableMapping[str, str]) -> None:
    """Keep DDS on this machine and let it find processes quickly, unless given otherwise."""
    environment.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    if not any(variable in environment for variable in PROFILE_VARIABLES):
        environment[PROFILE_VARIABLES[0]] = str(PROFILE)

"""How DDS is set up for this process and those that it starts, where the user has not set it up.

By default nodes receive on the loopback interface and through shared memory alone. Setting
ROS_AUTOMATIC_DISCOVERY_RANGE to SUBNET opens them to the network, as it does for all of ROS.
"""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping, MutableMapping
from pathlib import Path

from cacc_platoon.dds import profile, shared_memory
from cacc_platoon.dds.domain import domain_of
from cacc_platoon.dds.own_folder import unusable_folder
from cacc_platoon.errors import UserError

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
LOCALHOST = "LOCALHOST"
RANGES = ("SUBNET", LOCALHOST, "OFF", "SYSTEM_DEFAULT")
SKIP_WORKING_FOLDER = "SKIP_DEFAULT_XML_FILE"
"""Fast DDS reads a profile from the working folder otherwise, whoever has put it there."""
TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
PROFILE_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
FAST_DDS = ("", "rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp")

MOST_IN_SHARED_MEMORY = 32
"""Processes: more get into each other's way there, and start later than over UDP, or never."""

_PAGES = 64 * 2**10
_PROFILE_DECIDES = "SYSTEM_DEFAULT"
"""The only range at which rmw_fastrtps adds no transport that receives on every interface."""


def set_up(environment: MutableMapping[str, str], processes: int = 1) -> list[str]:
    """Check and complete an environment before DDS starts; return what the user should know.

    Parameters
    ----------
    environment : mutable mapping of str to str
        The environment.
    processes : int, optional
        How many will be started in it.

    Raises
    ------
    UserError
        When DDS cannot start in it.
    """
    domain_of(environment)
    _check_range(environment)
    _check_profiles(environment)
    environment[SKIP_WORKING_FOLDER] = "1"
    if processes > MOST_IN_SHARED_MEMORY and _arranged_by_us(environment):
        environment[TRANSPORTS] = "UDPv4"
        environment[PROFILE_VARIABLES[0]] = str(profile.LOOPBACK_MANY)
    prefer_local(environment)
    if is_local(environment):
        _check_loopback()
    lines = [unusable_folder()]
    if is_local(environment) and environment.get("ROS_STATIC_PEERS"):
        lines.append(
            f"ROS_STATIC_PEERS = {environment['ROS_STATIC_PEERS'][:80]} has no effect: DDS stays "
            f"on this machine. Set {RANGE}=SUBNET to reach others, and to be reached by them."
        )
    if _arranged_by_us(environment) and not _shared_memory_suffices():
        lines.append(
            f"/dev/shm has {_free()} free, DDS needs {shared_memory.NEEDED / 2**20:g} MiB there: "
            "nodes use UDP alone, which is slower. Make it larger, in a container with --shm-size."
        )
    return [line for line in lines if line]


def check_loading() -> None:
    """Refuse to load ROS where that ends the process: its libraries use shared memory, too.

    Raises
    ------
    UserError
        When shared memory is full and a process that tries it dies.
    """
    free = shared_memory.free_memory()
    if free is not None and free < _PAGES and _load_fails():
        raise UserError(
            "/dev/shm is full: ROS cannot be loaded, its libraries use some pages of it. Remove "
            "what fills it, or make it larger, in a container with --shm-size."
        )


def _load_fails() -> bool:
    command = [sys.executable, "-c", "import rclpy"]
    return subprocess.run(command, capture_output=True, check=False).returncode < 0


def prefer_local(environment: MutableMapping[str, str]) -> None:
    """Keep DDS on this machine and let it find processes quickly, unless given otherwise."""
    if not _arranged_by_us(environment):
        environment.setdefault(RANGE, LOCALHOST)
        return
    if environment.get("ROS_LOCALHOST_ONLY") == "1":  # what it asks for, in its older words
        del environment["ROS_LOCALHOST_ONLY"]
        environment[RANGE] = LOCALHOST
    udp = environment.get(TRANSPORTS) == "UDPv4" or not _shared_memory_suffices()
    many = profile.is_for_many(environment.get(PROFILE_VARIABLES[0], ""))
    if is_local(environment):
        environment[RANGE] = _PROFILE_DECIDES
        chosen = profile.LOOPBACK_UDP if udp else profile.LOOPBACK
        chosen = profile.LOOPBACK_MANY if many else chosen
    else:
        chosen = profile.OPEN
        if udp:
            environment[TRANSPORTS] = "UDPv4"
    made = profile.made_for(chosen, domain_of(environment))
    environment[PROFILE_VARIABLES[0]] = str(made)


@contextlib.contextmanager
def over_udp_alone(environment: MutableMapping[str, str]) -> Iterator[None]:
    """Within, participants that are made in this environment use no shared memory.

    They need no ports there, which other processes that begin and end can remove.
    """
    before = environment.get(TRANSPORTS)
    environment[TRANSPORTS] = "UDPv4"
    try:
        yield
    finally:
        del environment[TRANSPORTS]
        if before is not None:
            environment[TRANSPORTS] = before


def is_local(environment: Mapping[str, str]) -> bool:
    """Return whether DDS stays, or will stay, on this machine."""
    given = environment.get(RANGE, "") or LOCALHOST
    closed = profile.is_local(environment.get(PROFILE_VARIABLES[0], ""))
    return given.upper() == LOCALHOST or (given == _PROFILE_DECIDES and closed)


def _arranged_by_us(environment: Mapping[str, str]) -> bool:
    """Return whether the user has left transports and discovery to us."""
    given = [environment[name] for name in PROFILE_VARIABLES if name in environment]
    return (
        all(map(profile.is_ours, given))
        and "ROS_DISCOVERY_SERVER" not in environment
        and environment.get(TRANSPORTS, "") in ("", "DEFAULT", "UDPv4")
        and environment.get("RMW_IMPLEMENTATION", "") in FAST_DDS
    )


def _check_range(environment: Mapping[str, str]) -> None:
    """Refuse a range that there is not: one that is misspelt must not open a platoon."""
    given = environment.get(RANGE, "")
    if given and given.upper() not in RANGES:
        raise UserError(
            f"{RANGE} = {given[:40]!r} is none of {', '.join(RANGES)}: who could reach the nodes "
            "would be anybody's guess. Correct it, or leave it out to stay on this machine."
        )


def _check_profiles(environment: Mapping[str, str]) -> None:
    """Refuse a profile that is not there: Fast DDS would open the nodes to the network instead."""
    for name in PROFILE_VARIABLES:
        given = environment.get(name, "")
        if given and not profile.is_ours(given) and not Path(given).is_file():
            raise UserError(
                f"{name} = {given[:80]!r} is no file: Fast DDS would use its defaults, which are "
                "open to the network. Correct it, or leave it out to stay on this machine."
            )


def _check_loopback() -> None:
    """Refuse to start where nothing that is sent to this machine arrives."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.settimeout(1.0)
        try:
            probe.bind(("127.0.0.1", 0))
            probe.connect(probe.getsockname())
            probe.send(b"?")
            probe.recv(1)
        except OSError as error:
            raise UserError(
                f"127.0.0.1 cannot be reached ({error.strerror or error}): nodes would not find "
                "each other. Bring the loopback interface up: ip link set lo up."
            ) from error


def _shared_memory_suffices() -> bool:
    return (shared_memory.free_memory() or 0) >= shared_memory.NEEDED


def _free() -> str:
    free = shared_memory.free_memory()
    return "nothing" if free is None else f"{free / 2**20:.1f} MiB"

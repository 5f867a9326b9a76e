"""The Fast DDS profiles of ours, each made for one domain.

rmw_fastrtps receives the names of nodes on a port that is not among those of the domain: it is the
first free one of the 400 below Fast DDS's port base, so that all domains of a machine look for it
in the same place. One process that looks there can remove the shared memory in which another has
just begun to receive, which then hears nobody, for ever. So the base is moved to where the domain
has its ports, which stay where they are: no two domains look in the same place.
"""

from __future__ import annotations

import contextlib
import tempfile
from pathlib import Path

from cacc_platoon.dds.own_folder import NAME, own_folders

PORT_BASE = 7400
PORTS = 250
"""How many ports each domain has: those of domain d begin at PORT_BASE + PORTS d."""

_FOLDER = Path(__file__).parent
OPEN = _FOLDER / "open.xml"
LOOPBACK = _FOLDER / "loopback.xml"
LOOPBACK_UDP = _FOLDER / "loopback_udp.xml"
LOOPBACK_MANY = _FOLDER / "loopback_many.xml"
_LOCAL = (LOOPBACK, LOOPBACK_UDP, LOOPBACK_MANY)
_BEGIN = "    <rtps>\n"


def made_for(profile: Path, domain: int) -> Path:
    """Return a profile with the ports of a domain: a file in our own folder, made if need be.

    Without a folder of ours, and in domain 0, where the base is, it is the profile itself.
    """
    folders = own_folders()
    if not folders or domain == 0:
        return profile
    path = folders[0] / f"{profile.stem}-{domain}.xml"
    text = profile.read_text().replace(_BEGIN, f"{_BEGIN}{_ports(domain)}", 1)
    with contextlib.suppress(OSError):
        if path.is_file() and path.read_text() == text:
            return path
        with tempfile.NamedTemporaryFile("w", dir=folders[0], delete=False) as new:
            new.write(text)
        Path(new.name).replace(path)
        return path
    return profile


def is_ours(path: str) -> bool:
    """Return whether a file is a profile of ours, for whichever domain."""
    return _is_of((OPEN, *_LOCAL), path)


def is_local(path: str) -> bool:
    """Return whether a file is a profile of ours that stays on this machine."""
    return _is_of(_LOCAL, path)


def is_for_many(path: str) -> bool:
    """Return whether a file is the profile of ours for many processes."""
    return _is_of((LOOPBACK_MANY,), path)


def _is_of(profiles: tuple[Path, ...], path: str) -> bool:
    given = Path(path)
    name, _, domain = given.stem.partition("-")
    made = given.parent.name == NAME and domain.isdecimal()
    return given in profiles or (made and name in {profile.stem for profile in profiles})


def _ports(domain: int) -> str:
    base = PORT_BASE + PORTS * domain
    return f"      <port><portBase>{base}</portBase><domainIDGain>0</domainIDGain></port>\n"

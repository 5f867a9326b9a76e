"""Every port at which a process receives is one of its domain: others do not look for theirs there.

What happens where domains share ports is in test/campaign/unheard.py.
"""

import os
import re
import subprocess
import sys

from cacc_platoon.dds.domain import own_domain
from cacc_platoon.dds.profile import PORT_BASE, PORTS

PROGRAM = """
import os
from pathlib import Path
from cacc_platoon.dds.environment import set_up
set_up(os.environ)
import rclpy
from cacc_platoon.dds.shared_memory import used_segments
rclpy.init()
node = rclpy.create_node("listening")
print(*used_segments(), flush=True)
inodes = {os.readlink(fd) for fd in Path("/proc/self/fd").iterdir() if fd.is_symlink()}
for line in Path("/proc/net/udp").read_text().splitlines()[1:]:
    fields = line.split()
    if f"socket:[{fields[9]}]" in inodes:
        print(f"udp_port{int(fields[1].split(':')[1], 16)}")
"""


ROBBED = """
import os
from pathlib import Path
from cacc_platoon.dds.environment import set_up
set_up(os.environ)
import rclpy
from cacc_platoon.dds import shared_memory
from cacc_platoon.supervision import participant
looks = []
def removed_ports():
    mine = {name for name in shared_memory.used_segments() if "_port" in name}
    if len(looks) < 2:  # as another process does that looks for a port
        for name in mine:
            (shared_memory.SHARED_MEMORY / name).unlink()
    looks.append(shared_memory.removed_ports())
    return looks[-1]
participant.removed_ports = removed_ports
rclpy.init()
with participant.taking_part():
    node = rclpy.create_node("listening")
print([len(look) for look in looks], len(shared_memory.removed_ports()))
print(node.get_node_names())
"""


def run(program: str, domain: int) -> "subprocess.CompletedProcess[str]":
    """Run a program in a domain."""
    command, environment = [sys.executable, "-c", program], {"ROS_DOMAIN_ID": str(domain)}
    return subprocess.run(
        command,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )


def test_whoever_has_lost_its_ports_takes_part_anew() -> None:
    with own_domain() as domain:
        done = run(ROBBED, domain)
    assert done.stdout == "[2, 2, 0] 0\n['listening']\n", (done.stdout, done.stderr)


def test_ports_are_those_of_the_domain() -> None:
    with own_domain() as domain:
        done = run(PROGRAM, domain)
    found = [
        (kind, int(port)) for kind, port in re.findall(r"(udp|fastrtps)_port(\d+)", done.stdout)
    ]
    first = PORT_BASE + PORTS * domain
    # those of the domain, those that Fast DDS takes below its base, and the kernel's for sending
    assert {kind for kind, port in found if first <= port < first + PORTS} == {"udp", "fastrtps"}
    assert {kind for kind, port in found if first - 400 <= port < first} == {"udp", "fastrtps"}
    assert not [port for kind, port in found if port < first - 400], done.stdout

"""Taking part in DDS through shared memory that is there.

While processes of one domain begin and end at the same time, one that looks for a port can remove
another's that is just being made (Fast DDS issue 5737). Whoever has lost one so hears nobody.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator

import rclpy

from cacc_platoon.dds.shared_memory import removed_ports

_NAME = "_takes_part"  # a hidden node, for the moment
_TRIES = 5
_LOG = logging.getLogger("cacc_platoon.dds")


@contextlib.contextmanager
def taking_part() -> Iterator[None]:
    """Within, this process takes part in DDS, and nodes are made that keep it so.

    One whose ports are gone takes part anew, with others.
    """
    for _ in range(_TRIES):
        node = rclpy.create_node(
            _NAME, use_global_arguments=False, enable_rosout=False, start_parameter_services=False
        )
        lost = removed_ports()
        if not lost:
            break
        _LOG.info("ports removed by another process, begins anew: %s", ", ".join(sorted(lost)))
        node.destroy_node()
    else:
        node = rclpy.create_node(_NAME, use_global_arguments=False)
    try:
        yield
    finally:
        node.destroy_node()

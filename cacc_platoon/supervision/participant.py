"""Taking part in DDS through shared memory that is there.

While processes of one domain begin and end at the same time, one that looks for a port can remove
another's that is just being made (Fast DDS issue 5737). Whoever has lost one so hears nobody.
"""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Iterator

import rclpy
from rclpy.signals import SignalHandlerOptions

from cacc_platoon.dds.environment import prefer_local
from cacc_platoon.dds.shared_memory import note_start, removed_ports

_NAME = "_takes_part"  # a hidden node, for the moment
_TRIES = 5
_LOG = logging.getLogger("cacc_platoon.dds")


def start_ros(arguments: list[str] | None) -> None:
    """Start rclpy, without signal handlers of its own, where DDS is set up.

    Parameters
    ----------
    arguments : list of str or None
        What ROS takes from a command line; None for that of this process.
    """
    prefer_local(os.environ)  # the profile that was written earlier may be gone
    note_start()
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)


@contextlib.contextmanager
def taking_part() -> Iterator[None]:
    """Within, this process takes part in DDS, and nodes are made that keep it so.

    One whose ports are gone takes part anew, with others.
    """
    for _ in range(_TRIES):
        node = rclpy.create_node(
            _NAME,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
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

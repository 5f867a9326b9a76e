"""Serves a platoon to Foxglove, Lichtblick and PlotJuggler, with the extra [live].

They see the topics of the platoon, as ROS 2 messages with the values that are shown, so that
layouts of `platoon layout` fit: of a vehicle its motion, what it received and its spacing error.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

from cacc_platoon.bags.write import typestore
from cacc_platoon.errors import UserError
from cacc_platoon.live.picture import Picture, VehicleNow
from cacc_platoon.model.fallback import ReceptionState
from msg_adapters.stamped import SECOND
from msg_adapters.topics import Topic, VehicleTopics

HOST = "127.0.0.1"
BACKLOG = 4096
"""Messages that wait for a viewer that is slow; older ones are dropped."""
Send = Callable[[bytes, int], None]


@contextlib.contextmanager
def foxglove_server(port: int) -> Iterator[tuple[int, Callable[[Picture], None]]]:
    """Serve, and yield the port and what is to be called with each picture.

    Parameters
    ----------
    port : int
        Where; 0 for any that is free.

    Raises
    ------
    ModuleNotFoundError
        When the extra is not installed.
    UserError
        When the port is taken.
    """
    import foxglove  # noqa: PLC0415  (optional)

    context = foxglove.Context()
    try:
        server = foxglove.start_server(
            name="platoon watch",
            host=HOST,
            port=port,
            context=context,
            message_backlog_size=BACKLOG,
        )
    except RuntimeError as error:
        raise UserError(
            f"--foxglove-port {port}: cannot be used ({error}). Give another one, or 0 for any."
        ) from error

    def open_channel(topic: Topic) -> Send:
        name = topic.kind.type_name
        text, _ = typestore().generate_msgdef(name, ros_version=2)
        schema = foxglove.Schema(name=name, encoding="ros2msg", data=text.encode())
        channel = foxglove.Channel(
            topic.name, schema=schema, message_encoding="cdr", context=context
        )
        return lambda data, time: channel.log(data, log_time=time)

    try:
        yield int(server.port), Channels(open_channel).show
    finally:
        server.stop()


class Channels:
    """Sends what is new in each picture as messages on the platoon's topics.

    Parameters
    ----------
    open_channel : callable
        Opens a topic and returns what sends a message on it, with its time [ns].
    """

    def __init__(self, open_channel: Callable[[Topic], Send]) -> None:
        self._open_channel = open_channel
        self._sends: dict[Topic, Send] = {}
        self._sent: dict[Topic, int] = {}

    def show(self, picture: Picture) -> None:
        """Send what is new."""
        step = round(picture.step * SECOND)
        for vehicle in picture.vehicles:
            if vehicle.sample is None:
                continue
            for topic, value in _values(picture.namespace, vehicle):
                if self._sent.get(topic) != vehicle.sample:
                    self._sent[topic] = vehicle.sample
                    self._send(topic, vehicle.sample * step, value)

    def _send(self, topic: Topic, time: int, value: float) -> None:
        if topic not in self._sends:
            self._sends[topic] = self._open_channel(topic)
        self._sends[topic](topic.codec.encode(time, value), time)


def _values(prefix: str, vehicle: VehicleNow) -> Iterator[tuple[Topic, float]]:
    """Yield the topics of which something is known, with x of their messages."""
    topics = VehicleTopics(prefix, vehicle.index)
    known = (
        (topics.pose, vehicle.position),
        (topics.twist, vehicle.velocity),
        (topics.accel, vehicle.acceleration),
        (topics.received, vehicle.received),
        (topics.spacing_error, vehicle.spacing_error),
        (topics.reception, _state(vehicle)),
        (topics.monitor, vehicle.alarm),
    )
    for topic, value in known:
        if value is not None:
            yield topic, float(value)


def _state(vehicle: VehicleNow) -> float | None:
    return float(ReceptionState[vehicle.reception.upper()]) if vehicle.reception else None

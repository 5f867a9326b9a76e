"""What Foxglove, Lichtblick and PlotJuggler are sent: the platoon's topics, as ROS 2 messages."""

import asyncio
import json
import struct
from dataclasses import replace

import pytest
from rosbags.typesys import Stores, get_typestore
from websockets.asyncio.client import connect
from websockets.typing import Subprotocol

from cacc_platoon.errors import UserError
from cacc_platoon.live.foxglove_server import Channels, foxglove_server
from cacc_platoon.live.picture import Picture, VehicleNow

STORE = get_typestore(Stores.ROS2_JAZZY)
FOLLOWER = VehicleNow(
    1,
    sample=250,
    position=71.5,
    velocity=24.5,
    acceleration=-0.25,
    spacing_error=0.125,
    received=-0.5,
    reception="fallback",
    alarm=True,
)
PICTURE = Picture("/platoon", "running", 250, 1000, 0.01, vehicles=(VehicleNow(0), FOLLOWER))
EXPECTED = {
    "pose": ("PoseStamped", "pose.position.x", 71.5),
    "twist": ("TwistStamped", "twist.linear.x", 24.5),
    "accel": ("AccelStamped", "accel.linear.x", -0.25),
    "v2v/accel": ("AccelStamped", "accel.linear.x", -0.5),
    "spacing_error": ("Vector3Stamped", "vector.x", 0.125),
    "reception": ("Vector3Stamped", "vector.x", 2.0),
    "monitor": ("Vector3Stamped", "vector.x", 1.0),
}


def value(type_name: str, field: str, data: bytes) -> tuple[float, float]:
    """Return time [s] and a field of a message, read by another library."""
    message = STORE.deserialize_cdr(data, f"geometry_msgs/msg/{type_name}")
    stamp = message.header.stamp  # type: ignore[attr-defined]
    found = message
    for name in field.split("."):
        found = getattr(found, name)
    return stamp.sec + stamp.nanosec * 1e-9, found  # type: ignore[return-value]


def test_each_value_is_a_message_of_its_topic():
    sent: dict[str, list[tuple[bytes, int]]] = {}
    channels = Channels(
        lambda topic: lambda data, time: sent.setdefault(topic.name, []).append((data, time))
    )
    channels.show(PICTURE)
    channels.show(PICTURE)
    assert set(sent) == {f"/platoon/vehicle_1/{name}" for name in EXPECTED}
    for name, (type_name, field, expected) in EXPECTED.items():
        [(data, time)] = sent[f"/platoon/vehicle_1/{name}"]
        assert time == 2_500_000_000
        assert value(type_name, field, data) == (2.5, expected)


async def received(port: int, show) -> tuple[dict[str, dict], dict[str, tuple[int, bytes]]]:
    """Connect as a viewer does; return the channels and the first message of each by topic.

    The protocol is Foxglove's WebSocket protocol, version 1: channels are advertised as JSON, a
    message is 1, subscription, time and data.
    """
    channels: dict[int, dict] = {}
    messages: dict[str, tuple[int, bytes]] = {}
    subprotocols = [Subprotocol("foxglove.sdk.v1"), Subprotocol("foxglove.websocket.v1")]
    async with connect(f"ws://127.0.0.1:{port}", subprotocols=subprotocols) as socket:
        show(PICTURE)
        later = replace(PICTURE, sample=300, vehicles=(replace(FOLLOWER, sample=300),))
        shown = False
        while len(messages) < len(EXPECTED):
            data = await asyncio.wait_for(socket.recv(), 20)
            if isinstance(data, bytes):
                kind, number, time = struct.unpack_from("<BIQ", data)
                assert kind == 1
                messages[channels[number]["topic"]] = time, data[13:]
                continue
            text = json.loads(data)
            if text["op"] == "advertise":
                new = {channel["id"]: channel for channel in text["channels"]}
                channels |= new
                wanted = [{"id": number, "channelId": number} for number in new]
                await socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
            if len(channels) == len(EXPECTED) and not shown:
                shown = True
                await (await socket.ping())  # it has taken the subscriptions
                show(later)
    return {channel["topic"]: channel for channel in channels.values()}, messages


def test_a_viewer_that_connects_sees_the_platoon():
    with foxglove_server(0) as (port, show):
        channels, messages = asyncio.run(received(port, show))
    for name, (type_name, field, expected) in EXPECTED.items():
        channel = channels[f"/platoon/vehicle_1/{name}"]
        assert channel["encoding"] == "cdr"
        assert channel["schemaName"] == f"geometry_msgs/msg/{type_name}"
        assert channel["schemaEncoding"] == "ros2msg"
        assert "MSG: std_msgs/Header" in channel["schema"]
        time, data = messages[f"/platoon/vehicle_1/{name}"]
        assert (time, value(type_name, field, data)) == (3_000_000_000, (3.0, expected))


def test_a_port_that_is_taken_is_one_line():
    with (
        foxglove_server(0) as (port, _),
        pytest.raises(UserError, match="cannot be used"),
        foxglove_server(port),
    ):
        pass

"""CDR bytes <-> values, checked against rclpy's serialisation and against rosbags."""

from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import AccelStamped, PoseStamped, TwistStamped, Vector3Stamped
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from cacc_platoon.bags.write import typestore
from msg_adapters.stamped import (
    ACCEL,
    POSE,
    TWIST,
    VECTOR,
    LayoutError,
    StampedCodec,
)
from msg_adapters.text import encode_string

KINDS = [POSE, TWIST, ACCEL, VECTOR]
CLASSES = {
    kind.type_name: cls
    for kind, cls in zip(
        KINDS, (PoseStamped, TwistStamped, AccelStamped, Vector3Stamped), strict=True
    )
}
frames = st.text("abcdefghijklmnopqrstuvwxyz_0123456789/", min_size=1, max_size=40)
stamps = st.integers(0, (2**31 - 1) * 10**9 + 999_999_999)
numbers = st.floats(allow_nan=False)
kinds = st.sampled_from(KINDS)


def leading_vector(message):
    """Return the vector of a ROS message that carries the value along the road."""
    match message:
        case PoseStamped():
            return message.pose.position
        case TwistStamped():
            return message.twist.linear
        case AccelStamped():
            return message.accel.linear
    return message.vector


@given(kind=kinds, frame=frames, stamp=stamps, x=numbers, y=numbers)
def test_ros_reads_what_is_encoded(kind, frame, stamp, x, y):
    data = StampedCodec(kind, frame).encode(stamp, x, y)
    message = deserialize_message(data, CLASSES[kind.type_name])
    header, vector = message.header, leading_vector(message)
    assert header.stamp.sec * 10**9 + header.stamp.nanosec == stamp
    assert header.frame_id == frame
    assert (vector.x, vector.y, vector.z) == (x, y, 0.0)
    if kind is POSE:
        rotation = message.pose.orientation
        assert (rotation.x, rotation.y, rotation.z, rotation.w) == (0.0, 0.0, 0.0, 1.0)
    if kind in (TWIST, ACCEL):
        part = message.twist if kind is TWIST else message.accel
        assert (part.angular.x, part.angular.y, part.angular.z) == (0.0, 0.0, 0.0)


@given(kind=kinds, frame=frames, stamp=stamps, x=numbers)
def test_ros_writes_what_is_encoded_but_for_its_padding(kind, frame, stamp, x):
    message = CLASSES[kind.type_name]()
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    leading_vector(message).x = x
    codec = StampedCodec(kind, frame)
    serialised = bytes(serialize_message(message))
    assert len(serialised) == codec.size
    assert codec.zero_padding(serialised) == codec.encode(stamp, x)
    assert codec.decode(serialised) == (stamp, x)


@given(kind=kinds, frame=frames, stamp=stamps, x=numbers, y=numbers)
def test_rosbags_writes_the_same_bytes(kind, frame, stamp, x, y):
    store = typestore()
    data = StampedCodec(kind, frame).encode(stamp, x, y)
    message: Any = store.deserialize_cdr(data, kind.type_name)
    assert message.header.frame_id == frame
    assert bytes(store.serialize_cdr(message, kind.type_name)) == data


@given(kind=kinds, frame=frames, stamp=stamps, x=numbers, y=numbers)
def test_what_is_encoded_decodes_to_the_same(kind, frame, stamp, x, y):
    codec = StampedCodec(kind, frame)
    data = codec.encode(stamp, x, y)
    assert codec.decode(data) == (stamp, x)
    assert codec.zero_padding(data) == data


@given(kind=kinds, frame=frames, rows=st.lists(st.tuples(stamps, numbers), max_size=10))
def test_many_messages_are_the_single_ones(kind, frame, rows):
    codec = StampedCodec(kind, frame)
    times = np.array([stamp for stamp, _ in rows], np.int64)
    values = np.array([x for _, x in rows])
    many = codec.encode_many(times, values)
    assert many.shape == (len(rows), codec.size)
    assert [row.tobytes() for row in many] == [codec.encode(*row) for row in rows]
    assert codec.stamps(many).tolist() == times.tolist()
    assert codec.values(many).tobytes() == values.tobytes()


@given(kind=kinds, frame=frames, garbage=st.integers(0, 255))
def test_padding_is_known_wherever_it_lies(kind, frame, garbage):
    codec = StampedCodec(kind, frame)
    clean = codec.encode(1_234_567_890, 0.25)
    begin, end = 16 + len(frame) + 1, codec.size - 8 * kind.doubles
    dirty = clean[:begin] + bytes([garbage]) * (end - begin) + clean[end:]
    assert codec.zero_padding(dirty) == clean
    assert codec.decode(dirty) == (1_234_567_890, 0.25)


def test_the_sign_of_zero_and_the_last_bit_survive():
    codec = StampedCodec(ACCEL, "vehicle_1/base_link")
    for x in (-0.0, 5e-324, np.nextafter(1.0, 2.0), float("inf")):
        assert np.float64(codec.decode(codec.encode(0, x))[1]).tobytes() == np.float64(x).tobytes()
    assert np.isnan(codec.decode(codec.encode(0, float("nan")))[1])


@pytest.mark.parametrize("length", [0, 4, -1, 1])
def test_a_message_of_another_length_is_refused(length):
    codec = StampedCodec(TWIST, "map")
    data = codec.encode(0, 1.0)
    cut = data[:length] if length in (0, 4, -1) else data + b"\0"
    with pytest.raises(LayoutError, match=f"has {len(cut)} bytes where {codec.size} are due"):
        codec.decode(cut)


def test_the_scenario_travels_as_a_ros_string():
    text = "/**:\n  ros__parameters: {a: 'ü'}\n"
    message: Any = typestore().deserialize_cdr(encode_string(text), "std_msgs/msg/String")
    assert message.data == text

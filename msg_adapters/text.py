"""std_msgs/String as CDR bytes: the scenario and the messages of the protocol."""

from __future__ import annotations

import struct

HEADER = b"\x00\x01\x00\x00"
_LENGTH = struct.Struct("<I")


def encode_string(text: str) -> bytes:
    """Return the CDR bytes of a std_msgs/String.

    Examples
    --------
    >>> decode_string(encode_string("platoon"))
    'platoon'
    """
    data = text.encode() + b"\0"
    return HEADER + _LENGTH.pack(len(data)) + data


def decode_string(data: bytes) -> str:
    """Return the text of a std_msgs/String, what cannot be read replaced; empty if cut short."""
    if len(data) < len(HEADER) + _LENGTH.size:
        return ""
    (length,) = _LENGTH.unpack_from(data, len(HEADER))
    begin = len(HEADER) + _LENGTH.size
    return data[begin : begin + length].rstrip(b"\0").decode(errors="replace")

"""Frames of the control connection."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.lite6.protocol import MalformedFrameError, UxbusFrame, UxbusReader

pytestmark = pytest.mark.untimed

frames = st.builds(
    UxbusFrame,
    st.integers(0, 0xFFFF),
    st.sampled_from([2, 3]),
    st.integers(0, 255),
    st.binary(max_size=60),
)


def packed(frame: UxbusFrame) -> bytes:
    length = len(frame.payload) + 1
    header = struct.pack(">HHHB", frame.transaction, frame.protocol, length, frame.register)
    return header + frame.payload


@given(st.lists(frames, max_size=5), st.integers(1, 20))
def test_frames_survive_any_cutting_of_the_stream(sent: list[UxbusFrame], piece: int) -> None:
    stream = b"".join(packed(frame) for frame in sent)
    reader = UxbusReader()
    received = [
        frame
        for start in range(0, len(stream), piece)
        for frame in reader.feed(stream[start : start + piece])
    ]
    assert received == sent


def test_a_reply_repeats_the_header_and_counts_its_length() -> None:
    reply = UxbusFrame(7, 3, 13, b"").reply(b"\x00\x02")
    assert reply == struct.pack(">HHHBBB", 7, 3, 3, 13, 0, 2)


@pytest.mark.parametrize(
    "nonsense",
    [
        b"GET / HTTP/1.1\r\n",
        struct.pack(">HHHB", 1, 0, 1, 13),  # standard Modbus is not spoken
        struct.pack(">HHH", 1, 2, 0),
        struct.pack(">HHH", 1, 2, 60_000),
    ],
)
def test_nonsense_ends_the_stream(nonsense: bytes) -> None:
    with pytest.raises(MalformedFrameError):
        list(UxbusReader().feed(nonsense))


def test_the_sdk_s_heartbeat_is_recognised() -> None:
    (frame,) = UxbusReader().feed(bytes([0, 0, 0, 1, 0, 2, 0, 0]))
    assert frame.is_heartbeat
    assert not UxbusFrame(1, 3, 13, b"").is_heartbeat

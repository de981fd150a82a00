"""Records reach the bridge's process as they are."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from tams_app.ros2.wire import decode, encode
from tests.ros2.records import frame, full_header, one_of_each
from tests.synthetic_session import Synthetic, tick

pytestmark = pytest.mark.untimed


@pytest.mark.parametrize(
    "record",
    [full_header(), *one_of_each(), replace(tick(0), arm=None)],
    ids=lambda one: type(one).__name__,
)
def test_a_record_is_the_same_after_its_way(record: Any) -> None:
    content = encode(record)
    assert content is not None
    again = decode(memoryview(content))
    assert type(again) is type(record)
    assert encode(again) == content  # tests/test_codec.py: a record's JSON has all of it


def test_the_bytes_of_a_frame_travel_as_they_are() -> None:
    data = bytes(range(256)) * 100
    content = encode(frame(data=data))
    assert content is not None
    assert decode(content).data == data
    assert len(content) < len(data) + 500


def test_what_ros_is_not_told_of_is_not_sent() -> None:
    log = Synthetic(0.1).log()
    for record in (log.captured[0], log.shown[0], log.system[0]):
        assert encode(record) is None

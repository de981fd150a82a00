"""Logs that are whole, and not as TAMS writes them: one sentence each, and little memory."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk
from mcap.records import Header as FileHeader
from mcap.writer import MCAP0_MAGIC, Writer
from zstandard import ZstdCompressor

from tams_app.errors import UnreadableLogError
from tams_app.recording.mcap_stream import McapStream
from tams_app.recording.reader import read_log, read_records, read_video
from tams_app.recording.topics import PROFILE, TOPICS, Header
from tests.synthetic_session import header

pytestmark = pytest.mark.untimed
T_NS = 10**9
SENT = {"view": "eih", "index": 0, "capture_ns": 1, "encoded_ns": 1, "keyframe": True}
PACKET = ("kind", "sequence", "size_bytes", "entered_ns", "departed_ns", "delivered_ns", "fate")


def log(path: Path, *messages: tuple[str, bytes], **changes: Any) -> Path:
    """A log of a header with these changes, and of these messages by topic."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile=PROFILE)
        head = ("/header", TOPICS[Header].encode(header(**changes)))
        for topic, data in (head, *messages):
            channel = writer.register_channel(topic, "json", 0)
            writer.add_message(channel, T_NS, data, T_NS)
        writer.finish()
    return path


def sent_as(data: bytes) -> list[tuple[str, bytes]]:
    return [("/frames/sent", json.dumps(SENT | {"size_bytes": 1}).encode()), ("/video/eih", data)]


@pytest.mark.parametrize("data", [bytes([3 << 3, 5]), b"\x1a\xff"], ids=["number", "cut off"])
def test_a_video_message_of_another_form_is_one_sentence(tmp_path: Path, data: bytes) -> None:
    path = log(tmp_path / "a.mcap", *sent_as(data))
    for read in (lambda: list(read_records(path)), lambda: list(read_video(path, "eih"))):
        with pytest.raises(UnreadableLogError, match="/video/eih is not as TAMS"):
            read()


@pytest.mark.parametrize(
    ("topic", "data"),
    [
        ("/note", b"[" * 100_000),
        ("/facts", json.dumps({"t_ns": 1, "values": [1, 2]}).encode()),
        (
            "/packets",
            json.dumps(
                {"view": ["a"], "rtp_timestamp": [0], **{key: [0] for key in PACKET}, "kind": [99]}
            ).encode(),
        ),
    ],
)
def test_a_record_of_another_form_is_one_sentence(tmp_path: Path, topic: str, data: bytes) -> None:
    with pytest.raises(UnreadableLogError, match=f"{topic} is not as TAMS"):
        read_log(log(tmp_path / "a.mcap", (topic, data)))


@pytest.mark.parametrize(
    "change", [{"views": ()}, {"weights": {}}, {"fps": 0}, {"control_rate_hz": 0.0}], ids=str
)
def test_a_header_that_no_configuration_gives_is_one_sentence(
    tmp_path: Path, change: dict[str, Any]
) -> None:
    with pytest.raises(UnreadableLogError, match="/header is not as TAMS"):
        read_log(log(tmp_path / "a.mcap", **change))


@pytest.mark.parametrize("told", [100_000_000, 1000], ids=["told", "hidden"])
def test_a_chunk_that_would_take_a_hundred_times_ours_is_damage(tmp_path: Path, told: int) -> None:
    data = ZstdCompressor(level=1).compress(bytes(100_000_000))
    content = MCAP0_MAGIC
    for record in (
        FileHeader(profile=PROFILE, library=""),
        Chunk("zstd", data, 1, 0, 0, told),
    ):
        builder = RecordBuilder()
        record.write(builder)
        content += builder.end()
    (path := tmp_path / "a.mcap").write_bytes(content)
    stream = McapStream(path, PROFILE)
    assert list(stream) == []
    assert len(stream.gaps) == 1

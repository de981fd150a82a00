"""Small sessions with an arm that moves and frames that can be known again; and their datasets."""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import SeekingReader

from tams_app.config import load_config
from tams_app.recording import LOG_NAME, Header
from tams_app.recording.mcap_log import McapLog
from tams_app.records import Episode, Outcome, Phase, Pose, Tick, Twist
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.calibration.weights_session import VIDEO, encoded, image_of, seen
from tests.synthetic_session import FPS, START_NS, VIEWS, header, tick

SECONDS = 1.5
KEYFRAME_INTERVAL = 10
CHUNK_S = 0.25
GRIPPER_CLOSES, GRIPPER_OPENS = 61, 120  # at which tick
FIRST_CAPTURE_NS = {"eih": 3 * NS_PER_MS, "gt": 14 * NS_PER_MS, "gs": 25 * NS_PER_MS}
PLACED = Outcome(True, True, 1.25, 0, "placed")


def moving_tick(number: int) -> Tick:
    """The control loop's tick of that number: each of its figures is another one than before."""
    base = tick(number)
    sign = -1.0 if number % 3 else 1.0  # the same rotation, told in both ways
    half = number / 1000
    rotation = Rotation(sign * np.cos(half), 0.0, sign * np.sin(half), 0.0)
    tcp = Pose(np.array([0.3 + number / 1000, -number / 2000, 0.2]), rotation)
    closed = None if number < GRIPPER_CLOSES else number < GRIPPER_OPENS
    arm = replace(base.arm, joints=np.arange(6) / 10 + number / 100, tcp=tcp, gripper_closed=closed)
    return replace(
        base,
        arm=arm,
        twist=Twist((number / 500, 0.0, -number / 700), (0.0, number / 900, 0.0)),
        phase=Phase.GRASP if number >= GRIPPER_CLOSES else Phase.REACH,
        arming="engaged" if number >= 30 else "ready",
    )


def head(**changes: Any) -> Header:
    """The header of such a session."""
    config = load_config().model_copy(update={"video": VIDEO}).model_dump(mode="json")
    return header(**{"config": config, "name": "run"} | changes)


def write_session(
    folder: Path,
    ticks: Sequence[Tick] = (),
    seconds: float = SECONDS,
    header_of: Header | None = None,
    bitstream: bool = True,
    outcome: Outcome | None = PLACED,
    episodes: Sequence[Episode] = (),
) -> Path:
    """A session folder; its log has chunks of `CHUNK_S`, its cameras take turns."""
    folder.mkdir(parents=True)
    log = McapLog(folder / LOG_NAME, header_of or head(), bitstream)
    records: list[tuple[int, Any]] = [(one.started_ns, one) for one in ticks]
    records += [(one.t_ns, one) for one in episodes]
    for view, later_ns in FIRST_CAPTURE_NS.items():
        for frame in encoded(view, round(seconds * FPS), KEYFRAME_INTERVAL):
            shifted = replace(
                frame,
                capture_ns=frame.capture_ns + later_ns,
                encoded_ns=frame.encoded_ns + later_ns,
            )
            records.append((shifted.encoded_ns, shifted))
    chunk = 0
    for at_ns, record in sorted(records, key=lambda one: one[0]):
        if (at_ns - START_NS) // round(CHUNK_S * NS_PER_S) > chunk:
            chunk += 1
            log.flush()
        log.write(record, at_ns)
    if outcome is not None:
        log.write(outcome, START_NS + round(seconds * NS_PER_S))
    log.close()
    return folder


def moving_session(folder: Path, seconds: float = SECONDS, **others: Any) -> Path:
    """A session folder of the velocity servo."""
    ticks = [moving_tick(number) for number in range(round(seconds * 120))]
    return write_session(folder, ticks, seconds, **others)


def capture_ns(view: str, index: int) -> int:
    """When such a session's camera took a frame."""
    return START_NS + FIRST_CAPTURE_NS[view] + index * NS_PER_S // FPS


TICKS = [moving_tick(number) for number in range(4 * 120)]
CAPTURES_NS = {view: [capture_ns(view, index) for index in range(64)] for view in VIEWS}


class Dataset:
    """An exported dataset in the folder `root`, as its files are."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.info: dict[str, Any] = json.loads((root / "meta/info.json").read_text())
        self.rows = self._table(self.info["data_path"])
        self.episodes = self._table(
            "meta/episodes/chunk-{chunk_index:03}/file-{file_index:03}.parquet"
        )

    def video(self, view: str, episode: dict[str, Any]) -> Path:
        key = f"observation.images.{view}"
        numbers = {name: episode[f"videos/{key}/{name}"] for name in ("chunk_index", "file_index")}
        return self.root / self.info["video_path"].format(video_key=key, **numbers)

    def instants_ns(self, episode: dict[str, Any]) -> list[int]:
        """Of its rows, in the session's time."""
        start_ns = episode["started_wall_ns"] - head().wall_offset_ns
        return [start_ns + k * NS_PER_S // FPS for k in range(episode["length"])]

    def check(self) -> None:
        """Each row has the newest tick, and of each view the newest frame, of its instant."""
        assert len(self.rows) == self.info["total_frames"]
        for episode in self.episodes:
            instants = self.instants_ns(episode)
            first, end = episode["dataset_from_index"], episode["dataset_to_index"]
            for row, instant_ns in zip(self.rows[first:end], instants, strict=True):
                tick = TICKS[bisect_right(TICKS, instant_ns, key=lambda one: one.started_ns) - 1]
                rotation = np.array(tick.arm.tcp.rotation)
                state, action = row["observation.state"], row["action"]
                assert state[:9] == pytest.approx([*tick.arm.joints, *tick.arm.tcp.position])
                assert abs(np.dot(state[9:13], rotation)) == pytest.approx(1)
                assert state[13] == float(bool(tick.arm.gripper_closed))
                assert action[:6] == pytest.approx([*tick.twist.linear, *tick.twist.angular])
                assert row["phase"] == tick.phase.value
                assert row["engaged"] == (tick.arming == "engaged")
            for view in VIEWS:
                video = cv2.VideoCapture(str(self.video(view, episode)))
                assert video.get(cv2.CAP_PROP_FPS) == FPS
                for k, instant_ns in enumerate(instants):
                    image = video.read()[1]
                    assert video.get(cv2.CAP_PROP_POS_MSEC) == pytest.approx(k * 1000 / FPS)
                    wanted = bisect_right(CAPTURES_NS[view], instant_ns) - 1
                    assert seen(image) == (view, wanted)
                    assert cv2.PSNR(image, image_of(view, wanted)) > 30
                assert not video.read()[0]

    def _table(self, template: str) -> list[dict[str, Any]]:
        path = self.root / template.format(chunk_index=0, file_index=0)
        return pq.read_table(path).to_pylist()


def damaged(session: Path, at_s: float) -> Path:
    """Changes a byte of the chunk in which that second is."""
    path = session / LOG_NAME
    wall_ns = START_NS + head().wall_offset_ns + round(at_s * NS_PER_S)
    with path.open("rb") as file:
        summary = SeekingReader(file).get_summary()
    chunk = next(
        one
        for one in summary.chunk_indexes
        if one.message_start_time <= wall_ns <= one.message_end_time
    )
    data = bytearray(path.read_bytes())
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 4
    path.write_bytes(data)
    return session

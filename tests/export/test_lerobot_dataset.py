"""The dataset that sessions are exported as is the one that LeRobot documents."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tams_app.cli import _main
from tams_app.export.lerobot.samples import STATE_NAMES
from tams_app.recording import read_video
from tams_app.records import Tick
from tams_app.units import NS_PER_S
from tests.calibration.weights_session import HEIGHT, WIDTH, image_of, seen
from tests.export.sessions import (
    GRIPPER_CLOSES,
    START_OF_GRID_NS,
    moving_session,
    moving_tick,
    shown_at,
)
from tests.synthetic_session import FPS, VIEWS

pytestmark = pytest.mark.untimed

LENGTHS = (1.5, 1.0)  # of the sessions [s]
TASK = "Put the block where it belongs."
KEYS = {view: f"observation.images.{view}" for view in VIEWS}
STATISTICS = {"min", "max", "mean", "std", "count", "q01", "q10", "q50", "q90", "q99"}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two sessions, exported by the command."""
    folder = tmp_path_factory.mktemp("sessions")
    sessions = [
        str(moving_session(folder / f"session-{number}", seconds))
        for number, seconds in enumerate(LENGTHS)
    ]
    out = folder / "dataset"
    given = [*sessions, "--format", "lerobot", "--out", str(out), "--task", TASK]
    assert _main(["export", *given]) == 0
    return out


def test_a_video_is_no_larger_than_one_and_a_fifth_of_the_logs(
    dataset: Path, rows: list[dict[str, Any]]
) -> None:
    index_bytes = 1500 + 16 * len(rows)  # of an MP4 file, which is most of one so small
    for view, key in KEYS.items():
        logged = sum(
            len(frame.data)
            for path in dataset.parent.glob("session-*/session.mcap")
            for frame in read_video(path, view)
        )
        written = sum(path.stat().st_size for path in (dataset / "videos" / key).rglob("*.mp4"))
        assert 0 < written - index_bytes <= 1.2 * logged


@pytest.fixture(scope="module")
def info(dataset: Path) -> dict[str, Any]:
    return json.loads((dataset / "meta/info.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def rows(dataset: Path) -> list[dict[str, Any]]:
    return pq.read_table(dataset / "data/chunk-000/file-000.parquet").to_pylist()


@pytest.fixture(scope="module")
def episodes(dataset: Path) -> list[dict[str, Any]]:
    return pq.read_table(dataset / "meta/episodes/chunk-000/file-000.parquet").to_pylist()


def instant_ns(row: dict[str, Any]) -> int:
    return START_OF_GRID_NS + row["frame_index"] * NS_PER_S // FPS


def tick_at(row: dict[str, Any]) -> Tick:
    """The newest tick that had begun."""
    ticks = (moving_tick(number) for number in range(200))
    return max(
        (one for one in ticks if one.started_ns <= instant_ns(row)), key=lambda one: one.started_ns
    )


def test_the_files_are_where_the_layout_has_them(dataset: Path) -> None:
    found = {str(path.relative_to(dataset)) for path in dataset.rglob("*") if path.is_file()}
    assert found == {
        "meta/info.json",
        "meta/stats.json",
        "meta/tasks.parquet",
        "meta/subtasks.parquet",
        "meta/episodes/chunk-000/file-000.parquet",
        "data/chunk-000/file-000.parquet",
        *(f"videos/{key}/chunk-000/file-000.mp4" for key in KEYS.values()),
    }


def test_info_tells_version_counts_and_where_files_are(
    dataset: Path, info: dict[str, Any], rows: list[dict[str, Any]]
) -> None:
    assert info["codebase_version"] == "v3.0"
    assert info["robot_type"] == "lite6"
    assert (info["fps"], info["total_episodes"], info["total_tasks"]) == (FPS, 2, 1)
    assert info["total_frames"] == len(rows)
    assert info["splits"] == {"train": "0:2"}
    number = {"chunk_index": 0, "file_index": 0}
    assert (dataset / info["data_path"].format(**number)).is_file()
    for key in KEYS.values():
        assert (dataset / info["video_path"].format(video_key=key, **number)).is_file()


def test_every_feature_has_the_type_and_shape_that_info_tells(
    dataset: Path, info: dict[str, Any]
) -> None:
    features = info["features"]
    for key in KEYS.values():
        video = features.pop(key)
        assert (video["dtype"], video["shape"]) == ("video", [HEIGHT, WIDTH, 3])
        assert video["info"]["video.codec"] == "h264"
    schema = pq.read_schema(dataset / "data/chunk-000/file-000.parquet")
    assert schema.names == list(features)
    kinds = {
        "float32": pa.float32(),
        "int64": pa.int64(),
        "bool": pa.bool_(),
        "string": pa.string(),
    }
    for name, feature in features.items():
        kind, (size,) = kinds[feature["dtype"]], feature["shape"]
        assert schema.field(name).type == (kind if size == 1 else pa.list_(kind, size)), name
        assert feature["names"] is None or len(feature["names"]) == size
    standard = ("timestamp", "frame_index", "episode_index", "index", "task_index")
    assert [features[name]["dtype"] for name in standard] == ["float32"] + ["int64"] * 4


def test_indices_count_on_and_timestamps_are_those_of_the_frame_rate(
    rows: list[dict[str, Any]], episodes: list[dict[str, Any]]
) -> None:
    assert [row["index"] for row in rows] == list(range(len(rows)))
    assert [one["episode_index"] for one in episodes] == [0, 1]
    for episode, seconds in zip(episodes, LENGTHS, strict=True):
        first, end = episode["dataset_from_index"], episode["dataset_to_index"]
        assert end - first == episode["length"]
        assert seconds * FPS - 2 <= episode["length"] <= seconds * FPS
        own = rows[first:end]
        assert {row["episode_index"] for row in own} == {episode["episode_index"]}
        assert [row["frame_index"] for row in own] == list(range(len(own)))
        for row in own:
            assert row["timestamp"] == np.float32(row["frame_index"] / FPS)
    assert episodes[0]["dataset_from_index"] == 0
    assert episodes[1]["dataset_from_index"] == episodes[0]["dataset_to_index"]
    assert episodes[1]["dataset_to_index"] == len(rows)


def test_an_episode_tells_its_session_its_task_and_its_verdict(
    dataset: Path, episodes: list[dict[str, Any]], rows: list[dict[str, Any]]
) -> None:
    assert [one["session"] for one in episodes] == ["session-0", "session-1"]
    for episode in episodes:
        assert episode["tasks"] == [TASK]
        assert (episode["success"], episode["completed"], episode["drops"]) == (True, True, 0)
        assert (episode["completion_time_s"], episode["outcome"]) == (1.25, "placed")
    tasks = pq.read_table(dataset / "meta/tasks.parquet").to_pandas()
    assert tasks.iloc[0].name == TASK
    assert list(tasks["task_index"]) == [0]
    assert {row["task_index"] for row in rows} == {0}


def test_states_and_actions_are_those_of_the_newest_tick(rows: list[dict[str, Any]]) -> None:
    for row in rows:
        tick = tick_at(row)
        assert tick.arm is not None
        state, action = row["observation.state"], row["action"]
        rotation = np.array(tick.arm.tcp.rotation)
        assert state[:6] == pytest.approx(tick.arm.joints)
        assert state[6:9] == pytest.approx(tick.arm.tcp.position)
        assert abs(np.dot(state[9:13], rotation)) == pytest.approx(1)
        assert state[13] == float(bool(tick.arm.gripper_closed))
        assert action[:6] == pytest.approx([*tick.twist.linear, *tick.twist.angular])
        assert row["engaged"] == (tick.arming == "engaged")


def test_a_quaternion_never_jumps_to_its_negative(rows: list[dict[str, Any]]) -> None:
    for before, after in pairwise(rows):
        if after["frame_index"]:
            one, other = (row["observation.state"][9:13] for row in (before, after))
            assert np.dot(one, other) > 0.9


def test_the_gripper_of_an_action_is_the_state_that_it_leads_to(
    rows: list[dict[str, Any]],
) -> None:
    for before, after in pairwise(rows):
        if after["frame_index"]:
            assert before["action"][-1] == after["observation.state"][-1]
    closing = next(row for row in rows if row["action"][-1] == 1)
    assert closing["observation.state"][-1] == 0
    assert instant_ns(closing) < moving_tick(GRIPPER_CLOSES).started_ns


def test_phases_are_subtasks_by_name_and_number(dataset: Path, rows: list[dict[str, Any]]) -> None:
    subtasks = pq.read_table(dataset / "meta/subtasks.parquet").to_pandas()
    assert len(subtasks) == 6
    for row in rows:
        assert row["phase"] == tick_at(row).phase.value
        assert subtasks.iloc[row["subtask_index"]].name == row["phase"]
    assert {row["phase"] for row in rows} == {"REACH", "GRASP"}


@pytest.mark.parametrize("view", VIEWS)
def test_frame_k_of_a_video_is_the_newest_frame_of_the_log_at_row_k(
    dataset: Path, view: str, rows: list[dict[str, Any]], episodes: list[dict[str, Any]]
) -> None:
    key = KEYS[view]
    video = cv2.VideoCapture(str(dataset / f"videos/{key}/chunk-000/file-000.mp4"))
    assert video.get(cv2.CAP_PROP_FPS) == FPS
    first = 0
    for episode in episodes:
        assert episode[f"videos/{key}/from_timestamp"] == pytest.approx(first / FPS, abs=1e-9)
        for k in range(episode["length"]):
            found, image = video.read()
            assert found
            assert video.get(cv2.CAP_PROP_POS_MSEC) == pytest.approx((first + k) * 1000 / FPS)
            wanted = shown_at(view, instant_ns(rows[episode["dataset_from_index"] + k]))
            assert seen(image) == (view, wanted)
            assert cv2.PSNR(image, image_of(view, wanted)) > 30
        first += episode["length"]
        assert episode[f"videos/{key}/to_timestamp"] == pytest.approx(first / FPS, abs=1e-9)
    assert not video.read()[0]


@pytest.mark.parametrize("view", VIEWS)
def test_frames_of_a_video_are_found_in_any_order(
    dataset: Path, view: str, rows: list[dict[str, Any]]
) -> None:
    video = cv2.VideoCapture(str(dataset / f"videos/{KEYS[view]}/chunk-000/file-000.mp4"))
    for row in np.random.default_rng(1).permutation(len(rows)):
        video.set(cv2.CAP_PROP_POS_FRAMES, int(row))
        assert seen(video.read()[1]) == (view, shown_at(view, instant_ns(rows[row])))


def test_there_are_statistics_of_each_feature_by_episode_and_of_all(
    dataset: Path, info: dict[str, Any], rows: list[dict[str, Any]], episodes: list[dict[str, Any]]
) -> None:
    told = json.loads((dataset / "meta/stats.json").read_text(encoding="utf-8"))
    numeric = {name for name in info["features"] if name != "phase"} | set(KEYS.values())
    assert set(told) == numeric
    states = np.array([row["observation.state"] for row in rows])
    for name in STATE_NAMES[:6]:
        place = STATE_NAMES.index(name)
        assert told["observation.state"]["mean"][place] == pytest.approx(states[:, place].mean())
        assert told["observation.state"]["std"][place] == pytest.approx(states[:, place].std())
    for feature, found in told.items():
        assert set(found) == STATISTICS
        shape = (3, 1, 1) if feature in KEYS.values() else np.shape(found["min"])
        for name, value in found.items():
            assert np.shape(value) == ((1,) if name == "count" else shape)
        for episode in episodes:
            assert {
                name.removeprefix(f"stats/{feature}/")
                for name in episode
                if name.startswith(f"stats/{feature}/")
            } == STATISTICS

"""The dataset that sessions are exported as is the one that LeRobot documents."""

from __future__ import annotations

import json
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tams_app.cli import _main
from tams_app.export.lerobot import dataset as writing
from tams_app.export.lerobot import video
from tams_app.export.lerobot.statistics import PixelStatistics
from tams_app.recording import read_video
from tams_app.video.core.codecs import bgr_of, i420_of
from tests.calibration.weights_session import HEIGHT, WIDTH, seen
from tests.export.conftest import Export
from tests.export.sessions import CAPTURES_NS, GRIPPER_CLOSES, TICKS, Dataset, moving_session
from tests.synthetic_session import FPS, VIEWS

pytestmark = pytest.mark.untimed

LENGTHS = (1.5, 1.0)  # of the sessions [s]
TASK = "Put the block where it belongs."
KEYS = {view: f"observation.images.{view}" for view in VIEWS}
DOCTOR = Path(__file__).parents[2] / "build/lerobot-doctor"  # is installed there, apart
STATISTICS = {"min", "max", "mean", "std", "count", "q01", "q10", "q50", "q90", "q99"}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Two sessions, exported by the command."""
    folder = tmp_path_factory.mktemp("sessions")
    sessions = [
        moving_session(folder / f"session-{number}", seconds)
        for number, seconds in enumerate(LENGTHS)
    ]
    logs = [(session / "session.mcap").read_bytes() for session in sessions]
    given = [*map(str, sessions), "--format", "lerobot", "--out", f"{folder}/out", "--task", TASK]
    assert _main(["export", *given]) == 0
    assert [(session / "session.mcap").read_bytes() for session in sessions] == logs
    return Dataset(folder / "out")


def test_each_row_has_the_newest_tick_and_frames_of_its_instant(dataset: Dataset) -> None:
    dataset.check()
    assert {row["phase"] for row in dataset.rows} == {"REACH", "GRASP"}
    first_ns = max(captured[0] for captured in CAPTURES_NS.values())
    assert [dataset.instants_ns(one)[0] for one in dataset.episodes] == [first_ns] * 2


@pytest.mark.parametrize("view", VIEWS)
def test_frames_of_a_video_are_found_in_any_order(dataset: Dataset, view: str) -> None:
    file = cv2.VideoCapture(str(dataset.video(view, dataset.episodes[0])))
    in_order = [seen(file.read()[1]) for _ in range(dataset.episodes[0]["length"])]
    for k in np.random.default_rng(1).permutation(len(in_order)):
        file.set(cv2.CAP_PROP_POS_FRAMES, int(k))
        assert seen(file.read()[1]) == in_order[k]


def test_a_video_is_no_larger_than_one_and_a_fifth_of_the_logs(dataset: Dataset) -> None:
    logs = [dataset.root.parent / f"{one['session']}/session.mcap" for one in dataset.episodes]
    for view in VIEWS:
        logged = sum(len(frame.data) for path in logs for frame in read_video(path, view))
        files = [dataset.video(view, one).stat().st_size for one in dataset.episodes]
        # of an MP4 file the index, which is most of one so small
        assert 0 < sum(files) - 1500 * len(files) - 16 * len(dataset.rows) <= 1.2 * logged


@pytest.mark.parametrize("log_bytes", [200_000, 50_000])
def test_what_is_hard_to_encode_is_held_to_the_logs_rate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, log_bytes: int
) -> None:
    noise = np.random.default_rng(1).integers(64, 192, (60, 160 * 120 * 3 // 2), np.uint8)
    monkeypatch.setattr(video, "_frames_on_grid", lambda *_: (frame for frame in noise))
    shape = SimpleNamespace(fps=FPS, width=160, height=120)
    episode: Any = SimpleNamespace(rows=60, shape=shape, sizes_bytes={"gt": log_bytes})
    frames = list(video.write_video(tmp_path / "noise.mp4", episode, "gt"))
    assert len(frames) == episode.rows
    assert 0.5 * log_bytes < (tmp_path / "noise.mp4").stat().st_size <= 1.2 * log_bytes


def test_the_files_are_where_the_layout_has_them(dataset: Dataset) -> None:
    files = (path for path in dataset.root.rglob("*") if path.is_file())
    assert {str(path.relative_to(dataset.root)) for path in files} == {
        "meta/info.json",
        "meta/stats.json",
        "meta/tasks.parquet",
        "meta/subtasks.parquet",
        "meta/episodes/chunk-000/file-000.parquet",
        "data/chunk-000/file-000.parquet",
        *(f"videos/{key}/chunk-000/file-00{n}.mp4" for key in KEYS.values() for n in (0, 1)),
    }
    info = dataset.info
    assert (info["codebase_version"], info["robot_type"]) == ("v3.0", "lite6")
    assert (info["fps"], info["total_episodes"], info["total_tasks"]) == (FPS, 2, 1)
    assert info["splits"] == {"train": "0:2"}


def test_a_chunk_is_followed_by_the_next_and_no_file_is_above_the_declared_size(
    tmp_path: Path, export: Export, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in (("MB", 1000), ("DATA_FILE_MB", 1), ("VIDEO_FILE_MB", 1)):
        monkeypatch.setattr(writing, name, value)
    monkeypatch.setattr(writing, "FILES_PER_CHUNK", 1)
    sessions = [moving_session(tmp_path / name, 0.3) for name in ("one", "two")]
    assert export(*sessions, "--out", tmp_path / "out")[0] == 0
    dataset = Dataset(tmp_path / "out")
    dataset.check()
    videos = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*.mp4")}
    assert {path.split("/", 3)[3] for path in videos} == {
        "chunk-000/file-000.mp4",
        "chunk-001/file-000.mp4",
    }
    for kind, folder in (("data", "data"), ("video", "videos")):
        largest = max(path.stat().st_size for path in dataset.root.glob(f"{folder}/**/file-*"))
        assert 1000 < largest <= 1000 * dataset.info[f"{kind}_files_size_in_mb"]


def test_every_feature_has_the_type_and_shape_that_info_tells(dataset: Dataset) -> None:
    features = dict(dataset.info["features"])
    for key in KEYS.values():
        feature = features.pop(key)
        assert (feature["dtype"], feature["shape"]) == ("video", [HEIGHT, WIDTH, 3])
        assert feature["info"]["video.codec"] == "h264"
    schema = pq.read_schema(dataset.root / "data/chunk-000/file-000.parquet")
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


def test_indices_count_on_and_timestamps_are_those_of_the_frame_rate(dataset: Dataset) -> None:
    assert [row["index"] for row in dataset.rows] == list(range(len(dataset.rows)))
    assert [one["episode_index"] for one in dataset.episodes] == [0, 1]
    first = 0
    for episode, seconds in zip(dataset.episodes, LENGTHS, strict=True):
        length = episode["length"]
        assert seconds * FPS - 2 <= length <= seconds * FPS
        assert (episode["dataset_from_index"], episode["dataset_to_index"]) == (
            first,
            first + length,
        )
        for k, row in enumerate(dataset.rows[first : first + length]):
            assert (row["episode_index"], row["frame_index"]) == (episode["episode_index"], k)
            assert row["timestamp"] == np.float32(k / FPS)
        for key in KEYS.values():
            assert episode[f"videos/{key}/from_timestamp"] == 0
            assert episode[f"videos/{key}/to_timestamp"] == pytest.approx(length / FPS)
        first += length


def test_an_episode_tells_its_session_its_task_and_its_verdict(dataset: Dataset) -> None:
    assert [one["session"] for one in dataset.episodes] == ["session-0", "session-1"]
    for episode in dataset.episodes:
        assert episode["tasks"] == [TASK]
        assert (episode["success"], episode["completed"], episode["drops"]) == (True, True, 0)
        assert (episode["completion_time_s"], episode["outcome"]) == (1.25, "placed")
    tasks, subtasks = (
        pd.read_parquet(dataset.root / f"meta/{name}.parquet") for name in ("tasks", "subtasks")
    )
    assert tasks.to_dict() == {"task_index": {TASK: 0}}
    assert (tasks.index.name, subtasks.index.name, len(subtasks)) == ("task", "subtask", 6)
    for row in dataset.rows:
        assert row["task_index"] == 0
        assert subtasks.iloc[row["subtask_index"]].name == row["phase"]


def test_a_quaternion_never_jumps_and_a_gripper_s_action_is_the_state_that_it_leads_to(
    dataset: Dataset,
) -> None:
    for before, after in pairwise(dataset.rows):
        if after["frame_index"]:
            one, other = (row["observation.state"][9:13] for row in (before, after))
            assert np.dot(one, other) > 0.9
            assert before["action"][-1] == after["observation.state"][-1]
    closing = next(row for row in dataset.rows if row["action"][-1] == 1)
    assert closing["observation.state"][-1] == 0
    instants = dataset.instants_ns(dataset.episodes[0])
    assert instants[closing["frame_index"]] < TICKS[GRIPPER_CLOSES].started_ns


def test_there_are_statistics_of_each_feature_by_episode_and_of_all_rows(dataset: Dataset) -> None:
    told = json.loads((dataset.root / "meta/stats.json").read_text(encoding="utf-8"))
    assert set(told) == {name for name in dataset.info["features"] if name != "phase"}
    for feature, found in told.items():
        assert set(found) == STATISTICS
        for episode in dataset.episodes:
            names = {name for name in episode if name.startswith(f"stats/{feature}/")}
            assert {name.rpartition("/")[2] for name in names} == STATISTICS
        if feature in KEYS.values():
            assert all(np.shape(of) == (3, 1, 1) for name, of in found.items() if name != "count")
            assert found["count"] == [len(dataset.rows)]
            continue
        values = np.array([row[feature] for row in dataset.rows], float).reshape(
            len(dataset.rows), -1
        )
        for name in ("min", "max", "mean", "std"):
            assert found[name] == pytest.approx(getattr(np, name)(values, axis=0))
        assert found["q10"] == pytest.approx(np.quantile(values, 0.1, axis=0))
        assert found["count"] == [len(values)]


def test_those_of_pixels_are_by_colour_and_from_0_to_1() -> None:
    random = np.random.default_rng(3)
    images = [
        np.full((48, 64, 3), random.integers(0, 255, 3), np.uint8) for _ in range(5)
    ]  # of one colour each, so that leaving pixels out changes nothing
    pixels, others = PixelStatistics(), PixelStatistics()
    for number, image in enumerate(images):
        (pixels if number < 3 else others).add(i420_of(image), 48, 64)
    pixels.include(others)
    found = {name: np.array(value) for name, value in pixels.result().items()}
    coded = np.stack([bgr_of(i420_of(image), 48, 64) for image in images])
    wanted = coded.reshape(-1, 3)[:, ::-1] / 255  # red first
    for name in ("mean", "std", "min", "max"):
        assert found[name].ravel() == pytest.approx(getattr(np, name)(wanted, axis=0))
    assert found["q50"].ravel() == pytest.approx(np.median(wanted, axis=0))
    assert found["count"].tolist() == [5]


@pytest.mark.verify
@pytest.mark.timeout(1200)
def test_lerobot_doctor_finds_no_fault_of_the_format(tmp_path: Path, export: Export) -> None:
    subprocess.run([sys.executable, "-m", "venv", DOCTOR], check=True)
    install = [DOCTOR / "bin/pip", "install", "--quiet", "lerobot-doctor==0.2.*"]
    subprocess.run(install, check=True)  # without a network this fails: nothing was judged
    sessions = [moving_session(tmp_path / name, 3.0) for name in ("one", "two")]
    assert export(*sessions, "--out", tmp_path / "out")[0] == 0
    doctor = [DOCTOR / "bin/lerobot-doctor", tmp_path / "out", "--json"]
    judged = subprocess.run(doctor, check=False, capture_output=True, text=True)
    verdicts = {one["name"]: one["severity"] for one in json.loads(judged.stdout)["checks"]}
    assert "FAIL" not in verdicts.values(), judged.stdout

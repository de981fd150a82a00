"""What cannot be exported is said in a sentence, and leaves no folder behind."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest

from tams_app.cli import _main
from tams_app.errors import UnreadableLogError
from tams_app.export.lerobot import files, layout
from tams_app.export.lerobot.layout import FileNumber
from tams_app.export.lerobot.mp4 import BUFFER_S, Mp4Writer
from tams_app.recording.mcap_stream import McapStream
from tams_app.recording.topics import PROFILE
from tams_app.records import Tick
from tams_app.units import NS_PER_S
from tests.calibration.weights_session import seen
from tests.export.sessions import (
    PLACED,
    damage,
    head,
    moving_session,
    moving_tick,
    shown_at,
    write_session,
)
from tests.file_size_limit import file_size_limit
from tests.synthetic_session import FPS, START_NS, VIEWS

pytestmark = pytest.mark.untimed

Export = Callable[..., tuple[int, str, str]]


@pytest.fixture
def export(capsys: pytest.CaptureFixture[str]) -> Export:
    """Exit code, output and errors of the command."""

    def run(*arguments: object) -> tuple[int, str, str]:
        code = _main(["export", *map(str, arguments), "--format", "lerobot"])
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    return run


def rows_of(dataset: Path) -> list[dict[str, Any]]:
    return pq.read_table(dataset / "data/chunk-000/file-000.parquet").to_pylist()


def episodes_of(dataset: Path) -> list[dict[str, Any]]:
    return pq.read_table(dataset / "meta/episodes/chunk-000/file-000.parquet").to_pylist()


def test_a_damaged_log_is_refused_in_a_sentence_or_its_longest_whole_part_is_exported(
    tmp_path: Path, export: Export
) -> None:
    session = moving_session(tmp_path / "session")
    damage(session, 0.4)  # of chunks of a quarter of a second
    code, _, error = export(session)
    assert (code, len(error.splitlines())) == (2, 1)
    assert "The log is damaged: what was recorded at 0.3 to 0.5 s is missing." in error
    assert not (session / "lerobot").exists()
    code, out, _ = export(session, "--with-damaged")
    assert code == 0
    assert "session: The log is damaged: what was recorded at 0.3 to 0.5 s is missing." in out
    (episode,) = episodes_of(session / "lerobot")
    start_ns = episode["started_wall_ns"] - head().wall_offset_ns
    assert 0.5 < (start_ns - START_NS) / NS_PER_S < 1.1  # behind the gap, at keyframes
    assert 0.4 * FPS < episode["length"] < 0.95 * FPS
    for row in rows_of(session / "lerobot"):
        instant_ns = start_ns + row["frame_index"] * NS_PER_S // FPS
        number = max(n for n in range(200) if moving_tick(n).started_ns <= instant_ns)
        assert row["observation.state"][6] == pytest.approx(0.3 + number / 1000)
    for view in VIEWS:
        path = session / f"lerobot/videos/observation.images.{view}/chunk-000/file-000.mp4"
        video = cv2.VideoCapture(str(path))
        for k in range(episode["length"]):
            instant_ns = start_ns + k * NS_PER_S // FPS
            assert seen(video.read()[1]) == (view, shown_at(view, instant_ns))


def test_a_log_that_was_cut_off_is_refused_in_a_sentence_or_its_beginning_is_exported(
    tmp_path: Path, export: Export
) -> None:
    session = moving_session(tmp_path / "session")
    path = session / "session.mcap"
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    code, _, error = export(session)
    assert (code, len(error.splitlines())) == (2, 1)
    assert "The log ends early, at " in error
    code, out, _ = export(session, "--with-damaged")
    assert code == 0
    assert "session: The log ends early, at " in out
    (episode,) = episodes_of(session / "lerobot")
    assert episode["log_complete"] is False
    assert episode["tasks"] == ["Pick up the block and place it in the container."]
    assert 0 < episode["length"] < 1.3 * FPS
    assert episode["success"] is None
    assert episode["outcome"] == ""


def test_what_is_there_already_is_never_written_over(tmp_path: Path, export: Export) -> None:
    session = moving_session(tmp_path / "session", 0.3)
    (session / "lerobot").mkdir()
    (session / "lerobot/mine").write_text("keep", encoding="utf-8")
    code, _, error = export(session)
    assert code == 2
    assert error == f"tams: {session}/lerobot: is there already: give another name\n"
    assert [path.name for path in (session / "lerobot").iterdir()] == ["mine"]


def other_views() -> dict[str, Any]:
    return {"header_of": head(views=("eih", "gt"))}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (lambda: {"header_of": head(fps=25)}, "at 25 frames a second"),
        (other_views, "has eih, gt with 160x120"),
        (
            lambda: {"header_of": head(config={**head().config, "arm": {"model": "other"}})},
            "is of another arm",
        ),
    ],
)
def test_sessions_of_unlike_shape_are_refused_in_a_sentence(
    tmp_path: Path, export: Export, changes: Callable[[], dict[str, Any]], said: str
) -> None:
    first = moving_session(tmp_path / "first", 0.3)
    ticks = [moving_tick(number) for number in range(36)]
    second = write_session(tmp_path / "second", ticks, 0.3, **changes())
    code, _, error = export(first, second, "--out", tmp_path / "out")
    assert code == 2
    assert said in error
    assert error.endswith("export them apart\n")
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_session_that_was_led_from_pose_to_pose_is_refused_in_a_sentence(
    tmp_path: Path, export: Export
) -> None:
    ticks = [moving_tick(number) for number in range(36)]
    session = write_session(tmp_path / "session", ticks, 0.3, head(servo="pose"))
    code, _, error = export(session)
    assert code == UnreadableLogError.exit_code
    assert "led from pose to pose" in error
    assert len(error.splitlines()) == 1


def test_a_log_without_arm_or_without_video_is_refused_in_a_sentence(
    tmp_path: Path, export: Export
) -> None:
    ticks = [moving_tick(number) for number in range(36)]
    unseen = write_session(tmp_path / "unseen", ticks, 0.3, bitstream=False)
    code, _, error = export(unseen)
    assert code == 2
    assert "holds no video of eih: record with recording.bitstream: true" in error
    operator = write_session(tmp_path / "operator", [], 0.3)
    code, _, error = export(operator)
    assert code == 2
    assert "of two computers give the robot's log" in error
    silent = [replace(one, arm=None) for one in ticks]
    code, _, error = export(write_session(tmp_path / "silent", silent, 0.3))
    assert (code, "tells nothing of an arm" in error) == (2, True)
    late = [replace(one, started_ns=one.started_ns + 9 * NS_PER_S) for one in ticks]
    code, _, error = export(write_session(tmp_path / "late", late, 0.3))
    assert (code, "has no moment with the arm and a picture" in error) == (2, True)


def test_frames_of_another_size_than_the_header_tells_are_refused(
    tmp_path: Path, export: Export
) -> None:
    config = head().config
    wide = head(config={**config, "video": {**config["video"], "width": 320}})
    ticks = [moving_tick(number) for number in range(36)]
    session = write_session(tmp_path / "session", ticks, 0.3, wide)
    code, _, error = export(session)
    assert code == 2
    assert "are not of 320x120 as its header says" in error
    assert not (session / "lerobot").exists()


def test_ticks_before_the_arm_reports_are_no_part_of_an_episode(
    tmp_path: Path, export: Export
) -> None:
    ticks = [moving_tick(number) for number in range(60)]
    ticks[:24] = [replace(one, arm=None) for one in ticks[:24]]
    session = write_session(tmp_path / "session", ticks, 0.5)
    assert export(session)[0] == 0
    (episode,) = episodes_of(session / "lerobot")
    assert episode["started_wall_ns"] == ticks[24].started_ns + head().wall_offset_ns


def test_wrong_use_is_a_sentence(tmp_path: Path, export: Export, capsys: Any) -> None:
    session = moving_session(tmp_path / "session", 0.3)
    code, _, error = export(session, session)
    assert (code, "--out: of several sessions say in which folder" in error) == (2, True)
    code, _, error = export(tmp_path / "nowhere")
    assert (code, "there is no such folder" in error) == (2, True)
    assert _main(["export", str(session), "--format", "papyrus"]) == 2
    assert "'papyrus' is not one of" in capsys.readouterr().err


def test_a_missing_package_is_named_with_what_installs_it(
    tmp_path: Path, export: Export, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = moving_session(tmp_path / "session", 0.3)
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(
        "tams_app.export.lerobot.convert.find_spec",
        lambda name: None if name == "pyarrow" else find_spec(name),
    )
    code, _, error = export(session)
    assert (code, error) == (1, "tams: pyarrow missing: pip install 'tams[study]'\n")
    assert not (session / "lerobot").exists()


@pytest.mark.parametrize("limit_bytes", [2_000, 20_000])
def test_a_full_disk_is_a_sentence_and_leaves_no_folder(
    tmp_path: Path, export: Export, limit_bytes: int
) -> None:
    session = moving_session(tmp_path / "session", 1.0)
    with file_size_limit(limit_bytes):
        code, _, error = export(session)
    assert code == 1
    assert "cannot be written" in error
    assert len(error.splitlines()) == 1
    assert not (session / "lerobot").exists()


def test_an_interrupted_export_leaves_no_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = moving_session(tmp_path / "session", 0.3)

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(files.PixelStatistics, "add", interrupt)
    with pytest.raises(KeyboardInterrupt):
        _main(["export", str(session), "--format", "lerobot"])
    assert not (session / "lerobot").exists()


def test_a_file_that_is_full_is_followed_by_the_next(
    tmp_path: Path, export: Export, monkeypatch: pytest.MonkeyPatch
) -> None:
    sessions = [moving_session(tmp_path / f"s{number}", 0.3) for number in range(2)]
    alone = tmp_path / "alone"
    assert export(sessions[0], "--out", alone)[0] == 0
    largest = max(path.stat().st_size for path in alone.rglob("*.mp4"))
    # the first fits in, and the second does not beside it
    monkeypatch.setattr(layout, "DATA_FILE_MB", 0)
    monkeypatch.setattr(layout, "VIDEO_FILE_MB", largest / layout.MB)
    out = tmp_path / "out"
    assert export(*sessions, "--out", out)[0] == 0
    first, second = episodes_of(out)
    for kind in ("data", *(f"videos/observation.images.{view}" for view in VIEWS)):
        assert (first[f"{kind}/file_index"], second[f"{kind}/file_index"]) == (0, 1)
    for view in VIEWS:
        key = f"observation.images.{view}"
        assert second[f"videos/{key}/from_timestamp"] == 0
        video = cv2.VideoCapture(str(out / f"videos/{key}/chunk-000/file-001.mp4"))
        assert video.get(cv2.CAP_PROP_FRAME_COUNT) == second["length"]
    rows = pq.read_table(out / "data/chunk-000/file-001.parquet").to_pylist()
    assert [row["index"] for row in rows] == list(
        range(second["dataset_from_index"], second["dataset_to_index"])
    )


def test_frames_are_held_to_their_rate_from_episode_to_episode(tmp_path: Path) -> None:
    path, seconds, noise = tmp_path / "noise.mp4", 2, np.random.default_rng(1)
    writer = Mp4Writer(path, 160, 120, FPS)
    sizes = []
    for kbps in (800, 200):
        writer.limit(kbps)
        writer.begin_episode()
        before = path.stat().st_size
        for _ in range(seconds * FPS):
            writer.write(noise.integers(64, 192, 160 * 120 * 3 // 2, np.uint8))
        sizes.append(path.stat().st_size - before)
        assert sizes[-1] <= kbps * 1000 / 8 * (seconds + BUFFER_S)
    writer.close()
    assert sizes[1] < sizes[0] / 2


def test_no_file_is_above_the_size_that_info_declares(
    tmp_path: Path, export: Export, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(layout, "MB", 1000)
    monkeypatch.setattr(layout, "DATA_FILE_MB", 1)
    monkeypatch.setattr(layout, "VIDEO_FILE_MB", 1)
    session = moving_session(tmp_path / "session", 0.3)
    assert export(session)[0] == 0
    info = json.loads((session / "lerobot/meta/info.json").read_text(encoding="utf-8"))
    for kind, folder in (("data", "data"), ("video", "videos")):
        files = list((session / "lerobot" / folder).rglob("file-*"))
        largest = max(path.stat().st_size for path in files)
        assert largest > 1000
        assert largest <= 1000 * info[f"{kind}_files_size_in_mb"]


def engaged_between(first: int, last: int, seconds: float) -> list[Tick]:
    """Ticks of a session in which the arm was engaged at those from `first` to `last` only."""
    return [
        replace(moving_tick(number), arming="engaged" if first <= number <= last else "ready")
        for number in range(round(seconds * 120))
    ]


@pytest.mark.parametrize(
    ("placed_s", "arguments", "from_s", "to_s"),
    [
        (None, (), 0.5, 3.0),  # a second before the first engagement, a second after the last
        (0.25, (), 0.5, 2.75),  # a second after the placing, counted from the first engagement
        (0.25, ("--keep-idle",), 0.0, 4.0),
    ],
)
def test_idle_time_at_either_end_is_left_out_unless_it_is_wanted(
    tmp_path: Path,
    export: Export,
    placed_s: float | None,
    arguments: tuple[str, ...],
    from_s: float,
    to_s: float,
) -> None:
    outcome = replace(PLACED, completion_time_s=placed_s)
    ticks = engaged_between(180, 240, 4.0)
    session = write_session(tmp_path / "session", ticks, 4.0, outcome=outcome)
    assert export(session, *arguments)[0] == 0
    (episode,) = episodes_of(session / "lerobot")
    start_s = (episode["started_wall_ns"] - head().wall_offset_ns - START_NS) / NS_PER_S
    assert start_s == pytest.approx(from_s, abs=0.05)
    assert start_s + episode["length"] / FPS == pytest.approx(to_s, abs=0.1)


def test_a_session_without_engagement_is_idle_time_alone(tmp_path: Path, export: Export) -> None:
    session = write_session(tmp_path / "session", engaged_between(1, 0, 0.3), 0.3)
    code, _, error = export(session)
    assert (code, "the arm was never engaged; --keep-idle" in error) == (2, True)
    assert export(session, "--keep-idle")[0] == 0


def test_of_several_sessions_what_gives_no_episode_is_named_and_counted(
    tmp_path: Path, export: Export
) -> None:
    good = moving_session(tmp_path / "good", 0.3)
    failed = moving_session(tmp_path / "failed", 0.3, outcome=replace(PLACED, success=False))
    cut = moving_session(tmp_path / "cut", 0.3)
    data = (cut / "session.mcap").read_bytes()
    (cut / "session.mcap").write_bytes(data[: len(data) * 2 // 3])
    dataset = tmp_path / "dataset"
    code, out, _ = export(good, failed, cut, "--only-success", "--out", dataset)
    assert code == 0
    assert f"skipped: {failed}: was not judged a success (placed)\n" in out
    assert f"skipped: {cut}: The log ends early, at " in out
    assert out.endswith("; skipped: 2 of 3 sessions\n")
    assert [one["session"] for one in episodes_of(dataset)] == ["good"]
    code, out, error = export(failed, cut, "--only-success", "--out", tmp_path / "none")
    assert (code, out.count("skipped: ")) == (2, 2)
    assert "none of 2 sessions can be exported" in error
    assert not (tmp_path / "none").exists()


def test_a_chunk_has_a_thousand_files() -> None:
    number = FileNumber()
    for _ in range(1000):
        number.next()
    assert (number.chunk_index, number.file_index) == (1, 0)


def test_a_session_without_a_verdict_says_so_with_nulls(tmp_path: Path, export: Export) -> None:
    session = moving_session(tmp_path / "session", 0.3, outcome=replace(PLACED, success=None))
    assert export(session)[0] == 0
    schema = pq.read_schema(session / "lerobot/meta/episodes/chunk-000/file-000.parquet")
    assert str(schema.field("success").type) == "bool"
    (episode,) = episodes_of(session / "lerobot")
    assert (episode["success"], episode["completed"]) == (None, True)


def test_the_log_stays_as_it_was(tmp_path: Path, export: Export) -> None:
    session = moving_session(tmp_path / "session", 0.3)
    before = (session / "session.mcap").read_bytes()
    assert export(session)[0] == 0
    assert (session / "session.mcap").read_bytes() == before
    assert list(McapStream(session / "session.mcap", PROFILE))
    assert json.loads((session / "lerobot/meta/info.json").read_text())["total_episodes"] == 1

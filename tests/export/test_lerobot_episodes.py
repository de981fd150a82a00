"""Sessions that are rows of episodes, of which the kept ones are exported."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import pyarrow.parquet as pq
import pytest

from tams_app.cli import _main
from tams_app.recording import LOG_NAME, read_log
from tams_app.records import Episode
from tams_app.units import NS_PER_S
from tests.calibration.weights_session import seen
from tests.export.sessions import damage, head, moving_session, moving_tick, shown_at
from tests.synthetic_session import FPS, START_NS, VIEWS

pytestmark = pytest.mark.untimed


def at(t_s: float) -> int:
    return START_NS + round(t_s * NS_PER_S)


def ended(number: int, begin_s: float, end_s: float, **verdict: Any) -> Episode:
    return Episode(at(end_s), number, at(begin_s), at(end_s), **verdict)


KEPT = ended(1, 0.2, 0.6)
DISCARDED = ended(2, 0.65, 0.9)
SUCCESS = ended(3, 1.0, 1.3, success=True)
ROW = [KEPT, DISCARDED, replace(DISCARDED, t_ns=at(0.95), kept=False), SUCCESS]


def exported(session: Path, *options: str) -> list[dict[str, Any]]:
    """The rows of `meta/episodes`."""
    assert _main(["export", str(session), "--format", "lerobot", *options]) == 0
    return pq.read_table(  # type: ignore[no-any-return]
        session / "lerobot/meta/episodes/chunk-000/file-000.parquet"
    ).to_pylist()


def test_each_kept_episode_is_one_of_the_dataset_with_its_number_and_label(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = moving_session(tmp_path / "session", episodes=ROW)
    found = exported(session)
    assert [(one["session_episode"], one["success"]) for one in found] == [(1, None), (3, True)]
    assert {one["session"] for one in found} == {"session"}
    assert "session: takes 1, 3 of 3 episodes" in capsys.readouterr().out


def test_its_rows_and_frames_are_those_from_its_begin_to_its_end(tmp_path: Path) -> None:
    session = moving_session(tmp_path / "session", episodes=ROW)
    found = exported(session)
    rows = pq.read_table(session / "lerobot/data/chunk-000/file-000.parquet").to_pylist()
    instants = []
    for one, episode in zip(found, (KEPT, SUCCESS), strict=True):
        start_ns = one["started_wall_ns"] - head().wall_offset_ns
        assert start_ns == episode.start_ns
        last_ns = start_ns + (one["length"] - 1) * NS_PER_S // FPS
        assert last_ns < episode.end_ns <= last_ns + NS_PER_S // FPS + 1
        instants += [start_ns + k * NS_PER_S // FPS for k in range(one["length"])]
    assert len(rows) == len(instants)
    for row, instant_ns in zip(rows, instants, strict=True):
        number = max(n for n in range(200) if moving_tick(n).started_ns <= instant_ns)
        assert row["observation.state"][6] == pytest.approx(0.3 + number / 1000)
    for view in VIEWS:
        path = session / f"lerobot/videos/observation.images.{view}/chunk-000/file-000.mp4"
        video = cv2.VideoCapture(str(path))
        for instant_ns in instants:
            assert seen(video.read()[1]) == (view, shown_at(view, instant_ns))


def test_only_those_labelled_a_success_are_taken_if_that_is_wanted(tmp_path: Path) -> None:
    session = moving_session(tmp_path / "session", episodes=ROW)
    assert [one["session_episode"] for one in exported(session, "--only-success")] == [3]


def test_of_a_session_killed_in_its_third_episode_the_two_that_had_ended_are_whole(
    tmp_path: Path,
) -> None:
    session = moving_session(tmp_path / "session", episodes=[KEPT, DISCARDED])
    path = session / LOG_NAME
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 85 // 100])
    log = read_log(path)
    assert log.truncated
    assert log.ended_ns > DISCARDED.end_ns
    found = exported(session)
    assert [(one["session_episode"], one["log_complete"]) for one in found] == [
        (1, True),
        (2, True),
    ]
    assert [one["length"] for one in found] == [12, 8]


def test_of_a_damaged_log_the_episodes_that_are_whole_are_taken_and_the_others_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = moving_session(tmp_path / "session", episodes=ROW)
    damage(session, 1.1)
    (found,) = exported(session)
    assert (found["session_episode"], found["log_complete"], found["length"]) == (1, True, 12)
    shown = " ".join(capsys.readouterr().out.split())
    assert "takes 1 of 3 episodes; without 3: The log is damaged: what was recorded at" in shown
    assert "--with-damaged" in shown


def test_of_a_damaged_episode_the_longest_whole_part_is_taken_if_that_is_wanted(
    tmp_path: Path,
) -> None:
    session = moving_session(tmp_path / "session", episodes=[KEPT, ended(2, 0.7, 1.3)])
    damage(session, 1.1)
    first, second = exported(session, "--with-damaged")
    assert (first["session_episode"], first["log_complete"], first["length"]) == (1, True, 12)
    assert (second["session_episode"], second["log_complete"]) == (2, False)
    assert 0.2 * FPS < second["length"] < 0.4 * FPS  # until the damage


def test_a_row_of_episodes_of_which_none_is_whole_is_refused_in_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = moving_session(tmp_path / "session", episodes=[SUCCESS])
    damage(session, 1.1)
    assert _main(["export", str(session), "--format", "lerobot"]) == 2
    assert "The log is damaged: what was recorded at" in capsys.readouterr().err
    assert not (session / "lerobot").exists()


@pytest.mark.parametrize(
    ("row", "options", "told"),
    [
        ([replace(KEPT, kept=False)], (), "no episode of it was kept"),
        ([KEPT], ("--only-success",), "no episode of it was labelled a success"),
    ],
)
def test_a_session_without_such_an_episode_is_refused_in_a_sentence(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    row: list[Episode],
    options: tuple[str, ...],
    told: str,
) -> None:
    session = moving_session(tmp_path / "session", episodes=row)
    assert _main(["export", str(session), "--format", "lerobot", *options]) == 2
    assert told in capsys.readouterr().err
    assert not (session / "lerobot").exists()


def test_a_row_of_episodes_of_which_none_has_ended_is_not_exported_as_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = {**head().config, "recording": {"episodes": True}}
    session = moving_session(tmp_path / "session", header_of=head(config=config))
    assert _main(["export", str(session), "--format", "lerobot"]) == 2
    assert "no episode of it was kept" in capsys.readouterr().err

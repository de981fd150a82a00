"""What of a session is exported; and where nothing can be, a sentence and no folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from tams_app.export.lerobot.statistics import PixelStatistics
from tams_app.records import Episode, Tick
from tams_app.units import NS_PER_S
from tests.export.conftest import Export
from tests.export.sessions import (
    PLACED,
    TICKS,
    Dataset,
    damaged,
    head,
    moving_session,
    write_session,
)
from tests.file_size_limit import file_size_limit
from tests.synthetic_session import FPS, START_NS

pytestmark = pytest.mark.untimed


def at(t_s: float) -> int:
    return START_NS + round(t_s * NS_PER_S)


def ended(number: int, begin_s: float, end_s: float, **verdict: Any) -> Episode:
    return Episode(at(end_s), number, at(begin_s), at(end_s), **verdict)


KEPT = ended(1, 0.2, 0.6)
DISCARDED = ended(2, 0.65, 0.9)
SUCCESS = ended(3, 1.0, 1.3, success=True)
ROW = [KEPT, DISCARDED, replace(DISCARDED, t_ns=at(0.95), kept=False), SUCCESS]


def cut(session: Path, share: float) -> Path:
    path = session / "session.mcap"
    data = path.read_bytes()
    path.write_bytes(data[: round(len(data) * share)])
    return session


def taken(dataset: Dataset) -> list[tuple[int, bool, int]]:
    names = ("session_episode", "log_complete", "length")
    return [tuple(one[name] for name in names) for one in dataset.episodes]


def test_each_kept_episode_is_one_of_the_dataset_from_its_begin_to_its_end(
    tmp_path: Path, export: Export
) -> None:
    session = moving_session(tmp_path / "session", episodes=ROW)
    code, out, _ = export(session)
    assert (code, "session: takes 1, 3 of 3 episodes" in out) == (0, True)
    dataset = Dataset(session / "lerobot")
    dataset.check()
    assert taken(dataset) == [(1, True, 12), (3, True, 9)]
    assert [one["success"] for one in dataset.episodes] == [None, True]
    assert [dataset.instants_ns(one)[0] for one in dataset.episodes] == [at(0.2), at(1.0)]
    assert export(session, "--only-success", "--out", tmp_path / "out")[0] == 0
    assert taken(Dataset(tmp_path / "out")) == [(3, True, 9)]


def test_of_a_session_killed_in_its_third_episode_the_two_that_had_ended_are_whole(
    tmp_path: Path, export: Export
) -> None:
    session = cut(moving_session(tmp_path / "session", episodes=[KEPT, DISCARDED]), 0.85)
    assert export(session)[0] == 0
    assert taken(Dataset(session / "lerobot")) == [(1, True, 12), (2, True, 8)]


def test_of_a_damaged_log_whole_episodes_are_taken_and_of_others_a_part_if_that_is_wanted(
    tmp_path: Path, export: Export
) -> None:
    session = damaged(
        moving_session(tmp_path / "session", episodes=[KEPT, ended(2, 0.7, 1.3)]), 1.1
    )
    code, out, _ = export(session)
    shown = "takes 1 of 2 episodes; without 2: The log is damaged: what was recorded at"
    assert (code, shown in out, "--with-damaged" in out) == (0, True, True)
    assert taken(Dataset(session / "lerobot")) == [(1, True, 12)]
    assert export(session, "--with-damaged", "--out", tmp_path / "out")[0] == 0
    dataset = Dataset(tmp_path / "out")
    dataset.check()
    whole, part = taken(dataset)
    assert (whole, part[:2]) == ((1, True, 12), (2, False))
    assert 0.2 * FPS < part[2] < 0.4 * FPS  # until the damage
    alone = damaged(moving_session(tmp_path / "alone", episodes=[SUCCESS]), 1.1)
    code, _, error = export(alone)
    assert (code, "The log is damaged: what was recorded at" in error) == (2, True)
    assert not (alone / "lerobot").exists()


@pytest.mark.parametrize(
    ("spoil", "share", "said"),
    [
        (damaged, 0.4, "The log is damaged: what was recorded at 0.3 to 0.5 s is missing."),
        (cut, 0.5, "The log ends early, at "),
    ],
)
def test_of_a_log_that_is_not_whole_the_longest_part_is_exported_if_that_is_wanted(
    tmp_path: Path, export: Export, spoil: Callable[..., Path], share: float, said: str
) -> None:
    session = spoil(moving_session(tmp_path / "session"), share)
    code, _, error = export(session)
    assert (code, said in error, len(error.splitlines())) == (2, True, 1)
    assert not (session / "lerobot").exists()
    code, out, _ = export(session, "--with-damaged")
    assert (code, f"session: {said}" in out) == (0, True)
    dataset = Dataset(session / "lerobot")
    dataset.check()
    ((_, complete, length),) = taken(dataset)
    assert not complete
    from_s = (dataset.instants_ns(dataset.episodes[0])[0] - START_NS) / NS_PER_S
    assert from_s > 0.5 if spoil is damaged else from_s < 0.1  # behind the gap, at keyframes
    assert 0.2 * FPS < length < 1.3 * FPS
    assert dataset.episodes[0]["success"] is (True if spoil is damaged else None)


def few(folder: Path, ticks: list[Tick] = TICKS[:36], **others: Any) -> Path:
    return write_session(folder, ticks, 0.3, **others)


def engaged_between(first: int, last: int, seconds: float) -> list[Tick]:
    """Ticks of a session in which the arm was engaged at those from `first` to `last` only."""
    return [
        replace(one, arming="engaged" if first <= number <= last else "ready")
        for number, one in enumerate(TICKS[: round(seconds * 120)])
    ]


WIDE = {**head().config, "video": {**head().config["video"], "width": 320}}
UNENDED = {**head().config, "recording": {"episodes": True}}
SILENT = [replace(one, arm=None) for one in TICKS[:36]]
LATE = [replace(one, started_ns=one.started_ns + 9 * NS_PER_S) for one in TICKS[:36]]


@pytest.mark.parametrize(
    ("said", "options", "parts"),
    [
        ("its arm was led from pose to pose", (), {"header_of": head(servo="pose")}),
        ("no video of eih: record with recording.bitstream: true", (), {"bitstream": False}),
        ("of two computers give the robot's log", (), {"ticks": []}),
        ("tells nothing of an arm", (), {"ticks": SILENT}),
        ("has no moment with the arm and a picture", (), {"ticks": LATE}),
        ("are not of 320x120 as its header says", (), {"header_of": head(config=WIDE)}),
        ("never engaged; --keep-idle", (), {"ticks": engaged_between(1, 0, 0.3)}),
        ("no episode of it was kept", (), {"episodes": [replace(KEPT, kept=False)]}),
        ("no episode of it was kept", (), {"header_of": head(config=UNENDED)}),
        ("was labelled a success", ("--only-success",), {"episodes": [KEPT]}),
        ("not judged a success (there is", ("--only-success",), {"outcome": None}),
    ],
)
def test_what_cannot_be_exported_is_a_sentence(
    tmp_path: Path, export: Export, said: str, options: tuple[str, ...], parts: dict[str, Any]
) -> None:
    session = few(tmp_path / "session", **parts)
    code, _, error = export(session, *options)
    assert (code, len(error.splitlines())) == (2, 1)
    assert error.startswith(f"tams: {session}: ")
    assert said in error
    assert not (session / "lerobot").exists()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"fps": 25}, "at 25 frames a second, but"),
        ({"views": ("eih", "gt")}, "has eih, gt with 160x120"),
        ({"config": {**head().config, "arm": {"model": "other"}}}, "is of another arm than"),
    ],
)
def test_sessions_of_unlike_shape_are_refused_in_a_sentence(
    tmp_path: Path, export: Export, changes: dict[str, Any], said: str
) -> None:
    first = few(tmp_path / "first")
    second = few(tmp_path / "second", header_of=head(**changes))
    code, _, error = export(first, second, "--out", tmp_path / "out")
    assert (code, said in error, len(error.splitlines())) == (2, True, 1)
    assert error.endswith("export them apart\n")
    assert not (tmp_path / "out").exists()


def test_wrong_use_and_what_is_missing_is_a_sentence(
    tmp_path: Path, export: Export, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = few(tmp_path / "session")
    code, _, error = export(session, session)
    assert (code, "--out: of several sessions say in which folder" in error) == (2, True)
    code, _, error = export(tmp_path / "nowhere")
    assert (code, "there is no such folder" in error) == (2, True)
    (session / "lerobot").mkdir()
    (session / "lerobot/mine").touch()
    code, _, error = export(session)
    assert error == f"tams: {session}/lerobot: is there already: give another name\n"
    assert [path.name for path in (session / "lerobot").iterdir()] == ["mine"]
    monkeypatch.setattr("tams_app.errors.find_spec", lambda name: name if name != "av" else None)
    code, _, error = export(session)
    assert (code, error) == (1, "tams: --format lerobot needs av: make extras\n")


@pytest.mark.parametrize("limit_bytes", [1_000, 2_000, 20_000])
def test_a_full_disk_is_a_sentence_and_leaves_no_folder(
    tmp_path: Path, export: Export, limit_bytes: int
) -> None:
    session = moving_session(tmp_path / "session", 1.0)
    with file_size_limit(limit_bytes):
        code, _, error = export(session)
    assert (code, "cannot be written" in error, len(error.splitlines())) == (1, True, 1)
    assert not (session / "lerobot").exists()


def test_an_interrupted_export_leaves_no_folder(
    tmp_path: Path, export: Export, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = few(tmp_path / "session")

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(PixelStatistics, "add", interrupt)
    with pytest.raises(KeyboardInterrupt):
        export(session)
    assert not (session / "lerobot").exists()


@pytest.mark.parametrize(
    ("placed_s", "options", "from_s", "to_s"),
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
    options: tuple[str],
    from_s: float,
    to_s: float,
) -> None:
    outcome = replace(PLACED, completion_time_s=placed_s)
    ticks = engaged_between(180, 240, 4.0)
    session = write_session(tmp_path / "session", ticks, 4.0, outcome=outcome)
    assert export(session, *options)[0] == 0
    dataset = Dataset(session / "lerobot")
    instants = dataset.instants_ns(dataset.episodes[0])
    assert (instants[0] - START_NS) / NS_PER_S == pytest.approx(from_s, abs=0.05)
    assert (instants[-1] - START_NS) / NS_PER_S == pytest.approx(to_s, abs=0.1)


def test_an_episode_begins_when_the_arm_reports_and_without_a_verdict_it_has_nulls(
    tmp_path: Path, export: Export
) -> None:
    ticks = [replace(one, arm=None) for one in TICKS[:24]] + TICKS[24:60]
    session = write_session(tmp_path / "session", ticks, 0.5, outcome=replace(PLACED, success=None))
    assert export(session)[0] == 0
    dataset = Dataset(session / "lerobot")
    (episode,) = dataset.episodes
    assert dataset.instants_ns(episode)[0] == TICKS[24].started_ns
    assert (episode["success"], episode["completed"]) == (None, True)
    schema = pq.read_schema(dataset.root / "meta/episodes/chunk-000/file-000.parquet")
    assert str(schema.field("success").type) == "bool"


def test_of_several_sessions_what_gives_no_episode_is_named_and_counted(
    tmp_path: Path, export: Export
) -> None:
    good = few(tmp_path / "good")
    failed = few(tmp_path / "failed", outcome=replace(PLACED, success=False))
    short = cut(few(tmp_path / "cut"), 0.67)
    code, out, _ = export(good, failed, short, "--only-success", "--out", tmp_path / "out")
    assert code == 0
    assert f"skipped: {failed}: was not judged a success (placed)\n" in out
    assert f"skipped: {short}: The log ends early, at " in out
    assert out.endswith("; skipped: 2 of 3 sessions\n")
    assert [one["session"] for one in Dataset(tmp_path / "out").episodes] == ["good"]
    code, out, error = export(failed, short, "--only-success", "--out", tmp_path / "none")
    assert (code, out.count("skipped: ")) == (2, 2)
    assert "none of 2 sessions can be exported" in error
    assert not (tmp_path / "none").exists()

"""The measurement of the frames beside a session: what it tells, and that it never hurts."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from tams_app.config import VideoConfig
from tams_app.records import Frame, FrameQuality, Image, ViewState
from tams_app.runtime.parts import Parts
from tams_app.session.quality import RECENT_SCORES, LiveQuality, TaskRegions
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.live.frame_ring import SHOWN, FrameBlock, RingLayout

pytestmark = pytest.mark.waiting

WIDTH, HEIGHT = 160, 120
FRAME_NS = 33 * NS_PER_MS


class Session:
    """What is recorded and noted."""

    def __init__(self) -> None:
        self.screen = FrameBlock(RingLayout(SHOWN, ("gt",), WIDTH, HEIGHT))
        self.records: list[FrameQuality] = []
        self.notes: list[tuple[str, str]] = []
        self._changed = threading.Condition()

    def record(self, quality: FrameQuality) -> None:
        with self._changed:
            self.records.append(quality)
            self._changed.notify_all()

    def note(self, level: str, text: str) -> None:
        with self._changed:
            self.notes.append((level, text))
            self._changed.notify_all()

    def wait(self, records: int = 0, notes: int = 0) -> bool:
        with self._changed:
            return self._changed.wait_for(
                lambda: len(self.records) >= records and len(self.notes) >= notes, 30
            )


def quality_of(session: Session, logs: Path, enabled: bool = True) -> LiveQuality:
    config = VideoConfig.model_validate(
        {"views": ["gt"], "width": WIDTH, "height": HEIGHT, "quality": {"enabled": enabled}}
    )
    parts, regions = Parts(logs, pytest.fail, 0), TaskRegions({}, {})
    screen: Any = SimpleNamespace(frames=session.screen, mount=None)
    return LiveQuality(config, parts, screen, session, regions)  # type: ignore[arg-type]


@pytest.fixture
def session() -> Iterator[Session]:
    session = Session()
    yield session
    session.screen.close()


@pytest.fixture
def quality(session: Session, tmp_path: Path) -> LiveQuality:
    return quality_of(session, tmp_path)


@pytest.fixture
def started(quality: LiveQuality) -> Iterator[LiveQuality]:
    quality.start()
    yield quality
    quality.close()


def frame(index: int) -> Image:
    coarse = np.random.default_rng(index).integers(0, 255, (12, 16, 3), dtype=np.uint8)
    return np.asarray(cv2.resize(coarse, (WIDTH, HEIGHT)), np.uint8)


def push(session: Session, quality: LiveQuality, index: int) -> None:
    quality.captured(Frame("gt", index, index * FRAME_NS, frame(index)))
    shown = np.asarray(cv2.GaussianBlur(frame(index), (0, 0), 1), np.uint8)
    session.screen.put("gt", index, index * FRAME_NS + NS_PER_MS, shown)


def test_a_killed_helper_is_noted_once_and_its_scores_stay(
    session: Session, started: LiveQuality
) -> None:
    push(session, started, 0)
    assert session.wait(records=1)
    os.kill(started._parts.pids["quality"], signal.SIGKILL)
    assert session.wait(notes=1)
    push(session, started, 1)
    started.close()
    (note,) = session.notes
    assert note[0] == "warning"
    assert note[1].startswith("the frames' quality is not measured: the SSIM helper ended")
    assert [one.index for one in session.records] == [0]


def test_a_helper_that_cannot_start_is_noted_and_the_session_goes_on_without(
    session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.executable", "/nowhere/python")
    quality = quality_of(session, tmp_path)
    quality.start()
    assert quality._parts.pids == {}
    push(session, quality, 0)
    quality.close()
    ((level, text),) = session.notes
    assert level == "warning"
    assert "quality could not be started" in text
    assert session.records == []
    left = {path.name for path in Path("/dev/shm").glob(f"tams-{os.getpid()}-*")}
    assert left <= {session.screen.name}, "the session's own"


def test_no_memory_for_the_frames_is_noted_and_the_session_goes_on_without(
    session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(name: str, size: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tams_app.video.live.frame_ring.create_block", full)
    quality = quality_of(session, tmp_path)
    quality.start()
    push(session, quality, 0)
    quality.close()
    assert "No space left on device" in session.notes[0][1]


def test_switched_off_there_is_no_helper(session: Session, tmp_path: Path) -> None:
    quality = quality_of(session, tmp_path, enabled=False)
    quality.start()
    push(session, quality, 0)
    quality.close()
    assert quality._parts.pids == {}
    assert list(tmp_path.iterdir()) == []
    assert session.notes == []
    assert session.records == []


def live_of(quality: LiveQuality, view: str, now_ns: int) -> float | None:
    return quality.views({view: ViewState()}, now_ns)[view].live_ssim


def scored(index: int, live: float | None, view: str = "gt") -> FrameQuality:
    t_ns = index * FRAME_NS
    return FrameQuality(view, index, t_ns, None, None, False, None, None, None, live)


def test_the_console_gets_the_mean_of_the_last_scores_of_a_view(quality: LiveQuality) -> None:
    assert live_of(quality, "gt", 0) is None
    for index in range(40):
        quality._keep(scored(index, index / 100))
        quality._keep(scored(index, None))
        quality._keep(scored(index, 0.9, "eih"))
    last = [index / 100 for index in range(40 - RECENT_SCORES, 40)]
    assert live_of(quality, "gt", 40 * FRAME_NS) == pytest.approx(np.mean(last))
    assert live_of(quality, "eih", 40 * FRAME_NS) == pytest.approx(0.9)


def test_the_mean_at_the_task_is_over_the_frames_that_have_one(quality: LiveQuality) -> None:
    quality._keep(replace(scored(0, 0.9), task_live=0.5))
    quality._keep(replace(scored(1, 0.9), task_live=0.7))
    quality._keep(scored(2, 0.9))
    view = quality.views({"gt": ViewState(sent_kbps=3.0)}, 3 * FRAME_NS)["gt"]
    assert (view.sent_kbps, view.live_ssim) == (3.0, pytest.approx(0.9))
    assert view.task_live_ssim == pytest.approx(0.6)


def test_old_scores_are_not_shown_as_if_they_were_new(quality: LiveQuality) -> None:
    quality._keep(scored(0, 0.9))
    quality._keep(scored(1, 0.5))
    assert live_of(quality, "gt", 3 * NS_PER_S + FRAME_NS) == pytest.approx(0.5)
    assert live_of(quality, "gt", 3 * NS_PER_S + 2 * FRAME_NS) is None

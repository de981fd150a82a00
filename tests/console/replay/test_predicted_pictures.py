"""A replay draws what was predicted as it was drawn."""

from __future__ import annotations

import numpy as np
import pytest

from tams_app.config import load_config
from tams_app.console.replay.predicted import DrawnPictures
from tams_app.prediction.present import PREDICTED_FACT, MountTrail
from tams_app.recording import FrameCaptured, FrameShown, SessionLog
from tams_app.records import MountPrediction, Pose
from tams_app.rotation import Rotation
from tams_app.session.predicting import predicted_cameras
from tams_app.units import NS_PER_MS
from tests.synthetic_session import START_NS, header

pytestmark = pytest.mark.untimed

CONFIG = load_config(None, {"view.predict": "all"})
LATE_NS = 120 * NS_PER_MS
SHOWN_NS = START_NS + 900 * NS_PER_MS
DOWN = Rotation.from_rotvec((np.pi, 0.0, 0.0))
IMAGE = np.random.default_rng(3).integers(0, 255, (480, 640, 3), np.uint8)


def flange(t_ns: int) -> Pose:
    """It goes along y at a quarter of a metre a second."""
    return Pose(np.array([0.35, 0.25 * (t_ns - START_NS) / 1e9, 0.25]), DOWN)


def predictions(until_ns: int) -> list[MountPrediction]:
    times_ns = range(START_NS, until_ns, 16 * NS_PER_MS)
    return [MountPrediction(t - LATE_NS, flange(t - LATE_NS), t, flange(t)) for t in times_ns]


def log_of(predicted: str = "eih,gt,gs") -> SessionLog:
    log = SessionLog(header(config=CONFIG.model_dump(mode="json")), START_NS)
    log.facts[PREDICTED_FACT] = predicted
    for view in ("eih", "gt", "gs"):
        log.captured.append(FrameCaptured(view, 7, SHOWN_NS - LATE_NS))
        log.shown.append(FrameShown(view, 7, SHOWN_NS, True))
    log.predictions = predictions(START_NS + 3_000 * NS_PER_MS)
    return log


@pytest.mark.parametrize("view", ["eih", "gt", "gs"])
def test_a_picture_is_as_it_was_drawn_when_it_was_shown(view: str) -> None:
    trail = MountTrail()
    for prediction in predictions(SHOWN_NS + 16 * NS_PER_MS):
        trail.add(prediction)
    shown = predicted_cameras(CONFIG)[view].view(trail).show(IMAGE, SHOWN_NS - LATE_NS, SHOWN_NS)
    assert shown.correction is not None
    drawn = DrawnPictures(log_of()).draw(view, IMAGE, SHOWN_NS)
    assert (drawn == shown.image).all()
    assert (drawn != IMAGE).any()


def test_only_views_of_which_something_was_predicted_are_drawn() -> None:
    pictures = DrawnPictures(log_of("eih"))
    assert pictures.views == ("eih",)
    assert pictures.draw("gt", IMAGE, SHOWN_NS) is IMAGE


def test_a_picture_is_as_received_where_its_capture_is_not_known() -> None:
    assert DrawnPictures(log_of()).draw("eih", IMAGE, SHOWN_NS + 1) is IMAGE


def test_a_log_of_another_version_and_one_without_predictions_are_shown_as_received() -> None:
    log = log_of("")
    assert DrawnPictures(log).views == ()
    log.facts[PREDICTED_FACT] = "eih"
    log.header.config.clear()
    log.header.config["version"] = "of another"
    assert DrawnPictures(log).views == ()

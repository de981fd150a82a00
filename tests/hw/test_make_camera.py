"""Which camera a configuration makes."""

from __future__ import annotations

from typing import Any

import pytest

from hw.gstreamer.camera import GstCamera
from hw.gstreamer.capture import FileSource, PatternSource
from hw.make_camera import make_camera
from hw.v4l2.source import V4l2Source
from tams_app.config import CameraConfig, VideoConfig
from tams_app.errors import ConfigError
from tams_app.runtime.clock import VirtualClock

pytestmark = pytest.mark.untimed


def make(**keys: Any) -> GstCamera:
    config = CameraConfig(**keys)
    return make_camera("gs", config, VideoConfig(), VirtualClock(), lambda *_: None)


@pytest.mark.parametrize(
    ("keys", "kind"),
    [
        ({"source": "v4l2", "serial": "S1"}, V4l2Source),
        ({"source": "file", "file": "a.mkv"}, FileSource),
        ({"source": "pattern"}, PatternSource),
    ],
)
def test_each_source_has_its_camera(keys: dict[str, Any], kind: type) -> None:
    camera = make(**keys)
    assert camera.view == "gs"
    assert isinstance(camera._source, kind)


def test_only_real_cameras_are_judged_by_their_noise_and_never_end() -> None:
    traits = {
        source: (camera._source.noisy, camera._source.endless)
        for source, camera in {
            "v4l2": make(serial="S1"),
            "file": make(source="file", file="a.mkv"),
            "pattern": make(source="pattern"),
        }.items()
    }
    assert traits == {"v4l2": (True, True), "file": (False, False), "pattern": (False, True)}


def test_an_exposure_longer_than_a_frame_is_refused_before_anything_is_opened() -> None:
    with pytest.raises(ConfigError, match=r"cameras\.gs\.exposure_us"):
        make(serial="S1", exposure_us=40_000)


def test_a_camera_is_called_what_it_was_asked_by() -> None:
    assert make(name="Webcam", serial="S1")._source.label == "Webcam, serial S1"


def test_a_source_that_does_not_exist_is_one_sentence() -> None:
    with pytest.raises(
        ConfigError, match=r"cameras\.VIEW\.source: 'webcam' is not one of v4l2, file,"
    ):
        make(source="webcam")

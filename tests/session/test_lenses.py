"""What a session knows of its cameras: exactly of the rig's, by calibration of real ones."""

from typing import Any

import numpy as np
import pytest

from tams_app.config import Config, load_config
from tams_app.errors import ConfigError
from tams_app.records import Note
from tams_app.rotation import Rotation
from tams_app.runtime.clock import VirtualClock
from tams_app.session.lenses import known_cameras
from tams_app.session.predicting import as_received, linked_present, predicted_cameras
from tams_app.session.viewing import scene_of
from tams_app.station.mount_memory import MountMemory
from tests.session.exchange import MemoryJournal

pytestmark = pytest.mark.untimed

LENS = {"width": 1280, "height": 960, "fx": 1400.0, "fy": 1410.0, "cx": 641.0, "cy": 470.0,
        "distortion": [-0.1, 0.02, 0.001, 0.0, 0.0], "error_px": 0.2}  # fmt: skip
ON_ARM = {"frame": "arm", "position_mm": [-68, 1, 24], "rotation_vector_rad": [0.1, 0.2, 1.5],
          "error_px": 1.0}  # fmt: skip
BESIDE = ON_ARM | {"frame": "base", "position_mm": [750, 0, 820]}


VIEWS = ("eih", "gt", "gs")


def config(cameras: dict[str, Any], real: bool = True, **more: Any) -> Config:
    named = {view: {"name": view, **keys} for view, keys in cameras.items()}
    for view in VIEWS:
        named.setdefault(view, {"name": view})
    views = {f"cameras.{view}": keys for view, keys in named.items()}
    return load_config(None, {"rig.enabled": not real, **views, **more})


def test_a_measured_camera_is_known_at_its_place_for_pictures_of_the_video_s_size() -> None:
    lenses = scene_of(config({"eih": {"lens": LENS, "mount": ON_ARM},
                              "gt": {"lens": LENS, "mount": BESIDE}, "gs": {}})).lenses  # fmt: skip
    assert set(lenses) == {"eih", "gt"}
    eih = lenses["eih"]
    assert (eih.parent, lenses["gt"].parent) == ("link6", "base")
    assert eih.pose.position == pytest.approx([-0.068, 0.001, 0.024])
    assert eih.pose.rotation.as_rotvec() == pytest.approx((0.1, 0.2, 1.5))
    assert (eih.width, eih.height) == (640, 480)
    assert (eih.fx, eih.fy, eih.cx, eih.cy) == pytest.approx((700.0, 705.0, 320.25, 234.75))
    assert eih.distortion == (-0.1, 0.02, 0.001, 0.0, 0.0)


def test_on_hardware_what_was_measured_is_predicted_and_the_rest_is_told() -> None:
    cameras = {"eih": {"lens": LENS, "mount": ON_ARM}, "gt": {"lens": LENS}, "gs": {}}
    ours = config(cameras, **{"view.predict": "all"})
    (eih,) = predicted_cameras(ours).values()
    assert eih.on_arm
    assert eih.lens.distortion == (-0.1, 0.02, 0.001, 0.0, 0.0)
    assert as_received(ours) == {
        "gt": "where it is was not measured",
        "gs": "its lens was not measured",
    }
    assert as_received(config(cameras, **{"view.predict": "eih"})) == {}
    assert as_received(config(cameras)) == {}
    assert as_received(config({"eih": {}}, **{"view.predict": "eih"})) == {
        "eih": "its lens was not measured"
    }


def test_a_video_of_another_shape_than_the_lens_was_measured_in_is_refused_in_words() -> None:
    known = known_cameras(
        config({"eih": {"lens": LENS, "mount": ON_ARM}}, **{"video.height": 360})
    )["eih"]
    assert known.lens is None
    assert known.words == (
        "its lens was measured in pictures of 1280x960, and the video is 640x360, of another shape"
    )


def test_the_rig_s_cameras_are_exact_unless_a_calibration_is_given() -> None:
    exact = scene_of(load_config(None, {})).lenses
    given = scene_of(config({"eih": {"lens": LENS, "mount": ON_ARM}}, real=False)).lenses
    assert given["eih"].fx == pytest.approx(700.0)
    assert (given["gt"].fx, given["gs"].cx) == (exact["gt"].fx, exact["gs"].cx)
    assert isinstance(exact["eih"].pose.rotation, Rotation)
    assert np.allclose(exact["eih"].pose.position, [-0.068, 0.0, 0.024])


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"mount": ON_ARM}, "mount holds with the lens"),
        ({"lens": LENS | {"distortion": [-2.0, 0, 0, 0, 0]}}, "turns back within the picture"),
        ({"lens": LENS | {"cx": 1300.0}}, "must be in the picture"),
        ({"lens": LENS, "mount": ON_ARM | {"position_mm": [0, 0, 6000]}}, "give millimetres"),
    ],
)
def test_a_calibration_that_cannot_be_is_refused_in_one_sentence(
    keys: dict[str, Any], words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        config({"eih": keys})


def test_a_session_says_of_each_view_that_is_not_predicted_why_it_is_not() -> None:
    kept = MemoryJournal(VirtualClock())
    cameras = {"eih": {"lens": LENS}, "gt": {}, "gs": {"lens": LENS, "mount": BESIDE}}
    ours = config(cameras, **{"view.predict": "all"})
    memory = MountMemory(predicted_cameras(ours))
    try:
        linked_present(ours, None, kept, memory)
    finally:
        memory.close()
    assert [one.text for one in kept.of(Note)] == [
        "EIH is shown as received: where it is was not measured; measure it: run_tams.py calibrate "
        "cameras --only lens,mount",
        "GT is shown as received: its lens was not measured; measure it: run_tams.py calibrate "
        "cameras --only lens,mount",
        "view.predict: how the hand moves the arm is not known: all is shown as received",
    ]

"""Loading GStreamer, and what it says when something is missing."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from tams_app import gst
from tams_app.errors import SetupError
from tams_app.runtime.process import PROJECT_DIRECTORY

pytestmark = pytest.mark.waiting


def test_a_machine_with_all_packages_lacks_nothing() -> None:
    assert gst.missing_elements() == {}


def test_a_buffer_holds_a_copy_of_what_it_was_given_and_gives_a_copy_back() -> None:
    image = np.random.default_rng(0).integers(0, 255, (48, 64, 3), dtype=np.uint8)
    buffer = gst.raw_buffer(image, 7, 5)
    before = image.copy()
    image[:] = 0
    pixels = gst.pixels_of(buffer)
    np.testing.assert_array_equal(pixels.reshape(before.shape), before)
    pixels[:] = 0
    assert buffer.extract_dup(0, buffer.get_size()) == before.tobytes()
    assert (buffer.pts, buffer.duration) == (7, 5)
    assert gst.pixels_of(gst.raw_buffer(b"packet", 0, 0)).tobytes() == b"packet"


def test_an_image_that_is_not_in_one_piece_is_refused() -> None:
    with pytest.raises(ValueError, match="contiguous"):
        gst.raw_buffer(np.zeros((4, 4, 3), np.uint8)[:, ::2], 0, 0)


def test_a_missing_element_is_named_with_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(gst.ELEMENT_PACKAGES, "nosuchenc", "gstreamer1.0-imagined")
    assert gst.missing_elements(["x264enc", "nosuchenc"]) == {"nosuchenc": "gstreamer1.0-imagined"}
    with pytest.raises(SetupError, match=r"lacks nosuchenc; install gstreamer1\.0-imagined"):
        gst.require_elements(["x264enc", "nosuchenc"])


def test_a_pipeline_that_cannot_be_built_is_a_setup_error() -> None:
    with pytest.raises(SetupError, match="nosuchelement"):
        gst.parse_pipeline("fakesrc ! nosuchelement ! fakesink")


def test_a_failed_pipeline_tells_its_reason_once() -> None:
    pipeline = gst.parse_pipeline("filesrc location=/nosuchfile ! fakesink")
    with pytest.raises(SetupError, match="the probe could not start: filesrc"):
        gst.set_playing(pipeline, "the probe")
    gst.shut_down(pipeline)
    gst.shut_down(pipeline)
    assert gst.poll_bus(pipeline) == ""


def test_a_critical_of_gstreamer_does_not_go_unnoticed(glib_complaints: list[str]) -> None:
    Gst = gst.load().Gst
    Gst.Pad.new("loose", Gst.PadDirection.SRC).push(Gst.Buffer.new())
    Gst.Caps.from_string("video/x-raw").get_structure(0).set_name("not a name")
    assert glib_complaints
    glib_complaints.clear()


def test_c_plus_plus_libraries_loaded_after_gstreamer_can_throw() -> None:
    program = (
        "import sys; from tams_app.config import load_config; "
        "from hw.gstreamer.capture import PatternSource; "
        "PatternSource(load_config().video).open().close(); import matplotlib.pyplot; print('ok')"
    )
    result = subprocess.run(
        [sys.executable, "-c", program],
        cwd=PROJECT_DIRECTORY,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert result.stdout == "ok\n", result.stderr

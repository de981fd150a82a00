"""The colours of frames on their way through encoder and decoder."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.video.core import pipelines
from tams_app.video.core.codecs import bgr_of, i420_of

pytestmark = pytest.mark.waiting
COLOUR = st.tuples(*[st.integers(0, 255)] * 3)


def quarters(colours: list[tuple[int, int, int]], height: int, width: int) -> NDArray[np.uint8]:
    """An image of four areas of one colour each; their borders lie between blocks of chroma."""
    small = np.array(colours, np.uint8).reshape(2, 2, 3)
    return np.repeat(np.repeat(small, height // 2, axis=0), width // 2, axis=1)


@given(st.lists(COLOUR, min_size=4, max_size=4))
def test_areas_of_one_colour_come_back_within_three_levels(
    colours: list[tuple[int, int, int]],
) -> None:
    image = quarters(colours, 16, 32)
    again = bgr_of(i420_of(image), 16, 32)
    assert np.abs(again.astype(int) - image.astype(int)).max() <= 3


@pytest.mark.parametrize(("width", "height"), [(640, 480), (168, 122), (648, 486), (1280, 720)])
def test_gstreamer_reads_the_planes_as_they_were_laid_out(width: int, height: int) -> None:
    """Its own converter sees the same image in them, up to its rounding."""
    colours = [(200, 30, 60), (20, 220, 90), (70, 80, 240), (128, 10, 10)]
    image = quarters(colours, height // 4 * 4, width)
    image = np.concatenate((image, image[: height - len(image)]))
    caps = pipelines.raw_caps(VideoConfig(width=width, height=height))
    pipeline = gst.parse_pipeline(
        f'appsrc name=in format=time caps="{caps}" ! videoconvert ! video/x-raw,format=BGR '
        "! appsink name=out sync=false async=false"
    )
    gst.set_playing(pipeline, "the converter")
    pipeline.get_by_name("in").emit("push-buffer", gst.raw_buffer(i420_of(image), 0, 0))
    seen = gst.pixels_of(pipeline.get_by_name("out").emit("pull-sample").get_buffer())
    gst.shut_down(pipeline)
    rows = seen.reshape(height, -1)[:, : width * 3].reshape(height, width, 3)
    assert cv2.PSNR(rows, image) > 35

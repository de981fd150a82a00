"""Colour conversion by OpenCV beside GStreamer's: time, and how much of an image comes back.

`python -m benchmarks.colour`: renders of the scene, BGR to I420 and back, one thread each.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import cv2
import numpy as np

from hw.sim.layout import draw_layout
from hw.sim.viewpoints import VIEWS
from hw.sim.world.scene import build_model
from hw.sim.world.scene_renderer import SceneRenderer
from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.records import Image
from tams_app.units import NS_PER_S
from tams_app.video.core.colour import Planes, bgr_of, i420_of
from tams_app.video.core.pipelines import raw_caps
from tams_app.video.core.ssim import FrameMoments, luma_of, ssim

ROUNDS = 50


class Converter:
    """videoconvert alone, from one pixel format to another."""

    def __init__(self, before: str, after: str) -> None:
        self._pipeline = gst.parse_pipeline(
            f'appsrc name=in format=time caps="{raw_caps(VideoConfig(), before)}" ! videoconvert '
            f"n-threads=1 ! video/x-raw,format={after} ! appsink name=out sync=false async=false"
        )
        gst.set_playing(self._pipeline, "videoconvert")

    def __call__(self, pixels: Planes) -> Planes:
        buffer = gst.raw_buffer(pixels, 0, NS_PER_S)
        self._pipeline.get_by_name("in").emit("push-buffer", buffer)
        return gst.pixels_of(self._pipeline.get_by_name("out").emit("pull-sample").get_buffer())

    def close(self) -> None:
        gst.shut_down(self._pipeline)


def main() -> None:
    cv2.setNumThreads(1)
    height, width = VideoConfig().height, VideoConfig().width
    into, back = Converter("BGR", "I420"), Converter("I420", "BGRx")

    def four_bytes(planes: Planes) -> Image:
        pixels = back(planes).reshape(height, width, 4)
        return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGRA2BGR), np.uint8)

    for view, image in _renders().items():
        print(view)
        ways: dict[str, tuple[Callable[[Image], Planes], Callable[[Planes], Image]]] = {
            "videoconvert": (into, four_bytes),
            "OpenCV": (i420_of, lambda planes: bgr_of(planes, height, width)),
        }
        for name, (there, home) in ways.items():
            planes = there(image)
            shown = home(planes)
            similarity = ssim(*(FrameMoments.of(luma_of(one)) for one in (image, shown)))
            print(
                f"  {name:13s} there {_cpu_ms(there, image):.2f} ms, back "
                f"{_cpu_ms(home, planes):.2f} ms, PSNR {cv2.PSNR(image, shown):.1f} dB, "
                f"SSIM of luma {similarity:.4f}"
            )
    into.close()
    back.close()


def _renders() -> dict[str, Image]:
    layout = draw_layout(0)
    qpos = build_model(layout, textured=False).qpos0.tolist()
    renderer = SceneRenderer(layout)
    try:
        return {view: renderer.render(view, qpos) for view in VIEWS}
    finally:
        renderer.close()


def _cpu_ms(convert: Callable[..., Planes], given: Planes) -> float:
    """Processor time of the whole process: videoconvert works in a thread of its own."""
    costs = []
    for _ in range(ROUNDS):
        before_s = time.process_time()
        convert(given)
        costs.append((time.process_time() - before_s) * 1000)
    return statistics.median(costs)


if __name__ == "__main__":
    main()

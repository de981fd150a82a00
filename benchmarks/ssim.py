"""SSIM beside scikit-image's: the same score, and how much sooner. `python -m benchmarks.ssim`."""

from __future__ import annotations

import time
from collections.abc import Callable

import cv2
import numpy as np
from skimage.metrics import structural_similarity

from benchmarks.figures import Figure
from hw.sim.layout import draw_layout
from hw.sim.viewpoints import VIEWS
from hw.sim.world.scene import build_model
from hw.sim.world.scene_renderer import SceneRenderer
from tams_app.config import load_config
from tams_app.records import FrameQuality
from tams_app.runtime.kept_memory import keep_freed_memory
from tams_app.video.core.quality import Fate, Image, Scorer
from tams_app.video.core.ssim import FrameMoments, Luma, luma_of, ssim

ROUNDS = 15


def ssim_figures(seed: int = 0) -> list[Figure]:
    """Alternating, on renders of the scene, one thread each: times [ms] and their ratios."""
    keep_freed_memory()  # as all who score do
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        return _measure(_renders(seed))
    finally:
        cv2.setNumThreads(threads)


def _measure(lumas: list[Luma]) -> list[Figure]:
    one, other = lumas[0], np.asarray(cv2.GaussianBlur(lumas[0], (0, 0), 2), np.uint8)
    scorer, moments = Scorer(), FrameMoments.of(one)
    known = FrameMoments.of(other)
    difference = max(
        abs(_theirs(luma, blurred) - ssim(FrameMoments.of(luma), FrameMoments.of(blurred)))
        for luma in lumas
        for blurred in [np.asarray(cv2.GaussianBlur(luma, (0, 0), 2), np.uint8)]
    )
    theirs, pair, again, frame = _medians_ms(
        lambda: _theirs(one, other),
        lambda: ssim(FrameMoments.of(one), FrameMoments.of(other)),
        lambda: ssim(moments, known),
        lambda: scorer.score(_fate(one, other)),
    )

    def figure(name: str, value: float, unit: str, **target: float) -> Figure:
        return Figure("ssim", name, value, unit, **target)

    return [
        figure("largest difference from scikit-image", difference, "", at_most=1e-4),
        figure("scikit-image, one pair", theirs, "ms"),
        figure("one pair", pair, "ms"),
        figure("one pair, moments known", again, "ms"),
        figure("one frame, all three scores", frame, "ms"),
        figure("scikit-image / one pair", theirs / pair, "times", at_least=3),
        figure("scikit-image for three scores / one frame", 3 * theirs / frame, "times"),
    ]


def _medians_ms(*measured: Callable[[], object]) -> list[float]:
    times = np.empty((ROUNDS, len(measured)))
    for number in range(ROUNDS):
        for place, call in enumerate(measured):
            start = time.perf_counter()
            call()
            times[number, place] = time.perf_counter() - start
    return [float(value) for value in np.median(times, axis=0) * 1e3]


def _theirs(one: Luma, other: Luma) -> float:
    return float(
        structural_similarity(
            one, other, gaussian_weights=True, sigma=1.5, use_sample_covariance=False,
            data_range=255,
        )
    )  # fmt: skip


def _fate(captured: Luma, shown: Luma) -> Fate:
    """A frame that was shown, while its like was on screen at its capture (moments not known)."""
    own = Image(shown)
    record = FrameQuality("eih", 0, 0, 1, None, False, None, None, None, None)
    return Fate(record, Image(captured), own, own, Image(shown))


def _renders(seed: int) -> list[Luma]:
    layout = draw_layout(seed)
    qpos = build_model(layout, textured=False).qpos0.copy()
    qpos[:6] = np.radians(load_config().arm.ready_joints_deg)
    renderer = SceneRenderer(layout)
    lumas = [luma_of(renderer.render(view, qpos)) for view in VIEWS]
    renderer.close()
    return lumas


if __name__ == "__main__":
    for each in ssim_figures():
        print(f"{each.name:45} {each.value:10.3g} {each.unit:6} {each.target:8} {each.verdict}")

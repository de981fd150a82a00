"""The rig's three cameras in virtual time, plugged in an unknown order, and a simulated person."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import cv2
import numpy as np

from calibration.cameras.bench import Settings, Shot, Task
from calibration.cameras.flashes import Flashes
from hw.sim.layout import draw_layout
from hw.sim.viewpoints import HEIGHT_PX, WIDTH_PX
from hw.sim.world.camera_images import SensorNoise
from hw.sim.world.scene_renderer import SceneRenderer
from hw.sim.world.world import World
from tams_app.config import CameraConfig, Config
from tams_app.records import Frame, Image
from tams_app.runtime.clock import VirtualClock
from tams_app.units import NS_PER_MS, NS_PER_S

_SEED = 0xCA3
_RATE_PPM = 100.0  # by which crystals differ
_JITTER_MS = 0.3
_DELIVERY_MS = (12.0, 2.0)  # at least, and the mean of what comes on top
_SKIN = (120, 150, 205)  # BGR
_RING_S = 9.0
_START_BLUR_PX = 4.0
_SCREEN_BLACK, _SCREEN_WHITE = 25.0, 215.0  # grey levels of the screen in an image
_GAMMA = 2.2


@dataclass(frozen=True, slots=True)
class CameraTruth:
    """What a simulated camera is like, to check the wizard against."""

    view: str
    latency_ms: float  # from the middle of its exposure to its timestamp
    exposure_ms: float
    sharpest_px: float
    phase_ns: int
    rate_hz: float


class SimulatedBench:
    """Images of the rig at rest, rendered once, with what the person holds before them."""

    source = "the simulated rig and a simulated person"
    attended = False

    def __init__(self, config: Config, seed: int) -> None:
        """SetupError without off-screen OpenGL."""
        self.fps, self.width = config.video.fps, WIDTH_PX
        self._clock = VirtualClock()
        self._random = np.random.default_rng([_SEED, seed])
        self.truth = _draw_truth(config.video.views, self._random, self.fps)
        self._scenes = _scenes(config, seed)
        sigma = config.rig.camera_noise_sigma
        self._noise = {
            name: SensorNoise(seed, truth.view, sigma, HEIGHT_PX, WIDTH_PX)
            for name, truth in self.truth.items()
        }
        self._person = _Person({one.view: one.sharpest_px for one in self.truth.values()})
        self._flashes: Flashes | None = None
        self.refused: Sequence[str] = ()

    @property
    def cameras(self) -> Sequence[str]:
        return tuple(self.truth)

    def binding(self, camera: str) -> dict[str, str]:
        return {
            "source": "v4l2",
            "name": "",
            "serial": f"SIMULATED-{camera[-1]}",
            "path": "",
            "file": "",
        }

    def camera_of(self, config: CameraConfig) -> str:
        found = [name for name in self.truth if self.binding(name)["serial"] == config.serial]
        return found[0] if found else ""

    def prompt(self, task: Task, view: str) -> None:
        self._person.ask(task, view, self._clock.now_ns())

    @property
    def done(self) -> bool:
        return self._person.finished(self._clock.now_ns())

    def shots(self, cameras: Sequence[str], seconds: float, every: int = 1) -> Iterator[Shot]:
        start_ns = self._clock.now_ns()
        end_ns = start_ns + round(seconds * NS_PER_S)
        due = [self._next(name, start_ns) for name in cameras]
        heapq.heapify(due)
        while due and due[0][0] < end_ns:
            at_ns, name, index = due[0]
            heapq.heapreplace(due, self._next(name, at_ns + 1))
            if index % every:
                continue
            self._clock.sleep_until_ns(at_ns)
            yield self._shot(name, index, at_ns)
        self._clock.sleep_until_ns(end_ns)

    def _next(self, name: str, from_ns: int) -> tuple[int, str, int]:
        """When the camera's first frame from a time on begins, and its index."""
        truth = self.truth[name]
        index = math.ceil((from_ns - truth.phase_ns) * truth.rate_hz / NS_PER_S)
        return truth.phase_ns + math.ceil(index * NS_PER_S / truth.rate_hz), name, index

    def chosen_settings(self, camera: str) -> Settings:
        return Settings()  # the rig's cameras have nothing to set

    def use_settings(self, camera: str, settings: Settings) -> None:
        raise AssertionError("the rig's cameras have nothing to set")

    @contextmanager
    def screen(self) -> Iterator[Flashes]:
        self._flashes = Flashes.beginning(self._clock.now_ns())
        try:
            yield self._flashes
        finally:
            self._flashes = None

    def close(self) -> None:
        """Nothing is held."""

    def _shot(self, name: str, index: int, start_ns: int) -> Shot:
        truth = self.truth[name]
        end_ns = start_ns + round(truth.exposure_ms * NS_PER_MS)
        lit = None if self._flashes is None else self._flashes.lit_share(start_ns, end_ns)
        image = self._person.seen(truth.view, self._scenes[truth.view], start_ns, end_ns, lit)
        self._noise[name].apply(image, index)
        jitter_ms = float(self._random.normal(0, _JITTER_MS))
        capture_ns = (start_ns + end_ns) // 2 + round((truth.latency_ms + jitter_ms) * NS_PER_MS)
        least_ms, mean_ms = _DELIVERY_MS
        late_ms = least_ms + float(self._random.exponential(mean_ms))
        frame = Frame(name, index, capture_ns, image)
        return Shot(name, frame, capture_ns + round(late_ms * NS_PER_MS))


class _Person:
    """Does what was asked last, and knows when it is finished; all of it in virtual time."""

    def __init__(self, sharpest_px: dict[str, float]) -> None:
        """By view: the blur that is left when the ring stands right."""
        self._sharpest_px = sharpest_px
        self._blur_px = dict.fromkeys(sharpest_px, _START_BLUR_PX)
        self._behind: dict[str, tuple[float, Image]] = {}  # by view: blur and the blurred scene
        self._task, self._view, self._since_ns = Task.REST, "", 0

    def ask(self, task: Task, view: str, now_ns: int) -> None:
        """Begin to do it for `view`, "" for all."""
        self._task, self._view, self._since_ns = task, view, now_ns

    def finished(self, now_ns: int) -> bool:
        """Whether what was asked is done; what has no end of its own never is."""
        after_s = (now_ns - self._since_ns) / NS_PER_S
        return self._task is Task.SHOW_SCREEN or (self._task is Task.FOCUS and after_s >= _RING_S)

    def seen(
        self, view: str, scene: Image, start_ns: int, end_ns: int, lit_share: float | None
    ) -> Image:
        """What `view` sees in an exposure; `lit_share`: of it the screen is white, if there is one.

        The screen's light adds up over the exposure; grey levels do not.
        """
        middle_s = ((start_ns + end_ns) / 2 - self._since_ns) / NS_PER_S
        meant = self._view in ("", view)
        if self._task is Task.FOCUS and view == self._view:
            self._blur_px[view] = self._ring(view, middle_s)
        image = self._blurred(view, scene)
        if self._task is Task.WAVE:
            _draw_hand(image, middle_s, 1.0 if meant else 0.12)
        elif self._task is Task.SHOW_SCREEN and meant and lit_share is not None:
            level = _SCREEN_BLACK + (_SCREEN_WHITE - _SCREEN_BLACK) * lit_share ** (1 / _GAMMA)
            image[40:-40, 40:-40] = round(level)
        return image

    def _blurred(self, view: str, scene: Image) -> Image:
        """A new image of the scene, as sharp as the ring stands."""
        blur_px = self._blur_px[view]
        if view not in self._behind or self._behind[view][0] != blur_px:
            blurred = scene if blur_px < 0.3 else cv2.GaussianBlur(scene, (0, 0), blur_px)
            self._behind[view] = blur_px, np.asarray(blurred, np.uint8)
        return self._behind[view][1].copy()

    def _ring(self, view: str, after_s: float) -> float:
        """Turned through the best place to the other end, and back to where the bar was highest."""
        best = self._sharpest_px[view]
        if after_s < _RING_S / 3:
            return best + (_START_BLUR_PX - best) * (1 - 3 * after_s / _RING_S)
        if after_s < 2 * _RING_S / 3:
            return best + 2.0 * math.sin(math.pi * (3 * after_s / _RING_S - 1))
        return best


def _draw_hand(image: Image, after_s: float, size: float) -> None:
    height, width = image.shape[:2]
    centre = (
        int(width * (0.5 + 0.25 * math.sin(7.0 * after_s))),
        int(height * (0.5 + 0.1 * math.cos(5.0 * after_s))),
    )
    axes = (max(3, int(0.2 * size * width)), max(3, int(0.3 * size * height)))
    cv2.ellipse(image, centre, axes, 15 * math.sin(6 * after_s), 0, 360, _SKIN, -1)


def _draw_truth(
    views: Sequence[str], random: np.random.Generator, fps: int
) -> dict[str, CameraTruth]:
    """Cameras named A, B, C in an order that says nothing of the views."""
    return {
        f"camera {letter}": CameraTruth(
            view=str(view),
            latency_ms=float(random.uniform(5, 45)),
            exposure_ms=float(random.uniform(6, 14)),
            sharpest_px=float(random.uniform(0.3, 0.6)),
            phase_ns=int(random.uniform(0, NS_PER_S / fps)),
            rate_hz=float(fps * (1 + random.uniform(-1, 1) * _RATE_PPM / 1e6)),
        )
        for letter, view in zip("ABCDEFGH", random.permutation(list(views)), strict=False)
    }


def _scenes(config: Config, seed: int) -> dict[str, Image]:
    layout = draw_layout(seed)
    qpos = World(layout, np.radians(config.arm.ready_joints_deg)).qpos
    renderer = SceneRenderer(layout)
    try:
        return {view: renderer.render(view, qpos) for view in config.video.views}
    finally:
        renderer.close()

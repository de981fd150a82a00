"""What the predictive display costs a frame: `python -m benchmarks.correction_cost`.

Processor time of one thread for a picture of 640 by 480 of each of the rig's views, at poses 20 mm
apart, median of rounds: here, on the reference machine by this one's speed, and as a ratio to an
11 by 11 Gaussian window over as many floats. The check of the wrist's camera is spread over all
frames of an arm that moves without a pause, at 30 a second.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from hw.sim.viewpoints import VIEWS
from tams_app.config import load_config
from tams_app.prediction.camera_check import CameraCheck
from tams_app.prediction.present import CorrectedView, MountTrail, WristView
from tams_app.records import MountPrediction, Pose, ShownFrame, Vector
from tams_app.runtime.machine_speed import this_machine
from tams_app.session.predicting import predicted_cameras
from tams_app.session.viewing import scene_of
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.rig_views import stored_views

ROUNDS, FPS = 200, 30
LATE_NS = 200 * NS_PER_MS
SPEED_M_S = 0.10  # 20 mm in that time
TARGET_MS, CHECK_TARGET_MS = 2.0, 0.2
WINDOW = cv2.getGaussianKernel(11, 1.5, cv2.CV_32F)


class Driving:
    """The arm turns to and fro, its flange at 100 mm/s over a fifth of a metre."""

    def __init__(self) -> None:
        self._config = load_config(None, {"rig.enabled": True, "view.predict": "all"})
        figure = scene_of(self._config).figure
        assert figure is not None
        self._figure, self._ready = figure, np.radians(self._config.arm.ready_joints_deg)
        self._reach_m = float(np.linalg.norm(self.flange(self._ready).position[:2]))
        self.trail = MountTrail()
        cameras = predicted_cameras(self._config)
        self.views: dict[str, CorrectedView] = {
            view: cameras[view].view(self.trail) for view in VIEWS
        }

    def flange(self, joints: Vector) -> Pose:
        return self._figure.place(joints)[self._figure.flange]

    def at(self, t_ns: int) -> Vector:
        along_m = SPEED_M_S * t_ns / NS_PER_S
        aside_m = abs((along_m + 0.1) % 0.4 - 0.2) - 0.1
        joints = self._ready.copy()
        joints[0] += aside_m / self._reach_m
        return joints

    def tell(self, now_ns: int) -> None:
        """Where the arm was and is at `now_ns`."""
        then_ns = now_ns - LATE_NS
        then, now = self.at(then_ns), self.at(now_ns)
        self.trail.add(
            MountPrediction(
                then_ns,
                self.flange(then),
                now_ns,
                self.flange(now),
                then_joints=then,
                now_joints=now,
            )
        )


def median_ms(call: Callable[[], object]) -> float:
    """Processor time of this thread."""
    costs = []
    for _ in range(ROUNDS):
        began_s = time.thread_time()
        call()
        costs.append(time.thread_time() - began_s)
    return 1000.0 * statistics.median(costs)


def corrections_ms() -> dict[str, float]:
    """Of each view, to correct a frame for the screen."""
    driving, images = Driving(), stored_views()
    now_ns = NS_PER_S
    for t_ns in range(NS_PER_S // 2, now_ns + 1, 10 * NS_PER_MS):
        driving.tell(t_ns)
    found = {}
    for view, corrected in driving.views.items():
        capture_ns = now_ns - LATE_NS
        assert corrected.show(images[view], capture_ns, now_ns).correction is not None
        found[view] = median_ms(lambda: corrected.show(images[view], capture_ns, now_ns))  # noqa: B023
    return found


def check_ms() -> float:
    """Of the check, a frame: the mean over a minute of motion."""
    driving = Driving()
    view = driving.views["eih"]
    assert isinstance(view, WristView)
    check, images = CameraCheck(view), stored_views()
    image, spent_s, frames = images["eih"], 0.0, 60 * FPS
    for number in range(frames):
        now_ns = NS_PER_S + number * NS_PER_S // FPS
        driving.tell(now_ns)
        rolled = np.roll(image, 4 * number, axis=1)  # each frame unlike those before
        shown = ShownFrame("eih", number, now_ns, rolled, now_ns - LATE_NS, True)
        began_s = time.thread_time()
        check.shown(shown)
        check.fits = True  # what goes on is measured
        spent_s += time.thread_time() - began_s
    assert check.judged > frames // FPS // 2
    return 1000.0 * spent_s / frames


def main() -> None:
    cv2.setNumThreads(1)
    floats = np.zeros((480, 640), np.float32)
    unit_ms = median_ms(lambda: cv2.sepFilter2D(floats, -1, WINDOW, WINDOW))
    costs = [(f"{view}, corrected", ms, TARGET_MS) for view, ms in corrections_ms().items()]
    costs.append(("eih, check of the camera, mean", check_ms(), CHECK_TARGET_MS))
    speed = this_machine().speed
    shown = Table("a frame of", "ms", "on the reference", "Gaussian windows", "target", box=None)
    for name, ms, target_ms in costs:
        figures = (f"{one:.2f}" for one in (ms, ms * speed, ms / unit_ms))
        verdict = "met" if ms * speed <= target_ms else "missed"
        shown.add_row(name, *figures, f"≤ {target_ms:g} ms: {verdict}")
    Console(width=100).print(shown)
    print(f"one window takes {unit_ms:.2f} ms; speed of a core {speed:.2f} of the reference's")


if __name__ == "__main__":
    main()

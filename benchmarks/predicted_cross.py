"""A picture of the cross where the hand leads the gripper: `python -m benchmarks.predicted_cross`.

docs/predicted-cross.jpg: parts of the fixed views of a session of two sides over a relay of 200 ms
each way, with the outline of where the arm is now, at the instant when the hand had led the arm
furthest beyond that.
"""

from __future__ import annotations

import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import cv2
import numpy as np

from benchmarks.predicted import DOCS, FIXED, around_drawn
from tams_app.prediction.present import Correction, Shown
from tams_app.records import Image, MountPrediction
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.shared_ring import map_descriptor
from tams_app.station.mount_memory import MountMemory, PresentViews
from tests.faults.two_sides import HOST, HandSide, RobotSide
from tests.impaired_link import Conditions, ImpairedLink

ONE_WAY_MS, FPS = 200.0, 10
UPLINK_KBPS = 6000.0
WATCHED_S, EACH_S = 3.0, 0.05


@dataclass(frozen=True, slots=True)
class Instant:
    """The fixed views then, as received and as shown; how far beyond the arm the hand leads."""

    lead_m: float
    received: dict[str, Image]
    shown: dict[str, Shown]


def instants(folder: Path) -> list[Instant]:
    """Of a hand that goes across the workspace, those with an outline in each view."""
    way, found = Conditions(latency_ms=ONE_WAY_MS), list[Instant]()
    beliefs, put = list[MountPrediction](), MountMemory.put

    def keep(mount: MountMemory, belief: MountPrediction) -> None:
        beliefs.append(belief)
        put(mount, belief)

    budget = {"budget": {"mode": "feedback", "max_kbps": UPLINK_KBPS}}
    with (
        patch.object(MountMemory, "put", keep),
        RobotSide(folder / "robot", video={"fps": FPS}, policy=budget) as robot,
    ):
        robot.waits()
        with (
            ImpairedLink((HOST, robot.port), way, way) as link,
            HandSide(folder / "operator", link.port, predict="all") as side,
        ):
            station = side.session.side.station
            assert station is not None
            assert station.mount is not None
            block = map_descriptor(os.dup(station.mount.descriptor))
            views, clock = PresentViews(station.mount.cameras, block), MonotonicClock()
            side.moves()
            end_s = time.monotonic() + WATCHED_S
            while time.monotonic() < end_s:
                time.sleep(EACH_S)
                frames = {view: side.shown(view) for view in FIXED}
                if any(frame is None for frame in frames.values()):
                    continue
                now_ns = clock.now_ns()
                shown = {
                    view: views.show(view, frame.image, frame.capture_ns, now_ns)
                    for view, frame in frames.items()
                    if frame is not None
                }
                if all(one.correction is Correction.OUTLINE for one in shown.values()):
                    received = {view: one.image for view, one in frames.items() if one is not None}
                    found.append(Instant(_lead_m(beliefs[-1]), received, shown))
    return found


def _lead_m(belief: MountPrediction) -> float:
    commanded = belief.now if belief.commanded is None else belief.commanded
    return float(np.linalg.norm(commanded.position - belief.now.position))


def main() -> None:
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as name:
        furthest = max(instants(Path(name)), key=lambda one: one.lead_m)
    parts = [around_drawn(furthest.shown[view].image, furthest.received[view]) for view in FIXED]
    path = DOCS / "predicted-cross.jpg"
    cv2.imwrite(str(path), np.hstack(parts), [cv2.IMWRITE_JPEG_QUALITY, 85])
    print(f"{path}: the hand leads the arm by {1000 * furthest.lead_m:.0f} mm")


if __name__ == "__main__":
    main()

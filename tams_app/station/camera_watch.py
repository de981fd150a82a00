"""The check of the camera on the arm, where the frames come in."""

from __future__ import annotations

from tams_app.prediction.camera_check import CameraCheck
from tams_app.records import ShownFrame, TakeNote
from tams_app.runtime.shared_ring import open_block
from tams_app.station.mount_memory import MountMemory, PresentViews

MEASURE = "run_tams.py calibrate cameras --only lens,mount"


def misfit(view: str) -> str:
    """What is said once a camera is found not to be where it should be."""
    return (
        f"{view}: while the arm moves, the picture does not change as the camera's pose and lens "
        "say, so it is shown as received from now on; mount the camera as it was, or measure it: "
        f"{MEASURE}"
    )


class CameraWatch:
    """Reads where the arm was from the memory that all share, and tells it what is found."""

    def __init__(self, mount: MountMemory, note: TakeNote) -> None:
        """While `mount` has its name."""
        self._mount, self._note = mount, note
        self._checks: dict[str, tuple[PresentViews, CameraCheck]] = {}
        for view, camera in mount.cameras.items():
            if camera.on_arm:
                present = PresentViews({view: camera}, open_block(mount.name))
                self._checks[view] = present, CameraCheck(present.on_arm(view))

    def shown(self, frame: ShownFrame) -> None:
        """In the thread of the frame's view."""
        if frame.view not in self._checks:
            return
        present, check = self._checks[frame.view]
        present.read()
        if check.shown(frame):
            self._mount.camera_fits = False
            self._note("warning", misfit(frame.view))

"""What the operator is shown: the newest frames, and where the camera on the arm is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from tams_app.config import VideoConfig
from tams_app.recording.journal import Journal
from tams_app.records import ShownFrame
from tams_app.runtime.parts import Parts
from tams_app.video.live.frame_ring import SHOWN, FrameBlock, RingLayout

if TYPE_CHECKING:  # few sessions predict
    from tams_app.prediction.present import PredictedCamera
    from tams_app.station.mount_memory import CameraWatch, MountMemory


class Screen:
    """Memory for windows, for a simulated operator, and for those who score what is shown.

    `frames`: the frames shown. `mount`: where the camera on the arm is, by which its frames are
    corrected; None: none are.
    """

    def __init__(
        self,
        video: VideoConfig,
        parts: Parts,
        log: Journal,
        cameras: Mapping[str, PredictedCamera],
    ) -> None:
        """`cameras`: by view, those whose frames are corrected."""
        self._log = log
        self.frames = FrameBlock(RingLayout(SHOWN, video.views, video.width, video.height))
        parts.stack.callback(self.frames.close)
        self.mount: MountMemory | None = None
        self._camera_watch: CameraWatch | None = None
        if cameras:
            from tams_app.station.mount_memory import CameraWatch, MountMemory

            self.mount = MountMemory(cameras)
            parts.stack.callback(self.mount.close)
            self._camera_watch = CameraWatch(self.mount, log.note)

    def show(self, shown: ShownFrame) -> None:
        """In a thread for each view."""
        self._log.record(shown)
        self.frames.put(shown.view, shown.index, shown.shown_ns, shown.image, shown.capture_ns)
        if self._camera_watch is not None:
            self._camera_watch.shown(shown)

    def hide(self) -> None:
        """Once all other processes that read the memory have it open."""
        self.frames.hide()
        if self.mount is not None:
            self.mount.hide()


def mount_specification(mount: MountMemory | None) -> dict[str, Any]:
    """What a helper process makes `described_views` from; None: no view is corrected."""
    return {"mount_memory": "", "cameras": {}} if mount is None else mount.specification()

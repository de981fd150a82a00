"""The real devices as the session sees them."""

from __future__ import annotations

from hw.controller import Controller
from hw.gstreamer.camera import GstCamera
from hw.make_camera import make_camera
from hw.openvr.controller import OpenVrController
from tams_app.session.devices import Devices, Note


class HardwareDevices(Devices):
    """The configured arm, an OpenVR controller and one camera for each view.

    The session opens and closes them; whether one is there shows when it is opened.
    """

    def make_controller(self, note: Note) -> Controller:
        return OpenVrController(self._config.controller, self._clock, note)

    def make_cameras(self, note: Note) -> list[GstCamera]:
        config = self._config
        return [
            make_camera(view, config.cameras[view], config.video, self._clock, note)
            for view in config.video.views
        ]

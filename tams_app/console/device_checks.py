"""Whether the devices that the configuration names are there and fit to be used."""

from __future__ import annotations

from collections.abc import Iterator

from tams_app.config import CameraConfig, Config
from tams_app.console.doctor import Finding
from tams_app.errors import TamsError


def arm(config: Config) -> Iterator[Finding]:
    """The arm at the configured address."""
    if config.rig.enabled:
        return
    from hw.arms import arm_kind

    info = arm_kind(config.arm.model).find(config.arm)
    if info.problem:
        yield Finding("Arm", False, config.arm.host, info.problem)
    else:
        yield Finding("Arm", True, info.description)


def controller(config: Config) -> Iterator[Finding]:
    """The controller of the operator's hand, and the mapping of its buttons."""
    if config.rig.enabled:
        return
    from hw.openvr.controller import OpenVrController
    from hw.openvr.devices import list_controllers
    from tams_app.runtime.clock import MonotonicClock

    what, hand = "Controller", config.controller.hand
    try:
        OpenVrController(config.controller, MonotonicClock(), lambda *_: None)
        found = list_controllers()
    except TamsError as error:
        yield Finding(what, False, "", str(error))
        return
    mine = [info for info in found if info.role == hand and info.connected]
    detail = mine[0].controller_type if mine else f"none for the {hand} hand"
    yield Finding(what, bool(mine), detail, "switch it on and wake it, or set controller.hand")


def cameras(config: Config) -> Iterator[Finding]:
    """A camera for each view, with a mode that will do."""
    if config.rig.enabled:
        return
    for view, camera in config.cameras.items():
        yield _camera(view, camera, config)


def _camera(view: str, camera: CameraConfig, config: Config) -> Finding:
    from hw.make_camera import make_camera
    from tams_app.runtime.clock import MonotonicClock

    what, warnings = f"Camera {view}", list[str]()

    def note(_level: str, text: str) -> None:
        warnings.append(text.removeprefix(f"camera {view} "))

    try:
        device = make_camera(view, camera, config.video, MonotonicClock(), note)
        try:
            device.start()
        finally:
            device.close()
    except TamsError as error:
        return Finding(what, False, "", str(error).removeprefix(f"camera {view}: "))
    return Finding(what, True, "; ".join(warnings))

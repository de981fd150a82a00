"""`doctor`: arms, controllers and cameras, all that are there and those of the configuration."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import asdict, replace

from hw.arms import arm_kind
from hw.openvr.devices import ControllerInfo, list_controllers
from hw.v4l2.devices import CameraInfo, choose_camera, list_cameras
from tams_app.config import CameraConfig, Config
from tams_app.console.findings import Finding, attempted, tried
from tams_app.errors import TamsError
from tams_app.printing import Console

_TEXTURE = "from tams_app.faces.headset.texture import AtlasTexture; AtlasTexture().close()"
_LOOK_FRAMES, _FRAME_S = 30, 0.1  # at most, of a camera, for damaged ones


def show_devices(config: Config, as_json: bool = False, console: Console | None = None) -> None:
    """Print every device found, one line each, cameras with their modes.

    `as_json`: print one object instead. Nothing is moved, enabled or changed by looking. Whether
    the configuration can use them is what the doctor's checks say.
    """
    console = console or Console()
    arm = arm_kind(config.arm.model).find(config.arm)
    try:
        controllers, problem = list_controllers(), ""
    except TamsError as error:
        controllers, problem = [], str(error)
    cameras = list_cameras()
    if as_json:
        views = _views(cameras, config.cameras)
        tree = {
            "arm": {"host": config.arm.host, **asdict(arm)},
            "controllers": {"found": [asdict(info) for info in controllers], "problem": problem},
            "cameras": [{**asdict(info), "view": views.get(info.node)} for info in cameras],
        }
        console.out(json.dumps(tree, default=float))  # rates are fractions
        return
    for title, lines in (
        ("Arm", [arm.description]),
        ("Controllers", [problem] if problem else controller_lines(controllers)),
        ("Cameras", camera_lines(cameras, config.cameras)),
    ):
        console.print(title, style="bold")
        for line in lines:
            console.print(f"  {line}", soft_wrap=True)


def controller_lines(found: list[ControllerInfo]) -> Iterator[str]:
    """Each controller: hand, kind, battery, whether it is tracked."""
    if not found:
        yield "SteamVR knows no controller: switch one on."
    for info in found:
        battery = "" if info.battery is None else f", battery {info.battery:.0%}"
        standing = "tracked" if info.tracked else "not tracked"
        hand = info.role or "no hand"
        kind = f"{info.controller_type} {info.serial}".strip()
        yield f"{hand}: {kind}{battery}, {standing if info.connected else 'switched off'}"


def camera_lines(found: list[CameraInfo], cameras: Mapping[str, CameraConfig]) -> Iterator[str]:
    """Each camera, the view the configuration gives it, its stable paths and its modes."""
    if not found:
        yield "no camera is plugged in"
    views = _views(found, cameras)
    for info in found:
        view = views.get(info.node)
        yield f"{info}{f'  <- {view}' if view else ''}"
        for path in info.links:
            yield f"    {path}"
        for mode in info.modes:
            yield f"    {mode}"


def _views(found: list[CameraInfo], cameras: Mapping[str, CameraConfig]) -> dict[str, str]:
    """View by node, for the configured cameras that are there."""
    views = {}
    for view, camera in cameras.items():
        if camera.source != "v4l2":
            continue
        try:
            info = choose_camera(found, camera.name, camera.serial, camera.path)
        except TamsError:  # which of them is missing is the doctor's to say
            continue
        views[info.node] = view
    return views


def arm(config: Config) -> Iterator[Finding]:
    """The arm at the configured address."""
    if config.rig.enabled:
        return
    info = arm_kind(config.arm.model).find(config.arm)
    if info.problem:
        yield Finding("Arm", False, config.arm.host, info.problem)
    else:
        yield Finding("Arm", True, info.description)


def controller(config: Config) -> Iterator[Finding]:
    """The operator's controller; of a tracked one the mapping of its buttons too."""
    device = config.controller.device
    if config.operator_is_simulated or device == "keyboard":
        return
    if device not in ("auto", "openvr"):
        found_one = attempted("Controller", _start_controller, config)
        yield replace(found_one, detail=device if found_one.ok else "")
        return
    from hw.openvr.controller import OpenVrController
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


def _start_controller(config: Config) -> None:
    from hw.make_controller import make_controller
    from tams_app.runtime.clock import MonotonicClock

    made = make_controller(config.controller, config.hand, MonotonicClock(), lambda *_: None)
    with closing(made):
        made.start()


def headset(config: Config) -> Iterator[Finding]:
    """OpenGL for the views in the headset, where they are wanted."""
    from tams_app.faces.display import has_display
    from tams_app.faces.session_face import headset_is_wanted

    if config.headless or not has_display() or not headset_is_wanted(config):
        return
    reason = tried(_TEXTURE)
    fix = "apt-get install libgl1 libgl1-mesa-dri, or set headset.show to never"
    yield Finding("OpenGL for the headset", not reason, reason, fix)


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
        with closing(make_camera(view, camera, config.video, MonotonicClock(), note)) as device:
            device.start()
            frames = (device.next_frame(_FRAME_S) for _ in range(_LOOK_FRAMES))
            damaged = sum(frame is not None and frame.damaged for frame in frames)
    except TamsError as error:
        return Finding(what, False, "", str(error).removeprefix(f"camera {view}: "))
    if damaged:
        return Finding(what, False, f"{damaged} of its frames arrived damaged", "; ".join(warnings))
    return Finding(what, True, "; ".join(warnings))

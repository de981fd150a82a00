"""`run_tams.py doctor --devices`: the arms, controllers and cameras that are there."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict

from hw.arms import arm_kind
from hw.openvr.devices import ControllerInfo, list_controllers
from hw.v4l2.devices import CameraInfo, choose_camera, list_cameras
from tams_app.config import CameraConfig, Config
from tams_app.errors import TamsError
from tams_app.printing import Console


def show_devices(config: Config, as_json: bool = False, console: Console | None = None) -> int:
    """Print every device found, one line each, cameras with their modes; always 0.

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
        return 0
    for title, lines in (
        ("Arm", [arm.description]),
        ("Controllers", [problem] if problem else controller_lines(controllers)),
        ("Cameras", camera_lines(cameras, config.cameras)),
    ):
        console.print(title, style="bold")
        for line in lines:
            console.print(f"  {line}", soft_wrap=True)
    return 0


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

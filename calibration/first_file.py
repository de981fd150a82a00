"""The wizard of `init`: asks what the place has, and writes the first configuration file."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calibration.kit import WizardUI
from hw.arms import ARM_KINDS, arm_kind
from hw.make_controller import DEVICES
from hw.v4l2.devices import CameraInfo, choose_mode, list_cameras
from tams_app.config import Config, load_config
from tams_app.config.marks import TEMPLATE, filled, unset_keys
from tams_app.console.devices import controller
from tams_app.errors import ConfigError, DeviceError, not_one_of
from tams_app.outputs import write_file
from tams_app.robot.build import check_names

LATER = "none"  # in place of a camera that is not there yet
SIDES = ("right", "left")


@dataclass(frozen=True, slots=True)
class Answers:
    """What the command line says already; the rest is asked for."""

    model: str | None = None
    host: str | None = None
    hand: str | None = None
    side: str | None = None
    cameras: Sequence[str] = ()  # VIEW=SERIAL_OR_PATH


def write_first_file(ui: WizardUI, path: Path, given: Answers) -> None:
    """Ask `ui` for what is not given, and write the template with the answers to `path`.

    ConfigError if `path` is there already, for an answer that cannot be, and, where there is no
    terminal, with what has to be given.
    """
    if path.exists() or path.is_symlink():
        raise ConfigError(f"{path}: is there already; give another name, or delete it")
    ours = load_config(TEMPLATE)
    cameras = _given_cameras(given.cameras, ours)
    found = list_cameras()
    if not ui.attended:
        _require_all(given, cameras, ours, found)
    model = given.model or _ask_model(ui)
    host = given.host or _ask_host(ui, ours, model)
    hand = given.hand or _ask_hand(ui, ours)
    side = given.side
    if side is None and ui.attended and hand in ("auto", "openvr"):
        side = ui.choice("Which hand holds it?", {side: side for side in SIDES})
    cameras |= _ask_cameras(ui, ours, cameras, found)
    values = {
        "arm.model": ("model", json.dumps(model)),
        "arm.host": ("host", json.dumps(host)),
        "controller.device": ("device", json.dumps(hand)),
        "controller.hand": ("hand", json.dumps(side or SIDES[0])),
    }
    overrides: dict[str, object] = {key: json.loads(value) for key, (_, value) in values.items()}
    for view, chosen in cameras.items():
        if chosen == LATER:
            continue
        key, pixel_format = _key_of(chosen, found, ours)
        values[f"cameras.{view}.serial"] = (key, json.dumps(chosen))
        values[f"cameras.{view}.pixel_format"] = ("pixel_format", pixel_format)
        overrides[f"cameras.{view}"] = {key: chosen, "pixel_format": pixel_format}
    check_names(load_config(TEMPLATE, overrides))  # before anything is written
    arm_kind(model)
    write_file(path, filled(TEMPLATE.read_text(encoding="utf-8"), values))
    left = "; ".join(f"{key} (line {line})" for key, line in unset_keys(path).items())
    ui.print(f"{path}: written. Still to be set there, each explained beside it: {left}.")
    ui.print(f"Next: run_tams.py doctor --config {shlex.quote(str(path))}")


def _given_cameras(given: Sequence[str], ours: Config) -> dict[str, str]:
    cameras = {}
    for one in given:
        view, equals, chosen = one.partition("=")
        if not equals or not chosen:
            raise ConfigError(f"--camera: {one!r} is not VIEW=SERIAL_OR_PATH")
        if view not in ours.video.views:
            raise ConfigError(f"--camera: {not_one_of(view, ours.video.views)}")
        cameras[view] = chosen
    return cameras


def _require_all(
    given: Answers, cameras: dict[str, str], ours: Config, found: list[CameraInfo]
) -> None:
    """ConfigError with the options that are needed where there is no terminal to ask at."""
    needed = [
        *([] if given.host else ["--host ADDRESS"]),
        *([] if given.hand else [f"--hand DEVICE ({', '.join(DEVICES)})"]),
        *(f"--camera {view}=…" for view in ours.video.views if view not in cameras),
    ]
    if needed:
        raise ConfigError(
            f"there is no terminal to ask at: give {', '.join(needed)}; cameras found: "
            f"{'; '.join(map(str, found)) or 'none'} (VIEW={LATER} leaves one for later)"
        )


def _ask_model(ui: WizardUI) -> str:
    models = list(ARM_KINDS)
    if len(models) == 1:
        return models[0]
    return ui.choice("Which arm is it?", {model: arm_kind(model).title for model in models})


def _ask_host(ui: WizardUI, ours: Config, model: str) -> str:
    kind = arm_kind(model)
    while True:
        question = f"{kind.title}: address of its control box? (Enter: {ours.arm.host})"
        host = ui.line(question) or ours.arm.host
        found = kind.find(ours.arm.model_copy(update={"model": model, "host": host}))
        if not found.problem:
            ui.print(found.description)
            return host
        ui.print(found.problem)
        if ui.yes("Write this address anyway? (Enter: yes)", default=True):
            return host


def _ask_hand(ui: WizardUI, ours: Config) -> str:
    """A device, after showing which of them are here."""
    for device in DEVICES:
        settings = ours.controller.model_copy(update={"device": device})
        findings = list(controller(ours.model_copy(update={"controller": settings})))
        missing = [one.fix for one in findings if not one.ok]
        ui.print(f"  {device}: {missing[0] if missing else 'here'}")
    return ui.choice("What does the operator hold?", {device: device for device in DEVICES})


def _ask_cameras(
    ui: WizardUI, ours: Config, given: dict[str, str], found: list[CameraInfo]
) -> dict[str, str]:
    """A serial number or path for each view that has none yet, or LATER."""
    wanted = [view for view in ours.video.views if view not in given]
    if not wanted:
        return {}
    if not found:
        ui.print("No camera is plugged in: the cameras are left for later.")
        return dict.fromkeys(wanted, LATER)
    for number, info in enumerate(found, start=1):
        ui.print(f"  {number}: {info}")
    numbers = {str(number): stable_name(info, found) for number, info in enumerate(found, start=1)}
    options = {**numbers, LATER: "later"}
    chosen = {view: ui.choice(f"Camera of the view {view}?", options) for view in wanted}
    return {view: numbers.get(number, LATER) for view, number in chosen.items()}


def stable_name(info: CameraInfo, found: Sequence[CameraInfo]) -> str:
    """The camera's serial number where no other has it, else a path that stays the same."""
    if info.serial and [one.serial for one in found].count(info.serial) == 1:
        return info.serial
    by_path = [link for link in info.links if "/by-path/" in link]
    return (by_path or list(info.paths))[-1]


def _key_of(chosen: str, found: Sequence[CameraInfo], ours: Config) -> tuple[str, str]:
    """The key that `chosen` is for, `serial` or `path`, and the camera's pixel format."""
    key, video = "path" if chosen.startswith("/") else "serial", ours.video
    for info in found:
        if chosen == info.serial or chosen in info.paths:
            for mjpeg, pixel_format in ((True, "mjpeg"), (False, "raw")):
                try:
                    choose_mode(info, mjpeg, video.width, video.height, video.fps)
                except DeviceError:  # the other one, or the doctor lists the modes that there are
                    continue
                return key, pixel_format
    return key, "mjpeg"

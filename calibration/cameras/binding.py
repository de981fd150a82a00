"""Which camera is which view: the person waves before each, as prompted."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

from rich.table import Table
from rich.text import Text

from calibration.cameras.bench import Bench, Task, agreed, until_done
from calibration.cameras.motion import Attribution, MotionMeter, attribute
from calibration.ui import WizardUI
from tams_app.errors import DeviceError

_STEP_BACK_S = 8.0
_REST_S = 2.0
_WINDOW_S = 1.5
_STEP_S = 0.5
_WAITING_S = 15.0
_BAR = 30
NAMES = {"eih": "eye in hand (EIH)", "gt": "global top (GT)", "gs": "global side (GS)"}


def bind_views(ui: WizardUI, bench: Bench, views: Sequence[str]) -> dict[str, str]:
    """Camera by view; DeviceError if there are too few cameras or the person gives up."""
    for sentence in bench.refused:
        ui.say(f"Left out: {sentence}")
    if len(bench.cameras) < len(views):
        found = ", ".join(bench.cameras) or "none"
        raise DeviceError(
            f"{len(views)} views need as many cameras; those that can be used: {found}"
        )
    ui.say(f"{len(bench.cameras)} cameras: {', '.join(bench.cameras)}.")
    meters = _at_rest(ui, bench)
    taken: dict[str, str] = {}
    for view in views:
        camera = _wait_for_wave(ui, bench, meters, view, taken)
        ui.say(f"{view.upper()} is {camera}.")
        taken[camera] = view
    return {view: camera for camera, view in taken.items()}


def _at_rest(ui: WizardUI, bench: Bench) -> dict[str, MotionMeter]:
    bench.prompt(Task.REST, "")
    if bench.attended:
        ui.say(f"Step out of all images within {_STEP_BACK_S:g} s; Enter if you are out.")
        for _ in until_done(ui, bench, bench.cameras, _STEP_BACK_S):
            pass  # what moves now is not at rest yet
    ui.say(f"Keep out and let everything rest for {_REST_S:g} s.")
    meters = {camera: MotionMeter() for camera in bench.cameras}
    for shot in bench.shots(bench.cameras, _REST_S):
        meters[shot.camera].rest(shot.frame.image)
    return meters


def _wait_for_wave(
    ui: WizardUI, bench: Bench, meters: Mapping[str, MotionMeter], view: str, taken: dict[str, str]
) -> str:
    """The camera that was waved before; asks again until it is clear or not wanted."""
    while True:
        ui.say(f"Wave a hand close before the camera {NAMES.get(view, view)}, and only there.")
        bench.prompt(Task.WAVE, view)
        found = _watch(ui, bench, meters, taken)
        if found.camera:
            return found.camera
        ui.say(f"Not clear: {found.reason}.")
        if not agreed(ui, bench, "Try again?"):
            raise DeviceError(f"which camera is {view.upper()} was not found out: {found.reason}")


def _watch(
    ui: WizardUI, bench: Bench, meters: Mapping[str, MotionMeter], taken: dict[str, str]
) -> Attribution:
    length = round(_WINDOW_S * bench.fps)
    moved: dict[str, deque[float]] = {name: deque(maxlen=length) for name in bench.cameras}
    found = attribute(moved, taken)
    for _ in range(round(_WAITING_S / _STEP_S)):
        for shot in bench.shots(bench.cameras, _STEP_S):
            moved[shot.camera].append(meters[shot.camera].moved(shot.frame.image))
        found = attribute({name: list(seen) for name, seen in moved.items()}, taken)
        ui.show(_bars(found.shares, taken))
        if found.camera:
            break
    return found


def _bars(shares: Mapping[str, float], taken: Mapping[str, str]) -> Table:
    table = Table(box=None, show_header=False)
    for name, share in shares.items():
        bar = "█" * min(_BAR, round(share * 3 * _BAR))
        view = taken.get(name, "").upper()
        # the camera's own name may look like markup
        table.add_row(Text(name), view, f"{bar:<{_BAR}}", f"{share:.0%} moves")
    return table

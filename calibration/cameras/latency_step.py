"""The step that measures each camera's latency before a screen that flashes."""

from __future__ import annotations

from collections.abc import Sequence

from calibration.cameras.bench import Bench, Task, until_done
from calibration.cameras.findings import Findings
from calibration.cameras.flashes import camera_latency
from calibration.ui import WizardUI

_POINTING_S = 120.0
_FLASHING_S = 20.0


def measure_latency(ui: WizardUI, bench: Bench, views: Sequence[Findings]) -> None:
    """Light to time stamp of each view; a view that does not see the flashes is left out."""
    with bench.screen() as flashes:
        ui.print("A window flashes black and white.")
        for found in views:
            view = found.view.upper()
            ui.print(f"{view}: point it at the window, so that it fills most of the image; Enter.")
            bench.prompt(Task.SHOW_SCREEN, found.view)
            for _ in until_done(ui, bench, [found.camera], _POINTING_S):
                pass  # not pointed at it yet
            ui.print(f"{view}: keep still for {_FLASHING_S:g} s.")
            shots = list(bench.shots([found.camera], _FLASHING_S))
            levels = [float(shot.frame.image[::4, ::4].mean()) for shot in shots]
            try:
                found.latency = camera_latency(
                    levels, [shot.frame.capture_ns for shot in shots], flashes
                )
            except ValueError as error:
                ui.print(f"{view}: no latency: {error}: nearer, and no other light on the screen.")
                continue
            ui.print(
                f"{view}: light to time stamp {found.latency.ms:.0f} ± {found.latency.error_ms:.0f}"
                f" ms, the display's own delay included ({found.latency.flashes} flashes)."
            )

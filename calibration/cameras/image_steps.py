"""The steps on a camera that is bound: focus, exposure, frame rate and latency."""

from __future__ import annotations

from collections.abc import Sequence

from rich.text import Text

from calibration.cameras.bench import Bench, Settings, Shot, agreed, until_done
from calibration.cameras.findings import Findings
from calibration.cameras.flashes import camera_latency
from calibration.cameras.image_quality import (
    Sharpness,
    blur_words,
    exposure_advice,
    focus_advice,
    measure_exposure,
    sharpness,
)
from calibration.cameras.timing import FEWEST_FRAMES, clock_problem, measure_rate, rate_advice
from calibration.ui import WizardUI
from hw.sim.operator.at_cameras import Task
from tams_app.errors import DeviceError

FOCUS, EXPOSURE, RATE = "focus", "exposure", "rate"
_FOCUS_S = 180.0
_POINTING_S = 120.0
_FLASHING_S = 20.0
_LOOK_S = 10.0  # for a drift of 100 ppm and a rate to 0.1 %
_FRAMES = 90  # of these, for light and focus
_FOCUS_EVERY = 3
_BAR = 40
_SAME_LIGHT = 0.15  # of the mean grey level


def focus(ui: WizardUI, bench: Bench, found: Findings) -> None:
    """Show how sharp it is until the person is content."""
    view = found.view.upper()
    ui.print(
        f"{view}: point it at its scene and turn the focus ring until the bar is highest; "
        "then press Enter. A camera without a ring: just Enter."
    )
    bench.prompt(Task.FOCUS, found.view)
    best = 0.0
    for shot in until_done(ui, bench, [found.camera], _FOCUS_S, _FOCUS_EVERY):
        measured = sharpness(shot.frame.image)
        best = max(best, measured.tenengrad)
        ui.show(_bar(view, measured, best))


def look(ui: WizardUI, bench: Bench, found: Findings, want: Sequence[str]) -> None:
    """Measure with a scene at rest and say what is wrong; `want`: of focus, exposure, rate."""
    view = found.view.upper()
    ui.print(f"{view}: keep still for {_LOOK_S:g} s.")
    bench.prompt(Task.REST, "")
    shots = list(bench.shots([found.camera], _LOOK_S))
    if len(shots) < FEWEST_FRAMES:
        raise DeviceError(
            f"{found.camera} gave {len(shots)} images in {_LOOK_S:g} s; look at its cable"
        )
    found.image = shots[-1].frame.image
    found.sharpness = sharpness(found.image)
    found.exposure = measure_exposure([shot.frame.image for shot in shots[-_FRAMES:]])
    chosen = bench.chosen_settings(found.camera)
    advice = []
    if FOCUS in want:
        advice += [line for line in (focus_advice(found.sharpness),) if line]
    if EXPOSURE in want:
        advice += exposure_advice(found.exposure, chosen.exposure_us, bench.fps, bench.width)
    if RATE in want:
        advice += _rate(found, shots, bench.fps)
    found.advice += advice
    ui.print(f"{view}: " + ("; ".join(advice) if advice else "sees well") + ".")


def offer_settings(ui: WizardUI, bench: Bench, found: Findings) -> None:
    """Fix what the automatic has chosen, if the image then stays as it was and the person wants.

    Cameras may report another exposure than their automatic uses: the image shows it.
    """
    chosen = bench.chosen_settings(found.camera)
    if chosen == Settings() or found.exposure is None:
        return
    period_us = 1e6 / bench.fps
    if chosen.exposure_us is not None and chosen.exposure_us > period_us:
        chosen = Settings(round(period_us, -2), chosen.white_balance_k)
    words = _words(chosen)
    if not agreed(ui, bench, f"Fix {found.view.upper()} at {words}?"):
        return
    bench.use_settings(found.camera, chosen)
    images = [shot.frame.image for shot in bench.shots([found.camera], 1.0)]
    if not images:
        raise DeviceError(f"{found.camera} gives no image at {words}; look at its cable")
    fixed = measure_exposure(images)
    before = found.exposure.mean_grey
    if abs(fixed.mean_grey - before) > _SAME_LIGHT * max(before, 1.0):
        bench.use_settings(found.camera, Settings())
        ui.print(
            f"At {words} the image is another (mean grey {fixed.mean_grey:.0f}, it was "
            f"{before:.0f}): this camera does not tell what its automatic uses. It stays automatic."
        )
        return
    found.settings, found.exposure = chosen, fixed


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


def _rate(found: Findings, shots: Sequence[Shot], fps: int) -> list[str]:
    captured = [shot.frame.capture_ns for shot in shots]
    found.rate = measure_rate(captured)
    problem = clock_problem(captured, [shot.delivered_ns for shot in shots])
    return [*rate_advice(found.rate, fps), *([problem] if problem else [])]


def _words(settings: Settings) -> str:
    parts = []
    if settings.exposure_us is not None:
        parts.append(f"{settings.exposure_us / 1000:.1f} ms exposure")
    if settings.white_balance_k is not None:
        parts.append(f"{settings.white_balance_k} K white balance")
    return " and ".join(parts)


def _bar(view: str, measured: Sharpness, best: float) -> Text:
    filled = round(_BAR * measured.tenengrad / best) if best else 0
    line = "█" * filled + "·" * (_BAR - filled)
    return Text(f"{view} {line}| best so far; {blur_words(measured)}")

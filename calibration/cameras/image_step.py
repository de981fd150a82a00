"""Focus, exposure, frame rate and clock of one camera."""

from __future__ import annotations

from collections.abc import Sequence

from rich.text import Text

from calibration.cameras.asking import agreed, until_done
from calibration.cameras.bench import Bench, Settings, Shot, Task
from calibration.cameras.exposure import exposure_advice, measure_exposure
from calibration.cameras.findings import Findings
from calibration.cameras.focus import Sharpness, blur_words, focus_advice, sharpness
from calibration.cameras.timing import FEWEST_FRAMES, check_clock, measure_rate, rate_advice
from calibration.desk import Desk
from tams_app.errors import DeviceError

_FOCUS_S = 180.0
_LOOK_S = 10.0  # for a drift of 100 ppm and a rate to 0.1 %
_PICTURES = 90  # of these, for light and focus
_FOCUS_EVERY = 3
_BAR = 40
_SAME_LIGHT = 0.15  # of the mean grey level


def focus(desk: Desk, bench: Bench, found: Findings) -> None:
    """Show how sharp it is until the person is content."""
    view = found.view.upper()
    desk.say(
        f"{view}: point it at its scene and turn the focus ring until the bar is highest; "
        "then press Enter. A camera without a ring: just Enter."
    )
    bench.prompt(Task.FOCUS, found.view)
    best = 0.0
    for shot in until_done(desk, bench, [found.camera], _FOCUS_S, _FOCUS_EVERY):
        measured = sharpness(shot.frame.image)
        best = max(best, measured.tenengrad)
        desk.show(_bar(view, measured, best))


def look(desk: Desk, bench: Bench, found: Findings, want: Sequence[str]) -> None:
    """Measure with a scene at rest and say what is wrong; `want`: of focus, exposure, rate."""
    view = found.view.upper()
    desk.say(f"{view}: keep still for {_LOOK_S:g} s.")
    bench.prompt(Task.REST, "")
    shots = list(bench.shots([found.camera], _LOOK_S))
    if len(shots) < FEWEST_FRAMES:
        raise DeviceError(
            f"{found.camera} gave {len(shots)} pictures in {_LOOK_S:g} s; look at its cable"
        )
    found.image = shots[-1].frame.image
    found.sharpness = sharpness(found.image)
    found.exposure = measure_exposure([shot.frame.image for shot in shots[-_PICTURES:]])
    chosen = bench.chosen_settings(found.camera)
    advice = []
    if "focus" in want:
        advice += [line for line in (focus_advice(found.sharpness),) if line]
    if "exposure" in want:
        advice += exposure_advice(found.exposure, chosen.exposure_us, bench.fps, bench.width)
    if "rate" in want:
        advice += _rate(found, shots, bench.fps)
    found.advice += advice
    desk.say(f"{view}: " + ("; ".join(advice) if advice else "sees well") + ".")


def offer_settings(desk: Desk, bench: Bench, found: Findings) -> None:
    """Fix what the automatic has chosen, if the picture then stays as it was and the person wants.

    Cameras may report another exposure than their automatic uses: the picture tells.
    """
    chosen = bench.chosen_settings(found.camera)
    if chosen == Settings() or found.exposure is None:
        return
    period_us = 1e6 / bench.fps
    if chosen.exposure_us is not None and chosen.exposure_us > period_us:
        chosen = Settings(round(period_us, -2), chosen.white_balance_k)
    words = _words(chosen)
    if not agreed(desk, bench, f"Fix {found.view.upper()} at {words}?", otherwise=False):
        return
    bench.use_settings(found.camera, chosen)
    pictures = [shot.frame.image for shot in bench.shots([found.camera], 1.0)]
    if not pictures:
        raise DeviceError(f"{found.camera} gives no picture at {words}; look at its cable")
    fixed = measure_exposure(pictures)
    before = found.exposure.mean_grey
    if abs(fixed.mean_grey - before) > _SAME_LIGHT * max(before, 1.0):
        bench.use_settings(found.camera, Settings())
        desk.say(
            f"At {words} the picture is another (mean grey {fixed.mean_grey:.0f}, it was "
            f"{before:.0f}): this camera does not tell what its automatic uses. It stays automatic."
        )
        return
    found.settings, found.exposure = chosen, fixed


def _rate(found: Findings, shots: Sequence[Shot], fps: int) -> list[str]:
    captured = [shot.frame.capture_ns for shot in shots]
    found.rate = measure_rate(captured)
    found.clock = check_clock(captured, [shot.delivered_ns for shot in shots])
    advice = rate_advice(found.rate, fps)
    return [*advice, found.clock.problem] if found.clock.problem else advice


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

"""How long light takes to the timestamp, on to the operator's eye, and how the cameras differ."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from rich.text import Text

from calibration.cameras.bench import Bench, Task
from calibration.cameras.common_event import (
    offsets_from_latencies,
    offsets_from_switchings,
    switchings,
)
from calibration.cameras.findings import Findings
from calibration.cameras.latency import (
    FEWEST_READINGS,
    ScreenTimes,
    camera_latency,
    chained,
    latency,
)
from calibration.cameras.stream_delay import stream_delays_ms
from calibration.cameras.time_pattern import PatternReader
from calibration.desk import Desk
from tams_app.config import Config
from tams_app.runtime.clock import NS_PER_MS, Clock

_READINGS = 60
_PATIENCE_S = 30.0
_CHUNK_S = 0.5
_STREAM_S = 3.0
_LIGHT_S = 15.0


def measure_latency(
    desk: Desk, bench: Bench, views: Sequence[Findings], config: Config, clock: Clock
) -> None:
    """Glass to capture and capture to shown of each view; what fails is said and left out."""
    read_screens(desk, bench, views)
    for found in views:
        _stream(desk, bench, found, config, clock)


def read_screens(desk: Desk, bench: Bench, views: Sequence[Findings]) -> None:
    """Glass to capture of each view, and how far the cameras differ by it."""
    with bench.screen() as screen:
        desk.say(f"The pattern counts on the screen ({screen.method}).")
        for found in views:
            _read_screen(desk, bench, found, screen)
    _offsets_by_screen(desk, views, screen)


def measure_offsets_by_light(desk: Desk, bench: Bench, views: Sequence[Findings]) -> None:
    """The cameras' clocks against the first view's, from a light that all of them see."""
    desk.say(f"Switch a light off and on for {_LIGHT_S:g} s, about once a second.")
    bench.prompt(Task.SWITCH_LIGHT, "")
    names = {found.camera: found for found in views}
    levels: dict[str, list[float]] = {name: [] for name in names}
    times: dict[str, list[int]] = {name: [] for name in names}
    for shot in bench.shots(list(names), _LIGHT_S):
        levels[shot.camera].append(float(shot.frame.image[::4, ::4].mean()))
        times[shot.camera].append(shot.frame.capture_ns)
    switched = {name: switchings(levels[name], times[name]) for name in names}
    reference = views[0]
    try:
        offsets = offsets_from_switchings(switched, reference.camera)
    except ValueError as error:
        desk.say(f"The clocks' offsets cannot be told: {error}.")
        return
    for name, offset in offsets.items():
        names[name].offset = offset
        desk.say(
            f"{names[name].view.upper()} sees it {offset.ms:+.1f} ± {offset.error_ms:.1f} ms after "
            f"{reference.view.upper()} ({offset.events} switchings)."
        )


def _read_screen(desk: Desk, bench: Bench, found: Findings, screen: ScreenTimes) -> None:
    view = found.view.upper()
    desk.say(f"{view}: point it at the screen, so that the pattern fills most of the image.")
    bench.prompt(Task.SHOW_SCREEN, found.view)
    reader, counts, times, reasons = PatternReader(), list[int](), list[int](), Counter[str]()
    for _ in range(round(_PATIENCE_S / _CHUNK_S)):
        for shot in bench.shots([found.camera], _CHUNK_S):
            reading = reader.read(shot.frame.image)
            if reading.reason:
                reasons[reading.reason] += 1
                continue
            counts.append(reading.count)
            times.append(shot.frame.capture_ns)
        last = f": {reasons.most_common(1)[0][0]}" if reasons and not counts else ""
        desk.show(Text(f"{view}: {len(counts)} of {_READINGS} read{last}"))
        if len(counts) >= _READINGS:
            break
    try:
        found.to_capture = camera_latency(times, counts, screen)
    except ValueError as error:
        why = f"; mostly: {reasons.most_common(1)[0][0]}" if reasons else ""
        desk.say(f"{view}: no latency: {error}{why}.")
        return
    measured = found.to_capture
    desk.say(
        f"{view}: light to capture {measured.median_ms:.1f} ± {measured.error_ms:.1f} ms "
        f"(5 to 95 %: {measured.p5_ms:.1f} to {measured.p95_ms:.1f} ms; the screen's refresh of "
        f"{screen.period_ns / NS_PER_MS:.1f} ms is the limit)."
    )


def _stream(desk: Desk, bench: Bench, found: Findings, config: Config, clock: Clock) -> None:
    view = found.view.upper()
    bench.prompt(Task.REST, "")
    delays = stream_delays_ms(found.view, config, bench.live(found.camera, _STREAM_S), clock)
    if len(delays) < FEWEST_READINGS:
        desk.say(f"{view}: only {len(delays)} images came through encoder and decoder.")
        return
    found.to_shown = latency(delays, 0.0, outlier_ms=None)
    desk.say(
        f"{view}: capture to shown {found.to_shown.median_ms:.1f} ms through encoder, loopback and "
        "decoder (without network, window and display)."
    )
    if found.to_capture is not None:
        found.in_all = chained(found.to_capture, found.to_shown)
        desk.say(f"{view}: light to shown {found.in_all.median_ms:.1f} ms in all.")


def _offsets_by_screen(desk: Desk, views: Sequence[Findings], screen: ScreenTimes) -> None:
    samples = {
        found.camera: found.to_capture.samples_ms.tolist()
        for found in views
        if found.to_capture is not None
    }
    reference = views[0].camera
    if reference not in samples or len(samples) < 2:
        return
    offsets = offsets_from_latencies(samples, reference, screen.period_ns / NS_PER_MS)
    for found in views:
        offset = found.offset = offsets.get(found.camera)
        if offset is not None:
            desk.say(
                f"{found.view.upper()} timestamps it {offset.ms:+.1f} ± {offset.error_ms:.1f} ms "
                f"after {views[0].view.upper()}."
            )

"""`run_tams.py calibrate cameras`: which camera is which, its latency, lens and mount."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from calibration.cameras import measuring
from calibration.cameras.bench import Bench, LiveBench, Task, agreed
from calibration.cameras.binding import bind_views
from calibration.cameras.board import Board
from calibration.cameras.flashes import check_display
from calibration.cameras.measuring import LENS, MOUNT, Findings, findings_figure
from calibration.kit import WizardUI
from calibration.options import CameraOptions
from calibration.store import Calibration, utc_now
from calibration.wizard import Wizard
from hw.arms import arm_kind
from tams_app.config import CameraConfig
from tams_app.config.whole import REMOVED
from tams_app.errors import ConfigError, SetupError, TamsError, not_one_of
from tams_app.records import Lens, Pose
from tams_app.rotation import Rotation
from tams_app.runtime.clock import MonotonicClock

KIND = "cameras"
WHICH, LATENCY = "which", "latency"
STEPS = (WHICH, LATENCY, LENS, MOUNT)  # in the order in which they are done
_NOWHERE = Pose(np.zeros(3), Rotation.identity())
_LOOK_S = 0.5  # for the figure
_OFFER = "Measure the latency, with a screen that the cameras can be pointed at?"


class CameraWizard(Wizard[CameraOptions]):
    """Which camera is which view, and what is measured of each."""

    _steps: tuple[str, ...]
    _bench: Bench  # open while it measures
    _found: Sequence[Findings] = ()  # of each view, once its camera is known

    def __init__(self, ui: WizardUI, options: CameraOptions, bench: Bench | None = None) -> None:
        """`bench`: other cameras than the options name."""
        super().__init__(ui, options)
        self._given = bench

    def check(self) -> None:
        self._steps = chosen_steps(self.options.only)

    def prepare(self) -> None:
        if self.config.rig.enabled and not self.options.sim:
            raise ConfigError(
                "this configuration uses the simulated rig, which brings its own cameras: give "
                "--sim, or --config with your laboratory's"
            )

    def measure(self) -> Calibration | None:
        with closing(self._given or self._open()) as bench:
            self._bench = bench
            if bench.attended:
                self.require_person()
            else:
                self.ui.print("A simulated person does what is asked for here.")
            if MOUNT in self._steps:
                with bench.listening():
                    pass  # one that does not report is refused before anything is measured
            cameras = (
                bind_views(self.ui, bench, self.config.video.views)
                if WHICH in self._steps
                else self._bound()
            )
            self._found = [Findings(view, cameras[view]) for view in self.config.video.views]
            self._measure()
            return self.partial()

    def partial(self) -> Calibration | None:
        if not self._found:
            return None
        return Calibration(
            KIND,
            {"cameras": {each.view: self._keys(each) for each in self._found}},
            self._bench.source,
            {each.view: each.quality() for each in self._found},
            not self._bench.attended,
        )

    def drawn(self) -> Figure | None:
        return findings_figure(self._found)

    def _open(self) -> Bench:
        if self.options.sim:
            from calibration.cameras.simulated import SimulatedBench  # only this needs MuJoCo

            return SimulatedBench(self.config, self.options.seed)
        if LATENCY in self._steps:
            check_display()
        return LiveBench(self.config.video, self.config.arm, MonotonicClock())

    def _measure(self) -> None:
        steps, ui, bench = self._steps, self.ui, self._bench
        bench.prompt(Task.REST, "")
        for each in self._found:
            for frame in bench.shots([each.camera], _LOOK_S):
                each.image = frame.image
        if LATENCY in steps:
            measuring.measure_latency(ui, bench, self._found)
        elif not self.options.only and agreed(ui, bench, _OFFER):
            try:
                measuring.measure_latency(ui, bench, self._found)
            except SetupError as error:
                ui.print(f"Left out: {error}.")
        self._measure_with_board()

    def _measure_with_board(self) -> None:
        """Lenses and mounts; TamsError if they alone were asked for, and none was found."""
        steps, ui, bench = self._steps, self.ui, self._bench
        board = Board(self.options.square_mm)
        if LENS in steps:
            for each in self._found:
                measuring.measure_lens(ui, bench, board, each)
        if MOUNT in steps:
            figure = arm_kind(self.config.arm.model).figure()
            try:
                measuring.measure_mounts(ui, bench, board, self._found, self._lenses(), figure)
            except SetupError as error:
                ui.print(f"No mount: {error}.")
        nothing = all(each.lens is None and each.mount is None for each in self._found)
        if nothing and set(steps) <= {WHICH, LENS, MOUNT} and {LENS, MOUNT} & set(steps):
            raise TamsError("no lens and no mount was found: nothing is written")

    def _lenses(self) -> dict[str, Lens]:
        """By view, for the bench's pictures: measured now, else of the configuration."""
        lenses = {}
        for each in self._found:
            lens = None if each.lens is None else each.lens.lens
            before = self._before(each)
            if lens is None and before is not None and before.lens is not None:
                size = self._bench.width, self._bench.height
                lens = before.lens.at(_NOWHERE, "").scaled_to(*size)
            if lens is not None:
                lenses[each.view] = lens
        return lenses

    def _before(self, found: Findings) -> CameraConfig | None:
        """What the configuration has of the view's camera, if it is the same one."""
        before = self.config.cameras.get(found.view)
        same = before is not None and self._bench.camera_of(before) == found.camera
        return before if same else None

    def _bound(self) -> dict[str, str]:
        """The cameras that the configuration names; ConfigError if one is not there."""
        cameras = {}
        for view in self.config.video.views:
            configured = self.config.cameras.get(view)
            camera = self._bench.camera_of(configured) if configured is not None else ""
            if not camera:
                raise ConfigError(
                    f"no camera that is plugged in is cameras.{view}: add which to --only, so that "
                    "it is found"
                )
            cameras[view] = camera
        return cameras

    def _keys(self, found: Findings) -> dict[str, Any]:
        """All keys of a view's camera that this kind of calibration knows.

        All of them each time: the new file replaces the old one. What was not measured now stays
        as the configuration has it; latency, lens and mount only if they are of the same camera,
        a mount only with the lens through which it was found.
        """
        before, same = self.config.cameras.get(found.view), self._before(found)
        keys: dict[str, Any] = dict(self._bench.binding(found.camera))
        if before is not None:
            keys["exposure_us"] = before.exposure_us
            keys["white_balance_k"] = before.white_balance_k
        if found.latency is not None:
            keys["latency_ms"] = round(max(0.0, found.latency.ms), 1)
        elif same is not None:
            keys["latency_ms"] = same.latency_ms
        today = utc_now().date()
        lens = None if same is None else same.lens
        mount = None if same is None else same.mount
        if found.lens is not None:
            lens = measuring.lens_section(found.lens, today)
        if found.mount is not None:
            mount = measuring.mount_section(found.mount, found.view, today)
        elif found.lens is not None:
            mount = None  # it was found through another lens
        for name, section in (("lens", lens), ("mount", mount)):
            if section is not None:
                keys[name] = section.model_dump(mode="json")
            elif before is not None and getattr(before, name) is not None:
                keys[name] = None  # over that of the configuration
        return keys


def chosen_steps(only: str) -> tuple[str, ...]:
    """From `which,lens`; none given: which camera is which. ConfigError lists the names."""
    if not only:
        return (WHICH,)
    names = tuple(name.strip() for name in only.split(","))
    for name in names:
        if name not in STEPS:
            raise ConfigError(f"--only: {REMOVED.get(name) or not_one_of(name, STEPS)}")
    return names

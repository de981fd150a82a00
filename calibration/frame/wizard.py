"""`run_tams.py calibrate frame`: buttons, strokes, the fit, a try, and the question."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from calibration.frame import result
from calibration.frame.asking import fit_moves, try_six_directions
from calibration.frame.buttons import ask_buttons, finding_table
from calibration.frame.capture import strokes_of_log, was_simulated
from calibration.frame.fit import FrameFit, fit_strokes
from calibration.frame.result import KIND, FrameResult, save_fit
from calibration.frame.sources import SIX_DIRECTIONS, HandSource, LiveSetup
from calibration.frame.stroke import RefusedError
from calibration.options import FrameOptions
from calibration.store import Calibration
from calibration.ui import as_text
from calibration.wizard import Wizard
from tams_app.errors import ConfigError
from tams_app.runtime.clock import MonotonicClock

if TYPE_CHECKING:
    from calibration.frame.simulated_person import SimulatedSetup

_INTRODUCTION = """\
How does the controller's tracking frame stand to the robot? The robot's x points away from its
base, y to its left, z up. Take the {hand} controller.
{tasks}
At last you try all six directions. The arm is not connected and does not move.
Ctrl-C ends this at any time, and nothing is changed."""
_BUTTONS = "You will press each button once.\n"
_STROKES = """\
You will move it along the robot's axes, at least 200 mm each time, along something straight where
you can."""


class FrameWizard(Wizard[FrameOptions]):
    """How the controller's frame stands to the arm's, and which button is which."""

    _outcome: FrameResult | None = None  # once there is a frame that may be kept

    def check(self) -> None:
        options = self.options
        if options.logs and options.sim:
            raise ConfigError("--from does not go with --sim")
        self.overrides = {"rig.enabled": True} if options.sim else None
        self.simulated |= any(was_simulated(log) for log in options.logs)

    def measure(self) -> Calibration | None:
        if self.options.logs:
            self._fit_logs()
        else:
            self._measure(self._setup())
        assert self._outcome is not None
        doubt = result.doubt(self._outcome.frame)
        if doubt and not self._is_kept(doubt):
            self.ui.print("Nothing is written.")
            return None
        return self.partial()

    def partial(self) -> Calibration | None:
        if self._outcome is None:
            return None
        before = self.store.in_force(KIND)
        return result.calibration(self.config, self._outcome, before, self.simulated)

    def draw(self, path: Path) -> None:
        if self._outcome is not None:
            save_fit(self._outcome.frame, path)

    def _fit_logs(self) -> None:
        logs = self.options.logs
        strokes = [stroke for log in logs for stroke in strokes_of_log(log, self.config)]
        frame = fit_strokes(strokes)
        source = "strokes recorded in " + ", ".join(str(log) for log in logs)
        self._outcome = FrameResult(frame, source)
        self._show(frame)
        self.ui.print("A recording cannot be tried out: watch the directions in `run --dry-run`.")

    def _setup(self) -> LiveSetup | SimulatedSetup:
        if self.options.sim:
            from calibration.frame.simulated_person import SimulatedSetup

            return SimulatedSetup(self.config, self.options.seed)
        if self.config.rig.enabled:
            raise ConfigError(
                "this configuration has the simulated rig: add --sim, or give --config with "
                "hardware"
            )
        self.require_person()
        return LiveSetup(self.config, MonotonicClock(), lambda _level, text: self.ui.print(text))

    def _measure(self, setup: LiveSetup | SimulatedSetup) -> None:
        options = self.options
        tasks = (_BUTTONS if options.buttons else "") + _STROKES
        self.ui.print(_INTRODUCTION.format(hand=self.config.controller.hand, tasks=tasks))
        if options.sim:
            self.ui.print("A simulated person does all this now.")
        buttons = None
        if options.buttons:
            with setup.buttons() as components:
                buttons = ask_buttons(self.ui, components, self.config)
            self.ui.print(as_text(finding_table(buttons)))
        config = result.mapped(self.config, buttons)
        with setup.hand(config.controller) as source:
            frame = fit_moves(self.ui, source, config, options.rounds)
            self._show(frame)
            result.doubt(frame)  # what is no use needs no trying
            how = f"strokes by {setup.description}"
            self._outcome = FrameResult(frame, how, buttons, None, setup.true_rotation)
            self._try(source, self._outcome)

    def _show(self, frame: FrameFit) -> None:
        self.ui.print(as_text(result.result_table(frame)))
        for remark in result.remarks(self.config, frame):
            self.ui.print(remark)

    def _try(self, source: HandSource, outcome: FrameResult) -> None:
        """RefusedError unless each direction that was tried lit up."""
        self.ui.print(
            "Now try it: no arm is connected, the table shows where it would go. Move some 200 mm "
            "each time; Enter skips a direction."
        )
        config = result.mapped(self.config, outcome.buttons)
        hand = result.hand_with(config.hand, outcome.frame)
        lit = try_six_directions(self.ui, source, config, hand)
        self.ui.print(
            f"{sum(lit.values())} of {len(SIX_DIRECTIONS)} directions lit up as asked for."
        )
        self._outcome = replace(outcome, lit=lit)
        if wrong := [one.name for one, is_right in lit.items() if not is_right]:
            self._outcome = None
            raise RefusedError(
                f"Another direction lit up for {', '.join(wrong)}, or none: if you moved as asked, "
                "the frame is wrong; calibrate again.",
            )

    def _is_kept(self, doubt: str) -> bool:
        """Only a person can accept a doubtful result; --yes does not."""
        self.ui.print(doubt)
        if not self.ui.attended:
            self._outcome = None
            raise RefusedError(
                "A person at the terminal must confirm so uncertain a frame: run this from one, or "
                "make better strokes.",
            )
        return self.ui.yes("Keep it all the same?")

"""One trial in virtual time: both sides of a session, from first frame to verdict."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial
from pathlib import Path

from tams_app.config import Config
from tams_app.errors import ConfigError
from tams_app.records import Outcome
from tams_app.robot import build
from tams_app.runtime.clock import VirtualClock
from tams_app.session.predicting import predicted_trial
from tams_app.session.recorders import virtual_records
from tams_app.session.virtual.operator import VirtualOperator
from tams_app.session.virtual.side import VirtualRobotSide
from tams_app.session.virtual.video import FrameScores
from tams_app.units import NS_PER_S
from tams_app.video.virtual.stepped_clock import EventQueue

START_NS = NS_PER_S
ENGAGED_WITHIN_S = 30.0  # else they never will: they need about three


class VirtualTrial:
    """The two sides, and the time that passes for them; `run` it once, then `close`."""

    def __init__(
        self,
        config: Config,
        participant_seed: int,
        folder: Path,
        wall_start_ns: int,
    ) -> None:
        """SetupError, ConfigError, LogError or DeviceError say why it cannot begin."""
        build.check_names(config)
        build.check_ready_pose(config)
        if config.recording.record_reference:
            raise ConfigError(
                "recording.record_reference: a trial in virtual time keeps no lossless captures; "
                "set it to false"
            )
        self._limit_s = config.seconds
        self._clock, self._events = VirtualClock(START_NS), EventQueue()
        self._ended = ""
        with ExitStack() as stack:
            records = virtual_records(config, folder, self._clock, wall_start_ns)
            self._log = stack.enter_context(records)
            states, mount = predicted_trial(config, self._log)
            lumas = {view: shows.luma for view, shows in mount.views.items()}
            self._scores = FrameScores(config, self._log, lumas)
            looks = {view: shows.show for view, shows in mount.views.items()}
            if config.rig.operator.looks_at == "received":
                looks = {}
            self._operator = VirtualOperator(config, participant_seed, self._log, looks)
            self._robot = VirtualRobotSide(
                config,
                self._clock,
                self._log,
                self._events,
                self._operator,
                self._scores,
                mount,
                states,
            )
            stack.callback(self._robot.close)
            self._stack = stack.pop_all()

    def run(self) -> Outcome:
        """From the start to the verdict."""
        self._begin()
        while not self._ended:
            due_ns = self._events.next_ns
            assert due_ns is not None, "cameras and control always have something to do"
            self._robot.advance_to(due_ns)
            self._clock.sleep_until_ns(due_ns)
            self._events.do_next()
            if self._robot.is_over:
                self._end("the trial is over")
        self._robot.stop()
        self._scores.finish(self._clock.now_ns())
        outcome = self._robot.outcome(self._ended)
        self._log.record(outcome)
        return outcome

    def close(self) -> None:
        """Finish the log and give everything back; may be called twice."""
        self._stack.close()

    def _begin(self) -> None:
        now_ns = self._clock.now_ns()
        self._robot.begin(now_ns)
        self._log.fact("operator", self._operator.kind)
        self._events.post(now_ns + round(ENGAGED_WITHIN_S * NS_PER_S), self._give_up)
        if self._limit_s is not None:
            end = partial(self._end, f"ended after {self._limit_s:g} s")
            self._events.post(now_ns + round(self._limit_s * NS_PER_S), end)

    def _give_up(self) -> None:
        if not self._robot.started:
            self._end("the operator never engaged")

    def _end(self, reason: str) -> None:
        """The first reason counts."""
        self._ended = self._ended or reason

"""`run`: both sides in one process, joined without a link."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from msgspec.structs import replace

from tams_app.config import Config
from tams_app.records import SessionState
from tams_app.robot.control import Signals
from tams_app.robot.side import Ground, RobotSide, start_devices, start_video
from tams_app.runtime.clock import Clock
from tams_app.session.local_operator import LocalOperator
from tams_app.session.predicting import follow_states, predicted_cameras
from tams_app.session.quality import LiveQuality
from tams_app.session.session import Session
from tams_app.session.task_place import task_regions
from tams_app.station.station import Station
from tams_app.video.live.installed_codecs import installed_codecs


def run(
    config: Config, clock: Clock, folder: Path, arm_at_once: bool = False, dry_run: bool = False
) -> Session:
    """A session of both sides; `arm_at_once` and `dry_run`: see `RobotSide`."""
    signals = Signals()

    def compose(session: Session) -> BothSides:
        codecs = installed_codecs(config.video)
        log, parts = session.open_log(config), session.parts
        cameras, is_rig = predicted_cameras(config), config.rig.enabled
        station = Station(config, clock, parts, log, session.displays, is_rig, cameras=cameras)
        ground = Ground(config, clock, parts, log, signals, session)
        devices = start_devices(ground)
        station.launch(confirms=not arm_at_once, world_memory=devices.memory_name)
        quality = LiveQuality(
            config.video, station.screen, parts.logs, log.record, log.note, station.mount
        )
        parts.stack.callback(quality.close)
        quality.start()  # takes a moment, of which a capacity trace must lose nothing
        regions = task_regions(config)  # of the frames that are scored
        captured = regions.through(quality.captured)
        operator = LocalOperator(station, config, codecs.decoder)
        video = start_video(ground, operator, codecs, captured)
        session.go_on()
        devices.wait_ready()
        station.wait_ready()
        session.go_on()
        listeners = (*follow_states(config, clock, parts, log, station.mount), regions)
        robot = RobotSide(ground, devices, video, operator, listeners, arm_at_once, dry_run)
        both = BothSides(robot, station, quality)
        session.ready(both)
        robot.begin()
        return both

    return Session(config, clock, folder, signals, compose)


@dataclass(frozen=True, slots=True)
class BothSides:
    """The two sides, and what compares the frames of the one with those of the other."""

    robot: RobotSide
    station: Station
    quality: LiveQuality

    @property
    def pids(self) -> dict[str, int]:
        quality = self.quality.pid
        return {**self.robot.pids, **({} if quality is None else {"quality": quality})}

    def poll(self) -> str:
        return self.robot.poll()

    def state(self) -> SessionState:
        state = self.robot.state()
        views = self.station.views(state.views, state.now_ns, offset_ns=0)
        return replace(state, views=self.quality.views(views, state.now_ns))

    def stop_arm(self, failed: bool) -> None:
        self.robot.stop_arm(failed)

    def finish(self, reason: str, failed: bool) -> None:
        self.robot.finish(reason, failed)

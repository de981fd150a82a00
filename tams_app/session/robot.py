"""`robot`: the robot's side alone, with the operator at the end of a link."""

from __future__ import annotations

from pathlib import Path

from tams_app.config import Config
from tams_app.link.gateway_client import Endpoint, Gateway
from tams_app.link.sealing import LONGEST_DATAGRAM_BYTES, MEDIA_OVERHEAD_BYTES
from tams_app.robot.control import Signals
from tams_app.robot.linked_operator import LinkedOperator
from tams_app.robot.side import Ground, RobotSide, start_devices, start_video
from tams_app.runtime.clock import Clock
from tams_app.session.session import Session
from tams_app.video.live.installed_codecs import installed_codecs

# what is sent again is 2 bytes longer, a parity packet 7
LONGEST_RTP_BYTES = LONGEST_DATAGRAM_BYTES - MEDIA_OVERHEAD_BYTES - 7


def robot(
    config: Config,
    clock: Clock,
    folder: Path,
    endpoint: Endpoint,
    arm_at_once: bool = False,
    dry_run: bool = False,
) -> Session:
    """A session of the robot's side; an operator calls, and may leave and call again.

    `endpoint`: where to listen. `arm_at_once` and `dry_run`: see `RobotSide`.
    """
    config, signals = for_robot(config), Signals()

    def compose(session: Session) -> RobotSide:
        codecs = installed_codecs(config.video)
        log, parts = session.open_log(config), session.parts
        ground = Ground(config, clock, parts, log, signals, session)
        devices = start_devices(ground)

        def gateway(welcome: bytes) -> Gateway:
            made = Gateway("robot", endpoint, welcome, parts.logs)
            parts.watch("link", made.process)
            return made

        operator = LinkedOperator(config, clock, signals, log, gateway, folder.name)
        session.forward_notes(operator.note)
        video = start_video(ground, operator, codecs, link=config.link)
        session.go_on()
        devices.wait_ready()
        if config.rig.enabled:
            log.fact("operator", "elsewhere")
            log.note("info", "the operator is at another computer")
        session.go_on()
        side = RobotSide(ground, devices, video, operator, arm_at_once=arm_at_once, dry_run=dry_run)
        session.ready(side)
        side.begin()
        return side

    return Session(config, clock, folder, signals, compose)


def for_robot(config: Config) -> Config:
    """The configuration of a session whose operator is at the other end of the link.

    A pose or a button is judged by its age at the operator's side; what the link may add until it
    is lost comes on top. Nothing is shown here. A datagram carries at most 1200 bytes,
    which every path lets through.
    """
    video = config.video
    video = video.model_copy(update={"mtu_bytes": min(video.mtu_bytes, LONGEST_RTP_BYTES)})
    fresh, link = config.freshness, config.link
    freshness = fresh.model_copy(
        update={
            "hold_pose_ms": link.bridge_ms,
            "pose_frozen_ms": fresh.pose_frozen_ms + link.lost_after_ms,
            "buttons_ms": fresh.buttons_ms + link.lost_after_ms,
        }
    )
    return config.model_copy(update={"faces": (), "freshness": freshness, "video": video})

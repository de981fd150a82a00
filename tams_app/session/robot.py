"""`robot`: the robot's side alone, with the operator at the end of a link."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from tams_app.config import Config
from tams_app.link.gateway_client import Endpoint
from tams_app.link.page_client import Page
from tams_app.link.quic import LONGEST_CONTENT_BYTES
from tams_app.robot.linked_operator import LinkedOperator, listen, serve, welcome_of
from tams_app.robot.side import RobotSide, bind_video, start_devices
from tams_app.robot.status import StatusBoard
from tams_app.runtime.mailbox import Sentences
from tams_app.session.session import Outset, Session

_HERE = Endpoint("127.0.0.1", 0, None)
# what is sent again is 2 bytes longer, a parity packet 7
LONGEST_RTP_BYTES = LONGEST_CONTENT_BYTES - 7


@contextmanager
def robot(
    outset: Outset,
    endpoint: Endpoint | None,
    arm_at_once: bool = False,
    dry_run: bool = False,
    page: Page | None = None,
) -> Iterator[Session]:
    """A session of the robot's side; an operator calls, and may leave and call again.

    `outset` has the configuration that `for_robot` makes, and `Signals`. `endpoint`: where to
    listen; None: a page of this computer alone may call. `arm_at_once` and `dry_run`: see
    `LiveGround`. `page`: which may call.
    """
    config = outset.config
    with outset.starting() as parts:
        log = outset.open_log(config, parts)
        ground = outset.ground(parts, log, arm_at_once, dry_run)
        board, devices = StatusBoard(config, log.newest), start_devices(ground)
        sentences = Sentences()  # for the operator
        outset.sentences.forward_to(sentences)
        video = bind_video(ground, board, link=config.link)
        welcome = welcome_of(config, video, outset.folder.name)
        gateway = listen(ground, endpoint or _HERE, welcome)
        if page is not None:
            serve(ground, page, gateway, is_alone=endpoint is None)
        operator = LinkedOperator(ground, gateway, video.sent, sentences, page)
        entrances = video.enter_network(operator.ports)
        operator.connect(entrances)
        video.start(entrances)
        outset.go_on()
        devices.wait_ready()
        if config.rig.enabled:
            log.fact("operator", "elsewhere")
            log.note("info", "the operator is at another computer")
        outset.go_on()
        side = RobotSide(ground, board, devices, video, operator, link=operator)
        outset.ready(parts)
        side.begin()
        with Session(outset, parts, log, side) as session:
            yield session


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

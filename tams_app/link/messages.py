"""The messages of the two applications: one table of their fields, and one codec (MessagePack).

Each message is complete in one datagram, and the newest counts. Stamps are nanoseconds of the
sender's own monotonic clock. What must arrive is counted, and the count is in every message: it is
repeated until a later message of the other side acknowledges it.
"""

from __future__ import annotations

from typing import Annotated, TypeVar

import msgspec

from tams_app.errors import TamsError
from tams_app.records import SessionState, Whole
from tams_app.vectors import Floats3

HAND_RATE_HZ = 120.0
STATE_RATE_HZ = 60.0
PROTOCOL = 5
# Facts of the logs of both sides, by which one is found to the other:
SESSION_FACT = "link_session"  # the same in both
ROBOT_FOLDER_FACT = "robot_folder"  # of the operator's side: name of the other log's folder
OPERATOR_FOLDER_FACT = "operator_folder"  # the same of the robot's side
OPERATOR_FACT = "link_operator"  # of the operator's side: the number in what it sends


class MessageError(TamsError):
    """Bytes that are no message of the kind that was expected."""


class SessionDescription(msgspec.Struct, frozen=True):
    """The session that the robot's side runs."""

    protocol: Whole
    version: str
    session: Annotated[str, "the same for as long as its senders run"]
    name: str
    strategy: str
    network: str
    seed: int
    feedback: bool
    simulated: bool
    video: Annotated[dict[str, object], "its `VideoConfig`, which receivers must follow"]
    repair: Annotated[dict[str, object], "its `RepairRule`, as a mapping of its fields"]
    hand_rotation: Annotated[
        tuple[Floats3, Floats3, Floats3],
        "its `HandConfig.rotation`: a device on a desk moves the hand in the arm's frame",
    ]
    workspace: Annotated[dict[str, object], "of its `LimitsConfig`: bounds of the space shown"]
    driving: Annotated[
        dict[str, dict[str, object]] | None,
        "by section, what else decides how the hand moves the arm and is not as by default; None: "
        "too much for a message",
    ]
    stopped_after_ms: Annotated[float, "`LinkConfig.stopped_after_ms` there"]


class HandMessage(msgspec.Struct, frozen=True, array_like=True):
    """A sample of the controller, the frames that are shown, and the operator's requests.

    Times are of the operator's side unless they say otherwise. Requests are counted.
    """

    operator: Annotated[Whole, "random number of the application, with which its counts begin"]
    simulated: Annotated[bool, "no person holds the controller: that moves no real arm"]
    sent_ns: Whole
    echo_ns: Annotated[Whole, "the newest `StateMessage.sent_ns` received; 0: none yet"]
    echo_heard_ns: Annotated[Whole, "when it was received"]
    status: Annotated[str, "a `ControllerStatus`"]
    pose: Annotated[
        tuple[float, float, float, float, float, float, float] | None,
        "position [m] and rotation (quaternion), in the tracking frame",
    ]
    pose_ns: Whole
    buttons_ns: Whole
    trigger: float
    grip: float
    a: bool
    b: bool
    menu: bool
    shown: Annotated[
        tuple[Whole | None, ...],
        "by view, the RTP timestamp of the newest frame shown that counts (complete, and on a "
        "display that works); None before the first",
    ]
    confirms: Annotated[Whole, "confirmations"] = 0
    confirmed_ns: Annotated[Whole, "when the last one was given"] = 0
    stops: Annotated[Whole, "emergency stops"] = 0
    noted: Annotated[Whole, "the robot's sentences received (`StateMessage.noted`)"] = 0
    presses: Annotated[
        tuple[Whole, Whole, Whole, Whole],
        "how often grip, A, B and the menu button have gone down (`Presses`): a press may have "
        "come and gone between two samples",
    ] = (0, 0, 0, 0)
    hand: Annotated[str, "what the operator drives with, of `teleop.hands.HANDS`"] = ""
    damaged: Annotated[tuple[bool, ...], "by view, a newer frame is shown, not complete"] = ()
    episodes: Annotated[
        tuple[Whole, Whole, Whole, Whole, Whole], "how often each `EpisodeRequest`, in their order"
    ] = (0, 0, 0, 0, 0)
    pinned: Annotated[Whole | None, "place of the pinned view, in the order of the views"] = None


class StateMessage(msgspec.Struct, frozen=True, array_like=True):
    """The state of the robot's side. Times are its own unless they say otherwise."""

    sent_ns: Whole
    echo_ns: Annotated[Whole, "the newest `HandMessage.sent_ns` received, which echoes it"]
    echo_heard_ns: Annotated[Whole, "when it was received"]
    state: Annotated[SessionState, "of the session there; its `heard_ns` is of the last tick"]
    first_capture_ns: Annotated[
        tuple[Whole | None, ...], "by view, the capture of the frame with RTP timestamp 0, if any"
    ]
    haptics: Annotated[Whole, "how many pulses there have been"]
    haptic: Annotated[str, "the last of them"]
    confirms: Annotated[Whole, "of the last `HandMessage`, which acknowledges them"]
    stops: Annotated[Whole, "of the last `HandMessage`, which acknowledges them"]
    noted: Annotated[Whole, "how many sentences there have been for people"]
    notes: Annotated[tuple[str, ...], "the last ones, until their receipt is acknowledged"]
    ended: Annotated[str, 'why the session has ended, "" while it runs']
    failed: bool


Message = TypeVar("Message", SessionDescription, HandMessage, StateMessage)


def encode(message: SessionDescription | HandMessage | StateMessage) -> bytes:
    """The bytes of a message."""
    return msgspec.msgpack.encode(message)


def decode(content: bytes, kind: type[Message]) -> Message:
    """The message of `kind`; MessageError if it is none, with every field of its type.

    Whole numbers are less than 2**62 from 0.
    """
    try:
        return msgspec.msgpack.decode(content, type=kind)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise MessageError(f"no {kind.__name__}: {error}") from error

"""What the two applications tell each other, each message whole in one datagram; newest counts.

Stamps are nanoseconds of the sender's own monotonic clock. What must arrive is counted, and the
count is in every message: it is repeated until a later message of the other side acknowledges it.
"""

from __future__ import annotations

from typing import TypeVar

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


class Welcome(msgspec.Struct, frozen=True):
    """What the robot's side says of the session that it runs.

    session: the same for as long as its senders run.
    video: its `VideoConfig`, which receivers must follow.
    repair: its `RepairRule`, as a mapping of its fields.
    hand_rotation: its `HandConfig.rotation`: a device on a desk moves the hand in the arm's frame.
    workspace: of its `LimitsConfig`, what bounds the space that the operator is shown.
    driving: by section, what else of its configuration decides how the hand moves the arm and is
        not as by default; None: that is too much to be told.
    stopped_after_ms: `LinkConfig.stopped_after_ms` there.
    """

    protocol: Whole
    version: str
    session: str
    name: str
    strategy: str
    network: str
    seed: int
    feedback: bool
    simulated: bool
    video: dict[str, object]
    repair: dict[str, object]
    hand_rotation: tuple[Floats3, Floats3, Floats3]
    workspace: dict[str, object]
    driving: dict[str, dict[str, object]] | None
    stopped_after_ms: float


class HandMessage(msgspec.Struct, frozen=True, array_like=True):
    """A sample of the controller, and what the operator's side shows and asks for.

    operator: a random number of the application that sends; its counts begin with it.
    simulated: whether no person holds the controller: that moves no real arm.
    sent_ns: when it was sent.
    echo_ns: the newest `StateMessage.sent_ns` that was heard, 0 before the first; echo_heard_ns:
        when that was.
    pose: position [m] and rotation (quaternion), 7 numbers, in the tracking frame, or None.
    shown: by view, the RTP timestamp of the newest frame shown that counts (it is whole, and
        what shows it works); None before the first. damaged: by view, whether a newer one is shown
        that is not whole.
    confirms: how often the operator has confirmed; confirmed_ns: when they did last.
    stops: how often they have asked for an emergency stop.
    presses: how often grip, A, B and the menu button have gone down (`Presses`): a press may have
        come and gone unheard.
    noted: how many of the robot's sentences have been heard (`StateMessage.noted`).
    hand: what the operator drives with, of `teleop.hands.HANDS`.
    episodes: how often each `EpisodeRequest` was made, in their order.
    pinned: place of the view that the operator has pinned, in the order of the views.
    """

    operator: Whole
    simulated: bool
    sent_ns: Whole
    echo_ns: Whole
    echo_heard_ns: Whole
    status: str
    pose: tuple[float, float, float, float, float, float, float] | None
    pose_ns: Whole
    buttons_ns: Whole
    trigger: float
    grip: float
    a: bool
    b: bool
    menu: bool
    shown: tuple[Whole | None, ...]
    confirms: Whole = 0
    confirmed_ns: Whole = 0
    stops: Whole = 0
    noted: Whole = 0
    presses: tuple[Whole, Whole, Whole, Whole] = (0, 0, 0, 0)
    hand: str = ""
    damaged: tuple[bool, ...] = ()
    episodes: tuple[Whole, Whole, Whole, Whole, Whole] = (0, 0, 0, 0, 0)
    pinned: Whole | None = None


class StateMessage(msgspec.Struct, frozen=True, array_like=True):
    """What the robot's side does and knows.

    sent_ns: when it was sent.
    echo_ns, echo_heard_ns: the newest `HandMessage.sent_ns` that was heard, and when that was.
    state: of the session there; its stamps are of the clock there, `heard_ns` of its last tick.
    haptics: how many pulses there have been; haptic: the last of them.
    first_capture_ns: by view, when the frame with RTP timestamp 0 was captured, None before.
    confirms, stops: those of the last `HandMessage`.
    noted: how many sentences there have been for people; notes: the last of them, until the
        operator's side has heard of them.
    ended: why the session has ended, "" while it runs.
    """

    sent_ns: Whole
    echo_ns: Whole
    echo_heard_ns: Whole
    state: SessionState
    first_capture_ns: tuple[Whole | None, ...]
    haptics: Whole
    haptic: str
    confirms: Whole
    stops: Whole
    noted: Whole
    notes: tuple[str, ...]
    ended: str
    failed: bool


Message = TypeVar("Message", Welcome, HandMessage, StateMessage)


def encode(message: Welcome | HandMessage | StateMessage) -> bytes:
    """The bytes of a message (MessagePack)."""
    return msgspec.msgpack.encode(message)


def decode(content: bytes, kind: type[Message]) -> Message:
    """The message of `kind`; MessageError if it is none, with every field of its type.

    Whole numbers are less than 2**62 from 0.
    """
    try:
        return msgspec.msgpack.decode(content, type=kind)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise MessageError(f"no {kind.__name__}: {error}") from error

"""The messages between the application and a face of it, window or headset.

The application's `FaceFacts` lie in shared memory, where the newest wins; the face's messages come
over a socket, each whole in one packet. Stamps are of the monotonic clock of this computer.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import msgspec

from tams_app.faces.commands import Command
from tams_app.records import SessionState

BEAT_S = 0.02  # a face reports at least so often
LONGEST = 64 * 1024  # bytes of an `Opening` or an `Event`
SPAN_S = 60.0  # of the past that a window draws


class ShownWorkspace(msgspec.Struct, frozen=True):
    """The space that the TCP does not leave [mm], in the arm's base frame."""

    box_min_mm: tuple[float, float, float]
    box_max_mm: tuple[float, float, float]
    radius_min_mm: float
    radius_max_mm: float


class Stretch(msgspec.Struct, frozen=True, array_like=True):
    """A time [s] in which something stayed the same."""

    begin_s: float
    end_s: float
    what: str


class Outline(msgspec.Struct, frozen=True):
    """A whole log: its length, its phases, and its states of the arming table."""

    end_s: float
    phases: tuple[Stretch, ...]
    states: tuple[Stretch, ...]


class Opening(msgspec.Struct, frozen=True):
    """The facts that a face is opened with: fixed as long as it is open.

    The descriptors of the frames' and the facts' memory come with it, in this order, and if there
    are `cameras` that of their mount. blind: nothing may be shown that reveals the strategy or the
    network of a trial, or the phases of one that a person marks. hand: of `HANDS`. replay: the log
    that all of it is from, so that nothing moves; None for a session. old_ms: the age from
    which a frame is called old. has_episodes: there are keys for them. strategy, network: "" where
    they may not be known. cameras: by view, those whose frames are to be corrected, as of
    `MountMemory.specification`.
    """

    views: tuple[str, ...]
    width: int
    height: int
    workspace: ShownWorkspace
    blind: bool
    hand: str
    old_ms: float
    replay: Outline | None = None
    has_episodes: bool = False
    strategy: str = ""
    network: str = ""
    cameras: dict[str, Any] = {}


class TrialFacts(msgspec.Struct, frozen=True):
    """The trial of a study, as far as its participant may know of it."""

    participant: str
    title: str
    passed_s: float | None  # None: not begun
    limit_s: float
    drops: int = 0  # that were counted


class ReplayFacts(msgspec.Struct, frozen=True):
    """The state of a replay; its position is the time of its facts.

    marks: the phases that a person marks in it, in place of those of its log; None where they mark
    none. past: the minute before its last jump, with rates alone.
    """

    speed: float  # times the real one
    paused: bool  # or at the end
    jumps: int = 0  # how often it went elsewhere than on
    marks: tuple[Stretch, ...] | None = None
    past: tuple[SessionState, ...] = ()


class Ended(msgspec.Struct, frozen=True):
    """What came of a session that is over.

    headline: the verdict, or what is being done. lines: what else there is to know. key: what the
    keys do now.
    """

    headline: str
    lines: tuple[str, ...] = ()
    key: str = ""


class Notice(msgspec.Struct, frozen=True):
    """A sentence for the operator, and when it was shown."""

    t_s: float
    text: str


class FaceFacts(msgspec.Struct, frozen=True):
    """The session's state at one moment as a face shows it, and the notices last.

    advice: what to do about `state.reason` now. reported_ns: when they were put (`FaceClient`).
    silent_s: for how long nothing has been received, None while that is short; only a face knows it
    (`faces.silence`). recorded_mb: size of the log so far, None where it is not told. end: of a
    session that is over.
    """

    state: SessionState
    advice: str = ""
    trial: TrialFacts | None = None
    replay: ReplayFacts | None = None
    notices: tuple[Notice, ...] = ()
    reported_ns: int = 0
    silent_s: float | None = None
    recorded_mb: float | None = None
    end: Ended | None = None


class CommandRequest(msgspec.Struct, frozen=True, tag="asked"):
    """The operator asks for something; once for each press, however long the key is held."""

    t_ns: int
    command: Command


class Seek(msgspec.Struct, frozen=True, tag="sought"):
    """The moment of the log [s] that was clicked or dragged to in a replay."""

    t_ns: int
    t_s: float


class Pin(msgspec.Struct, frozen=True, tag="pin"):
    """The operator pinned this view, whose place is the large one; "": they let it go."""

    t_ns: int
    view: str


class Keys(msgspec.Struct, frozen=True, tag="keys"):
    """The keys that are down: sent with every press, release and change of focus, and as a beat.

    held: their names as GDK has them (`w`, also with Shift, `Left`, `Shift_L`), in the order of
    pressing. A key that repeats itself stays in it, one whose release the window cannot see (it has
    no focus) leaves it.
    focused: it has the focus, and the operator sees it (`faces.window.sight`).
    drawings: how often the window has drawn new pictures so far.
    seen_ns: by view, when the frame was decoded that the operator sees.
    presses: how often each key has gone down, by name: one may go down and up between two looks.
    """

    t_ns: int
    focused: bool
    held: tuple[str, ...]
    drawings: int = 0
    presses: dict[str, int] = {}
    seen_ns: dict[str, int] = {}


class Beat(msgspec.Struct, frozen=True, tag="beat"):
    """A face without keys works; `drawings` and `seen_ns` as in `Keys`."""

    t_ns: int
    drawings: int
    seen_ns: dict[str, int] = {}


class FaceClosed(msgspec.Struct, frozen=True, tag="gone"):
    """A face shows nothing any more; `why` in a few words."""

    t_ns: int
    why: str


Event: TypeAlias = CommandRequest | Seek | Pin | Keys | Beat | FaceClosed

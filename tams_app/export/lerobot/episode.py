"""The parts of a log that become episodes: the longest that are whole, with arm and all views.

Ticks of the control loop are sampled on an episode's grid: what a learner sees, and what was done.
Lengths in metres, angles in radians, as the names say; quaternions are x, y, z, w.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tams_app.errors import UnreadableLogError
from tams_app.export.options import ExportOptions
from tams_app.outputs import is_plain_name
from tams_app.recording import Gap, Header, SessionLog, read_log, read_ticks, read_video
from tams_app.recording.topics import OutcomeGiven
from tams_app.records import Episode as EndedEpisode
from tams_app.records import Outcome, Phase, ServoMode, Tick
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_S

STATE_NAMES = (
    *(f"joint_{number}_rad" for number in range(1, 7)),
    *("tcp_x_m", "tcp_y_m", "tcp_z_m", "tcp_qx", "tcp_qy", "tcp_qz", "tcp_qw", "gripper"),
)
ACTION_NAMES = (
    *("tcp_vx_m_s", "tcp_vy_m_s", "tcp_vz_m_s"),
    *("tcp_wx_rad_s", "tcp_wy_rad_s", "tcp_wz_rad_s", "gripper"),
)
PHASES = tuple(Phase)

_GRIPPER, _QUATERNION = -1, slice(-5, -1)  # in a state
_MARGIN_NS = NS_PER_S  # of idle time at either end: a block counts as placed after half of it
_WITH_DAMAGED = "--with-damaged exports the longest part that is whole."
_ALWAYS = (-np.inf, np.inf)

_Span: TypeAlias = tuple[float, float]  # from when to when [ns]
_Wanted: TypeAlias = tuple[int | None, _Span, Outcome]
_Ints: TypeAlias = NDArray[np.int64]
_CAPTURED, _ENCODED, _KEYFRAME, _BYTES = range(4)  # the recorded frames of a view, a row each


class TickTable:
    """The ticks at which the arm had reported, as numbers: some 200 bytes each.

    times_ns: when each started, shape (n,). engaged_ns: of those in which the arm was engaged.
    """

    def __init__(self, ticks: Iterable[Tick]) -> None:
        times, values = array("q"), array("d")
        closed = False
        for tick in ticks:
            if tick.arm is None:
                continue
            if tick.arm.gripper_closed is not None:  # not known: as it was last
                closed = tick.arm.gripper_closed
            times.append(tick.started_ns)
            values.extend((*tick.arm.joints, *tick.arm.tcp.position, *tick.arm.tcp.rotation))
            values.extend((closed, *tick.twist.linear, *tick.twist.angular, closed))
            values.extend((PHASES.index(tick.phase), tick.arming == ArmingState.ENGAGED))
        width = len(STATE_NAMES) + len(ACTION_NAMES) + 2
        self.times_ns = np.frombuffer(times, np.int64)
        self._values = np.frombuffer(values, np.float64).reshape(-1, width)
        self.engaged_ns = self.times_ns[self._values[:, -1] == 1]

    def sample(self, grid_ns: NDArray[np.int64]) -> dict[str, NDArray[Any]]:
        """Features of a dataset, a row for each instant of `grid_ns`: the newest tick's values.

        None of the instants is before the first tick. The gripper of an action is what is commanded
        until the next instant.
        """
        rows = self._values[np.searchsorted(self.times_ns, grid_ns, side="right") - 1]
        state, action = rows[:, : len(STATE_NAMES)], rows[:, len(STATE_NAMES) : -2]
        action[:-1, _GRIPPER] = state[1:, _GRIPPER]
        # a quaternion and its negative are the same rotation: no jump from one to the other
        turned = state[:, _QUATERNION]
        signs = np.where(np.sum(turned[1:] * turned[:-1], axis=1) < 0, -1.0, 1.0)
        turned[1:] *= np.cumprod(signs)[:, np.newaxis]
        phase = rows[:, -2].astype(np.int64)
        return {
            "observation.state": state.astype(np.float32),
            "action": action.astype(np.float32),
            "phase": np.array([one.value for one in PHASES])[phase],
            "subtask_index": phase,
            "engaged": rows[:, -1].astype(np.bool_),
        }


class Shape(NamedTuple):
    """The common properties of all episodes of a dataset; arm: None where the log names none."""

    fps: int
    width: int
    height: int
    views: tuple[str, ...]
    arm: str | None

    def __str__(self) -> str:
        views, size = ", ".join(self.views), f"{self.width}x{self.height}"
        return f"{views} with {size} at {self.fps} frames a second"


@dataclass(frozen=True, slots=True)
class EpisodeSource:
    """An episode before its frames are read.

    name: of the session's folder. number: of those of its session, None if without episodes.
    grid_ns: the instant of each row. columns: by feature, the rows' values, without the videos.
    keyframes_ns: by view, the capture that its decoding begins with; sizes_bytes: what the log has
    of it from the first row to the last. remark: a sentence if the log was not whole, else "".
    """

    path: Path
    name: str
    number: int | None
    header: Header
    shape: Shape
    grid_ns: _Ints
    columns: dict[str, NDArray[Any]]
    keyframes_ns: Mapping[str, int]
    sizes_bytes: Mapping[str, int]
    outcome: Outcome
    remark: str

    @property
    def rows(self) -> int:
        return len(self.grid_ns)


class _Part(NamedTuple):
    start_ns: int
    end_ns: int
    keyframes_ns: dict[str, int]


def read_episodes(path: Path, options: ExportOptions) -> tuple[list[EpisodeSource], str]:
    """The episodes in the log at `path`: one, or those kept of a session that is a row of them.

    With a sentence on what is taken of that row. UnreadableLogError in a sentence if there is none.
    """
    log = read_log(path, only=(OutcomeGiven, EndedEpisode))
    # a log with episodes that was cut off lacks none that had ended
    damage = "" if log.has_episodes and not log.gaps else log.damage
    lacks = "has no moment with the arm and a picture of every view"
    if damage and (log.has_episodes or not options.with_damaged):
        lacks = damage if options.with_damaged else f"{damage} {_WITH_DAMAGED}"
        if not log.has_episodes:
            raise unusable(path, lacks)
    wanted = _kept(path, log, options) if log.has_episodes else []
    outcome = log.outcome or Outcome(None, None, None, None, "")
    if options.only_success and not log.has_episodes and not outcome.success:
        verdict = outcome.reason or "there is no verdict"
        raise unusable(path, f"was not judged a success ({verdict})")
    shape = _shape(path, log.header)
    table = TickTable(read_ticks(path))
    if not len(table.times_ns):
        raise unusable(path, "tells nothing of an arm: of two computers give the robot's log")
    captures = {view: _captures(path, view) for view in shape.views}
    if not log.has_episodes:
        when_ns = _ALWAYS if options.keep_idle else _busy(path, table, outcome)
        wanted = [(None, when_ns, outcome)]
    name = path.resolve().parent.name
    found: dict[int | None, EpisodeSource] = {}
    for number, when_ns, outcome in wanted:
        undamaged = _part(_ALWAYS, when_ns, table.times_ns, captures)
        parts = [_part(span, when_ns, table.times_ns, captures) for span in _whole(log.gaps)]
        part = max(filter(None, parts), key=lambda one: one.end_ns - one.start_ns, default=None)
        cut = damage if part != undamaged or not log.has_episodes else ""
        if part is None or (cut and not options.with_damaged):
            continue
        rows = (part.end_ns - part.start_ns) * shape.fps // NS_PER_S + 1
        grid_ns = part.start_ns + np.arange(rows, dtype=np.int64) * NS_PER_S // shape.fps
        from_s, to_s = map(log.since_start_s, part[:2])
        found[number] = EpisodeSource(
            path,
            name,
            number,
            log.header,
            shape,
            grid_ns,
            table.sample(grid_ns),
            part.keyframes_ns,
            {view: _bytes_within(one, grid_ns) for view, one in captures.items()},
            outcome,
            f"{name}: {cut} Its episode is from {from_s:.1f} to {to_s:.1f} s." if cut else "",
        )
    if not found:
        raise unusable(path, lacks)
    sentence = ""
    if log.has_episodes:
        left = _listed(number for number, *_ in wanted if number not in found)
        sentence = f"{name}: takes {_listed(found)} of {len(log.judged_episodes)} episodes"
        sentence += f"; without {left}: {lacks}" if left else ""
    return list(found.values()), sentence


def unusable(path: Path, why: str) -> UnreadableLogError:
    return UnreadableLogError(f"{path.parent}: {why}")


def _listed(numbers: Iterable[int | None]) -> str:
    return ", ".join(map(str, numbers))


def _kept(path: Path, log: SessionLog, options: ExportOptions) -> list[_Wanted]:
    """The kept episodes as the operator began and ended them, labelled by them alone."""
    wanted: list[_Wanted] = [
        (one.number, (one.start_ns, one.end_ns - 1), Outcome(None, one.success, None, None, ""))
        for one in log.judged_episodes
        if one.kept and (one.success or not options.only_success)
    ]
    if not wanted:
        what = "labelled a success" if options.only_success else "kept"
        raise unusable(path, f"no episode of it was {what}")
    return wanted


def _shape(path: Path, header: Header) -> Shape:
    if header.servo != ServoMode.VELOCITY:
        why = "its arm was led from pose to pose, which this version of TAMS does not know"
        raise unusable(path, f"{why}: use version 2 to export it")
    for view in header.views:  # a folder of the dataset is named after it
        if not is_plain_name(view):
            raise unusable(path, f"a view is named {view!r}: cannot be a folder")
    video, arm = header.config.get("video", {}), header.config.get("arm", {}).get("model")
    try:
        size = int(video["width"]), int(video["height"])
    except (KeyError, TypeError, ValueError) as error:
        raise unusable(path, "does not say how large its pictures are") from error
    return Shape(header.fps, *size, tuple(header.views), None if arm is None else str(arm))


def _captures(path: Path, view: str) -> _Ints:
    frames = read_video(path, view)
    found = [(one.capture_ns, one.encoded_ns, one.keyframe, len(one.data)) for one in frames]
    if not found:
        raise unusable(path, f"holds no video of {view}: record with recording.bitstream: true")
    return np.array(found, np.int64)


def _bytes_within(captures: _Ints, grid_ns: _Ints) -> int:
    first, last = np.searchsorted(captures[:, _CAPTURED], grid_ns[[0, -1]], side="right") - 1
    return int(captures[first : last + 1, _BYTES].sum())


def _busy(path: Path, table: TickTable, outcome: Outcome) -> _Span:
    """From before the first engagement to after the placing, or else after the last engagement."""
    engaged_ns = table.engaged_ns
    if not len(engaged_ns):
        raise unusable(path, "the arm was never engaged; --keep-idle exports it all the same")
    placed_s = outcome.completion_time_s
    last_ns = engaged_ns[-1] if placed_s is None else engaged_ns[0] + placed_s * NS_PER_S
    return float(engaged_ns[0] - _MARGIN_NS), float(last_ns + _MARGIN_NS)


def _whole(gaps: Sequence[Gap]) -> list[_Span]:
    """From when to when the log is whole."""
    starts = [-np.inf, *(np.inf if gap.end_ns is None else gap.end_ns for gap in gaps)]
    ends = [*(-np.inf if gap.start_ns is None else gap.start_ns for gap in gaps), np.inf]
    return list(zip(starts, ends, strict=True))


def _part(
    whole_ns: _Span, wanted_ns: _Span, ticks_ns: _Ints, captures: Mapping[str, _Ints]
) -> _Part | None:
    """Between two gaps, of what is wanted what can be decoded, to when the last frame was taken."""
    lower_ns, upper_ns = whole_ns
    ticks = ticks_ns[(ticks_ns > lower_ns) & (ticks_ns < upper_ns)]
    if not len(ticks):
        return None
    start_ns, end_ns = int(max(ticks[0], wanted_ns[0])), int(min(ticks[-1], wanted_ns[1]))
    keyframes: dict[str, _Ints] = {}
    for view, rows in captures.items():
        inside = rows[(rows[:, _ENCODED] > lower_ns) & (rows[:, _ENCODED] < upper_ns)]
        keyframes[view] = inside[inside[:, _KEYFRAME] == 1, _CAPTURED]
        if not len(keyframes[view]):
            return None
        start_ns = max(start_ns, int(keyframes[view][0]))
        end_ns = min(end_ns, int(inside[-1, _CAPTURED]))
    if end_ns < start_ns:
        return None
    begun = {view: int(found[found <= start_ns][-1]) for view, found in keyframes.items()}
    return _Part(start_ns, end_ns, begun)

"""One summary of a session on two computers, from the logs of both sides.

The two clocks are brought together by the messages that both have logged: of those that went one
way, the one that took least bounds their offset from one side, of those that came back from the
other. Between the bounds nothing shows where it is: the middle is taken, and half of their distance
is the uncertainty of every figure that spans both computers.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tams_app.errors import LogError
from tams_app.link.messages import OPERATOR_FACT, SESSION_FACT
from tams_app.prediction.present import PREDICTED_FACT
from tams_app.recording import Header, SessionLog
from tams_app.recording.reader import ShownPicture
from tams_app.recording.topics import FrameShown
from tams_app.records import HandHeard
from tams_app.summary.operator import LINK_NAMES, round_trip_ms
from tams_app.summary.summarise import session_summary
from tams_app.summary.tables import Integers, LogTables, capture_indices, percentiles, ratio
from tams_app.units import NS_PER_MS, NS_PER_S

_OPERATORS_FACTS = ("operator", PREDICTED_FACT)
_BY_LINK = "link "  # so the labels of these reasons begin
_WINDOW_NS = 10 * NS_PER_S  # two clocks of ±50 ppm drift apart by at most a millisecond


@dataclass(frozen=True, slots=True)
class ClockOffsets:
    """The robot's clock minus that of the operator's side, at times of the latter [ns]."""

    t_ns: Integers
    offset_ns: Integers
    uncertainty_ns: int

    def to_robot(self, operator_ns: Integers) -> Integers:
        """Times of the operator's side on the robot's clock; between two windows in proportion."""
        since = self.t_ns[0]
        offsets = np.interp(operator_ns - since, self.t_ns - since, self.offset_ns)
        on_robot: Integers = operator_ns + np.round(offsets).astype(np.int64)
        return on_robot


def in_order(first: SessionLog, second: SessionLog) -> tuple[SessionLog, SessionLog]:
    """The log of the robot's side and that of the operator's; LogError unless they are of one."""
    robot, operator = (second, first) if first.states_received else (first, second)
    if not operator.states_received or robot.states_received or not robot.ticks:
        raise LogError(
            "these are not the two logs of one session: give that of `robot` and that of `operate`"
        )
    sessions = {one.facts.get(SESSION_FACT) for one in (robot, operator)}
    if len(sessions) > 1 or None in sessions:
        raise LogError("these are the logs of two different sessions")
    number = operator.facts.get(OPERATOR_FACT)  # of perhaps several operators of the session
    from_them = [one for one in robot.hands_received if str(one.operator) == number]
    return replace(robot, hands_received=from_them), operator


def clock_offsets(robot: SessionLog, operator: SessionLog) -> ClockOffsets:
    """The clocks' offset in windows of ten seconds; LogError if no message went both ways."""
    went = [(one.sent_ns, one.t_ns) for one in robot.hands_received]
    came = [(one.t_ns, one.sent_ns) for one in operator.states_received]
    there, back = (np.array(way, dtype=np.int64).reshape(-1, 2) for way in (went, came))
    windows_there, windows_back = there[:, 0] // _WINDOW_NS, back[:, 0] // _WINDOW_NS
    rows = []
    for window in np.intersect1d(windows_there, windows_back):
        at_most = np.min(np.diff(there[windows_there == window], axis=1))
        at_least = np.max(np.diff(back[windows_back == window], axis=1))
        middle_ns = int(window) * _WINDOW_NS + _WINDOW_NS // 2
        rows.append((middle_ns, (at_most + at_least) // 2, (at_most - at_least + 1) // 2))
    if not rows:
        raise LogError("the two sides have not heard of each other: there is nothing to join")
    t_ns, offset_ns, uncertainty_ns = np.array(rows, dtype=np.int64).T
    return ClockOffsets(t_ns, offset_ns, int(np.max(uncertainty_ns)))


def joined(robot: SessionLog, operator: SessionLog, offsets: ClockOffsets) -> SessionLog:
    """The robot's log with the frames shown at the operator's side, on the robot's clock."""
    shown = []
    for view in robot.header.views:
        indices = capture_indices(robot, view)
        there = [one for one in operator.shown if one.view == view and one.index in indices]
        times_ns = offsets.to_robot(np.array([one.shown_ns for one in there], dtype=np.int64))
        shown += [
            FrameShown(
                view,
                indices[one.index],
                t_ns,
                one.whole,
                one.received_ns and one.received_ns + t_ns - one.shown_ns,
            )
            for one, t_ns in zip(there, times_ns.tolist(), strict=True)
        ]
    seen_ns = np.array([one.t_ns for one in operator.glances], dtype=np.int64)
    glances = [
        replace(one, t_ns=t_ns)
        for one, t_ns in zip(operator.glances, offsets.to_robot(seen_ns).tolist(), strict=True)
    ]
    facts = {name: operator.facts[name] for name in _OPERATORS_FACTS if name in operator.facts}
    return replace(
        robot,
        shown=shown,
        glances=glances,
        predictions=operator.predictions,
        facts={**robot.facts, **facts},
    )


def on_robots_clock(
    pictures: Iterable[ShownPicture], robot: Header, operator: Header, offsets: ClockOffsets
) -> Iterator[ShownPicture]:
    """Pictures of the operator's side with the times of the robot's wall clock."""
    for picture in pictures:
        there_ns = np.array([picture.shown_ns - operator.wall_offset_ns], dtype=np.int64)
        here_ns = int(offsets.to_robot(there_ns)[0])
        yield replace(picture, shown_ns=here_ns + robot.wall_offset_ns)


def summarise_joined(
    robot: SessionLog, operator: SessionLog, offsets: ClockOffsets, both: LogTables
) -> dict[str, Any]:
    """The summary of the frames as they were shown, and `link`.

    `offsets` and `both`: what `clock_offsets` and `joined` have made of the two logs.
    """
    return {
        **session_summary(both),
        "complete": robot.complete and operator.complete,
        "link": link_figures(robot, operator, offsets),
    }


def link_figures(robot: SessionLog, operator: SessionLog, offsets: ClockOffsets) -> dict[str, Any]:
    """The link's figures; times between the sides are right to within `uncertainty_ms`."""
    received = robot.hands_received
    counted = [one for one in received if not one.refusal]
    posed = [one for one in counted if one.pose_ns]  # those with a pose
    refused = dict(Counter(one.refusal for one in received if one.refusal))
    reported = sum(one.packets for one in robot.uplink)
    return {
        "clock_offset_ms": round(float(np.median(offsets.offset_ns)) / NS_PER_MS, 3),
        "uncertainty_ms": round(offsets.uncertainty_ns / NS_PER_MS, 3),
        "samples": {"heard": len(received), "counted": len(counted), "refused": refused},
        "sample_age_ms": _ages_ms([(one.pose_ns, one.t_ns) for one in posed], offsets),
        "command_latency_ms": _command_latency_ms(robot, posed, offsets),
        "state_age_ms": _state_ages_ms(operator, offsets),
        "round_trip_ms": round_trip_ms(received),
        "stops_per_minute": _stops_per_minute(robot),
        "video": {
            "packets": reported or None,
            "loss_fraction": ratio(sum(one.lost for one in robot.uplink), reported),
        },
        "ignored": {
            "robot": robot.link_health[-1].ignored if robot.link_health else {},
            "operator": operator.link_health[-1].ignored if operator.link_health else {},
        },
    }


def _stops_per_minute(robot: SessionLog) -> dict[str, float]:
    """How often the link stopped the arm, by reason."""
    counts = Counter(stop.reason for stop in robot.stops if stop.reason.startswith(_BY_LINK))
    ticks = robot.ticks
    if not counts or len(ticks) < 2:
        return {}
    minutes = (ticks[-1].started_ns - ticks[0].started_ns) / NS_PER_S / 60.0
    return {reason: round(number / minutes, 2) for reason, number in counts.items()}


def _ages_ms(times_ns: list[tuple[int, int]], offsets: ClockOffsets) -> dict[str, Any]:
    """From when each was made at the operator's side until a time of the robot's."""
    made_ns, at_ns = np.array(times_ns, dtype=np.int64).reshape(-1, 2).T
    return percentiles((at_ns - offsets.to_robot(made_ns)) / NS_PER_MS, LINK_NAMES)


def _command_latency_ms(
    robot: SessionLog, posed: list[HandHeard], offsets: ClockOffsets
) -> dict[str, Any]:
    """From the pose of the hand to the end of the first tick that had it."""
    started = np.array([tick.started_ns for tick in robot.ticks], dtype=np.int64)
    finished = np.array([tick.finished_ns for tick in robot.ticks], dtype=np.int64)
    tick = np.searchsorted(started, [one.t_ns for one in posed])
    acted = [
        (one.pose_ns, int(finished[number]))
        for one, number in zip(posed, tick.tolist(), strict=True)
        if number < len(finished)
    ]
    return _ages_ms(acted, offsets)


def _state_ages_ms(operator: SessionLog, offsets: ClockOffsets) -> dict[str, Any]:
    """Age of the robot's messages when they were received."""
    received = operator.states_received
    at = offsets.to_robot(np.array([one.t_ns for one in received], dtype=np.int64))
    sent = np.array([one.sent_ns for one in received], dtype=np.int64)
    return percentiles((at - sent) / NS_PER_MS, LINK_NAMES)

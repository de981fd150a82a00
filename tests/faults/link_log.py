"""What the log of the robot's side says of an outage: when the arm rested, what was commanded."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tams_app.recording import SessionLog
from tams_app.records import Tick, Vector
from tams_app.teleop.safety import ArmingState, Reason
from tams_app.units import NS_PER_MS, NS_PER_S

REST_M_S = 0.001
_BY_LINK = (Reason.LINK_GAP.label, Reason.LINK_LOST.label)  # a reason may have details
_STOPPED = (ArmingState.HOLDING, ArmingState.FAULT)
_RESTS_WITHIN_NS = 100 * NS_PER_MS  # the stop profile of a hold
_BEFORE = 10  # reports: a tenth of a second
_RESTS_FOR_NS = 100 * NS_PER_MS  # a report or two of the same place are no rest yet


@dataclass(frozen=True, slots=True)
class Outage:
    """How the arm stopped after a link that was away.

    sample_ns: when the last sample that counted was heard; stop_ns: the first tick on hold or in
    fault, with its reason;
    rest_ns: from when on the arm rested, by its own reports; speed_mm_s: its speed when the last
    sample came; travel_mm: how far it went from then until it rested.
    """

    sample_ns: int
    stop_ns: int
    reason: str
    rest_ns: int
    speed_mm_s: float
    travel_mm: float

    @property
    def zero_ns(self) -> int:
        """From then on nothing is commanded, be it a hold or a fault."""
        return self.stop_ns + _RESTS_WITHIN_NS

    def rest_after_ms(self, lost_after_ms: float) -> float:
        """From when the samples' time was up until the arm rested."""
        return (self.rest_ns - self.sample_ns) / NS_PER_MS - lost_after_ms


def outage(log: SessionLog, from_ns: int) -> Outage:
    """The first stop after `from_ns`; StopIteration if there is none."""
    stop = next(tick for tick in log.ticks if tick.started_ns > from_ns and tick.arming in _STOPPED)
    heard = [one.t_ns for one in log.hands_received if not one.refusal]
    sample_ns = max(t_ns for t_ns in heard if t_ns < stop.started_ns)
    t_ns, at_m = arm_way(log.ticks)
    speeds = np.linalg.norm(np.diff(at_m, axis=0), axis=1) / np.diff(t_ns) * NS_PER_S
    first = int(np.searchsorted(t_ns, sample_ns))
    # a report that shows no motion since the one before: the arm rested when that one was made
    rest = next(
        number
        for number in range(first, len(speeds))
        if np.all(speeds[number:][t_ns[number:-1] < t_ns[number] + _RESTS_FOR_NS] < REST_M_S)
    )
    before = max(first - _BEFORE, 0)
    before_m_s = (
        np.linalg.norm(at_m[first] - at_m[before]) / (t_ns[first] - t_ns[before]) * NS_PER_S
    )
    travel_m = float(np.linalg.norm(at_m[rest] - at_m[first]))
    return Outage(
        sample_ns,
        stop.started_ns,
        stop.reason,
        int(t_ns[rest]),
        float(before_m_s) * 1000.0,
        travel_m * 1000.0,
    )


def losses(log: SessionLog, from_ns: int, to_ns: int) -> list[int]:
    """When [ns], between these times, the link stopped an arm that had not stopped."""
    return [
        after.started_ns
        for before, after in pairwise(log.ticks)
        if from_ns < after.started_ns < to_ns
        and before.arming not in _STOPPED
        and after.arming in _STOPPED
        and after.reason.startswith(_BY_LINK)
    ]


def arm_way(ticks: Iterable[Tick]) -> tuple[Vector, Vector]:
    """Times [ns] and places [m], shape (n, 3), of the arm's reports."""
    times: list[int] = []
    places = []
    for tick in ticks:
        if tick.arm is not None and (not times or tick.arm.received_ns > times[-1]):
            times.append(tick.arm.received_ns)
            places.append(tick.arm.tcp.position)
    return np.array(times), np.array(places)


def commanded_mm(log: SessionLog, from_ns: int) -> tuple[float, int]:
    """How far the arm was told to go from `from_ns` until it was armed anew; how many ticks."""
    ticks = ticks_until(log, from_ns, lambda tick: tick.arming == ArmingState.READY)
    period_s = _period_ns(log) / NS_PER_S
    return 1000.0 * sum(float(np.linalg.norm(tick.twist.linear)) * period_s for tick in ticks), len(
        ticks
    )


def travelled_mm(log: SessionLog, from_ns: int) -> float:
    """How far the arm went from `from_ns` until it was armed anew, by its reports."""
    _, at_m = arm_way(ticks_until(log, from_ns, lambda tick: tick.arming == ArmingState.READY))
    return float(np.linalg.norm(np.diff(at_m, axis=0), axis=1).sum()) * 1000.0


def ticks_until(log: SessionLog, from_ns: int, end: Callable[[Tick], bool]) -> list[Tick]:
    """Ticks from `from_ns` to before the first that `end` is true of."""
    found: list[Tick] = []
    for tick in log.ticks:
        if tick.started_ns < from_ns:
            continue
        if end(tick):
            break
        found.append(tick)
    return found


def _period_ns(log: SessionLog) -> float:
    return float(np.median(np.diff([tick.due_ns for tick in log.ticks])))

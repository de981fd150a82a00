"""The rules of episodes: when one begins and ends, and what becomes of it; pure.

A session is divided into episodes. `NEXT` counts down and begins one, and given again ends and
keeps it. What would be lost is discarded by the second of two requests only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from tams_app.records import Episode, EpisodeRequest, EpisodesState, EpisodeState
from tams_app.units import NS_PER_S

ARMED_NS = 5 * NS_PER_S  # for so long a second request counts; a controller's needs more than one
LATE_NS = NS_PER_S  # a `NEXT` so soon after a time limit was to end the episode that it has ended
WARNED_NS = 10 * NS_PER_S  # so long before the time limit of an episode it is announced
SHOWN = 5  # episodes that have ended, on the screen


class Answer(NamedTuple):
    """The effect of a request: a sentence for the operator, and what the log is to keep.

    begins: another episode begins with this request, after its countdown.
    """

    sentence: str
    record: Episode | None = None
    begins: bool = False


@dataclass(frozen=True, slots=True)
class _Armed:
    request: EpisodeRequest
    until_ns: int


class Episodes:
    """The episodes of one session; `step` as time passes, `ask` for what people want.

    Times must not go back. Between two episodes nothing is recorded as one: the operator puts the
    scene in order meanwhile.
    """

    def __init__(self, countdown_s: float, limit_s: float = math.inf, wanted: int = 0) -> None:
        """`countdown_s`: from the request to the begin of an episode.

        `limit_s`: the longest that one may take. `wanted`: how many are to be kept; 0: any number.
        """
        self._countdown_ns = round(countdown_s * NS_PER_S)
        self._limit_s, self._wanted = limit_s, wanted
        self._warn_ns = math.inf
        self._due_ns: int | None = None  # of the begin, in a countdown
        self._start_ns: int | None = None  # of the one that is recorded
        self._armed: _Armed | None = None
        self._late_ns = 0  # until when the first `NEXT` may mean an episode that its limit ended
        self._ended: list[Episode] = []

    @property
    def ended(self) -> tuple[Episode, ...]:
        """All that have ended, in order, each by its newest verdict."""
        return tuple(self._ended)

    @property
    def number(self) -> int:
        """The number of the episode that is recorded, or comes next."""
        return len(self._ended) + 1

    def step(self, now_ns: int) -> str:
        """Let time pass; a sentence if an episode has begun or ends soon, else ""."""
        if self._armed is not None and now_ns >= self._armed.until_ns:
            self._armed = None
        if self._start_ns is not None and now_ns >= self._warn_ns:
            self._warn_ns = math.inf
            left_s = self._limit_s - (now_ns - self._start_ns) / NS_PER_S
            return f"episode {self.number} ends in {left_s:.0f} s, at its time limit, and is kept"
        if self._due_ns is None or now_ns < self._due_ns:
            return ""
        self._start_ns, self._due_ns = self._due_ns, None
        self._warn_ns = self._start_ns + self._limit_s * NS_PER_S - WARNED_NS
        return f"episode {self.number} is recorded"

    def is_overdue(self, now_ns: int) -> bool:
        """True if the one that is recorded has reached its time limit."""
        return self._start_ns is not None and now_ns - self._start_ns >= self._limit_s * NS_PER_S

    @property
    def is_complete(self) -> bool:
        """True if as many are kept as are wanted, and none is begun."""
        is_idle = self._start_ns is None and self._due_ns is None
        return is_idle and 0 < self._wanted <= sum(one.kept for one in self._ended)

    def ask(self, now_ns: int, request: EpisodeRequest) -> Answer:
        """Carry out a request; `step` has been called for `now_ns`."""
        armed, self._armed = self._armed, None
        is_second = armed is not None and armed.request is request
        if request in (EpisodeRequest.DISCARD, EpisodeRequest.REDO):
            return self._discard(now_ns, request, is_second)
        success = None if request is EpisodeRequest.NEXT else request is EpisodeRequest.SUCCESS
        if self._start_ns is not None:
            return self._end(now_ns, kept=True, success=success)
        if request is EpisodeRequest.NEXT:
            late_ns, self._late_ns = self._late_ns, 0
            if now_ns < late_ns:
                what = f"episode {self._ended[-1].number} has just ended, at its time limit"
                return Answer(f"{what}; press again to begin another")
            return self._begin(now_ns)
        return self._label(now_ns, request)

    def state(self, now_ns: int) -> EpisodesState:
        """The episodes as the operator is shown them."""
        doing, since_ns = "idle", now_ns
        if self._due_ns is not None:
            doing, since_ns = "countdown", self._due_ns
        elif self._start_ns is not None:
            doing, since_ns = "recording", self._start_ns
        armed = "" if self._armed is None else self._armed.request.value
        return shown_episodes(self._ended, doing, abs(now_ns - since_ns) / NS_PER_S, armed)

    def close(self) -> str:
        """End the session; a sentence if an episode was running, which is not kept, else ""."""
        if self._start_ns is None:
            return ""
        return f"episode {self.number} was running and is not kept; the log has what was recorded"

    def _begin(self, now_ns: int) -> Answer:
        if self._due_ns is not None:
            return Answer(f"episode {self.number} begins in a moment; discard it to call it off")
        self._due_ns = now_ns + self._countdown_ns
        seconds = self._countdown_ns / NS_PER_S
        sentence = self.step(now_ns) or f"episode {self.number} begins in {seconds:g} s"
        return Answer(sentence, begins=True)

    def _end(self, now_ns: int, *, kept: bool, success: bool | None = None) -> Answer:
        assert self._start_ns is not None, "one is recorded"
        episode = Episode(now_ns, self.number, self._start_ns, now_ns, kept, success)
        self._late_ns = now_ns + LATE_NS if self.is_overdue(now_ns) else 0
        self._start_ns = None
        self._ended.append(episode)
        length_s = (episode.end_ns - episode.start_ns) / NS_PER_S
        return Answer(f"episode {episode.number}, {length_s:.1f} s: {verdict(episode)}", episode)

    def _label(self, now_ns: int, request: EpisodeRequest) -> Answer:
        if not self._ended or not self._ended[-1].kept:
            return Answer("there is no episode to label: the last one was discarded, or none ended")
        return self._judge(now_ns, success=request is EpisodeRequest.SUCCESS)

    def _discard(self, now_ns: int, request: EpisodeRequest, is_second: bool) -> Answer:
        """The running episode, a countdown or, between two, the last one."""
        redo = request is EpisodeRequest.REDO
        if self._due_ns is not None:
            if redo:
                return self._begin(now_ns)
            self._due_ns = None
            return Answer(f"episode {self.number} does not begin")
        is_running = self._start_ns is not None
        if not is_running and not (self._ended and self._ended[-1].kept):
            return self._begin(now_ns) if redo else Answer("there is no episode to discard")
        if not is_second:
            self._armed = _Armed(request, now_ns + ARMED_NS)
            number = self.number if is_running else self._ended[-1].number
            what = f"discard episode {number}" + (" and begin another" if redo else "")
            return Answer(f"{what}? Press again within {ARMED_NS // NS_PER_S} s to confirm")
        answer = self._end(now_ns, kept=False) if is_running else self._judge(now_ns, kept=False)
        if not redo:
            return answer
        return Answer(
            f"{answer.sentence}; {self._begin(now_ns).sentence}", answer.record, begins=True
        )

    def _judge(self, now_ns: int, *, kept: bool = True, success: bool | None = None) -> Answer:
        """Another verdict on the last episode."""
        last = self._ended[-1]
        success = last.success if success is None else success
        self._ended[-1] = episode = replace(last, t_ns=now_ns, kept=kept, success=success)
        return Answer(f"episode {episode.number}: {verdict(episode)}", episode)


def verdict(episode: Episode | EpisodeState) -> str:
    """The verdict on an episode, in words."""
    if not episode.kept:
        return "discarded"
    return {None: "kept", True: "kept, success", False: "kept, failure"}[episode.success]


def shown_episodes(
    ended: Sequence[Episode], doing: str, seconds: float, armed: str = ""
) -> EpisodesState:
    """Episodes as the operator is shown them: all that have `ended`, and what is done now."""
    last = (
        EpisodeState(one.number, (one.end_ns - one.start_ns) / NS_PER_S, one.kept, one.success)
        for one in ended[-SHOWN:]
    )
    kept = sum(one.kept for one in ended)
    return EpisodesState(
        len(ended) + 1, doing, seconds, armed, kept, len(ended) - kept, tuple(last)
    )

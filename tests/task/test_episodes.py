"""The rules of episodes under a clock that is stepped, and what holds whatever people ask."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.records import Episode, EpisodeRequest
from tams_app.task.episodes import ARMED_NS, SHOWN, Episodes, verdict
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

NEXT, DISCARD, REDO = EpisodeRequest.NEXT, EpisodeRequest.DISCARD, EpisodeRequest.REDO
SUCCESS, FAILURE = EpisodeRequest.SUCCESS, EpisodeRequest.FAILURE


class Played:
    """Episodes with their clock, and what their log keeps."""

    def __init__(self, countdown_s: float = 3.0, limit_s: float = math.inf) -> None:
        self.episodes = Episodes(countdown_s, limit_s)
        self.now_ns = 0
        self.log: list[Episode] = []
        self.sentences: list[str] = []

    def wait(self, seconds: float) -> None:
        self.now_ns += round(seconds * NS_PER_S)
        self.sentences += filter(None, [self.episodes.step(self.now_ns)])

    def ask(self, *requests: EpisodeRequest) -> None:
        for request in requests:
            answer = self.episodes.ask(self.now_ns, request)
            self.sentences.append(answer.sentence)
            self.log += filter(None, [answer.record])

    def record(self, seconds: float) -> None:
        """Until it is recorded for that long."""
        self.ask(NEXT)
        self.wait(3.0)
        self.wait(seconds)

    @property
    def doing(self) -> str:
        return self.episodes.state(self.now_ns).doing


def test_the_time_limit_of_an_episode_is_announced_before_it_comes() -> None:
    played = Played(limit_s=120.0)
    played.record(109.9)
    assert played.sentences[-1] == "episode 1 is recorded"
    played.wait(0.2)
    assert played.sentences[-1] == "episode 1 ends in 10 s, at its time limit, and is kept"
    played.wait(9.8)
    assert not played.episodes.is_overdue(played.now_ns)
    played.wait(0.2)
    assert played.episodes.is_overdue(played.now_ns)


def test_a_press_that_comes_just_after_the_time_limit_meant_the_episode_that_has_ended() -> None:
    """It begins none: of that the operator knew nothing, and it would be kept."""
    played = Played(limit_s=120.0)
    for late_s, doing in ((0.9, "idle"), (1.1, "countdown")):
        played.record(120.0)
        played.ask(NEXT)  # at its limit, as `EpisodeKeeper` does
        played.wait(late_s)
        played.ask(NEXT)
        assert played.doing == doing
    assert "episode 1 has just ended, at its time limit; press again" in " ".join(played.sentences)
    played.ask(DISCARD)
    played.record(120.0)
    played.ask(NEXT, NEXT, NEXT)
    assert played.doing == "countdown", "the second press counts"
    played.ask(DISCARD)
    played.record(60.0)
    played.ask(NEXT, NEXT)
    assert played.doing == "countdown", "that one ended by the operator's own press"


def test_an_episode_begins_when_its_countdown_is_over_and_ends_kept() -> None:
    played = Played()
    played.ask(NEXT)
    state = played.episodes.state(NS_PER_S)
    assert (state.doing, state.number, state.seconds) == ("countdown", 1, 2.0)
    played.wait(3.1)
    assert played.doing == "recording"
    assert played.episodes.state(played.now_ns).seconds == pytest.approx(0.1)
    played.wait(6.9)
    played.ask(NEXT)
    assert played.log == [Episode(10 * NS_PER_S, 1, 3 * NS_PER_S, 10 * NS_PER_S, True, None)]
    assert (played.doing, played.episodes.number) == ("idle", 2)


RECORD, SHORT, LONG = "record", ARMED_NS / NS_PER_S - 0.01, ARMED_NS / NS_PER_S  # what is done


@pytest.mark.parametrize(
    ("done", "doing", "log"),
    [
        ([NEXT, NEXT, 3.0], "recording", []),  # a second press in the countdown ends nothing
        ([RECORD, DISCARD], "recording", []),  # one press discards nothing
        ([RECORD, REDO], "recording", []),
        ([RECORD, DISCARD, SHORT, DISCARD], "idle", ["discarded"]),
        ([RECORD, DISCARD, LONG, DISCARD], "recording", []),  # too late for a second press
        ([RECORD, NEXT, DISCARD, NEXT, DISCARD], "idle", ["kept"]),  # another between them
        ([RECORD, NEXT, DISCARD, REDO, DISCARD], "idle", ["kept"]),
        ([RECORD, NEXT, DISCARD, SUCCESS, DISCARD], "idle", ["kept", "kept, success"]),
        ([RECORD, DISCARD, NEXT, DISCARD], "idle", ["kept"]),  # the first was for a running one
        ([RECORD, NEXT, 60.0, DISCARD, DISCARD], "idle", ["kept", "discarded"]),
        ([RECORD, REDO, REDO], "countdown", ["discarded"]),
        ([RECORD, REDO, REDO, 3.0], "recording", ["discarded"]),
        ([RECORD, DISCARD, DISCARD, REDO], "countdown", ["discarded"]),  # is discarded already
        ([NEXT, DISCARD, 10.0], "idle", []),  # a countdown is called off at the first press
        ([NEXT, REDO, 3.0], "recording", []),
        ([RECORD, SUCCESS], "idle", ["kept, success"]),  # a label ends a running one
        ([RECORD, FAILURE], "idle", ["kept, failure"]),
        (
            [RECORD, NEXT, SUCCESS, FAILURE, DISCARD, DISCARD],
            "idle",
            ["kept", "kept, success", "kept, failure", "discarded"],
        ),
        ([RECORD, DISCARD, DISCARD, SUCCESS], "idle", ["discarded"]),  # and is not labelled
        ([SUCCESS], "idle", []),
        ([FAILURE], "idle", []),
        ([DISCARD], "idle", []),
        ([REDO], "countdown", []),
    ],
)
def test_what_is_asked_ends_labels_and_discards_as_the_guide_says(
    done: list[EpisodeRequest | str | float], doing: str, log: list[str]
) -> None:
    played = Played()
    for one in done:
        if isinstance(one, float):
            played.wait(one)
        elif one == RECORD:
            played.record(5.0)
        else:
            played.ask(one)
    assert played.doing == doing
    assert [verdict(one) for one in played.log] == log


def test_a_first_press_is_told_and_a_discarded_episode_keeps_time_and_label() -> None:
    played = Played()
    played.record(5.0)
    played.ask(DISCARD)
    assert played.episodes.state(played.now_ns).armed == DISCARD.value
    played.ask(SUCCESS, DISCARD, DISCARD)
    labelled, discarded = played.log
    assert replace(discarded, t_ns=labelled.t_ns, kept=True) == labelled
    assert played.episodes.ended == (discarded,)


def test_the_last_few_are_shown_with_their_verdicts() -> None:
    played = Played()
    for _ in range(SHOWN + 1):
        played.record(2.0)
        played.ask(SUCCESS)
    last = played.episodes.state(played.now_ns).last
    assert [one.number for one in last] == list(range(2, SHOWN + 2))
    assert all(one.success and one.length_s == 2.0 for one in last)


STEPS = st.lists(
    st.tuples(st.integers(0, 7_000).map(lambda ms: ms * NS_PER_MS), st.sampled_from(EpisodeRequest))
)


@given(steps=STEPS, countdown_s=st.sampled_from([0.0, 0.5, 3.0]))
def test_no_instant_is_of_two_episodes_and_each_ended_one_is_kept_or_discarded_by_two_presses(
    steps: list[tuple[int, EpisodeRequest]], countdown_s: float
) -> None:
    """At each instant the log has all that have ended: whatever happens then, they are whole."""
    played = Played(countdown_s)
    presses: list[tuple[int, EpisodeRequest]] = []
    for pause_ns, request in steps:
        played.wait(pause_ns / NS_PER_S)
        before = {one.number: one for one in played.log}
        played.ask(request)
        newest = {one.number: one for one in played.log}
        assert tuple(newest.values()) == played.episodes.ended
        state = played.episodes.state(played.now_ns)
        assert state.kept + state.discarded == len(newest)
        assert list(newest) == list(range(1, state.number))
        for number, episode in newest.items():
            was_kept = number not in before or before[number].kept
            if was_kept and not episode.kept:
                last_ns, last = presses[-1]
                assert request in (DISCARD, REDO)
                assert last is request
                assert played.now_ns - last_ns < ARMED_NS
        presses.append((played.now_ns, request))
    for one, other in pairwise(played.episodes.ended):
        assert one.start_ns <= one.end_ns <= other.start_ns <= other.end_ns

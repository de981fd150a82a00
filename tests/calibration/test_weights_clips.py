"""Cutting clips: which stretches, the right frames at the right instants, and nothing twice."""

from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.kit import quiet
from calibration.weights import clips as clip_file
from calibration.weights.clips import ClipFolder, ClipWriter, play
from calibration.weights.cutting import (
    LONGEST_S,
    SHORTEST_S,
    STRIP_HEIGHT,
    cut_session,
    newest_at,
    open_session,
    phase_segments,
    select,
)
from tams_app.errors import ConfigError, LogError, SetupError
from tams_app.records import Frame, Phase, PhaseChange
from tams_app.units import NS_PER_S
from tests.calibration.weights_session import (
    HEIGHT,
    WIDTH,
    add_captures,
    image_of,
    record_session,
    seen,
)
from tests.synthetic_session import FPS, VIEWS, capture_ns

pytestmark = pytest.mark.waiting

S = NS_PER_S
TWO_PHASES = [(0.0, Phase.REACH), (0.7, Phase.ALIGN)]

changes = st.lists(
    st.builds(PhaseChange, st.integers(0, 60 * S), st.sampled_from(Phase), st.just("")), max_size=12
)


@given(changes, st.integers(0, 30 * S), st.integers(0, 60 * S), st.floats(0, 2))
def test_segments_follow_each_other_within_the_frames_time_and_context_leaves_none_out(
    phases, first_ns, last_ns, context_s
):
    segments = phase_segments(phases, first_ns, last_ns)
    for one, following in pairwise(segments):
        assert one.end_ns <= following.start_ns
    around = phase_segments(phases, first_ns, last_ns, context_s)
    assert [segment.phase for segment in around] == [segment.phase for segment in segments]
    for one, other in zip(segments, around, strict=True):
        assert first_ns <= other.start_ns <= one.start_ns < one.end_ns <= other.end_ns <= last_ns


@given(changes)
def test_every_phase_that_lasts_gives_one_clip_within_the_bounds(phases):
    segments = phase_segments(phases, 0, 60 * S)
    chosen = select(segments)
    assert all(SHORTEST_S <= segment.seconds <= LONGEST_S for segment in chosen)
    lasting = {segment.phase for segment in segments if segment.seconds >= SHORTEST_S}
    assert [segment.phase for segment in chosen] == [one for one in Phase if one in lasting]


def test_a_long_phase_is_shortened_to_its_end_and_the_sessions_last_to_its_beginning():
    phases = [PhaseChange(0, Phase.REACH, ""), PhaseChange(20 * S, Phase.ALIGN, "")]
    reach, align = select(phase_segments(phases, 0, 40 * S))
    assert (reach.start_ns, reach.end_ns) == (12 * S, 20 * S)
    assert (align.start_ns, align.end_ns) == (20 * S, 28 * S)


@given(
    st.lists(st.tuples(st.sampled_from(VIEWS), st.integers(0, 1000)), max_size=60),
    st.lists(st.integers(0, 1200), max_size=30),
)
def test_each_instant_shows_every_views_newest_frame_of_that_time(captures, wanted):
    captures.sort(key=lambda capture: capture[1])
    wanted.sort()
    frames = [
        Frame(view, 0, t_ns, np.full((1, 1, 3), number, np.uint8))
        for number, (view, t_ns) in enumerate(captures)
    ]
    moments = list(newest_at(iter(frames), wanted))
    assert [t_ns for t_ns, _ in moments] == wanted
    for t_ns, images in moments:
        for view in VIEWS:
            before = [n for n, (of, at) in enumerate(captures) if of == view and at <= t_ns]
            assert images[view][0, 0, 0] == before[-1] if before else view not in images


def frames_of(path):
    video = cv2.VideoCapture(str(path))
    assert video.get(cv2.CAP_PROP_FPS) == FPS
    frames = []
    while (got := video.read())[0]:
        frames.append(got[1])
    return frames


def part(frame, view):
    at = VIEWS.index(view) * WIDTH
    return frame[STRIP_HEIGHT:, at : at + WIDTH]


def test_a_session_is_cut_into_clips_that_show_all_views_as_they_were(tmp_path):
    session = open_session(record_session(tmp_path / "s1", TWO_PHASES, 1.5), VIEWS)
    folder = ClipFolder(tmp_path / "clips")
    cut = cut_session(session, folder, quiet)
    assert cut.shows == "as sent, no bottleneck"
    reach, align = folder.clips()
    assert (reach.phase, align.phase) == (Phase.REACH, Phase.ALIGN)
    assert reach.seconds == pytest.approx(0.7)
    for clip, first, count in ((reach, 0, 21), (align, 21, 22)):
        frames = frames_of(clip.path)
        assert len(frames) == count
        assert np.ptp(frames[0][:STRIP_HEIGHT]) > 100  # something is written there
        for number, frame in enumerate(frames):
            found = [seen(part(frame, view)) for view in VIEWS]
            assert found == [(view, first + number) for view in VIEWS]


def test_a_session_that_is_left_half_way_is_given_up_without_a_complaint(tmp_path, glib_complaints):
    frames = open_session(record_session(tmp_path / "s1", TWO_PHASES, 1.5), VIEWS).frames()
    assert next(frames).capture_ns == capture_ns(0)
    frames.close()


def test_lossless_captures_are_taken_where_there_are_some_else_a_narrow_network_is_told(tmp_path):
    folder = record_session(tmp_path / "s1", [(0.0, Phase.REACH), (0.5, Phase.ALIGN)], 0.6, "s3")
    session = open_session(folder, VIEWS)
    assert session.is_constrained
    assert session.shows == "as sent over s3"
    add_captures(folder, 15)
    session = open_session(folder, VIEWS)
    assert not session.is_constrained
    clips = ClipFolder(tmp_path / "clips")
    assert cut_session(session, clips, quiet).shows == "lossless captures"
    frames = frames_of(clips.file(Phase.REACH, "s1"))
    shown = [seen(255 - part(frame, "gs")) for frame in frames]
    assert shown == [("gs", index) for index in range(15)]


def test_captures_that_end_before_the_session_do_not_stand_still_for_the_rest(tmp_path):
    folder = record_session(tmp_path / "s1", [(0.0, Phase.REACH), (0.5, Phase.ALIGN)], 1.2)
    add_captures(folder, 15)
    clips = ClipFolder(tmp_path / "clips")
    with pytest.raises(LogError, match=r"the last 0\.7 s have no frames of eih.*reference\.mcap"):
        cut_session(open_session(folder, VIEWS), clips, quiet)
    assert clips.sessions()["s1"].clips
    assert not clips.there()["s1"].clips  # what a result may name
    (folder / "reference.mcap").unlink()
    cut_session(open_session(folder, VIEWS), clips, quiet)
    assert list(clips.there()["s1"].clips) == [Phase.REACH, Phase.ALIGN]


def test_what_is_cut_already_is_not_cut_again_and_what_is_missing_is(tmp_path):
    session = open_session(record_session(tmp_path / "s1", TWO_PHASES, 1.5), VIEWS)
    folder = ClipFolder(tmp_path / "clips")
    cut_session(session, folder, quiet)
    reach, align = (folder.file(phase, "s1") for phase in (Phase.REACH, Phase.ALIGN))
    untouched, whole = reach.stat().st_mtime_ns, frames_of(align)
    align.unlink()
    cut = cut_session(session, folder, quiet)
    assert reach.stat().st_mtime_ns == untouched
    assert len(frames_of(align)) == len(whole)
    assert np.array_equal(frames_of(align)[-1], whole[-1])
    other = cut.model_copy(update={"recorded": "2020-01-01T00:00:00.000+00:00"})
    with pytest.raises(ConfigError, match="another session named s1: rename one folder"):
        folder.add("s1", other)


def test_an_interrupted_clip_leaves_no_half_file_and_is_cut_the_next_time(tmp_path):
    session = open_session(record_session(tmp_path / "s1", TWO_PHASES, 1.5), VIEWS)
    folder = ClipFolder(tmp_path / "clips")

    def interrupt(doing, part):
        if doing.startswith("ALIGN") and part > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cut_session(session, folder, interrupt)
    assert [clip.phase for clip in folder.clips()] == [Phase.REACH]
    assert not list(folder.path.glob("*.part"))
    cut_session(session, folder, quiet)
    assert [clip.phase for clip in folder.clips()] == [Phase.REACH, Phase.ALIGN]


def test_a_phase_too_short_for_a_clip_is_cut_with_its_context_if_that_is_wanted(tmp_path):
    phases = [(0.0, Phase.ALIGN), (0.6, Phase.GRASP), (0.8, Phase.TRANSPORT)]
    session = open_session(record_session(tmp_path / "s1", phases, 1.5), VIEWS)
    folder = ClipFolder(tmp_path / "clips")
    cut_session(session, folder, quiet)
    assert [clip.phase for clip in folder.clips()] == [Phase.ALIGN, Phase.TRANSPORT]
    cut = cut_session(session, folder, quiet, context_s=0.5)
    assert cut.context_s == 0.5
    align, grasp, transport = folder.clips()
    assert grasp.seconds == pytest.approx(1.2)
    shown = [seen(part(frame, "eih"))[1] for frame in frames_of(grasp.path)]
    assert shown == list(range(3, 39))
    # what was cut without context before is cut anew
    assert seen(part(frames_of(transport.path)[0], "eih"))[1] == 9
    assert len(frames_of(align.path)) == 33


FLICKER = [(0.1 * n, (Phase.REACH, Phase.ALIGN)[n % 2]) for n in range(5)]


@pytest.mark.parametrize(
    ("phases", "seconds", "changes", "words"),
    [
        ([], 0.1, {}, "has no phases"),
        (FLICKER, 0.5, {}, "no phase lasts long enough"),
        (TWO_PHASES, 0.0, {}, "s1: has no frames of eih"),
        (TWO_PHASES, 0.1, {"recording": {"bitstream": False}}, r"set recording\.bitstream: true"),
        (TWO_PHASES, 0.1, {"video": {"colour": "grey"}}, r"another version .*: video\.colour: no"),
    ],
)
def test_a_session_that_gives_no_clips_is_refused(tmp_path, phases, seconds, changes, words):
    folder = record_session(tmp_path / "s1", phases, seconds, changes=changes)
    with pytest.raises(LogError, match=words):
        cut_session(open_session(folder, VIEWS), ClipFolder(tmp_path / "clips"), quiet)
    with pytest.raises(ConfigError, match="shows the views eih, gt, gs"):
        open_session(folder, ("eih", "gt"))


def test_a_clip_that_cannot_be_written_is_told(tmp_path):
    with pytest.raises(SetupError, match=r"x\.mp4"):
        ClipWriter(tmp_path / "nowhere" / "x.mp4", WIDTH, HEIGHT, FPS)


def test_a_clip_is_played_to_its_end_in_a_window(tmp_path, monkeypatch, screen):
    path = tmp_path / "clip.mp4"
    writer = ClipWriter(path, WIDTH, HEIGHT, FPS)
    for index in range(10):
        writer.add(image_of("gt", index))
    writer.finish()
    blank = screen.photograph()
    screens, shut_down = [], clip_file.gst.shut_down

    def photograph_and_shut_down(pipeline):
        screens.append(screen.photograph())
        shut_down(pipeline)

    monkeypatch.setattr(clip_file.gst, "shut_down", photograph_and_shut_down)
    play(path)
    assert not np.array_equal(screens[-1], blank)  # the last frame was on the screen


@pytest.mark.usefixtures("screen")
def test_a_broken_clip_or_no_display_is_told_and_the_clip_not_taken_as_seen(tmp_path, monkeypatch):
    path = tmp_path / "clip.mp4"
    path.write_bytes(b"no frames" * 100)
    with pytest.raises(SetupError, match=r"clip\.mp4: cannot be shown: .* delete it"):
        play(path)
    monkeypatch.delenv("DISPLAY")
    with pytest.raises(SetupError, match="no display"):
        play(path)

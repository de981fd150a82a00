"""Which codecs a session uses, tried on encoders and decoders that are here in hardware's place."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.config import VideoConfig
from tams_app.units import NS_PER_S
from tams_app.video.core import codecs
from tams_app.video.core.codecs import AVDEC, SOFTWARE, X264, Decoder, Encoder
from tams_app.video.core.frame_interval import FrameTime
from tams_app.video.core.rate_control import Overdraft
from tams_app.video.live import codec_choice
from tams_app.video.live.codec_choice import choose_codecs
from tests.video.streams import stream

pytestmark = pytest.mark.waiting

OPENH264 = Encoder(
    "nvh264",
    "openh264enc",
    ("bitrate={bps}", "rate-control=bitrate", "no-such-setting=7", "gop-size={keyframe_interval}"),
    rate="{bps}",
    caps="profile=constrained-baseline,",
    pixels="I420",
)
NO_DECODER = Decoder("nvh264dec", "nosuchdec")
STANDS_STILL = replace(X264, word="nvh264", rate_property="key-int-max", rate="{kbps}")


def choice(
    monkeypatch,
    encoder=None,
    word="nvh264",
    timeout_s=30.0,
    decoder="avdec",
    starts_at_capacity=True,
):
    """What is chosen if hardware's entries were these; by default of elements that do not exist."""
    encoder = encoder or replace(OPENH264, element="nosuchenc")
    monkeypatch.setattr(codec_choice, "ENCODERS", {"nvh264": encoder, "x264": X264})
    monkeypatch.setattr(codec_choice, "DECODERS", {"nvh264dec": NO_DECODER, "avdec": AVDEC})
    video = VideoConfig(encoder=word, decoder=decoder)
    return choose_codecs(video, starts_at_capacity, timeout_s)


def refused(monkeypatch, encoder, timeout_s=30.0):
    """The sentence with which x264 stands in."""
    found = choice(monkeypatch, encoder, timeout_s=timeout_s)
    assert found.encoder is X264
    (remark,) = found.remarks
    assert remark.startswith("video.encoder: ")
    assert remark.endswith("; x264enc is used")
    return remark


def test_by_default_software_is_used_and_nothing_tried(monkeypatch):
    monkeypatch.setattr(codec_choice, "HelperProcess", None)
    assert choose_codecs(VideoConfig(), True) == SOFTWARE


def test_x264_and_avdec_are_set_up_as_they_always_were():
    assert X264.launch(VideoConfig(), 1500) == (
        "videoconvert name=converter n-threads=1 ! video/x-raw,format=I420 "
        "! x264enc name=encoder tune=zerolatency threads=1 speed-preset=superfast "
        "bitrate=1500 vbv-buf-capacity=33 key-int-max=600 aud=false "
        "! video/x-h264,profile=high,stream-format=byte-stream,alignment=au"
    )
    assert AVDEC.launch == (
        "avdec_h264 name=decoder max-threads=1 ! videoconvert n-threads=1 ! video/x-raw,format=I420"
    )


def test_every_word_of_the_configuration_has_its_codec():
    for words, known in (("encoder", codecs.ENCODERS), ("decoder", codecs.DECODERS)):
        for word in known:
            assert getattr(VideoConfig.model_validate({words: word}), words) == word
            assert known[word].word == word


def test_the_decoder_of_older_logs_is_understood():
    assert VideoConfig.model_validate({"decoder": "avdec_h264"}).decoder == "avdec"


def test_hardware_that_is_not_here_is_replaced_in_a_sentence(monkeypatch):
    found = choice(monkeypatch, decoder="nvh264dec")
    assert (found.encoder, found.decoder) == (X264, AVDEC)
    assert found.remarks == (
        "video.encoder: nosuchenc is not on this machine; x264enc is used",
        "video.decoder: nosuchdec is not on this machine; avdec_h264 is used",
    )


def test_auto_says_nothing_where_there_is_no_hardware(monkeypatch):
    assert choice(monkeypatch, word="auto", decoder="auto") == SOFTWARE


@pytest.mark.parametrize("word", ["nvh264", "auto"])
def test_an_encoder_that_passes_is_used_with_the_settings_that_it_has_here(monkeypatch, word):
    found = choice(monkeypatch, OPENH264, word=word)
    assert not found.remarks
    assert found.encoder.adjustable
    kept = tuple(name for name in OPENH264.settings if "no-such" not in name)
    assert found.encoder == replace(OPENH264, settings=kept)


def test_an_encoder_with_b_frames_is_refused(monkeypatch):
    settings = ("bitrate={kbps}", "bframes=2", "b-adapt=false", "rc-lookahead=0")
    reordering = replace(X264, word="nvh264", settings=settings)
    assert "x264enc keeps frames back" in refused(monkeypatch, reordering)


def test_an_encoder_that_makes_only_keyframes_is_refused(monkeypatch):
    intra = replace(X264, word="nvh264", settings=(*X264.settings[:-2], "key-int-max=1"))
    assert "keyframes without being asked" in refused(monkeypatch, intra)


def test_an_encoder_whose_pipeline_cannot_be_is_refused(monkeypatch):
    impossible = replace(OPENH264, caps="profile=high-4:4:4,")
    assert "cannot build a pipeline" in refused(monkeypatch, impossible)


def test_a_driver_that_hangs_costs_no_more_than_the_time_that_it_is_given(monkeypatch):
    settings = ("tune=zerolatency ! identity sleep-time=3600000000",)
    hanging = replace(X264, word="nvh264", settings=settings)
    assert "the probe of x264enc was not ready within 1 s" in refused(monkeypatch, hanging, 1.0)


def test_an_encoder_whose_rate_stands_is_used_only_if_it_was_asked_for(monkeypatch):
    asked = choice(monkeypatch, STANDS_STILL)
    assert not asked.encoder.adjustable
    (remark,) = asked.remarks
    assert "cannot change its bitrate while it plays" in remark
    automatic = choice(monkeypatch, STANDS_STILL, word="auto")
    assert automatic.encoder is X264
    assert "cannot change its bitrate" in automatic.remarks[0]


def test_an_encoder_whose_rate_stands_is_not_left_at_the_floor_where_the_capacity_is_learnt(
    monkeypatch,
):
    learning = choice(monkeypatch, STANDS_STILL, starts_at_capacity=False)
    assert learning.encoder is X264
    (remark,) = learning.remarks
    assert "would stay at the floor; x264enc is used" in remark


def test_a_decoder_that_passes_is_used_and_one_that_keeps_frames_back_is_not(monkeypatch):
    prompt = Decoder("nvh264dec", "avdec_h264", ("max-threads=1", "no-such-setting=7"))
    monkeypatch.setattr(codec_choice, "DECODERS", {"nvh264dec": prompt, "avdec": AVDEC})
    found = choose_codecs(VideoConfig(decoder="nvh264dec"), True, 30.0)
    assert (found.decoder.settings, found.remarks) == (("max-threads=1",), ())
    late = replace(prompt, settings=("max-threads=4", "thread-type=frame"))
    monkeypatch.setattr(codec_choice, "DECODERS", {"nvh264dec": late, "avdec": AVDEC})
    found = choose_codecs(VideoConfig(decoder="auto"), True, 30.0)
    assert found.decoder is AVDEC
    assert "avdec_h264 keeps frames back" in found.remarks[0]


# --- what an encoder cannot do, the sender makes up for ------------------------------------------


def sent_kbps(encoder, start_kbps, target_kbps, seconds=4):
    """Wire rate of a real stream in its second half, and how many frames were left out."""
    with stream(kbps=start_kbps, fps=30, encoder=encoder) as joined:
        joined.sender.set_target_kbps(target_kbps)
        joined.push(range(15 * seconds))
        before = joined.sender.wire_bytes
        joined.push(range(15 * seconds, 30 * seconds))
        sent = joined.sender.wire_bytes - before
    return sent * 8 / 1000 / (seconds / 2), len(joined.dropped)


@pytest.mark.parametrize("target_kbps", [400.0, 2000.0])
def test_an_encoder_of_uneven_frames_keeps_to_its_target_and_uses_most_of_it(target_kbps):
    encoder = replace(OPENH264, settings=(OPENH264.settings[0], OPENH264.settings[3]))
    kbps, _ = sent_kbps(encoder, 1000.0, target_kbps)
    assert 0.65 * target_kbps < kbps < 1.1 * target_kbps


def test_an_encoder_that_stays_at_its_rate_leaves_frames_out_to_meet_the_target():
    kbps, dropped = sent_kbps(replace(STANDS_STILL, adjustable=False), 1500.0, 500.0)
    assert dropped > 40
    assert kbps == pytest.approx(500.0, rel=0.15)


@given(
    st.lists(st.integers(0, 60_000), min_size=1, max_size=200),
    st.floats(100.0, 8000.0),
    st.floats(5.0, 60.0),
)
def test_whatever_an_encoder_makes_no_more_leaves_than_the_time_pays_and_two_frames(
    sizes, target_kbps, rate_hz
):
    time = FrameTime(round(NS_PER_S / rate_hz), round(NS_PER_S / rate_hz))
    paid_bytes = target_kbps / 8e6 * time.usual_ns
    overdraft, sent = Overdraft(), 0
    for number, size in enumerate(sizes):
        if overdraft.keep(sent, target_kbps, time):
            sent += size
        assert sent <= (number + 3) * paid_bytes + max(sizes) + 1
    if max(sizes) <= paid_bytes:
        assert sent == sum(sizes)  # one that keeps to its share loses nothing

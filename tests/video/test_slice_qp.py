"""The QP that is read from real encoders' bytes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app import gst
from tams_app.video.slice_qp import SliceQp

pytestmark = pytest.mark.waiting

_FRAMES = 12
_WAIT_NS = 20_000_000_000


def encoded(settings="", profile="high", by="x264enc tune=zerolatency threads=1"):
    """Access units of a moving test picture."""
    pipeline = gst.parse_pipeline(
        f"videotestsrc num-buffers={_FRAMES} pattern=ball ! video/x-raw,width=320,height=240 "
        f"! videoconvert ! video/x-raw,format=I420 ! {by} {settings} "
        f"! video/x-h264,profile={profile},stream-format=byte-stream,alignment=au "
        "! appsink name=out sync=false"
    )
    gst.set_playing(pipeline, "the encoder")
    sink = pipeline.get_by_name("out")
    units = []
    while (sample := sink.emit("try-pull-sample", _WAIT_NS)) is not None:
        units.append(sample.get_buffer().extract_dup(0, sample.get_buffer().get_size()))
    gst.shut_down(pipeline)
    assert len(units) == _FRAMES
    return units


@pytest.mark.parametrize("profile", ["high", "main", "constrained-baseline"])
@pytest.mark.parametrize("preset", ["ultrafast", "superfast", "medium"])
def test_it_is_the_one_that_the_encoder_was_told(preset, profile):
    for told in (18, 31):
        reader = SliceQp()
        units = encoded(f"pass=quant quantizer={told} speed-preset={preset} aud=false", profile)
        read = [reader.read(unit) for unit in units]
        assert set(read[1:]) == {told}


@pytest.mark.parametrize("settings", ["cabac=false", "dct8x8=true", "interlaced=true"])
def test_other_streams_of_x264_tell_a_qp_or_nothing(settings):
    reader = SliceQp()
    read = [reader.read(unit) for unit in encoded(f"bitrate=300 {settings}")]
    assert all(qp is None or qp in range(52) for qp in read)


def test_b_frames_do_not_tell():
    reader = SliceQp()
    settings = "bitrate=300 bframes=2 b-adapt=false rc-lookahead=4 tune=0"
    read = [reader.read(unit) for unit in encoded(settings)]
    assert None in read
    assert any(qp is not None for qp in read)


def test_another_encoder_s_stream_tells_its_qp():
    reader = SliceQp()
    read = [reader.read(unit) for unit in encoded(profile="constrained-baseline", by="openh264enc")]
    assert all(qp in range(52) for qp in read)


def unit(head, bits):
    """A NAL unit whose header byte is `head`, with emulation prevention."""
    bits += "1" + "0" * (-(len(bits) + 1) % 8)
    content = int(bits, 2).to_bytes(len(bits) // 8, "big")
    while b"\0\0\0" in content:
        content = content.replace(b"\0\0\0", b"\0\0\3\0", 1)
    return b"\0\0\1" + bytes([head]) + content


def golomb(number):
    text = f"{number + 1:b}"
    return "0" * (len(text) - 1) + text


def test_bytes_that_were_put_in_to_break_up_zeros_do_not_count():
    numbers = golomb(0) + golomb(12) + golomb(0) + golomb(12)  # 16 bits for number and order
    sequence = unit(0x67, f"{66:08b}" + "0" * 16 + numbers + golomb(1) + "0" + golomb(9) * 2 + "1")
    zeros = golomb(0) * 2
    picture = unit(0x68, zeros + "00" + golomb(0) + zeros + "000" + golomb(0) * 3 + "000")
    slice_ = golomb(0) + golomb(5) + golomb(0) + "0" * 32 + "0" + "0" + "0" + golomb(7)
    assert b"\0\0\3" in unit(0x41, slice_)
    assert SliceQp().read(sequence + picture + unit(0x41, slice_)) == 26 + 4


def test_a_stream_that_is_read_from_its_middle_does_not_tell():
    unit = encoded("pass=quant quantizer=24")[3]
    assert SliceQp().read(unit) is None


@given(st.binary(max_size=200), st.integers(0, 80))
def test_damaged_bytes_never_raise(noise, cut):
    for start in (b"", b"\0\0\1\x67", b"\0\0\1\x68", b"\0\0\1\x65"):
        SliceQp().read(start + noise[cut:])

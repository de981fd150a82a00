"""Encoders and decoders: how they are set up, and what is refused where they are not here."""

from __future__ import annotations

import pytest

from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.errors import SetupError
from tams_app.video.core import codecs
from tams_app.video.core.codecs import SOFTWARE
from tams_app.video.live.installed_codecs import installed_codecs

pytestmark = pytest.mark.waiting


def test_by_default_software_is_used_with_all_its_settings():
    assert installed_codecs(VideoConfig()) == SOFTWARE


def test_every_element_of_the_configuration_has_its_codec():
    for key, known in (("encoder", codecs.ENCODERS), ("decoder", codecs.DECODERS)):
        for element in known:
            assert getattr(VideoConfig.model_validate({key: element}), key) == element
            assert known[element].element == element


@pytest.mark.parametrize(
    ("key", "word", "element"),
    [
        ("encoder", "x264", "x264enc"),
        ("encoder", "auto", "x264enc"),
        ("encoder", "nvh264", "nvh264enc"),
        ("decoder", "avdec", "avdec_h264"),
        ("decoder", "auto", "avdec_h264"),
    ],
)
def test_the_words_of_older_logs_are_understood(key, word, element):
    assert getattr(VideoConfig.model_validate({key: word}), key) == element


@pytest.mark.parametrize(("key", "element"), [("encoder", "nvh264enc"), ("decoder", "nvh264dec")])
def test_an_element_that_is_not_here_is_refused_in_one_sentence(monkeypatch, key, element):
    sentence = f"video.{key}: GStreamer lacks {element}; install a package, or leave the key out"
    here = {"encoder": "x264enc", "decoder": "avdec_h264"}[key]

    def missing(names):
        return {name: "a package" for name in names if name == element}

    monkeypatch.setattr(gst, "missing_elements", missing)
    with pytest.raises(SetupError, match=sentence) as refusal:
        installed_codecs(VideoConfig.model_validate({key: element}))
    assert str(refusal.value).endswith(f"for {here}")


def test_settings_that_an_element_does_not_have_are_left_out():
    assert gst.known_settings("x264enc", ("bitrate=7", "no-such=1")) == ("bitrate=7",)

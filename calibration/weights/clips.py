"""The folder of clips: which there are, from which sessions, and what was left out."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, TypeVar

import yaml
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from calibration.store import write_text
from tams_app import gst
from tams_app.config.section import describe_validation_error
from tams_app.config.yaml_file import read_yaml
from tams_app.errors import ConfigError, SetupError
from tams_app.faces.display import require_display
from tams_app.outputs import is_plain_name
from tams_app.records import Image, Phase
from tams_app.units import NS_PER_MS, NS_PER_S

_INDEX = "clips.yaml"
_HEADER = "# Written by `run_tams.py calibrate weights`: what each clip shows.\n"


@dataclass(frozen=True, slots=True)
class Clip:
    """One phase of one session, all views side by side."""

    path: Path
    phase: Phase
    seconds: float


class Kept(BaseModel):
    """What a YAML file keeps."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


Model = TypeVar("Model", bound=Kept)


def read_kept(path: Path, model: type[Model]) -> Model:
    """What a file keeps; ConfigError if it was spoilt."""
    try:
        return model.model_validate(read_yaml(path))
    except ValidationError as error:
        raise ConfigError(f"{path}: {describe_validation_error(error, model)}") from error


class CutSession(Kept):
    """What was cut from one session; times in seconds from its start."""

    model_config = ConfigDict(extra="ignore")  # what earlier versions counted besides

    recorded: str  # UTC
    shows: Annotated[str, Field(alias="picture")]  # the quality of the frames, in words
    constrained: bool  # not at full quality, as the paper's were
    rig: bool = False  # recorded on the simulated rig
    context_s: float  # shown before and after each phase
    clips: dict[Phase, ClipTimes]


class ClipTimes(Kept):
    """Where in its session a clip is."""

    start_s: float
    seconds: float


def _plain_name(text: str) -> str:
    if not is_plain_name(text):
        raise ValueError("must be a plain name, for files are named after it")
    return text


class _Index(Kept):
    sessions: dict[Annotated[str, AfterValidator(_plain_name)], CutSession] = {}


class ClipFolder:
    """The clips and their index."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def sessions(self) -> dict[str, CutSession]:
        """What was cut so far, by session; ConfigError if the index was spoilt."""
        index = self.path / _INDEX
        return read_kept(index, _Index).sessions if index.is_file() else {}

    def there(self) -> dict[str, CutSession]:
        """The same, without the clips that were not finished or are gone."""
        found = {}
        for name, session in self.sessions().items():
            clips = {p: times for p, times in session.clips.items() if self.file(p, name).is_file()}
            found[name] = session.model_copy(update={"clips": clips})
        return found

    def clips(self) -> list[Clip]:
        """Every clip that is there, by phase and session."""
        there = sorted(self.there().items())
        return [
            Clip(self.file(phase, name), phase, session.clips[phase].seconds)
            for phase in Phase
            for name, session in there
            if phase in session.clips
        ]

    def file(self, phase: Phase, session: str) -> Path:
        """Where the clip of a phase of a session is, or will be."""
        return self.path / f"{phase.value}-{session}.mp4"

    def add(self, name: str, session: CutSession) -> None:
        """Enter a session before its clips are cut; those that were cut otherwise before go.

        ConfigError if another session has its name.
        """
        known = self.sessions()
        if before := known.get(name):
            if before.recorded != session.recorded:
                raise ConfigError(
                    f"{self.path / _INDEX}: knows another session named {name}: rename one folder"
                )
            for phase, times in before.clips.items():
                if session.clips.get(phase) != times or before.shows != session.shows:
                    self.file(phase, name).unlink(missing_ok=True)
        content = _Index(sessions=known | {name: session}).model_dump(mode="json", by_alias=True)
        text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None)
        write_text(self.path / _INDEX, _HEADER + text)


_QUANTISER = 18  # of x264: hardly distinguishable from the original
_WRITING = ("appsrc", "videoconvert", "x264enc", "h264parse", "mp4mux", "filesink")
_PLAYING = ("filesrc", "qtdemux", "h264parse", "avdec_h264", "videoconvert", "autovideosink")
_FLUSH_NS = 60 * NS_PER_S
_POLL_NS = 50 * NS_PER_MS


class ClipWriter:
    """Writes one clip; the file is there, whole, after `finish` and not before."""

    def __init__(self, path: Path, width: int, height: int, fps: int) -> None:
        """`width` and `height` of every image [pixels]."""
        gst.require_elements(_WRITING)
        self._path, self._fps = path, fps
        self._partial = path.with_suffix(".part")
        self._count = 0
        self._pipeline = gst.parse_pipeline(
            "appsrc name=images format=time block=true max-buffers=4 max-bytes=0 "
            f'caps="video/x-raw,format=BGR,width={width},height={height},framerate={fps}/1" '
            "! videoconvert ! video/x-raw,format=I420 "
            f"! x264enc pass=quant quantizer={_QUANTISER} speed-preset=superfast key-int-max={fps} "
            "! video/x-h264,profile=high ! h264parse ! mp4mux faststart=true "
            "! filesink name=file async=false"
        )
        self._pipeline.get_by_name("file").set_property("location", str(self._partial))
        self._images = self._pipeline.get_by_name("images")
        try:
            gst.set_playing(self._pipeline, f"writing {path.name}")
        except SetupError:
            self.close()
            raise

    def add(self, image: Image) -> None:
        """The next image, BGR; SetupError if it cannot be written."""
        pts_ns = self._count * NS_PER_S // self._fps
        buffer = gst.raw_buffer(image, pts_ns, NS_PER_S // self._fps)
        self._count += 1
        self._images.emit("push-buffer", buffer)
        if reason := gst.poll_bus(self._pipeline):
            raise SetupError(f"{self._path}: cannot be written: {reason}")

    def finish(self) -> None:
        """Complete the file and give it its name; SetupError if it cannot be written."""
        kinds = gst.load().Gst.MessageType
        self._images.emit("end-of-stream")
        message = self._pipeline.get_bus().timed_pop_filtered(_FLUSH_NS, kinds.EOS | kinds.ERROR)
        ended = message is not None and message.type == kinds.EOS
        gst.shut_down(self._pipeline)
        if not ended:
            self.close()
            raise SetupError(f"{self._path}: cannot be written: is the disk full?")
        os.replace(self._partial, self._path)

    def close(self) -> None:
        """Give up what is not finished; may be called always."""
        gst.shut_down(self._pipeline)
        self._partial.unlink(missing_ok=True)


def play(path: Path) -> None:
    """Show a clip once in a window, which may be closed before its end.

    SetupError if there is no display or the file cannot be played.
    """
    require_display()
    gst.require_elements(_PLAYING)
    Gst = gst.load().Gst
    pipeline = gst.parse_pipeline(
        "filesrc name=file ! qtdemux ! h264parse ! avdec_h264 ! videoconvert ! autovideosink"
    )
    pipeline.get_by_name("file").set_property("location", str(path))
    wanted = Gst.MessageType.EOS | Gst.MessageType.ERROR
    try:
        gst.set_playing(pipeline, f"showing {path.name}")
        # in short waits, so that Ctrl-C is handled between them
        while (message := pipeline.get_bus().timed_pop_filtered(_POLL_NS, wanted)) is None:
            pass
        if message.type == Gst.MessageType.ERROR:
            error, _ = message.parse_error()
            # what every sink reports of a closed window; a file that is gone is found before
            if not error.matches(Gst.ResourceError.quark(), Gst.ResourceError.NOT_FOUND):
                raise SetupError(
                    f"{path}: cannot be shown: {error.message}; if the file is broken, delete it "
                    "and name its session with --from again"
                )
    finally:
        gst.shut_down(pipeline)

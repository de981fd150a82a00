"""Pictures of a log as they were drawn: with what was then predicted."""

from __future__ import annotations

from bisect import bisect_left, bisect_right

from pydantic import ValidationError

from tams_app.config import Config
from tams_app.prediction.cameras import PredictedCamera
from tams_app.prediction.present import PREDICTED_FACT, MountTrail
from tams_app.recording import SessionLog
from tams_app.records import Image
from tams_app.session.predicting import predicted_cameras
from tams_app.units import NS_PER_MS

_BEFORE_NS = 600 * NS_PER_MS  # an older frame is shown as received
_AFTER_NS = 20 * NS_PER_MS


class DrawnPictures:
    """Draws a picture as it was drawn when it was shown; as received where that is not known.

    `views`: those of which something is predicted. Of a log of `operate` alone when a frame was
    captured is not known.
    """

    def __init__(self, log: SessionLog) -> None:
        named = set(log.facts.get(PREDICTED_FACT, "").split(","))
        self._cameras = {view: camera for view, camera in _cameras(log).items() if view in named}
        self.views = tuple(self._cameras)
        self._predictions = sorted(log.predictions, key=lambda one: one.now_ns)
        self._times_ns = [one.now_ns for one in self._predictions]
        captured_ns = {
            (one.view, one.index): one.capture_ns
            for one in log.captured
            if one.view in self._cameras
        }
        self._captured_ns = {
            (one.view, one.shown_ns): captured_ns[one.view, one.index]
            for one in log.shown
            if (one.view, one.index) in captured_ns
        }

    def draw(self, view: str, image: Image, shown_ns: int) -> Image:
        """`image`, BGR, which was shown at `shown_ns` of the session's clock."""
        capture_ns = self._captured_ns.get((view, shown_ns))
        if capture_ns is None:
            return image
        first = bisect_left(self._times_ns, shown_ns - _BEFORE_NS)
        last = bisect_right(self._times_ns, shown_ns + _AFTER_NS)
        trail = MountTrail()
        for prediction in self._predictions[first:last]:
            trail.add(prediction)
        return self._cameras[view].view(trail).show(image, capture_ns, shown_ns).image


def _cameras(log: SessionLog) -> dict[str, PredictedCamera]:
    try:
        return predicted_cameras(Config.model_validate(log.header.config))
    except ValidationError:  # of another version: its cameras are not known
        return {}

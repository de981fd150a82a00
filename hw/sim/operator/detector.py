"""One look at the three views: what can be made out of tool, block and container in each.

The operator looks where they believe the things to be, and searches the more widely the less they
know. All uncertainty is measured in the image.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from hw.sim.layout import (
    BLOCK_EDGE_M,
    BLOCK_HEIGHT_M,
    CONTAINER_MARKER,
    FIXED_VIEWPOINTS,
    GRIPPER_MARKER,
    HEIGHT_PX,
    WIDTH_PX,
)
from hw.sim.operator.belief import Belief
from hw.sim.operator.vision.blobs import (
    EDGE_JUDGEMENT,
    HALF_TURN,
    QUARTER_TURN,
    Blob,
    FingerGauge,
    Window,
    find_blobs,
    fit_yaw,
)
from hw.sim.operator.vision.fiducials import MarkerFinder, gripper_faces, match_face
from hw.sim.operator.vision.solids import (
    BLUE,
    GREEN,
    ORANGE,
    Box,
    VisiblePart,
    block_box,
    block_corners,
    container_box,
    sketch,
    tool_boxes,
)
from hw.sim.operator.vision.views import (
    Cue,
    Glance,
    HeadingSighting,
    Matrix,
    Pinhole,
    Sighting,
    Thing,
    wrist_cameras,
)
from tams_app.records import Image, Vector

_MARGIN_PX = 12.0
_SEARCH_SIGMAS = 4.0
_EVERYWHERE_PX = 150.0  # an uncertainty beyond this: the whole image is searched
_HIDDEN = 0.25  # less of a thing than this is not judged
_ODD_SIZE = (0.3, 2.5)  # of the visible area expected: beyond, it is something else
_SIZE_SHIFT = 0.30  # shift of the middle per side length, of a part missing or too much
_WHOLE = (0.7, 1.5)
_OTHER_WAY = 0.6  # of the misfit: then a block believed to stand lies, or vice versa
_SKETCH_SIGMA_PX = 0.4  # a gripper drawn from boxes is no better
_HIDDEN_SIGMA_PX = 2.5  # where one thing cuts off another is known no better
_THING_RADIUS_M = {Thing.TOOL: 0.030, Thing.BLOCK: 0.014, Thing.CONTAINER: 0.060}
_MARKERS_RADIUS_M = 0.050
_CONTAINER_SURE_M = 0.002
_CONTAINER_EVERY = 6  # glances; what stands still needs no more
_CONTAINER_SKETCH_SIGMA_PX = 1.0
_MARKER_CENTRE_PX = 0.2
_FLOOR = np.array([(0.0, 0.0, 0.002)])  # the container's, which carries its marker [m]
_CONTAINER_AREA_PX = 9000.0  # about, in the fixed views
_SEARCH_PX = 2.0  # a thing just found is not yet looked at closely
_WORK_X_M, _WORK_Y_M = (0.18, 0.45), (-0.30, 0.32)


class Detector:
    """Looks at the views of the fixed and the wrist cameras; keeps only a count of glances."""

    def __init__(self) -> None:
        self._wrist_views = wrist_cameras()
        self._markers = MarkerFinder()
        self._faces = gripper_faces()
        self._gauges = {view: FingerGauge(camera) for view, camera in self._wrist_views.items()}
        self._glances = 0
        self._opening = 0.016

    def look(self, images: Mapping[str, Image], belief: Belief) -> Glance:
        """All that `images` (BGR, by view) show, searched for around what `belief` expects."""
        self._glances += 1
        boxes = tool_boxes(belief.tcp, belief.tool_axes, self._opening)
        sightings: list[Sighting] = []
        headings: list[HeadingSighting] = []
        opening = None
        for view, image in images.items():
            if view in self._wrist_views:
                opening = self._gauges[view].measure(image)
            else:
                sightings += self._see_tool(view, image, belief, boxes)
            sightings += self._see_block(view, image, belief, boxes, headings)
            if self._wants_container(belief, view):
                sightings += self._see_container(view, image, belief, boxes)
        self._opening = self._opening if opening is None else opening
        return Glance(tuple(sightings), tuple(headings), opening)

    # --- the gripper ----------------------------------------------------------------------------

    def _see_tool(
        self, view: str, image: Image, belief: Belief, boxes: list[Box]
    ) -> list[Sighting]:
        camera = belief.camera(view)
        spread = _SEARCH_SIGMAS * belief.pixel_sigma(view, Thing.TOOL) + _MARGIN_PX
        found = self._see_gripper_markers(view, image, belief, camera, spread)
        middle = camera.project(belief.tcp[None])[0]
        radius = _radius(camera, belief.tcp, Thing.TOOL) + spread
        window = Window.about(image, middle, radius)
        if window is None:
            return found
        expected = sketch(camera, boxes, GREEN, middle, radius)
        blobs = find_blobs(window, GREEN, max(20.0, expected.area))
        if expected.visible < _HIDDEN or not blobs:
            return found
        area = sum(blob.area for blob in blobs)
        centre = sum((blob.area * blob.middle for blob in blobs), np.zeros(2)) / area
        judged = _judged(blobs[0], area, expected)
        if judged is not None:
            pixel = centre - expected.middle + middle
            sigma, lasting = judged[0], math.hypot(judged[1], _SKETCH_SIGMA_PX)
            found.append(_centre_sighting(view, Thing.TOOL, pixel, sigma, lasting))
        return found

    def _see_gripper_markers(
        self, view: str, image: Image, belief: Belief, camera: Pinhole, spread: float
    ) -> list[Sighting]:
        turn = belief.tool_axes
        expected = [camera.project(belief.tcp + face @ turn.T) for face in self._faces]
        middle = np.mean(expected, axis=(0, 1))
        metre_px = camera.focal_px / float(camera.depths(belief.tcp[None])[0])
        window = Window.about(image, middle, _MARKERS_RADIUS_M * metre_px + spread)
        found = []
        for marker in self._markers.find(window) if window is not None else ():
            if marker.identity == GRIPPER_MARKER:
                edge_px = self._markers.edge_px
                sighting, away_px = match_face(view, marker, self._faces, expected, edge_px)
                if away_px < spread:
                    found.append(sighting)
        return found

    # --- the block ------------------------------------------------------------------------------

    def _see_block(
        self,
        view: str,
        image: Image,
        belief: Belief,
        boxes: list[Box],
        headings: list[HeadingSighting],
    ) -> list[Sighting]:
        """Look where it is believed to be; if it plainly is not there, anywhere else."""
        camera = belief.camera(view)
        spread = _SEARCH_SIGMAS * belief.pixel_sigma(view, Thing.BLOCK) + _MARGIN_PX
        if not belief.seen[Thing.BLOCK] or spread > _EVERYWHERE_PX:
            return self._search_block(view, image, camera)
        block = block_box(belief.block, belief.block_yaw, belief.lies)
        middle = camera.project(belief.block[None])[0]
        radius = _radius(camera, belief.block, Thing.BLOCK) + spread
        window = Window.about(image, middle, radius)
        if window is None:
            return []
        expected = sketch(camera, [*boxes, block], ORANGE, middle, radius)
        if expected.visible < _HIDDEN:
            return []
        blob = _block_patch(window, expected)
        judged = None if blob is None else _judged(blob, blob.area, expected)
        if blob is None or judged is None:
            if belief.block_is_near or not _in_plain_sight(expected, image, middle):
                return []
            elsewhere = self._search_block(view, image, camera)
            return [one for one in elsewhere if _distance(one.pixels[0], middle) > radius]
        if view in self._wrist_views and expected.visible > _WHOLE[0]:
            headings += _heading(view, blob, camera, belief, blob.area / expected.area)
        pixel = blob.middle - expected.middle + middle
        return [_centre_sighting(view, Thing.BLOCK, pixel, *judged)]

    def _search_block(self, view: str, image: Image, camera: Pinhole) -> list[Sighting]:
        """Anywhere on the mat; the size must be about right."""
        if view in self._wrist_views:
            return []  # where this camera looks is not sure enough to search by
        window = Window(0, 0, image)
        metre_px = camera.focal_px / float(np.linalg.norm(camera.place))
        expected_area = 1.5 * (BLOCK_EDGE_M * metre_px) ** 2
        for blob in find_blobs(window, ORANGE, expected_area):
            on_mat = _is_on_mat(camera.ray_at_height(blob.middle, BLOCK_HEIGHT_M / 2))
            if on_mat and 0.3 < blob.area / expected_area < 4.0:
                lasting = blob.lasting_px + _SEARCH_PX
                return [_centre_sighting(view, Thing.BLOCK, blob.middle, blob.sigma_px, lasting)]
        return []

    # --- the container --------------------------------------------------------------------------

    def _wants_container(self, belief: Belief, view: str) -> bool:
        """In every glance until its place is known, then now and then, the views in turn."""
        if belief.sigma_of(Thing.CONTAINER) > _CONTAINER_SURE_M:
            return True
        views = sorted((*self._wrist_views, *FIXED_VIEWPOINTS))
        turn = _CONTAINER_EVERY // len(views)
        return self._glances % _CONTAINER_EVERY == turn * views.index(view)

    def _see_container(
        self, view: str, image: Image, belief: Belief, boxes: list[Box]
    ) -> list[Sighting]:
        camera, place = belief.camera(view), belief.container
        spread = _SEARCH_SIGMAS * belief.pixel_sigma(view, Thing.CONTAINER) + _MARGIN_PX
        if not belief.seen[Thing.CONTAINER] or spread > _EVERYWHERE_PX:
            return self._search_container(view, image, camera)
        middle = camera.project(place[None])[0]
        radius = _radius(camera, place, Thing.CONTAINER) + spread
        window = Window.about(image, middle, radius)
        if window is None:
            return []
        found = self._read_container_marker(view, window)
        if found or view in self._wrist_views:
            return found
        drawn = [*boxes, container_box(place[0], place[1])]
        expected = sketch(camera, drawn, BLUE, middle, radius)
        if expected.visible < _HIDDEN:
            return []
        for blob in find_blobs(window, BLUE, expected.area)[:1]:
            judged = _judged(blob, blob.area, expected)
            if judged is not None:
                pixel = blob.middle - expected.middle + middle
                sigma, lasting = judged[0], math.hypot(judged[1], _CONTAINER_SKETCH_SIGMA_PX)
                return [_centre_sighting(view, Thing.CONTAINER, pixel, sigma, lasting)]
        return []

    def _search_container(self, view: str, image: Image, camera: Pinhole) -> list[Sighting]:
        """Anywhere on the mat, by its marker or as something blue of about its size."""
        if view in self._wrist_views:
            return []
        window = Window(0, 0, image)
        found = self._read_container_marker(view, window)
        if found:
            return found
        middle, radius = np.array((WIDTH_PX / 2, HEIGHT_PX / 2)), WIDTH_PX / 2
        for blob in find_blobs(window, BLUE, _CONTAINER_AREA_PX):
            place = camera.ray_at_height(blob.middle, 0.0)
            expected = sketch(camera, [container_box(place[0], place[1])], BLUE, middle, radius)
            judged = _judged(blob, blob.area, expected)
            if _is_on_mat(place) and judged is not None:
                sigma, lasting = judged[0], judged[1] + _SEARCH_PX
                return [_centre_sighting(view, Thing.CONTAINER, blob.middle, sigma, lasting)]
        return []

    def _read_container_marker(self, view: str, window: Window) -> list[Sighting]:
        for marker in self._markers.find(window):
            if marker.identity == CONTAINER_MARKER:
                centre = marker.middle[None]
                blurred = math.hypot(_MARKER_CENTRE_PX, EDGE_JUDGEMENT * self._markers.edge_px)
                sigma, cue = _MARKER_CENTRE_PX, Cue.MARKER
                return [Sighting(view, Thing.CONTAINER, centre, _FLOOR, sigma, blurred, cue=cue)]
        return []


def _block_patch(window: Window, expected: VisiblePart) -> Blob | None:
    """The patch that is the block, if there is one and none of it is cut off."""
    blobs = find_blobs(window, ORANGE, max(12.0, expected.area))
    if not blobs:
        return None
    blob = min(blobs, key=lambda one: _distance(one.middle, expected.middle) / one.area)
    return blob if window.holds(blob) else None


def _in_plain_sight(expected: VisiblePart, image: Image, middle: Vector) -> bool:
    """True if a thing at `middle` [px] is in the image and hardly hidden."""
    inside = (middle >= 0.0).all() and (middle < image.shape[1::-1]).all()
    return bool(inside and expected.visible > _WHOLE[0])


def _is_on_mat(place: Vector) -> bool:
    """True if a point on the table [m] is where the task's things can be."""
    in_x = _WORK_X_M[0] < place[0] < _WORK_X_M[1]
    return bool(in_x and _WORK_Y_M[0] < place[1] < _WORK_Y_M[1])


def _radius(camera: Pinhole, place: Vector, thing: Thing) -> float:
    """The largest size of `thing` in the image [px], about its middle."""
    depth = max(0.05, float(camera.depths(place[None])[0]))
    return min(_EVERYWHERE_PX, camera.focal_px * _THING_RADIUS_M[thing] / depth)


def _judged(blob: Blob, area: float, expected: VisiblePart) -> tuple[float, float] | None:
    """Standard deviations of a patch's middle [px], of one glance and lasting.

    Its own, and those from what is hidden, missing of it or too much. Where one thing cuts off
    another jumps with the noise as much as it stays.
    """
    if expected.area <= 0.0:
        return None
    size = area / expected.area
    if not _ODD_SIZE[0] < size < _ODD_SIZE[1]:
        return None
    odd = _SIZE_SHIFT * abs(1.0 - size) * math.sqrt(expected.area)
    hidden = _HIDDEN_SIGMA_PX * (1.0 - expected.visible) / math.sqrt(2.0)
    return math.hypot(blob.sigma_px, hidden), math.hypot(blob.lasting_px, odd, hidden)


def _heading(
    view: str, blob: Blob, camera: Pinhole, belief: Belief, size: float
) -> list[HeadingSighting]:
    if not _WHOLE[0] < size < _WHOLE[1]:
        return []
    fits = {}
    for lying, yaws in ((False, QUARTER_TURN), (True, HALF_TURN)):

        def draw(yaws: Vector, lying: bool = lying) -> Matrix:
            corners = block_corners(belief.block, belief.tool_yaw + yaws, lying)
            return camera.project(corners.reshape(-1, 3)).reshape(len(yaws), 8, 2)

        fitted = fit_yaw(blob.outline, blob.edge_sigma_px, draw, yaws)
        if fitted is not None:
            fits[lying] = fitted
    if not fits:
        return []
    usual, other = fits.get(belief.lies), fits.get(not belief.lies)
    if usual is None or (other is not None and other.misfit_px < _OTHER_WAY * usual.misfit_px):
        assert other is not None, "one of the two fits"
        return [HeadingSighting(view, other.yaw, other.sigma, not belief.lies, other.lasting)]
    return [HeadingSighting(view, usual.yaw, usual.sigma, belief.lies, usual.lasting)]


def _centre_sighting(
    view: str, thing: Thing, pixel: Vector, sigma_px: float, lasting_px: float
) -> Sighting:
    return Sighting(view, thing, pixel[None], np.zeros((1, 3)), sigma_px, lasting_px)


def _distance(one: Vector, other: Vector) -> float:
    return float(np.linalg.norm(one - other)) + 1.0

"""Rectangles around the shapes of CommonRoad: rectangles, circles, polygons and sets of them."""

from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from dechirp.traffic.outlines import rectangle_corners_m, rotation

_BASIC_SHAPES = ("rectangle", "circle", "polygon")
_SMALLEST_M = 0.01  # of polygons that are lines, such as kerbs


class Box(NamedTuple):
    """Rectangle that contains a shape, in the axes of the shape."""

    centre_m: np.ndarray
    """(2,)."""
    heading_rad: float
    length_m: float
    width_m: float


def read_box(parent: ElementTree.Element | None) -> Box | None:
    """Return the rectangle around all basic shapes in an element; None without any.

    It is the rectangle itself, the square around a circle, and the smallest rectangle around a
    polygon or around several shapes.

    Raises
    ------
    ValueError
        If a number is missing or no number, or a polygon has less than two points.
    """
    boxes, corners_m = [], []
    for shape in () if parent is None else parent:
        if shape.tag not in _BASIC_SHAPES:
            continue
        if shape.tag == "polygon":
            points_m = np.array([_read_vector_m(point) for point in shape.findall("point")])
            boxes.append(_smallest_box(points_m))
            corners_m.append(points_m)
            continue
        boxes.append(_read_rectangle_or_circle(shape))
        centre_m, heading_rad, length_m, width_m = boxes[-1]
        with np.errstate(invalid="ignore"):  # sizes and angles that are not finite
            corners_m.append(rectangle_corners_m(centre_m, heading_rad, length_m, width_m))
    if len(boxes) > 1:
        return _smallest_box(np.concatenate(corners_m))
    return boxes[0] if boxes else None


def _read_rectangle_or_circle(shape: ElementTree.Element) -> Box:
    centre = shape.find("center")
    centre_m = np.zeros(2) if centre is None else _read_vector_m(centre)
    if shape.tag == "circle":
        diameter_m = 2 * float(shape.findtext("radius", ""))
        return Box(centre_m, 0.0, diameter_m, diameter_m)
    return Box(
        centre_m,
        float(shape.findtext("orientation", "0")),
        float(shape.findtext("length", "")),
        float(shape.findtext("width", "")),
    )


def _read_vector_m(point: ElementTree.Element) -> np.ndarray:
    return np.array([float(point.findtext("x", "")), float(point.findtext("y", ""))])


def _smallest_box(points_m: np.ndarray) -> Box:
    """Return the rectangle of the smallest area around points (n, 2), its length the longer side.

    One of its sides lies on an edge of the convex hull (Freeman and Shapira, Determining the
    minimum-area encasing rectangle for an arbitrary closed curve, Communications of the ACM, 1975).
    """
    from scipy.spatial import ConvexHull, QhullError

    if len(points_m) < 2 or not np.all(np.isfinite(points_m)):
        raise ValueError(f"a polygon of {len(points_m)} points, or of points that are not finite")
    middle_m = points_m.mean(axis=0)
    points_m = points_m - middle_m
    try:
        hull_m = points_m[ConvexHull(points_m).vertices]
    except (QhullError, ValueError):  # all points on a line
        farthest = int(np.argmax(np.linalg.norm(points_m - points_m[0], axis=1)))
        hull_m = points_m[[0, farthest]]
    edges_m = np.roll(hull_m, -1, axis=0) - hull_m
    smallest: tuple[float, Box] | None = None
    for heading_rad in np.arctan2(edges_m[:, 1], edges_m[:, 0]).tolist():
        along_m = hull_m @ rotation(heading_rad)
        low_m, high_m = along_m.min(axis=0), along_m.max(axis=0)
        length_m, width_m = np.maximum(high_m - low_m, _SMALLEST_M).tolist()
        if smallest is None or length_m * width_m < smallest[0]:
            centre_m = middle_m + rotation(heading_rad) @ ((low_m + high_m) / 2)
            smallest = length_m * width_m, Box(centre_m, heading_rad, length_m, width_m)
    assert smallest is not None
    box = smallest[1]
    if box.width_m > box.length_m:
        return Box(box.centre_m, box.heading_rad + np.pi / 2, box.width_m, box.length_m)
    return box

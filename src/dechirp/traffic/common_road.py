"""CommonRoad scenarios, versions 2018b and 2020a."""

import math
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers.expat import errors as xml_errors

from dechirp.core.errors import RecordingError
from dechirp.traffic.base import CutTrafficError, ObjectKind, ObjectState, TrafficFormat

_KINDS: dict[str, ObjectKind] = {
    "car": "car",
    "taxi": "car",
    "parkedVehicle": "car",
    "priorityVehicle": "car",
    "truck": "truck",
    "bus": "bus",
    "motorcycle": "motorcycle",
    "bicycle": "bicyclist",
    "pedestrian": "pedestrian",
    "building": "building",
    "pillar": "pole",
    "roadBoundary": "wall",
    "median_strip": "wall",
}
_VERSIONS = ("2018b", "2020a")
_ERRORS_AT_FILE_END = {
    xml_errors.codes[message]
    for message in (
        xml_errors.XML_ERROR_NO_ELEMENTS,
        xml_errors.XML_ERROR_UNCLOSED_TOKEN,
        xml_errors.XML_ERROR_PARTIAL_CHAR,
        xml_errors.XML_ERROR_UNCLOSED_CDATA_SECTION,
    )
}
_OBSTACLES = {"dynamicObstacle", "staticObstacle", "obstacle"}


class CommonRoad(TrafficFormat):
    """Dynamic and static obstacles, with exact states or the middle of intervals."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Return True if the file begins with the element commonRoad."""
        if path.suffix.lower() != ".xml":
            return False
        with path.open("rb") as file:
            return b"<commonRoad" in file.read(4096)

    def read_states(self, path: Path) -> Iterator[ObjectState]:
        """Yield the initial state and the trajectory of each obstacle."""
        step_s, place = math.nan, ""
        try:
            for event, element in ElementTree.iterparse(path, events=("start", "end")):
                if event == "start" and element.tag == "commonRoad":
                    _check_version(path, element.attrib["commonRoadVersion"])
                    step_s = float(element.attrib["timeStepSize"])
                    if not 0 < step_s < math.inf:
                        raise ValueError(f"timeStepSize {step_s:g}, not above 0")
                elif event == "end" and element.tag in _OBSTACLES:
                    place = f"object {element.get('id')}: "
                    for state in _read_obstacle(element, step_s):
                        yield state
                        place = f"object {state.id} after {state.time_s:g} s: "
                    place = ""
                    element.clear()
        except (ElementTree.ParseError, KeyError, TypeError, ValueError) as error:
            is_cut = getattr(error, "code", None) in _ERRORS_AT_FILE_END
            raise (CutTrafficError if is_cut else RecordingError)(
                path,
                value=f"{place}{type(error).__name__}: {error}",
                expected="a complete CommonRoad scenario with timeStepSize, and obstacles with"
                " rectangles or circles, positions and times",
                fix="export it again",
            ) from None


def _check_version(path: Path, version: str) -> None:
    if version not in _VERSIONS:
        raise RecordingError(
            path,
            value=f"version {version[:20]!r}",
            expected=f"a CommonRoad scenario of version {' or '.join(_VERSIONS)}",
            fix="convert it to one of these versions",
        )


def _read_obstacle(obstacle: ElementTree.Element, step_s: float) -> Iterator[ObjectState]:
    number = int(obstacle.attrib["id"])
    is_stationary = (
        obstacle.tag == "staticObstacle" or (obstacle.findtext("role") or "").strip() == "static"
    )
    kind = _KINDS.get((obstacle.findtext("type") or "").strip(), "other")
    length_m, width_m = _read_size(obstacle)
    for state in (
        *obstacle.findall("initialState"),
        *obstacle.findall("trajectory/state"),
    ):
        heading_rad = _read_number(state, "orientation")
        speed = 0.0 if is_stationary else _read_number(state, "velocity")
        yield ObjectState(
            time_s=step_s * _read_number(state, "time"),
            id=number,
            kind=kind,
            x_m=_read_point(state, "x"),
            y_m=_read_point(state, "y"),
            heading_rad=heading_rad,
            vx_m_per_s=speed * math.cos(heading_rad),
            vy_m_per_s=speed * math.sin(heading_rad),
            length_m=length_m,
            width_m=width_m,
            is_stationary=is_stationary,
        )


def _read_size(obstacle: ElementTree.Element) -> tuple[float, float]:
    """Return length and width of a rectangle, or of the square around a circle; NaN of others."""
    if (rectangle := obstacle.find("shape/rectangle")) is not None:
        return float(rectangle.findtext("length", "")), float(rectangle.findtext("width", ""))
    if (radius := obstacle.findtext("shape/circle/radius")) is not None:
        return 2 * float(radius), 2 * float(radius)
    return math.nan, math.nan


def _read_point(state: ElementTree.Element, axis: str) -> float:
    if (text := state.findtext(f"position/point/{axis}")) is None:
        raise ValueError(f"no position/point/{axis}")
    return float(text)


def _read_number(state: ElementTree.Element, name: str) -> float:
    """Return an exact number, the middle of an interval, or NaN if there is none."""
    element = state.find(name)
    if element is None:
        return math.nan
    if (exact := element.findtext("exact")) is not None:
        return float(exact)
    start, end = element.findtext("intervalStart", ""), element.findtext("intervalEnd", "")
    return (float(start) + float(end)) / 2

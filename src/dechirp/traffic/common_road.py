"""CommonRoad scenarios, versions 2018b and 2020a."""

import math
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers.expat import errors as xml_errors

from dechirp.core.display import format_count_with_noun
from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.text import join_names
from dechirp.traffic.base import CutTrafficError, ObjectKind, ObjectState, TrafficFormat
from dechirp.traffic.common_road_shapes import Box, read_box
from dechirp.traffic.outlines import rotation

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
_OBSTACLES = {"dynamicObstacle", "staticObstacle", "obstacle", "environmentObstacle"}
_SAME_PLACE_M = 0.1


class CommonRoad(TrafficFormat):
    """Obstacles of all roles but phantoms, with exact states or the middle of intervals."""

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
        except (ElementTree.ParseError, LookupError, TypeError, ValueError) as error:
            is_cut = getattr(error, "code", None) in _ERRORS_AT_FILE_END
            raise (CutTrafficError if is_cut else RecordingError)(
                path,
                value=f"{place}{type(error).__name__}: {error}",
                expected="a complete CommonRoad scenario with timeStepSize, and obstacles with"
                " shapes, positions and times",
                fix="export it again",
            ) from None

    def read_findings(self, path: Path) -> tuple[Finding, ...]:
        """Return a warning on obstacles whose future is an occupancy set: a region, no motion."""
        if b"<occupancySet" not in path.read_bytes():
            return ()
        numbers = []
        try:
            for _, element in ElementTree.iterparse(path):
                if element.tag in _OBSTACLES:
                    if element.find("occupancySet") is not None:
                        numbers.append(str(element.get("id")))
                    element.clear()
        except ElementTree.ParseError:  # a cut, of which `read_states` informs
            pass
        if not numbers:
            return ()
        return (
            Finding(
                level="warning",
                setting="traffic.path",
                value=f"occupancy sets of {format_count_with_noun(len(numbers), 'object')} are not"
                f" read: {join_names(numbers, at_most=4)}",
                expected="trajectories: an occupancy set is the region where an object may be",
                fix="nothing to do if the initial states suffice; else take a scenario with"
                " trajectories",
            ),
        )


def _check_version(path: Path, version: str) -> None:
    if version not in _VERSIONS:
        raise RecordingError(
            path,
            value=f"version {version[:20]!r}",
            expected=f"a CommonRoad scenario of version {' or '.join(_VERSIONS)}",
            fix="convert it to one of these versions",
        )


def _read_obstacle(obstacle: ElementTree.Element, step_s: float) -> Iterator[ObjectState]:
    kind = _KINDS.get((obstacle.findtext("type") or "").strip(), "other")
    is_stationary = (
        obstacle.tag in ("staticObstacle", "environmentObstacle")
        or (obstacle.findtext("role") or "").strip() == "static"
    )
    box = read_box(obstacle.find("shape"))
    state = ObjectState(
        time_s=0.0,
        id=int(obstacle.attrib["id"]),
        kind=kind,
        x_m=0.0,
        y_m=0.0,
        length_m=math.nan if box is None else box.length_m,
        width_m=math.nan if box is None else box.width_m,
        is_stationary=is_stationary,
    )
    if obstacle.tag == "environmentObstacle":  # its shape is in the axes of the file
        yield _move_to_box(state._replace(heading_rad=0.0, vx_m_per_s=0.0, vy_m_per_s=0.0), box)
        return
    first: ObjectState | None = None
    for element in (*obstacle.findall("initialState"), *obstacle.findall("trajectory/state")):
        current = _move_to_box(_read_state(state, element, step_s), box)
        if first is None:
            first = current
        elif _is_repeated(first, current):
            continue
        yield current


def _read_state(obstacle: ObjectState, state: ElementTree.Element, step_s: float) -> ObjectState:
    """Return the state of the origin of the shape of an obstacle."""
    heading_rad = _read_number(state, "orientation")
    speed = 0.0 if obstacle.is_stationary else _read_number(state, "velocity")
    x_m, y_m = _read_position_m(state)
    return obstacle._replace(
        time_s=step_s * _read_number(state, "time"),
        x_m=x_m,
        y_m=y_m,
        heading_rad=heading_rad,
        vx_m_per_s=speed * math.cos(heading_rad),
        vy_m_per_s=speed * math.sin(heading_rad),
    )


def _move_to_box(state: ObjectState, box: Box | None) -> ObjectState:
    """Return the state of the centre of the box around the shape."""
    if box is None or not (box.heading_rad or box.centre_m.any()):
        return state
    heading_rad = state.heading_rad if math.isfinite(state.heading_rad) else 0.0
    offset_x_m, offset_y_m = rotation(heading_rad) @ box.centre_m
    return state._replace(
        x_m=state.x_m + float(offset_x_m),
        y_m=state.y_m + float(offset_y_m),
        heading_rad=state.heading_rad + box.heading_rad,
    )


def _is_repeated(first: ObjectState, state: ObjectState) -> bool:
    """Return True if a trajectory begins with the initial state, as many exporters write it."""
    distance_m = math.hypot(state.x_m - first.x_m, state.y_m - first.y_m)
    return state.time_s == first.time_s and distance_m < _SAME_PLACE_M


def _read_position_m(state: ElementTree.Element) -> tuple[float, float]:
    """Return a position, or the middle of the region in which it lies."""
    position = state.find("position")
    point = None if position is None else position.find("point")
    if point is not None:
        x, y = point.findtext("x"), point.findtext("y")
        if x is None or y is None:
            raise ValueError("no position/point/x and y")
        return float(x), float(y)
    if (region := read_box(position)) is None:
        raise ValueError("no position/point/x and y, nor a region")
    return float(region.centre_m[0]), float(region.centre_m[1])


def _read_number(state: ElementTree.Element, name: str) -> float:
    """Return an exact number, the middle of an interval, or NaN if there is none."""
    element = state.find(name)
    if element is None:
        return math.nan
    if (exact := element.findtext("exact")) is not None:
        return float(exact)
    start, end = element.findtext("intervalStart", ""), element.findtext("intervalEnd", "")
    return (float(start) + float(end)) / 2

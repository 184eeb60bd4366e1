"""Successive ASAM OSI messages `SensorView`: motions of host and objects, one time after another.

A simulator sends one view at a time, so that velocities come from positions of the past alone.
"""

import math
from collections import Counter
from collections.abc import Callable, Container, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from dechirp.core.display import format_count_with_noun
from dechirp.core.errors import InvalidSetting, RecordingError
from dechirp.core.findings import Finding
from dechirp.core.optional_imports import import_from_extra
from dechirp.core.text import format_number, join_names
from dechirp.traffic.base import ObjectKind, ObjectState
from dechirp.traffic.motion import Motion
from dechirp.traffic.mounting import Mounting
from dechirp.traffic.osi_trace import (
    OSI_VERSION,
    first_object_text,
    foreign_osi_version,
    state_of_moving_object,
    state_of_stationary_object,
)
from dechirp.traffic.overlaps import OVERLAP_FIX, find_overlapping_pairs
from dechirp.traffic.road_bodies import Size, complete_size
from dechirp.traffic.traffic import FASTEST_M_PER_S, MOVES_M_PER_S, SAME_SIZE_M, check_state

_SETTING = "SensorModel.view"
_MAX_TIME_S = 1e9
_LARGEST = {"position": 1e7, "velocity": 1e3, "acceleration": 1e3, "turn rate": 100.0}
_MAX_TURN_RATE_RAD_PER_S = 3.0  # faster turns from one view to the next are jumps of the heading


class ViewedObject(NamedTuple):
    """Object of a view."""

    id: int
    kind: ObjectKind
    motion: Motion
    """In the axes of the world."""
    size: Size
    interval_s: float
    """Time since the view before with this object; 0 in its first."""

    @property
    def name(self) -> str:
        """Kind and id, such as car-12."""
        return f"{self.kind}-{self.id}"


class View(NamedTuple):
    """Content of a `SensorView` that a radar needs."""

    time_s: float
    host: ViewedObject
    rear_axle_m: np.ndarray
    """(3,): vector from the centre of the host's box to its rear axle, the origin of mountings."""
    mounting: Mounting | None
    """Pose of the radar on the host that the view states."""
    objects: tuple[ViewedObject, ...]
    """All moving objects without the host, then the stationary ones."""
    findings: tuple[Finding, ...]
    """Findings that no view before has given."""


@dataclass
class _History:
    """Past of an object: positions and headings of its last views."""

    time_s: float
    position_m: np.ndarray
    heading_rad: float
    velocity: np.ndarray | None
    """Mean from the view before the last to the last, from positions."""
    interval_s: float
    states_velocity: bool
    """True if a velocity other than zero was stated in any view."""
    kind: ObjectKind
    size: Size
    """In the last view."""


class OsiViews:
    """Reader of successive views.

    Velocities that are missing, or zero although the object moves, come from positions: the mean
    since the view before, plus half of its change, so that constant acceleration causes no error.
    """

    def __init__(self) -> None:
        self._last_s: float | None = None
        self._histories: dict[int, _History] = {}
        self._read: tuple[float | None, dict[int, _History]] = None, {}
        self._reported: set[tuple[str, int | None]] = set()
        self._subjects: set[tuple[str, int | None]] = set()
        self._findings: list[Finding] = []

    def read(self, view: Any) -> View:
        """Read a view: an `osi3` message, or its bytes; the next one follows it after `accept`.

        Raises
        ------
        InvalidSetting
            If it is no view, time does not ascend, the host is missing, or an object has impossible
            numbers.
        """
        message = _parse_view(view)
        truth = message.global_ground_truth
        time_s = self._check_time(message)
        self._findings, self._subjects = [], set()
        states = _states_by_id(truth, time_s)
        host_id = _host_id(message, states, time_s)
        histories = {number: self._next_history(state) for number, (state, _) in states.items()}
        objects = {
            number: self._viewed_object(state, moving, histories[number])
            for number, (state, moving) in states.items()
        }
        self._report_overlaps(list(objects.values()), time_s)
        rear_axle_m = _rear_axle_m(states[host_id][1])
        mounting = _mounting_of_view(message, rear_axle_m, objects[host_id].size.height_m)
        standing = [
            self._standing_object(state)
            for state in _stationary_states(truth, time_s, frozenset(states))
        ]
        if standing:
            counts = sorted(Counter(item.kind for item in standing).items())
            self._report(
                "stationary",
                None,
                value=f"{format_count_with_noun(len(standing), 'stationary object')} at"
                f" {time_s:g} s: {join_names([f'{count} {kind}' for kind, count in counts])}",
                expected="boxes with the classes of the guide",
                fix="nothing to do: they reflect and shadow",
            )
        self._read = time_s, histories
        return View(
            time_s=time_s,
            host=objects.pop(host_id),
            rear_axle_m=rear_axle_m,
            mounting=mounting,
            objects=(*objects.values(), *standing),
            findings=tuple(self._findings),
        )

    def accept(self) -> None:
        """Make the view that was read last the one before the next."""
        self._last_s, self._histories = self._read
        self._reported |= self._subjects

    def _check_time(self, message: Any) -> float:
        time_s = _time_s(message)
        if self._last_s is not None and not time_s > self._last_s:
            raise _view_error(
                f"a view at {time_s:.9g} s{first_object_text(message.global_ground_truth)} after"
                f" one at {self._last_s:.9g} s",
                "times that ascend",
                "send each view once and in order; use a new model to start again",
            )
        return time_s

    def _next_history(self, state: ObjectState) -> _History:
        """Return the history of an object with its present state."""
        position_m = np.array([state.x_m, state.y_m])
        past = self._histories.get(state.id)
        stated_speed = math.hypot(state.vx_m_per_s, state.vy_m_per_s)
        velocity, interval_s = None, 0.0
        if past is not None:
            interval_s = state.time_s - past.time_s
            velocity = (position_m - past.position_m) / interval_s
            if np.hypot(*velocity) > FASTEST_M_PER_S:
                self._report(
                    "position",
                    state.id,
                    value=f"object {state.id} jumps by"
                    f" {format_number(float(np.hypot(*(position_m - past.position_m))), 3)} m at"
                    f" {state.time_s:g} s",
                    expected=f"at most {FASTEST_M_PER_S:g} m/s from view to view",
                    fix="give the object behind the jump another id",
                )
                velocity = None
        return _History(
            time_s=state.time_s,
            position_m=position_m,
            heading_rad=self._heading_rad(state, past, velocity),
            velocity=velocity,
            interval_s=interval_s,
            states_velocity=stated_speed > 0 or (past is not None and past.states_velocity),
            kind=state.kind,
            size=self._complete_size(state),
        )

    def _heading_rad(
        self, state: ObjectState, past: _History | None, velocity: np.ndarray | None
    ) -> float:
        """Return the stated heading, else the course of an object that moves, else the last one."""
        if math.isfinite(state.heading_rad):
            return math.remainder(state.heading_rad, 2 * math.pi)
        for course in ((state.vx_m_per_s, state.vy_m_per_s), velocity):
            if course is not None and math.hypot(*course) > MOVES_M_PER_S:
                return math.atan2(course[1], course[0])
        return 0.0 if past is None else past.heading_rad

    def _viewed_object(self, state: ObjectState, moving: Any, history: _History) -> ViewedObject:
        size = history.size
        self._report_change(state, history)
        acceleration = moving.base.acceleration
        motion = Motion(
            position_m=_position_on_ground_m(state, size),
            velocity_m_per_s=self._velocity(state, history),
            acceleration_m_per_s2=np.nan_to_num([acceleration.x, acceleration.y]),
            heading_rad=history.heading_rad,
            turn_rate_rad_per_s=self._turn_rate(state.id, moving, history),
            turn_acceleration_rad_per_s2=0.0,
        )
        return ViewedObject(state.id, state.kind, motion, size, history.interval_s)

    def _standing_object(self, state: ObjectState) -> ViewedObject:
        size = self._complete_size(state)
        heading_rad = state.heading_rad if math.isfinite(state.heading_rad) else 0.0
        motion = Motion(
            position_m=_position_on_ground_m(state, size),
            velocity_m_per_s=np.zeros(2),
            acceleration_m_per_s2=np.zeros(2),
            heading_rad=math.remainder(heading_rad, 2 * math.pi),
            turn_rate_rad_per_s=0.0,
            turn_acceleration_rad_per_s2=0.0,
        )
        return ViewedObject(state.id, state.kind, motion, size, 0.0)

    def _complete_size(self, state: ObjectState) -> Size:
        """Return the size of an object, with that of its class where it is unknown."""
        stated_size = Size(state.length_m, state.width_m, state.height_m)
        size = complete_size(state.kind, stated_size)
        if size != stated_size:
            self._report(
                "size",
                state.id,
                value=f"object {state.id} at {state.time_s:g} s without length, width or height",
                expected="base.dimension of every object",
                fix=f"nothing to do: those typical of its class ({state.kind}) replace them",
            )
        return size

    def _report_change(self, state: ObjectState, history: _History) -> None:
        """Report another class or size than in the view before."""
        past = self._histories.get(state.id)
        if past is None:
            return
        if state.kind != past.kind or not np.allclose(
            history.size, past.size, rtol=0.0, atol=SAME_SIZE_M
        ):
            old, new = (
                f"{item.kind} of {' x '.join(format_number(side, 3) for side in item.size)} m"
                for item in (past, history)
            )
            self._report(
                "change",
                state.id,
                value=f"object {state.id} at {state.time_s:g} s: {old}, then {new}",
                expected="one class and one size for each object",
                fix="give another object its own id; each view is simulated as it is",
            )

    def _report_overlaps(self, objects: list[ViewedObject], time_s: float) -> None:
        """Report moving objects that overlap one before them in the view."""
        pairs, depths_m = find_overlapping_pairs(
            np.array([item.motion.position_m[:2] for item in objects]),
            np.array([item.motion.heading_rad for item in objects]),
            np.array([item.size[:2] for item in objects]),
        )
        for index in np.lexsort(pairs.T).tolist():
            first, second = (objects[number].id for number in pairs[index].tolist())
            self._report(
                "overlap",
                second,
                value=f"object {second} overlaps object {first} at {time_s:g} s, by"
                f" {depths_m[index]:.1f} m",
                expected="objects apart",
                fix=OVERLAP_FIX,
            )

    def _velocity(self, state: ObjectState, history: _History) -> np.ndarray:
        stated = np.array([state.vx_m_per_s, state.vy_m_per_s])
        is_missing = bool(np.isnan(stated).any())
        if history.velocity is None:
            if is_missing:
                self._report(
                    "velocity",
                    state.id,
                    value=f"the velocity of object {state.id} at {state.time_s:g} s is missing",
                    expected="velocities in the first view of an object",
                    fix="nothing to do: 0 until its next view, then from positions",
                )
            return np.nan_to_num(stated)
        past = self._histories[state.id]
        derived = history.velocity
        if past.velocity is not None:
            share = history.interval_s / (history.interval_s + past.interval_s)
            derived = derived + share * (derived - past.velocity)
        moves = float(np.hypot(*derived)) > MOVES_M_PER_S
        if is_missing or (moves and not history.states_velocity):
            self._report(
                "velocity",
                state.id,
                value=f"the velocity of object {state.id} at {state.time_s:g} s is missing, or zero"
                " although it moves",
                expected="velocities in the views",
                fix="nothing to do: differences of positions replace them",
            )
            return np.asarray(derived)
        return stated

    def _turn_rate(self, number: int, moving: Any, history: _History) -> float:
        """Return the stated rate, else the change of heading since the last view."""
        rate = moving.base.orientation_rate
        if rate.HasField("yaw") and math.isfinite(rate.yaw):
            return float(rate.yaw)
        past = self._histories.get(number)
        if past is None:
            return 0.0
        turned_rad = math.remainder(history.heading_rad - past.heading_rad, 2 * math.pi)
        turn_rate = turned_rad / history.interval_s
        return turn_rate if abs(turn_rate) <= _MAX_TURN_RATE_RAD_PER_S else 0.0

    def _report(
        self, subject: str, number: int | None, *, value: str, expected: str, fix: str
    ) -> None:
        """Add a finding, once for each subject and object."""
        if (subject, number) not in self._reported | self._subjects:
            self._subjects.add((subject, number))
            self._findings.append(
                Finding(
                    level="warning" if subject in ("position", "change", "overlap") else "note",
                    setting=f"view.{subject}",
                    value=value,
                    expected=expected,
                    fix=fix,
                )
            )


def view_time_s(view: Any) -> float:
    """Return the time of a view: an `osi3` message, or its bytes."""
    return _time_s(_parse_view(view))


def _time_s(message: Any) -> float:
    truth = message.global_ground_truth
    stamped = next((item for item in (message, truth) if item.HasField("timestamp")), None)
    if stamped is None:
        raise _view_error(
            f"a view{first_object_text(truth)} without timestamp",
            "timestamp, the time of the objects",
            "set SensorView.timestamp",
        )
    time_s = float(stamped.timestamp.seconds + stamped.timestamp.nanos / 1e9)
    if not abs(time_s) <= _MAX_TIME_S:
        raise _view_error(
            f"a view at {time_s:g} s",
            f"times up to {_MAX_TIME_S:g} s",
            "count from the start of the simulation",
        )
    return time_s


def _parse_view(view: Any) -> Any:
    kind = import_from_extra("io", "osi3.osi_sensorview_pb2", setting=_SETTING).SensorView
    decode_error = import_from_extra("io", "google.protobuf.message", setting=_SETTING).DecodeError
    fix = "give an osi3.SensorView, or its bytes from SerializeToString()"
    if not isinstance(view, bytes | bytearray | memoryview | kind):
        raise _view_error(f"a {type(view).__name__}", "a SensorView", fix)
    if isinstance(view, kind):
        message = view
    else:
        try:
            message = kind.FromString(bytes(view))
        except decode_error as error:
            raise _view_error(f"{len(bytes(view))} bytes: {error}", "a SensorView", fix) from None
    version = foreign_osi_version(message, message.global_ground_truth)
    if version is not None:
        truth = message.global_ground_truth
        raise _view_error(
            f"a view at {_time_s(message):g} s{first_object_text(truth)} of OSI version {version}",
            f"version {OSI_VERSION}",
            f"convert the view to ASAM OSI {OSI_VERSION}",
        )
    return message


def _position_on_ground_m(state: ObjectState, size: Size) -> np.ndarray:
    ground_m = state.z_m - size.height_m / 2 if math.isfinite(state.z_m) else 0.0
    return np.array([state.x_m, state.y_m, ground_m])


def _states_by_id(truth: Any, time_s: float) -> dict[int, tuple[ObjectState, Any]]:
    """Return the checked state and the message of each object."""
    states: dict[int, tuple[ObjectState, Any]] = {}
    for moving in truth.moving_object:
        state = _checked_state(state_of_moving_object, moving, time_s, states)
        _check_motion(state, moving)
        states[state.id] = state, moving
    return states


def _stationary_states(
    truth: Any, time_s: float, moving_ids: frozenset[int]
) -> Iterator[ObjectState]:
    """Yield the checked states of all stationary objects."""
    ids = set(moving_ids)
    for stationary in truth.stationary_object:
        state = _checked_state(state_of_stationary_object, stationary, time_s, ids)
        _check_position(state)
        ids.add(state.id)
        yield state


def _checked_state(
    read_state: Callable[[object, Any, float], ObjectState],
    item: Any,
    time_s: float,
    ids: Container[int],
) -> ObjectState:
    """Return a state with possible numbers, whose id is not among others."""
    try:
        state = read_state(_SETTING, item, time_s)
        check_state(_SETTING, state)
    except RecordingError as error:
        (mistake,) = error.mistakes
        raise _view_error(mistake.value, mistake.expected, mistake.fix) from None
    if state.id in ids:
        raise _view_error(
            f"object {state.id} twice at {time_s:g} s",
            "one state of an object at a time",
            "give each object its own id",
        )
    return state


def _check_motion(state: ObjectState, moving: Any) -> None:
    """Raise `InvalidSetting` for a place or a motion that no road user has."""
    acceleration, rate = moving.base.acceleration, moving.base.orientation_rate
    _check_position(state)
    for name, unit, numbers in (
        ("velocity", "m/s", (state.vx_m_per_s, state.vy_m_per_s)),
        ("acceleration", "m/s^2", (acceleration.x, acceleration.y)),
        ("turn rate", "rad/s", (rate.yaw,)),
    ):
        _check_magnitudes(state, name, unit, numbers)


def _check_position(state: ObjectState) -> None:
    _check_magnitudes(state, "position", "m", (state.x_m, state.y_m, state.z_m))


def _check_magnitudes(state: ObjectState, name: str, unit: str, numbers: tuple[float, ...]) -> None:
    largest = _LARGEST[name]
    if any(abs(number) > largest for number in numbers):  # false for NaN, which is missing
        raise _view_error(
            f"object {state.id} at {state.time_s:g} s: {name}"
            f" {', '.join(f'{number:g}' for number in numbers)} {unit}",
            f"at most {largest:g} {unit}",
            "correct it, or leave it out",
        )


def _host_id(message: Any, states: dict[int, Any], time_s: float) -> int:
    """Return the id of the host, which is among the objects."""
    truth = message.global_ground_truth
    places = [
        (message, "host_vehicle_id"),
        (truth, "host_vehicle_id"),
        (message.host_vehicle_data, "host_vehicle_id"),
    ]
    named = [getattr(holder, field).value for holder, field in places if holder.HasField(field)]
    if not named:
        raise _view_error(
            f"a view at {time_s:g} s{first_object_text(truth)} without host vehicle",
            "host_vehicle_id, the vehicle that carries the radar",
            "set SensorView.host_vehicle_id",
        )
    number = int(named[0])
    if number not in states:
        raise _view_error(
            f"host vehicle {number} is not among the"
            f" {format_count_with_noun(len(states), 'object')} at {time_s:g} s",
            "the host as a moving object with its position",
            "add it to global_ground_truth.moving_object, or correct host_vehicle_id",
        )
    return number


def _rear_axle_m(host: Any) -> np.ndarray:
    """Return the vector from the centre of a box to the rear axle, zero if unknown."""
    if not host.vehicle_attributes.HasField("bbcenter_to_rear"):
        return np.zeros(3)
    rear = host.vehicle_attributes.bbcenter_to_rear
    return np.nan_to_num([rear.x, rear.y, rear.z], posinf=0.0, neginf=0.0)


def _mounting_of_view(message: Any, rear_axle_m: np.ndarray, height_m: float) -> Mounting | None:
    """Return the stated pose, from the centre of the vehicle on the ground."""
    if not message.HasField("mounting_position"):
        return None
    place, turned = message.mounting_position.position, message.mounting_position.orientation
    x, y, z = rear_axle_m + np.array((place.x, place.y, place.z))
    # OSI turns to the right-hand side of each axis: its pitch lowers the nose.
    return Mounting(
        position_m=(float(x), float(y), float(z + height_m / 2)),
        yaw_rad=_wrapped(turned.yaw),
        pitch_rad=-_wrapped(turned.pitch),
        roll_rad=_wrapped(turned.roll),
    )


def _wrapped(angle_rad: float) -> float:
    """Return an angle within half a turn; others than numbers are left to later checks."""
    return math.remainder(angle_rad, 2 * math.pi) if math.isfinite(angle_rad) else angle_rad


def _view_error(value: str, expected: str, fix: str) -> InvalidSetting:
    return InvalidSetting(_SETTING, value=value, expected=expected, fix=fix)

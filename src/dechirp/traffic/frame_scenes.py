"""Scenes of traffic: the objects around a radar on one of its vehicles, frame by frame."""

import math
from bisect import bisect_right
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple, cast

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_number
from dechirp.core.display import format_count_with_noun
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding
from dechirp.core.text import format_number, format_si, join_names
from dechirp.radar.radar import Radar
from dechirp.scene.bodies.base import Body
from dechirp.scene.scene import Scene
from dechirp.traffic.base import STRUCTURE_KINDS, ObjectKind
from dechirp.traffic.motion import MAX_ACCELERATION_M_PER_S2, Motion, ObjectPath, fit_paths
from dechirp.traffic.mounting import Mounting, mounting_on_vehicle
from dechirp.traffic.object_steps import SAME_TIME_S, typical_steps_s
from dechirp.traffic.outlines import (
    contains_origin,
    nearest_point_m,
    rectangle_corners_m,
    rotation,
)
from dechirp.traffic.radar_scene import (
    MovingBody,
    RadarMotion,
    build_scene_around_radar,
    cut_to_range,
    is_below_body,
    motion_of_mounted_radar,
    outline_around_radar_m,
)
from dechirp.traffic.road_bodies import Size, body_of_object, complete_size
from dechirp.traffic.traffic import FASTEST_M_PER_S, Traffic

_MAX_NAMED = 4
_MAX_SUGGESTED_IDS = 5
_MAX_FRAMES = 1_000_000
_ROUNDING_S = 1e-9
_LARGEST_UNNOTICED_SHIFT_M, _LEAST_NAMED_SHIFT_M = 0.5, 1e-3


class ObjectInView(NamedTuple):
    """Object in the view of the radar in one frame."""

    name: str
    """Kind and id, such as car-12."""
    number: int
    """Index of the object in the traffic."""
    path: ObjectPath
    motion: Motion
    """Motion at mid-frame, in the axes of the file."""
    size: Size
    corners_m: np.ndarray
    """(4, 2): outline at mid-frame, x forward and y left of the radar."""
    kind: ObjectKind

    @property
    def is_structure(self) -> bool:
        """Return whether the object is a structure, no road user."""
        return self.kind in STRUCTURE_KINDS


class FrameScenes:
    """Scene of each frame of a radar in traffic; time zero of each is the start of its frame.

    Simulate a scene with `radar.for_frame(number)`, as its first frame. The coordinates are those
    of the radar at time zero, without its pitch and roll: x along the boresight seen from above, y
    left, z up. Within a frame, positions follow velocity and acceleration at mid-frame, relative to
    the radar, and bodies and radar turn at constant rates.

    Parameters
    ----------
    traffic : Traffic
        As `open_traffic` returns it.
    radar : Radar
        It determines the times of the frames, and with the largest range what is simulated.
    ego : int, optional
        Id of the vehicle that carries the radar; default: the host of the file.
    mount : str or Mounting
        Place on the outline of the vehicle, such as front or rear-left, or any pose.
    start_s, duration_s : float, optional
        Part of the trace, from its first step; default: all, while the vehicle is present.

    Raises
    ------
    InvalidSetting
        If the vehicle is missing or not named, its presence has no room for a frame, or an object
        has a size that no body can have.
    """

    @check_argument_types
    def __init__(
        self,
        traffic: Traffic,
        radar: Radar,
        *,
        ego: int | None = None,
        mount: str | Mounting = "front",
        start_s: float = 0.0,
        duration_s: float | None = None,
    ) -> None:
        objects = traffic.objects
        self._radar, self._times_s = radar, objects["time"].values
        self._nearest_positions_m = _nearest_positions_m(objects)
        self._ids = [int(number) for number in objects["id"].values]
        self._is_velocity_derived = objects["is_velocity_derived"].values.tolist()
        self._kinds = [cast(ObjectKind, str(kind)) for kind in objects["kind"].values]
        self.names = tuple(
            f"{kind}-{number}" for kind, number in zip(self._kinds, self._ids, strict=True)
        )
        """Name of each object, kind and id: car-12."""
        stated_sizes = [
            Size(*(float(objects[name][index]) for name in ("length", "width", "height")))
            for index in range(len(self._ids))
        ]
        self._sizes = [
            complete_size(kind, size) for kind, size in zip(self._kinds, stated_sizes, strict=True)
        ]
        steps_s = typical_steps_s(objects)
        heights_m = [size.height_m for size in self._sizes]
        objects = objects.assign(height=("object", heights_m))
        self._paths = [
            fit_paths(objects.isel(object=index), step_s)
            for index, step_s in enumerate(steps_s.tolist())
        ]
        self._longest_step_s = max(
            float(np.diff(path.times_s).max(initial=step_s))
            for paths, step_s in zip(self._paths, steps_s, strict=True)
            for path in paths
        )
        half_diagonals_m = [math.hypot(size.length_m, size.width_m) / 2 for size in self._sizes]
        self._half_diagonals_m = np.array(half_diagonals_m)
        self._check_bodies()
        self._ego = self._find_ego(traffic, ego)
        self.mounting = (
            mount
            if isinstance(mount, Mounting)
            else mounting_on_vehicle(mount, *self._sizes[self._ego][:2])
        )
        """Pose of the radar on its vehicle."""
        self.start_s, self.n_frames = self._select_frames(start_s, duration_s)
        """Start of the first frame, in the time of the file; number of frames."""
        self._times_around_radar_s: dict[int, float] = {}
        self._latest_view: tuple[int, list[ObjectInView]] = (-1, [])
        self.ego_presence_findings = self._find_ego_presence(
            start_s, duration_s, float(steps_s[self._ego])
        )
        """Note if the vehicle appears later, or leaves earlier, than the part selected."""
        self._findings = (
            *traffic.findings,
            *self._unknown_size_findings(stated_sizes),
            *self._path_findings(),
            *self.ego_presence_findings,
            *self._ego_gap_findings(),
        )

    @property
    def ego_name(self) -> str:
        """Return the name of the vehicle that carries the radar."""
        return self.names[self._ego]

    @property
    def ego_size(self) -> Size:
        """Return the size of the vehicle that carries the radar."""
        return self._sizes[self._ego]

    @property
    def first_step_s(self) -> float:
        """Return the time of the first step of the file."""
        return float(self._times_s[0])

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Return findings on the traffic, and on objects around the radar in frames so far."""
        return (*self._findings, *self._around_radar_findings())

    def mid_frame_s(self, number: int) -> float:
        """Return the middle of a frame, in the time of the file."""
        frame = self._radar.frame
        return self.start_s + frame.frame_start_s(number) + frame.for_frame(number).mid_frame_s

    def radar_motion(self, number: int) -> RadarMotion:
        """Return the motion of the radar at mid-frame, in the axes of the file.

        While the vehicle is absent, it is that of the nearest path, straight on.
        """
        path, _ = self._ego_path_at(self.mid_frame_s(number))
        return motion_of_mounted_radar(path.motion_at(self.mid_frame_s(number)), self.mounting)

    def structure_outlines_m(self) -> np.ndarray:
        """Return the corners of all structures seen from above, (n, 4, 2), in the axes of the file.

        Overhead structures are among them.
        """
        corners_m = []
        for kind, size, paths in zip(self._kinds, self._sizes, self._paths, strict=True):
            if kind in STRUCTURE_KINDS:
                motion = paths[0].motion_at(float(paths[0].times_s[0]))
                place_m = motion.position_m[:2]
                corners_m.append(rectangle_corners_m(place_m, motion.heading_rad, *size[:2]))
        return np.array(corners_m).reshape(-1, 4, 2)

    def objects_in_view(self, number: int) -> list[ObjectInView]:
        """Return the objects within the largest range and in front of the antennas at mid-frame.

        Objects around the radar are left out, with a finding. No object is in view while the
        vehicle of the radar is absent.
        """
        if self._latest_view[0] == number:
            return self._latest_view[1]
        time_s, radar = self.mid_frame_s(number), self.radar_motion(number)
        if not self._ego_path_at(time_s)[1]:
            return []
        max_range_m = self._radar.frame.chirp.max_range_m
        items = []
        for index in self._indices_near(radar.position_m[:2], max_range_m, time_s):
            path = _path_at(self._paths[index], time_s)
            if path is None or index == self._ego:
                continue
            motion, size, kind = path.motion_at(time_s), self._sizes[index], self._kinds[index]
            if kind in STRUCTURE_KINDS:
                motion, size = cut_to_range(motion, size, radar, max_range_m)
            corners_m = outline_around_radar_m(motion, size, radar)
            items.append(
                ObjectInView(self.names[index], index, path, motion, size, corners_m, kind)
            )
        outlines_m = np.array([item.corners_m for item in items]).reshape(-1, 4, 2)
        is_near = np.linalg.norm(nearest_point_m(outlines_m), axis=-1) < max_range_m
        is_in_view = is_near & (outlines_m[..., 0].max(axis=-1) > 0)
        for place in np.flatnonzero(contains_origin(outlines_m)):
            item = items[place]
            body = body_of_object(item.kind, item.size, 0.0, lambda rate: 0.0)
            if not is_below_body(body, item.motion, radar):
                self._times_around_radar_s.setdefault(item.number, time_s)
                is_in_view[place] = False
        objects = [item for item, is_chosen in zip(items, is_in_view, strict=True) if is_chosen]
        self._latest_view = number, objects
        return objects

    def scene(self, number: int) -> Scene:
        """Return the scene of a frame, without the vehicle of the radar."""
        mid_s = self._radar.frame.for_frame(number).mid_frame_s
        start_s = self.mid_frame_s(number) - mid_s
        bodies = [
            MovingBody(item.name, item.motion, self._body(item, start_s))
            for item in self.objects_in_view(number)
        ]
        return build_scene_around_radar(self.radar_motion(number), self.mounting, bodies, mid_s)

    def scenes(self) -> Iterator[Scene]:
        """Yield the scenes of all frames."""
        return (self.scene(number) for number in range(self.n_frames))

    def _body(self, item: ObjectInView, start_s: float) -> Body:
        """Return the body of an object, its legs in the phase of the start of the frame."""
        motion = item.motion
        forward = rotation(motion.heading_rad)[:, 0]
        return body_of_object(
            self._kinds[item.number],
            item.size,
            float(forward @ motion.velocity_m_per_s),
            lambda rate: item.path.integrate_over_speed(rate, start_s),
        )

    def _indices_near(self, place_m: np.ndarray, range_m: float, time_s: float) -> list[int]:
        """Return the objects that may be within a range of a place, from the nearest step."""
        nearest = int(np.argmin(np.abs(self._times_s - time_s)))
        distances_m = np.linalg.norm(self._nearest_positions_m[:, nearest] - place_m, axis=-1)
        reach_m = range_m + self._half_diagonals_m + 2 * self._longest_step_s * FASTEST_M_PER_S
        return [int(index) for index in np.flatnonzero(distances_m < reach_m)]

    def _ego_path_at(self, time_s: float) -> tuple[ObjectPath, bool]:
        """Return the path of the radar's vehicle nearest to a time, and whether it is present."""
        paths = self._paths[self._ego]
        distances_s = [max(path.start_s - time_s, time_s - path.end_s) for path in paths]
        nearest = int(np.argmin(distances_s))
        return paths[nearest], distances_s[nearest] <= SAME_TIME_S

    def _find_ego(self, traffic: Traffic, ego: int | None) -> int:
        number = traffic.host if ego is None else ego
        if number is not None and number in self._ids:
            return self._ids.index(number)
        n_steps = np.isfinite(traffic.objects["x"].values).sum(axis=1)
        is_structure = [kind in STRUCTURE_KINDS for kind in self._kinds]
        if not all(is_structure):
            n_steps[is_structure] = 0
        longest = np.argsort(-n_steps, kind="stable")[:_MAX_SUGGESTED_IDS]
        longest = longest[n_steps[longest] > 0]
        raise InvalidSetting(
            "traffic.ego",
            value="missing, and the file names no host" if number is None else number,
            expected="the id of the vehicle that carries the radar; most time in the trace have "
            + join_names([f"{self.names[index]} ({n_steps[index]} steps)" for index in longest]),
            fix=f"give the id, such as --set traffic.ego={self._ids[longest[0]]}, or the argument"
            " ego",
        )

    def _select_frames(self, start_s: float, duration_s: float | None) -> tuple[float, int]:
        """Return the start of the first frame, in the time of the file, and the frame count."""
        check_number("traffic.start_s", start_s, at_least=0)
        earliest_s = float(self._times_s[0]) + start_s
        paths = self._paths[self._ego]
        path = next((path for path in paths if path.end_s > earliest_s), paths[-1])
        first_s, end_s = max(earliest_s, float(path.times_s[0])), paths[-1].end_s
        if duration_s is not None:
            end_s = min(end_s, first_s + check_number("traffic.duration_s", duration_s, above=0))
        frame = self._radar.frame
        n_frames = bisect_right(
            range(_MAX_FRAMES),
            end_s - first_s + _ROUNDING_S,
            key=lambda number: frame.frame_start_s(number) + frame.for_frame(number).duration_s,
        )
        if not n_frames:
            last_s = paths[-1].end_s - float(self._times_s[0])
            raise InvalidSetting(
                "traffic.start_s",
                value=f"{format_number(start_s)} s; {self.ego_name} is present until"
                f" {format_number(last_s)} s",
                expected=f"time for a frame of {format_si(frame.for_frame(0).duration_s, 's', 3)}",
                fix="start earlier, lengthen traffic.duration_s, or choose another vehicle",
            )
        return first_s, n_frames

    def _check_bodies(self) -> None:
        """Raise `InvalidSetting`, with object and time, for a size that no body can have."""
        for index, paths in enumerate(self._paths):
            try:
                body_of_object(self._kinds[index], self._sizes[index], 0.0, lambda rate: 0.0)
            except InvalidSetting as error:
                (mistake,) = error.mistakes
                raise InvalidSetting(
                    f"traffic.object {self._ids[index]}",
                    value=f"{mistake.setting} {mistake.value}, from"
                    f" {format_number(float(paths[0].times_s[0]))} s",
                    expected=mistake.expected,
                    fix="correct the size or the class of the object in the file",
                ) from None

    def _unknown_size_findings(self, stated_sizes: list[Size]) -> tuple[Finding, ...]:
        unknown = [
            f"{name} from {format_number(float(paths[0].times_s[0]))} s"
            for name, size, paths in zip(self.names, stated_sizes, self._paths, strict=True)
            if not np.all(np.isfinite(size))
        ]
        if not unknown:
            return ()
        return (
            Finding(
                level="note",
                setting="traffic.size",
                value="length, width or height of"
                f" {format_count_with_noun(len(unknown), 'object')} are unknown:"
                f" {join_names(unknown, at_most=_MAX_NAMED)}",
                expected="sizes in the file",
                fix="nothing to do: those typical of their class replace them",
            ),
        )

    def _path_findings(self) -> tuple[Finding, ...]:
        paths = [
            (name, path)
            for name, its_paths in zip(self.names, self._paths, strict=True)
            for path in its_paths
        ]
        rough = [(name, path) for name, path in paths if not path.follows_velocities]
        if not rough:
            return ()
        rough_names = {name for name, _ in rough}
        has_velocities = any(
            name in rough_names and not is_derived
            for name, is_derived in zip(self.names, self._is_velocity_derived, strict=True)
        )
        first_paths = dict(reversed(rough))
        names = [
            f"{name} from {format_number(float(path.times_s[0]))} s"
            for name, path in reversed(first_paths.items())
        ]
        name, path = max(paths, key=lambda item: item[1].shift_m)
        if path.shift_m < _LEAST_NAMED_SHIFT_M:
            places = "smooth paths pass through the positions"
        else:
            places = (
                f"smooth paths are up to {format_number(path.shift_m, 2)} m beside the positions"
                f" ({name} from {format_number(float(path.times_s[0]))} s)"
            )
        return (
            Finding(
                level="warning" if path.shift_m > _LARGEST_UNNOTICED_SHIFT_M else "note",
                setting="traffic.position",
                value=f"positions{' and velocities' if has_velocities else ''} of"
                f" {format_count_with_noun(len(rough), 'path')}"
                f"{' contradict each other, or' if has_velocities else ''} need more than"
                f" {MAX_ACCELERATION_M_PER_S2:g} m/s^2:"
                f" {join_names(names, at_most=_MAX_NAMED)}; {places}",
                expected="smooth motion",
                fix="nothing to do for the jitter of measured positions; else correct the trace",
            ),
        )

    def _find_ego_presence(
        self, start_s: float, duration_s: float | None, step_s: float
    ) -> tuple[Finding, ...]:
        paths, first_s, last_s = self._paths[self._ego], self._times_s[0], self._times_s[-1]
        wanted_s = math.inf if duration_s is None else self.start_s + duration_s
        is_late = self.start_s - (first_s + start_s) > step_s
        if not is_late and min(last_s, wanted_s) - paths[-1].end_s <= step_s:
            return ()
        return (
            Finding(
                level="note",
                setting="traffic.ego",
                value=f"{self.ego_name} is present from {format_number(float(paths[0].times_s[0]))}"
                f" to {format_number(float(paths[-1].times_s[-1]))} s, the trace from"
                f" {format_number(float(first_s))} to {format_number(float(last_s))} s:"
                f" {format_count_with_noun(self.n_frames, 'frame')}",
                expected="a vehicle that is present in the whole part",
                fix="nothing to do, or choose a vehicle that is present for longer",
            ),
        )

    def _ego_gap_findings(self) -> tuple[Finding, ...]:
        paths, frame = self._paths[self._ego], self._radar.frame
        end_s = self.start_s + frame.frame_start_s(self.n_frames - 1)
        gaps = [
            f"from {format_number(before.end_s)} to {format_number(after.start_s)} s"
            for before, after in pairwise(paths)
            if after.start_s - before.end_s > SAME_TIME_S
            and before.end_s < end_s
            and after.start_s > self.start_s
        ]
        if not gaps:
            return ()
        return (
            Finding(
                level="warning",
                setting="traffic.ego",
                value=f"{self.ego_name} is absent {join_names(gaps, at_most=_MAX_NAMED)}: no object"
                " is in view of the frames there",
                expected="a vehicle that is present in all frames",
                fix="select a part with traffic.start_s and traffic.duration_s, or complete the"
                " file",
            ),
        )

    def _around_radar_findings(self) -> tuple[Finding, ...]:
        if not self._times_around_radar_s:
            return ()
        places = [
            f"{self.names[index]} at {format_number(time_s)} s"
            for index, time_s in self._times_around_radar_s.items()
        ]
        return (
            Finding(
                level="warning",
                setting="traffic.mount",
                value="the radar is inside"
                f" {format_count_with_noun(len(places), 'object')}, left out:"
                f" {join_names(places, at_most=_MAX_NAMED)}",
                expected="a radar outside of all other objects",
                fix="move the radar, or remove what belongs to its vehicle, such as a trailer",
            ),
        )


def _nearest_positions_m(objects: xr.Dataset) -> np.ndarray:
    """Return the position of each object in its step nearest to each time, (n, n_times, 2)."""
    times_s = objects["time"].values
    positions_m = np.stack([objects["x"].values, objects["y"].values], axis=-1)
    for of_object in positions_m:
        present = np.flatnonzero(np.isfinite(of_object[:, 0]))
        middles_s = (times_s[present][1:] + times_s[present][:-1]) / 2
        of_object[:] = of_object[present[np.searchsorted(middles_s, times_s)]]
    return positions_m


def _path_at(paths: list[ObjectPath], time_s: float) -> ObjectPath | None:
    """Return the path on which an object is at a time, None while it is absent."""
    return next((path for path in paths if path.start_s <= time_s <= path.end_s), None)

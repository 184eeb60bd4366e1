"""Bodies of objects: the kinds of traffic files as scatterers, at the sizes of the objects."""

import math
from collections.abc import Callable
from typing import NamedTuple

from dechirp.scene.bodies.base import Body
from dechirp.scene.bodies.bicyclist import Bicyclist
from dechirp.scene.bodies.foliage import Foliage
from dechirp.scene.bodies.guard_rail import GuardRail
from dechirp.scene.bodies.pedestrian import Pedestrian
from dechirp.scene.bodies.pole import Pole
from dechirp.scene.bodies.vehicle import Car, Truck, Van
from dechirp.scene.bodies.wall import Wall
from dechirp.scene.gait import MAX_RELATIVE_SPEED_PER_S, Gait
from dechirp.scene.skeleton import HIP_HEIGHT
from dechirp.traffic.base import STRUCTURE_KINDS, ObjectKind


class Size(NamedTuple):
    """Length, width and height of an object."""

    length_m: float
    width_m: float
    height_m: float


_TYPICAL_SIZES: dict[ObjectKind, Size] = {
    "car": Size(4.5, 1.8, 1.5),
    "van": Size(5.9, 2.0, 2.6),
    "truck": Size(16.5, 2.55, 4.0),
    "bus": Size(12.0, 2.55, 3.2),
    "motorcycle": Size(2.2, 0.8, 1.4),
    "bicyclist": Size(1.8, 0.6, 1.75),
    "pedestrian": Size(0.5, 0.5, 1.75),
    "other": Size(1.0, 1.0, 1.0),
    "wall": Size(10.0, 0.2, 2.0),
    "building": Size(10.0, 10.0, 6.0),
    "guard-rail": Size(10.0, 0.3, 0.75),
    "pole": Size(0.12, 0.12, 6.0),
    "tree": Size(4.0, 4.0, 8.0),
    "hedge": Size(2.0, 1.0, 1.5),
    "overhead": Size(10.0, 2.0, 1.0),
}
# Buses reflect as vans, motorcycles and other objects as cars, of their own size.
_VEHICLES: dict[ObjectKind, type[Car] | type[Van] | type[Truck]] = {
    "car": Car,
    "van": Van,
    "truck": Truck,
    "bus": Van,
    "motorcycle": Car,
    "other": Car,
}
_MAX_PEDESTRIAN_HEIGHT_M, _MIN_PEDESTRIAN_HEIGHT_M = 2.5, 0.5
_MIN_BICYCLIST_HEIGHT_M = 1.0
_TRUNK_SHARE = 0.3  # of the height of a tree
_HALF_BEAM_HEIGHT_M = 0.16  # of a guard rail, whose beam ends at the height of the object
_DEVELOPMENT_M = 5.0  # of a bicycle: distance per turn of the cranks


def complete_size(kind: ObjectKind, size: Size) -> Size:
    """Return a size with that of its kind where it is unknown (NaN)."""
    return Size(
        *(
            length_m if math.isfinite(length_m) else typical_m
            for length_m, typical_m in zip(size, _TYPICAL_SIZES[kind], strict=True)
        )
    )


def body_of_object(
    kind: ObjectKind,
    size: Size,
    speed_m_per_s: float,
    integrate_over_speed: Callable[[Callable[[float], float]], float],
) -> Body:
    """Return the body of an object that moves at a speed, negative backwards.

    Parameters
    ----------
    kind, size
        The size is complete.
    speed_m_per_s : float
        Speed of wheels and legs; people faster than walkers move their legs as fast as these do.
    integrate_over_speed : callable
        Integrates a rate that depends on the speed over the time that the object has moved, so
        that legs move on from frame to frame.
    """
    if kind == "pedestrian":
        return _make_pedestrian(size, abs(speed_m_per_s), integrate_over_speed)
    if kind == "bicyclist":
        return _make_bicyclist(size, abs(speed_m_per_s), integrate_over_speed)
    if kind in STRUCTURE_KINDS:
        return _make_structure(kind, size)
    vehicle = _VEHICLES[kind]
    typical = vehicle()
    # Wheels that fit under the typical vehicle fit under one with all of its sizes scaled.
    scale = min(size.length_m / typical.length_m, size.height_m / typical.height_m, 1.0)
    return vehicle(
        length_m=size.length_m,
        width_m=size.width_m,
        height_m=size.height_m,
        wheel_radius_m=scale * typical.wheel_radius_m,
        speed_m_per_s=0.0 if kind == "other" else speed_m_per_s,
    )


def _make_structure(kind: ObjectKind, size: Size) -> Body:
    length_m, width_m, height_m = size
    if kind == "guard-rail":
        middle_m = max(height_m - _HALF_BEAM_HEIGHT_M, height_m / 2)
        wave_radius_m = min(GuardRail.wave_radius_m, middle_m)
        return GuardRail(length_m=length_m, height_m=middle_m, wave_radius_m=wave_radius_m)
    if kind == "pole":
        return Pole(radius_m=min(length_m, width_m) / 2, height_m=height_m)
    if kind in ("tree", "hedge"):
        base_height_m = _TRUNK_SHARE * height_m if kind == "tree" else 0.0
        return Foliage(
            length_m=length_m, width_m=width_m, height_m=height_m, base_height_m=base_height_m
        )
    return Wall(
        length_m=length_m, width_m=width_m, height_m=height_m, is_overhead=kind == "overhead"
    )


def _make_pedestrian(
    size: Size,
    speed_m_per_s: float,
    integrate_over_speed: Callable[[Callable[[float], float]], float],
) -> Pedestrian:
    height_m = min(max(size.height_m, _MIN_PEDESTRIAN_HEIGHT_M), _MAX_PEDESTRIAN_HEIGHT_M)
    fastest = MAX_RELATIVE_SPEED_PER_S * HIP_HEIGHT * height_m

    def cycle_frequency_hz(speed: float) -> float:
        return Gait(height_m=height_m, speed_m_per_s=min(speed, fastest)).cycle_frequency_hz

    cycles = integrate_over_speed(cycle_frequency_hz)
    return Pedestrian(
        height_m=height_m,
        speed_m_per_s=min(speed_m_per_s, fastest),
        phase_rad=2 * math.pi * (cycles % 1.0),
    )


def _make_bicyclist(
    size: Size,
    speed_m_per_s: float,
    integrate_over_speed: Callable[[Callable[[float], float]], float],
) -> Bicyclist:
    height_m = min(max(size.height_m, _MIN_BICYCLIST_HEIGHT_M), _MAX_PEDESTRIAN_HEIGHT_M)
    turns = integrate_over_speed(lambda speed: speed / _DEVELOPMENT_M)
    return Bicyclist(
        height_m=height_m,
        speed_m_per_s=speed_m_per_s,
        # Three turns a second are the most that the model accepts.
        development_m=max(_DEVELOPMENT_M, speed_m_per_s / 2.9),
        phase_rad=2 * math.pi * (turns % 1.0),
    )

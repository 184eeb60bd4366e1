"""Scene around a radar on a vehicle, from the motions of all objects at one time."""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from dechirp.scene.bodies.base import Body
from dechirp.scene.ego import Ego
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target
from dechirp.traffic.motion import Motion
from dechirp.traffic.mounting import Mounting
from dechirp.traffic.outlines import QUARTER_TURN, rectangle_corners_m, rotation
from dechirp.traffic.road_bodies import Size

_CUT_STEP_M = 4.0  # twice the distance of the posts of guard rails
_SLOWEST_TURN_RAD_PER_S = 1e-5  # moves the ends of a truck by 1 um in a frame of 12 ms


class RadarMotion(NamedTuple):
    """Motion of the radar at one time, in the axes of the file."""

    position_m: np.ndarray
    """(3,)."""
    velocity_m_per_s: np.ndarray
    """(2,)."""
    acceleration_m_per_s2: np.ndarray
    """(2,)."""
    yaw_rad: float
    turn_rate_rad_per_s: float


class MovingBody(NamedTuple):
    """Object of a scene: its name, its motion at mid-frame and its body."""

    name: str
    motion: Motion
    """In the axes of the file."""
    body: Body


def motion_of_mounted_radar(vehicle: Motion, mounting: Mounting) -> RadarMotion:
    """Return the motion of a radar that is mounted on a moving vehicle."""
    arm_m = rotation(vehicle.heading_rad) @ np.array(mounting.position_m[:2])
    turn_rate = vehicle.turn_rate_rad_per_s
    return RadarMotion(
        vehicle.position_m + np.array([*arm_m, mounting.position_m[2]]),
        vehicle.velocity_m_per_s + turn_rate * QUARTER_TURN @ arm_m,
        vehicle.acceleration_m_per_s2
        + vehicle.turn_acceleration_rad_per_s2 * QUARTER_TURN @ arm_m
        - turn_rate**2 * arm_m,
        vehicle.heading_rad + mounting.yaw_rad,
        turn_rate,
    )


def cut_to_range(
    motion: Motion, size: Size, radar: RadarMotion, max_range_m: float
) -> tuple[Motion, Size]:
    """Return centre and size of the part of a long structure that is abreast of the view.

    Along its length, it ends at the largest range before and behind the radar, rounded up to 4 m,
    so that posts stay where they are from frame to frame.
    """
    forward = rotation(motion.heading_rad)[:, 0]
    abreast_m = float((radar.position_m - motion.position_m)[:2] @ forward)
    half_m = size.length_m / 2
    low_m = max(-half_m, _CUT_STEP_M * math.floor((abreast_m - max_range_m) / _CUT_STEP_M))
    high_m = min(half_m, _CUT_STEP_M * math.ceil((abreast_m + max_range_m) / _CUT_STEP_M))
    if high_m <= low_m:  # out of view, as a whole
        return motion, size
    middle_m = np.array([*((low_m + high_m) / 2 * forward), 0.0])
    return (
        motion._replace(position_m=motion.position_m + middle_m),
        size._replace(length_m=high_m - low_m),
    )


def is_below_body(body: Body, motion: Motion, radar: RadarMotion) -> bool:
    """Return True if the radar is below the box of a body, such as a bridge over the road."""
    box_m = body.blocking_box_m
    return box_m is not None and bool(box_m[0, 2] > radar.position_m[2] - motion.position_m[2])


def outline_around_radar_m(motion: Motion, size: Size, radar: RadarMotion) -> np.ndarray:
    """Return the corners of an object, (4, 2), x forward and y left of the radar."""
    return rectangle_corners_m(
        rotation(-radar.yaw_rad) @ (motion.position_m - radar.position_m)[:2],
        motion.heading_rad - radar.yaw_rad,
        size.length_m,
        size.width_m,
    )


def build_scene_around_radar(
    radar: RadarMotion, mounting: Mounting, bodies: Iterable[MovingBody], mid_s: float
) -> Scene:
    """Build the scene of a frame from all motions at its middle, `mid_s` after its start.

    Its coordinates are those of the radar at the start, without its pitch and roll.
    """
    turned_rad = radar.turn_rate_rad_per_s * mid_s
    to_scene = rotation(turned_rad - radar.yaw_rad)
    ego = Ego(
        pitch_rad=mounting.pitch_rad,
        roll_rad=mounting.roll_rad,
        velocity_m_per_s=(*(rotation(-radar.yaw_rad) @ radar.velocity_m_per_s), 0.0),
        turn_rate_rad_per_s=radar.turn_rate_rad_per_s,
    )
    moved_m = ego.displacements_m(np.array([mid_s]))[0, :2]
    # The radar moves along an arc at constant speed; all other acceleration is that of the
    # targets against it.
    added_acceleration = (
        radar.turn_rate_rad_per_s * QUARTER_TURN @ radar.velocity_m_per_s
        - radar.acceleration_m_per_s2
    )
    targets = []
    for name, motion, body in bodies:
        offset_m = motion.position_m - radar.position_m
        middle_m = to_scene @ offset_m[:2] + moved_m
        velocity = to_scene @ motion.velocity_m_per_s
        acceleration = to_scene @ (motion.acceleration_m_per_s2 + added_acceleration)
        turn_rate = motion.turn_rate_rad_per_s
        turn_rate *= abs(turn_rate) > _SLOWEST_TURN_RAD_PER_S
        heading_rad = motion.heading_rad - radar.yaw_rad + turned_rad - turn_rate * mid_s
        start_m = middle_m - mid_s * velocity + mid_s**2 / 2 * acceleration
        targets.append(
            Target(
                name=name,
                position_m=(*start_m, offset_m[2]),
                velocity_m_per_s=(*(velocity - mid_s * acceleration), 0.0),
                acceleration_m_per_s2=(*acceleration, 0.0),
                heading_rad=math.remainder(heading_rad, 2 * math.pi),
                turn_rate_rad_per_s=turn_rate,
                body=body,
            )
        )
    return Scene(targets=tuple(targets), ego=ego)

"""Scenario of each of several radars: its own pose and clock, and interference by the others."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding
from dechirp.core.text import format_si
from dechirp.experiments.mounted_radar import MountedRadar
from dechirp.experiments.scenario import Scenario
from dechirp.radar.radar import Radar
from dechirp.scene.ego import Ego
from dechirp.scene.scene import Scene
from dechirp.simulation.impairments.interference import Interference, Interferer
from dechirp.traffic.mounting import Mounting
from dechirp.traffic.outlines import QUARTER_TURN, rotation

CAR_LENGTH_M, CAR_WIDTH_M = 4.5, 1.8
"""Outline of the vehicle in scenes, which have no body for it."""


class SingleRadar(NamedTuple):
    """One of several radars, with a scenario of its own."""

    scenario: Scenario
    """Pose, start and interference by the other radars included; without a tracker."""
    mounting: Mounting
    start_offset_s: float


def split_radars(scenario: Scenario) -> tuple[dict[str, SingleRadar], tuple[Finding, ...]]:
    """Return the scenario of each radar by its name, and findings on their interference.

    Raises
    ------
    DechirpError
        If the traffic file cannot be read, or a scenario is invalid.
    """
    size_m = (CAR_LENGTH_M, CAR_WIDTH_M)
    radars = {
        mounted.label: replace(mounted, radar=mounted.radar or scenario.radar)
        for mounted in scenario.radars
    }
    traffic = scenario.traffic
    findings: list[Finding] = []
    if traffic is not None:
        first = next(iter(radars.values())).radar
        assert first is not None  # as checked by the scenario
        scenes = traffic.open_scenes(first)
        size_m = scenes.ego_size[:2]
        # The vehicle may appear later than the file starts, which a later start hides.
        findings += scenes.ego_presence_findings
        traffic = replace(traffic, start_s=max(scenes.start_s - scenes.first_step_s, 0.0))
    mountings = {name: mounted.mounting_on(*size_m) for name, mounted in radars.items()}
    singles = {}
    for index, (name, mounted) in enumerate(radars.items()):
        radar, offset_s, mounting = mounted.radar, mounted.start_offset_s, mountings[name]
        assert radar is not None
        interference, its_findings = _mutual_interference(name, radars, mountings)
        findings += its_findings
        own_traffic, own_scene = None, None
        if traffic is not None:
            _check_offset_within_duration(index, offset_s, traffic.duration_s)
            duration_s = None if traffic.duration_s is None else traffic.duration_s - offset_s
            own_traffic = replace(
                traffic, pose=mounting, start_s=traffic.start_s + offset_s, duration_s=duration_s
            )
        elif scenario.scene is not None:
            own_scene = _scene_of_mounted_radar(scenario.scene, name, mounting, offset_s)
        single = replace(
            scenario,
            name=f"{scenario.name} {name}",
            seed=_seed(scenario.seed, index),
            radars=(),
            radar=radar,
            tracker=None,
            group_tracker=None,
            impairments=(*interference, *scenario.impairments),
            traffic=own_traffic,
            scene=own_scene,
        )
        singles[name] = SingleRadar(single, mounting, offset_s)
    return singles, tuple(findings)


def _check_offset_within_duration(index: int, offset_s: float, duration_s: float | None) -> None:
    """Raise `InvalidSetting` if a radar starts after the end of the run."""
    if duration_s is not None and offset_s >= duration_s:
        raise InvalidSetting(
            f"radars.{index}.start_offset",
            value=format_si(offset_s, "s"),
            expected=f"less than traffic.duration, {format_si(duration_s, 's')}",
            fix="start the radar earlier, or lengthen traffic.duration",
        )


def _scene_of_mounted_radar(scene: Scene, name: str, mounting: Mounting, time_s: float) -> Scene:
    """Return the scene of one radar, whose time zero is a later time of the scene."""
    ego = ego_of_mounted_radar(scene.ego, mounting, time_s)
    if not time_s:
        return replace(scene, ego=ego)
    targets = []
    for target in scene.targets:
        if target.waypoints:
            raise InvalidSetting(
                f"radars.{name}.start_offset_s",
                value=f"{time_s:g} s, in a scene with waypoints",
                expected="targets with a velocity, or frames that start at time zero",
                fix="leave out the start offset, or the waypoints",
            )
        acceleration = np.array(target.acceleration_m_per_s2)
        velocity = np.array(target.velocity_m_per_s)
        position_m = target.position_m + velocity * time_s + acceleration * time_s**2 / 2
        heading_rad = target.heading_rad
        if heading_rad is not None:
            turned_rad = heading_rad + target.turn_rate_rad_per_s * time_s
            heading_rad = math.remainder(turned_rad, 2 * math.pi)
        targets.append(
            replace(
                target,
                position_m=tuple(position_m),
                velocity_m_per_s=tuple(velocity + acceleration * time_s),
                heading_rad=heading_rad,
            )
        )
    return replace(scene, targets=tuple(targets), ego=ego)


def ego_of_mounted_radar(vehicle: Ego, mounting: Mounting, time_s: float = 0.0) -> Ego:
    """Return pose and motion of a radar on a vehicle, at a time.

    The radar moves on an arc with the turn rate of the vehicle, at the velocity of its centre plus
    that of the lever arm.
    """
    times_s = np.array([time_s])
    axes = vehicle.axes(times_s)[0]
    arm_m = axes @ np.array(mounting.position_m)
    position_m = np.array(vehicle.position_m) + vehicle.displacements_m(times_s)[0] + arm_m
    velocity = vehicle.velocities_m_per_s(times_s)[0]
    velocity[:2] += vehicle.turn_rate_rad_per_s * QUARTER_TURN @ arm_m[:2]
    on_vehicle = Ego(
        yaw_rad=mounting.yaw_rad, pitch_rad=mounting.pitch_rad, roll_rad=mounting.roll_rad
    )
    axes = axes @ on_vehicle.axes(np.zeros(1))[0]
    return Ego(
        position_m=tuple(position_m),
        yaw_rad=math.atan2(axes[1, 0], axes[0, 0]),
        pitch_rad=math.asin(np.clip(axes[2, 0], -1, 1)),
        roll_rad=math.atan2(axes[2, 1], axes[2, 2]),
        velocity_m_per_s=tuple(velocity),
        turn_rate_rad_per_s=vehicle.turn_rate_rad_per_s,
    )


def _seed(seed: int, index: int) -> int:
    """Return the seed of a radar: that of the scenario for the first one."""
    if not index:
        return seed
    (number,) = np.random.SeedSequence(seed, spawn_key=(index,)).generate_state(1, np.uint64)
    return int(number >> np.uint64(1))


def _mutual_interference(
    victim: str, radars: Mapping[str, MountedRadar], mountings: Mapping[str, Mounting]
) -> tuple[tuple[Interference, ...], list[Finding]]:
    """Return the interference that a radar receives from the others, if any."""
    receiver = radars[victim].radar
    assert receiver is not None
    interferers, unsupported = [], []
    for name, mounted in radars.items():
        sender = mounted.radar
        assert sender is not None
        if name == victim:
            continue
        if not (_has_equal_ramps_and_frames(sender) and _has_equal_ramps_and_frames(receiver)):
            unsupported.append(name)
            continue
        interferer = _interferer(name, mounted, radars[victim], mountings[name], mountings[victim])
        if interferer is None or not interferer.gain_towards_radar(0.0, Ego()):
            continue
        if Interference(interferers=(interferer,)).can_receive(interferer, receiver):
            interferers.append(interferer)
    findings = [
        Finding(
            level="note",
            setting="radars",
            value=f"interference of {name} on {victim} is left out",
            expected="equal ramps and frames",
            fix="nothing to do, unless their bands overlap",
        )
        for name in unsupported
    ]
    return ((Interference(interferers=tuple(interferers)),) if interferers else ()), findings


def _has_equal_ramps_and_frames(radar: Radar) -> bool:
    return radar.frame.modulation is None and radar.frame.n_intervals == 1


def _interferer(
    name: str, sender: MountedRadar, victim: MountedRadar, place: Mounting, victim_place: Mounting
) -> Interferer | None:
    """Return a radar as the interferer of another on the same vehicle; None without hardware."""
    assert sender.radar is not None
    frame, hardware = sender.radar.frame, sender.radar.hardware
    if hardware is None:
        return None
    chirp = frame.chirp
    # The victim measures time and frequency with its own oscillator.
    ratio = (1 + victim.clock_error) / (1 + sender.clock_error)
    to_victim = rotation(-victim_place.yaw_rad)
    offset_m = np.subtract(place.position_m, victim_place.position_m)
    mean_power = np.mean(np.sum(np.abs(np.array(frame.weights)) ** 2, axis=1))
    return Interferer(
        name=name,
        start_frequency_hz=chirp.start_frequency_hz / ratio,
        slope_hz_per_s=chirp.slope_hz_per_s / ratio**2,
        ramp_duration_s=chirp.ramp_duration_s * ratio,
        interval_s=frame.single_interval_s * ratio,
        n_chirps=frame.n_chirps_total,
        period_s=(frame.frame_start_s(1) - frame.frame_start_s(0)) * ratio,
        offset_s=sender.start_offset_s - victim.start_offset_s,
        transmit_power_w=hardware.transmit_power_w * float(mean_power),
        antenna_gain=hardware.antenna_gain,
        pattern=hardware.tx_pattern,
        position_m=(*(to_victim @ offset_m[:2]), offset_m[2]),
        heading_rad=math.remainder(place.yaw_rad - victim_place.yaw_rad, 2 * math.pi),
        moves_with_radar=True,
    )

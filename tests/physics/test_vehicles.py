"""Cars, vans and trucks: cross-section over aspect, shadowing and rolling wheels."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.config.loading import parse_settings
from dechirp.scene.bodies.base import Body
from dechirp.scene.bodies.vehicle import Car, Truck, Van
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target

WAVELENGTH_M = 3.9e-3
# Passenger car of TR 37.885, one scattering point: 3GPP TR 38.901 V19, table 7.9.2.1-4. Middle
# and 3 dB width over azimuth, the same over zenith angle (deg), G_max (dBsm), sigma_max (dB).
TR_38_901_TABLE = [
    (0, 40.54, 71.75, 29.13, 15.52, 8.45),
    (90, 26.90, 79.70, 44.42, 20.75, 13.68),
    (180, 36.32, 79.65, 36.73, 14.56, 7.50),
    (270, 26.90, 79.70, 44.42, 20.75, 13.68),
]
AZIMUTHS_DEG = np.arange(-180.0, 180.0)
VEHICLES = [Car, Van, Truck]


def compute_table_rcs_db(azimuth_deg, elevation_deg):
    """Compute equation 7.9.2-2 of TR 38.901 for the side within 45 deg of the azimuth."""
    middle, width, zenith, height, peak_db, max_loss_db = TR_38_901_TABLE[
        int((azimuth_deg + 45) // 90) % 4
    ]
    offset_deg = (azimuth_deg - middle + 180) % 360 - 180
    loss_db = 12 * (offset_deg / width) ** 2 + 12 * ((90 - elevation_deg - zenith) / height) ** 2
    return peak_db - min(loss_db, max_loss_db)


def compute_rcs_m2(body, azimuth_deg, elevation_deg=0.0, range_m=1e5):
    """Compute the RCS from directions around a body, (n_directions, n_scatterers)."""
    azimuth, elevation = np.radians(np.atleast_1d(azimuth_deg)), np.radians(elevation_deg)
    cos_elevation = np.cos(elevation)
    z = np.full(azimuth.shape, np.sin(elevation))
    to_radar = np.stack(
        [cos_elevation * np.cos(azimuth), cos_elevation * np.sin(azimuth), z], axis=-1
    )
    return body.cross_sections_towards_m2(range_m * to_radar, WAVELENGTH_M)


def to_decibels(power):
    return 10 * np.log10(power)


@pytest.mark.parametrize("elevation_deg", [0, 5, 20, 40])
def test_car_rcs_over_aspect_matches_3gpp_table(elevation_deg):
    rcs_db = to_decibels(compute_rcs_m2(Car(), AZIMUTHS_DEG, elevation_deg).sum(axis=1))
    expected_db = [compute_table_rcs_db(azimuth_deg, elevation_deg) for azimuth_deg in AZIMUTHS_DEG]

    assert rcs_db == pytest.approx(np.array(expected_db), abs=3.0)
    # At the middle of each side one lobe dominates: the rest adds half a decibel at most.
    if elevation_deg == 0:
        assert rcs_db[[0, 90, 180, 270]] == pytest.approx([13.6, 20.1, 10.8, 20.1], abs=1.0)


@pytest.mark.parametrize("kind", VEHICLES)
def test_rcs_is_symmetric_left_to_right(kind):
    rcs_m2 = compute_rcs_m2(kind(), AZIMUTHS_DEG).sum(axis=1)

    assert rcs_m2[1:] == pytest.approx(rcs_m2[:0:-1], rel=1e-9)


def test_doubling_car_size_quadruples_rcs():
    large_car = Car(length_m=10, width_m=4, height_m=3.2, wheel_radius_m=0.64)
    azimuths_deg = np.arange(-179.5, 180)

    # The larger car has more points; directions to them from 1e5 m differ by 1e-4 rad.
    assert compute_rcs_m2(large_car, azimuths_deg).sum(axis=1) == pytest.approx(
        4 * compute_rcs_m2(Car(), azimuths_deg).sum(axis=1), rel=1e-2
    )


def test_side_rcs_of_truck_and_car_scale_with_area():
    sides_m2 = [compute_rcs_m2(kind(), 90.0).sum() for kind in (Truck, Car)]

    # Contributions other than the panel, 0.2 dB, scale with the areas of all sides.
    assert to_decibels(sides_m2[0] / sides_m2[1]) == pytest.approx(
        to_decibels(16.5 * 4.0 / (5.0 * 1.6)), abs=0.2
    )


@pytest.mark.parametrize("kind", VEHICLES)
def test_surfaces_facing_away_are_hidden(kind):
    body = kind()
    x, y, _ = body.scatterer_offsets_m(np.zeros(1))[0].T
    is_nose, is_left = x > 0.499 * body.length_m, y > 0.4 * body.width_m
    is_right, is_tail = y < -0.4 * body.width_m, x < -0.499 * body.length_m
    is_middle = ~(is_nose | is_tail)

    assert not compute_rcs_m2(body, 60.0)[0, is_right & is_middle].any()
    assert not compute_rcs_m2(body, 60.0)[0, is_tail & ~is_left].any()
    assert compute_rcs_m2(body, 60.0)[0, (is_left | is_nose) & is_middle].all()
    assert not compute_rcs_m2(body, 180.0)[0, ~is_tail].any()
    # Three of four corners are visible, the opposite one is not.
    corners = compute_rcs_m2(body, -120.0)[0, (is_nose | is_tail) & (abs(y) > 0.499 * body.width_m)]
    assert np.count_nonzero(corners) == 0.75 * corners.size


def test_side_reflection_moves_along_vehicle_with_radar():
    body = Truck()
    x_m, y_m, _ = body.scatterer_offsets_m(np.zeros(1))[0].T
    is_side = (y_m > 0.499 * body.width_m) & (abs(x_m) < 0.499 * body.length_m)
    for radar_x_m in (-5.0, 0.0, 4.0):
        side_rcs_m2 = body.cross_sections_towards_m2(
            np.array([[radar_x_m, 6.0, 0.5]]), WAVELENGTH_M
        )[0, is_side]
        assert np.average(x_m[is_side], weights=side_rcs_m2) == pytest.approx(radar_x_m, abs=0.2)
        # Extent of the reflection: lobe width of 26.9 deg at 4.7 m.
        is_near = abs(x_m[is_side] - radar_x_m) < 4.7 * np.tan(np.radians(26.9))
        assert side_rcs_m2[is_near].sum() > 0.95 * side_rcs_m2.sum()


def measure_range_rates(kind, azimuth, times_s):
    """Measure range rates of scatterers, (n_times, n), and flag those on wheels.

    The vehicle moves at 10 m/s along x, far away in the direction of an azimuth.
    """
    position_m = 1e5 * np.array([np.cos(azimuth), np.sin(azimuth), 0])
    body = kind(speed_m_per_s=10.0)
    target = Target(position_m=tuple(position_m), velocity_m_per_s=(10, 0, 0), body=body)
    scene, step_s = Scene(targets=[target]), 1e-4
    ranges_m = [
        np.linalg.norm(scene.scatterer_positions_m(times_s + shift_s), axis=-1)
        for shift_s in (-step_s / 2, step_s / 2)
    ]
    wheel_offsets_m = body.scatterer_offsets_m(np.array([0.0, 1e-3]))
    return (ranges_m[1] - ranges_m[0]) / step_s, (wheel_offsets_m[0] != wheel_offsets_m[1]).any(
        axis=-1
    )


@pytest.mark.parametrize("kind", VEHICLES)
@pytest.mark.parametrize("aspect_deg", [0, 40, 70, 150])
def test_rims_span_zero_to_twice_speed_and_body_is_rigid(kind, aspect_deg):
    aspect = np.radians(aspect_deg)
    body = kind()
    turn_s = 2 * np.pi * body.wheel_radius_m / 10
    speeds, is_wheel = measure_range_rates(kind, aspect, np.linspace(0, turn_s, 64))

    v = 10 * np.cos(aspect)
    # Differences over 0.1 ms of positions accurate to 1e-11 m, on circles that rotate by 3 mrad;
    # directions vary by the body size over 1e5 m: 2 mm/s.
    assert speeds[:, ~is_wheel] == pytest.approx(v, abs=0.01)
    rim_speeds = speeds[:, is_wheel]
    assert rim_speeds.min() == pytest.approx(min(0, 2 * v), abs=0.02)
    assert rim_speeds.max() == pytest.approx(max(0, 2 * v), abs=0.02)
    assert rim_speeds.mean(axis=0) == pytest.approx(v, abs=0.2)  # 64 times, including both ends


def test_tyre_is_at_rest_where_it_touches_ground():
    body = Car(speed_m_per_s=20.0)
    times_s = np.linspace(0, 0.1, 2001)
    ground_positions_m = body.scatterer_offsets_m(times_s) + (20.0 * times_s)[:, None, None] * [
        1,
        0,
        0,
    ]
    heights_m = ground_positions_m[:-1, :, 2]
    speeds = (
        np.linalg.norm(np.diff(ground_positions_m, axis=0), axis=-1) / np.diff(times_s)[:, None]
    )

    assert heights_m.min() >= 0
    is_touching = heights_m < 1e-4
    assert is_touching.any()
    # Cycloid: speed v sqrt(2 h / r) at the height h.
    assert speeds[is_touching].max() < 20 * np.sqrt(2 * 1e-4 / 0.32) * 1.5
    assert speeds.max() == pytest.approx(40, rel=1e-3)


def test_wheels_roll_backwards_with_reversing_car():
    forward_car, backward_car = Car(speed_m_per_s=5.0), Car(speed_m_per_s=-5.0)
    times_s = np.array([0.0, 0.01, 0.5])

    assert forward_car.scatterer_offsets_m(times_s) == pytest.approx(
        backward_car.scatterer_offsets_m(-times_s), abs=1e-12
    )


def test_car_without_rolling_wheels_is_rigid():
    assert Car().is_rigid and not Car(speed_m_per_s=1.0).is_rigid
    assert (
        Car().scatterer_offsets_m(np.array([0.0]))[0]
        == Car().scatterer_offsets_m(np.array([3.0]))[0]
    ).all()


def compute_doppler_spectrum(radar, body):
    """Compute velocities (m/s) and powers of a body that recedes obliquely at 10 m/s."""
    target = dc.Target(
        position_m=(18, -9, -0.5), velocity_m_per_s=(10, 0, 0), heading_rad=0.0, body=body
    )
    cube = dc.simulate(dc.Scene(targets=[target]), radar, impairments=()).values[0]
    spectrum = np.fft.fftshift(np.fft.fft(cube * np.hanning(len(cube))[:, None, None], axis=0), 0)
    bins = np.fft.fftshift(np.fft.fftfreq(len(cube), radar.frame.repetition_s))
    return bins * radar.frame.chirp.wavelength_m / 2, (abs(spectrum) ** 2).sum(axis=(1, 2))


def test_doppler_spectrum_has_body_line_and_rim_sidebands(radar):
    velocities, rolling_power = compute_doppler_spectrum(radar, Car(speed_m_per_s=10.0))
    _, sliding_power = compute_doppler_spectrum(radar, Car())
    v = 10 * 18 / np.hypot(18, 9)  # aspects of the wheels differ by 3 deg

    # Bins of 0.43 m/s; the corners of the car differ by 1 m/s in their aspect.
    assert velocities[rolling_power.argmax()] == pytest.approx(v, abs=1.0)
    rim_speeds = (velocities > 1.3 * v) & (velocities < 2.0 * v)
    is_beyond = (velocities > 2.0 * v + 2.5) | (velocities < -2.5)
    # The highest third of a rim exceeds 1.3 v: some 0.3 of the rims' 1.0 m^2 of 7.
    assert 0.01 < rolling_power[rim_speeds].sum() / rolling_power.sum() < 0.3
    assert sliding_power[rim_speeds].sum() < 1e-3 * rolling_power[rim_speeds].sum()
    assert rolling_power[is_beyond].sum() < 1e-4 * rolling_power.sum()


def test_true_snr_of_car_sums_its_visible_scatterers(radar):
    target = dc.Target(position_m=(30, 0, -0.5), velocity_m_per_s=(10, 0, 0), body=Car())
    point = replace(target, body=None, rcs_m2=10**1.36)
    snr = [
        dc.truth(dc.Scene(targets=[body_or_point]), radar).snr.item()
        for body_or_point in (target, point)
    ]

    assert to_decibels(snr[0] / snr[1]) == pytest.approx(0, abs=1.5)


@pytest.mark.parametrize(
    ("kind", "settings", "message"),
    [
        (Car, {"length_m": -4.5}, r"Car.length_m: -4.5"),
        (Van, {"width_m": 0}, r"Van.width_m: 0"),
        (Truck, {"height_m": float("nan")}, r"Truck.height_m: nan"),
        (Car, {"length_m": 4500.0}, r"Car.length_m: 4500"),
        (Car, {"wheel_radius_m": 0}, r"Car.wheel_radius_m: 0"),
        (Car, {"wheel_radius_m": 0.9}, r"Car.wheel_radius_m: 0.9 m; expected at most 0.8 m"),
        (Truck, {"wheel_radius_m": 0.7}, r"Truck.wheel_radius_m.* beside each other"),
        (Van, {"speed_m_per_s": float("inf")}, r"Van.speed_m_per_s: inf"),
        (Car, {"speed_m_per_s": 2e5}, r"Car.speed_m_per_s: 4e\+05 m/s at the top of the wheels"),
    ],
)
def test_rejects_invalid_vehicle(kind, settings, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        kind(**settings)


def test_settings_select_vehicle_by_kind():
    text = "position: [20 m, 0 m, -0.5 m]\nbody: {kind: truck, speed: 80 km/h, height: 3.5 m}"
    body = parse_settings(text, Target).body

    assert isinstance(body, Truck)
    assert body.speed_m_per_s == pytest.approx(80 / 3.6)
    assert body.height_m == 3.5
    assert {"car", "van", "truck"} <= set(Body.members())
    assert "vehicle" not in Body.members()

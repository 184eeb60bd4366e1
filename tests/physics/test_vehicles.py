"""Cars, vans and trucks: what they reflect over aspect, what they hide, how their wheels turn."""

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
TABLE = [
    (0, 40.54, 71.75, 29.13, 15.52, 8.45),
    (90, 26.90, 79.70, 44.42, 20.75, 13.68),
    (180, 36.32, 79.65, 36.73, 14.56, 7.50),
    (270, 26.90, 79.70, 44.42, 20.75, 13.68),
]
AZIMUTHS_DEG = np.arange(-180.0, 180.0)
VEHICLES = [Car, Van, Truck]


def table_db(azimuth_deg, elevation_deg):
    """Equation 7.9.2-2 of the same, for the side within 45 deg of the azimuth."""
    middle, width, zenith, height, peak_db, most_db = TABLE[int((azimuth_deg + 45) // 90) % 4]
    off = (azimuth_deg - middle + 180) % 360 - 180
    loss_db = 12 * (off / width) ** 2 + 12 * ((90 - elevation_deg - zenith) / height) ** 2
    return peak_db - min(loss_db, most_db)


def seen_m2(body, azimuth_deg, elevation_deg=0.0, range_m=1e5):
    """From directions around a body, (n_places, n_scatterers)."""
    azimuth, elevation = np.radians(np.atleast_1d(azimuth_deg)), np.radians(elevation_deg)
    level = np.cos(elevation)
    z = np.full(azimuth.shape, np.sin(elevation))
    to_radar = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), z], axis=-1)
    return body.cross_sections_towards_m2(range_m * to_radar, WAVELENGTH_M)


def decibels(power):
    return 10 * np.log10(power)


@pytest.mark.parametrize("elevation_deg", [0, 5, 20, 40])
def test_a_car_reflects_over_aspect_as_in_the_table_of_3gpp(elevation_deg):
    found_db = decibels(seen_m2(Car(), AZIMUTHS_DEG, elevation_deg).sum(axis=1))
    known_db = [table_db(azimuth_deg, elevation_deg) for azimuth_deg in AZIMUTHS_DEG]

    assert found_db == pytest.approx(np.array(known_db), abs=3.0)
    # At the middle of each side its lobe stands alone: the rest adds half a decibel at most.
    if elevation_deg == 0:
        assert found_db[[0, 90, 180, 270]] == pytest.approx([13.6, 20.1, 10.8, 20.1], abs=1.0)


@pytest.mark.parametrize("kind", VEHICLES)
def test_left_and_right_are_alike(kind):
    found_m2 = seen_m2(kind(), AZIMUTHS_DEG).sum(axis=1)

    assert found_m2[1:] == pytest.approx(found_m2[:0:-1], rel=1e-9)


def test_a_car_twice_as_large_reflects_four_times_as_much():
    large = Car(length_m=10, width_m=4, height_m=3.2, wheel_radius_m=0.64)
    azimuths_deg = np.arange(-179.5, 180)

    # Its points, more in number, are seen from 1e5 m in angles that differ by 1e-4 rad.
    assert seen_m2(large, azimuths_deg).sum(axis=1) == pytest.approx(
        4 * seen_m2(Car(), azimuths_deg).sum(axis=1), rel=1e-2
    )


def test_the_side_of_a_truck_outshines_that_of_a_car_by_their_areas():
    sides_m2 = [seen_m2(kind(), 90.0).sum() for kind in (Truck, Car)]

    # What is not of the panels, 0.2 dB, goes with the areas of all sides.
    assert decibels(sides_m2[0] / sides_m2[1]) == pytest.approx(
        decibels(16.5 * 4.0 / (5.0 * 1.6)), abs=0.2
    )


@pytest.mark.parametrize("kind", VEHICLES)
def test_what_faces_away_is_hidden(kind):
    body = kind()
    x, y, _ = body.offsets_m(np.zeros(1))[0].T
    nose, left = x > 0.499 * body.length_m, y > 0.4 * body.width_m
    right, tail = y < -0.4 * body.width_m, x < -0.499 * body.length_m
    middle = ~(nose | tail)

    assert not seen_m2(body, 60.0)[0, right & middle].any()
    assert not seen_m2(body, 60.0)[0, tail & ~left].any()
    assert seen_m2(body, 60.0)[0, (left | nose) & middle].all()
    assert not seen_m2(body, 180.0)[0, ~tail].any()
    # Three of the four corners: not the one across.
    corners = seen_m2(body, -120.0)[0, (nose | tail) & (abs(y) > 0.499 * body.width_m)]
    assert np.count_nonzero(corners) == 0.75 * corners.size


def test_the_flash_of_a_side_wanders_along_it_as_the_radar_passes():
    body = Truck()
    x_m, y_m, _ = body.offsets_m(np.zeros(1))[0].T
    side = (y_m > 0.499 * body.width_m) & (abs(x_m) < 0.499 * body.length_m)
    for abreast_m in (-5.0, 0.0, 4.0):
        seen = body.cross_sections_towards_m2(np.array([[abreast_m, 6.0, 0.5]]), WAVELENGTH_M)[
            0, side
        ]
        assert np.average(x_m[side], weights=seen) == pytest.approx(abreast_m, abs=0.2)
        # As far to both sides as its lobe is wide: 26.9 deg at 4.7 m.
        near = abs(x_m[side] - abreast_m) < 4.7 * np.tan(np.radians(26.9))
        assert seen[near].sum() > 0.95 * seen.sum()


def speeds_m_per_s(kind, azimuth, times_s):
    """Rates of change of range in a scene, (n_times, n), and those of wheels among them.

    The vehicle goes at 10 m/s along x, far away in the direction of an azimuth.
    """
    place_m = 1e5 * np.array([np.cos(azimuth), np.sin(azimuth), 0])
    body = kind(speed_m_per_s=10.0)
    target = Target(position_m=tuple(place_m), velocity_m_per_s=(10, 0, 0), body=body)
    scene, step_s = Scene(targets=[target]), 1e-4
    ranges_m = [
        np.linalg.norm(scene.positions_m(times_s + shift_s), axis=-1)
        for shift_s in (-step_s / 2, step_s / 2)
    ]
    moving = body.offsets_m(np.array([0.0, 1e-3]))
    return (ranges_m[1] - ranges_m[0]) / step_s, (moving[0] != moving[1]).any(axis=-1)


@pytest.mark.parametrize("kind", VEHICLES)
@pytest.mark.parametrize("aspect_deg", [0, 40, 70, 150])
def test_rims_span_from_standing_to_twice_the_speed_and_the_body_moves_as_one(kind, aspect_deg):
    aspect = np.radians(aspect_deg)
    body = kind()
    turn_s = 2 * np.pi * body.wheel_radius_m / 10
    speeds, on_wheels = speeds_m_per_s(kind, aspect, np.linspace(0, turn_s, 64))

    v = 10 * np.cos(aspect)
    # Differences over 0.1 ms, of places known to 1e-11 m, on circles that turn by 3 mrad; the
    # direction changes by the size of the body over 1e5 m: 2 mm/s.
    assert speeds[:, ~on_wheels] == pytest.approx(v, abs=0.01)
    rims = speeds[:, on_wheels]
    assert rims.min() == pytest.approx(min(0, 2 * v), abs=0.02)
    assert rims.max() == pytest.approx(max(0, 2 * v), abs=0.02)
    assert rims.mean(axis=0) == pytest.approx(v, abs=0.2)  # 64 times, both ends


def test_where_a_tyre_touches_the_ground_it_stands():
    body = Car(speed_m_per_s=20.0)
    times_s = np.linspace(0, 0.1, 2001)
    over_ground_m = body.offsets_m(times_s) + (20.0 * times_s)[:, None, None] * [1, 0, 0]
    heights_m = over_ground_m[:-1, :, 2]
    speeds = np.linalg.norm(np.diff(over_ground_m, axis=0), axis=-1) / np.diff(times_s)[:, None]

    assert heights_m.min() >= 0
    touching = heights_m < 1e-4
    assert touching.any()
    # A cycloid: speed v sqrt(2 h / r) at the height h.
    assert speeds[touching].max() < 20 * np.sqrt(2 * 1e-4 / 0.32) * 1.5
    assert speeds.max() == pytest.approx(40, rel=1e-3)


def test_wheels_roll_backwards_with_a_car_that_backs_up():
    ahead, back = Car(speed_m_per_s=5.0), Car(speed_m_per_s=-5.0)
    times_s = np.array([0.0, 0.01, 0.5])

    assert ahead.offsets_m(times_s) == pytest.approx(back.offsets_m(-times_s), abs=1e-12)


def test_a_car_on_standing_wheels_is_rigid():
    assert Car().is_rigid and not Car(speed_m_per_s=1.0).is_rigid
    assert (Car().offsets_m(np.array([0.0]))[0] == Car().offsets_m(np.array([3.0]))[0]).all()


def doppler(radar, body):
    """Velocities (m/s), and the power at each of a body that recedes obliquely at 10 m/s."""
    target = dc.Target(
        position_m=(18, -9, -0.5), velocity_m_per_s=(10, 0, 0), heading_rad=0.0, body=body
    )
    cube = dc.simulate(dc.Scene(targets=[target]), radar, impairments=()).values[0]
    spectrum = np.fft.fftshift(np.fft.fft(cube * np.hanning(len(cube))[:, None, None], axis=0), 0)
    bins = np.fft.fftshift(np.fft.fftfreq(len(cube), radar.frame.repetition_s))
    return bins * radar.frame.chirp.wavelength_m / 2, (abs(spectrum) ** 2).sum(axis=(1, 2))


def test_the_spectrum_of_a_car_is_a_line_with_the_rims_around_it(radar):
    velocities, turning = doppler(radar, Car(speed_m_per_s=10.0))
    _, standing = doppler(radar, Car())
    v = 10 * 18 / np.hypot(18, 9)  # the wheels are seen under 3 deg more or less

    # Bins of 0.43 m/s; the corners of the car differ by 1 m/s in their aspect.
    assert velocities[turning.argmax()] == pytest.approx(v, abs=1.0)
    rims = (velocities > 1.3 * v) & (velocities < 2.0 * v)
    beyond = (velocities > 2.0 * v + 2.5) | (velocities < -2.5)
    # Over 1.3 v is the third of a circle that is highest: some 0.3 of the rims' 1.0 m^2 of 7.
    assert 0.01 < turning[rims].sum() / turning.sum() < 0.3
    assert standing[rims].sum() < 1e-3 * turning[rims].sum()
    assert turning[beyond].sum() < 1e-4 * turning.sum()


def test_the_truth_of_a_car_is_that_of_all_it_shows(radar):
    target = dc.Target(position_m=(30, 0, -0.5), velocity_m_per_s=(10, 0, 0), body=Car())
    point = replace(target, body=None, rcs_m2=10**1.36)
    snr = [dc.truth(dc.Scene(targets=[one]), radar).snr.item() for one in (target, point)]

    assert decibels(snr[0] / snr[1]) == pytest.approx(0, abs=1.5)


@pytest.mark.parametrize(
    ("kind", "of", "message"),
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
def test_a_vehicle_that_cannot_be_is_refused_by_name(kind, of, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        kind(**of)


def test_settings_files_choose_vehicles_by_kind():
    text = "position: [20 m, 0 m, -0.5 m]\nbody: {kind: truck, speed: 80 km/h, height: 3.5 m}"
    body = parse_settings(text, Target).body

    assert isinstance(body, Truck)
    assert body.speed_m_per_s == pytest.approx(80 / 3.6)
    assert body.height_m == 3.5
    assert {"car", "van", "truck"} <= set(Body.members())
    assert "vehicle" not in Body.members()

"""Ground clutter: cross section, fading and ridge over azimuth for a moving radar."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.config.loading import parse_settings
from dechirp.scene.bodies.ground_clutter import GroundClutter
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target

WAVELENGTH_M = 3.9e-3
SPACING_M = 1.95e-3
GROUND_POSITION_M = (0.0, 0.0, -0.5)


def test_ground_cross_section_follows_area_and_grazing_angle():
    ground = GroundClutter(near_m=5, far_m=45, width_m=30, n_patches=20_000, gamma=0.03)
    found_m2 = ground.cross_sections_towards_m2(np.array([[0.0, 0.0, 0.6]]), WAVELENGTH_M)
    x_m = (np.arange(400) + 0.5) / 10 + 5
    y_m = (np.arange(300) + 0.5) / 10 - 15
    grazing = 0.6 / np.sqrt(x_m[:, None] ** 2 + y_m**2 + 0.36)

    # The mean sine of 20,000 random positions has a standard error of 0.4 %.
    assert found_m2.sum() == pytest.approx(0.03 * 1200 * grazing.mean(), rel=0.02)
    from_above = ground.cross_sections_towards_m2(np.array([[25.0, 0.0, 1e6]]), WAVELENGTH_M)
    assert from_above.sum() == pytest.approx(0.03 * 1200, rel=1e-6)


def test_patches_stay_fixed_while_radar_moves():
    ground = GroundClutter(n_patches=50)
    scene = Scene(
        targets=[Target(position_m=GROUND_POSITION_M, body=ground)],
        ego=dc.Ego(velocity_m_per_s=(15, 0, 0)),
    )
    before_m, after_m = scene.scatterer_positions_m([0.0, 0.4])

    assert before_m - after_m == pytest.approx(np.tile([6.0, 0, 0], (50, 1)), abs=1e-9)
    assert ground.is_rigid
    assert GroundClutter(n_patches=50) == ground
    assert (GroundClutter(n_patches=50, seed=1).scatterer_offsets_m(np.zeros(1)) != before_m).any()


def test_patches_are_uniform_within_area():
    ground = GroundClutter(near_m=-3, far_m=17, width_m=8, n_patches=4000, seed=5)
    x, y, z = ground.scatterer_offsets_m(np.zeros(1))[0].T

    assert x.min() >= -3 and x.max() <= 17 and abs(y).max() <= 4 and not z.any()
    # Means of uniform positions are within five standard errors.
    assert x.mean() == pytest.approx(7, abs=5 * 20 / np.sqrt(12 * 4000))
    assert y.mean() == pytest.approx(0, abs=5 * 8 / np.sqrt(12 * 4000))


def test_clutter_power_is_exponentially_distributed():
    powers = []
    for seed in range(40):
        ground = GroundClutter(near_m=10, far_m=40, width_m=20, n_patches=3000, seed=seed)
        scene = Scene(targets=[Target(position_m=GROUND_POSITION_M, body=ground)])
        range_m = np.linalg.norm(scene.scatterer_positions_m([0.0])[0], axis=-1)
        rcs_m2 = ground.cross_sections_towards_m2(np.array([[0.0, 0.0, 0.5]]), WAVELENGTH_M)[0]
        field = np.sqrt(rcs_m2) * np.exp(4j * np.pi * range_m / WAVELENGTH_M)
        cells = np.floor(range_m).astype(int)  # 1 m wide, with some hundred patches each
        for cell in range(15, 35):
            is_in_cell = cells == cell
            powers.append(abs(field[is_in_cell].sum()) ** 2 / rcs_m2[is_in_cell].sum())

    # 800 exponential draws have mean and deviation 1; five standard errors.
    assert np.mean(powers) == pytest.approx(1, abs=0.18)
    assert np.std(powers) == pytest.approx(1, abs=0.36)


@pytest.fixture(scope="module")
def sixteen_receiver_radar(radar):
    """Return a radar with a line of sixteen receivers: 6.4 deg between 3 dB points."""
    rx_m = [(0.0, k * SPACING_M, 0.0) for k in range(16)]
    return replace(radar, array=dc.Array(rx_m=rx_m))


def measure_ridge(sixteen_receiver_radar, velocity_m_per_s):
    """Return azimuths (deg), velocities (m/s) and the power over both."""
    ground = GroundClutter(near_m=4, far_m=44, width_m=80, n_patches=1500)
    scene = dc.Scene(
        targets=[dc.Target(position_m=GROUND_POSITION_M, body=ground)],
        ego=dc.Ego(velocity_m_per_s=velocity_m_per_s),
    )
    cube = dc.simulate(scene, sixteen_receiver_radar, impairments=()).values[0]  # chirp, rx, sample
    chirps, rx, samples = (np.hanning(n) for n in cube.shape)
    cube = cube * chirps[:, None, None] * rx[:, None] * samples
    spectrum = np.fft.fftshift(np.fft.fft(np.fft.fft(cube, axis=2), axis=0), 0)
    velocities = np.fft.fftshift(
        np.fft.fftfreq(len(cube), sixteen_receiver_radar.frame.repetition_s)
    )
    wavelength_m = sixteen_receiver_radar.frame.chirp.wavelength_m
    azimuths_deg = np.arange(-50, 51, 10)
    cycles = np.sin(np.radians(azimuths_deg)) * SPACING_M / wavelength_m
    # A wave from the left reaches the left elements first, with less beat phase.
    steering = np.exp(2j * np.pi * cycles[:, None] * np.arange(16))
    beams = np.einsum("ar,vrs->avs", steering, spectrum)
    return azimuths_deg, velocities * wavelength_m / 2, (abs(beams) ** 2).sum(axis=2)


def test_moving_radar_has_clutter_ridge_over_azimuth(sixteen_receiver_radar):
    azimuths_deg, velocities, power = measure_ridge(sixteen_receiver_radar, (18.0, 0.0, 0.0))

    for azimuth_deg, over_velocity in zip(azimuths_deg, power, strict=True):
        expected = -18 * np.cos(np.radians(azimuth_deg))
        is_on_ridge = abs(velocities - expected) < 3.5
        # Velocities spread within the beam, 11 deg wide with its window; random fading shifts their
        # mean by two bins of 0.43 m/s.
        mean = np.average(velocities[is_on_ridge], weights=over_velocity[is_on_ridge])
        assert mean == pytest.approx(expected, abs=0.9)
        assert over_velocity[is_on_ridge].sum() > 0.9 * over_velocity.sum()


def test_stationary_radar_has_clutter_at_zero_velocity(sixteen_receiver_radar):
    _, velocities, power = measure_ridge(sixteen_receiver_radar, (0.0, 0.0, 0.0))

    # The window has only sidelobes beyond two bins.
    assert power[:, abs(velocities) < 1].sum() > (1 - 1e-5) * power.sum()


def test_clutter_ridge_follows_yaw_of_radar(sixteen_receiver_radar):
    # The boresight is 30 deg to the left of the velocity: the ridge peaks at -30 deg.
    ground = GroundClutter(near_m=4, far_m=44, width_m=80, n_patches=200)
    scene = Scene(
        targets=[Target(position_m=GROUND_POSITION_M, body=ground)],
        ego=dc.Ego(velocity_m_per_s=(18, 0, 0), yaw_rad=np.pi / 6),
    )
    first_m, second_m = scene.scatterer_positions_m([0.0, 1e-3])
    velocities = (np.linalg.norm(second_m, axis=-1) - np.linalg.norm(first_m, axis=-1)) / 1e-3
    x, y, z = ((first_m + second_m) / 2).T
    level = np.hypot(x, y) / np.sqrt(x**2 + y**2 + z**2)

    assert velocities == pytest.approx(-18 * np.cos(np.arctan2(y, x) + np.pi / 6) * level, abs=1e-3)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"near_m": 50, "far_m": 20}, "GroundClutter.near_m: 50 m; expected below far_m"),
        ({"far_m": float("nan")}, "GroundClutter.far_m: nan"),
        ({"width_m": -3}, "GroundClutter.width_m: -3"),
        ({"n_patches": 0}, "GroundClutter.n_patches: 0"),
        ({"gamma": -15.0}, "GroundClutter.gamma: -15"),
        ({"seed": -1}, "GroundClutter.seed: -1"),
    ],
)
def test_rejects_invalid_ground_clutter(settings, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        GroundClutter(**settings)


def test_rejects_radar_at_ground_level(radar):
    scene = dc.Scene(targets=[dc.Target(position_m=(5, 0, 0), body=GroundClutter())])

    message = r"^scene\.targets\.target-1\.position: .* 0 m above the radar"
    with pytest.raises(dc.InvalidSetting, match=message):
        dc.simulate(scene, radar)


def test_settings_file_accepts_gamma_in_decibels():
    target = parse_settings(
        "position: [0 m, 0 m, -0.5 m]\nbody: {kind: ground-clutter, gamma: -10 dB}", Target
    )

    assert isinstance(target.body, GroundClutter)
    assert target.body.gamma == pytest.approx(0.1)

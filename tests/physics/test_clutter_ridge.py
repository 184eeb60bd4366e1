"""Ground clutter: how much of it there is, and at which velocities a moving radar sees it."""

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
DOWN_M = (0.0, 0.0, -0.5)


def test_ground_reflects_by_its_area_and_the_grazing_angle():
    ground = GroundClutter(near_m=5, far_m=45, width_m=30, n_patches=20_000, gamma=0.03)
    found_m2 = ground.cross_sections_towards_m2(np.array([[0.0, 0.0, 0.6]]), WAVELENGTH_M)
    x_m = (np.arange(400) + 0.5) / 10 + 5
    y_m = (np.arange(300) + 0.5) / 10 - 15
    grazing = 0.6 / np.sqrt(x_m[:, None] ** 2 + y_m**2 + 0.36)

    # 20,000 random places: their mean sine is known to 0.4 %.
    assert found_m2.sum() == pytest.approx(0.03 * 1200 * grazing.mean(), rel=0.02)
    from_above = ground.cross_sections_towards_m2(np.array([[25.0, 0.0, 1e6]]), WAVELENGTH_M)
    assert from_above.sum() == pytest.approx(0.03 * 1200, rel=1e-6)


def test_a_patch_is_still_in_the_world_as_the_radar_drives_on():
    ground = GroundClutter(n_patches=50)
    scene = Scene(
        targets=[Target(position_m=DOWN_M, body=ground)],
        ego=dc.Ego(velocity_m_per_s=(15, 0, 0)),
    )
    before_m, after_m = scene.positions_m([0.0, 0.4])

    assert before_m - after_m == pytest.approx(np.tile([6.0, 0, 0], (50, 1)), abs=1e-9)
    assert ground.is_rigid
    assert GroundClutter(n_patches=50) == ground
    assert (GroundClutter(n_patches=50, seed=1).offsets_m(np.zeros(1)) != before_m).any()


def test_patches_lie_where_the_area_is():
    ground = GroundClutter(near_m=-3, far_m=17, width_m=8, n_patches=4000, seed=5)
    x, y, z = ground.offsets_m(np.zeros(1))[0].T

    assert x.min() >= -3 and x.max() <= 17 and abs(y).max() <= 4 and not z.any()
    # Uniform: means within five standard errors.
    assert x.mean() == pytest.approx(7, abs=5 * 20 / np.sqrt(12 * 4000))
    assert y.mean() == pytest.approx(0, abs=5 * 8 / np.sqrt(12 * 4000))


def test_the_echo_of_many_patches_fades_as_rayleigh_says():
    powers = []
    for seed in range(40):
        ground = GroundClutter(near_m=10, far_m=40, width_m=20, n_patches=3000, seed=seed)
        scene = Scene(targets=[Target(position_m=DOWN_M, body=ground)])
        range_m = np.linalg.norm(scene.positions_m([0.0])[0], axis=-1)
        rcs_m2 = ground.cross_sections_towards_m2(np.array([[0.0, 0.0, 0.5]]), WAVELENGTH_M)[0]
        field = np.sqrt(rcs_m2) * np.exp(4j * np.pi * range_m / WAVELENGTH_M)
        cells = np.floor(range_m).astype(int)  # 1 m, some hundred patches each
        for cell in range(15, 35):
            own = cells == cell
            powers.append(abs(field[own].sum()) ** 2 / rcs_m2[own].sum())

    # 800 exponential draws: mean 1, as spread; five standard errors.
    assert np.mean(powers) == pytest.approx(1, abs=0.18)
    assert np.std(powers) == pytest.approx(1, abs=0.36)


@pytest.fixture(scope="module")
def wide(radar):
    """Sixteen receivers in a row: 6.4 deg between 3 dB points."""
    rx_m = [(0.0, k * SPACING_M, 0.0) for k in range(16)]
    return replace(radar, array=dc.Array(rx_m=rx_m))


def ridge(wide, velocity_m_per_s):
    """Velocities (m/s) of most power over directions (deg), and all of both."""
    ground = GroundClutter(near_m=4, far_m=44, width_m=80, n_patches=1500)
    scene = dc.Scene(
        targets=[dc.Target(position_m=DOWN_M, body=ground)],
        ego=dc.Ego(velocity_m_per_s=velocity_m_per_s),
    )
    cube = dc.simulate(scene, wide, impairments=()).values[0]  # chirp, rx, sample
    chirps, rx, samples = (np.hanning(n) for n in cube.shape)
    cube = cube * chirps[:, None, None] * rx[:, None] * samples
    spectrum = np.fft.fftshift(np.fft.fft(np.fft.fft(cube, axis=2), axis=0), 0)
    velocities = np.fft.fftshift(np.fft.fftfreq(len(cube), wide.frame.repetition_s))
    wavelength_m = wide.frame.chirp.wavelength_m
    azimuths_deg = np.arange(-50, 51, 10)
    turns = np.sin(np.radians(azimuths_deg)) * SPACING_M / wavelength_m
    # A wave from the left comes to the left first, with less phase of the beat.
    steering = np.exp(2j * np.pi * turns[:, None] * np.arange(16))
    beams = np.einsum("ar,vrs->avs", steering, spectrum)
    return azimuths_deg, velocities * wavelength_m / 2, (abs(beams) ** 2).sum(axis=2)


def test_a_moving_radar_sees_ground_on_a_ridge_over_azimuth(wide):
    azimuths_deg, velocities, power = ridge(wide, (18.0, 0.0, 0.0))

    for azimuth_deg, over_velocity in zip(azimuths_deg, power, strict=True):
        expected = -18 * np.cos(np.radians(azimuth_deg))
        near = abs(velocities - expected) < 3.5
        # Within the beam, 11 deg wide with its window, velocities spread; their mean is off by
        # random fading: two bins of 0.43 m/s.
        mean = np.average(velocities[near], weights=over_velocity[near])
        assert mean == pytest.approx(expected, abs=0.9)
        assert over_velocity[near].sum() > 0.9 * over_velocity.sum()


def test_a_standing_radar_sees_ground_stand(wide):
    _, velocities, power = ridge(wide, (0.0, 0.0, 0.0))

    # Beyond two bins there are the side lobes of the window.
    assert power[:, abs(velocities) < 1].sum() > (1 - 1e-5) * power.sum()


def test_ground_beside_a_turned_radar_keeps_its_place_in_the_world(wide):
    # The radar looks 30 deg to the left of where it goes: the ridge is highest at -30 deg.
    ground = GroundClutter(near_m=4, far_m=44, width_m=80, n_patches=200)
    scene = Scene(
        targets=[Target(position_m=DOWN_M, body=ground)],
        ego=dc.Ego(velocity_m_per_s=(18, 0, 0), yaw_rad=np.pi / 6),
    )
    first_m, then_m = scene.positions_m([0.0, 1e-3])
    velocities = (np.linalg.norm(then_m, axis=-1) - np.linalg.norm(first_m, axis=-1)) / 1e-3
    x, y, z = ((first_m + then_m) / 2).T
    level = np.hypot(x, y) / np.sqrt(x**2 + y**2 + z**2)

    assert velocities == pytest.approx(-18 * np.cos(np.arctan2(y, x) + np.pi / 6) * level, abs=1e-3)


@pytest.mark.parametrize(
    ("of", "message"),
    [
        ({"near_m": 50, "far_m": 20}, "GroundClutter.near_m: 50 m; expected below far_m"),
        ({"far_m": float("nan")}, "GroundClutter.far_m: nan"),
        ({"width_m": -3}, "GroundClutter.width_m: -3"),
        ({"n_patches": 0}, "GroundClutter.n_patches: 0"),
        ({"gamma": -15.0}, "GroundClutter.gamma: -15"),
        ({"seed": -1}, "GroundClutter.seed: -1"),
    ],
)
def test_ground_that_cannot_be_is_refused_by_name(of, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        GroundClutter(**of)


def test_a_radar_in_the_ground_is_refused(radar):
    scene = dc.Scene(targets=[dc.Target(position_m=(5, 0, 0), body=GroundClutter())])

    wrong = r"^scene\.targets\.target-1\.position: .* 0 m above the radar"
    with pytest.raises(dc.InvalidSetting, match=wrong):
        dc.simulate(scene, radar)


def test_settings_files_give_gamma_in_decibels():
    found = parse_settings(
        "position: [0 m, 0 m, -0.5 m]\nbody: {kind: ground-clutter, gamma: -10 dB}", Target
    )

    assert isinstance(found.body, GroundClutter)
    assert found.body.gamma == pytest.approx(0.1)

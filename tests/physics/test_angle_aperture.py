"""Array aperture: steering vectors, resolved axes, direction grid and grating lobes."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.angle.aperture import Aperture, FieldOfView, radar_aperture
from dechirp.processing.angle.grating_lobes import (
    grating_lobe_findings,
    smallest_grating_lobe_separation,
)
from dechirp.radar.calibration import Calibration

WIDE = np.arange(8) * 0.5


def make_positions(*, y=0.0, z=0.0, x=0.0):
    return np.stack(np.broadcast_arrays(x, y, z), axis=-1).astype(float)


def replace_array(radar, tx_m, rx_m):
    multiplexing = dc.multiplexing.Tdm(order=tuple(range(len(tx_m)))) if len(tx_m) > 1 else None
    frame = replace(radar.frame, multiplexing=multiplexing)
    return replace(radar, frame=frame, array=dc.Array(tx_m=tx_m, rx_m=rx_m))


def test_steering_vector_equals_phase_of_far_target(radar):
    wavelength_m = 299_792_458.0 / radar.frame.chirp.mean_sampled_frequency_hz
    tx_m = np.array([(0, 0, 0), (0.001, 0.008, -0.002)])
    rx_m = np.array([(0, 0, 0), (0, 0.002, 0), (0, 0.001, 0.003)])
    aperture = radar_aperture(replace_array(radar, tx_m, rx_m))
    # The distance keeps the wavefront flat to 1e-9 cycles over 8 mm: d^2 / (R lambda).
    target_m = 1e7 * np.array([np.cos(0.4) * np.cos(0.3), np.cos(0.4) * np.sin(0.3), np.sin(0.4)])
    paths_m = [
        np.linalg.norm(target_m - t) + np.linalg.norm(target_m - r) - 2e7
        for t in tx_m
        for r in rx_m
    ]
    # Phases of Tx x conj(Rx) grow with the path length. Double precision resolves a path of 1e7 m
    # to 4e-9 m.
    expected = np.exp(2j * np.pi * np.array(paths_m) / wavelength_m)
    assert aperture.steering_vectors(0.3, 0.4) == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize(
    ("positions", "resolved_axes"),
    [
        (make_positions(y=WIDE), (True, False)),
        (make_positions(z=WIDE), (False, True)),
        (make_positions(y=WIDE, z=0.3 * WIDE), (True, False)),
        (make_positions(y=0.3 * WIDE, z=WIDE), (False, True)),
        (make_positions(y=WIDE, z=[0, 0, 0.5, 0, 0, 0, 0, 0]), (True, True)),
        # Position errors of a twentieth of a wavelength do not resolve a second axis.
        (make_positions(y=WIDE, z=[0, 0.05, 0, 0, 0.05, 0, 0, 0]), (True, False)),
    ],
)
def test_linear_array_resolves_one_angle_and_planar_array_both(positions, resolved_axes):
    aperture = Aperture(positions)
    assert aperture.resolves_azimuth_and_elevation == resolved_axes
    shape = aperture.direction_grid.shape
    assert (shape[1] > 1, shape[0] > 1) == resolved_axes


@pytest.mark.parametrize(
    "positions",
    [make_positions(y=[0.0]), make_positions(y=[1.0, 1.0, 1.0]), make_positions(x=WIDE)],
    ids=str,
)
def test_rejects_array_without_extent_across_boresight(positions):
    with pytest.raises(dc.InvalidSetting, match=r"Radar\.array") as error:
        Aperture(positions)
    assert "array.tx" in str(error.value)


def test_rejects_array_of_unknown_geometry(radar):
    with pytest.raises(dc.InvalidSetting, match=r"Radar\.array"):
        radar_aperture(replace(radar, array=dc.Array()))


def test_rejects_nonfinite_positions():
    with pytest.raises(dc.InvalidSetting, match="positions"):
        Aperture(make_positions(y=[0.0, np.nan]))


def test_aperture_includes_calibrated_position_errors(radar):
    plain = replace_array(radar, [(0, 0, 0), (0, 0.004, 0)], [(0, 0, 0), (0, 0.002, 0)])
    calibration = Calibration(
        elements=((1, 0), (0, 1), (0, 0), (1, 1)),
        gain=((1.0, 0.0),) * 4,
        position_error_m=((0.0, 1e-4, 0.0), (0.0, 0.0, 2e-4), (0.0,) * 3, (0.0,) * 3),
    )
    wavelength_m = 299_792_458.0 / plain.frame.chirp.mean_sampled_frequency_hz
    difference = (
        radar_aperture(replace(plain, calibration=calibration)).positions
        - radar_aperture(plain).positions
    )
    expected_m = np.zeros((4, 3))
    expected_m[2, 1], expected_m[1, 2] = 1e-4, 2e-4
    assert difference * wavelength_m == pytest.approx(expected_m, abs=1e-12)


@pytest.mark.parametrize(
    "positions", [make_positions(y=WIDE), make_positions(y=WIDE[:, None], z=WIDE[:4])]
)
def test_direction_grid_has_small_straddling_loss(positions):
    aperture = Aperture(positions.reshape(-1, 3), FieldOfView(azimuth_rad=1.2, elevation_rad=0.5))
    rng = np.random.default_rng(72)
    # The last grid direction may be a whole step away from the edges.
    azimuth, elevation = rng.uniform(-1.1, 1.1, 500), rng.uniform(-0.4, 0.4, 500)
    elevation *= aperture.resolves_azimuth_and_elevation[1]
    correlation = (
        aperture.steering_vectors(azimuth, elevation).conj()
        @ aperture.direction_grid.steering.T
        / aperture.n_elements
    )
    loss_db = -20 * np.log10(np.abs(correlation).max(axis=1))
    # Half a grid step loses pi^2 / 3 (1 / 16)^2 of the beam power, on a plane 1 / 8 on each of two
    # axes.
    assert loss_db.max() < (0.06 if sum(aperture.resolves_azimuth_and_elevation) == 1 else 0.5)
    assert np.any(aperture.direction_grid.azimuth_rad == 0) and np.any(
        aperture.direction_grid.elevation_rad == 0
    )
    assert (
        abs(aperture.direction_grid.azimuth_rad).max() <= 1.2
        and abs(aperture.direction_grid.elevation_rad).max() <= 0.5
    )


def test_rejects_direction_grid_larger_than_memory():
    rng = np.random.default_rng(73)
    aperture = Aperture(rng.uniform(0, 200, (300, 3)) * [0, 1, 1])
    with pytest.raises(dc.InvalidSetting, match="field_of_view"):
        aperture.direction_grid  # noqa: B018


@pytest.mark.parametrize("field", ["azimuth_rad", "elevation_rad"])
@pytest.mark.parametrize("invalid_value", [0.0, -0.1, 2.0, np.nan])
def test_rejects_invalid_field_of_view(field, invalid_value):
    with pytest.raises(dc.InvalidSetting, match=field):
        FieldOfView(**{field: invalid_value})


@pytest.mark.parametrize("n", [2, 5, 12])
@pytest.mark.parametrize("spacing", [0.51, 0.7, 1.0, 2.0])
def test_grating_lobes_repeat_at_wavelength_over_spacing(n, spacing):
    aperture = Aperture(make_positions(y=spacing * np.arange(n)))
    # Grating lobes are searched to a 256th of a grid step.
    assert smallest_grating_lobe_separation(aperture) == pytest.approx((1 / spacing, 0.0), abs=1e-3)
    (finding,) = grating_lobe_findings(aperture)
    limit_deg = np.degrees(np.arcsin(0.5 / spacing))
    assert finding.level == ("note" if limit_deg > 60 else "warning")
    assert f"-{limit_deg:.3g} and {limit_deg:.3g} deg" in finding.value
    narrow_aperture = Aperture(aperture.positions, FieldOfView(azimuth_rad=np.radians(limit_deg)))
    assert (
        smallest_grating_lobe_separation(narrow_aperture) is None
        and grating_lobe_findings(narrow_aperture) == []
    )


def test_grating_lobe_directions_have_similar_steering_vectors():
    aperture = Aperture(make_positions(y=[0, 0.8, 2.4, 3.2, 0.8], z=[0, 0, 0.5, 1.0, 1.5]))
    sine_y, sine_z = smallest_grating_lobe_separation(aperture)
    first, second = np.arcsin(np.array([[-sine_y, -sine_z], [sine_y, sine_z]]) / 2)
    correlation = (
        np.vdot(aperture.steering_vectors(first[0], 0.0), aperture.steering_vectors(second[0], 0.0))
        / 5
    )
    assert sine_z == 0 and abs(correlation) > 0.95


def test_half_wavelength_and_uneven_spacings_have_no_grating_lobes():
    assert smallest_grating_lobe_separation(Aperture(make_positions(y=WIDE))) is None
    assert (
        smallest_grating_lobe_separation(
            Aperture(make_positions(y=WIDE[:, None], z=WIDE[:4] * 2).reshape(-1, 3))
        )
        is None
    )
    assert (
        smallest_grating_lobe_separation(
            Aperture(make_positions(y=[0, 0.7, 1.9, 3.6, 5.1, 7.9, 8.3]))
        )
        is None
    )

"""What an array tells of directions, before any estimator."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.angle.aperture import Aperture, FieldOfView, radar_aperture
from dechirp.processing.angle.grating_lobes import grating_lobe_findings, grating_lobe_separation
from dechirp.radar.calibration import Calibration

WIDE = np.arange(8) * 0.5


def along(*, y=0.0, z=0.0, x=0.0):
    return np.stack(np.broadcast_arrays(x, y, z), axis=-1).astype(float)


def with_array(radar, tx_m, rx_m):
    multiplexing = dc.multiplexing.Tdm(order=tuple(range(len(tx_m)))) if len(tx_m) > 1 else None
    frame = replace(radar.frame, multiplexing=multiplexing)
    return replace(radar, frame=frame, array=dc.Array(tx_m=tx_m, rx_m=rx_m))


def test_steering_is_the_phase_of_the_way_to_a_far_target(radar):
    wavelength_m = 299_792_458.0 / radar.frame.chirp.mean_sampled_frequency_hz
    tx_m = np.array([(0, 0, 0), (0.001, 0.008, -0.002)])
    rx_m = np.array([(0, 0, 0), (0, 0.002, 0), (0, 0.001, 0.003)])
    seen = radar_aperture(with_array(radar, tx_m, rx_m))
    # Far enough that the front is flat to 1e-9 of a turn over 8 mm: d^2 / R lambda.
    at_m = 1e7 * np.array([np.cos(0.4) * np.cos(0.3), np.cos(0.4) * np.sin(0.3), np.sin(0.4)])
    ways = [np.linalg.norm(at_m - t) + np.linalg.norm(at_m - r) - 2e7 for t in tx_m for r in rx_m]
    # Phases of Tx x conj(Rx) grow with the way. A way of 1e7 m is known to 4e-9 m.
    expected = np.exp(2j * np.pi * np.array(ways) / wavelength_m)
    assert seen.steering_vectors(0.3, 0.4) == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize(
    ("positions", "tells"),
    [
        (along(y=WIDE), (True, False)),
        (along(z=WIDE), (False, True)),
        (along(y=WIDE, z=0.3 * WIDE), (True, False)),
        (along(y=0.3 * WIDE, z=WIDE), (False, True)),
        (along(y=WIDE, z=[0, 0, 0.5, 0, 0, 0, 0, 0]), (True, True)),
        # Errors of a twentieth of a wavelength make no second axis.
        (along(y=WIDE, z=[0, 0.05, 0, 0, 0.05, 0, 0, 0]), (True, False)),
    ],
)
def test_a_line_tells_one_angle_and_a_plane_both(positions, tells):
    seen = Aperture(positions)
    assert seen.resolves == tells
    shape = seen.grid.shape
    assert (shape[1] > 1, shape[0] > 1) == tells


@pytest.mark.parametrize(
    "positions", [along(y=[0.0]), along(y=[1.0, 1.0, 1.0]), along(x=WIDE)], ids=str
)
def test_elements_that_tell_no_direction_are_refused(positions):
    with pytest.raises(dc.InvalidSetting, match=r"Radar\.array") as error:
        Aperture(positions)
    assert "array.tx" in str(error.value)


def test_an_array_whose_geometry_is_not_known_is_refused(radar):
    with pytest.raises(dc.InvalidSetting, match=r"Radar\.array"):
        radar_aperture(replace(radar, array=dc.Array()))


def test_positions_that_are_no_numbers_are_refused():
    with pytest.raises(dc.InvalidSetting, match="positions"):
        Aperture(along(y=[0.0, np.nan]))


def test_calibrated_positions_are_used_where_there_are_any(radar):
    plain = with_array(radar, [(0, 0, 0), (0, 0.004, 0)], [(0, 0, 0), (0, 0.002, 0)])
    moved = Calibration(
        elements=((1, 0), (0, 1), (0, 0), (1, 1)),
        gain=((1.0, 0.0),) * 4,
        position_error_m=((0.0, 1e-4, 0.0), (0.0, 0.0, 2e-4), (0.0,) * 3, (0.0,) * 3),
    )
    wavelength_m = 299_792_458.0 / plain.frame.chirp.mean_sampled_frequency_hz
    difference = (
        radar_aperture(replace(plain, calibration=moved)).positions
        - radar_aperture(plain).positions
    )
    expected_m = np.zeros((4, 3))
    expected_m[2, 1], expected_m[1, 2] = 1e-4, 2e-4
    assert difference * wavelength_m == pytest.approx(expected_m, abs=1e-12)


@pytest.mark.parametrize("positions", [along(y=WIDE), along(y=WIDE[:, None], z=WIDE[:4])])
def test_no_direction_is_far_from_one_of_the_grid(positions):
    seen = Aperture(positions.reshape(-1, 3), FieldOfView(azimuth_rad=1.2, elevation_rad=0.5))
    rng = np.random.default_rng(72)
    # At the edges the last direction of the grid may be a whole step away.
    azimuth, elevation = rng.uniform(-1.1, 1.1, 500), rng.uniform(-0.4, 0.4, 500)
    elevation *= seen.resolves[1]
    away = seen.steering_vectors(azimuth, elevation).conj() @ seen.grid.steering.T / seen.n_elements
    loss_db = -20 * np.log10(np.abs(away).max(axis=1))
    # Half a step off: pi^2 / 3 (1 / 16)^2 of a beam's power, or of 1 / 8 on each of two axes.
    assert loss_db.max() < (0.06 if sum(seen.resolves) == 1 else 0.5)
    assert np.any(seen.grid.azimuth_rad == 0) and np.any(seen.grid.elevation_rad == 0)
    assert abs(seen.grid.azimuth_rad).max() <= 1.2 and abs(seen.grid.elevation_rad).max() <= 0.5


def test_a_grid_that_would_take_all_memory_is_refused():
    rng = np.random.default_rng(73)
    huge = Aperture(rng.uniform(0, 200, (300, 3)) * [0, 1, 1])
    with pytest.raises(dc.InvalidSetting, match="field_of_view"):
        huge.grid  # noqa: B018


@pytest.mark.parametrize("field", ["azimuth_rad", "elevation_rad"])
@pytest.mark.parametrize("wrong", [0.0, -0.1, 2.0, np.nan])
def test_a_field_of_view_beyond_the_sides_is_refused(field, wrong):
    with pytest.raises(dc.InvalidSetting, match=field):
        FieldOfView(**{field: wrong})


@pytest.mark.parametrize("n", [2, 5, 12])
@pytest.mark.parametrize("apart", [0.51, 0.7, 1.0, 2.0])
def test_a_line_of_wide_steps_repeats_by_the_wavelength_over_the_step(n, apart):
    seen = Aperture(along(y=apart * np.arange(n)))
    # Lobes are searched to a 256th of a grid step.
    assert grating_lobe_separation(seen) == pytest.approx((1 / apart, 0.0), abs=1e-3)
    (finding,) = grating_lobe_findings(seen)
    within = np.degrees(np.arcsin(0.5 / apart))
    assert finding.level == ("note" if within > 60 else "warning")
    assert f"-{within:.3g} and {within:.3g} deg" in finding.value
    narrow = Aperture(seen.positions, FieldOfView(azimuth_rad=np.radians(within)))
    assert grating_lobe_separation(narrow) is None and grating_lobe_findings(narrow) == []


def test_two_directions_that_are_said_to_repeat_look_the_same():
    seen = Aperture(along(y=[0, 0.8, 2.4, 3.2, 0.8], z=[0, 0, 0.5, 1.0, 1.5]))
    left, up = grating_lobe_separation(seen)
    one, other = np.arcsin(np.array([[-left, -up], [left, up]]) / 2)
    alike = np.vdot(seen.steering_vectors(one[0], 0.0), seen.steering_vectors(other[0], 0.0)) / 5
    assert up == 0 and abs(alike) > 0.95


def test_steps_of_half_a_wavelength_and_uneven_ones_do_not_repeat():
    assert grating_lobe_separation(Aperture(along(y=WIDE))) is None
    assert (
        grating_lobe_separation(Aperture(along(y=WIDE[:, None], z=WIDE[:4] * 2).reshape(-1, 3)))
        is None
    )
    assert grating_lobe_separation(Aperture(along(y=[0, 0.7, 1.9, 3.6, 5.1, 7.9, 8.3]))) is None

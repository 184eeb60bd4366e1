"""Vertical velocity of the radar from static detections with measured elevations."""

import re

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.core.table_columns import dataset_to_columns
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.report.objects_section import describe_ego_clusters_and_tracks
from dechirp.tracking.doppler_fit import Sightings, fit_radar_velocity
from dechirp.tracking.ego import EgoMotion, ego_motion, label_static_and_moving
from nightly import nightly

SETTINGS = EgoMotion(with_vertical=True)


def directions(azimuth, elevation):
    return np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ],
        axis=-1,
    )


def draw_detections(rng, velocity, n, n_moving, angle_std=0.0, velocity_std=1e-6):
    azimuth, elevation = rng.uniform(-0.7, 0.7, n), rng.uniform(-0.5, 0.5, n)
    radial = -directions(azimuth, elevation) @ velocity
    radial[:n_moving] += rng.uniform(2, 20, n_moving)
    columns = {
        "frame": np.zeros(n),
        "time": np.zeros(n),
        "range": rng.uniform(20, 80, n),
        "velocity": radial + velocity_std * rng.standard_normal(n),
        "azimuth": azimuth + angle_std * rng.standard_normal(n),
        "elevation": elevation + angle_std * rng.standard_normal(n),
        "velocity_std": np.full(n, velocity_std),
        "azimuth_std": np.full(n, max(angle_std, 1e-7)),
        "elevation_std": np.full(n, max(angle_std, 1e-7)),
    }
    return xr.Dataset({name: ("detection", column) for name, column in columns.items()})


@pytest.mark.parametrize("velocity", [(9.0, 1.0, -3.0), (0.0, 0.0, 5.0), (15.0, -2.0, 0.0)])
def test_three_components_follow_the_majority(velocity):
    rng = np.random.default_rng(1)
    rows = draw_detections(rng, np.array(velocity), 50, 15)
    ego = ego_motion(rows, None, SETTINGS)
    assert ego.n_static.item() == 35
    assert [ego.vx.item(), ego.vy.item(), ego.vz.item()] == pytest.approx(velocity, abs=1e-4)
    labels = label_static_and_moving(rows, ego, None, SETTINGS).motion.values
    assert labels.tolist() == ["moving"] * 15 + ["static"] * 35


@nightly
def test_covariance_of_three_components_is_correct():
    """The mean of e' C^-1 e over 3 is 1: standard error 0.029 in 800 trials, 5 of them allowed.

    The estimated model error is never negative, which lowers it to 0.9 to 0.95.
    """
    rng = np.random.default_rng(2)
    truth, n, squares = np.array([20.0, 1.0, -4.0]), 40, []
    for _ in range(800):
        azimuth, elevation = rng.uniform(-0.6, 0.6, n), rng.uniform(-0.5, 0.5, n)
        radial = -directions(azimuth, elevation) @ truth
        sightings = Sightings(
            velocity_m_per_s=radial + 0.03 * rng.standard_normal(n),
            azimuth_rad=azimuth + 0.005 * rng.standard_normal(n),
            elevation_rad=elevation + 0.01 * rng.standard_normal(n),
            velocity_std=np.full(n, 0.03),
            azimuth_std=np.full(n, 0.005),
            elevation_std=np.full(n, 0.01),
            period_m_per_s=np.full(n, 1e9),
        )
        fit = fit_radar_velocity(sightings, truth)
        error = fit.velocity - truth
        squares.append(error @ np.linalg.solve(fit.covariance, error) / 3)
    assert 0.75 < np.mean(squares) < 1.15


def test_climbing_radar_is_biased_only_without_the_vertical_component():
    rng = np.random.default_rng(3)
    rows = draw_detections(rng, np.array([10.0, 0.0, 4.0]), 60, 0, 0.005, 0.03)
    level, climbing = (ego_motion(rows, None, setting) for setting in (EgoMotion(), SETTINGS))
    assert abs(climbing.vz.item() - 4.0) < 6 * climbing.vz_std.item() < 0.5
    assert abs(climbing.vx.item() - 10.0) < 6 * climbing.vx_std.item()
    assert level.n_static.item() < climbing.n_static.item()
    assert "vz" not in level
    assert dataset_to_columns(climbing)["vz_m_per_s"] == [climbing.vz.item()]
    assert "vz_m_per_s" not in dataset_to_columns(level)


def test_elevations_in_one_plane_leave_the_motion_unknown():
    rng = np.random.default_rng(4)
    rows = draw_detections(rng, np.array([10.0, 0.0, 0.0]), 30, 0)
    flat = rows.assign(elevation=("detection", np.zeros(30)))
    assert np.isnan(ego_motion(flat, None, SETTINGS).vz.item())
    unmeasured = rows.assign(elevation=("detection", np.full(30, np.nan)))
    assert np.isnan(ego_motion(unmeasured, None, SETTINGS).vx.item())
    with pytest.raises(dc.InvalidSetting, match="with_vertical"):
        EgoMotion(with_vertical="yes")


@nightly
def test_samples_of_a_planar_array_give_the_three_components():
    """Errors are at most 5 of the stated standard errors; a normal one exceeds them in 6e-7."""
    half_m, rng = 1.95e-3, np.random.default_rng(5)
    chirp = dc.Chirp(
        start_frequency_hz=76.5e9,
        slope_hz_per_s=20e12,
        adc_start_s=2e-6,
        ramp_duration_s=15e-6,
        sample_rate_hz=20e6,
        n_samples=256,
        sampling="complex",
    )
    frame = dc.Frame(
        chirp=chirp, n_chirps=64, interval_s=18e-6, period_s=0.05, multiplexing=Tdm(order=(0, 1, 2))
    )
    array = dc.Array(
        tx_m=[(0, 0, 0), (0, 2 * half_m, 2 * half_m), (0, 4 * half_m, 0)],
        rx_m=[(0, k * half_m, 0) for k in range(4)],
    )
    hardware = dc.Hardware(transmit_power_w=0.02, antenna_gain=16.0, noise_factor=16.0)
    velocity = np.array([8.0, -0.5, -1.2])
    places_m = rng.uniform(8, 40, 20)[:, None] * directions(
        rng.uniform(-0.6, 0.6, 20), rng.uniform(-0.25, 0.25, 20)
    )
    targets = [
        dc.Target(position_m=tuple(place), velocity_m_per_s=tuple(-velocity), rcs_m2=10.0)
        for place in places_m.tolist()
    ]
    result = dc.run(
        dc.Scenario(
            radar=dc.Radar(frame=frame, array=array, hardware=hardware),
            scene=dc.Scene(targets=targets),
            n_frames=2,
            seed=3,
            ego_motion=SETTINGS,
        )
    )
    for name, true_value in zip(("vx", "vy", "vz"), velocity, strict=True):
        errors = result.ego[name].values - true_value
        assert (abs(errors) < 5 * result.ego[f"{name}_std"].values).all(), name
    assert result.ego.vz_std.max() < 0.5
    (sentence, *_) = describe_ego_clusters_and_tracks(result)
    assert re.search(r"to the left and \S1\.2\d+ m/s upwards, estimated", sentence)

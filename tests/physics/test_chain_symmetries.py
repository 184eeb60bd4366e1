"""Symmetries of the processing chain: mirroring, rotation, reciprocity and sign conventions."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

import dechirp as dc
from dechirp.processing.cluster import cluster
from dechirp.processing.spectrum import Transform, mean_range_doppler_power
from dechirp.radar.array import Array
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.scene.rotations import rotation_about_z
from small_radars import WINDOWS, scene_strategy, simulate_echoes, small_chain, small_radar

pytestmark = pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
EPS = float(np.finfo(np.float32).eps)
few_examples = settings(max_examples=8)
seeds = st.integers(0, 2**32 - 1)


@few_examples
@given(seeds, st.sampled_from(WINDOWS), st.sampled_from([96, 97]))
def test_conjugate_samples_mirror_range_and_velocity(seed, window, n_bins):
    samples = np.random.default_rng(seed).standard_normal((32, 2, 96, 2)) @ (1, 1j)
    samples = samples.astype(np.complex64)
    fast = Transform(window=window, n_points=96, n_bins=n_bins)
    slow = Transform(window=window, n_points=32, n_bins=32)
    original, conjugated = (
        mean_range_doppler_power(cube, "complex", fast, slow) for cube in (samples, samples.conj())
    )
    # Zero velocity is row 16 and zero range column 0; mirroring exchanges -k and k.
    mirrored = original[np.ix_(-np.arange(32), -np.arange(n_bins))]
    assert abs(conjugated - mirrored).max() < 20 * EPS * original.max()


@few_examples
@given(seeds, st.sampled_from(WINDOWS))
def test_map_of_real_samples_is_symmetric_half_of_complex_map(seed, window):
    """Compare with the full spectrum, whose halves are conjugate mirror images."""
    samples = np.random.default_rng(seed).standard_normal((32, 2, 96)).astype(np.float32)
    fast, slow = (Transform(window=window, n_points=n, n_bins=n) for n in (96, 32))
    real_map = mean_range_doppler_power(samples, "real", fast, slow)
    complex_map = mean_range_doppler_power(samples.astype(np.complex64), "complex", fast, slow)
    assert abs(real_map - 2 * complex_map[:, :49]).max() < 20 * EPS * real_map.max()
    mirrored = complex_map[-np.arange(32)][:, -np.arange(49)]
    assert abs(real_map - 2 * mirrored).max() < 20 * EPS * real_map.max()


def mirror_y(position):
    return (position[0], -position[1], position[2])


@few_examples
@given(scene_strategy(), seeds)
def test_mirrored_scene_and_radar_reproduce_samples(radar_and_scene, seed):
    radar, scene = radar_and_scene
    mirrored_radar = replace(
        radar,
        array=Array(
            tx_m=[mirror_y(position) for position in radar.array.tx_m],
            rx_m=[mirror_y(position) for position in radar.array.rx_m],
        ),
    )
    mirrored_scene = dc.Scene(
        targets=[
            replace(
                target,
                position_m=mirror_y(target.position_m),
                velocity_m_per_s=mirror_y(target.velocity_m_per_s),
            )
            for target in scene.targets
        ]
    )
    cube = dc.simulate(scene, radar, seed=seed)
    np.testing.assert_array_equal(
        dc.simulate(mirrored_scene, mirrored_radar, seed=seed).values, cube.values
    )
    detections, mirrored_detections = (
        dc.detect(cube, radar, small_chain()),
        dc.detect(cube, mirrored_radar, small_chain()),
    )
    assert mirrored_detections.sizes == detections.sizes
    for name in ("range", "velocity", "snr", "azimuth_std"):
        np.testing.assert_allclose(mirrored_detections[name], detections[name], rtol=1e-9)
    np.testing.assert_allclose(mirrored_detections.azimuth, -detections.azimuth, atol=1e-9)


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_receding_velocity_and_left_azimuth_are_positive(sampling):
    radar = small_radar(sampling)
    for speed in (-6.0, 6.0):
        for azimuth_rad in (-0.4, 0.4):
            direction = np.array([np.cos(azimuth_rad), np.sin(azimuth_rad), 0])
            target = dc.Target(
                position_m=tuple(20 * direction),
                velocity_m_per_s=tuple(speed * direction),
                rcs_m2=30,
            )
            cube = dc.simulate(dc.Scene(targets=[target]), radar, seed=2)
            [velocity], [azimuth] = (
                dc.detect(cube, radar, small_chain())[n] for n in ("velocity", "azimuth")
            )
            assert np.sign(velocity) == np.sign(speed) and np.sign(azimuth) == np.sign(azimuth_rad)


@few_examples
@given(scene_strategy(), seeds, st.permutations(range(3)))
def test_receiver_order_does_not_change_detections(radar_and_scene, seed, order):
    radar, scene = radar_and_scene
    array = replace(radar.array, rx_m=[radar.array.rx_m[k] for k in order])
    permuted_radar = replace(radar, array=array)
    cube = dc.simulate(scene, radar, seed=seed)
    permuted_cube = cube.isel(rx=list(order))
    np.testing.assert_allclose(
        simulate_echoes(scene, permuted_radar),
        simulate_echoes(scene, radar)[:, :, list(order)],
        rtol=1e-9,
    )
    maps = [
        dc.power_map(c.isel(frame=0), r, small_chain())
        for c, r in ((cube, radar), (permuted_cube, permuted_radar))
    ]
    assert float(abs(maps[1] - maps[0]).max()) < 4 * EPS * float(maps[0].max())
    detections, permuted_detections = (
        dc.detect(cube, radar, small_chain()),
        dc.detect(permuted_cube, permuted_radar, small_chain()),
    )
    assert permuted_detections.sizes == detections.sizes
    for name in ("range", "velocity", "azimuth", "snr"):
        np.testing.assert_allclose(
            permuted_detections[name], detections[name], rtol=1e-5, atol=1e-6
        )


@few_examples
@given(scene_strategy(), st.floats(-pi, pi), st.tuples(*[st.floats(-100, 100)] * 3))
def test_echoes_are_invariant_to_common_rotation_and_translation(radar_and_scene, yaw, offset_m):
    radar, scene = radar_and_scene
    rotation = rotation_about_z(np.array(yaw))

    def transform(position):
        return tuple(rotation @ np.array(position) + offset_m)

    transformed_scene = dc.Scene(
        targets=[
            replace(
                target,
                position_m=transform(target.position_m),
                velocity_m_per_s=tuple(rotation @ np.array(target.velocity_m_per_s)),
            )
            for target in scene.targets
        ],
        ego=dc.Ego(position_m=offset_m, yaw_rad=yaw),
    )
    expected = simulate_echoes(scene, radar)
    # Positions at 200 m are rounded to 3e-14 m, 1e-10 cycles.
    np.testing.assert_allclose(
        simulate_echoes(transformed_scene, radar), expected, rtol=0, atol=1e-8 * abs(expected).max()
    )


@few_examples
@given(scene_strategy())
def test_exchanged_transmitters_and_receivers_are_reciprocal(radar_and_scene):
    """Exchange transmitters and receivers: each pair receives the same samples."""
    _, scene = radar_and_scene
    static_scene = dc.Scene(targets=[replace(t, velocity_m_per_s=(0, 0, 0)) for t in scene.targets])
    radar = small_radar(code=Tdm(order=(0, 1)), n_rx=3, n_chirps=2)
    array = Array(tx_m=radar.array.rx_m, rx_m=radar.array.tx_m)
    exchanged_radar = replace(
        radar, array=array, frame=replace(radar.frame, multiplexing=Tdm(order=(0, 1, 2)))
    )
    original, exchanged = (
        simulate_echoes(static_scene, radar)[0, :2],
        simulate_echoes(static_scene, exchanged_radar)[0, :3],
    )
    np.testing.assert_allclose(
        exchanged, original.transpose(1, 0, 2), rtol=0, atol=1e-10 * abs(original).max()
    )


@few_examples
@given(seeds)
def test_mirrored_detections_form_mirrored_clusters(seed):
    rng = np.random.default_rng(seed)
    radar, n = small_radar(), 40
    columns = {
        "frame": np.zeros(n, int),
        "time": np.zeros(n),
        "range": rng.uniform(5, 60, n),
        "velocity": rng.uniform(-8, 8, n),
        "azimuth": rng.uniform(-0.8, 0.8, n),
        "elevation": np.full(n, np.nan),
        "snr": rng.uniform(20, 2000, n),
        "ambiguity_number": np.zeros(n),
        **{
            f"{name}_std": np.full(n, 0.01)
            for name in ("range", "velocity", "azimuth", "elevation")
        },
    }
    rows = xr.Dataset({name: ("detection", column) for name, column in columns.items()})
    (marked, clusters), (mirrored_marked, mirrored_clusters) = (
        cluster(column, radar) for column in (rows, rows.assign(azimuth=-rows.azimuth))
    )
    np.testing.assert_array_equal(mirrored_marked.cluster, marked.cluster)
    for name in ("range", "velocity", "snr"):
        np.testing.assert_allclose(mirrored_clusters[name], clusters[name], rtol=1e-12)
    np.testing.assert_allclose(mirrored_clusters.azimuth, -clusters.azimuth, atol=1e-12)

"""Symmetries of the whole chain: mirrors, turns, exchanges, and the signs that they rest on."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

import dechirp as dc
from dechirp.processing.cluster import cluster
from dechirp.processing.spectrum import Transform, mean_power
from dechirp.radar.array import Array
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.scene.rotations import rotation_about_z
from small_radars import WINDOWS, chain, echoes, scenes, small

pytestmark = pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
EPS = float(np.finfo(np.float32).eps)
few = settings(max_examples=8)
seeds = st.integers(0, 2**32 - 1)


@few
@given(seeds, st.sampled_from(WINDOWS), st.sampled_from([96, 97]))
def test_the_conjugate_of_samples_mirrors_range_and_velocity(seed, window, n_bins):
    samples = np.random.default_rng(seed).standard_normal((32, 2, 96, 2)) @ (1, 1j)
    samples = samples.astype(np.complex64)
    fast = Transform(window=window, n_points=96, n_bins=n_bins)
    slow = Transform(window=window, n_points=32, n_bins=32)
    here, there = (mean_power(one, "complex", fast, slow) for one in (samples, samples.conj()))
    # Zero velocity is row 16, zero range column 0; -k and k change places.
    mirrored = here[np.ix_(-np.arange(32), -np.arange(n_bins))]
    assert abs(there - mirrored).max() < 20 * EPS * here.max()


@few
@given(seeds, st.sampled_from(WINDOWS))
def test_real_samples_have_the_map_of_both_their_mirrored_halves(seed, window):
    """A real spectrum is its own conjugate mirror: the half that is kept tells the other."""
    samples = np.random.default_rng(seed).standard_normal((32, 2, 96)).astype(np.float32)
    fast, slow = (Transform(window=window, n_points=n, n_bins=n) for n in (96, 32))
    half = mean_power(samples, "real", fast, slow)
    whole = mean_power(samples.astype(np.complex64), "complex", fast, slow)
    assert abs(half - 2 * whole[:, :49]).max() < 20 * EPS * half.max()
    mirrored = whole[-np.arange(32)][:, -np.arange(49)]
    assert abs(half - 2 * mirrored).max() < 20 * EPS * half.max()


def mirrored(at):
    return (at[0], -at[1], at[2])


@few
@given(scenes(), seeds)
def test_a_mirrored_scene_before_a_mirrored_radar_gives_the_same_bits(seen, seed):
    radar, scene = seen
    other = replace(
        radar,
        array=Array(
            tx_m=[mirrored(at) for at in radar.array.tx_m],
            rx_m=[mirrored(at) for at in radar.array.rx_m],
        ),
    )
    turned = dc.Scene(
        targets=[
            replace(
                one,
                position_m=mirrored(one.position_m),
                velocity_m_per_s=mirrored(one.velocity_m_per_s),
            )
            for one in scene.targets
        ]
    )
    cube = dc.simulate(scene, radar, seed=seed)
    np.testing.assert_array_equal(dc.simulate(turned, other, seed=seed).values, cube.values)
    here, there = dc.detect(cube, radar, chain()), dc.detect(cube, other, chain())
    assert there.sizes == here.sizes
    for name in ("range", "velocity", "snr", "azimuth_std"):
        np.testing.assert_allclose(there[name], here[name], rtol=1e-9)
    np.testing.assert_allclose(there.azimuth, -here.azimuth, atol=1e-9)


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_receding_is_positive_and_so_is_the_left(sampling):
    radar = small(sampling)
    for speed in (-6.0, 6.0):
        for left in (-0.4, 0.4):
            away = np.array([np.cos(left), np.sin(left), 0])
            target = dc.Target(
                position_m=tuple(20 * away), velocity_m_per_s=tuple(speed * away), rcs_m2=30
            )
            cube = dc.simulate(dc.Scene(targets=[target]), radar, seed=2)
            [velocity], [azimuth] = (
                dc.detect(cube, radar, chain())[n] for n in ("velocity", "azimuth")
            )
            assert np.sign(velocity) == np.sign(speed) and np.sign(azimuth) == np.sign(left)


@few
@given(scenes(), seeds, st.permutations(range(3)))
def test_receivers_may_be_listed_in_any_order(seen, seed, order):
    radar, scene = seen
    array = replace(radar.array, rx_m=[radar.array.rx_m[k] for k in order])
    other = replace(radar, array=array)
    cube = dc.simulate(scene, radar, seed=seed)
    listed = cube.isel(rx=list(order))
    np.testing.assert_allclose(
        echoes(scene, other), echoes(scene, radar)[:, :, list(order)], rtol=1e-9
    )
    maps = [dc.power_map(c.isel(frame=0), r, chain()) for c, r in ((cube, radar), (listed, other))]
    assert float(abs(maps[1] - maps[0]).max()) < 4 * EPS * float(maps[0].max())
    here, there = dc.detect(cube, radar, chain()), dc.detect(listed, other, chain())
    assert there.sizes == here.sizes
    for name in ("range", "velocity", "azimuth", "snr"):
        np.testing.assert_allclose(there[name], here[name], rtol=1e-5, atol=1e-6)


@few
@given(scenes(), st.floats(-pi, pi), st.tuples(*[st.floats(-100, 100)] * 3))
def test_nothing_changes_when_radar_and_scene_are_turned_and_moved_together(seen, yaw, moved):
    radar, scene = seen
    turn = rotation_about_z(np.array(yaw))

    def carried(at):
        return tuple(turn @ np.array(at) + moved)

    together = dc.Scene(
        targets=[
            replace(
                one,
                position_m=carried(one.position_m),
                velocity_m_per_s=tuple(turn @ np.array(one.velocity_m_per_s)),
            )
            for one in scene.targets
        ],
        ego=dc.Ego(position_m=moved, yaw_rad=yaw),
    )
    expected = echoes(scene, radar)
    # 200 m are rounded to 3e-14 m, 1e-10 of a turn.
    np.testing.assert_allclose(
        echoes(together, radar), expected, rtol=0, atol=1e-8 * abs(expected).max()
    )


@few
@given(scenes())
def test_what_transmits_may_receive(seen):
    """Reciprocity: with transmitters and receivers exchanged, each pair hears the same."""
    _, scene = seen
    still = dc.Scene(targets=[replace(t, velocity_m_per_s=(0, 0, 0)) for t in scene.targets])
    one = small(code=Tdm(order=(0, 1)), n_rx=3, n_chirps=2)
    array = Array(tx_m=one.array.rx_m, rx_m=one.array.tx_m)
    other = replace(one, array=array, frame=replace(one.frame, multiplexing=Tdm(order=(0, 1, 2))))
    here, there = echoes(still, one)[0, :2], echoes(still, other)[0, :3]
    np.testing.assert_allclose(there, here.transpose(1, 0, 2), rtol=0, atol=1e-10 * abs(here).max())


@few
@given(seeds)
def test_clusters_are_the_same_in_the_mirror(seed):
    rng = np.random.default_rng(seed)
    radar, n = small(), 40
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
    rows = xr.Dataset({name: ("detection", one) for name, one in columns.items()})
    (of_each, here), (in_mirror, there) = (
        cluster(one, radar) for one in (rows, rows.assign(azimuth=-rows.azimuth))
    )
    np.testing.assert_array_equal(in_mirror.cluster, of_each.cluster)
    for name in ("range", "velocity", "snr"):
        np.testing.assert_allclose(there[name], here[name], rtol=1e-12)
    np.testing.assert_allclose(there.azimuth, -here.azimuth, atol=1e-12)

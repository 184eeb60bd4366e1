"""Clustering of detections with DBSCAN in resolution cells and aliased velocity."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
import xarray as xr

import dechirp as dc
from dechirp.evaluation.association import associate_detections
from dechirp.processing.cluster import Dbscan, Reach, cluster
from dechirp.radar.resolution_cells import alias_doppler_cells, to_resolution_cells
from dechirp.radar.velocity_ambiguity import (
    range_shift_per_ambiguity_m,
    unambiguous_velocity_span_m_per_s,
)
from dechirp.scene.bodies.vehicle import Car
from nightly import nightly_except

COLUMNS = ("range", "velocity", "azimuth", "elevation", "snr", "ambiguity_number")
STANDARD_ERRORS = ("range_std", "velocity_std", "azimuth_std", "elevation_std")
NAN = float("nan")


def make_detections(frame=0, **columns) -> xr.Dataset:
    """Return detections; defaults are NaN, 20 dB, and errors of 1 cm, 1 cm/s and 0.01 rad."""
    defaults = dict.fromkeys(COLUMNS, NAN) | dict.fromkeys(STANDARD_ERRORS, 0.01) | {"snr": 100.0}
    columns_with_defaults = defaults | {"frame": frame, "time": 0.1 * np.asarray(frame)} | columns
    arrays = np.broadcast_arrays(*columns_with_defaults.values())
    return xr.Dataset(
        {
            name: ("detection", column.copy())
            for name, column in zip(columns_with_defaults, arrays, strict=True)
        }
    )


def cell_distances(a, b, radar):
    """Compute the distance of two rows on each axis in resolution cells, from first principles."""
    chirp, frame = radar.frame.chirp, radar.frame
    wavelength_m = 299_792_458.0 / chirp.mean_sampled_frequency_hz
    cell_m = 299_792_458.0 / (2 * chirp.slope_hz_per_s * chirp.n_samples / chirp.sample_rate_hz)
    # The beat frequency of a receding target is higher by its Doppler frequency.
    coupling_s = chirp.mean_sampled_frequency_hz / chirp.slope_hz_per_s
    range_cells = (a.range - b.range + coupling_s * (a.velocity - b.velocity)) / cell_m
    span = wavelength_m / (2 * frame.repetition_s)
    velocity_difference = (a.velocity - b.velocity + span / 2) % span - span / 2
    length = np.ptp(radar.array.virtual_positions_m[:, 1]) / wavelength_m
    sines = np.sin(a.azimuth) - np.sin(b.azimuth)
    return (
        abs(range_cells),
        abs(velocity_difference) / (span / frame.n_chirps),
        abs(sines) * length,
        min(a.range, b.range) * abs(a.azimuth - b.azimuth),
    )


def cluster_by_brute_force(rows, radar, dbscan):
    """Return the sets of core rows of each cluster, the core mask, and the rows that are noise."""
    n = rows.sizes["detection"]
    columns = ("range", "velocity", "azimuth", "frame")
    detections = [SimpleNamespace(**{c: float(rows[c][i]) for c in columns}) for i in range(n)]
    limits = dbscan.reach
    reach = (limits.range, limits.velocity, limits.direction, limits.across_m or np.inf)
    is_near = np.array(
        [
            [
                a.frame == b.frame
                and not any(d > m for d, m in zip(cell_distances(a, b, radar), reach, strict=True))
                for b in detections
            ]
            for a in detections
        ]
    )
    is_core = is_near.sum(axis=1) >= dbscan.min_detections
    reached = is_near & is_core[:, None] & is_core
    for _ in range(n):
        reached = reached | (reached @ reached)
    sets = {frozenset(np.flatnonzero(reached[i]).tolist()) for i in np.flatnonzero(is_core)}
    noise = set(np.flatnonzero(~is_core & ~(is_near & is_core).any(axis=1)).tolist())
    return sets, is_core, noise


@pytest.mark.parametrize(
    ("min_detections", "across_m"), nightly_except(1, [(1, None), (3, None), (3, 2.0)])
)
@pytest.mark.parametrize("seed", nightly_except(1, range(5)))
def test_clusters_match_definition_of_dbscan(radar, min_detections, across_m, seed):
    rng = np.random.default_rng(seed)
    n = 120
    azimuth = np.where(rng.random(n) < 0.2, NAN, rng.uniform(-1.2, 1.2, n))
    top = radar.frame.max_velocity_m_per_s
    rows = make_detections(
        frame=np.sort(rng.integers(0, 2, n)),
        range=rng.uniform(5, 30, n),
        velocity=rng.uniform(-top, top, n),
        azimuth=azimuth,
    )
    reach = Reach(velocity=5.0, direction=0.3, across_m=across_m)
    dbscan = Dbscan(reach=reach, min_detections=min_detections)

    marked, clusters = cluster(rows, radar, dbscan)

    sets, core, noise = cluster_by_brute_force(rows, radar, dbscan)
    label = marked.cluster.values
    cluster_sets = {frozenset(np.flatnonzero((label == k) & core)) for k in range(label.max() + 1)}
    assert cluster_sets == sets
    assert set(np.flatnonzero(label == -1)) == noise
    assert clusters.sizes["cluster"] == len(sets) < n
    assert (noise == set()) == (min_detections == 1)


def test_vehicles_side_by_side_are_separate_within_a_beam(radar):
    # At 30 m, 3.5 m from middle to middle, within half a cell of the direction.
    azimuth = np.array([0.0, 3.5 / 30.0])
    rows = make_detections(range=np.full(2, 30.0), velocity=np.full(2, 3.0), azimuth=azimuth)
    aperture = np.ptp(radar.array.virtual_positions_m[:, 1]) / radar.frame.chirp.wavelength_m
    direction = 2 * np.sin(azimuth[1]) * aperture

    for across_m, n_clusters in ((None, 1), (3.6, 1), (3.4, 2)):
        reach = Reach(direction=direction, across_m=across_m)
        assert cluster(rows, radar, Dbscan(reach=reach))[1].sizes["cluster"] == n_clusters


def test_order_of_detections_does_not_change_clusters(radar):
    rng = np.random.default_rng(3)
    rows = make_detections(
        frame=np.repeat([4, 5], 40), range=rng.uniform(5, 30, 80), velocity=rng.uniform(-2, 2, 80)
    )
    order = rng.permutation(80)

    marked, clusters = cluster(rows, radar)
    permuted, permuted_clusters = cluster(rows.isel(detection=order), radar)

    pairs = set(zip(marked.cluster.values[order], permuted.cluster.values, strict=True))
    assert len(pairs) == clusters.sizes["cluster"] == permuted_clusters.sizes["cluster"]
    assert sorted(permuted_clusters.range.values) == pytest.approx(sorted(clusters.range.values))


def test_border_detection_joins_first_cluster(radar):
    reach_m = 5 * radar.frame.chirp.range_resolution_m
    near, far = [0.0] * 4 + [0.9], [2.7] + [3.6] * 4
    # The middle detection has one neighbour on each side: too few for a cluster, or to join both.
    rows = make_detections(range=20 + reach_m * np.array([1.8, *far, *near]), velocity=0.0)

    marked, _ = cluster(rows, radar, Dbscan(min_detections=4))

    assert marked.cluster.values.tolist() == [0] * 6 + [1] * 5


def test_noise_detections_are_labelled_minus_one(radar):
    rows = make_detections(range=[20, 20.3, 20.5, 60], velocity=[1, 1.1, 1, 1])
    marked, clusters = cluster(rows, radar, Dbscan(min_detections=2))

    assert marked.cluster.values.tolist() == [0, 0, 0, -1]
    assert clusters.n_detections.values.tolist() == [3]
    xr.testing.assert_identical(marked.drop_vars("cluster"), rows)


def test_clusters_wrap_around_at_velocity_limits(radar):
    top, margin = radar.frame.max_velocity_m_per_s, 0.1
    rows = make_detections(
        range=20.0, velocity=[top - margin, margin - top, margin - top], snr=[50.0, 25.0, 25.0]
    )
    marked, clusters = cluster(rows, radar)

    assert marked.cluster.values.tolist() == [0, 0, 0]
    assert abs(float(clusters.velocity[0])) == pytest.approx(top, abs=0.05)
    # The wavelength depends on the echo: 1 in 1,000 of the span.
    assert float(clusters.velocity_extent[0]) == pytest.approx(2 * margin, abs=2e-3 * top)


def test_ambiguous_cluster_velocity_stays_within_unambiguous_span(radar):
    top = radar.frame.max_velocity_m_per_s
    # The strongest velocity is below the limit, the mean above it: aliased to the lower limit.
    rows = make_detections(
        range=20.0, velocity=[top - 0.05, 0.4 - top, 0.4 - top], snr=[50.0, 49.0, 49.0]
    )
    _, clusters = cluster(rows, radar)

    assert clusters.sizes["cluster"] == 1
    mean = -top + (0.4 * 98 - 0.05 * 50) / 148
    assert float(clusters.velocity[0]) == pytest.approx(mean, abs=2e-3 * top)
    # One ambiguity more raises the velocity and lowers the range, here of the strongest only.
    shift_m = range_shift_per_ambiguity_m(radar.frame) * 50 / 148
    assert float(clusters.range[0]) == pytest.approx(20.0 + shift_m, abs=1e-6)


def test_cluster_takes_known_ambiguity_number_of_its_members(radar):
    radar = replace(
        radar,
        frame=replace(radar.frame, multiplexing=dc.multiplexing.Tdm(order=(0, 1))),
        array=replace(radar.array, tx_m=[(0, 0, 0), (0, 3.8e-3, 0)]),
    )
    frame = radar.frame
    span = float(unambiguous_velocity_span_m_per_s(np.array(20.0), frame))
    # Both share one map cell: one ambiguity higher, and nearer by the coupling.
    rows = make_detections(
        range=[20.0, 20.0 + range_shift_per_ambiguity_m(frame)],
        velocity=[5.0 + span, 5.0],
        ambiguity_number=[1.0, NAN],
        snr=[10.0, 1000.0],
    )
    marked, clusters = cluster(rows, radar)

    assert marked.cluster.values.tolist() == [0, 0]
    assert float(clusters.velocity[0]) == pytest.approx(5.0 + span, abs=1e-4)
    assert float(clusters.range[0]) == pytest.approx(20.0, abs=1e-6)
    assert float(clusters.ambiguity_number[0]) == 1

    # With both numbers known there are two targets; two transmitters distinguish two ambiguities,
    # and the third is aliased to the first.
    for ambiguity_numbers, n_clusters in (([1.0, 0.0], 2), ([2.0, 0.0], 1)):
        unambiguous_rows = make_detections(
            range=[20.0 - ambiguity_numbers[0] * range_shift_per_ambiguity_m(frame), 20.0],
            velocity=[5.0 + ambiguity_numbers[0] * span, 5.0],
            ambiguity_number=ambiguity_numbers,
        )
        assert cluster(unambiguous_rows, radar)[1].sizes["cluster"] == n_clusters


def test_each_frame_wraps_at_its_own_velocity_span(radar):
    radar = replace(radar, frame=replace(radar.frame, interval_s=[35e-6, 45e-6]))
    tops = [radar.for_frame(k).frame.max_velocity_m_per_s for k in (0, 1)]
    # Each frame has a pair at its own velocity limits, or a pair at those of the other frame.
    for span_frames, n_clusters in (((0, 1), 2), ((1, 0), 4)):
        velocity = [s * (tops[k] - 0.1) for k in span_frames for s in (1, -1)]
        rows = make_detections(frame=[0, 0, 1, 1], range=20.0, velocity=velocity)
        assert cluster(rows, radar)[1].sizes["cluster"] == n_clusters


def test_clusters_do_not_extend_over_frames(radar):
    rows = make_detections(frame=[7, 2, 7, 2], range=20.0, velocity=1.0)
    marked, clusters = cluster(rows, radar)

    assert sorted(clusters.frame.values) == [2, 7]
    assert (clusters.frame.values[marked.cluster.values] == rows.frame.values).all()
    assert clusters.time.values == pytest.approx(0.1 * clusters.frame.values)


def test_cluster_angle_averages_detections_with_known_angle(radar):
    rows = make_detections(
        range=20.0, velocity=1.0, azimuth=[0.1, NAN, 0.2], snr=[300.0, 1000.0, 100.0]
    )
    _, clusters = cluster(rows, radar)

    assert float(clusters.azimuth[0]) == pytest.approx((3 * 0.1 + 0.2) / 4)
    assert float(clusters.azimuth_extent[0]) == pytest.approx(0.1)
    assert np.isnan(clusters.elevation[0]) and np.isnan(clusters.elevation_std[0])
    assert clusters.snr.item() == 1400


def test_centroid_standard_errors_are_correct(radar):
    rng = np.random.default_rng(5)
    n_frames, n = 4000, 3
    frame = np.repeat(np.arange(n_frames), n)
    snr = rng.uniform(20, 2000, frame.size)
    errors = dict(
        zip(STANDARD_ERRORS[:3], np.array([[2.0], [1.0], [0.2]]) / np.sqrt(snr), strict=True)
    )
    truth = {"range": 30.0, "velocity": radar.frame.max_velocity_m_per_s - 0.05, "azimuth": 0.3}
    columns = {
        name: true_value + errors[f"{name}_std"] * rng.standard_normal(frame.size)
        for name, true_value in truth.items()
    }
    span = unambiguous_velocity_span_m_per_s(columns["range"], radar.frame)
    is_aliased = columns["velocity"] > span / 2
    columns["velocity"] -= span * is_aliased
    columns["range"] += range_shift_per_ambiguity_m(radar.frame) * is_aliased

    _, clusters = cluster(make_detections(frame=frame, snr=snr, **columns, **errors), radar)

    complete_clusters = clusters.isel(cluster=clusters.n_detections.values == n)
    assert complete_clusters.sizes["cluster"] > 0.99 * n_frames
    top = float(unambiguous_velocity_span_m_per_s(np.array(30.0), radar.frame)) / 2
    for name, true_value in truth.items():
        error = complete_clusters[name].values - true_value
        if name == "velocity":
            error = (error + top) % (2 * top) - top
        if name == "range":
            error -= range_shift_per_ambiguity_m(radar.frame) * (
                complete_clusters.velocity.values < 0
            )
        normalised_square = np.mean((error / complete_clusters[f"{name}_std"].values) ** 2)
        # Five standard deviations of a mean of 4,000 squares; SNR weights are optimal.
        assert normalised_square == pytest.approx(1, abs=5 * np.sqrt(2 / n_frames))
        weights = 1 / errors[f"{name}_std"].reshape(n_frames, n) ** 2
        assert complete_clusters[f"{name}_std"].values.mean() == pytest.approx(
            np.mean(weights.sum(axis=1) ** -0.5), rel=0.01
        )


def test_clusters_reduce_detections_without_mixing_cars(radar):
    chirp = replace(radar.frame.chirp, slope_hz_per_s=30e12, adc_start_s=2e-6)
    rx_m = [(0, 1.93e-3 * k, 0) for k in range(4)]
    radar = replace(
        radar, frame=replace(radar.frame, chirp=chirp), array=replace(radar.array, rx_m=rx_m)
    )
    positions_m = {"left": (15, 3, -0.5), "right": (15, -4, -0.5)}
    scene = dc.Scene(
        targets=[
            dc.Target(name=name, position_m=position_m, velocity_m_per_s=(v, 0, 0), body=Car())
            for (name, position_m), v in zip(positions_m.items(), (4.0, -6.0), strict=True)
        ]
    )
    detections = dc.detect(dc.simulate(scene, radar, seed=1), radar)
    target_index = associate_detections(detections, dc.truth(scene, radar), radar, scene).target

    marked, clusters = cluster(detections, radar)

    assert set(target_index) == {0, 1}
    for number in range(clusters.sizes["cluster"]):
        assert len(set(target_index[marked.cluster.values == number])) == 1
    assert clusters.sizes["cluster"] <= detections.sizes["detection"] / 2
    assert float(clusters.range_extent.max()) < Car().length_m


def test_no_detections_yield_no_clusters(radar):
    marked, clusters = cluster(make_detections(range=[20.0]).isel(detection=[]), radar)
    assert marked.sizes["detection"] == clusters.sizes["cluster"] == 0
    noise_clusters = cluster(VALID_DETECTIONS, radar, Dbscan(min_detections=2))[1]
    assert noise_clusters.sizes["cluster"] == 0 and set(noise_clusters) == set(clusters)
    assert "cluster" in marked and "velocity_extent" in clusters


def test_accepts_detections_without_snr_and_standard_errors(radar):
    rows = make_detections(range=[20.0, 20.2], velocity=1.0, snr=NAN)[
        ["frame", "range", "velocity", "snr"]
    ]
    clusters = cluster(rows, radar)[1]

    assert float(clusters.range[0]) == pytest.approx(20.1)
    assert np.isnan(clusters.range_std[0]) and np.isnan(clusters.snr[0])


def test_aliased_doppler_cell_stays_below_number_of_bins(radar):
    # -1e-18 % 128 is 128 in floating point, outside the map.
    cells = to_resolution_cells([20.0], [-1e-18], [NAN], [NAN], radar)
    assert 0 <= alias_doppler_cells(cells, 128)[0, 1] < 128


def test_rejects_pairs_larger_than_memory(radar, monkeypatch):
    crowd = make_detections(range=np.full(2000, 20.0), velocity=1.0)
    memory = SimpleNamespace(available=1e8)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: memory)
    with pytest.raises(dc.NotEnoughMemory, match="lower the reach"):
        cluster(crowd, radar)


@pytest.mark.parametrize(
    ("build", "setting"),
    [
        (lambda: Reach(range=0.0), "Reach.range"),
        (lambda: Reach(velocity=NAN), "Reach.velocity"),
        (lambda: Reach(direction=-1.0), "Reach.direction"),
        (lambda: Reach(range=1e9), "Reach.range"),
        (lambda: Reach(across_m=0.0), "Reach.across_m"),
        (lambda: Dbscan(reach=2.0), "Dbscan.reach"),
        (lambda: Dbscan(min_detections=0), "Dbscan.min_detections"),
        (lambda: Dbscan(min_detections=2.5), "Dbscan.min_detections"),
    ],
)
def test_rejects_invalid_settings(build, setting):
    with pytest.raises(dc.InvalidSetting) as error:
        build()
    assert error.value.mistakes[0].setting == setting


VALID_DETECTIONS = make_detections(range=[20.0, 30.0], velocity=1.0)


@pytest.mark.parametrize(
    ("rows", "setting"),
    [
        (VALID_DETECTIONS.drop_vars("range"), "detections"),
        (VALID_DETECTIONS["range"], "detections"),
        (VALID_DETECTIONS.assign(range=("detection", [20.0, np.inf])), "detections.range"),
        (VALID_DETECTIONS.assign(velocity=("detection", [-np.inf, 0.0])), "detections.velocity"),
        (VALID_DETECTIONS.assign(snr=("detection", [-1.0, 1.0])), "detections.snr"),
        (VALID_DETECTIONS.assign(frame=("detection", [0, -1])), "detections.frame"),
        (VALID_DETECTIONS.assign(frame=("detection", [0, 0.5])), "detections.frame"),
        (VALID_DETECTIONS.assign(azimuth=("detection", [np.inf, 0.0])), "detections.azimuth"),
        (VALID_DETECTIONS.assign(range=("detection", ["a", "b"])), "detections.range"),
    ],
)
def test_rejects_invalid_detections(radar, rows, setting):
    with pytest.raises(dc.InvalidSetting) as error:
        cluster(rows, radar)
    assert error.value.mistakes[0].setting == setting


def test_rejects_wrong_argument_types(radar):
    with pytest.raises(dc.InvalidSetting, match="radar: a Frame"):
        cluster(VALID_DETECTIONS, radar.frame)
    with pytest.raises(dc.InvalidSetting, match="dbscan: an int"):
        cluster(VALID_DETECTIONS, radar, 3)

"""Detections that lie close together are one cluster: where velocity goes round as well."""

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
from dechirp.radar.velocity_ambiguity import range_shift_m, unambiguous_span_m_per_s
from dechirp.scene.bodies.vehicle import Car

COLUMNS = ("range", "velocity", "azimuth", "elevation", "snr", "ambiguity_number")
ERRORS = ("range_std", "velocity_std", "azimuth_std", "elevation_std")
NAN = float("nan")


def table(frame=0, **columns) -> xr.Dataset:
    """Detections; what is not given is not told, or 20 dB, or 1 cm, 1 cm/s and 0.01 rad off."""
    usual = dict.fromkeys(COLUMNS, NAN) | dict.fromkeys(ERRORS, 0.01) | {"snr": 100.0}
    known = usual | {"frame": frame, "time": 0.1 * np.asarray(frame)} | columns
    arrays = np.broadcast_arrays(*known.values())
    return xr.Dataset(
        {name: ("detection", one.copy()) for name, one in zip(known, arrays, strict=True)}
    )


def apart(a, b, radar):
    """How far apart two rows are along each axis, in resolution cells, from first principles."""
    chirp, frame = radar.frame.chirp, radar.frame
    wavelength_m = 299_792_458.0 / chirp.mean_sampled_frequency_hz
    m_a_cell = 299_792_458.0 / (2 * chirp.slope_hz_per_s * chirp.n_samples / chirp.sample_rate_hz)
    # A receding target's beat is higher by its Doppler frequency.
    m_for_m_per_s = chirp.mean_sampled_frequency_hz / chirp.slope_hz_per_s
    range_cells = (a.range - b.range + m_for_m_per_s * (a.velocity - b.velocity)) / m_a_cell
    span = wavelength_m / (2 * frame.repetition_s)
    off = (a.velocity - b.velocity + span / 2) % span - span / 2
    length = np.ptp(radar.array.virtual_positions_m[:, 1]) / wavelength_m
    sines = np.sin(a.azimuth) - np.sin(b.azimuth)
    return abs(range_cells), abs(off) / (span / frame.n_chirps), abs(sines) * length


def brute_force(rows, radar, dbscan):
    """Sets of rows that DBSCAN makes clusters of without borders, and the rows that are noise."""
    n = rows.sizes["detection"]
    columns = ("range", "velocity", "azimuth", "frame")
    one = [SimpleNamespace(**{c: float(rows[c][i]) for c in columns}) for i in range(n)]
    most = (dbscan.reach.range, dbscan.reach.velocity, dbscan.reach.direction)
    near = np.array(
        [
            [
                a.frame == b.frame
                and not any(d > m for d, m in zip(apart(a, b, radar), most, strict=True))
                for b in one
            ]
            for a in one
        ]
    )
    core = near.sum(axis=1) >= dbscan.min_detections
    reached = near & core[:, None] & core
    for _ in range(n):
        reached = reached | (reached @ reached)
    sets = {frozenset(np.flatnonzero(reached[i]).tolist()) for i in np.flatnonzero(core)}
    noise = set(np.flatnonzero(~core & ~(near & core).any(axis=1)).tolist())
    return sets, core, noise


@pytest.mark.parametrize("min_detections", [1, 3])
@pytest.mark.parametrize("seed", range(5))
def test_clusters_are_those_of_the_definition(radar, min_detections, seed):
    rng = np.random.default_rng(seed)
    n = 120
    azimuth = np.where(rng.random(n) < 0.2, NAN, rng.uniform(-1.2, 1.2, n))
    top = radar.frame.max_velocity_m_per_s
    rows = table(
        frame=np.sort(rng.integers(0, 2, n)),
        range=rng.uniform(5, 30, n),
        velocity=rng.uniform(-top, top, n),
        azimuth=azimuth,
    )
    dbscan = Dbscan(reach=Reach(velocity=5.0, direction=0.3), min_detections=min_detections)

    marked, clusters = cluster(rows, radar, dbscan)

    sets, core, noise = brute_force(rows, radar, dbscan)
    label = marked.cluster.values
    found = {frozenset(np.flatnonzero((label == k) & core)) for k in range(label.max() + 1)}
    assert found == sets
    assert set(np.flatnonzero(label == -1)) == noise
    assert clusters.sizes["cluster"] == len(sets) < n
    assert (noise == set()) == (min_detections == 1)


def test_the_order_of_detections_makes_no_odds(radar):
    rng = np.random.default_rng(3)
    rows = table(
        frame=np.repeat([4, 5], 40), range=rng.uniform(5, 30, 80), velocity=rng.uniform(-2, 2, 80)
    )
    order = rng.permutation(80)

    marked, clusters = cluster(rows, radar)
    turned, again = cluster(rows.isel(detection=order), radar)

    pairs = set(zip(marked.cluster.values[order], turned.cluster.values, strict=True))
    assert len(pairs) == clusters.sizes["cluster"] == again.sizes["cluster"]
    assert sorted(again.range.values) == pytest.approx(sorted(clusters.range.values))


def test_a_detection_between_two_clusters_is_of_the_first(radar):
    reach_m = 5 * radar.frame.chirp.range_resolution_m
    near, far = [0.0] * 4 + [0.9], [2.7] + [3.6] * 4
    # The one between has a neighbour on each side: too few to start a cluster, or to join both.
    rows = table(range=20 + reach_m * np.array([1.8, *far, *near]), velocity=0.0)

    marked, _ = cluster(rows, radar, Dbscan(min_detections=4))

    assert marked.cluster.values.tolist() == [0] * 6 + [1] * 5


def test_noise_is_kept_and_marked(radar):
    rows = table(range=[20, 20.3, 20.5, 60], velocity=[1, 1.1, 1, 1])
    marked, clusters = cluster(rows, radar, Dbscan(min_detections=2))

    assert marked.cluster.values.tolist() == [0, 0, 0, -1]
    assert clusters.n_detections.values.tolist() == [3]
    xr.testing.assert_identical(marked.drop_vars("cluster"), rows)


def test_velocity_goes_round_at_the_ends_of_the_span(radar):
    top, off = radar.frame.max_velocity_m_per_s, 0.1
    rows = table(range=20.0, velocity=[top - off, off - top, off - top], snr=[50.0, 25.0, 25.0])
    marked, clusters = cluster(rows, radar)

    assert marked.cluster.values.tolist() == [0, 0, 0]
    assert abs(float(clusters.velocity[0])) == pytest.approx(top, abs=0.05)
    # The wavelength is that of each echo: 1 in 1,000 of the span.
    assert float(clusters.velocity_extent[0]) == pytest.approx(2 * off, abs=2e-3 * top)


def test_a_velocity_of_no_known_fold_is_within_the_span(radar):
    top = radar.frame.max_velocity_m_per_s
    # The strongest is below the end of the span, the mean is beyond it: at its beginning.
    rows = table(range=20.0, velocity=[top - 0.05, 0.4 - top, 0.4 - top], snr=[50.0, 49.0, 49.0])
    _, clusters = cluster(rows, radar)

    assert clusters.sizes["cluster"] == 1
    mean = -top + (0.4 * 98 - 0.05 * 50) / 148
    assert float(clusters.velocity[0]) == pytest.approx(mean, abs=2e-3 * top)
    # What a fold more adds to the velocity it takes off the range: of the strongest alone.
    moved_m = range_shift_m(radar.frame) * 50 / 148
    assert float(clusters.range[0]) == pytest.approx(20.0 + moved_m, abs=1e-6)


def test_a_known_fold_is_that_of_its_cluster(radar):
    radar = replace(
        radar,
        frame=replace(radar.frame, multiplexing=dc.multiplexing.Tdm(order=(0, 1))),
        array=replace(radar.array, tx_m=[(0, 0, 0), (0, 3.8e-3, 0)]),
    )
    frame = radar.frame
    span = float(unambiguous_span_m_per_s(np.array(20.0), frame))
    # The same place on the map: a fold on, and nearer by its coupling.
    rows = table(
        range=[20.0, 20.0 + range_shift_m(frame)],
        velocity=[5.0 + span, 5.0],
        ambiguity_number=[1.0, NAN],
        snr=[10.0, 1000.0],
    )
    marked, clusters = cluster(rows, radar)

    assert marked.cluster.values.tolist() == [0, 0]
    assert float(clusters.velocity[0]) == pytest.approx(5.0 + span, abs=1e-4)
    assert float(clusters.range[0]) == pytest.approx(20.0, abs=1e-6)
    assert float(clusters.ambiguity_number[0]) == 1

    # Both known, they are two targets; two transmitters tell two folds, and the third is the first.
    for folds, n_clusters in (([1.0, 0.0], 2), ([2.0, 0.0], 1)):
        known = table(
            range=[20.0 - folds[0] * range_shift_m(frame), 20.0],
            velocity=[5.0 + folds[0] * span, 5.0],
            ambiguity_number=folds,
        )
        assert cluster(known, radar)[1].sizes["cluster"] == n_clusters


def test_frames_go_round_at_their_own_spans(radar):
    radar = replace(radar, frame=replace(radar.frame, interval_s=[35e-6, 45e-6]))
    tops = [radar.for_frame(k).frame.max_velocity_m_per_s for k in (0, 1)]
    # In each frame a pair at the ends of its own span, and one that is at those of the other.
    for of, n_clusters in (((0, 1), 2), ((1, 0), 4)):
        velocity = [s * (tops[k] - 0.1) for k in of for s in (1, -1)]
        rows = table(frame=[0, 0, 1, 1], range=20.0, velocity=velocity)
        assert cluster(rows, radar)[1].sizes["cluster"] == n_clusters


def test_frames_have_clusters_of_their_own(radar):
    rows = table(frame=[7, 2, 7, 2], range=20.0, velocity=1.0)
    marked, clusters = cluster(rows, radar)

    assert sorted(clusters.frame.values) == [2, 7]
    assert (clusters.frame.values[marked.cluster.values] == rows.frame.values).all()
    assert clusters.time.values == pytest.approx(0.1 * clusters.frame.values)


def test_an_angle_is_that_of_the_detections_that_tell_it(radar):
    rows = table(range=20.0, velocity=1.0, azimuth=[0.1, NAN, 0.2], snr=[300.0, 1000.0, 100.0])
    _, clusters = cluster(rows, radar)

    assert float(clusters.azimuth[0]) == pytest.approx((3 * 0.1 + 0.2) / 4)
    assert float(clusters.azimuth_extent[0]) == pytest.approx(0.1)
    assert np.isnan(clusters.elevation[0]) and np.isnan(clusters.elevation_std[0])
    assert clusters.snr.item() == 1400


def test_the_centroid_is_as_far_off_as_its_standard_error_says(radar):
    rng = np.random.default_rng(5)
    n_frames, n = 4000, 3
    frame = np.repeat(np.arange(n_frames), n)
    snr = rng.uniform(20, 2000, frame.size)
    errors = dict(zip(ERRORS[:3], np.array([[2.0], [1.0], [0.2]]) / np.sqrt(snr), strict=True))
    true = {"range": 30.0, "velocity": radar.frame.max_velocity_m_per_s - 0.05, "azimuth": 0.3}
    drawn = {
        name: at + errors[f"{name}_std"] * rng.standard_normal(frame.size)
        for name, at in true.items()
    }
    span = unambiguous_span_m_per_s(drawn["range"], radar.frame)
    gone_round = drawn["velocity"] > span / 2
    drawn["velocity"] -= span * gone_round
    drawn["range"] += range_shift_m(radar.frame) * gone_round

    _, clusters = cluster(table(frame=frame, snr=snr, **drawn, **errors), radar)

    whole = clusters.isel(cluster=clusters.n_detections.values == n)
    assert whole.sizes["cluster"] > 0.99 * n_frames
    top = float(unambiguous_span_m_per_s(np.array(30.0), radar.frame)) / 2
    for name, at in true.items():
        off = whole[name].values - at
        if name == "velocity":
            off = (off + top) % (2 * top) - top
        if name == "range":
            off -= range_shift_m(radar.frame) * (whole.velocity.values < 0)
        ratio = np.mean((off / whole[f"{name}_std"].values) ** 2)
        # Five standard deviations of a mean of 4,000 squares; weights by ratio are the best.
        assert ratio == pytest.approx(1, abs=5 * np.sqrt(2 / n_frames))
        weights = 1 / errors[f"{name}_std"].reshape(n_frames, n) ** 2
        assert whole[f"{name}_std"].values.mean() == pytest.approx(
            np.mean(weights.sum(axis=1) ** -0.5), rel=0.01
        )


def test_cars_are_fewer_clusters_than_detections_and_do_not_mix(radar):
    chirp = replace(radar.frame.chirp, slope_hz_per_s=30e12, adc_start_s=2e-6)
    rx_m = [(0, 1.93e-3 * k, 0) for k in range(4)]
    radar = replace(
        radar, frame=replace(radar.frame, chirp=chirp), array=replace(radar.array, rx_m=rx_m)
    )
    places = {"left": (15, 3, -0.5), "right": (15, -4, -0.5)}
    scene = dc.Scene(
        targets=[
            dc.Target(name=name, position_m=at, velocity_m_per_s=(v, 0, 0), body=Car())
            for (name, at), v in zip(places.items(), (4.0, -6.0), strict=True)
        ]
    )
    found = dc.detect(dc.simulate(scene, radar, seed=1), radar)
    owner = associate_detections(found, dc.truth(scene, radar), radar, scene).target

    marked, clusters = cluster(found, radar)

    assert set(owner) == {0, 1}
    for number in range(clusters.sizes["cluster"]):
        assert len(set(owner[marked.cluster.values == number])) == 1
    assert clusters.sizes["cluster"] <= found.sizes["detection"] / 2
    assert float(clusters.range_extent.max()) < Car().length_m


def test_no_detections_are_no_clusters(radar):
    marked, clusters = cluster(table(range=[20.0]).isel(detection=[]), radar)
    assert marked.sizes["detection"] == clusters.sizes["cluster"] == 0
    lone = cluster(GOOD, radar, Dbscan(min_detections=2))[1]
    assert lone.sizes["cluster"] == 0 and set(lone) == set(clusters)
    assert "cluster" in marked and "velocity_extent" in clusters


def test_lists_of_other_radars_need_no_ratios_and_no_errors(radar):
    rows = table(range=[20.0, 20.2], velocity=1.0, snr=NAN)[["frame", "range", "velocity", "snr"]]
    clusters = cluster(rows, radar)[1]

    assert float(clusters.range[0]) == pytest.approx(20.1)
    assert np.isnan(clusters.range_std[0]) and np.isnan(clusters.snr[0])


def test_a_target_between_the_last_bin_and_the_first_is_on_the_map(radar):
    # -1e-18 % 128 is 128 in floating point: beyond the map.
    cells = to_resolution_cells([20.0], [-1e-18], [NAN], [NAN], radar)
    assert 0 <= alias_doppler_cells(cells, 128)[0, 1] < 128


def test_pairs_that_would_not_fit_are_refused(radar, monkeypatch):
    crowd = table(range=np.full(2000, 20.0), velocity=1.0)
    little = SimpleNamespace(available=1e8)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: little)
    with pytest.raises(dc.NotEnoughMemory, match="lower the reach"):
        cluster(crowd, radar)


@pytest.mark.parametrize(
    ("make", "setting"),
    [
        (lambda: Reach(range=0.0), "Reach.range"),
        (lambda: Reach(velocity=NAN), "Reach.velocity"),
        (lambda: Reach(direction=-1.0), "Reach.direction"),
        (lambda: Reach(range=1e9), "Reach.range"),
        (lambda: Dbscan(reach=2.0), "Dbscan.reach"),
        (lambda: Dbscan(min_detections=0), "Dbscan.min_detections"),
        (lambda: Dbscan(min_detections=2.5), "Dbscan.min_detections"),
    ],
)
def test_settings_that_cannot_work_are_refused(make, setting):
    with pytest.raises(dc.InvalidSetting) as wrong:
        make()
    assert wrong.value.mistakes[0].setting == setting


GOOD = table(range=[20.0, 30.0], velocity=1.0)


@pytest.mark.parametrize(
    ("rows", "setting"),
    [
        (GOOD.drop_vars("range"), "detections"),
        (GOOD["range"], "detections"),
        (GOOD.assign(range=("detection", [20.0, np.inf])), "detections.range"),
        (GOOD.assign(velocity=("detection", [-np.inf, 0.0])), "detections.velocity"),
        (GOOD.assign(snr=("detection", [-1.0, 1.0])), "detections.snr"),
        (GOOD.assign(frame=("detection", [0, -1])), "detections.frame"),
        (GOOD.assign(frame=("detection", [0, 0.5])), "detections.frame"),
        (GOOD.assign(azimuth=("detection", [np.inf, 0.0])), "detections.azimuth"),
        (GOOD.assign(range=("detection", ["a", "b"])), "detections.range"),
    ],
)
def test_detections_that_cannot_be_are_refused(radar, rows, setting):
    with pytest.raises(dc.InvalidSetting) as wrong:
        cluster(rows, radar)
    assert wrong.value.mistakes[0].setting == setting


def test_what_is_no_radar_is_refused(radar):
    with pytest.raises(dc.InvalidSetting, match="radar: a Frame"):
        cluster(GOOD, radar.frame)
    with pytest.raises(dc.InvalidSetting, match="dbscan: a int"):
        cluster(GOOD, radar, 3)

"""Association of detections with the nearest target within two resolution cells."""

import itertools

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.evaluation import association
from dechirp.evaluation.association import GATE_CELLS, Associator, associate_detections
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.resolution_cells import alias_doppler_cells, to_resolution_cells
from dechirp.scene.aliasing import apparent_range_and_velocity
from dechirp.scene.bodies.points import Oscillation, Points, Scatterer
from nightly import nightly_except

CHIRP = dc.Chirp(
    start_frequency_hz=77e9,
    slope_hz_per_s=20e12,
    adc_start_s=2e-6,
    ramp_duration_s=30e-6,
    sample_rate_hz=10e6,
    n_samples=128,
    sampling="complex",
)
RADAR = dc.Radar(
    frame=dc.Frame(chirp=CHIRP, n_chirps=128, interval_s=35e-6),
    hardware=dc.Hardware(transmit_power_w=0.016, antenna_gain=10.0, noise_factor=16.0),
)
CAR = dc.Target(name="car", position_m=(50, 0, 0), velocity_m_per_s=(10, 0, 0), rcs_m2=1.0)
CELL_M, CELL_M_PER_S = CHIRP.range_resolution_m, RADAR.frame.velocity_resolution_m_per_s


def build_detections(**columns) -> xr.Dataset:
    n = max(np.size(column) for column in columns.values())
    columns = {"frame": 0, "ambiguity_number": np.nan, **columns}
    return xr.Dataset(
        {name: ("detection", np.broadcast_to(column, n)) for name, column in columns.items()}
    )


def test_detection_beyond_two_cells_is_unmatched():
    ground_truth = dc.truth(dc.Scene(targets=[CAR]), RADAR)
    for name, cell in (("range", CELL_M), ("velocity", CELL_M_PER_S)):
        columns = {"range": ground_truth.range.item(), "velocity": 10.0}
        columns[name] = columns[name] + cell * np.array([0.1, 1.9, 2.1])
        assert associate_detections(
            build_detections(**columns), ground_truth, RADAR
        ).target.tolist() == [0, 0, -1]


def build_two_scatterer_scene(**far_settings) -> dc.Scene:
    """Build a body at 50 m with scatterers at its origin and 6 m, ten cells, behind it."""
    near = Scatterer(position_m=(0, 0, 0), rcs_m2=1.0)
    far = Scatterer(position_m=(6, 0, 0), rcs_m2=1.0, **far_settings)
    pair = dc.Target(
        position_m=(50, 0, 0), velocity_m_per_s=(10, 0, 0), body=Points(scatterers=(near, far))
    )
    return dc.Scene(targets=[pair])


def test_detection_of_any_scatterer_matches_its_body():
    scene = build_two_scatterer_scene()
    ground_truth = dc.truth(scene, RADAR)
    detections = build_detections(
        range=ground_truth.range.item() + np.array([0, 6.1, 3.0]), velocity=10.0
    )

    matched = associate_detections(detections, ground_truth, RADAR, scene)

    # The third detection lies 3 m, five cells, from both; without the scene only the origin counts.
    assert matched.target.tolist() == [0, 0, -1]
    assert np.isnan(matched.range_error_m).all()
    assert associate_detections(detections, ground_truth, RADAR).target.tolist() == [0, -1, -1]


def test_oscillating_scatterer_matches_at_its_own_velocity():
    # Scatterer velocity at mid-frame: 12.6 m/s towards the radar, 29 cells from the body velocity.
    turn = 2 * np.pi * 20.0 * RADAR.frame.mid_frame_s
    swing = Oscillation(amplitude_m=(0.1, 0, 0), frequency_hz=20.0, phase_rad=np.pi - turn)
    scene = build_two_scatterer_scene(oscillation=swing)
    ground_truth = dc.truth(scene, RADAR)
    detections = build_detections(
        range=ground_truth.range.item() + 6, velocity=[10 - 0.1 * 2 * np.pi * 20, 10.0]
    )

    assert associate_detections(detections, ground_truth, RADAR, scene).target.tolist() == [0, -1]


def test_velocity_distance_wraps_around_end_of_map():
    max_velocity = RADAR.frame.max_velocity_m_per_s
    fast_target = dc.Target(
        position_m=(50, 0, 0), velocity_m_per_s=(max_velocity - 0.3 * CELL_M_PER_S, 0, 0)
    )
    scene = dc.Scene(targets=[fast_target])
    ground_truth = dc.truth(scene, RADAR)

    matched = associate_detections(
        build_detections(range=ground_truth.range.item(), velocity=[-max_velocity + CELL_M_PER_S]),
        ground_truth,
        RADAR,
        scene,
    )

    assert matched.target.tolist() == [0]
    assert matched.velocity_error_m_per_s[0] == pytest.approx(1.3 * CELL_M_PER_S)


def test_rejects_frame_missing_in_ground_truth():
    ground_truth = dc.truth(dc.Scene(targets=[CAR]), RADAR)

    with pytest.raises(dc.InvalidSetting, match=r"detections.frame: 1"):
        associate_detections(
            build_detections(range=50.0, velocity=10.0, frame=[1]), ground_truth, RADAR
        )


def build_radar(n_tx: int, interval_s, sampling: str) -> dc.Radar:
    """Build a radar with one or two transmitters and four receivers."""
    return dc.Radar(
        frame=dc.Frame(
            chirp=dc.Chirp(**{**vars(CHIRP), "sampling": sampling}),
            n_chirps=32,
            interval_s=interval_s,
            multiplexing=Tdm(order=(0, 1)) if n_tx == 2 else None,
        ),
        array=dc.Array(
            tx_m=[(0, 7.8e-3 * k, 0) for k in range(n_tx)],
            rx_m=[(0, 1.95e-3 * k, 0) for k in range(4)],
        ),
        hardware=RADAR.hardware,
    )


def draw_random_case(rng: np.random.Generator, radar: dc.Radar) -> tuple[xr.Dataset, dict]:
    """Draw six targets in three frames, some close together, and 80 detections around them."""
    targets = [
        dc.Target(
            position_m=(rng.uniform(8, 14), rng.uniform(-8, 8), 0),
            velocity_m_per_s=(rng.uniform(-60, 60), 0, 0),
        )
        for _ in range(6)
    ]
    ground_truth = dc.truth(dc.Scene(targets=targets), radar, n_frames=3)
    target_indices, frame, n = rng.integers(0, 6, 80), rng.integers(0, 3, 80), 80
    apparent = apparent_range_and_velocity(ground_truth, radar)
    ambiguity_number = np.where(rng.random(n) < 0.5, np.nan, rng.integers(-1, 2, n))
    velocity_cell = radar.for_frame(0).frame.velocity_resolution_m_per_s
    return ground_truth, {
        "frame": frame,
        "range": apparent.range_m[target_indices, frame] + rng.normal(0, 1.2, n) * CELL_M,
        "velocity": apparent.velocity_m_per_s[target_indices, frame]
        + rng.normal(0, 1.2, n) * velocity_cell,
        "azimuth": np.where(
            rng.random(n) < 0.3,
            np.nan,
            ground_truth.azimuth.values[target_indices, frame] + rng.normal(0, 0.3, n),
        ),
        "elevation": np.full(n, np.nan),
        "ambiguity_number": ambiguity_number,
    }


def match_pair_by_pair(ground_truth: xr.Dataset, columns: dict, radar: dc.Radar) -> list[int]:
    """Match each detection to its nearest target by testing all pairs."""
    matches = []
    expected = apparent_range_and_velocity(ground_truth, radar)
    for i, number in enumerate(columns["frame"]):
        frame_radar = radar.for_frame(int(number))
        angles = [columns["azimuth"][i], columns["elevation"][i]]
        nearest = (np.inf, -1)
        # A second pass without angles, which depend on the velocity ambiguity under TDM.
        for ignores_angles in (
            False,
            True,
        ):
            if ignores_angles and (nearest[0] <= GATE_CELLS or len(radar.array.tx_m) == 1):
                continue
            if ignores_angles and np.isfinite(columns["ambiguity_number"][i]):
                continue
            values = [columns["range"][i], columns["velocity"][i], *angles]
            detection_cells = alias_doppler_cells(
                to_resolution_cells(*(np.array([x]) for x in values), frame_radar),
                frame_radar.frame.n_chirps,
            )[0]
            if ignores_angles:
                detection_cells[2:] = np.nan
            for target in range(ground_truth.sizes["target"]):
                target_truth = ground_truth.isel(target=target, frame=int(number))
                target_values = [
                    np.array([x])
                    for x in (
                        expected.range_m[target, number],
                        expected.velocity_m_per_s[target, number],
                        float(target_truth.azimuth),
                        float(target_truth.elevation),
                    )
                ]
                distance_cells = abs(
                    detection_cells
                    - alias_doppler_cells(
                        to_resolution_cells(*target_values, frame_radar), frame_radar.frame.n_chirps
                    )[0]
                )
                distance_cells[1] = min(
                    distance_cells[1], frame_radar.frame.n_chirps - distance_cells[1]
                )
                nearest = min(nearest, (np.nanmax(distance_cells), target))
        matches.append(nearest[1] if nearest[0] <= GATE_CELLS else -1)
    return matches


@pytest.mark.parametrize(
    ("n_tx", "interval_s", "sampling"),
    nightly_except(3, [*itertools.product((1, 2), (35e-6, (35e-6, 41e-6)), ("complex", "real"))]),
)
def test_batch_association_equals_pair_by_pair_matching(monkeypatch, n_tx, interval_s, sampling):
    radar = build_radar(n_tx, interval_s, sampling)
    ground_truth, columns = draw_random_case(np.random.default_rng(n_tx), radar)
    matcher, expected = (
        Associator(ground_truth, radar),
        match_pair_by_pair(ground_truth, columns, radar),
    )

    batch = matcher(columns)
    single_matches = [
        matcher({name: column[i : i + 1] for name, column in columns.items()}) for i in range(80)
    ]
    monkeypatch.setattr(association, "_MAX_BRUTE_FORCE_PAIRS", -1)
    tree_matches = matcher(columns)

    assert 20 < np.count_nonzero(np.array(expected) >= 0) < 80
    assert batch.target.tolist() == expected
    for single_column, batch_column, tree_column in zip(
        zip(*single_matches, strict=True), batch, tree_matches, strict=True
    ):
        np.testing.assert_array_equal(np.concatenate(single_column), batch_column)
        np.testing.assert_array_equal(tree_column, batch_column)

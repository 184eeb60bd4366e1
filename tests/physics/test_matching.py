"""Whose detections are: the nearest target within two cells, the same for one trial and many."""

import itertools

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.evaluation import association as matching
from dechirp.evaluation.association import GATE_CELLS, Associator, associate_detections
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.resolution_cells import alias_doppler_cells, to_resolution_cells
from dechirp.scene.aliasing import apparent_truth
from dechirp.scene.bodies.points import Oscillation, Points, Scatterer

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


def rows(**columns) -> xr.Dataset:
    n = max(np.size(column) for column in columns.values())
    columns = {"frame": 0, "ambiguity_number": np.nan, **columns}
    return xr.Dataset(
        {name: ("detection", np.broadcast_to(column, n)) for name, column in columns.items()}
    )


def test_a_detection_two_cells_away_is_not_the_targets():
    known = dc.truth(dc.Scene(targets=[CAR]), RADAR)
    for name, cell in (("range", CELL_M), ("velocity", CELL_M_PER_S)):
        at = {"range": known.range.item(), "velocity": 10.0}
        at[name] = at[name] + cell * np.array([0.1, 1.9, 2.1])
        assert associate_detections(rows(**at), known, RADAR).target.tolist() == [0, 0, -1]


def pair_of_points(**of_far) -> dc.Scene:
    """A body 50 m away with scatterers at its origin and 6 m, ten cells, behind it."""
    near = Scatterer(position_m=(0, 0, 0), rcs_m2=1.0)
    far = Scatterer(position_m=(6, 0, 0), rcs_m2=1.0, **of_far)
    pair = dc.Target(
        position_m=(50, 0, 0), velocity_m_per_s=(10, 0, 0), body=Points(scatterers=(near, far))
    )
    return dc.Scene(targets=[pair])


def test_a_detection_of_any_scatterer_is_the_bodys():
    scene = pair_of_points()
    known = dc.truth(scene, RADAR)
    found = rows(range=known.range.item() + np.array([0, 6.1, 3.0]), velocity=10.0)

    matched = associate_detections(found, known, RADAR, scene)

    # 3 m lie between the two, five cells from each; without the scene only the origin counts.
    assert matched.target.tolist() == [0, 0, -1]
    assert np.isnan(matched.range_error_m).all()
    assert associate_detections(found, known, RADAR).target.tolist() == [0, -1, -1]


def test_a_part_that_moves_is_looked_for_at_its_own_velocity():
    # 12.6 m/s towards the radar at the middle of the frame, 29 cells from that of the body.
    turn = 2 * np.pi * 20.0 * RADAR.frame.mid_frame_s
    swing = Oscillation(amplitude_m=(0.1, 0, 0), frequency_hz=20.0, phase_rad=np.pi - turn)
    scene = pair_of_points(oscillation=swing)
    known = dc.truth(scene, RADAR)
    found = rows(range=known.range.item() + 6, velocity=[10 - 0.1 * 2 * np.pi * 20, 10.0])

    assert associate_detections(found, known, RADAR, scene).target.tolist() == [0, -1]


def test_velocities_are_near_each_other_across_the_end_of_the_map():
    most = RADAR.frame.max_velocity_m_per_s
    fast = dc.Target(position_m=(50, 0, 0), velocity_m_per_s=(most - 0.3 * CELL_M_PER_S, 0, 0))
    scene = dc.Scene(targets=[fast])
    known = dc.truth(scene, RADAR)

    matched = associate_detections(
        rows(range=known.range.item(), velocity=[-most + CELL_M_PER_S]), known, RADAR, scene
    )

    assert matched.target.tolist() == [0]
    assert matched.velocity_error_m_per_s[0] == pytest.approx(1.3 * CELL_M_PER_S)


def test_a_frame_that_the_truth_has_not_is_refused():
    known = dc.truth(dc.Scene(targets=[CAR]), RADAR)

    with pytest.raises(dc.InvalidSetting, match=r"detections.frame is 1"):
        associate_detections(rows(range=50.0, velocity=10.0, frame=[1]), known, RADAR)


def other_radar(n_tx: int, interval_s, sampling: str) -> dc.Radar:
    """One or two transmitters beside four receivers."""
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


def random_case(rng: np.random.Generator, radar: dc.Radar) -> tuple[xr.Dataset, dict]:
    """Six targets in three frames, some near each other, and 80 detections about them."""
    targets = [
        dc.Target(
            position_m=(rng.uniform(8, 14), rng.uniform(-8, 8), 0),
            velocity_m_per_s=(rng.uniform(-60, 60), 0, 0),
        )
        for _ in range(6)
    ]
    known = dc.truth(dc.Scene(targets=targets), radar, n_frames=3)
    of, frame, n = rng.integers(0, 6, 80), rng.integers(0, 3, 80), 80
    at = apparent_truth(known, radar)
    fold = np.where(rng.random(n) < 0.5, np.nan, rng.integers(-1, 2, n))
    speed = radar.for_frame(0).frame.velocity_resolution_m_per_s
    return known, {
        "frame": frame,
        "range": at.range_m[of, frame] + rng.normal(0, 1.2, n) * CELL_M,
        "velocity": at.velocity_m_per_s[of, frame] + rng.normal(0, 1.2, n) * speed,
        "azimuth": np.where(
            rng.random(n) < 0.3, np.nan, known.azimuth.values[of, frame] + rng.normal(0, 0.3, n)
        ),
        "elevation": np.full(n, np.nan),
        "ambiguity_number": fold,
    }


def by_hand(known: xr.Dataset, columns: dict, radar: dc.Radar) -> list[int]:
    """The nearest target, looked for in one pair after another."""
    out = []
    expected = apparent_truth(known, radar)
    for i, number in enumerate(columns["frame"]):
        one = radar.for_frame(int(number))
        angles = [columns["azimuth"][i], columns["elevation"][i]]
        nearest = (np.inf, -1)
        for turned in (False, True):  # then without its direction, where that goes with a fold
            if turned and (nearest[0] <= GATE_CELLS or len(radar.array.tx_m) == 1):
                continue
            if turned and np.isfinite(columns["ambiguity_number"][i]):
                continue
            told = [columns["range"][i], columns["velocity"][i], *angles]
            own = alias_doppler_cells(
                to_resolution_cells(*(np.array([x]) for x in told), one), one.frame.n_chirps
            )[0]
            if turned:
                own[2:] = np.nan
            for target in range(known.sizes["target"]):
                place = known.isel(target=target, frame=int(number))
                there = [
                    np.array([x])
                    for x in (
                        expected.range_m[target, number],
                        expected.velocity_m_per_s[target, number],
                        float(place.azimuth),
                        float(place.elevation),
                    )
                ]
                apart = abs(
                    own
                    - alias_doppler_cells(to_resolution_cells(*there, one), one.frame.n_chirps)[0]
                )
                apart[1] = min(apart[1], one.frame.n_chirps - apart[1])
                nearest = min(nearest, (np.nanmax(apart), target))
        out.append(nearest[1] if nearest[0] <= GATE_CELLS else -1)
    return out


@pytest.mark.parametrize(
    ("n_tx", "interval_s", "sampling"),
    [*itertools.product((1, 2), (35e-6, (35e-6, 41e-6)), ("complex", "real"))],
)
def test_many_trials_are_matched_as_one_is_pair_by_pair(monkeypatch, n_tx, interval_s, sampling):
    radar = other_radar(n_tx, interval_s, sampling)
    known, columns = random_case(np.random.default_rng(n_tx), radar)
    matcher, hand = Associator(known, radar), by_hand(known, columns, radar)

    every = matcher(columns)
    one_by_one = [
        matcher({name: column[i : i + 1] for name, column in columns.items()}) for i in range(80)
    ]
    monkeypatch.setattr(matching, "_MAX_BRUTE_FORCE_PAIRS", -1)
    by_tree = matcher(columns)

    assert 20 < np.count_nonzero(np.array(hand) >= 0) < 80
    assert every.target.tolist() == hand
    for alone, together, tree in zip(zip(*one_by_one, strict=True), every, by_tree, strict=True):
        np.testing.assert_array_equal(np.concatenate(alone), together)
        np.testing.assert_array_equal(tree, together)

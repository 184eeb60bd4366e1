"""I/Q images of strong echoes, named in a note, and targets that are at mirrors by chance."""

from dataclasses import replace

import numpy as np
import pytest
from test_chain_fitting import RADAR as RADAR_WITHOUT_HARDWARE

import dechirp as dc
from dechirp.core.detection_columns import UNITS
from dechirp.experiments.scenario import RecordingSource
from dechirp.processing.image_echoes import find_image_echoes

HARDWARE = dc.Hardware(transmit_power_w=0.01, antenna_gain=10, noise_factor=10)
RADAR = replace(RADAR_WITHOUT_HARDWARE, hardware=HARDWARE)
CHIRP = replace(RADAR.frame.chirp, n_samples=128)
LENGTH_M, CELL_M = CHIRP.max_range_m, CHIRP.range_resolution_m
CHAIN = dc.Chain()
# sqrt((1 - 2 g cos p + g^2) / (1 + 2 g cos p + g^2)) of 0.2 dB and 1.5 degrees: -35.3 dB.
GAIN_DB, PHASE_DEG = 0.2, 1.5


def image_level_db():
    """Return the level of the image, B. Razavi, RF Microelectronics, 2nd ed., 4.2."""
    gain, phase_rad = 10 ** (GAIN_DB / 20), np.radians(PHASE_DEG)
    cross = 2 * gain * np.cos(phase_rad)
    return 10 * np.log10((1 - cross + gain**2) / (1 + cross + gain**2))


def run_scene(scene, tmp_path, *, has_imbalance, sampling="complex"):
    frame = replace(RADAR.frame, chirp=replace(RADAR.frame.chirp, sampling=sampling))
    radar = replace(RADAR, frame=frame)
    impairments = [dc.impairments.ThermalNoise()]
    if has_imbalance:
        imbalance = dc.impairments.IqImbalance(
            gain=10 ** (GAIN_DB / 10), phase_rad=np.radians(PHASE_DEG)
        )
        impairments.append(imbalance)
    path = tmp_path / "scene.h5"
    cube = dc.simulate(scene, radar, impairments=tuple(impairments), seed=5)
    dc.write(dc.recording_from_cube(cube, radar), path)
    result = dc.run(dc.Scenario(recording=RecordingSource(path=str(path)), chain=CHAIN))
    notes = [str(finding) for finding in result.findings if "I/Q images" in str(finding)]
    return result, notes


def static_scene(*cells, rcs_m2=2000):
    return dc.Scene(
        targets=[dc.Target(position_m=(cell * CELL_M, 0, 0), rcs_m2=rcs_m2) for cell in cells]
    )


def test_images_of_strong_static_echoes_are_named_with_their_level(tmp_path):
    scene = static_scene(20.0, 31.4)

    result, notes = run_scene(scene, tmp_path, has_imbalance=True)

    ranges = np.sort(result.detections.range.values / CELL_M)
    assert ranges == pytest.approx([20, 31.4, 128 - 31.4, 108], abs=0.1)
    (note,) = notes
    assert "2 detections" in note
    assert f"{LENGTH_M - 20 * CELL_M:.4g} m (of {20 * CELL_M:.4g} m)" in note
    # Noise at an SNR above 15 dB moves a level by less than 2 dB with a probability of 1 - 1e-6.
    stated_db = float(note.split("echoes ")[1].split(" dB")[0])
    assert stated_db == pytest.approx(-image_level_db(), abs=2)


def test_no_image_is_named_without_imbalance_or_in_real_samples(tmp_path):
    targets = static_scene(20.0, 31.4).targets + static_scene(90.0, 105.3, rcs_m2=500).targets
    assert run_scene(dc.Scene(targets=targets), tmp_path, has_imbalance=False)[1] == []
    real = static_scene(20.0, 31.4)
    assert run_scene(real, tmp_path, has_imbalance=False, sampling="real")[1] == []


def make_columns(cells, velocity_cells):
    n = len(cells)
    velocity_cell = RADAR.frame.velocity_resolution_m_per_s
    columns = {name: np.full(n, np.nan) for name in UNITS}
    return columns | {
        "frame": np.zeros(n),
        "range": np.asarray(cells) * CELL_M,
        "range_std": np.full(n, 0.02 * CELL_M),
        "velocity": np.asarray(velocity_cells) * velocity_cell,
        "velocity_std": np.full(n, 0.02 * velocity_cell),
    }


def map_of_tones(tones):
    power = np.ones((RADAR.frame.n_chirps, CHIRP.n_samples))
    for cell, velocity_cell, snr_db in tones:
        row = (RADAR.frame.n_chirps // 2 + round(velocity_cell)) % RADAR.frame.n_chirps
        power[row, round(cell) % CHIRP.n_samples] += 10 ** (snr_db / 10)
    return power


def find(tones):
    cells, velocity_cells, _ = np.transpose(tones)
    columns = make_columns(cells, velocity_cells)
    return find_image_echoes(columns, {0: map_of_tones(tones)}, RADAR, CHAIN)


def test_image_of_moving_echo_has_the_opposite_velocity():
    strong = 40.2, 6.3, 60
    (image,) = find([strong, (128 - 40.2, -6.3, 25)])
    assert image.range_m == pytest.approx((128 - 40.2) * CELL_M)
    assert 10 * np.log10(image.level) == pytest.approx(-35, abs=0.1)

    assert find([strong, (128 - 40.2, 6.3, 25)]) == ()  # of the same velocity
    assert find([strong, (128 - 40.2, -6.3, 45)]) == ()  # 15 dB weaker: a target
    assert find([strong, (128 - 43.2, -6.3, 25)]) == ()  # 3 cells beside the mirror


def test_unequal_levels_are_no_images():
    # Images have one level: one echo at a mirror 25 dB, another 40 dB weaker, by chance.
    tones = [(20.0, 0, 70), (30.0, 0, 66), (108.0, 0, 45), (98.0, 0, 26)]
    others = [(cell, 0, 40) for cell in range(70, 95, 3)]
    assert find([*tones, *others]) == ()


def test_targets_at_random_places_are_rarely_named():
    rng, n_trials = np.random.default_rng(6), 600
    n_affected = 0
    for trial in range(n_trials):
        n = rng.integers(2, 30)
        moves = (trial % 2) * rng.uniform(-15, 15, n)
        tones = np.column_stack([rng.uniform(4, 124, n), moves, rng.uniform(15, 60, n)])
        n_affected += bool(find(tones))
    # At most 2 % of the frames: 12, and 30 of 600 once in 10^5.
    assert n_affected <= 30

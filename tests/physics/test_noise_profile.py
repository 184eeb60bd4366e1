"""Noise that depends on range, and the moving detections that it may cause."""

import numpy as np
import pytest
from test_chain_fitting import CELL_M, RADAR, make_cube

import dechirp as dc
from dechirp.experiments.scenario import RecordingSource
from dechirp.processing.chain import Chain
from dechirp.processing.moving_targets import MovingTargetMap
from dechirp.processing.noise_profile import noise_excess_of_ranges, noise_profile_findings
from dechirp.radar.cube import label_cube
from nightly import nightly

CHAIN = Chain(moving_targets=MovingTargetMap()).fit_to_radar(RADAR).moving_target_chain()
NOISY_CELLS = range(3, 7)
N_FRAMES = 40


def make_noisy_frames(factor, *tones, cells=NOISY_CELLS, n_frames=N_FRAMES):
    """Make frames whose noise is stronger by a factor in four cells of range."""
    rng = np.random.default_rng(5)
    n_chirps, n_samples = RADAR.frame.n_chirps, RADAR.frame.chirp.n_samples
    bins = np.exp(2j * np.pi * np.outer(cells, np.arange(n_samples)) / n_samples)
    frames = []
    for number in range(n_frames):
        noise = rng.normal(size=(n_chirps, len(bins), 2)) @ [1, 1j]
        extra = np.sqrt((factor - 1) / 2 / n_samples) * noise @ bins
        frames.append(make_cube(*tones, seed=[5, number]).values[0] + extra[:, None])
    return np.array(frames, np.complex64)


def test_excess_is_that_of_the_noise():
    excess = noise_excess_of_ranges(make_noisy_frames(4.0), RADAR, CHAIN)

    # Four of the 21 rows of the training cells have it too, the outer two with half of a main lobe:
    # 4 / (1 + 3 x 4 / 21) = 2.5. The median of 40 x 32 cells has a standard deviation of 3.5 %.
    assert excess[4:6] == pytest.approx(2.5, rel=0.3)
    assert np.all(excess[20:] == 1)


def test_white_noise_has_no_excess():
    # Four standard deviations, and 1 dB, in each of 128 rows: 1.26 is 7 deviations here.
    assert np.all(noise_excess_of_ranges(make_noisy_frames(1.0), RADAR, CHAIN) == 1)


def test_detections_that_the_noise_explains_are_named():
    excess = np.where(np.isin(np.arange(128), NOISY_CELLS), 3.0, 1.0)
    # One channel and many training cells: a threshold of 11.4 dB over the mean, 16.2 dB over this.
    snr_db = np.array([14.0, 20.0, 14.0, 14.0])
    columns = {
        "range": np.array([4.0, 4.0, 60.0, 5.0]) * CELL_M,
        "snr": 10 ** (snr_db / 10),
        "moving": np.array([1.0, 1.0, 1.0, 0.0]),
    }

    (note,) = noise_profile_findings(columns, excess, RADAR, CHAIN)

    assert note.level == "note"
    assert "1 moving detection at 0.094 m may" in note.value
    assert "4.8 dB higher" in note.value
    assert noise_profile_findings(columns, np.ones(128), RADAR, CHAIN) == ()


@nightly
def test_run_names_false_movers_of_coloured_noise(tmp_path):
    frames = make_noisy_frames(8.0, (30.0, 0, 60), (60.0, 5, 40))
    path = tmp_path / "capture.h5"
    dc.write(dc.recording_from_cube(label_cube(frames, RADAR, units="1"), RADAR), path)

    result = dc.run(dc.Scenario(recording=RecordingSource(path=str(path))))

    is_near = result.detections.range.values / CELL_M < 10
    motion = result.detections.moving.values
    (note,) = (f for f in result.findings if "may be false alarms: the noise" in f.value)
    n_named = int(note.value.split()[0])
    # The named ones stay in the list, with unknown motion.
    assert 0 < n_named <= np.sum(is_near & np.isnan(motion))
    assert np.sum(is_near & (motion == 1)) <= 0.3 / 0.7 * n_named
    assert np.sum(~is_near & (motion == 1)) == N_FRAMES


def run_capture(frames, path):
    dc.write(dc.recording_from_cube(label_cube(frames, RADAR, units="1"), RADAR), path)
    return dc.run(dc.Scenario(recording=RecordingSource(path=str(path))))


@nightly
def test_noise_that_rises_towards_zero_range_causes_no_movers(tmp_path):
    tones = (30.0, 0, 60), (60.0, 5, 40)
    frames = make_noisy_frames(8.0, *tones, cells=range(4))

    result = run_capture(frames, tmp_path / "capture.h5")

    moving = result.detections.range.values[result.detections.moving.values == 1] / CELL_M
    # 40 frames of 4,096 cells at a probability of 1e-6: 0.16 false alarms in the mean, of which
    # more than five have a probability of 2e-8.
    assert np.sum(abs(moving - 60) > 1) <= 5
    assert np.sum(abs(moving - 60) < 1) == N_FRAMES
    (choice,) = (f for f in result.findings if f.setting == "chain.moving_targets")
    assert "--set chain.moving_targets.cfar.n_training.range=0" in choice.value
    assert choice.value.endswith("and noise rises towards zero range")


@nightly
def test_training_cells_along_velocity_hide_no_wide_doppler_spectrum(tmp_path):
    # A target of 13 velocities, as of a person who walks: more than the guard cells.
    wide = [(60.0, velocity, 40) for velocity in range(-10, 3)]
    frames = make_noisy_frames(8.0, (30.0, 0, 60), *wide, cells=range(4))

    result = run_capture(frames, tmp_path / "capture.h5")

    moving = result.detections.range.values[result.detections.moving.values == 1] / CELL_M
    assert np.sum(abs(moving - 60) < 1) >= N_FRAMES
    assert result.scenario.chain.moving_targets.cfar.has_default_window

"""Ramps of other frequencies or at uneven times: how velocities unfold within a frame."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

import dechirp as dc
from dechirp.processing.refine import Tones
from dechirp.processing.velocity_ambiguity import by_ramps
from dechirp.scene.aliasing import RangeVelocity, echo_frequencies

# 2 of 7 and 3 of 10 repetitions from slot to slot: 7 and 10 folds.
KEYED = dc.modulations.FrequencyShiftKeying(step_hz=3e8)
STAGGERED = dc.modulations.Staggered(pauses_s=(0, 10e-6))


def with_ramps(radar, modulation, **frame):
    return replace(radar, frame=replace(radar.frame, modulation=modulation, **frame))


@pytest.mark.parametrize("modulation", [KEYED, STAGGERED], ids=lambda one: one.kind())
@pytest.mark.parametrize("velocity", [-60.0, -8.0, 17.0, 40.0])
def test_slots_tell_velocities_beyond_those_of_their_interval(radar, modulation, velocity):
    radar = with_ramps(radar, modulation, n_chirps=32)
    assert radar.frame.max_velocity_m_per_s < 14
    target = dc.Target(position_m=(20, 0, 0), velocity_m_per_s=(velocity, 0, 0))
    scene = dc.Scene(targets=[target])
    found = dc.detect(dc.simulate(scene, radar, seed=1), radar)
    truth = dc.truth(scene, radar).isel(target=0, frame=0)

    assert found.sizes["detection"] == 1
    assert found.ambiguity_confidence.item() > 0.99
    # Six standard errors: at 60 m/s the echo walks through half of a range cell.
    for name in ("range", "velocity"):
        assert abs(found[name] - truth[name]).item() < 6 * found[f"{name}_std"].item() + 1e-4


def echoes(radar, velocity, snr, rng):
    """Tones of targets at 30 m, with noise of the bound in beats and amplitudes."""
    frame, chirp, n = radar.frame, radar.frame.chirp, len(velocity)
    at = echo_frequencies(RangeVelocity(np.full(n, 30.0), velocity), radar)
    n_channels = frame.n_slots * radar.array.n_rx
    slots_s = np.array([0, frame.repetition_s - frame.single_interval_s])
    if isinstance(frame.modulation, dc.modulations.Staggered):
        slots_s = np.array([0, 35e-6])
    shift_hz = np.array([ramp.shift_hz for ramp in frame.ramps])
    delay_s = (at.beat_hz - at.doppler_hz)[:, None] / chirp.slope_hz_per_s
    phase = 2 * np.pi * (at.doppler_hz[:, None] * slots_s + shift_hz * delay_s)
    of_rx = np.exp(2j * np.pi * rng.random((n, radar.array.n_rx)))
    amplitude = np.sqrt(snr / n_channels) * np.exp(1j * phase)[:, :, None] * of_rx[:, None]
    noise = rng.standard_normal((2, *amplitude.shape)) / np.sqrt(2)
    error = rng.standard_normal(n) * np.sqrt(6 / (snr * (chirp.n_samples**2 - 1)))
    tones = Tones(
        slow=np.zeros(n),
        fast=at.beat_hz * 2 * np.pi / chirp.sample_rate_hz + error,
        energy=np.full(n, snr),
        amplitude=(amplitude + noise[0] + 1j * noise[1]).reshape(n, -1),
    )
    turns = at.doppler_hz * frame.repetition_s
    return tones, (turns - np.round(turns)) / frame.repetition_s, np.round(turns)


@pytest.mark.parametrize("snr_db", [14, 20])
@pytest.mark.parametrize(
    ("modulation", "n_folds"),
    [
        (dc.modulations.FrequencyShiftKeying(step_hz=350e6), 4),  # a quarter of a repetition
        (dc.modulations.FrequencyShiftKeying(step_hz=-233.3333e6), 3),  # two thirds
        (dc.modulations.Staggered(pauses_s=(0, 35e-6)), 3),
        (dc.modulations.Staggered(pauses_s=(0, 17.5e-6)), 5),
        (STAGGERED, 16),
    ],
    ids=str,
)
def test_folds_are_told_as_surely_as_is_said(radar, modulation, n_folds, snr_db):
    radar, rng = with_ramps(radar, modulation), np.random.default_rng(2)
    frame, snr = radar.frame, 10 ** (snr_db / 10)
    assert frame.n_resolvable_ambiguities == n_folds
    span = n_folds * frame.max_velocity_m_per_s
    tones, principal_hz, truth = echoes(radar, rng.uniform(-span, span, 3000), snr, rng)
    amplitudes = by_ramps.remove_beat_phase(tones.amplitude, tones.fast, frame)
    told = by_ramps.ambiguity_probabilities(
        amplitudes, frame, principal_hz, np.full(3000, snr), np.ones(3000)
    )
    best = told.number[np.arange(3000), told.probability.argmax(axis=1)]
    right, sure = best == truth, np.isfinite(told.certain_number)

    assert binom.sf((~right & sure).sum() - 1, sure.sum(), 0.02) > 1e-6
    if snr_db == 20:
        # What is told is wrong 1 % of the time at most: the rest is marked.
        assert binom.sf((~right & sure).sum() - 1, 3000, 0.01) > 1e-6
        assert sure.mean() > {3: 0.95, 4: 0.95, 5: 0.3, 16: 0.0}[n_folds] - 1e-9
    # Confidence is the share that is right, five standard errors; less where it is unsure of
    # the noise.
    spread = np.sqrt(np.sum(told.confidence * (1 - told.confidence)))
    assert right.sum() > told.confidence.sum() - 5 * spread - 10


def test_amplitudes_that_are_no_one_echo_are_not_certain(radar):
    radar, rng = with_ramps(radar, STAGGERED), np.random.default_rng(3)
    tones, principal_hz, _ = echoes(radar, rng.uniform(-20, 20, 500), 100.0, rng)
    turned = tones.amplitude * np.exp(2j * np.pi * rng.random(tones.amplitude.shape))
    told = by_ramps.ambiguity_probabilities(
        turned, radar.frame, principal_hz, np.full(500, 100.0), np.ones(500)
    )
    assert np.isfinite(told.certain_number).mean() < 0.05


@pytest.mark.parametrize(
    ("member", "settings", "expected"),
    [
        (
            dc.modulations.FrequencyShiftKeying,
            {"step_hz": 0.0},
            "a step other than 0",
        ),
        (dc.modulations.FrequencyShiftKeying, {"step_hz": 7e8}, "bandwidth of the ramp"),
        (dc.modulations.FrequencyShiftKeying, {"step_hz": np.nan}, "one finite number"),
        (
            dc.modulations.Staggered,
            {"pauses_s": (5e-6, 5e-6)},
            "equal pauses are a longer interval",
        ),
        (dc.modulations.Staggered, {"pauses_s": ()}, "two or more pauses that differ"),
        (dc.modulations.Staggered, {"pauses_s": (0, -5e-6)}, "at least 0"),
        (dc.modulations.Staggered, {"pauses_s": 5e-6}, "a list of numbers"),
    ],
)
def test_settings_that_cannot_be_are_refused(radar, member, settings, expected):
    with pytest.raises(dc.InvalidSetting, match=expected) as error:
        with_ramps(radar, member(**settings))
    # What the frame must hold against it is told of the frame: there it has its place in a file.
    assert error.value.mistakes[0].setting.startswith((member.__name__, "Frame.modulation."))

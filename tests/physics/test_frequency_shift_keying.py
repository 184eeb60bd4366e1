"""Velocity ambiguity resolution within a frame, with frequency-shift keying or staggered chirps."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

import dechirp as dc
from dechirp.processing.refine import Tones
from dechirp.processing.velocity_ambiguity import by_ramps
from dechirp.scene.aliasing import RangeVelocity, beat_and_doppler_frequencies

# Slots are 2 of 7 and 3 of 10 repetitions apart: 7 and 10 ambiguities.
FSK_MODULATION = dc.modulations.FrequencyShiftKeying(step_hz=3e8)
STAGGERED_MODULATION = dc.modulations.Staggered(pauses_s=(0, 10e-6))


def replace_modulation(radar, modulation, **frame):
    return replace(radar, frame=replace(radar.frame, modulation=modulation, **frame))


@pytest.mark.parametrize(
    "modulation", [FSK_MODULATION, STAGGERED_MODULATION], ids=lambda modulation: modulation.kind()
)
@pytest.mark.parametrize("velocity", [-60.0, -8.0, 17.0, 40.0])
def test_slots_extend_unambiguous_velocity_of_interval(radar, modulation, velocity):
    radar = replace_modulation(radar, modulation, n_chirps=32)
    assert radar.frame.max_velocity_m_per_s < 14
    target = dc.Target(position_m=(20, 0, 0), velocity_m_per_s=(velocity, 0, 0))
    scene = dc.Scene(targets=[target])
    detection = dc.detect(dc.simulate(scene, radar, seed=1), radar)
    truth = dc.truth(scene, radar).isel(target=0, frame=0)

    assert detection.sizes["detection"] == 1
    assert detection.ambiguity_confidence.item() > 0.99
    # Six standard errors: at 60 m/s the echo walks by half a range cell.
    for name in ("range", "velocity"):
        assert (
            abs(detection[name] - truth[name]).item() < 6 * detection[f"{name}_std"].item() + 1e-4
        )


def draw_echo_tones(radar, velocity, snr, rng):
    """Draw tones of targets at 30 m, with beat and amplitude errors at the bound."""
    frame, chirp, n = radar.frame, radar.frame.chirp, len(velocity)
    frequencies = beat_and_doppler_frequencies(RangeVelocity(np.full(n, 30.0), velocity), radar)
    n_channels = frame.n_slots * radar.array.n_rx
    slots_s = np.array([0, frame.repetition_s - frame.single_interval_s])
    if isinstance(frame.modulation, dc.modulations.Staggered):
        slots_s = np.array([0, 35e-6])
    shift_hz = np.array([ramp.shift_hz for ramp in frame.ramps])
    delay_s = (frequencies.beat_hz - frequencies.doppler_hz)[:, None] / chirp.slope_hz_per_s
    phase = 2 * np.pi * (frequencies.doppler_hz[:, None] * slots_s + shift_hz * delay_s)
    rx_phases = np.exp(2j * np.pi * rng.random((n, radar.array.n_rx)))
    amplitude = np.sqrt(snr / n_channels) * np.exp(1j * phase)[:, :, None] * rx_phases[:, None]
    noise = rng.standard_normal((2, *amplitude.shape)) / np.sqrt(2)
    error = rng.standard_normal(n) * np.sqrt(6 / (snr * (chirp.n_samples**2 - 1)))
    tones = Tones(
        slow=np.zeros(n),
        fast=frequencies.beat_hz * 2 * np.pi / chirp.sample_rate_hz + error,
        energy=np.full(n, snr),
        amplitude=(amplitude + noise[0] + 1j * noise[1]).reshape(n, -1),
    )
    cycles = frequencies.doppler_hz * frame.repetition_s
    return tones, (cycles - np.round(cycles)) / frame.repetition_s, np.round(cycles)


@pytest.mark.parametrize("snr_db", [14, 20])
@pytest.mark.parametrize(
    ("modulation", "n_ambiguities"),
    [
        (dc.modulations.FrequencyShiftKeying(step_hz=350e6), 4),  # a quarter of a repetition
        (dc.modulations.FrequencyShiftKeying(step_hz=-233.3333e6), 3),  # two thirds
        (dc.modulations.Staggered(pauses_s=(0, 35e-6)), 3),
        (dc.modulations.Staggered(pauses_s=(0, 17.5e-6)), 5),
        (STAGGERED_MODULATION, 16),
    ],
    ids=str,
)
def test_ambiguity_confidence_equals_share_of_correct_numbers(
    radar, modulation, n_ambiguities, snr_db
):
    radar, rng = replace_modulation(radar, modulation), np.random.default_rng(2)
    frame, snr = radar.frame, 10 ** (snr_db / 10)
    assert frame.n_resolvable_ambiguities == n_ambiguities
    span = n_ambiguities * frame.max_velocity_m_per_s
    tones, principal_hz, truth = draw_echo_tones(radar, rng.uniform(-span, span, 3000), snr, rng)
    amplitudes = by_ramps.remove_beat_phase(tones.amplitude, tones.fast, frame)
    hypotheses = by_ramps.ambiguity_probabilities(
        amplitudes, frame, principal_hz, np.full(3000, snr), np.ones(3000)
    )
    best = hypotheses.number[np.arange(3000), hypotheses.probability.argmax(axis=1)]
    is_right, is_certain = best == truth, np.isfinite(hypotheses.certain_ambiguity_numbers_or_nan)

    assert binom.sf((~is_right & is_certain).sum() - 1, is_certain.sum(), 0.02) > 1e-6
    if snr_db == 20:
        # Certain numbers are wrong 1 % of the time at most: the others are marked.
        assert binom.sf((~is_right & is_certain).sum() - 1, 3000, 0.01) > 1e-6
        assert is_certain.mean() > {3: 0.95, 4: 0.95, 5: 0.3, 16: 0.0}[n_ambiguities] - 1e-9
    # The mean confidence equals the correct share to five standard errors; it is lower where the
    # noise level is uncertain.
    spread = np.sqrt(np.sum(hypotheses.confidence * (1 - hypotheses.confidence)))
    assert is_right.sum() > hypotheses.confidence.sum() - 5 * spread - 10


def test_incoherent_amplitudes_yield_no_certain_ambiguity_number(radar):
    radar, rng = replace_modulation(radar, STAGGERED_MODULATION), np.random.default_rng(3)
    tones, principal_hz, _ = draw_echo_tones(radar, rng.uniform(-20, 20, 500), 100.0, rng)
    incoherent = tones.amplitude * np.exp(2j * np.pi * rng.random(tones.amplitude.shape))
    hypotheses = by_ramps.ambiguity_probabilities(
        incoherent, radar.frame, principal_hz, np.full(500, 100.0), np.ones(500)
    )
    assert np.isfinite(hypotheses.certain_ambiguity_numbers_or_nan).mean() < 0.05


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
def test_rejects_invalid_modulation(radar, member, settings, expected):
    with pytest.raises(dc.InvalidSetting, match=expected) as error:
        replace_modulation(radar, member(**settings))
    # Contradictions to the frame are reported for the frame, whose setting has a line in a file.
    assert error.value.mistakes[0].setting.startswith((member.__name__, "Frame.modulation."))

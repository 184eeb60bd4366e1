"""WAV files of a sound-card radar with triangular ramps, which observes a walker."""

import wave

import numpy as np

import dechirp as dc
from dechirp.core.units import SPEED_OF_LIGHT

RATE_HZ, RAMP_S, PERIOD_S = 16000, 20e-3, 41.1e-3
START_HZ, BANDWIDTH_HZ = 2.41e9, 87e6
"""Cells of 1.72 m, velocities modulo 1.49 m/s, and ranges by 0.84 m with each of them."""
RADAR = dc.Radar(
    frame=dc.Frame(
        chirp=dc.Chirp(
            start_frequency_hz=START_HZ,
            slope_hz_per_s=BANDWIDTH_HZ / RAMP_S,
            sample_rate_hz=RATE_HZ,
            n_samples=round(RAMP_S * RATE_HZ),
            ramp_duration_s=RAMP_S,
            sampling="real",
        ),
        n_chirps=1,
        interval_s=PERIOD_S,
    ),
    array=dc.Array(rx_m=((0.0, 0.0, 0.0),)),
)


def walker_range_m(time_s):
    """Return the range of a person who walks away, turns and comes back, 1 m/s in the mean."""
    steps_m = 0.015 * np.sin(2 * np.pi * 1.8 * time_s)
    return 4 + 8 * np.sin(np.pi * time_s / 16) ** 2 + steps_m


def record_triangle(path, range_m, *, inverted, tones=()):
    """Write beat signal and sync of a static echo and a target, over rising and falling ramps.

    `tones` are pairs of frequency and amplitude of tones that are independent of the ramps.
    """
    rng, time_s = np.random.default_rng(4), np.arange(16 * RATE_HZ) / RATE_HZ
    phase = (time_s / PERIOD_S + 0.3) % 1
    rises = phase < 0.5
    in_ramp_s = np.where(rises, phase, phase - 0.5) * PERIOD_S
    slope = BANDWIDTH_HZ / RAMP_S
    end_hz = START_HZ + slope * PERIOD_S / 2
    sent_hz = np.where(rises, START_HZ + slope * in_ramp_s, end_hz - slope * in_ramp_s)
    beat = 0.01 * rng.normal(size=time_s.size)
    for echo_m, amplitude in ((20.0, 0.3), (range_m(time_s), 0.03)):
        beat += amplitude * np.cos(4 * np.pi * sent_hz * echo_m / SPEED_OF_LIGHT)
    for frequency_hz, amplitude in tones:
        beat += amplitude * np.cos(2 * np.pi * frequency_hz * time_s + 1.0)
    sign = -1 if inverted else 1
    channels = sign * np.stack([beat, np.where(rises, 0.8, -0.8)], axis=1)
    with wave.open(str(path), "wb") as file:
        file.setnchannels(2)
        file.setsampwidth(2)
        file.setframerate(RATE_HZ)
        file.writeframes((channels * 32000).astype("<i2").tobytes())

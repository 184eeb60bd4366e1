"""Ramps of a triangle in a WAV file: the ranges of a walker show which ones rise."""

import wave

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.experiments.scenario import RecordingSource

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


def record_triangle(path, range_m, *, inverted):
    """Write beat signal and sync of a static echo and a target, over rising and falling ramps."""
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
    sign = -1 if inverted else 1
    channels = sign * np.stack([beat, np.where(rises, 0.8, -0.8)], axis=1)
    with wave.open(str(path), "wb") as file:
        file.setnchannels(2)
        file.setsampwidth(2)
        file.setframerate(RATE_HZ)
        file.writeframes((channels * 32000).astype("<i2").tobytes())


@pytest.mark.parametrize("inverted", [False, True])
def test_velocities_have_the_sign_of_range_rates_in_either_polarity(tmp_path, inverted):
    path = tmp_path / "walk.wav"
    record_triangle(path, walker_range_m, inverted=inverted)

    result = dc.run(dc.Scenario(radar=RADAR, recording=RecordingSource(path=str(path))))

    walker = result.detections.isel(
        detection=np.flatnonzero(np.isfinite(result.detections.ambiguity_number.values))
    )
    walker = walker.isel(detection=np.flatnonzero(walker.moving.values == 1))
    assert walker.sizes["detection"] >= 15
    step_s = 0.16  # half of a frame, over which velocities are means
    rate = (walker_range_m(walker.time + step_s) - walker_range_m(walker.time - step_s)) / (
        2 * step_s
    )
    assert abs(walker.velocity - rate).max() < 0.4  # half a span is 0.75 m/s
    assert abs(walker.range - walker_range_m(walker.time)).max() < 0.4  # a number is 0.84 m
    chosen = [str(f) for f in result.findings if "chosen --encoding" in str(f)]
    assert len(chosen) == (not inverted)
    assert result.scenario.recording.encoding == (None if inverted else "upright")


def test_ranges_that_fit_neither_ramp_keep_the_assumed_polarity(tmp_path):
    path = tmp_path / "still.wav"
    record_triangle(path, lambda time_s: 9 + 0.02 * np.sin(2 * np.pi * time_s), inverted=False)

    result = dc.run(dc.Scenario(radar=RADAR, recording=RecordingSource(path=str(path))))

    assert result.scenario.recording.encoding is None
    assert not any("velocities have the wrong sign:" in str(f) for f in result.findings)


def test_given_encoding_is_kept_with_a_warning(tmp_path):
    path = tmp_path / "walk.wav"
    record_triangle(path, walker_range_m, inverted=False)
    source = RecordingSource(path=str(path), encoding="inverted")

    result = dc.run(dc.Scenario(radar=RADAR, recording=source))

    assert result.scenario.recording.encoding == "inverted"
    (warning,) = (f for f in result.findings if "velocities have the wrong sign:" in str(f))
    assert warning.level == "warning"

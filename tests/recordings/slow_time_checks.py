"""Slow-time checks of real recordings: breathing, a vibrating pipe and a walk."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.ndimage import median_filter

from dechirp.core.findings import PhysicsWarning
from dechirp.processing.slow_time import (
    displacement,
    displacement_spectrum,
    frame_means,
    range_track,
    slow_time,
    strongest_oscillation,
)
from recordings.real_recordings import open_real_recording


def measure_breathing(folder: Path) -> xr.Dataset:
    """Measure the strongest oscillation between 0.1 and 1 Hz at 0.327 m, by receiver."""
    recording = open_real_recording(folder, "RadarIfxAvian_00")
    trace = frame_means(slow_time(recording.cube, recording.radar, 0.327))
    with pytest.warns(PhysicsWarning, match="1%"):  # the person shifts once
        displacement_m = displacement(trace, recording.radar)
    return strongest_oscillation(displacement_spectrum(displacement_m), (0.1, 1.0))


def check_breathing_rate(folder: Path) -> None:
    # 19.8 s resolve 0.05 Hz; regular breathing of 2 mm is measured to a tenth of that
    line = measure_breathing(folder)
    np.testing.assert_allclose(line.frequency, 0.24, atol=0.01)
    assert (line.amplitude > 1e-3).all() and (line.amplitude < 5e-3).all()


def check_receivers_agree_on_breathing(folder: Path) -> None:
    assert np.ptp(measure_breathing(folder).frequency.values) < 0.01


def measure_vibration(folder: Path, name: str) -> xr.Dataset:
    """Measure the strongest oscillation above 25 Hz at 2.15 m, in the strongest channel."""
    recording = open_real_recording(folder, name)
    trace = slow_time(recording.cube, recording.radar, 2.15)
    spectrum = displacement_spectrum(displacement(trace, recording.radar))
    strongest = int(abs(trace).mean("time").argmax("channel"))
    return strongest_oscillation(spectrum, (25.0, 499.0)).isel(channel=strongest)


def check_pipe_vibration(folder: Path) -> None:
    powered, unpowered = (
        measure_vibration(folder, name) for name in ("vibration_2.bin", "no_vibration_2.bin")
    )
    assert float(powered.frequency) == pytest.approx(152.5, abs=1)
    assert float(powered.amplitude) == pytest.approx(2.4e-6, abs=0.3e-6)
    assert powered.amplitude > 10 * powered.floor
    # 474 noise bins reach 3.4 times their median; the largest of this recording is 3.1
    assert (
        unpowered.amplitude < 4 * unpowered.floor and unpowered.amplitude < 0.1 * powered.amplitude
    )


def check_range_and_phase_agree(folder: Path) -> None:
    recording = open_real_recording(folder, "giulioCammina.json")
    track = range_track(recording.cube, recording.radar, (0.35, 0.95))
    times_s = track.time.values
    range_track_m = median_filter(track.values, 63)  # 1 s
    trace = slow_time(recording.cube, recording.radar, range_track_m)
    with pytest.warns(PhysicsWarning, match="1%"):  # after 52 s the trace is disturbed
        phase_displacement_m = displacement(trace, recording.radar).values[:, 0]

    def measure_change(values: np.ndarray, first_s: float, last_s: float) -> float:
        first, last = (
            np.median(values[abs(times_s - time_s) < 0.5]) for time_s in (first_s, last_s)
        )
        return float(last - first)

    for ends_s in ((0, 10), (10, 20), (20, 30), (35, 45), (45, 50)):
        range_change_m, phase_change_m = (
            measure_change(range_track_m, *ends_s),
            measure_change(phase_displacement_m, *ends_s),
        )
        assert range_change_m / phase_change_m == pytest.approx(1, abs=0.1), ends_s

"""What the phase over slow time tells in real recordings: breath, a shaking pipe, a walk."""

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
from recordings.opened import opened


def breath(folder: Path) -> xr.Dataset:
    """The strongest movement between 0.1 and 1 Hz of the person at 0.327 m, by receiver."""
    recording = opened(folder, "RadarIfxAvian_00")
    trace = frame_means(slow_time(recording.cube, recording.radar, 0.327))
    with pytest.warns(PhysicsWarning, match="1%"):  # where the person shifts, once
        moved = displacement(trace, recording.radar)
    return strongest_oscillation(displacement_spectrum(moved), (0.1, 1.0))


def somebody_breathes(folder: Path) -> None:
    # 19.8 s: lines are told apart by 0.05 Hz, and measured to a tenth of that by a breath of
    # 2 mm that is regular
    line = breath(folder)
    np.testing.assert_allclose(line.frequency, 0.24, atol=0.01)
    assert (line.amplitude > 1e-3).all() and (line.amplitude < 5e-3).all()


def all_receivers_see_one_breath(folder: Path) -> None:
    assert np.ptp(breath(folder).frequency.values) < 0.01


def shaking(folder: Path, name: str) -> xr.Dataset:
    """The strongest line above 25 Hz of the pipe at 2.15 m, where it is strongest."""
    recording = opened(folder, name)
    trace = slow_time(recording.cube, recording.radar, 2.15)
    spectrum = displacement_spectrum(displacement(trace, recording.radar))
    strongest = int(abs(trace).mean("time").argmax("channel"))
    return strongest_oscillation(spectrum, (25.0, 499.0)).isel(channel=strongest)


def a_pipe_shakes_only_while_the_device_is_on(folder: Path) -> None:
    on, off = (shaking(folder, name) for name in ("vibration_2.bin", "no_vibration_2.bin"))
    assert float(on.frequency) == pytest.approx(152.5, abs=1)
    assert float(on.amplitude) == pytest.approx(2.4e-6, abs=0.3e-6)
    assert on.amplitude > 10 * on.floor
    # 474 bins of noise reach 3.4 times their median; the largest here 3.1
    assert off.amplitude < 4 * off.floor and off.amplitude < 0.1 * on.amplitude


def range_and_phase_tell_the_same_walk(folder: Path) -> None:
    recording = opened(folder, "giulioCammina.json")
    track = range_track(recording.cube, recording.radar, (0.35, 0.95))
    times_s = track.time.values
    followed_m = median_filter(track.values, 63)  # a second
    trace = slow_time(recording.cube, recording.radar, followed_m)
    with pytest.warns(PhysicsWarning, match="1%"):  # after 52 s the trace is disturbed
        moved_m = displacement(trace, recording.radar).values[:, 0]

    def change(of: np.ndarray, first_s: float, last_s: float) -> float:
        first, last = (np.median(of[abs(times_s - at) < 0.5]) for at in (first_s, last_s))
        return float(last - first)

    for ends_s in ((0, 10), (10, 20), (20, 30), (35, 45), (45, 50)):
        by_range, by_phase = change(followed_m, *ends_s), change(moved_m, *ends_s)
        assert by_range / by_phase == pytest.approx(1, abs=0.1), ends_s

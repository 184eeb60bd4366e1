"""Tones that are independent of the ramps: found, subtracted, and told from echoes."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.experiments.scenario import RecordingSource
from dechirp.recordings.recording import open as open_recording
from nightly import nightly
from recordings.triangle_wav import RADAR, record_triangle, walker_range_m

TONES = ((1000.05, 0.01), (2000.1, 0.01), (5000.25, 0.003))
"""Frequencies (Hz) and amplitudes; as echoes at 34.5, 68.9 and 172 m."""


def passer_range_m(time_s):
    """Return the range of a walker who passes 34.5 m twice."""
    return walker_range_m(time_s) + 24


def find_tones_hz(path):
    tones = open_recording(path, radar=RADAR).contents.tones
    assert tones is not None
    return tones.frequencies_hz


def test_tones_are_found_with_their_frequency(tmp_path):
    record_triangle(tmp_path / "walk.wav", walker_range_m, inverted=True, tones=TONES)

    frequencies_hz = find_tones_hz(tmp_path / "walk.wav")

    # A bin is 0.49 Hz; the parabola through a Hann window's main lobe is accurate to 0.05 of it.
    assert np.allclose(frequencies_hz, [tone[0] for tone in TONES], atol=0.03)


@pytest.mark.parametrize(
    "range_m",
    [
        walker_range_m,
        lambda time_s: 30 + 0.005 * np.sin(2 * np.pi * 7.3 * time_s),  # a fan
        lambda time_s: 60 - 2.9 * time_s,
        lambda time_s: np.full(time_s.shape, 12.3),
    ],
)
def test_echoes_are_no_tones(tmp_path, range_m):
    record_triangle(tmp_path / "echo.wav", range_m, inverted=True)

    assert find_tones_hz(tmp_path / "echo.wav").size == 0


@nightly
def test_run_shows_no_targets_at_tones_and_keeps_targets_there(tmp_path):
    for name, tones in (("plain", ()), ("tones", TONES)):
        record_triangle(tmp_path / f"{name}.wav", passer_range_m, inverted=True, tones=tones)

    def moving_ranges(name: str, **options: bool) -> tuple[np.ndarray, np.ndarray, list[str]]:
        source = RecordingSource(path=str(tmp_path / f"{name}.wav"), **options)
        result = dc.run(dc.Scenario(radar=RADAR, recording=source))
        rows = result.detections.moving.values == 1
        notes = [str(finding) for finding in result.findings if "tones at" in str(finding)]
        return result.detections.range.values[rows], result.detections.frame.values[rows], notes

    plain_m, plain_frames, no_notes = moving_ranges("plain")
    range_m, frames, notes = moving_ranges("tones")
    kept_m, _, _ = moving_ranges("tones", repair_faults=False)

    # False targets, if samples stay as recorded.
    assert np.count_nonzero(kept_m > 60) >= 20
    assert np.count_nonzero(range_m > 60) <= np.count_nonzero(plain_m > 60)
    near_frames, plain_near_frames = (
        set(numbers[abs(ranges_m - 34.5) < tolerance_m].tolist())
        # An ambiguity number that is resolved in one of both shifts the range by 0.84 m.
        for ranges_m, numbers, tolerance_m in ((range_m, frames, 2.7), (plain_m, plain_frames, 1.8))
    )
    assert len(plain_near_frames) >= 8
    assert plain_near_frames <= near_frames  # the walker stays
    assert not no_notes
    (note,) = notes
    assert "tones at 1000, 2000, 5000 Hz" in note and "34.5" in note

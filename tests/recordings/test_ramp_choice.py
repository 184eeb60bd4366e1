"""Ramps of a triangle in a WAV file: the ranges of a walker show which ones rise."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.experiments.scenario import RecordingSource
from nightly import nightly
from recordings.triangle_wav import RADAR, record_triangle, walker_range_m


@nightly
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

"""Findings of `inspect` on real recordings: known defects, and no false warnings."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from dechirp.processing.quality.findings import recording_findings
from dechirp.processing.quality.measures import measure_frame_quality
from dechirp.recordings.recording import open as open_recording
from nightly import nightly
from recordings.real_recordings import RECORDINGS, open_real_recording

# Chirp 0 of both captures starts with a settling transient.
# The collection measured an image of about -5 dB in the SiRad walk, and found that the
# spectrum of the turntable is its own mirror image: one mixer, with phases calibrated.
EXPECTED_WARNINGS = {
    "20180613-190347.bin": {"recording.interference"},
    "20181128-214451.bin": {"recording.interference", "recording.ghost"},
    "giulioCammina.json": {"recording.iq_image"},
    **{key: {"recording.iq"} for key in RECORDINGS["mimo12_known_angles_mat"]},
}


@pytest.mark.parametrize(
    ("folder", "name"), [(folder, name) for folder, names in RECORDINGS.items() for name in names]
)
def test_warnings_match_known_defects(real_data, folder, name):
    recording = open_real_recording(real_data / folder, name)
    findings = recording.findings
    if recording.sizes:
        measures = [measure_frame_quality(frame, recording.radar) for frame in recording.frames()]
        findings += recording_findings(xr.concat(measures, "frame"), recording.radar)

    assert {f.setting for f in findings if f.level == "warning"} == EXPECTED_WARNINGS.get(
        name, set()
    )


def open_walk(folder, n_chirps):
    path = folder / "sirad122_walk" / "giulioCammina.json"
    radar = open_recording(path).radar
    return open_recording(path, radar=replace(radar, frame=replace(radar.frame, n_chirps=n_chirps)))


def test_iq_image_of_real_mixer_has_measured_strength(real_data):
    recording = open_walk(real_data, 3536)

    image = measure_frame_quality(recording.cube, recording.radar)["image"].item()

    # A power ratio of 3.2 of the two sides over the whole walk, by the script of the collection.
    assert 1 / image == pytest.approx(3.2, rel=0.15)


@nightly
def test_iq_image_of_real_mixer_follows_delay_of_half_sample(real_data):
    recording = open_walk(real_data, 16)
    radar = recording.radar
    frames = recording.frames()
    measures = xr.concat([measure_frame_quality(frame, radar) for frame in frames], "frame")
    known = measures.isel(frame=np.flatnonzero(np.isfinite(measures.image.values[:, 0])))

    # I and Q sampled a time T apart have a phase error of 2 pi f T, and so an image of
    # tan^2(pi f T): 1/4.2 to 1/1.6 while the person walks from 0.50 to 0.74 m and back, where the
    # mean depends on the weights. One ADC that alternates between I and Q has T of half a sample.
    frequency_hz = radar.frame.chirp.beat_frequency_hz(known.image_range.values)
    delay_s = np.arctan(np.sqrt(known.image.values[:, 0])) / (np.pi * frequency_hz)
    delay_samples = delay_s * radar.frame.chirp.sample_rate_hz
    # Frequencies are known to half a bin of 8 to 13, 6 %. The walk crosses five bins, so that the
    # rounding averages to 1 %. The median of 221 frames is 0.51 samples.
    assert np.median(delay_samples) == pytest.approx(0.5, rel=0.05)
    assert np.mean(abs(delay_samples / 0.5 - 1) < 0.2) > 0.95
    # The last 23 frames, disturbed, have no distinct echo.
    assert known.sizes["frame"] > 0.85 * measures.sizes["frame"]

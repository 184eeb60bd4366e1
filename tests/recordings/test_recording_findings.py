"""Findings of `inspect` on real recordings: known defects, and no false warnings."""

import numpy as np
import pytest
import xarray as xr

from dechirp.processing.quality.findings import recording_findings
from dechirp.processing.quality.measures import measure_frame_quality
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


def test_iq_image_of_real_mixer_has_measured_strength(real_data):
    recording = open_real_recording(real_data / "sirad122_walk", "giulioCammina.json")

    frames = recording.frames()
    images = [measure_frame_quality(frame, recording.radar)["image"] for frame in frames]
    image = np.nanmedian(images)  # unknown in the frames without a distinct echo

    # A power ratio of 3.2 of the two sides, by the script of the collection.
    assert 1 / image == pytest.approx(3.2, rel=0.15)

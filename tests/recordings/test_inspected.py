"""What `inspect` says of real recordings: what is wrong with them, and nothing of the others."""

import pytest
import xarray as xr

from dechirp.processing.quality.findings import recording_findings
from dechirp.processing.quality.measures import measure_frame
from recordings.opened import RECORDINGS, opened

# Chirp 0 of both settles: its first samples hold a transient. In 190347 as much energy lies
# at negative beat frequencies as at positive ones, so that the order of I and Q is a guess.
# The collection measured an image of about -5 dB in the SiRad walk, and found that the
# spectrum of the turntable is its own mirror image: one mixer, with phases calibrated.
WRONG = {
    "20180613-190347.bin": {"iq", "recording.interference"},
    "20181128-214451.bin": {"recording.interference", "recording.ghost"},
    "giulioCammina.json": {"recording.iq_image"},
    **{key: {"recording.iq"} for key in RECORDINGS["mimo12_known_angles_mat"]},
}


@pytest.mark.parametrize(
    ("folder", "name"), [(folder, name) for folder, names in RECORDINGS.items() for name in names]
)
def test_warnings_are_given_of_what_is_wrong_and_of_nothing_else(real_data, folder, name):
    recording = opened(real_data / folder, name)
    said = recording.findings
    if recording.sizes:
        measures = [measure_frame(frame, recording.radar) for frame in recording.frames()]
        said += recording_findings(xr.concat(measures, "frame"), recording.radar)

    assert {f.setting for f in said if f.level == "warning"} == WRONG.get(name, set())


def test_the_image_of_a_real_mixer_is_as_strong_as_it_was_measured(real_data):
    recording = opened(real_data / "sirad122_walk", "giulioCammina.json")

    image = measure_frame(recording.cube, recording.radar)["image"].item()

    # A power ratio of 3.2 of the two sides, by the script of the collection.
    assert 1 / image == pytest.approx(3.2, rel=0.15)

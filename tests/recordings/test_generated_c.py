"""Generated C on frames of real recordings: every word and every detection equals Python's."""

import pytest

from dechirp.processing.chain import Chain
from dechirp.processing.fixed_point.lookup_tables import pad_to_powers_of_two
from dechirp.processing.fixed_point.word_lengths import WordLengths
from generators.compiled_c import compare_compiled_c_with_model
from nightly import nightly
from recordings.real_recordings import RECORDINGS, open_real_recording

CASES = [
    (folder, names[0])
    for folder, names in RECORDINGS.items()
    if folder != "uart_tlv_awr2944"  # detections without samples
]


@nightly
@pytest.mark.parametrize(("folder", "name"), [*CASES, ("xwr1443_known_angles", "az_30.raw")])
def test_every_word_equals_model_in_real_frame(real_data, tmp_path, folder, name):
    recording = open_real_recording(real_data / folder, name)
    radar = recording.radar.for_frame(0)
    frame = next(iter(recording.frames())).isel(frame=0)
    chain = pad_to_powers_of_two(Chain(), radar).fit_to_radar(radar)
    assert compare_compiled_c_with_model(tmp_path, frame, radar, chain, WordLengths()) > 6000

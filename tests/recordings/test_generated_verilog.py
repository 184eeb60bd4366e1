"""Generated Verilog on frames of real recordings: every word and detection equals Python's."""

import pytest

from dechirp.processing.chain import Chain
from dechirp.processing.fixed_point.lookup_tables import pad_to_powers_of_two
from dechirp.processing.fixed_point.word_lengths import WordLengths
from generators.simulated_verilog import compare_simulated_verilog_with_model
from nightly import nightly
from recordings.real_recordings import open_real_recording


# Samples of 12 bits, real, of three receivers; and complex ones of two transmitters in turn.
@nightly
@pytest.mark.parametrize("scaling", ["block", "halving"])
@pytest.mark.parametrize(
    ("folder", "name"),
    [("bgt60_two_reflectors", "RadarIfxAvian_00"), ("xwr1443_known_angles", "az_30.raw")],
)
def test_every_word_equals_model_in_real_frame(real_data, tmp_path, folder, name, scaling):
    recording = open_real_recording(real_data / folder, name)
    radar = recording.radar.for_frame(0)
    frame = next(iter(recording.frames())).isel(frame=0)
    chain = pad_to_powers_of_two(Chain(), radar).fit_to_radar(radar)
    compare_simulated_verilog_with_model(
        tmp_path, frame, radar, chain, WordLengths(scaling=scaling, range_bits=18, doppler_bits=18),
        stall_percent=10, in_verilator=True,
    )  # fmt: skip

"""Real radars, real rooms: the chain finds what is known to be in front of them.

What is known is in the README of each recording; tolerances are a range bin and a velocity
bin of the radar, unless the README gives a wider one.
"""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from dechirp.cli.main import main
from dechirp.processing.cfar.base import Cells, Cfar
from dechirp.processing.cfar.cell_averaging import CellAveraging
from dechirp.processing.chain import Chain
from dechirp.processing.detect import detect
from dechirp.recordings.recording import Recording
from dechirp.recordings.recording import open as open_recording

OPENRADAR = Path(__file__).parents[2] / "examples" / "radar.yaml"


def found_in(recording: Recording, chain: Chain | None = None) -> xr.Dataset:
    """List the detections of the whole recording, strongest first."""
    found = detect(recording.cube, recording.radar, chain)
    return found.sortby("snr", ascending=False)


def where(found: xr.Dataset, condition: xr.DataArray) -> xr.Dataset:
    return found.isel(detection=np.flatnonzero(condition))


def openradar(real_data, name, axes) -> Recording:
    return open_recording(
        real_data / "openradar_people" / name,
        radar=OPENRADAR,
        axes=axes,
        encoding="uint16-wrapped",
    )


@pytest.fixture(scope="module")
def one_person(real_data) -> Recording:
    return openradar(real_data, "simple_frame_1.npy", ["chirp", "sample"])


@pytest.fixture(scope="module")
def two_people(real_data) -> Recording:
    return openradar(real_data, "doppler_example_1.npy", ["chirp", "rx", "sample"])


def test_a_person_comes_closer_at_two_metres(one_person):
    found = found_in(one_person)
    velocity_bin = one_person.radar.frame.velocity_resolution_m_per_s

    strongest = where(found, abs(found.velocity) > 2 * velocity_bin).isel(detection=0)

    assert float(strongest.range) == pytest.approx(1.95, abs=0.1)
    # The frame holds every second chirp, those of one transmitter. So their interval is
    # 184 us; with the 92 us from any chirp to the next the speed would come out as 1.29.
    assert float(strongest.velocity) == pytest.approx(-0.65, abs=velocity_bin)


def test_the_far_reflector_of_the_room_stands_still(one_person):
    found = found_in(one_person)
    velocity_bin = one_person.radar.frame.velocity_resolution_m_per_s

    # The strongest beyond the coupling between the antennas, which is in the first bins.
    strongest = where(found, found.range > 0.2).isel(detection=0)

    assert float(strongest.range) == pytest.approx(5.2, abs=0.4)
    assert float(strongest.velocity) == pytest.approx(0, abs=velocity_bin / 2)


def test_two_people_at_one_range_pass_each_other(two_people):
    found = found_in(two_people)
    frame = two_people.radar.frame
    range_bin, velocity_bin = frame.chirp.range_resolution_m, frame.velocity_resolution_m_per_s

    receding = where(found, found.velocity > 2 * velocity_bin).isel(detection=0)
    approaching = where(found, found.velocity < -2 * velocity_bin).isel(detection=0)

    assert float(receding.range) == pytest.approx(2.93, abs=range_bin)
    assert float(receding.velocity) == pytest.approx(0.56, abs=velocity_bin)
    # Body and limbs move differently: 2.93 to 2.98 m, -0.48 to -0.81 m/s.
    assert 2.93 - range_bin < float(approaching.range) < 2.98 + range_bin
    assert -0.81 - velocity_bin < float(approaching.velocity) < -0.48 + velocity_bin


@pytest.mark.parametrize("name", ["vibration_2", "no_vibration_2"])
def test_the_pipe_is_the_strongest_echo(real_data, name):
    recording = open_recording(real_data / "awr1642_vibrating_pipe" / f"{name}.bin")

    strongest = found_in(recording).isel(detection=0)

    frame = recording.radar.frame
    assert float(strongest.range) == pytest.approx(2.15, abs=frame.chirp.range_resolution_m)
    assert abs(float(strongest.velocity)) < frame.velocity_resolution_m_per_s / 2


@pytest.mark.parametrize("name", ["vibration_2", "no_vibration_2"])
def test_echoes_of_the_pipe_lie_at_positive_beat_frequencies(real_data, name):
    file = real_data / "awr1642_vibrating_pipe" / f"{name}.bin"
    samples = open_recording(file).cube.values

    spectrum = np.fft.fft(samples - samples.mean(axis=-1, keepdims=True), axis=-1)
    energy = np.sum(abs(spectrum) ** 2, axis=(0, 1, 2))

    # The rest is noise, and the lower sidelobes of the coupling next to DC.
    assert energy[1:128].sum() > 0.99 * energy.sum()
    swapped = open_recording(file, iq="qi")
    assert [finding.setting for finding in swapped.findings if finding.level == "warning"] == ["iq"]


def test_frames_of_one_chirp_are_the_chirps_of_one_frame(real_data):
    recording = open_recording(real_data / "awr1642_vibrating_pipe" / "vibration_2.bin")

    assert recording.cube.sizes == {"frame": 1, "chirp": 1000, "rx": 4, "sample": 256}
    assert recording.radar.frame.interval_s == pytest.approx(1e-3)
    assert recording.radar.frame.chirp.start_frequency_hz == pytest.approx(77e9, rel=1e-6)
    assert recording.radar.frame.chirp.slope_hz_per_s == pytest.approx(29.982e12, rel=1e-4)
    assert "radar.frame.n_chirps" in [finding.setting for finding in recording.findings]


def test_two_reflectors_are_two_in_every_frame(real_data):
    recording = open_recording(real_data / "bgt60_two_reflectors")
    # Reflectors and clutter all stand still. So compare a cell with others that stand still:
    # its own row, just outside the window's main lobe (2 cells). The reflectors are 27 dB
    # over those neighbours, the next highest place 9 dB; any offset from 15 to 26 dB gives
    # the same two. (The default ring, along both axes, finds them as well, and beyond 0.85 m
    # or below 0.2 m one thing more in 4 of the 64 frames.)
    chain = Chain(
        cfar=Cfar(
            estimator=CellAveraging(),
            n_training=Cells(range=2, velocity=0),
            n_guard=Cells(range=2, velocity=0),
            offset=100.0,  # 20 dB
        )
    )

    found = found_in(recording, chain)
    inside = where(found, (found.range > 0.2) & (found.range < 0.85)).sortby(["frame", "range"])

    frame = recording.radar.frame
    assert np.bincount(inside.frame, minlength=64).tolist() == [2] * 64
    assert np.max(abs(inside.velocity)) < frame.velocity_resolution_m_per_s / 2
    range_bin = frame.chirp.range_resolution_m
    assert inside.range.values[0::2] == pytest.approx(0.300, abs=range_bin)
    assert inside.range.values[1::2] == pytest.approx(0.457, abs=range_bin)


def test_a_changed_radar_keeps_the_order_of_i_and_q_of_its_log(real_data, tmp_path, capsys):
    capture = real_data / "awr1642_vibrating_pipe" / "vibration_2.bin"
    words = ["run", str(capture), "--set", "radar.frame.chirp.adc_start=5 us", "--json"]
    with pytest.raises(SystemExit) as ended:
        main([*words, "--out", str(tmp_path / "out")])

    assert ended.value.code == 0
    document = json.loads(capsys.readouterr().out)
    assert not [finding for finding in document["findings"] if finding["setting"] == "iq"]
    strongest = max(document["detections"], key=lambda row: row["snr_db"])
    assert strongest["range_m"] == pytest.approx(2.15, abs=0.1)

"""Detections in real recordings, compared with the known targets in front of the radars.

The README of each recording gives the targets; tolerances are a range bin and a velocity bin
of the radar, unless the README gives a wider one.
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
from dechirp.processing.range_doppler_map import power_map
from dechirp.recordings.recording import Recording
from dechirp.recordings.recording import open as open_recording
from nightly import nightly

OPENRADAR = Path(__file__).parents[2] / "examples" / "radar.yaml"


def detect_sorted(recording: Recording, chain: Chain | None = None) -> xr.Dataset:
    """List the detections of the whole recording, strongest first."""
    detections = detect(recording.cube, recording.radar, chain)
    return detections.sortby("snr", ascending=False)


def select_detections(detections: xr.Dataset, condition: xr.DataArray) -> xr.Dataset:
    return detections.isel(detection=np.flatnonzero(condition))


def open_openradar(real_data, name, axes) -> Recording:
    return open_recording(
        real_data / "openradar_people" / name,
        radar=OPENRADAR,
        axes=axes,
        encoding="uint16-wrapped",
    )


@pytest.fixture(scope="module")
def one_person(real_data) -> Recording:
    return open_openradar(real_data, "simple_frame_1.npy", ["chirp", "sample"])


@pytest.fixture(scope="module")
def two_people(real_data) -> Recording:
    return open_openradar(real_data, "doppler_example_1.npy", ["chirp", "rx", "sample"])


def test_approaching_person_is_at_two_metres(one_person):
    detections = detect_sorted(one_person)
    velocity_bin = one_person.radar.frame.velocity_resolution_m_per_s

    strongest = select_detections(detections, abs(detections.velocity) > 2 * velocity_bin).isel(
        detection=0
    )

    assert float(strongest.range) == pytest.approx(1.95, abs=0.1)
    # The frame holds every second chirp, those of one transmitter. Their interval is therefore
    # 184 us; an interval of 92 us would give 1.29 m/s.
    assert float(strongest.velocity) == pytest.approx(-0.65, abs=velocity_bin)


def test_far_reflector_has_zero_velocity(one_person):
    detections = detect_sorted(one_person)
    velocity_bin = one_person.radar.frame.velocity_resolution_m_per_s

    # Strongest detection beyond the antenna coupling, which occupies the first bins.
    strongest = select_detections(detections, detections.range > 0.2).isel(detection=0)

    assert float(strongest.range) == pytest.approx(5.2, abs=0.4)
    assert float(strongest.velocity) == pytest.approx(0, abs=velocity_bin / 2)


def test_two_people_at_equal_range_have_opposite_velocities(two_people):
    detections = detect_sorted(two_people)
    frame = two_people.radar.frame
    range_bin, velocity_bin = frame.chirp.range_resolution_m, frame.velocity_resolution_m_per_s

    receding = select_detections(detections, detections.velocity > 2 * velocity_bin).isel(
        detection=0
    )
    approaching = select_detections(detections, detections.velocity < -2 * velocity_bin).isel(
        detection=0
    )

    assert float(receding.range) == pytest.approx(2.93, abs=range_bin)
    assert float(receding.velocity) == pytest.approx(0.56, abs=velocity_bin)
    # Body and limbs move differently: 2.93 to 2.98 m, -0.48 to -0.81 m/s.
    assert 2.93 - range_bin < float(approaching.range) < 2.98 + range_bin
    assert -0.81 - velocity_bin < float(approaching.velocity) < -0.48 + velocity_bin


@pytest.mark.parametrize("name", ["vibration_2", "no_vibration_2"])
def test_pipe_is_strongest_echo(real_data, name):
    recording = open_recording(real_data / "awr1642_vibrating_pipe" / f"{name}.bin")

    strongest = detect_sorted(recording).isel(detection=0)

    frame = recording.radar.frame
    assert float(strongest.range) == pytest.approx(2.15, abs=frame.chirp.range_resolution_m)
    assert abs(float(strongest.velocity)) < frame.velocity_resolution_m_per_s / 2


@pytest.mark.parametrize("name", ["vibration_2", "no_vibration_2"])
def test_pipe_echoes_have_positive_beat_frequencies(real_data, name):
    file = real_data / "awr1642_vibrating_pipe" / f"{name}.bin"
    samples = open_recording(file).cube.values

    spectrum = np.fft.fft(samples - samples.mean(axis=-1, keepdims=True), axis=-1)
    energy = np.sum(abs(spectrum) ** 2, axis=(0, 1, 2))

    # Noise and the lower sidelobes of the coupling near DC make up the rest.
    assert energy[1:128].sum() > 0.99 * energy.sum()
    swapped_recording = open_recording(file, iq="qi")
    assert [
        finding.setting for finding in swapped_recording.findings if finding.level == "warning"
    ] == ["iq"]


def test_single_chirp_frames_are_merged(real_data):
    recording = open_recording(real_data / "awr1642_vibrating_pipe" / "vibration_2.bin")

    # At most 0.3 s and 256 chirps, of which none is left out.
    assert recording.cube.sizes == {"frame": 4, "chirp": 250, "rx": 4, "sample": 256}
    assert recording.radar.frame.interval_s == pytest.approx(1e-3)
    assert recording.radar.frame.chirp.start_frequency_hz == pytest.approx(77e9, rel=1e-6)
    assert recording.radar.frame.chirp.slope_hz_per_s == pytest.approx(29.982e12, rel=1e-4)
    assert "radar.frame.n_chirps" in [finding.setting for finding in recording.findings]


def test_two_reflectors_are_detected_in_every_frame(real_data):
    recording = open_recording(real_data / "bgt60_two_reflectors")
    # Reflectors and clutter are all static, so the training cells are in the row of the cell
    # under test, just outside the window's main lobe (2 cells). The reflectors are 27 dB above
    # them, the next highest cell 9 dB; any offset from 15 to 26 dB gives the two reflectors.
    # (The default training window, along both axes, also finds them, and one more detection
    # beyond 0.85 m or below 0.2 m in 4 of the 64 frames.)
    chain = Chain(
        cfar=Cfar(
            estimator=CellAveraging(),
            n_training=Cells(range=2, velocity=0),
            n_guard=Cells(range=2, velocity=0),
            offset=100.0,  # 20 dB
        )
    )

    detections = detect_sorted(recording, chain)
    reflectors = select_detections(
        detections, (detections.range > 0.2) & (detections.range < 0.85)
    ).sortby(["frame", "range"])

    frame = recording.radar.frame
    assert np.bincount(reflectors.frame, minlength=64).tolist() == [2] * 64
    assert np.max(abs(reflectors.velocity)) < frame.velocity_resolution_m_per_s / 2
    range_bin = frame.chirp.range_resolution_m
    assert reflectors.range.values[0::2] == pytest.approx(0.300, abs=range_bin)
    assert reflectors.range.values[1::2] == pytest.approx(0.457, abs=range_bin)


@nightly
def test_changed_radar_keeps_iq_order_of_studio_log(real_data, tmp_path, capsys):
    capture = real_data / "awr1642_vibrating_pipe" / "vibration_2.bin"
    arguments = ["run", str(capture), "--set", "radar.frame.chirp.adc_start=5 us", "--json"]
    with pytest.raises(SystemExit) as exit_info:
        main([*arguments, "--out", str(tmp_path / "out")])

    assert exit_info.value.code == 0
    document = json.loads(capsys.readouterr().out)
    assert not [finding for finding in document["findings"] if finding["setting"] == "iq"]
    # The other three are leakage at 0.07 m, 13 dB weaker than the pipe, and static reflectors at
    # 0.65 and 3.63 m, 13 and 2 dB weaker. Their ratios to the noise of their ranges are as high:
    # that of the pipe contains its vibration, 8 dB over the noise elsewhere. Swapped, all are
    # beyond 40 m.
    strongest = sorted(document["detections"], key=lambda row: -row["snr_db"])[:4]
    assert max(row["range_m"] for row in strongest) < 4
    assert min(abs(row["range_m"] - 2.15) for row in strongest) < 0.1


@pytest.mark.parametrize("name", ["vibration_2.bin", "no_vibration_2.bin"])
def test_pipe_is_echo_of_highest_power(real_data, name):
    recording = open_recording(real_data / "awr1642_vibrating_pipe" / name)

    power = power_map(recording.cube.isel(frame=0), recording.radar, Chain())

    strongest = power.isel(power.argmax(("velocity", "range")))
    assert float(strongest.range) == pytest.approx(2.15, abs=0.1)
    assert abs(float(strongest.velocity)) < recording.radar.frame.velocity_resolution_m_per_s

"""Ground truth of the recordings in the collection, as given in their `meta.json` files.

`TRUTHS` has one check per entry, and a test compares it with the files, so that none is missing.
"""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from dechirp.core.errors import RecordingError
from dechirp.processing.angle.fft import Fft
from dechirp.processing.angle.music import Music
from dechirp.processing.cfar.base import Cells, Cfar
from dechirp.processing.cfar.cell_averaging import CellAveraging
from dechirp.processing.chain import Chain
from dechirp.processing.detect import detect
from dechirp.processing.range_doppler_map import power_map
from dechirp.recordings.recording import Recording
from dechirp.recordings.recording import open as open_recording
from dechirp.recordings.settings.read import read_radar
from recordings.directions import detect_reflectors, detect_turntable_reflector
from recordings.real_recordings import KTH, RECORDINGS, open_real_recording
from recordings.slow_time_checks import (
    check_breathing_rate,
    check_pipe_vibration,
    check_range_and_phase_agree,
    check_receivers_agree_on_breathing,
)

Check = Callable[[Path], None]


def compute_padded_map(recording: Recording) -> xr.DataArray:
    """Compute the map of the first frame on a fine range grid, (velocity, range)."""
    chain = Chain(n_range_bins=4096)
    return power_map(next(iter(recording.frames())).isel(frame=0), recording.radar, chain)


def select_moving(detections: xr.Dataset, min_speed_m_per_s: float, *, snr: float) -> xr.Dataset:
    """Select detections above a speed and an SNR, strongest first."""
    is_selected = (abs(detections.velocity) > min_speed_m_per_s) & (detections.snr > snr)
    return detections.isel(detection=np.flatnonzero(is_selected)).sortby("snr", ascending=False)


def check_moving_car(folder: Path) -> None:
    recording = open_real_recording(folder, "20180613-190347.bin")
    frame = recording.radar.frame

    detections = detect(recording.cube, recording.radar)

    # 14.19 m and -12.8 m/s, 31 dB over the median, by the script of the collection.
    cars = select_moving(detections, 2 * frame.velocity_resolution_m_per_s, snr=100)
    assert cars.range.values == pytest.approx([14.19], abs=frame.chirp.range_resolution_m)
    assert cars.velocity.values == pytest.approx([-12.8], abs=frame.velocity_resolution_m_per_s)


def check_ghost_exceeds_echoes(folder: Path) -> None:
    recording = open_real_recording(folder, "20181128-214451.bin")
    power = power_map(recording.cube.isel(frame=0), recording.radar, Chain())

    standing = abs(power.velocity) < 2 * recording.radar.frame.velocity_resolution_m_per_s
    ghost = power.where(~standing, drop=True)
    row, column = np.unravel_index(int(np.argmax(ghost.values)), ghost.shape)

    # Smeared over 2.2 m and 5 m/s; 16 dB above the strongest real return, by the collection.
    assert float(ghost.range[column]) == pytest.approx(27.4, abs=1.1)
    assert float(ghost.velocity[row]) == pytest.approx(24, abs=2.5)
    echoes = power.where(standing, drop=True).sel(range=slice(1.0, None))
    assert 10 * math.log10(float(ghost.max() / echoes.max())) == pytest.approx(16, abs=1.5)


@cache
def detect_people(folder: Path) -> xr.Dataset:
    recording = open_real_recording(folder, "RadarIfxAvian_00")
    detections = detect(recording.cube, recording.radar)
    return select_moving(detections, recording.radar.frame.velocity_resolution_m_per_s, snr=1000)


def check_people_ranges(folder: Path) -> None:
    people = detect_people(folder)

    assert people.sizes["detection"] > 10
    assert float(people.range.min()) > 0.4
    assert float(people.range.max()) < 8


def check_people_speeds(folder: Path) -> None:
    assert float(abs(detect_people(folder).velocity).max()) < 2.5


def check_two_reflectors(folder: Path) -> None:
    recording = open_real_recording(folder, "RadarIfxAvian_00")
    # Training cells along range only: targets and clutter are all static.
    chain = Chain(
        cfar=Cfar(
            estimator=CellAveraging(),
            n_training=Cells(range=2, velocity=0),
            n_guard=Cells(range=2, velocity=0),
            offset=100.0,
        )
    )

    detections = detect(recording.cube, recording.radar, chain)

    frame_numbers = detections.frame.values[
        (detections.range.values > 0.2) & (detections.range.values < 0.85)
    ]
    assert np.bincount(frame_numbers.astype(int), minlength=64).tolist() == [2] * 64


def cancel_static_echoes(recording: Recording) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, ranges and power (time, range) of chirp-to-chirp differences."""
    samples = recording.cube.values.reshape(-1, recording.radar.frame.chirp.n_samples)
    differences = np.diff(samples, axis=0) * np.hanning(samples.shape[1])
    power = abs(np.fft.rfft(differences, 4096, axis=1)) ** 2
    time_s = (np.arange(len(differences)) + 0.5) * recording.radar.frame.interval_s
    return time_s, recording.radar.frame.chirp.range_bins_m(4096), power


def fit_line(time_s: np.ndarray, range_m: np.ndarray) -> float:
    """Return the slope, m/s, of a robust line fit; multipath points are outliers."""
    is_inlier = np.ones(len(range_m), bool)
    for _ in range(10):
        line = np.polyfit(time_s[is_inlier], range_m[is_inlier], 1)
        distances_m = abs(range_m - np.polyval(line, time_s))
        is_inlier = distances_m < max(3, 1.5 * float(np.median(distances_m)))
    return float(line[0])


def make_speed_check(name: str, speed_m_per_s: float, time_span_s: tuple[float, float]) -> Check:
    def check(folder: Path) -> None:
        time_s, range_m, power = cancel_static_echoes(open_real_recording(folder, name))
        in_time = (time_s > time_span_s[0]) & (time_s < time_span_s[1])
        in_range = (range_m > 30) & (range_m < 100)

        track_m = range_m[in_range][power[np.ix_(in_time, in_range)].argmax(axis=1)]

        speed = fit_line(time_s[in_time], track_m)
        assert speed == pytest.approx(-speed_m_per_s, rel=0.2)

    return check


def check_walker_ranges(folder: Path) -> None:
    recording = open_real_recording(folder, "single_target_range.wav")
    assert recording.n_frames == 60  # 486 ramps, 8 to a frame
    time_s, range_m, power = cancel_static_echoes(recording)
    smooth = np.apply_along_axis(np.convolve, 0, power, np.ones(11) / 11, mode="same")
    in_range = (range_m > 1.5) & (range_m < 20)
    track_m = range_m[in_range][smooth[:, in_range].argmax(axis=1)]

    def range_at(when_s: float) -> float:
        return float(np.median(track_m[abs(time_s - when_s) < 0.3]))

    # About 3 m after 1 s, 11 m after 9 s, 4 m after 14.5 s, by the script of the collection.
    range_bin_m = recording.radar.frame.chirp.range_resolution_m
    for when_s, expected_m in ((1, 3), (9, 11), (14.5, 4)):
        assert range_at(when_s) == pytest.approx(expected_m, abs=range_bin_m)
    outbound_ranges_m = [range_at(when_s) for when_s in np.arange(1, 9.1, 2)]
    assert outbound_ranges_m == sorted(outbound_ranges_m)


@cache
def detect_person(folder: Path) -> tuple[Recording, xr.Dataset]:
    recording = open_real_recording(folder, "simple_frame_1.npy")
    return recording, detect(recording.cube, recording.radar)


def check_approaching_person(folder: Path) -> None:
    recording, detections = detect_person(folder)

    walker = select_moving(
        detections, 2 * recording.radar.frame.velocity_resolution_m_per_s, snr=10
    )

    assert float(walker.range[0]) == pytest.approx(1.95, abs=0.1)
    assert float(walker.velocity[0]) < 0


def check_far_reflector(folder: Path) -> None:
    _, detections = detect_person(folder)
    detections = detections.sortby("snr", ascending=False)

    # Strongest detection beyond the antenna coupling, which occupies the first bins.
    strongest = detections.isel(detection=np.flatnonzero(detections.range > 0.2)[0])

    assert float(strongest.range) == pytest.approx(5.2, abs=0.4)


def check_two_people_at_equal_range(folder: Path) -> None:
    recording = open_real_recording(folder, "doppler_example_1.npy")
    detections = detect(recording.cube, recording.radar)

    people = select_moving(
        detections, 2 * recording.radar.frame.velocity_resolution_m_per_s, snr=1000
    )
    receding, approaching = (
        people.isel(detection=np.flatnonzero(s * people.velocity > 0)) for s in (1, -1)
    )

    range_bin_m = recording.radar.frame.chirp.range_resolution_m
    assert float(receding.range[0]) == pytest.approx(
        float(approaching.range[0]), abs=2 * range_bin_m
    )


def check_packets_complete(folder: Path) -> None:
    recording = open_real_recording(folder, "one_frame.pcap")

    assert math.prod(recording.sizes.values()) * 4 == 16384
    assert not recording.findings  # no packet lost, late, repeated or truncated


def check_samples_match_source(folder: Path) -> None:
    expected = json.loads((folder / "expected_samples.json").read_text())["samples"]
    samples = open_real_recording(folder, "one_frame.pcap").cube.values.ravel()

    for index, (real_part, imaginary_part) in expected.items():
        assert samples[int(index)] == np.complex64((real_part + 1j * imaginary_part) / 32768)


def check_studio_waveform(folder: Path) -> None:
    waveform = json.loads((folder / "meta.json").read_text())["waveform"]

    for name in ("indoor_walking.mmwave.json", "indoor_walking.setup.json"):
        frame = read_radar(folder / name).frame
        chirp = frame.chirp
        values = {
            "start_frequency_hz": chirp.start_frequency_hz,
            "slope_hz_per_s": chirp.slope_hz_per_s,
            "sample_rate_hz": chirp.sample_rate_hz,
            "samples_per_chirp": chirp.n_samples,
            "chirp_repetition_time_s": frame.interval_s,
            "chirps_per_frame": frame.n_chirps_total,
            "frame_period_s": frame.period_s,
            "sampled_bandwidth_hz": chirp.sampled_bandwidth_hz,
            "adc_start_time_s": chirp.adc_start_s,
            "ramp_end_time_s": chirp.ramp_duration_s,
            "idle_time_s": frame.interval_s - chirp.ramp_duration_s,
        }
        for key, number in values.items():
            assert number == pytest.approx(waveform[key], rel=1e-6), key
        # The table rounds it to 0.1 mm.
        assert chirp.range_resolution_m == pytest.approx(waveform["range_bin_m"], abs=5e-5)


def check_slow_walker_ranges(folder: Path) -> None:
    recording = open_real_recording(folder, "giulioCammina.json")
    chirp = recording.radar.frame.chirp
    samples = recording.cube.values.reshape(-1, chirp.n_samples)
    moving_samples = samples - samples.mean(axis=0)
    power = abs(np.fft.fft(moving_samples * np.hanning(chirp.n_samples), 1024, axis=1)) ** 2
    range_m = chirp.range_bins_m(1024)
    in_range = (range_m > 0.3) & (range_m < 1.2)

    def range_at(when_s: float) -> float:
        first_chirp = round(when_s / recording.radar.frame.interval_s)
        one_second = power[first_chirp : first_chirp + 63, in_range].mean(axis=0)
        return float(range_m[in_range][one_second.argmax()])

    range_bin_m = chirp.range_resolution_m
    for when_s, expected_m in ((0, 0.50), (32, 0.74), (51, 0.45)):
        assert range_at(when_s) == pytest.approx(expected_m, abs=range_bin_m)


def check_101_packets(folder: Path) -> None:
    recording = open_real_recording(folder, "awr2944_stream.dat")

    assert recording.points is not None
    assert recording.n_frames == 101
    assert np.unique(recording.points.frame_number).tolist() == list(range(99, 200))
    assert not [finding for finding in recording.findings if finding.level == "warning"]


def check_nothing_moves(folder: Path) -> None:
    points = open_real_recording(folder, "awr2944_stream.dat").points

    assert points is not None
    assert points.sizes["detection"] == 3010
    assert np.all(points.velocity == 0)
    assert float(points.range.min()) > 0.03
    assert float(points.range.max()) < 4.32


def check_reflector_range(folder: Path) -> None:
    for name in RECORDINGS[folder.name]:
        power = compute_padded_map(open_real_recording(folder, name))
        # Without beamforming, clutter at 3.16 m is as strong as a reflector at 50 degrees.
        standing = power.sel(velocity=0, method="nearest").sel(range=slice(1.5, 2.6))

        range_m = float(standing.range[int(np.argmax(standing.values))])

        assert range_m == pytest.approx(2.04, abs=0.05), name


def make_one_angle_check(name: str, azimuth_deg: float) -> Check:
    def check(folder: Path) -> None:
        detections = detect_reflectors(folder, name, Fft())

        assert np.degrees(detections.azimuth.values) == pytest.approx([azimuth_deg], abs=1.5)

    return check


def make_two_angle_check(name: str, azimuth_deg: tuple[float, float]) -> Check:
    def check(folder: Path) -> None:
        detections = detect_reflectors(folder, name, Music(n_sources=2))

        assert sorted(np.degrees(detections.azimuth.values)) == pytest.approx(azimuth_deg, abs=3)

    return check


def check_turntable_angles(folder: Path) -> None:
    for collection, azimuth_deg, tolerance_deg in (("A", 0, 1.5), ("D", 20, 1.5), ("C", 40, 1.5),
                                            ("B", 60, 2.0)):  # fmt: skip
        detections = detect_turntable_reflector(folder, collection)

        assert np.degrees(detections.azimuth.values) == pytest.approx(
            [azimuth_deg], abs=tolerance_deg
        )


TRUTHS: dict[str, dict[str, Check]] = {
    "awr1243_interference": {
        "20180613-190347": check_moving_car,
        "20181128-214451": check_ghost_exceeds_echoes,
    },
    "awr1642_vibrating_pipe": {"vibration_2": check_pipe_vibration},
    "bgt60_breathing": {
        "recording name": check_breathing_rate,
        "all three RX": check_receivers_agree_on_breathing,
    },
    "bgt60_people_room": {
        "live people-counting": check_people_ranges,
        "maximum speed": check_people_speeds,
    },
    "bgt60_two_reflectors": {"number of static reflectors": check_two_reflectors},
    "coffeecan_vehicles": {
        "car_32mph": make_speed_check("car_32mph.wav", 14.31, (2.3, 4.9)),
        "suv_25mph": make_speed_check("suv_25mph.wav", 11.18, (1.5, 6.3)),
    },
    "dca1000_pcap": {
        "12 data packets": check_packets_complete,
        "decoded complex samples": check_samples_match_source,
    },
    "kth_walker": {"one person walking": check_walker_ranges},
    "mmwavestudio_json": {"values a parser": check_studio_waveform},
    "openradar_people": {
        "simple_frame_1: object near": check_approaching_person,
        "simple_frame_1: strong static": check_far_reflector,
        "doppler_example_1": check_two_people_at_equal_range,
    },
    "sirad122_walk": {
        'a person ("Giulio': check_slow_walker_ranges,
        "range-track displacement": check_range_and_phase_agree,
    },
    "uart_tlv_awr2944": {
        "complete frames": check_101_packets,
        "static indoor": check_nothing_moves,
    },
    "mimo12_known_angles_mat": {"CollectionA..D": check_turntable_angles},
    "xwr1443_known_angles": {
        "reflector range": check_reflector_range,
        **{
            f"az_{angle}.raw": make_one_angle_check(f"az_{angle}.raw", angle)
            for angle in (-10, 30, 50)
        },
        **{
            f"az_{angle}_1GHz.raw": make_one_angle_check(f"az_{angle}_1GHz.raw", angle)
            for angle in (10, 50)
        },
        "az_-1010.raw": make_two_angle_check("az_-1010.raw", (-10, 10)),
        "az_3050.raw": make_two_angle_check("az_3050.raw", (30, 50)),
        "az_1030_1GHz.raw": make_two_angle_check("az_1030_1GHz.raw", (10, 30)),
        "az_3050_1GHz.raw": make_two_angle_check("az_3050_1GHz.raw", (30, 50)),
    },
}
"""Beginning of each ground-truth entry, and its check."""


@pytest.mark.parametrize(
    ("folder", "check"),
    [
        pytest.param(folder, check, id=f"{folder}: {beginning}")
        for folder, checks in TRUTHS.items()
        for beginning, check in checks.items()
    ],
)
def test_recording_matches_ground_truth(real_data, folder, check):
    check(real_data / folder)


def test_every_ground_truth_entry_has_check(real_data):
    for meta in sorted(real_data.glob("*/meta.json")):
        folder = meta.parent.name
        checks = TRUTHS.get(folder, {})
        for truth in json.loads(meta.read_text())["truth"]:
            matches = [beginning for beginning in checks if truth["what"].startswith(beginning)]
            assert len(matches) == 1, f"{folder}: {truth['what']}"


@pytest.mark.parametrize(
    ("folder", "name"), [(folder, name) for folder, names in RECORDINGS.items() for name in names]
)
def test_every_recording_opens_with_finite_samples(real_data, folder, name):
    recording = open_real_recording(real_data / folder, name)

    if recording.points is not None:
        with pytest.raises(RecordingError, match="detections without samples"):
            _ = recording.cube
        return
    cube = recording.cube
    assert dict(cube.sizes) == recording.sizes
    assert np.isfinite(cube.values).all()
    assert 0 < float(abs(cube.real).max()) <= 1
    last = list(recording.frames())[-1]
    np.testing.assert_array_equal(last.values[0], cube.values[-1])


def test_every_sample_file_of_collection_is_opened(real_data):
    kinds = {".bin", ".pcap", ".wav", ".mat", ".npy", ".raw", ".dat", ".json"}
    not_samples = {"meta.json", "meta_recording.json", "config.json", "expected_samples.json"}
    not_samples |= {"calibration_yellow.json", "command_only.pcap", "temperature.npy"}
    for folder in (entry for entry in real_data.iterdir() if entry.is_dir()):
        if folder.name == "mmwavestudio_json":
            continue
        opened_names = {name.split("/")[0] for name in RECORDINGS[folder.name]}
        for file in folder.iterdir():
            if file.suffix in kinds and file.name not in not_samples:
                assert file.name in opened_names


def test_rejects_capture_of_commands_only(real_data):
    with pytest.raises(RecordingError, match="no packets of samples"):
        open_real_recording(real_data / "dca1000_pcap", "command_only.pcap")


def test_continuous_chirps_are_divided_into_frames(real_data):
    folder = real_data / "kth_walker"
    recording = open_real_recording(folder, "single_target_range.wav")
    radar_6_chirps = replace(KTH, frame=replace(KTH.frame, n_chirps=6))
    framed_recording = open_recording(folder / "single_target_range.wav", radar=radar_6_chirps)

    assert recording.sizes == {"frame": 60, "chirp": 8, "rx": 1, "sample": 882}
    assert framed_recording.sizes == {"frame": 81, "chirp": 6, "rx": 1, "sample": 882}
    np.testing.assert_array_equal(
        framed_recording.cube.values[:80].reshape(480, 882),
        recording.cube.values.reshape(480, 882),
    )

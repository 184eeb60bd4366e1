"""Every recording of the collection opens, and what is known to be in it is found in it.

What is known stands in the `meta.json` of each recording. Truths that need the phase over slow
time wait for the issue that brings it; `OWED` lists them, and a test holds
both lists against the files, so that none is forgotten.
"""

import json
import math
from collections.abc import Callable
from dataclasses import replace
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
from recordings.directions import of_reflectors, on_the_turntable
from recordings.opened import KTH, RECORDINGS, opened
from recordings.slow_movements import (
    a_pipe_shakes_only_while_the_device_is_on,
    all_receivers_see_one_breath,
    range_and_phase_tell_the_same_walk,
    somebody_breathes,
)

Check = Callable[[Path], None]


def padded_map(recording: Recording) -> xr.DataArray:
    """Map of the first frame on a fine range grid, (velocity, range)."""
    chain = Chain(n_range_bins=4096)
    return power_map(next(iter(recording.frames())).isel(frame=0), recording.radar, chain)


def moving(found: xr.Dataset, at_least_m_per_s: float, *, snr: float) -> xr.Dataset:
    """Detections of so fast and so strong ones, strongest first."""
    chosen = (abs(found.velocity) > at_least_m_per_s) & (found.snr > snr)
    return found.isel(detection=np.flatnonzero(chosen)).sortby("snr", ascending=False)


def one_moving_car(folder: Path) -> None:
    recording = opened(folder, "20180613-190347.bin")
    frame = recording.radar.frame

    found = detect(recording.cube, recording.radar)

    # 14.19 m and -12.8 m/s, 31 dB over the median, by the script of the collection.
    cars = moving(found, 2 * frame.velocity_resolution_m_per_s, snr=100)
    assert cars.range.values == pytest.approx([14.19], abs=frame.chirp.range_resolution_m)
    assert cars.velocity.values == pytest.approx([-12.8], abs=frame.velocity_resolution_m_per_s)


def a_ghost_stronger_than_any_echo(folder: Path) -> None:
    recording = opened(folder, "20181128-214451.bin")
    power = power_map(recording.cube.isel(frame=0), recording.radar, Chain())

    standing = abs(power.velocity) < 2 * recording.radar.frame.velocity_resolution_m_per_s
    ghost = power.where(~standing, drop=True)
    row, column = np.unravel_index(int(np.argmax(ghost.values)), ghost.shape)

    # Smeared over 2.2 m and 5 m/s; 16 dB above the strongest real return, by the collection.
    assert float(ghost.range[column]) == pytest.approx(27.4, abs=1.1)
    assert float(ghost.velocity[row]) == pytest.approx(24, abs=2.5)
    echoes = power.where(standing, drop=True).sel(range=slice(1.0, None))
    assert 10 * math.log10(float(ghost.max() / echoes.max())) == pytest.approx(16, abs=1.5)


def people_move_within_the_room(folder: Path) -> None:
    recording = opened(folder, "RadarIfxAvian_00")
    found = detect(recording.cube, recording.radar)

    people = moving(found, recording.radar.frame.velocity_resolution_m_per_s, snr=1000)

    assert people.sizes["detection"] > 10
    assert float(people.range.min()) > 0.4
    assert float(people.range.max()) < 8


def nobody_walks_faster_than_people_do(folder: Path) -> None:
    recording = opened(folder, "RadarIfxAvian_00")
    found = detect(recording.cube, recording.radar)

    people = moving(found, recording.radar.frame.velocity_resolution_m_per_s, snr=1000)

    assert float(abs(people.velocity).max()) < 2.5


def two_reflectors_in_every_frame(folder: Path) -> None:
    recording = opened(folder, "RadarIfxAvian_00")
    # Along range alone: everything stands still, and so do the cells to compare with.
    chain = Chain(
        cfar=Cfar(
            estimator=CellAveraging(),
            n_training=Cells(range=2, velocity=0),
            n_guard=Cells(range=2, velocity=0),
            offset=100.0,
        )
    )

    found = detect(recording.cube, recording.radar, chain)

    inside = found.frame.values[(found.range.values > 0.2) & (found.range.values < 0.85)]
    assert np.bincount(inside.astype(int), minlength=64).tolist() == [2] * 64


def cancelled(recording: Recording) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, ranges and power (time, range) of what changes from chirp to chirp."""
    samples = recording.cube.values.reshape(-1, recording.radar.frame.chirp.n_samples)
    changes = np.diff(samples, axis=0) * np.hanning(samples.shape[1])
    power = abs(np.fft.rfft(changes, 4096, axis=1)) ** 2
    time_s = (np.arange(len(changes)) + 0.5) * recording.radar.frame.interval_s
    return time_s, recording.radar.frame.chirp.range_bins_m(4096), power


def line_through(time_s: np.ndarray, range_m: np.ndarray) -> float:
    """Slope, m/s, of the line through most of the points; multipath lies beside it."""
    near = np.ones(len(range_m), bool)
    for _ in range(10):
        line = np.polyfit(time_s[near], range_m[near], 1)
        off = abs(range_m - np.polyval(line, time_s))
        near = off < max(3, 1.5 * float(np.median(off)))
    return float(line[0])


def approaching(name: str, speed_m_per_s: float, at_s: tuple[float, float]) -> Check:
    def check(folder: Path) -> None:
        time_s, range_m, power = cancelled(opened(folder, name))
        when = (time_s > at_s[0]) & (time_s < at_s[1])
        where = (range_m > 30) & (range_m < 100)

        track_m = range_m[where][power[np.ix_(when, where)].argmax(axis=1)]

        speed = line_through(time_s[when], track_m)
        assert speed == pytest.approx(-speed_m_per_s, rel=0.2)

    return check


def one_person_walks_away_and_back(folder: Path) -> None:
    recording = opened(folder, "single_target_range.wav")
    assert recording.n_frames == 486
    time_s, range_m, power = cancelled(recording)
    smooth = np.apply_along_axis(np.convolve, 0, power, np.ones(11) / 11, mode="same")
    where = (range_m > 1.5) & (range_m < 20)
    track_m = range_m[where][smooth[:, where].argmax(axis=1)]

    def at(when_s: float) -> float:
        return float(np.median(track_m[abs(time_s - when_s) < 0.3]))

    # About 3 m after 1 s, 11 m after 9 s, 4 m after 14.5 s, by the script of the collection.
    range_bin_m = recording.radar.frame.chirp.range_resolution_m
    for when_s, expected_m in ((1, 3), (9, 11), (14.5, 4)):
        assert at(when_s) == pytest.approx(expected_m, abs=range_bin_m)
    there = [at(when_s) for when_s in np.arange(1, 9.1, 2)]
    assert there == sorted(there)


def a_person_approaches(folder: Path) -> None:
    recording = opened(folder, "simple_frame_1.npy")
    found = detect(recording.cube, recording.radar)

    walker = moving(found, 2 * recording.radar.frame.velocity_resolution_m_per_s, snr=10)

    assert float(walker.range[0]) == pytest.approx(1.95, abs=0.1)
    assert float(walker.velocity[0]) < 0


def a_reflector_at_the_far_end(folder: Path) -> None:
    recording = opened(folder, "simple_frame_1.npy")
    found = detect(recording.cube, recording.radar).sortby("snr", ascending=False)

    # The strongest beyond the coupling between the antennas, which is in the first bins.
    strongest = found.isel(detection=np.flatnonzero(found.range > 0.2)[0])

    assert float(strongest.range) == pytest.approx(5.2, abs=0.4)


def two_people_pass_each_other(folder: Path) -> None:
    recording = opened(folder, "doppler_example_1.npy")
    found = detect(recording.cube, recording.radar)

    people = moving(found, 2 * recording.radar.frame.velocity_resolution_m_per_s, snr=1000)
    away, near = (people.isel(detection=np.flatnonzero(s * people.velocity > 0)) for s in (1, -1))

    range_bin_m = recording.radar.frame.chirp.range_resolution_m
    assert float(away.range[0]) == pytest.approx(float(near.range[0]), abs=2 * range_bin_m)


def every_packet_came_once(folder: Path) -> None:
    recording = opened(folder, "one_frame.pcap")

    assert math.prod(recording.sizes.values()) * 4 == 16384
    assert not recording.findings  # nothing lost, late, twice or cut


def its_samples_are_those_of_the_source(folder: Path) -> None:
    expected = json.loads((folder / "expected_samples.json").read_text())["samples"]
    samples = opened(folder, "one_frame.pcap").cube.values.ravel()

    for place, (real, imaginary) in expected.items():
        assert samples[int(place)] == np.complex64((real + 1j * imaginary) / 32768)


def a_parser_returns_the_waveform(folder: Path) -> None:
    told = json.loads((folder / "meta.json").read_text())["waveform"]

    for name in ("indoor_walking.mmwave.json", "indoor_walking.setup.json"):
        frame = read_radar(folder / name).frame
        chirp = frame.chirp
        got = {
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
        for key, number in got.items():
            assert number == pytest.approx(told[key], rel=1e-6), key
        # The table gives it to a tenth of a millimetre.
        assert chirp.range_resolution_m == pytest.approx(told["range_bin_m"], abs=5e-5)


def a_person_walks_away_and_back_slowly(folder: Path) -> None:
    recording = opened(folder, "giulioCammina.json")
    chirp = recording.radar.frame.chirp
    samples = recording.cube.values[0, :, 0]
    moved = samples - samples.mean(axis=0)
    power = abs(np.fft.fft(moved * np.hanning(chirp.n_samples), 1024, axis=1)) ** 2
    range_m = chirp.range_bins_m(1024)
    where = (range_m > 0.3) & (range_m < 1.2)

    def at(when_s: float) -> float:
        first = round(when_s / recording.radar.frame.interval_s)
        one_second = power[first : first + 63, where].mean(axis=0)
        return float(range_m[where][one_second.argmax()])

    range_bin_m = chirp.range_resolution_m
    for when_s, expected_m in ((0, 0.50), (32, 0.74), (51, 0.45)):
        assert at(when_s) == pytest.approx(expected_m, abs=range_bin_m)


def a_hundred_and_one_packets(folder: Path) -> None:
    recording = opened(folder, "awr2944_stream.dat")

    assert recording.points is not None
    assert recording.n_frames == 101
    assert np.unique(recording.points.frame_number).tolist() == list(range(99, 200))
    assert not [finding for finding in recording.findings if finding.level == "warning"]


def nothing_moves(folder: Path) -> None:
    points = opened(folder, "awr2944_stream.dat").points

    assert points is not None
    assert points.sizes["detection"] == 3010
    assert np.all(points.velocity == 0)
    assert float(points.range.min()) > 0.03
    assert float(points.range.max()) < 4.32


def the_reflector_is_two_metres_away(folder: Path) -> None:
    for name in RECORDINGS[folder.name]:
        power = padded_map(opened(folder, name))
        # Without directions, the room at 3.16 m is as strong as a reflector at 50 degrees.
        standing = power.sel(velocity=0, method="nearest").sel(range=slice(1.5, 2.6))

        at_m = float(standing.range[int(np.argmax(standing.values))])

        assert at_m == pytest.approx(2.04, abs=0.05), name


def one_reflector(name: str, azimuth_deg: float) -> Check:
    def check(folder: Path) -> None:
        found = of_reflectors(folder, name, Fft())

        assert np.degrees(found.azimuth.values) == pytest.approx([azimuth_deg], abs=1.5)

    return check


def two_reflectors(name: str, azimuth_deg: tuple[float, float]) -> Check:
    def check(folder: Path) -> None:
        found = of_reflectors(folder, name, Music(n_sources=2))

        assert sorted(np.degrees(found.azimuth.values)) == pytest.approx(azimuth_deg, abs=3)

    return check


def a_turntable_turns_by_twenty_degrees(folder: Path) -> None:
    for collection, azimuth_deg, within in (("A", 0, 1.5), ("D", 20, 1.5), ("C", 40, 1.5),
                                            ("B", 60, 2.0)):  # fmt: skip
        found = on_the_turntable(folder, collection)

        assert np.degrees(found.azimuth.values) == pytest.approx([azimuth_deg], abs=within)


TRUTHS: dict[str, dict[str, Check]] = {
    "awr1243_interference": {
        "20180613-190347": one_moving_car,
        "20181128-214451": a_ghost_stronger_than_any_echo,
    },
    "awr1642_vibrating_pipe": {"vibration_2": a_pipe_shakes_only_while_the_device_is_on},
    "bgt60_breathing": {
        "recording name": somebody_breathes,
        "all three RX": all_receivers_see_one_breath,
    },
    "bgt60_people_room": {
        "live people-counting": people_move_within_the_room,
        "maximum speed": nobody_walks_faster_than_people_do,
    },
    "bgt60_two_reflectors": {"number of static reflectors": two_reflectors_in_every_frame},
    "coffeecan_vehicles": {
        "car_32mph": approaching("car_32mph.wav", 14.31, (2.3, 4.9)),
        "suv_25mph": approaching("suv_25mph.wav", 11.18, (1.5, 6.3)),
    },
    "dca1000_pcap": {
        "12 data packets": every_packet_came_once,
        "decoded complex samples": its_samples_are_those_of_the_source,
    },
    "kth_walker": {"one person walking": one_person_walks_away_and_back},
    "mmwavestudio_json": {"values a parser": a_parser_returns_the_waveform},
    "openradar_people": {
        "simple_frame_1: object near": a_person_approaches,
        "simple_frame_1: strong static": a_reflector_at_the_far_end,
        "doppler_example_1": two_people_pass_each_other,
    },
    "sirad122_walk": {
        'a person ("Giulio': a_person_walks_away_and_back_slowly,
        "range-track displacement": range_and_phase_tell_the_same_walk,
    },
    "uart_tlv_awr2944": {
        "complete frames": a_hundred_and_one_packets,
        "static indoor": nothing_moves,
    },
    "mimo12_known_angles_mat": {"CollectionA..D": a_turntable_turns_by_twenty_degrees},
    "xwr1443_known_angles": {
        "reflector range": the_reflector_is_two_metres_away,
        **{f"az_{angle}.raw": one_reflector(f"az_{angle}.raw", angle) for angle in (-10, 30, 50)},
        **{
            f"az_{angle}_1GHz.raw": one_reflector(f"az_{angle}_1GHz.raw", angle)
            for angle in (10, 50)
        },
        "az_-1010.raw": two_reflectors("az_-1010.raw", (-10, 10)),
        "az_3050.raw": two_reflectors("az_3050.raw", (30, 50)),
        "az_1030_1GHz.raw": two_reflectors("az_1030_1GHz.raw", (10, 30)),
        "az_3050_1GHz.raw": two_reflectors("az_3050_1GHz.raw", (30, 50)),
    },
}
"""What each truth begins with, and how it is checked."""


@pytest.mark.parametrize(
    ("folder", "check"),
    [
        pytest.param(folder, check, id=f"{folder}: {what}")
        for folder, checks in TRUTHS.items()
        for what, check in checks.items()
    ],
)
def test_what_is_known_of_a_recording_is_found_in_it(real_data, folder, check):
    check(real_data / folder)


def test_every_truth_of_the_collection_is_checked(real_data):
    for meta in sorted(real_data.glob("*/meta.json")):
        folder = meta.parent.name
        known = TRUTHS.get(folder, {})
        for truth in json.loads(meta.read_text())["truth"]:
            begins = [what for what in known if truth["what"].startswith(what)]
            assert len(begins) == 1, f"{folder}: {truth['what']}"


@pytest.mark.parametrize(
    ("folder", "name"), [(folder, name) for folder, names in RECORDINGS.items() for name in names]
)
def test_every_recording_opens_and_its_samples_are_whole(real_data, folder, name):
    recording = opened(real_data / folder, name)

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


def test_all_files_of_samples_in_the_collection_are_opened_by_these_tests(real_data):
    kinds = {".bin", ".pcap", ".wav", ".mat", ".npy", ".raw", ".dat", ".json"}
    not_samples = {"meta.json", "meta_recording.json", "config.json", "expected_samples.json"}
    not_samples |= {"calibration_yellow.json", "command_only.pcap", "temperature.npy"}
    for folder in (entry for entry in real_data.iterdir() if entry.is_dir()):
        if folder.name == "mmwavestudio_json":
            continue
        here = {name.split("/")[0] for name in RECORDINGS[folder.name]}
        for file in folder.iterdir():
            if file.suffix in kinds and file.name not in not_samples:
                assert file.name in here


def test_a_capture_of_commands_alone_says_so(real_data):
    with pytest.raises(RecordingError, match="no packets of samples"):
        opened(real_data / "dca1000_pcap", "command_only.pcap")


def test_chirps_of_a_continuous_radar_may_be_cut_into_frames(real_data):
    folder = real_data / "kth_walker"
    whole = opened(folder, "single_target_range.wav")
    eight = replace(KTH, frame=replace(KTH.frame, n_chirps=8))
    cut = open_recording(folder / "single_target_range.wav", radar=eight)

    assert cut.sizes == {"frame": 60, "chirp": 8, "rx": 1, "sample": 882}
    np.testing.assert_array_equal(cut.cube.values.reshape(480, 882), whole.cube.values[:480, 0, 0])

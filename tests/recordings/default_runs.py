"""Default runs of the real recordings: the known truth that each shows without any option.

As a program, this file prints the table of the guide: `python tests/recordings/default_runs.py`,
with the tests folder on the path, and DECHIRP_REAL_DATA and DECHIRP_WITNESS_DATA as for the tests.
Only metadata that a recording lacks is given: the radar, the axes of bare arrays, a calibration.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from time import process_time

import numpy as np
import xarray as xr

from dechirp.core.errors import DechirpError
from dechirp.experiments.run import Result, run
from dechirp.experiments.scenario import RecordingSource, Scenario
from dechirp.radar.radar import Radar
from dechirp.recordings.recording import open as open_recording
from recordings.directions import calibrate_radar
from recordings.real_recordings import missing_metadata

Measure = Callable[[Result], str]
"""Measurement of the truth in the result of a run; raises `AssertionError` where it is missed."""


@dataclass(frozen=True)
class KnownTruth:
    """Recording with a truth that a range, a velocity or a direction can show."""

    folder: str
    name: str
    truth: str
    measure: Measure
    is_calibrated: bool = False
    collection: str = "real"
    """Collection of the folder: real or witness."""


def select(result: Result, *, moving: bool | None = None, frame: int | None = None) -> xr.Dataset:
    """Return the detections that move, or of a frame, strongest first."""
    detections = result.detections
    is_selected = np.ones(detections.sizes["detection"], bool)
    if moving is not None:
        is_selected &= detections.moving.values == moving
    if frame is not None:
        is_selected &= detections.frame.values == frame
    return detections.isel(detection=np.flatnonzero(is_selected)).sortby("snr", ascending=False)


def within(detections: xr.Dataset, low_m: float, high_m: float) -> xr.Dataset:
    """Return the detections between two ranges."""
    ranges_m = detections.range.values
    return detections.isel(detection=np.flatnonzero((ranges_m > low_m) & (ranges_m < high_m)))


def near_range(expected_m: float, tolerance_m: float, *, n_strongest: int = 1) -> Measure:
    """Expect an echo among the strongest beyond 0.1 m of the first frame at a range."""

    def measure(result: Result) -> str:
        strongest = within(select(result, frame=result.first_frame), 0.1, np.inf)
        ranges_m = strongest.range.values[:n_strongest]
        nearest_m = ranges_m[abs(ranges_m - expected_m).argmin()]
        assert abs(nearest_m - expected_m) <= tolerance_m, ranges_m
        return f"{nearest_m:.2f} m"

    return measure


def at_azimuth(expected_deg: float, range_m: float, tolerances: tuple[float, float]) -> Measure:
    """Expect the strongest echo near a range at an azimuth; tolerances in m and degrees."""

    def measure(result: Result) -> str:
        tolerance_m, tolerance_deg = tolerances
        echo = within(select(result), range_m - tolerance_m, range_m + tolerance_m)
        echo = echo.isel(detection=0)
        azimuth_deg = float(np.degrees(echo.azimuth))
        assert abs(azimuth_deg - expected_deg) <= tolerance_deg, azimuth_deg
        return f"{float(echo.range):.2f} m, {azimuth_deg:.1f}°"

    return measure


def at_azimuths(first_deg: float, second_deg: float, tolerance_deg: float) -> Measure:
    """Expect two directions of the strongest echo about 2.04 m at two azimuths."""

    def measure(result: Result) -> str:
        echoes = within(select(result), 1.99, 2.09)
        assert echoes.sizes["detection"] == 2
        azimuths_deg = np.sort(np.degrees(echoes.azimuth.values))
        assert np.allclose(azimuths_deg, (first_deg, second_deg), atol=tolerance_deg), azimuths_deg
        return f"{float(echoes.range[0]):.2f} m, {azimuths_deg[0]:.1f}° and {azimuths_deg[1]:.1f}°"

    return measure


def mover(expected_m: float, tolerance_m: float, velocity_m_per_s: tuple[float, float]) -> Measure:
    """Expect a moving target at a range, with a velocity between two limits."""

    def measure(result: Result) -> str:
        low, high = velocity_m_per_s
        targets = within(
            select(result, moving=True), expected_m - tolerance_m, expected_m + tolerance_m
        )
        fits = (targets.velocity.values > low) & (targets.velocity.values < high)
        target = targets.isel(detection=int(np.flatnonzero(fits)[0]))
        return f"{float(target.range):.2f} m, {float(target.velocity):.2f} m/s"

    return measure


def velocity_from_ranges(expected_m_per_s: float) -> Measure:
    """Expect a fast target with a velocity within 20 %, as the collection states.

    The median of the moving detections between 30 and 110 m whose ranges in successive frames
    resolve their velocity. Images of static echoes farther away are weaker, where no vehicle was
    recorded.
    """

    def measure(result: Result) -> str:
        far_images = within(select(result, moving=True), 110, np.inf)
        targets = within(select(result, moving=True), 30, 110)
        assert far_images.snr.values.max(initial=0.0) < float(targets.snr.max()) / 2
        vehicle = targets.isel(detection=np.flatnonzero(targets.ambiguity_confidence.values > 0.5))
        n_frames = len(np.unique(vehicle.frame))
        assert n_frames >= 6, n_frames
        velocity = float(vehicle.velocity.median())
        assert abs(velocity / expected_m_per_s - 1) < 0.2, velocity
        return f"{velocity:.1f} m/s in {n_frames} frames"

    return measure


def walk(ranges_m: dict[float, float], tolerance_m: float) -> Measure:
    """Expect the strongest moving target within a second of each time (s) at a range."""

    def measure(result: Result) -> str:
        targets = select(result, moving=True)
        measured_m = []
        for when_s, expected_m in ranges_m.items():
            strongest = int(np.flatnonzero(abs(targets.time.values - when_s) < 1)[0])
            range_m = float(targets.range.values[strongest])
            assert abs(range_m - expected_m) <= tolerance_m, (when_s, range_m)
            measured_m.append(range_m)
        return ", ".join(f"{range_m:.2f}" for range_m in measured_m) + " m"

    return measure


def walk_away_and_back(ranges_m: dict[float, float], tolerance_m: float) -> Measure:
    """Expect a walk, away until the middle of three times (s) and back, with resolved velocities.

    Velocities are those of the range rates between the times, within 30 %: their median, and the
    sign of each.
    """

    def measure(result: Result) -> str:
        measured = walk(ranges_m, tolerance_m)(result)
        targets = select(result, moving=True)
        times_s, medians = list(ranges_m), []
        for start_s, stop_s in pairwise(times_s):
            rate = (ranges_m[stop_s] - ranges_m[start_s]) / (stop_s - start_s)
            # A second beside the times, the person turns.
            is_between = (targets.time.values > start_s + 1) & (targets.time.values < stop_s - 1)
            is_known = np.isfinite(targets.ambiguity_number.values)
            velocity = targets.velocity.values[is_between & is_known]
            assert velocity.size >= 0.5 * np.count_nonzero(is_between), (start_s, velocity)
            assert (np.sign(velocity) == np.sign(rate)).all(), (start_s, velocity)
            medians.append(float(np.median(velocity)))
            assert abs(medians[-1] / rate - 1) < 0.3, (start_s, medians)
        return f"{measured}; " + " and ".join(f"{v:.2f}" for v in medians) + " m/s"

    return measure


def two_reflectors(result: Result) -> str:
    """Expect the two strongest echoes from 0.2 to 0.85 m of every frame at 0.300 and 0.457 m."""
    ranges_m = []
    for frame in range(result.n_frames):
        echoes = within(select(result, frame=frame), 0.2, 0.85)
        ranges_m.append(sorted(echoes.range.values[:2].tolist()))
    assert np.allclose(ranges_m, (0.300, 0.457), atol=0.014)
    return "{:.3f} and {:.3f} m in all frames".format(*np.mean(ranges_m, axis=0))


def person_in_room(result: Result) -> str:
    """Expect moving targets from 0.4 to 8 m, slower than 2.5 m/s, in most frames."""
    people = within(select(result, moving=True), 0.4, 8)
    people = people.isel(detection=np.flatnonzero(people.snr.values > 100))
    share = len(np.unique(people.frame)) / result.n_frames
    assert share > 0.5
    assert float(abs(people.velocity).max()) < 2.5
    return f"motion in {share:.0%} of the frames"


def opposite_people(result: Result) -> str:
    """Expect one receding and one approaching target at 2.93 m."""
    people = within(select(result, moving=True), 2.85, 3.05)
    receding, approaching = float(people.velocity.max()), float(people.velocity.min())
    assert receding > 0.3
    assert approaching < -0.3
    return f"{receding:.2f} and {approaching:.2f} m/s at 2.93 m"


# The echo of the highest power, and the second or third by its ratio to the noise of its range,
# which contains its vibration: see `test_real_recordings`.
PIPE = near_range(2.15, 0.2, n_strongest=3)
TRUTHS = (
    KnownTruth(
        "awr1243_interference",
        "20180613-190347.bin",
        "car at 14.19 m, -12.8 m/s",
        mover(14.19, 0.2, (-13.8, -11.8)),
    ),
    KnownTruth(
        "awr1243_interference",
        "20181128-214451.bin",
        "ghost at 27.4 m, 24 m/s",
        mover(27.4, 1.1, (19, 29)),
    ),
    KnownTruth("awr1642_vibrating_pipe", "vibration_2.bin", "pipe at 2.15 m", PIPE),
    KnownTruth("awr1642_vibrating_pipe", "no_vibration_2.bin", "pipe at 2.15 m", PIPE),
    KnownTruth(
        "bgt60_breathing", "RadarIfxAvian_00", "person at 0.327 m", near_range(0.327, 0.027)
    ),
    KnownTruth("bgt60_people_room", "RadarIfxAvian_00", "people who move", person_in_room),
    KnownTruth("bgt60_two_reflectors", "RadarIfxAvian_00", "0.300 and 0.457 m", two_reflectors),
    KnownTruth(
        "coffeecan_vehicles", "car_32mph.wav", "-14.3 m/s ± 20 %", velocity_from_ranges(-14.31)
    ),
    KnownTruth(
        "coffeecan_vehicles", "suv_25mph.wav", "-11.2 m/s ± 20 %", velocity_from_ranges(-11.18)
    ),
    KnownTruth("dca1000_pcap", "one_frame.pcap", "test tone in cell 59", near_range(2.57, 0.044)),
    KnownTruth(
        "kth_walker",
        "single_target_range.wav",
        "3, 11 and 4 m at 1, 9 and 14.5 s, 1.0 and -1.3 m/s",
        # Read from a map of falling ramps: to half a cell, 0.86 m, and shifted by their coupling,
        # 0.64 m at 1.1 m/s.
        walk_away_and_back({1: 3, 9: 11, 14.5: 4}, 1.5),
    ),
    *(
        KnownTruth(
            "mimo12_known_angles_mat",
            f"Assignment1.mat/Collection{name}",
            f"{azimuth_deg}° at 6.75 m",
            at_azimuth(azimuth_deg, 6.75, (0.18, 1.5)),
        )
        for name, azimuth_deg in (("A", 0), ("D", -20), ("C", -40), ("B", -60))
    ),
    KnownTruth(
        "openradar_people",
        "simple_frame_1.npy",
        "person at 1.95 m, -0.6 m/s",
        mover(1.95, 0.1, (-0.8, -0.4)),
    ),
    KnownTruth(
        "openradar_people", "simple_frame_1.npy", "reflector at 5.2 m", near_range(5.2, 0.4)
    ),
    KnownTruth("openradar_people", "doppler_example_1.npy", "two people", opposite_people),
    KnownTruth(
        "sirad122_walk",
        "giulioCammina.json",
        "0.50, 0.74 and 0.45 m at 1, 32 and 51 s",
        walk({1: 0.50, 32: 0.74, 51: 0.45}, 0.08),
    ),
    *(
        KnownTruth(
            "xwr1443_known_angles",
            f"az_{name}.raw",
            f"{azimuth_deg}° at 2.04 m",
            at_azimuth(azimuth_deg, 2.04, (0.05, 1.4)),
            is_calibrated=True,
        )
        for name, azimuth_deg in (("-10", -10), ("50", 50), ("10_1GHz", 10), ("50_1GHz", 50))
    ),
    *(
        KnownTruth(
            "xwr1443_known_angles",
            f"az_{name}.raw",
            f"{first_deg}° and {second_deg}° at 2.04 m",
            at_azimuths(first_deg, second_deg, 3.5),
            is_calibrated=True,
        )
        for name, first_deg, second_deg in (
            ("-1010", -10, 10),
            ("3050", 30, 50),
            ("1030_1GHz", 10, 30),
            ("3050_1GHz", 30, 50),
        )
    ),
    KnownTruth(
        "iwr1843_reflectors",
        "1_Raw_0.bin",
        "reflector at 0.17 m",
        near_range(0.17, 0.042),
        collection="witness",
    ),
    *(
        KnownTruth(
            "urad_sweeps",
            name,
            "trolley at 8.3, 1.95 and 7.6 m at 1.9, 7.2 and 13.8 s",  # cells 34, 8 and 31 of 512
            walk({1.9: 8.3, 7.2: 1.95, 13.8: 7.56}, 0.62),
            collection="witness",
        )
        for name in ("I_trolley_test.txt", "Q_trolley_test.txt")
    ),
)
"""Recordings and their truth.

Without samples: uart_tlv_awr2944, people_counting, mmwavestudio_json. Without a truth that a map
shows: urad_sweeps/IQ_0_1024_sweeps.txt. The order of the receivers of mimo12_known_angles_mat is
not stated: that its turntable turns to the right is a convention.
"""


def data_folders() -> dict[str, Path]:
    """Return the folders of both collections that the environment names."""
    variables = {"real": "DECHIRP_REAL_DATA", "witness": "DECHIRP_WITNESS_DATA"}
    return {name: Path(os.environ[key]) for name, key in variables.items() if key in os.environ}


def run_by_default(known: KnownTruth, data: Path) -> Result:
    """Run a recording with its metadata alone."""
    folder = data / known.folder
    options = missing_metadata(folder, known.name)
    radar = options.pop("radar", None)
    if isinstance(axes := options.get("axes"), str):
        options["axes"] = tuple(axes.split(","))
    if known.is_calibrated:
        options["calibration"] = calibrate_radar(folder)
    if isinstance(radar, Path) and radar.suffix != ".yaml":
        options["settings_path"], radar = str(radar), None
    elif isinstance(radar, Path):
        radar = open_recording(folder / known.name, **missing_metadata(folder, known.name)).radar
    assert isinstance(radar, Radar | None)
    source = RecordingSource(path=str(folder / known.name), **options)
    return run(Scenario(radar=radar, recording=source))


def opens_bare(known: KnownTruth, data: Path) -> str:
    """Return whether the recording opens without any option, else the missing metadata."""
    try:
        open_recording(data / known.folder / known.name)
    except DechirpError:
        return "with " + ", ".join(missing_metadata(data / known.folder, known.name))
    return "yes"


def print_table(folders: dict[str, Path]) -> None:
    """Print the table of the recordings of some collections."""
    print("| Recording | Opened bare | Truth | Found by the default run | Time (s) |")
    print("|---|---|---|---|---|")
    for known in TRUTHS:
        if known.collection not in folders:
            continue
        data = folders[known.collection]
        start_s = process_time()
        try:
            found = known.measure(run_by_default(known, data))
        except (AssertionError, DechirpError, IndexError) as error:
            found = f"no: {type(error).__name__} {str(error)[:80]}"
        time_s = process_time() - start_s
        bare = opens_bare(known, data)
        if known.is_calibrated:
            bare += ", calibration"
        print(
            f"| `{known.folder}/{known.name}` | {bare} | {known.truth} | {found} | {time_s:.1f} |",
            flush=True,
        )


if __name__ == "__main__":
    print_table(data_folders())

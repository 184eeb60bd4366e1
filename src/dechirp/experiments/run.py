"""Run of one experiment: simulate or read samples, and process them."""

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import islice
from time import perf_counter
from typing import Any, Literal

import numpy as np
import xarray as xr

from dechirp.core.accessor import first_rows_display_table, load_plots
from dechirp.core.argument_types import check_argument_types
from dechirp.core.compiled_kernels import plain_twins_for_small_work
from dechirp.core.detection_columns import detections_from_columns
from dechirp.core.display import Displayable, Table, format_count_with_noun
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import (
    Finding,
    capture_warned_findings,
    findings_display_table,
    log_findings,
)
from dechirp.core.text import format_number
from dechirp.core.values import frozen_dataclass
from dechirp.experiments.frame_totals import FrameTotals
from dechirp.experiments.link_budget import added_noise_power_w, link_budget_of_first_target
from dechirp.experiments.object_stage import estimate_ego_motion_clusters_tracks
from dechirp.experiments.recording_stage import (
    detect_in_recording,
    note_rejected_images,
    open_scenario_recording,
)
from dechirp.experiments.scenario import (
    Scenario,
    check_single_radar,
    check_tracks_and_ego_motion_possible,
    prefix_setting_of_errors,
)
from dechirp.experiments.traffic_stage import (
    ObjectComparison,
    TrafficFrames,
    mark_tracks_on_structures,
)
from dechirp.processing import near_field
from dechirp.processing.cfar.base import Cfar
from dechirp.processing.chain import Chain
from dechirp.processing.chain_findings import chain_findings
from dechirp.processing.channel_errors import channel_error_findings
from dechirp.processing.detect import FrameProcessor
from dechirp.processing.hidden_echoes import (
    hidden_echo_findings,
    unsearched_echo_findings,
    velocity_sign_findings,
)
from dechirp.processing.leakage import leakage_mask
from dechirp.processing.mitigation.apply import mitigation_findings
from dechirp.processing.peaks import MAX_PEAKS
from dechirp.processing.range_doppler_map import label_map_axes, power_map, threshold_map
from dechirp.processing.virtual_array import can_separate_transmitters
from dechirp.radar.budget import BudgetLine
from dechirp.radar.radar import Radar
from dechirp.recordings.recording import Recording
from dechirp.results.object_lists.object_list import object_list
from dechirp.scene.truth import truth
from dechirp.simulation.simulate import simulate
from dechirp.tracking.online import LiveTracker

_LOGGER = logging.getLogger(__name__)

VITAL_SIGNS_SETTING = "vital_signs"
"""Setting of the note on vital signs that were not measured."""
_MIN_BREATHING_S = 10.0  # half a window of the measurement
_MIN_BREATHING_RATE_HZ = 1.4  # twice the highest breathing rate
_PERSON_RANGE_M = (0.2, 3.0)
_MAX_CHEST_M_PER_S = 0.1
_MIN_PERSON_SNR = 100.0
_MIN_PERSON_SHARE = 0.8


@frozen_dataclass
class Result(Displayable):
    """Results of one experiment."""

    scenario: Scenario
    radar: Radar
    source: xr.DataArray | Recording
    """The simulated cube, or the recording as processed, see `recording.repair_faults`; of a stream
    and in traffic the cube of the first frame.
    """
    first_frame: int
    """Number of the first processed frame, whose maps are kept."""
    power: xr.DataArray
    """Range-Doppler map of the first frame, (velocity, range)."""
    threshold: xr.DataArray
    """Threshold of each cell of that map."""
    detections: xr.Dataset
    ego: xr.Dataset | None = None
    """Ego motion over frames, from the detections; None if not requested."""
    clusters: xr.Dataset | None = None
    """None if not requested, as for tracks."""
    tracks: xr.Dataset | None = None
    vital_signs: xr.Dataset | None = None
    """Breathing and heart rate over windows of time; None if not requested."""
    displacement: xr.DataArray | None = None
    """Displacement of the chest over slow time, from which they are measured."""
    truth: xr.Dataset | None
    """None for a recording, and in traffic."""
    traffic: xr.Dataset | None = None
    """In traffic the true objects in view, with their detections; see `ObjectComparison`."""
    budget: tuple[BudgetLine, ...] | None
    """Link budget of the first target; None for a recording."""
    findings: tuple[Finding, ...]
    timing_s: dict[str, float]
    times_s: tuple[float, ...]
    """Middle of each frame, from the first to the last."""

    @property
    def cube(self) -> xr.DataArray:
        """All kept samples, (frame, chirp, rx, sample); a recording is decoded on access.

        Raises
        ------
        NotEnoughMemory
            If those of a recording would not fit; `frames` needs one frame at a time.
        """
        if isinstance(self.source, Recording):
            return self.source.cube
        return self.source

    @property
    def n_frames(self) -> int:
        """Number of frames, from the first to the last."""
        return len(self.times_s)

    @property
    def n_frames_with_kept_samples(self) -> int:
        """Number of frames whose samples are kept: of a stream and in traffic the first alone."""
        return self.source.sizes["frame"]

    def _display_line(self) -> str:
        parts = [format_count_with_noun(self.n_frames, "frame")]
        tables = {"detection": self.detections, "cluster": self.clusters, "track": self.tracks}
        parts += [
            format_count_with_noun(table.sizes[name], name)
            for name, table in tables.items()
            if table is not None
        ]
        parts += [format_count_with_noun(len(self.findings), "finding")] if self.findings else []
        return f"{self.scenario.name}: {', '.join(parts)}"

    def _display_tables(self) -> Iterable[Table]:
        yield findings_display_table(self.findings)
        yield first_rows_display_table(self.detections, "Detections")
        if self.tracks is not None:
            yield first_rows_display_table(self.tracks, "Tracks")

    @check_argument_types
    def plot(self, ax: Any = None) -> Any:
        """Draw the first figure of the report and return its axes.

        The scene from above with the detections of the first frame, for a recording its tracks, or
        without tracks the samples of the first chirp. Without `ax`, an `Axes` of matplotlib, the
        current ones of pyplot are used.
        """
        return load_plots().plot_result(self, ax)

    def frames(self) -> Iterator[xr.DataArray]:
        """Yield the kept frames as cubes of one frame each; recordings are decoded on the fly."""
        return _iter_frame_cubes(self.source)


@check_argument_types
def run(
    scenario: Scenario,
    *,
    kind: Literal["samples", "statistical"] = "samples",
    rng: np.random.Generator | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Result:
    """Simulate the scene, or open the recording, and process every frame.

    Parameters
    ----------
    scenario : Scenario
        As `load` reads it, or built in Python.
    kind : "samples" or "statistical"
        Simulate and process samples, or, in traffic, draw the detections of each frame from their
        distribution, which takes a fraction of the time; maps are then those of the samples of the
        first frame alone. See `StatisticalSensor` for its approximations.
    rng : Generator, optional
        Random generator of a simulation; by default seeded with the scenario's seed.
    progress : callable, optional
        Called with the number of finished steps and of all: each simulated frame is one, each
        processed frame another.

    Raises
    ------
    DechirpError
        If a setting is invalid, the recording cannot be read, or memory is insufficient.
    """
    check_single_radar(scenario)
    if kind not in ("samples", "statistical") or (kind != "samples" and scenario.traffic is None):
        raise InvalidSetting(
            "kind",
            value=repr(kind),
            expected="samples, or in traffic statistical",
            fix="leave it out",
        )
    with plain_twins_for_small_work(scenario.n_simulated_samples):
        result = _run(scenario, kind, rng, progress)
    log_findings(_LOGGER, result.findings)
    stages = ", ".join(f"{name} {time_s:.3f} s" for name, time_s in result.timing_s.items())
    _LOGGER.info("%s: %s", result._display_line(), stages)
    return result


def _run(
    scenario: Scenario,
    kind: Literal["samples", "statistical"],
    rng: np.random.Generator | None,
    progress: Callable[[int, int], None] | None,
) -> Result:
    start_s = perf_counter()
    n_simulated = 0 if scenario.scene is None else scenario.n_frames
    if scenario.tracker is not None:
        with prefix_setting_of_errors("tracker", instead_of="Tracker"):
            LiveTracker(scenario.tracker)  # fails early if a library is missing
    if scenario.traffic is not None:
        return _run_in_traffic(scenario, kind, rng, progress)

    def report_simulated(n_done: int, n_steps: int) -> None:
        if progress is not None:
            progress(n_done, 2 * n_steps)

    source, radar, findings = _simulate_cube_or_open_recording(scenario, report_simulated, rng)
    source_time_s = perf_counter()

    def report_processed(n_done: int, n_steps: int) -> None:
        if progress is not None:
            progress(n_simulated + n_done, n_simulated + n_steps)

    if isinstance(source, Recording):
        numbers = source.frame_numbers
        detected = detect_in_recording(source, scenario, progress=report_processed)
        scenario, radar = detected.scenario, detected.frames.radar
        totals, columns = detected.totals, detected.columns
        source = detected.frames.processed_recording()
        findings = (
            *detected.reader_findings,
            *detected.findings,
            *note_rejected_images(detected.frames.findings(), scenario.chain),
        )
    else:
        numbers = range(source.sizes["frame"])
        processor, totals = FrameProcessor(radar, scenario.chain), FrameTotals()
        for frame in processor.process_cubes(_iter_frame_cubes(source)):
            totals.add_frame_result(frame)
            report_processed(len(totals.times_s), len(numbers))
        columns = processor.joined_detection_columns()
    detection_run = DetectionRun(
        first_frame=numbers.start, detections=detections_from_columns(columns), frames=totals
    )
    if isinstance(source, Recording):
        findings = (
            *findings,
            *_vital_sign_findings(detection_run),
        )
    detection_time_s = perf_counter()
    result = build_result(scenario, radar, source, detection_run)
    return replace(
        result,
        truth=None if scenario.scene is None else _scene_truth(scenario, radar),
        budget=None if scenario.scene is None else link_budget_of_first_target(scenario, radar),
        findings=(*findings, *result.findings),
        timing_s={
            "simulate" if scenario.scene is not None else "open": source_time_s - start_s,
            "process": detection_time_s - source_time_s + result.timing_s["process"],
        },
    )


def _run_in_traffic(
    scenario: Scenario,
    kind: Literal["samples", "statistical"],
    rng: np.random.Generator | None,
    progress: Callable[[int, int], None] | None,
) -> Result:
    """Simulate and process the frames of a radar in traffic one at a time."""
    start_s = perf_counter()
    traffic = TrafficFrames(scenario)
    comparison = ObjectComparison(traffic)
    radar, totals = traffic.radar, FrameTotals()
    check_tracks_and_ego_motion_possible(scenario, radar)
    processor = FrameProcessor(radar, scenario.chain)
    first_cube: list[xr.DataArray] = []

    def keep_first_cube(cubes: Iterator[xr.DataArray]) -> Iterator[xr.DataArray]:
        for cube in cubes:
            if not first_cube:
                first_cube.append(cube)
            yield cube

    open_time_s = perf_counter()
    report = progress or (lambda n_done, n_steps: None)
    cubes = traffic.cubes(rng, report)
    if kind == "statistical":
        cubes = islice(cubes, 1)
    for frame in processor.process_cubes(keep_first_cube(cubes)):
        totals.add_frame_result(frame)
    if kind == "statistical":
        columns = traffic.draw_detections(rng, report, comparison)
        totals.times_s = [traffic.mid_frame_s(number) for number in range(traffic.n_frames)]
    else:
        columns = processor.joined_detection_columns()
    detections = detections_from_columns(columns)
    frames_time_s = perf_counter()
    result = build_result(
        scenario,
        radar,
        first_cube[0],
        DetectionRun(first_frame=0, detections=detections, frames=totals),
    )
    compare_time_s = perf_counter()
    if kind == "samples":
        comparison.add_all_frames(columns)
    tracks = result.tracks
    if tracks is not None:
        poses = [traffic.pose(number) for number in range(traffic.n_frames)]
        tracks = mark_tracks_on_structures(tracks, traffic.scenes, poses)
    return replace(
        result,
        tracks=tracks,
        traffic=comparison.to_dataset(),
        findings=(*traffic.findings, *result.findings),
        timing_s={
            "open": open_time_s - start_s,
            "simulate and process": frames_time_s - open_time_s,
            "track": result.timing_s["process"],
            "compare": perf_counter() - compare_time_s,
        },
    )


@frozen_dataclass
class DetectionRun:
    """Detections of all frames of a run."""

    first_frame: int
    detections: xr.Dataset
    frames: FrameTotals


def build_result(
    scenario: Scenario, radar: Radar, source: xr.DataArray | Recording, detection_run: DetectionRun
) -> Result:
    """Build the result of a run: clusters and tracks, maps of the first frame, findings."""
    start_s = perf_counter()
    chain, first = scenario.chain.fit_to_radar(radar), detection_run.first_frame
    fitted = replace(scenario, chain=chain)
    objects = estimate_ego_motion_clusters_tracks(
        detection_run.detections, detection_run.frames.times_s, fitted, radar, first_frame=first
    )
    power = label_frame_power_map(
        detection_run.frames.first_power, next(_iter_frame_cubes(source)), first, radar, chain
    )
    threshold = threshold_map(power, radar.for_frame(first), chain)
    return Result(
        scenario=fitted,
        radar=radar,
        source=source,
        first_frame=first,
        power=power,
        threshold=threshold,
        detections=objects.detections,
        ego=objects.ego,
        clusters=objects.clusters,
        tracks=objects.tracks,
        truth=None,
        budget=None,
        findings=(
            *fitted_chain_findings(scenario.chain, radar),
            *detection_findings(detection_run, radar, chain),
            *hidden_echo_findings(power, threshold, radar.for_frame(first), chain),
            *unsearched_echo_findings(
                power,
                threshold,
                radar.for_frame(first),
                chain,
                is_recorded=scenario.recording is not None,
            ),
            *objects.findings,
        ),
        times_s=tuple(detection_run.frames.times_s),
        timing_s={"process": perf_counter() - start_s},
    )


def leakage_in_recording(result: Result, detections: xr.Dataset) -> np.ndarray | None:
    """Return which detections of the result of a recording are leakage, (n,); None of a scene."""
    if result.scenario.recording is None:
        return None
    return leakage_mask(detections, result.radar, result.scenario.chain)


def fitted_chain_findings(chain: Chain, radar: Radar) -> tuple[Finding, ...]:
    """Return findings on the maps that a chain computes for a radar."""
    fitted = chain.fit_to_radar(radar)
    cells = _reduced_training_cell_findings(chain.cfar, fitted.cfar)
    return (
        *cells,
        *_dropped_directions_findings(chain, fitted, radar),
        *chain_findings(radar, fitted),
    )


def detection_findings(
    detection_run: DetectionRun, radar: Radar, chain: Chain
) -> tuple[Finding, ...]:
    """Return findings on the detections of a run."""
    detections = detection_run.detections
    beyond_leakage = detections.isel(detection=~leakage_mask(detections, radar, chain))
    return (
        *near_field.near_field_findings(radar, beyond_leakage),
        *velocity_sign_findings(beyond_leakage, radar),
        *_dropped_peak_findings(detection_run.frames.n_crowded),
        *_masked_direction_findings(
            detection_run.frames.masked_ranges_m, radar.frame.chirp.range_resolution_m
        ),
        *_unknown_angle_findings(detection_run.frames.n_unknown_angles),
        *channel_error_findings(
            detection_run.frames.channel_phase_rms_rad,
            radar,
            resolves_two_sources=getattr(chain.angle, "n_sources", 1) != 1,
        ),
        *(
            mitigation_findings(detection_run.frames.removed)
            if detection_run.frames.removed
            else ()
        ),
    )


def _vital_sign_findings(detection_run: DetectionRun) -> tuple[Finding, ...]:
    """Return a note if the frames are long and fast enough for breathing, with an echo near by.

    The limits are those of `processing.vital_signs`, which this does not import: it takes 0.04 s.
    """
    times_s = detection_run.frames.times_s
    duration_s = times_s[-1] - times_s[0] if times_s else 0.0
    if duration_s < _MIN_BREATHING_S or len(times_s) < _MIN_BREATHING_RATE_HZ * duration_s:
        return ()
    detections = detection_run.detections
    near, far = _PERSON_RANGE_M
    ranges_m, snr = detections["range"].values, detections["snr"].values
    is_person = (near <= ranges_m) & (ranges_m <= far) & (snr >= _MIN_PERSON_SNR)
    is_person &= abs(detections["velocity"].values) <= _MAX_CHEST_M_PER_S
    n_frames = len(np.unique(detections["frame"].values[is_person]))
    if n_frames < _MIN_PERSON_SHARE * len(times_s):
        return ()
    return (
        Finding(
            level="note",
            setting=VITAL_SIGNS_SETTING,
            value=f"not measured: {duration_s:.3g} s with a nearly static echo from {near:g} to"
            f" {far:g} m, which may be a person",
            expected="breathing and heart rate, if a person sits there",
            fix="add --vital-signs to measure them",
        ),
    )


def label_frame_power_map(
    power: tuple[np.ndarray, ...], cube: xr.DataArray, frame_number: int, radar: Radar, chain: Chain
) -> xr.DataArray:
    """Return the labelled range-Doppler map of one frame, a cube of which is given.

    `power` has the maps of its `FrameResult`. Triangles have a map of each side there; theirs is
    the map of both sides together, computed from the samples.
    """
    radar = radar.for_frame(frame_number)
    if len(power) > 1:
        return power_map(cube.isel(frame=0), radar, chain)
    return label_map_axes(power[0], radar, chain, samples_unit=str(cube.attrs.get("units")))


def build_result_object_list(result: Result) -> xr.Dataset:
    """Build the object list of a result: of its tracks, else of its clusters, else detections.

    Warns
    -----
    PhysicsWarning
        If detections have no direction, so that their positions are unknown.
    """
    if result.tracks is not None:
        return object_list(result.tracks)
    rows = result.detections if result.clusters is None else result.clusters
    return object_list(rows, result.times_s, first=result.first_frame)


def simulate_or_read_frame_and_radar(
    scenario: Scenario, number: int = 0
) -> tuple[xr.DataArray, Radar]:
    """Return the samples of one frame, (chirp, rx, sample), and the radar at its time.

    Raises
    ------
    InvalidSetting
        If there is no frame of that number.
    DechirpError
        If a setting is invalid, the recording cannot be read, or memory is insufficient.
    """
    check_single_radar(scenario)
    if scenario.traffic is not None:
        traffic = TrafficFrames(scenario)
        _check_frame_number(number, range(traffic.n_frames))
        cube = traffic.simulate_frame(number, traffic.scenes.scene(number))
        return cube.isel(frame=0), traffic.radar.for_frame(number)
    source, radar, _ = _simulate_cube_or_open_recording(scenario, lambda n_done, n_steps: None)
    numbers = _frame_numbers_of_source(source)
    _check_frame_number(number, numbers)
    frames = _iter_frame_cubes(source)
    cube = next(
        frame_cube
        for frame_number, frame_cube in zip(numbers, frames, strict=True)
        if frame_number == number
    )
    return cube.isel(frame=0), radar.for_frame(number)


def _check_frame_number(number: int, numbers: range) -> None:
    if number not in numbers:
        raise InvalidSetting(
            "frame",
            value=number,
            expected=f"a frame from {numbers.start} to {numbers.stop - 1}",
            fix="count frames from 0; n_frames is the number of simulated frames",
        )


def simulate_cube_truth_and_findings(
    scenario: Scenario, *, progress: Callable[[int, int], None] | None = None
) -> tuple[xr.DataArray, xr.Dataset, tuple[Finding, ...]]:
    """Simulate the cube of a scene as `run` does; return it with its truth and findings.

    Raises
    ------
    DechirpError
        If a setting is invalid, memory is insufficient, or the scenario has no scene.
    """
    check_single_radar(scenario)
    if scenario.scene is None:
        raise InvalidSetting(
            "scenario.traffic",
            value="traffic",
            expected="a scene, whose cube fits into memory",
            fix="process traffic with dechirp run, which simulates one frame at a time",
        )
    source, radar, findings = _simulate_cube_or_open_recording(
        scenario, progress or (lambda n_done, n_steps: None)
    )
    assert isinstance(source, xr.DataArray)  # the scenario has a scene
    return source, _scene_truth(scenario, radar), findings


def _reduced_training_cell_findings(configured: Cfar, fitted: Cfar) -> tuple[Finding, ...]:
    """Return a note if the map has no room for the default training cells."""
    if configured == fitted:
        return ()
    cells = [
        f"{getattr(fitted.n_training, axis)} training and"
        f" {getattr(fitted.n_guard, axis)} guard cells"
        f" along {axis}"
        for axis in ("range", "velocity")
    ]
    return (
        Finding(
            level="note",
            setting="chain.cfar",
            value=f"{' and '.join(cells)}, on each side, fewer than usual",
            expected="a training window that fits into the map",
            fix="set chain.cfar.n_training and chain.cfar.n_guard to choose others",
        ),
    )


def _dropped_directions_findings(
    configured: Chain, fitted: Chain, radar: Radar
) -> tuple[Finding, ...]:
    """Return a note if directions are requested that the array or the code cannot resolve."""
    was_asked_for = configured.angle is not Chain.angle  # an explicit setting
    if not (was_asked_for and configured.angle is not None and fitted.angle is None):
        return ()
    is_separable = can_separate_transmitters(radar.frame)
    return (
        Finding(
            level="note",
            setting="chain.angle",
            value=f"{configured.angle.kind()}, left out: this "
            + ("array" if is_separable else "code of the transmitters")
            + " resolves no directions",
            expected="elements at two places or more"
            if is_separable
            else "a code that separates the transmitters within a round",
            fix="give the radar more elements, or set chain.angle to null"
            if is_separable
            else "correct radar.frame.multiplexing, or set chain.angle to null",
        ),
    )


def _masked_direction_findings(
    ranges_m: Sequence[float], resolution_m: float
) -> tuple[Finding, ...]:
    """Return a note if detections at ranges have no direction beside much stronger echoes."""
    if not ranges_m:
        return ()
    ordered_m = np.sort(ranges_m)
    groups = np.split(ordered_m, np.flatnonzero(np.diff(ordered_m) > 3 * resolution_m) + 1)
    largest = sorted(groups, key=len, reverse=True)[:4]
    spans = [
        " to ".join(dict.fromkeys(format_number(m, 3) for m in (group[0], group[-1])))
        for group in sorted(largest, key=lambda group: float(group[0]))
    ]
    more = f" and {len(groups) - 4} other places" if len(groups) > 4 else ""
    return (
        Finding(
            level="note",
            setting="chain.angle",
            value=f"no direction for {format_count_with_noun(len(ranges_m), 'detection')} beside"
            f" much stronger echoes, perhaps shoulders of these, at {', '.join(spans)} m{more}",
            expected="echoes at least 10 dB above the sidelobes of others, with every window",
            fix="more bandwidth or a longer frame separates the echoes; else nothing is to be done",
        ),
    )


def _unknown_angle_findings(n_sources: int) -> tuple[Finding, ...]:
    """Return a note if the amplitudes of detections do not determine an angle."""
    if not n_sources:
        return ()
    return (
        Finding(
            level="note",
            setting="chain.field_of_view",
            value=f"an angle of {format_count_with_noun(n_sources, 'detection')} is left unknown",
            expected="plane waves from within the field of view, with an error of at most 22.5"
            " degrees",
            fix="widen chain.field_of_view if targets may be there; else they are no plane waves:"
            " near, extended, or several echoes in a cell",
        ),
    )


def _dropped_peak_findings(n_affected_frames: int) -> tuple[Finding, ...]:
    """Return a warning if frames had more peaks than are kept."""
    if not n_affected_frames:
        return ()
    return (
        Finding(
            level="warning",
            setting="chain.cfar",
            value=f"more than {MAX_PEAKS} peaks over threshold in"
            f" {format_count_with_noun(n_affected_frames, 'frame')}, of which the strongest are"
            " kept",
            expected=f"at most {MAX_PEAKS} in a frame",
            fix="lower the false-alarm probability",
        ),
    )


def _simulate_cube_or_open_recording(
    scenario: Scenario,
    progress: Callable[[int, int], None],
    rng: np.random.Generator | None = None,
) -> tuple[xr.DataArray | Recording, Radar, tuple[Finding, ...]]:
    """Return the simulated cube or the recording, its radar, and findings."""
    if scenario.scene is not None:
        assert scenario.radar is not None
        with capture_warned_findings() as findings:
            cube = simulate(
                scenario.scene,
                scenario.radar,
                impairments=scenario.impairments,
                n_frames=scenario.n_frames,
                seed=scenario.seed if rng is None else rng,
                engine=scenario.engine,
                progress=progress,
            )
        return cube, scenario.radar, tuple(findings)
    recording = open_scenario_recording(scenario)
    return recording, recording.radar, recording.findings


def _frame_numbers_of_source(source: xr.DataArray | Recording) -> range:
    """Return the numbers of the processed frames."""
    return source.frame_numbers if isinstance(source, Recording) else range(source.sizes["frame"])


def _iter_frame_cubes(source: xr.DataArray | Recording) -> Iterator[xr.DataArray]:
    if isinstance(source, Recording):
        yield from source.frames()
    else:
        for index in range(source.sizes["frame"]):
            yield source.isel(frame=slice(index, index + 1))


def _scene_truth(scenario: Scenario, radar: Radar) -> xr.Dataset:
    """Compute the truth of the scene, with signal-to-noise ratios against the added noise."""
    assert scenario.scene is not None
    noise_w = added_noise_power_w(scenario, radar)
    return truth(scenario.scene, radar, n_frames=scenario.n_frames, noise_power_w=noise_w)

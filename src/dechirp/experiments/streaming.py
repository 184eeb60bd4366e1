"""Processing of a stream: frames are processed as they arrive, and their samples discarded."""

from array import array
from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from time import perf_counter

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.detection_columns import UNITS, detections_from_columns
from dechirp.core.errors import DechirpError, InvalidSetting, RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.experiments.frame_totals import FrameTotals
from dechirp.experiments.object_stage import start_live_tracker
from dechirp.experiments.recording_faults import (
    FaultTreatment,
    FrameRepair,
    keep_faults,
    treat_measured_faults,
)
from dechirp.experiments.recording_stage import fit_scenario_to_recording
from dechirp.experiments.run import DetectionRun, Result, build_result
from dechirp.experiments.scenario import (
    RecordingSource,
    Scenario,
    check_chain_fits_radar,
    check_tracks_and_ego_motion_possible,
)
from dechirp.processing.detect import process_cubes
from dechirp.processing.quality.measures import measure_frame_quality
from dechirp.processing.quality.recording_measures import RecordingMeasures
from dechirp.radar.radar import Radar
from dechirp.recordings.live.growing_file import follow
from dechirp.recordings.live.stream import Stream
from dechirp.recordings.live.udp import is_udp_address, listen


@frozen_dataclass
class FrameReport:
    """Detections of a frame that has just arrived."""

    number: int
    """Number of the frame."""
    detections: xr.Dataset
    n_gaps: int
    """Number of chirps with lost samples."""


def open_stream(scenario: Scenario, *, idle_s: float) -> Stream:
    """Open the UDP address, or the growing file, of a scenario's recording.

    The stream ends after `idle_s` without data; see `listen` and `follow`.

    Raises
    ------
    DechirpError
        If it cannot be opened, or does not fit the scenario's settings.
    """
    source = _checked_stream_source(scenario)
    open_source = listen if is_udp_address(source.path) else follow
    stream: Stream = open_source(
        source.path,
        radar=scenario.radar,
        settings=source.settings_path,
        device=source.device,
        iq=source.iq,
        calibration=source.calibration,
        idle_s=idle_s,
    )
    try:
        check_chain_fits_radar(scenario.chain, stream.radar)
        check_tracks_and_ego_motion_possible(scenario, stream.radar)
        start_live_tracker(scenario, stream.radar)  # fails early if a library is missing
    except DechirpError:
        stream.close()
        raise
    return stream


@check_argument_types
def process_stream(
    scenario: Scenario, stream: Stream, *, on_frame: Callable[[FrameReport], None] | None = None
) -> Result:
    """Process every frame of a stream as it arrives, until the stream ends.

    Samples are kept of the first frame only; velocity ambiguity is resolved frame by frame. Faults
    are repaired as in `run`, by a treatment that the first frame decides.

    Parameters
    ----------
    scenario : Scenario
        Processing settings; `frames` of its `recording` count from the first frame that arrives.
    stream : Stream
        As `open_stream` returns it; closed at the end.
    on_frame : callable, optional
        Called with the detections of each frame.

    Raises
    ------
    RecordingError
        If no frame arrived, or none of the requested ones.
    DechirpError
        If a frame cannot be processed.
    """
    source, radar = _checked_stream_source(scenario), stream.radar
    repair: FrameRepair | None = None
    first: xr.DataArray | None = None
    numbers = range(0)
    columns = {name: array("d") for name in UNITS}
    chain, frames = scenario.chain.fit_to_radar(radar), FrameTotals()
    fit_findings: tuple[Finding, ...] = ()
    processing_s, start_s = 0.0, perf_counter()
    with stream:
        for received in islice(stream, *(source.frames or (0, None))):
            arrival_s, number = perf_counter(), stream.number
            if repair is None:
                treatment = _treat_stream_faults(received, stream.radar, scenario)
                repair = FrameRepair(stream.radar, treatment)
                radar = stream.radar.select_receivers(treatment.receivers)
                scenario = replace(scenario, chain=treatment.chain)
                fit_findings = treatment.findings
            cube = repair.repair_cube(received, number)
            if first is None:
                first, numbers = cube, range(number, number)
                scenario, choices = fit_scenario_to_recording(scenario, [cube], radar)
                fit_findings += choices
                chain = scenario.chain.fit_to_radar(radar)
            (frame,) = process_cubes([cube], radar, chain, first_frame_number=number)
            frames.add_frame_result(frame)
            numbers = range(numbers.start, number + 1)
            for name, column in columns.items():
                column.extend(frame.detections[name])
            if on_frame is not None:
                n_gaps = int(cube.gap.sum()) if "gap" in cube.coords else 0
                detections = detections_from_columns(frame.detections)
                on_frame(FrameReport(number=number, detections=detections, n_gaps=n_gaps))
            processing_s += perf_counter() - arrival_s
    if first is None or repair is None:
        raise RecordingError(
            source.path,
            value="a stream that ended before the requested frames",
            expected="frames of these numbers, counted from the first arrival",
            fix="ask for earlier ones (--frames), or wait longer (--idle)",
        )
    arrays = {name: np.array(column) for name, column in columns.items()}
    arrays["frame"] = arrays["frame"].astype(int)
    # Frames may be lost in transit; tracks coast through them.
    frames.times_s = [
        radar.frame.frame_start_s(number) + radar.frame.for_frame(number).mid_frame_s
        for number in numbers
    ]
    result = build_result(
        scenario,
        radar,
        first,
        DetectionRun(
            first_frame=numbers.start, detections=detections_from_columns(arrays), frames=frames
        ),
    )
    waiting_s = perf_counter() - start_s - processing_s - result.timing_s["process"]
    return replace(
        result,
        findings=(
            *stream.findings,
            _only_first_frame_kept_finding(),
            *_ambiguity_resolved_per_frame_findings(radar.frame.n_intervals),
            *fit_findings,
            *repair.findings(str(first.attrs["units"]), stream.findings),
            *result.findings,
        ),
        timing_s={"wait": waiting_s, "process": processing_s + result.timing_s["process"]},
    )


def _checked_stream_source(scenario: Scenario) -> RecordingSource:
    """Return the recording to follow; raise if there is none, or it is not a DCA1000 stream."""
    source = scenario.recording
    if source is None:
        raise InvalidSetting(
            "--follow",
            value="given for a simulated scene",
            expected="a scenario with a recording to follow",
            fix="remove --follow, or name the recording",
        )
    for name, accepted in (("format", "dca1000"), ("axes", None), ("encoding", None)):
        setting = getattr(source, name)
        if setting not in (None, accepted):
            raise InvalidSetting(
                f"--{name}",
                value=f"{setting}, of a stream",
                expected="the raw samples of a DCA1000, the only ones that can be followed",
                fix=f"remove --{name}, or read the complete file without --follow",
            )
    return source


def _treat_stream_faults(cube: xr.DataArray, radar: Radar, scenario: Scenario) -> FaultTreatment:
    """Choose the treatment of the faults of a stream by its first frame."""
    assert scenario.recording is not None
    if not scenario.recording.repair_faults:
        return keep_faults(radar, scenario.chain)
    measures = measure_frame_quality(cube, radar)
    return treat_measured_faults(
        RecordingMeasures(measures=measures, radar=radar),
        scenario.chain,
        fits_chain=scenario.recording.may_choose_mitigation,
    )


def _only_first_frame_kept_finding() -> Finding:
    return Finding(
        level="note",
        setting="recording",
        value="samples kept of the first frame only, as a stream has no end",
        expected="a recording, if all samples are needed",
        fix="no action is needed",
    )


def _ambiguity_resolved_per_frame_findings(n_intervals: int) -> tuple[Finding, ...]:
    if n_intervals == 1:
        return ()
    return (
        Finding(
            level="note",
            setting="radar.frame.interval",
            value="velocity ambiguity resolved from each frame alone",
            expected="frames of several intervals together",
            fix="record the frames, and run the recording to use all intervals",
        ),
    )

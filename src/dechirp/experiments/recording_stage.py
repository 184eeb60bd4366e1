"""Detections in a recording: its faults repaired, its chain fitted, its velocities resolved.

A run processes every frame of a recording. Then the ranges of moving targets in successive frames
decide what one frame cannot: the ambiguity numbers of their velocities, and which ramps of a
triangle rise. If a format leaves that open, and the ranges show the opposite sign of the
velocities, the other ramps are processed; they are taken if their velocities have the sign of the
ranges.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import get_args

import numpy as np
import xarray as xr

from dechirp.core.conventions import CUBE_AXES
from dechirp.core.detection_columns import detections_from_columns
from dechirp.core.errors import DechirpError
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.experiments.frame_totals import FrameTotals
from dechirp.experiments.recording_faults import MeasuredFrames, treat_recording_faults
from dechirp.experiments.scenario import (
    Scenario,
    check_chain_fits_radar,
    check_tracks_and_ego_motion_possible,
)
from dechirp.processing.chain import Chain
from dechirp.processing.chain_fitting import ChosenSettingName, fit_chain_to_frames
from dechirp.processing.channel_errors import hidden_channel_error_findings
from dechirp.processing.detect import FrameProcessor
from dechirp.processing.image_echoes import find_image_echoes, image_echo_findings
from dechirp.processing.leakage import leakage_findings
from dechirp.processing.moving_targets import motion_beyond_errors
from dechirp.processing.multiple_echoes import find_multiple_echoes, multiple_echo_findings
from dechirp.processing.noise_profile import (
    doubtful_motion_mask,
    maps_of_rising_ramps,
    noise_excess_of_ranges,
    noise_profile_findings,
)
from dechirp.processing.receiver_noise import (
    correlated_noise_findings,
    count_independent_receivers,
)
from dechirp.processing.velocity_ambiguity.by_range_rate import (
    can_resolve_by_range_rate,
    range_rate_findings,
    resolve_by_range_rate,
)
from dechirp.processing.velocity_ambiguity.sign_by_range_rate import (
    DECISIVE_LOG_LIKELIHOOD_RATIO,
    velocity_sign_log_likelihood_ratio,
)
from dechirp.processing.velocity_drift import (
    velocity_drift_findings,
    velocity_drift_m_per_s,
    widen_velocity_errors,
)
from dechirp.radar.radar import Radar
from dechirp.recordings.recording import Recording
from dechirp.recordings.recording import open as open_recording


def open_scenario_recording(scenario: Scenario) -> Recording:
    """Open the recording of a scenario.

    Raises
    ------
    DechirpError
        If it cannot be read, or does not fit the scenario's settings.
    """
    assert scenario.recording is not None
    source = scenario.recording
    recording = open_recording(
        source.path,
        radar=scenario.radar,
        settings=source.settings_path,
        device=source.device,
        format=source.format,
        axes=source.axes,
        encoding=source.encoding,
        iq=source.iq,
        calibration=source.calibration,
        frames=source.frames,
    )
    recording.check_has_samples()
    check_chain_fits_radar(scenario.chain, recording.radar)
    check_tracks_and_ego_motion_possible(scenario, recording.radar)
    return recording


@frozen_dataclass
class PreparedRecording:
    """Recording whose faults are repaired, with the chain that fits it."""

    scenario: Scenario
    """The scenario with the fitted chain."""
    frames: MeasuredFrames
    findings: tuple[Finding, ...]
    """Notes on what was chosen."""


def prepare_recording(recording: Recording, scenario: Scenario) -> PreparedRecording:
    """Choose the repair and the chain of a scenario's recording by some of its frames."""
    assert scenario.recording is not None
    treatment = treat_recording_faults(
        recording,
        scenario.chain,
        repairs_faults=scenario.recording.repair_faults,
        fits_chain=scenario.recording.may_choose_mitigation,
    )
    frames = MeasuredFrames(recording, treatment)
    fitted, choices = fit_scenario_to_recording(
        replace(scenario, chain=treatment.chain), frames.first_and_middle_frame(), frames.radar
    )
    return PreparedRecording(
        scenario=fitted, frames=frames, findings=(*treatment.findings, *choices)
    )


def fit_scenario_to_recording(
    scenario: Scenario, cubes: Iterable[xr.DataArray], radar: Radar
) -> tuple[Scenario, tuple[Finding, ...]]:
    """Return the scenario with the chain that fits its recording, and notes on what was chosen.

    `cubes` are some frames of the recording. Scenarios with a scene stay unchanged.
    """
    if scenario.recording is None or not scenario.recording.fit_chain:
        return scenario, ()
    frames = (cube.transpose(*CUBE_AXES).values[0] for cube in cubes)
    chain, choices = fit_chain_to_frames(
        scenario.chain, radar, frames, kept=scenario.recording.kept_settings
    )
    # Readers join single chirps: the given radar may have fewer chirps than that of the recording.
    given_radar = None if scenario.radar is None else radar
    # The fitted scenario, run again, gives the same result.
    source = replace(scenario.recording, kept_settings=get_args(ChosenSettingName))
    fitted = replace(scenario, radar=given_radar, recording=source, chain=chain)
    return fitted, tuple(choice.to_finding() for choice in choices)


@frozen_dataclass
class DetectedRecording:
    """Detections in all frames of a recording, with what was chosen to find them."""

    scenario: Scenario
    """The scenario with the fitted chain, and the encoding that was chosen."""
    reader_findings: tuple[Finding, ...]
    """Findings of the reader, and notes on what was chosen."""
    frames: MeasuredFrames
    totals: FrameTotals
    columns: Mapping[str, np.ndarray]
    """Columns of `core.detection_columns`."""
    findings: tuple[Finding, ...] = ()
    """Findings on the detections of all frames together."""


def detect_in_recording(
    recording: Recording,
    scenario: Scenario,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> DetectedRecording:
    """Process all frames of the opened recording of a scenario, and resolve their velocities.

    `progress` is called with the number of finished frames and of all.
    """
    detected = _process_frames(recording, scenario, progress)
    ratio = _velocity_sign_ratio(detected)
    if ratio < -DECISIVE_LOG_LIKELIHOOD_RATIO:
        detected = _process_other_ramps(detected, recording, scenario, progress)
    return _resolve_velocities(detected)


def _resolve_velocities(detected: DetectedRecording) -> DetectedRecording:
    """Return the detections with the ambiguity numbers that the ranges of targets give.

    Their standard errors contain the drift that static echoes show.
    """
    columns, radar = detected.columns, detected.frames.radar
    findings = detected.findings
    if _resolves_by_range_rate(detected.scenario, radar):
        columns = resolve_by_range_rate(columns, radar.frame)
        findings += range_rate_findings(detected.columns, columns)
    drift_m_per_s = velocity_drift_m_per_s(columns, radar)
    if drift_m_per_s > 0:
        columns = widen_velocity_errors(columns, drift_m_per_s)
        # Errors of resolved velocities contain other ambiguity numbers, which change no motion.
        std_m_per_s = np.hypot(detected.columns["velocity_std"], drift_m_per_s)
        columns["moving"] = motion_beyond_errors(
            columns["moving"], columns["velocity"], std_m_per_s
        )
        findings += velocity_drift_findings(drift_m_per_s, radar)
    findings += leakage_findings(detections_from_columns(columns), radar, detected.scenario.chain)
    max_range_m = detected.scenario.chain.max_range_m
    findings += multiple_echo_findings(find_multiple_echoes(columns, radar, max_range_m))
    findings += hidden_channel_error_findings(columns, detected.totals.channel_phase_rms_rad, radar)
    return replace(detected, columns=columns, findings=findings)


def _process_frames(
    recording: Recording, scenario: Scenario, progress: Callable[[int, int], None] | None
) -> DetectedRecording:
    """Process all frames, each alone."""
    prepared = prepare_recording(recording, scenario)
    processor = FrameProcessor(prepared.frames.radar, prepared.scenario.chain)
    numbers, totals = recording.frame_numbers, FrameTotals()
    for frame in processor.process_cubes(prepared.frames, first_frame_number=numbers.start):
        totals.add_frame_result(frame)
        if progress is not None:
            progress(len(totals.times_s), len(numbers))
    columns = processor.joined_detection_columns()
    noise_findings = _find_noise_profile(prepared, columns)
    return DetectedRecording(
        scenario=prepared.scenario,
        reader_findings=(*recording.findings, *prepared.findings),
        frames=prepared.frames,
        totals=totals,
        columns=columns,
        findings=(
            *_find_correlated_noise(prepared, columns["snr"]),
            *noise_findings,
            *_find_images(prepared, columns),
        ),
    )


def note_rejected_images(findings: Iterable[Finding], chain: Chain) -> Iterator[Finding]:
    """Yield findings; a warning of I/Q images is a note if the chain leaves them out."""
    for finding in findings:
        if finding.setting == "recording.iq_image" and chain.image_rejection is not None:
            fix = "no action needed: chain.image_rejection leaves images out of the detections"
            yield replace(finding, level="note", fix=fix)
        else:
            yield finding


def _find_noise_profile(
    prepared: PreparedRecording, columns: dict[str, np.ndarray]
) -> tuple[Finding, ...]:
    """Return a note on moving detections in noise that depends on range.

    Their motion becomes unknown, since a threshold for this noise would not confirm it.
    """
    radar = prepared.frames.radar
    chain = prepared.scenario.chain.fit_to_radar(radar)
    if chain.moving_targets is None or not np.any(columns["moving"] == 1):
        return ()
    moving_chain = chain.moving_target_chain()
    frames = (
        cube.transpose(*CUBE_AXES).values[0] for cube in prepared.frames.first_and_middle_frame()
    )
    excess = noise_excess_of_ranges(frames, radar, moving_chain)
    findings = noise_profile_findings(columns, excess, radar, moving_chain)
    is_doubtful = doubtful_motion_mask(columns, excess, radar, moving_chain)
    columns["moving"] = np.where(is_doubtful, np.nan, columns["moving"])
    return findings


def _find_images(
    prepared: PreparedRecording, columns: Mapping[str, np.ndarray]
) -> tuple[Finding, ...]:
    """Return a note on I/Q images among the detections of the first and the middle frame."""
    frames, radar = prepared.frames, prepared.frames.radar
    chain = prepared.scenario.chain.fit_to_radar(radar)
    if radar.frame.chirp.sampling != "complex":
        return ()
    maps = {}
    for number, cube in zip(
        frames.first_and_middle_numbers(), frames.first_and_middle_frame(), strict=True
    ):
        samples = cube.transpose(*CUBE_AXES).values[0]
        for power, _ in maps_of_rising_ramps([samples], radar, chain):
            maps[number] = power
    return image_echo_findings(find_image_echoes(columns, maps, radar, chain), radar)


def _find_correlated_noise(prepared: PreparedRecording, snr: np.ndarray) -> tuple[Finding, ...]:
    """Return a warning if the receivers have noise in common in the first and the middle frame."""
    radar = prepared.frames.radar
    cfar = prepared.scenario.chain.fit_to_radar(radar).cfar
    window, probability = cfar.training_window, cfar.false_alarm_probability
    if radar.array.n_rx < 2 or probability is None:  # a given threshold has no probability
        return ()
    n_independent = [
        count_independent_receivers(cube.transpose(*CUBE_AXES).values[0], radar.frame.n_slots)
        for cube in prepared.frames.first_and_middle_frame()
    ]
    return correlated_noise_findings(
        max(n_independent),
        radar.array.n_rx,
        snr,
        n_training=len(window.training_cell_offsets(window.half_range)),
        false_alarm_probability=probability,
    )


def _velocity_sign_ratio(detected: DetectedRecording) -> float:
    """Return the log-likelihood ratio of the stated and the opposite sign of the velocities."""
    radar = detected.frames.radar
    if not _resolves_by_range_rate(detected.scenario, radar):
        return 0.0
    return velocity_sign_log_likelihood_ratio(detected.columns, radar.frame)


def _process_other_ramps(
    detected: DetectedRecording,
    recording: Recording,
    scenario: Scenario,
    progress: Callable[[int, int], None] | None,
) -> DetectedRecording:
    """Return the detections in the other ramps of a triangle, if their velocities fit the ranges.

    Otherwise return those given, with a warning on the sign of their velocities.
    """
    encoding = recording.contents.other_ramps_encoding
    if encoding is not None:
        assert scenario.recording is not None
        source = replace(scenario.recording, encoding=encoding)
        other_scenario = replace(scenario, recording=source)
        try:
            other_recording = open_scenario_recording(other_scenario)
            if recording.n_frames < recording.contents.n_frames:
                numbers = recording.frame_numbers
                stop = min(numbers.stop, other_recording.contents.n_frames)
                other_recording = other_recording.select_frames(numbers.start, stop)
            other = _process_frames(other_recording, other_scenario, progress)
        except DechirpError:  # the pulses of the sync are shorter than the pauses, or the reverse
            other = None
        if other is not None and _velocity_sign_ratio(other) > DECISIVE_LOG_LIKELIHOOD_RATIO:
            note = _chosen_ramps_note(encoding)
            return replace(other, findings=(note, *other.findings))
    warning = _opposite_sign_warning(encoding)
    return replace(detected, findings=(warning, *detected.findings))


def _chosen_ramps_note(encoding: str) -> Finding:
    return Finding(
        level="note",
        setting="encoding",
        value=f"chosen --encoding {encoding} because the ranges of moving targets fall and rise"
        " against the velocities of the other ramps, and with those of these",
        expected="rising ramps, since falling ones reverse the sign of velocities",
        fix="no action needed; --encoding inverted reads the other ramps",
    )


def _opposite_sign_warning(encoding: str | None) -> Finding:
    proposal = "" if encoding is None else f"--encoding {encoding} reads the other ramps; "
    return Finding(
        level="warning",
        setting="radar.frame.chirp.slope",
        value="velocities have the wrong sign: the ranges of moving targets in successive frames"
        " fall where their velocities are positive, or the reverse",
        expected="rising ramps, and I before Q, as the settings state",
        fix=f"{proposal}exchange I and Q with --iq, or correct the sign of the slope, or the times"
        " of the frames, in the settings",
    )


def _resolves_by_range_rate(scenario: Scenario, radar: Radar) -> bool:
    """Return whether the ranges in successive frames may resolve the ambiguity of velocities."""
    source = scenario.recording
    return source is not None and source.fit_chain and can_resolve_by_range_rate(radar.frame)

"""Faults of a recording that affect a run: reported, and repaired where that is safe.

Some frames decide before the run which receivers work, and whether chirps contain bursts. Every
frame is measured during the run, its outlier and lost chirps are interpolated, and chirps that
begin between two samples are aligned.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import xarray as xr

from dechirp.core.findings import Finding
from dechirp.core.text import format_number, format_number_ranges, join_names
from dechirp.core.values import frozen_dataclass
from dechirp.experiments.inspection import find_sample_findings
from dechirp.processing.chain import Chain
from dechirp.processing.mitigation.chirp_alignment import MIN_OFFSET, align_chirps
from dechirp.processing.mitigation.chirp_interpolation import (
    interpolable_chirp_mask,
    interpolate_chirps,
)
from dechirp.processing.mitigation.interference_repair import (
    InterferenceAutoregression,
    InterferenceRepair,
)
from dechirp.processing.quality.chirp_findings import (
    BURST_REPAIR_OPTION,
    has_burst_mask,
    outlier_chirp_mask,
)
from dechirp.processing.quality.measures import QualityMeasurer
from dechirp.processing.quality.receivers import working_receivers
from dechirp.processing.quality.recording_measures import RecordingMeasures
from dechirp.radar.radar import Radar
from dechirp.recordings.recording import Recording, label_frames_as_cube
from dechirp.recordings.samples.stationary_tones import StationaryTones

_N_SAMPLED_FRAMES = 8  # frames all over the recording that decide before the run
_UNDO_TEXT = "--set recording.repair_faults=false keeps the samples as recorded"
_MAX_BURST_SHARE = 0.5  # of the chirps; repair needs a background in the others


@frozen_dataclass
class FaultTreatment:
    """Treatment of the faults of a recording or a stream."""

    receivers: tuple[int, ...]
    """Receivers that are used, by their numbers in the recording."""
    repairs_chirps: bool
    """Whether outlier and lost chirps are interpolated, and chirps aligned."""
    chain: Chain
    findings: tuple[Finding, ...]
    """Notes on what was left out or chosen."""


def treat_recording_faults(
    recording: Recording, chain: Chain, *, repairs_faults: bool = True, fits_chain: bool = True
) -> FaultTreatment:
    """Choose the treatment of a recording by some of its frames, see `treat_measured_faults`."""
    if not repairs_faults:
        return keep_faults(recording.radar, chain)
    return treat_measured_faults(_measure_sampled_frames(recording), chain, fits_chain=fits_chain)


def keep_faults(radar: Radar, chain: Chain) -> FaultTreatment:
    """Return the treatment that keeps the samples of all receivers as recorded."""
    receivers = tuple(range(radar.array.n_rx))
    return FaultTreatment(receivers=receivers, repairs_chirps=False, chain=chain, findings=())


def treat_measured_faults(
    measures: RecordingMeasures, chain: Chain, *, fits_chain: bool
) -> FaultTreatment:
    """Leave out receivers that do not work, and choose a repair where chirps contain bursts.

    Without `fits_chain`, or with mitigation of its own, the chain stays unchanged.
    """
    used = tuple(range(measures.radar.array.n_rx))
    findings: tuple[Finding, ...] = ()
    working = working_receivers(measures)
    if 0 < working.size < len(used):
        findings += (_left_out_receivers_note(np.setdiff1d(used, working), working),)
        used = tuple(working.tolist())
    has_burst = has_burst_mask(measures)
    is_repairable = has_burst.any() and has_burst.mean() < _MAX_BURST_SHARE
    if is_repairable and fits_chain and not chain.mitigation:
        chain = replace(chain, mitigation=(InterferenceAutoregression(),))
        findings += (_chosen_burst_repair_note(has_burst),)
    return FaultTreatment(receivers=used, repairs_chirps=True, chain=chain, findings=findings)


def _measure_sampled_frames(recording: Recording) -> RecordingMeasures:
    numbers = recording.frame_numbers
    n_sampled = min(_N_SAMPLED_FRAMES, len(numbers))
    measurer = QualityMeasurer(recording.radar)
    for index in np.unique(np.linspace(0, len(numbers) - 1, n_sampled).astype(int)).tolist():
        frame = recording.select_frames(numbers[index], numbers[index] + 1)
        for number, samples, is_lost in frame.iter_frame_samples():
            measurer.add_frame(samples, is_lost, recording.radar.frame.frame_start_s(number))
    return RecordingMeasures(
        measures=measurer.joined_measures(recording.contents.units), radar=recording.radar
    )


class FrameRepair:
    """Repair of successive frames, which are measured on the way."""

    def __init__(self, radar: Radar, treatment: FaultTreatment, *, n_frames: int = 1) -> None:
        self._radar, self._treatment = radar, treatment
        self._measurer = QualityMeasurer(radar, n_frames=n_frames)
        self._n_chirps = self._n_interpolated = self._n_zeroed = 0
        self._largest_offset = 0.0
        self._tones_hz = np.zeros(0)

    @property
    def has_changed_samples(self) -> bool:
        """True if a chirp of a receiver in use was changed."""
        return (
            self._n_interpolated + self._n_zeroed > 0
            or self._largest_offset > MIN_OFFSET
            or self._tones_hz.size > 0
        )

    def repair_samples(
        self,
        samples: np.ndarray,
        is_lost: np.ndarray | None,
        number: int,
        start_offsets: np.ndarray | None = None,
        tones: StationaryTones | None = None,
    ) -> np.ndarray:
        """Return the samples (chirp, rx, sample) of the receivers in use, without outlier chirps.

        `is_lost` and `start_offsets` (chirp,) are those of the frame, `tones` those of the
        recording, see `Contents`.
        """
        frame = self._radar.frame
        measures = self._measurer.add_frame(samples, is_lost, frame.frame_start_s(number))
        used_samples = samples[:, list(self._treatment.receivers)]
        self._n_chirps += len(samples)
        if not self._treatment.repairs_chirps:
            return used_samples
        if tones is not None and tones.frequencies_hz.size:
            used_samples = used_samples - tones.in_frame(number)[:, None]
            self._tones_hz = tones.frequencies_hz
        if start_offsets is not None:
            used_samples = align_chirps(used_samples, start_offsets)
            self._largest_offset = max(self._largest_offset, float(abs(start_offsets).max()))
        is_missing = outlier_chirp_mask(measures["unlike"], measures["burst"]) | measures["lost"]
        if is_missing.any():
            used_samples = interpolate_chirps(used_samples, is_missing, frame.n_slots)
            n_interpolated = int(interpolable_chirp_mask(is_missing, frame.n_slots).sum())
            self._n_interpolated += n_interpolated
            self._n_zeroed += int(is_missing.sum()) - n_interpolated
        return used_samples

    def repair_cube(self, cube: xr.DataArray, number: int) -> xr.DataArray:
        """Return the cube of one frame (frame, chirp, rx, sample) with the repaired samples."""
        is_lost = np.array(cube["gap"].values[0], bool) if "gap" in cube.coords else None
        samples = self.repair_samples(cube.values[0], is_lost, number)
        if not self.has_changed_samples and samples.shape == cube.shape[1:]:
            return cube
        return cube.isel(rx=list(self._treatment.receivers)).copy(data=samples[None])

    def findings(self, units: str, reader_findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
        """Return the warnings on the samples of all frames, and the repairs of their chirps."""
        measures = self._measurer.joined_measures(units)
        findings = find_sample_findings(measures, self._radar, reader_findings)
        return (
            *(
                self._finding_after_repair(finding)
                for finding in findings
                if finding.level == "warning"
            ),
            *_chirp_alignment_findings(self._largest_offset),
            *_tone_findings(self._tones_hz, self._radar),
            *_chirp_repair_findings(self._n_interpolated, self._n_zeroed, self._n_chirps),
        )

    def _finding_after_repair(self, finding: Finding) -> Finding:
        """Return the finding on bursts without the option that the run has already taken."""
        mitigation = self._treatment.chain.mitigation
        is_repaired = any(isinstance(method, InterferenceRepair) for method in mitigation)
        if finding.setting != "recording.interference" or not is_repaired:
            return finding
        return replace(finding, fix="no action needed: chain.mitigation repairs these chirps")


def repair_recording(recording: Recording, treatment: FaultTreatment) -> Recording:
    """Return the recording of the receivers in use, whose frames are repaired when decoded."""
    used = recording.select_receivers(treatment.receivers)
    if not treatment.repairs_chirps:
        return used
    all_contents = recording.contents

    def decode(number: int, out: np.ndarray) -> None:
        assert all_contents.decode is not None
        samples = np.empty((len(out), recording.radar.array.n_rx, out.shape[2]), out.dtype)
        all_contents.decode(number, samples)
        gaps, offsets = (
            None if values is None else values[number]
            for values in (all_contents.gaps, all_contents.start_offsets)
        )
        out[:] = FrameRepair(recording.radar, treatment).repair_samples(
            samples, gaps, number, offsets, all_contents.tones
        )

    # Interpolated samples are no integers of the converter, and equal times need no alignment.
    contents = replace(
        used.contents,
        decode=decode,
        decode_frames=None,
        scale=None,
        start_offsets=None,
        tones=None,
    )
    return replace(used, contents=contents)


class MeasuredFrames:
    """Frames of a recording for processing, measured and repaired on the way."""

    def __init__(self, recording: Recording, treatment: FaultTreatment) -> None:
        self._recording, self._treatment = recording, treatment
        self.radar = recording.radar.select_receivers(treatment.receivers)
        """The radar of the frames, with the receivers in use."""
        self._repair = FrameRepair(recording.radar, treatment, n_frames=recording.n_frames)
        self._measured_numbers: set[int] = set()

    def __iter__(self) -> Iterator[xr.DataArray]:
        """Yield cubes of one frame each of the receivers in use, without outlier chirps."""
        yield from self._iter_repaired_cubes(self._recording, self._repair)

    def read_frame(self, number: int) -> xr.DataArray:
        """Return the cube of one frame, which is measured when it is read first."""
        repair = self._repair
        if number in self._measured_numbers:
            repair = FrameRepair(self._recording.radar, self._treatment)
        (cube,) = self._iter_repaired_cubes(
            self._recording.select_frames(number, number + 1), repair
        )
        return cube

    def first_and_middle_numbers(self) -> list[int]:
        """Return the numbers of the first and the middle frame, one if they are the same."""
        numbers = self._recording.frame_numbers
        return sorted({numbers[0], numbers[len(numbers) // 2]})

    def first_and_middle_frame(self) -> Iterator[xr.DataArray]:
        """Yield the cubes of two frames, repaired as in the run: the first may be damaged."""
        for number in self.first_and_middle_numbers():
            frame = self._recording.select_frames(number, number + 1)
            yield from MeasuredFrames(frame, self._treatment)

    @property
    def n_measured(self) -> int:
        """Number of frames that were read."""
        return len(self._measured_numbers)

    def _iter_repaired_cubes(
        self, recording: Recording, repair: FrameRepair
    ) -> Iterator[xr.DataArray]:
        contents = recording.contents
        used_contents, offsets = replace(contents, radar=self.radar), contents.start_offsets
        for number, samples, is_lost in recording.iter_frame_samples():
            used_samples = repair.repair_samples(
                samples,
                is_lost,
                number,
                None if offsets is None else offsets[number],
                contents.tones,
            )
            self._measured_numbers.add(number)
            gaps = None if is_lost is None else is_lost[None]
            yield label_frames_as_cube(
                used_samples[None], used_contents, first_frame=number, gaps=gaps
            )

    def processed_recording(self) -> Recording:
        """Return the recording with the samples that were processed, after the last frame.

        Without repairs those as recorded, with the codes of their converter.
        """
        if self._repair.has_changed_samples:
            return repair_recording(self._recording, self._treatment)
        return self._recording.select_receivers(self._treatment.receivers)

    def findings(self) -> tuple[Finding, ...]:
        """Return the warnings on the samples of all frames, and the repairs of their chirps."""
        return self._repair.findings(self._recording.contents.units, self._recording.findings)


def _left_out_receivers_note(faulty: np.ndarray, working: np.ndarray) -> Finding:
    faulty_text = format_number_ranges("receiver", faulty)
    return Finding(
        level="note",
        setting="radar.array.rx",
        value=f"{faulty_text} left out, since {'it has' if faulty.size == 1 else 'they have'} no"
        f" signal of {'its' if faulty.size == 1 else 'their'} own;"
        f" {format_number_ranges('receiver', working)} used",
        expected="receivers that all work, since others corrupt directions",
        fix="check the board, or the number of receivers and the sample order in the settings;"
        f" {_UNDO_TEXT}",
    )


def _chosen_burst_repair_note(has_burst: np.ndarray) -> Finding:
    return Finding(
        level="note",
        setting="chain.mitigation",
        value=f"chosen {BURST_REPAIR_OPTION} because of bursts in"
        f" {np.count_nonzero(has_burst)} of {has_burst.size} chirps",
        expected="samples without bursts, which raise the noise of a whole frame",
        fix=f"give another mitigation to replace it; {_UNDO_TEXT}",
    )


def _chirp_alignment_findings(largest_offset: float) -> tuple[Finding, ...]:
    """Return a note on chirps that begin between two samples; `largest_offset` in intervals."""
    if largest_offset <= MIN_OFFSET:
        return ()
    note = Finding(
        level="note",
        setting="recording.repair_faults",
        value=f"chirps begin up to {largest_offset:.2f} sample intervals from their first sample:"
        " interpolated at equal times of each ramp",
        expected="a sample clock synchronous with the ramps, else static echoes have images at"
        " other velocities",
        fix=_UNDO_TEXT,
    )
    return (note,)


def _tone_findings(tones_hz: np.ndarray, radar: Radar) -> tuple[Finding, ...]:
    """Return a note on tones that were subtracted, with the ranges that they have as echoes."""
    if not tones_hz.size:
        return ()
    frequencies = join_names(f"{tone_hz:.0f}" for tone_hz in tones_hz)
    ranges = join_names(format_number(radar.frame.chirp.range_m(f), 3) for f in tones_hz)
    note = Finding(
        level="note",
        setting="recording.repair_faults",
        value=f"tones at {frequencies} Hz that do not follow the ramps, as of a sound card:"
        f" subtracted, since they look like targets at {ranges} m",
        expected="samples that contain only echoes, whose spectrum repeats with the ramps",
        fix=_UNDO_TEXT,
    )
    return (note,)


def _chirp_repair_findings(
    n_interpolated: int, n_zeroed: int, n_chirps: int
) -> tuple[Finding, ...]:
    """Return a note on interpolated chirps, and a warning about those that could not be."""
    findings: tuple[Finding, ...] = ()
    if n_interpolated:
        note = Finding(
            level="note",
            setting="recording.repair_faults",
            value=f"{n_interpolated} of {n_chirps} chirps are lost or unlike the others:"
            " interpolated among the chirps of the same transmitter",
            expected="equal chirps, since an outlier adds to every velocity",
            fix=_UNDO_TEXT,
        )
        findings += (note,)
    if n_zeroed:
        warning = Finding(
            level="warning",
            setting="recording.repair_faults",
            value=f"{n_zeroed} of {n_chirps} chirps are zero, lost or unlike the others, in frames"
            " with too many of them to interpolate",
            expected="of 16 chirps or more of each transmitter, at most a quarter lost, and at most"
            " an eighth in a row",
            fix="select other frames with --frames, or record again: strong echoes have"
            f" sidelobes over all velocities there; {_UNDO_TEXT}",
        )
        findings += (warning,)
    return findings

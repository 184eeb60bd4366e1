"""Simulated twin of a recorded frame."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_integer
from dechirp.core.compiled_kernels import use_compiled_kernels
from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding, capture_warned_findings
from dechirp.core.units import to_decibels
from dechirp.core.values import frozen_dataclass
from dechirp.experiments.recording_faults import MeasuredFrames, treat_recording_faults
from dechirp.experiments.scenario import Scenario
from dechirp.experiments.twin.compare import compare_noise_floors, compare_peaks
from dechirp.experiments.twin.fitting import (
    fit_points_to_recorded_peaks,
    simulate_points_without_noise,
)
from dechirp.experiments.twin.initial_points import (
    estimate_initial_points,
    find_leakage_cell_in_unsearched_rows,
)
from dechirp.experiments.twin.measure import FrameMap, find_peak_cells
from dechirp.experiments.twin.receiver import (
    estimate_dc_offsets,
    estimate_watts_per_unit,
    fit_coloured_noise,
)
from dechirp.processing.cfar.base import Cells, Cfar
from dechirp.processing.cfar.ordered_statistic import OrderedStatistic
from dechirp.processing.chain import Chain
from dechirp.radar.hardware import Hardware
from dechirp.radar.radar import Radar
from dechirp.recordings.recording import Recording
from dechirp.simulation.simulate import simulate

ASSUMED_HARDWARE = Hardware(transmit_power_w=10**-1.8, antenna_gain=10.0, noise_factor=10**1.2)
"""12 dBm, 10 dBi and 12 dB, typical of common chips; a recording does not contain them."""

DEFAULT_MAX_PEAKS, MAX_PEAKS_LIMIT = 64, 256  # each is simulated alone in each round
_MIN_CHIRPS = 16  # for a median over velocities
_MAX_TRAINING = 500  # on each side: calibration of the factor takes seconds
_GUARD = 3  # a peak under a Hann window is 4 cells wide


@frozen_dataclass
class TwinTolerance:
    """Tolerance of a twin's differences from the recording."""

    power: float = 10**0.1
    """Largest ratio of powers, in either direction."""
    cells: float = 0.2
    """Largest distance along each axis, in cells of the map."""


@frozen_dataclass
class Twin:
    """Recorded frame with its simulation."""

    scenario: Scenario
    """Scenario of the twin: `run` returns the same samples."""
    recorded: xr.DataArray
    """Map of the recording, (velocity, range), W by `watts_per_unit`."""
    simulated: xr.DataArray
    """Map of its twin, with noise; the same chain."""
    differences: xr.Dataset
    """One row a peak, see `compare.compare_peaks`."""
    noise: xr.Dataset
    """Noise floor: overall, and over `segment`, see `compare.compare_noise_floors`."""
    recording_units: str
    """Units of its samples on disk."""
    watts_per_unit: float
    """Factor applied to `|sample|^2` of the recording; 1 where it is calibrated."""
    frame_number: int
    findings: tuple[Finding, ...]

    def peaks_precise_enough_to_judge(self, tolerance: TwinTolerance) -> np.ndarray:
        """Return the peaks that noise allows to be judged at a tolerance, (peak,).

        One standard deviation due to the twin's noise must be a third of the tolerance or less, and
        the peak outside the rows about zero range of real samples.
        """
        peaks = self.differences
        relative_std = np.maximum(
            3 * peaks.power_std.values / (tolerance.power - 1),
            3 * peaks.cells_std.values / tolerance.cells,
        )
        return np.asarray(peaks.is_searched.values & (relative_std <= 1))

    def peaks_within_tolerance(self, tolerance: TwinTolerance) -> np.ndarray:
        """Return the peaks within a tolerance, (peak,)."""
        peaks = self.differences
        return _differences_within_tolerance(
            tolerance, peaks.power_ratio, peaks.range_cells, peaks.velocity_cells
        )

    def noise_free_peaks_within_tolerance(self, tolerance: TwinTolerance) -> np.ndarray:
        """Return the peaks within a tolerance without noise in the twin, (peak,): judged or not."""
        peaks = self.differences
        return _differences_within_tolerance(
            tolerance, peaks.power_ratio_clean, peaks.range_cells_clean, peaks.velocity_cells_clean
        )

    def is_twin_within_tolerance(self, tolerance: TwinTolerance) -> bool:
        """Return whether the noise floor and all judged peaks are within a tolerance."""
        ratio = float(self.noise.ratio)
        is_level_near = np.isnan(ratio) or abs(np.log(ratio)) <= np.log(tolerance.power)
        return bool(
            is_level_near
            and np.all(
                self.peaks_within_tolerance(tolerance)[
                    self.peaks_precise_enough_to_judge(tolerance)
                ]
            )
        )


def _differences_within_tolerance(
    tolerance: TwinTolerance,
    power_ratio: xr.DataArray,
    range_cells: xr.DataArray,
    velocity_cells: xr.DataArray,
) -> np.ndarray:
    distance_cells = np.maximum(abs(range_cells.values), abs(velocity_cells.values))
    return np.asarray(
        (abs(np.log(power_ratio.values)) <= np.log(tolerance.power))
        & (distance_cells <= tolerance.cells)
    )


@check_argument_types
def twin(
    recording: Recording,
    *,
    chain: Chain | None = None,
    seed: int = 0,
    max_peaks: int = DEFAULT_MAX_PEAKS,
    repair_faults: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> Twin:
    """Simulate the first frame of a recording: its radar, its noise, and a point for each peak.

    Parameters
    ----------
    recording : Recording
        As `open` returns it, with its radar; `part` selects another frame.
    chain : Chain, optional
        Chain that finds the peaks and computes both maps. By default the default chain with a
        threshold over the median of all velocities of a range: static echoes then mask none.
    seed : int
        Seed of the noise of the twin.
    max_peaks : int
        Number of the strongest peaks to simulate.
    repair_faults : bool
        False keeps the samples of all receivers as recorded. By default receivers that do not work
        are left out, and outlier and lost chirps interpolated, as in `run`.
    progress : callable, optional
        Called with the number of finished rounds and of all.

    Raises
    ------
    InvalidSetting
        If `max_peaks` is not a number from 1 to 256, or `seed` is invalid.
    RecordingError
        If it contains no samples, only zeros, samples that are not finite, or falling ramps.
    DechirpError
        If the samples cannot be read, or would not fit into memory.

    Notes
    -----
    A recording does not contain its full scale in watts. Its noise determines it, once a noise
    factor is assumed: `|sample|^2` times the factor is such that the mean of the noise over all
    ranges is k T0 F fs; without noise, such that the strongest cell is 60 dB below the transmit
    power. Cross sections depend on the assumed hardware, differences do not.

    A peak is a point, so a person becomes as many points as it has peaks. Recorded noise in a peak
    becomes part of its point; that of the twin is added to it, and `power_std` and `cells_std` are
    its effect on the peak.
    """
    check_integer("max_peaks", max_peaks, at_least=1, at_most=MAX_PEAKS_LIMIT)
    use_compiled_kernels()  # thousands of small calls
    recording.check_has_samples()
    number = recording.frame_numbers.start
    _check_no_falling_ramps(recording, recording.radar)
    first = recording.select_frames(number, number + 1)
    _check_samples_finite_and_not_all_zero(recording, next(first.frames()))
    treatment = treat_recording_faults(
        first, Chain(), repairs_faults=repair_faults, fits_chain=False
    )
    measured = MeasuredFrames(first, treatment)
    frame = next(iter(measured)).isel(frame=0)
    recorded_radar = measured.radar.for_frame(number)
    repair_findings = map(_name_twin_argument, (*treatment.findings, *measured.findings()))
    chain = (chain or default_twin_chain(recorded_radar)).fit_to_radar(recorded_radar)
    radar = replace(
        recorded_radar, hardware=recorded_radar.hardware or ASSUMED_HARDWARE, calibration=None
    )
    watts = estimate_watts_per_unit(frame, radar, chain)
    samples = frame.copy(data=frame.values * np.sqrt(watts).astype(np.float32))
    recorded_map = FrameMap(samples=samples.assign_attrs(units="W**0.5"), radar=radar, chain=chain)
    peaks, leaks = find_peak_cells(recorded_map), find_leakage_cell_in_unsearched_rows(recorded_map)
    cells = peaks[:max_peaks]
    constants = estimate_dc_offsets(recorded_map) if len(leaks) else ()
    points = first_points = estimate_initial_points(recorded_map, recorded_radar, cells, leaks)
    if len(first_points):
        points = fit_points_to_recorded_peaks(
            recorded_map, first_points, radar, constants=constants, progress=progress
        )
    noise = fit_coloured_noise(recorded_map)
    scenario = Scenario(
        name=f"twin-of-{recording.path.stem}",
        seed=seed,
        radar=radar,
        scene=points.targets_as_scene(radar),
        impairments=(*points.leakage_impairments(radar), *constants, *noise),
        chain=chain,
    )
    assert scenario.scene is not None
    with capture_warned_findings() as simulation_findings:
        cube = simulate(scenario.scene, radar, impairments=scenario.impairments, seed=seed)
    twin_map = FrameMap(samples=cube.isel(frame=0), radar=radar, chain=chain)
    clean_map = simulate_points_without_noise(points, radar, recorded_map, constants)
    return Twin(
        scenario=scenario,
        recorded=recorded_map.power,
        simulated=twin_map.power,
        differences=compare_peaks(recorded_map, clean_map, twin_map, points),
        noise=compare_noise_floors(recorded_map, twin_map),
        recording_units=recording.contents.units,
        watts_per_unit=watts,
        frame_number=number,
        findings=(
            *recording.findings,
            *repair_findings,
            *_omitted_peak_findings(len(peaks), max_peaks),
            *_assumption_and_omission_findings(recording, recorded_radar, watts),
            # Target positions are measured, so findings on them do not matter.
            *(
                finding
                for finding in simulation_findings
                if not finding.setting.startswith("scene.targets")
            ),
        ),
    )


def default_twin_chain(radar: Radar) -> Chain:
    """Return the default chain, with the noise of a cell from up to 1000 velocities of its range.

    Static echoes at every range then mask nothing, unlike in a window about the cell.
    """
    half = min(radar.frame.n_chirps // 2 - _GUARD - 1, _MAX_TRAINING)
    if radar.frame.n_chirps < _MIN_CHIRPS:
        return Chain()
    return Chain(
        cfar=Cfar(
            estimator=OrderedStatistic(rank=0.5),
            n_training=Cells(range=0, velocity=half),
            n_guard=Cells(range=0, velocity=_GUARD),
            false_alarm_probability=1e-6,
        )
    )


def _check_no_falling_ramps(recording: Recording, radar: Radar) -> None:
    if radar.frame.has_falling_ramps:
        raise RecordingError(
            recording.path,
            value="of ramps that rise and fall, whose two maps have each peak in another place",
            expected="ramps of one kind",
            fix="simulate its settings with a scene of your own",
        )


def _check_samples_finite_and_not_all_zero(recording: Recording, frame: xr.DataArray) -> None:
    if not np.isfinite(frame.values).all():
        problem = "with samples that are not finite (NaN or infinite)"
    elif not frame.values.any():
        problem = "of nothing but zeros"
    else:
        return
    raise RecordingError(
        recording.path,
        value=f"{problem} in frame {recording.frame_numbers.start}",
        expected="echoes or noise to make a twin of",
        fix="choose another frame: --frames 3:4 takes number 3",
    )


def _name_twin_argument(finding: Finding) -> Finding:
    """Return a finding on repairs with the argument of `twin` in place of the option of `run`."""
    keep = "in Python: dc.twin(recording, repair_faults=False)"
    return replace(
        finding,
        fix=finding.fix.replace("--set recording.repair_faults=false", keep),
    )


def _omitted_peak_findings(n_peaks: int, max_simulated_peaks: int) -> Sequence[Finding]:
    if n_peaks <= max_simulated_peaks:
        return []
    return [
        Finding(
            level="note",
            setting="max_peaks",
            value=f"{n_peaks} peaks, of which the {max_simulated_peaks} strongest are simulated",
            expected=f"at most {max_simulated_peaks}, for a twin that has them all",
            fix=f"in Python: dc.twin(recording, max_peaks={min(n_peaks, MAX_PEAKS_LIMIT)})",
        )
    ]


def _assumption_and_omission_findings(
    recording: Recording, radar: Radar, watts_per_unit: float
) -> Sequence[Finding]:
    """Return findings on assumptions, and on omissions of a twin of points."""
    assumptions = []
    if radar.hardware is None:
        assumptions.append(
            Finding(
                level="note",
                setting="radar.hardware",
                value="missing, assumed to be 12 dBm, 10 dBi and a noise factor of 12 dB,"
                f" so that full scale is {_ratio_as_decibel_text(watts_per_unit * 1e3)} dBm",
                expected="the hardware of the radar, for absolute cross sections",
                fix="give --radar with its hardware",
            )
        )
    if radar.calibration is not None:
        assumptions.append(
            Finding(
                level="note",
                setting="radar.calibration",
                value="used for directions, and left out of the twin, whose array is ideal",
                expected="nothing: powers are of all channels together",
                fix="give the scenario a mismatch to have channels that differ",
            )
        )
    if recording.n_frames > 1:
        assumptions.append(
            Finding(
                level="note",
                setting="--frames",
                value=f"{recording.n_frames} frames, of which the first is simulated, number"
                f" {recording.frame_numbers.start}",
                expected="one frame: what moves is elsewhere in the next",
                fix="choose another as 3:4",
            )
        )
    return assumptions


def _ratio_as_decibel_text(ratio: float) -> str:
    return f"{float(to_decibels(ratio)):.4g}"

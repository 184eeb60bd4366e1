"""A recording and its simulation side by side: the page that calls the rest."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from dechirp.core.checks import whole
from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding, heard
from dechirp.core.units import decibels
from dechirp.core.values import value
from dechirp.echoes.echo import simulate
from dechirp.experiment.scenario import Scenario
from dechirp.experiment.twin.compare import differences, floors
from dechirp.experiment.twin.match import matched, simulated
from dechirp.experiment.twin.measure import Seen, peaks_of
from dechirp.experiment.twin.receiver import noise_over_range, offsets, watts_per_unit
from dechirp.experiment.twin.start import leak_cells, started
from dechirp.formats.recording import Recording
from dechirp.process.cfar.base import Cells, Cfar
from dechirp.process.cfar.ordered_statistic import OrderedStatistic
from dechirp.process.chain import Chain
from dechirp.process.health.findings import findings
from dechirp.process.health.measures import measure
from dechirp.radar.hardware import Hardware
from dechirp.radar.radar import Radar

ASSUMED = Hardware(transmit_power_w=10**-1.8, antenna_gain=10.0, noise_factor=10**1.2)
"""12 dBm, 10 dBi and 12 dB, as of common chips: what a recording does not tell."""

MOST_PEAKS, MOST_PEAKS_EVER = 64, 256  # each is simulated by itself, round by round
_FEWEST_CHIRPS = 16  # for a median over velocities
_MOST_TRAINING = 500  # on each side: a factor is calibrated for 2000 at most, in seconds for these
_GUARD = 3  # a peak under a Hann window is 4 cells wide


@value
class TwinBar:
    """How near a twin is to be."""

    power: float = 10**0.1
    """Largest ratio of powers, either way."""
    cells: float = 0.2
    """Largest distance along each axis, in cells of the map."""


@value
class Twin:
    """A frame of a recording, and the simulation that was made from it."""

    scenario: Scenario
    """Makes the twin: `run` gives the same samples."""
    recorded: xr.DataArray
    """Map of the recording, (velocity, range), W by the stated factor."""
    simulated: xr.DataArray
    """That of its twin, with noise; the same chain."""
    differences: xr.Dataset
    """A row for each peak, see `compare.differences`."""
    floor: xr.Dataset
    """Of the noise: overall, and over `stretch`, see `compare.floors`."""
    recording_units: str
    """Of its samples, as they are on disk."""
    watts_per_unit: float
    """What `|sample|^2` of the recording was multiplied by; 1 where it is calibrated."""
    frame_number: int
    findings: tuple[Finding, ...]

    def judged(self, bar: TwinBar) -> np.ndarray:
        """Of which peaks noise permits to ask that much, (peak,).

        Those whose own noise in the twin moves them by a third of the bar or less, one standard
        deviation, outside the rows about zero range of real samples.
        """
        found = self.differences
        moves = np.maximum(
            3 * found.power_std.values / (bar.power - 1), 3 * found.cells_std.values / bar.cells
        )
        return np.asarray(found.searched.values & (moves <= 1))

    def within(self, bar: TwinBar) -> np.ndarray:
        """Which peaks are as near as that, (peak,)."""
        found = self.differences
        return _near(bar, found.power_ratio, found.range_cells, found.velocity_cells)

    def within_clean(self, bar: TwinBar) -> np.ndarray:
        """Which would be, were there no noise in the twin, (peak,): also of those not judged."""
        found = self.differences
        return _near(
            bar, found.power_ratio_clean, found.range_cells_clean, found.velocity_cells_clean
        )

    def is_within(self, bar: TwinBar) -> bool:
        """Whether the floor and all peaks of which that can be asked are as near as that."""
        ratio = float(self.floor.ratio)
        level = np.isnan(ratio) or abs(np.log(ratio)) <= np.log(bar.power)
        return bool(level and np.all(self.within(bar)[self.judged(bar)]))


def _near(bar: TwinBar, ratio: xr.DataArray, fast: xr.DataArray, slow: xr.DataArray) -> np.ndarray:
    away = np.maximum(abs(fast.values), abs(slow.values))
    return np.asarray((abs(np.log(ratio.values)) <= np.log(bar.power)) & (away <= bar.cells))


def twin(
    recording: Recording,
    *,
    chain: Chain | None = None,
    seed: int = 0,
    most_peaks: int = MOST_PEAKS,
    progress: Callable[[int, int], None] | None = None,
) -> Twin:
    """Simulate the first frame of a recording: its radar, its noise, and a point for each peak.

    Parameters
    ----------
    recording : Recording
        As `open` gives it, with its radar; `part` chooses another frame.
    chain : Chain, optional
        What finds the peaks, and makes the map of both. Without it the default one, but peaks
        stand over the median of all velocities of their range: what stands still hides none.
    seed : int
        Of the noise of the twin.
    most_peaks : int
        So many of the strongest are taken.
    progress : callable, optional
        Called with the number of rounds done and of all.

    Raises
    ------
    InvalidSetting
        If `most_peaks` is no number from 1 to 256, or `seed` is none.
    RecordingError
        If it holds no samples, nothing but zeros, samples that are not finite, or ramps that fall.
    DechirpError
        If the samples cannot be read, or would not fit into memory.

    Notes
    -----
    A recording does not say what its full scale is in watts. Its noise tells, once a noise factor
    is assumed: `|sample|^2` times the stated factor is such that the mean of the noise over all
    ranges is k T0 F fs; without noise, such that the strongest cell is 60 dB below what is sent.
    Cross sections hold under the assumed hardware, differences do not depend on it.

    A peak is a point, so a person becomes as many points as peaks were seen. Noise of the
    recording that is in a peak becomes part of its point; that of the twin comes on top, and
    `power_std` and `cells_std` say by how much that moves the peak.
    """
    whole("most_peaks", most_peaks, at_least=1, at_most=MOST_PEAKS_EVER)
    recording.must_hold_samples()
    number = recording.frame_numbers.start
    own = recording.radar.at(number)
    _must_rise(recording, own)
    frame = next(recording.part(number, number + 1).frames()).isel(frame=0)
    _must_hold_something(recording, frame)
    chain = (chain or usual_chain(own)).fitted(own)
    radar = replace(own, hardware=own.hardware or ASSUMED, calibration=None)
    watts = watts_per_unit(frame, radar, chain)
    samples = frame.copy(data=frame.values * np.sqrt(watts).astype(np.float32))
    seen = Seen(frame=samples.assign_attrs(units="sqrt(W)"), radar=radar, chain=chain)
    peaks, leaks = peaks_of(seen), leak_cells(seen)
    cells = peaks[:most_peaks]
    constants = offsets(seen) if len(leaks) else ()
    found = start = started(seen, own, cells, leaks)
    if len(start):
        found = matched(seen, start, radar, constants=constants, progress=progress)
    noise = noise_over_range(seen)
    scenario = Scenario(
        name=f"twin-of-{recording.path.stem}",
        seed=seed,
        radar=radar,
        scene=found.scene(radar),
        impairments=(*found.leakage(radar), *constants, *noise),
        chain=chain,
    )
    assert scenario.scene is not None
    with heard() as said:
        cube = simulate(scenario.scene, radar, impairments=scenario.impairments, seed=seed)
    made = Seen(frame=cube.isel(frame=0), radar=radar, chain=chain)
    clean = simulated(found, radar, seen, constants)
    return Twin(
        scenario=scenario,
        recorded=seen.power,
        simulated=made.power,
        differences=differences(seen, clean, made, found),
        floor=floors(seen, made),
        recording_units=recording.contents.units,
        watts_per_unit=watts,
        frame_number=number,
        findings=(
            *recording.findings,
            *_unlike_points(frame, own),
            *_left_out(len(peaks), most_peaks),
            *_told(recording, own, watts),
            # Where targets are was measured: that their echoes come early or late is no surprise.
            *(one for one in said if not one.setting.startswith("scene.targets")),
        ),
    )


def usual_chain(radar: Radar) -> Chain:
    """The default chain, but with the noise of a cell from all velocities of its range, or 1000.

    What stands still at every range then hides nothing, as it does in a ring about the cell.
    """
    half = min(radar.frame.n_chirps // 2 - _GUARD - 1, _MOST_TRAINING)
    if radar.frame.n_chirps < _FEWEST_CHIRPS:
        return Chain()
    return Chain(
        cfar=Cfar(
            estimator=OrderedStatistic(rank=0.5),
            n_training=Cells(range=0, velocity=half),
            n_guard=Cells(range=0, velocity=_GUARD),
            false_alarm_probability=1e-6,
        )
    )


def _must_rise(recording: Recording, radar: Radar) -> None:
    if radar.frame.falls:
        raise RecordingError(
            recording.path,
            got="of ramps that rise and fall, whose two maps have each peak in another place",
            need="ramps of one kind",
            fix="Simulate its settings with a scene of your own.",
        )


def _must_hold_something(recording: Recording, frame: xr.DataArray) -> None:
    if not np.isfinite(frame.values).all():
        got = "with samples that are not finite (NaN or infinite)"
    elif not frame.values.any():
        got = "of nothing but zeros"
    else:
        return
    raise RecordingError(
        recording.path,
        got=f"{got} in frame {recording.frame_numbers.start}",
        need="echoes or noise to make a twin of",
        fix="Choose another frame: --frames 3:4 takes number 3.",
    )


def _unlike_points(frame: xr.DataArray, radar: Radar) -> Sequence[Finding]:
    """What is wrong with the frame, and would be taken for echoes or for noise."""
    measured = measure(frame.expand_dims("frame"), radar)
    return [one for one in findings(measured, radar) if one.level == "warning"]


def _left_out(n_peaks: int, most_peaks: int) -> Sequence[Finding]:
    if n_peaks <= most_peaks:
        return []
    return [
        Finding(
            level="note",
            setting="most_peaks",
            got=f"{n_peaks} peaks, of which the {most_peaks} strongest are simulated",
            need=f"at most {most_peaks}, for a twin that has them all",
            fix=f"In Python: dc.twin(recording, most_peaks={min(n_peaks, MOST_PEAKS_EVER)}).",
        )
    ]


def _told(recording: Recording, radar: Radar, watts: float) -> Sequence[Finding]:
    """What was assumed, and what a twin of points leaves out."""
    said = []
    if radar.hardware is None:
        said.append(
            Finding(
                level="note",
                setting="radar.hardware",
                got="not known; taken as 12 dBm, 10 dBi and a noise factor of 12 dB,"
                f" so that full scale is {_db(watts * 1e3)} dBm",
                need="its own for cross sections that hold; differences do not depend on it",
                fix="Give --radar with its hardware.",
            )
        )
    if radar.calibration is not None:
        said.append(
            Finding(
                level="note",
                setting="radar.calibration",
                got="used for directions, and left out of the twin, whose array is ideal",
                need="nothing: powers are of all channels together",
                fix="Give the scenario a mismatch to have channels that differ.",
            )
        )
    if recording.n_frames > 1:
        said.append(
            Finding(
                level="note",
                setting="--frames",
                got=f"{recording.n_frames} frames, of which the first is simulated, number"
                f" {recording.frame_numbers.start}",
                need="one frame: what moves is elsewhere in the next",
                fix="Choose another as 3:4.",
            )
        )
    return said


def _db(ratio: float) -> str:
    return f"{float(decibels(ratio)):.4g}"

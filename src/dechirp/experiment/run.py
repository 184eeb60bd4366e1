"""One experiment from start to end: the page on which simulation and processing meet."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from time import perf_counter

import numpy as np
import xarray as xr

from dechirp.core.accessor import rows
from dechirp.core.displayed import Displayed, Table, several
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, findings, heard
from dechirp.core.values import value
from dechirp.echoes.echo import simulate
from dechirp.experiment.followed import follow
from dechirp.experiment.link import added_noise_w, link_budget
from dechirp.experiment.scenario import Scenario, called, check_chain, check_following
from dechirp.formats.recording import Recording
from dechirp.formats.recording import open as open_recording
from dechirp.objects.object_list import object_list
from dechirp.process import near_field
from dechirp.process.cfar.base import Cfar
from dechirp.process.chain import Chain
from dechirp.process.detect import detect_each
from dechirp.process.maps import power_map, threshold_map
from dechirp.process.mitigation.cleaned import Removed, summary
from dechirp.process.peaks import MOST_PEAKS
from dechirp.process.remarks import remarks
from dechirp.radar.budget import BudgetLine
from dechirp.radar.radar import Radar
from dechirp.scene.truth import truth
from dechirp.tracking.live import LiveTracker


@value
class Result(Displayed):
    """What came out of one experiment."""

    scenario: Scenario
    radar: Radar
    source: xr.DataArray | Recording
    """The simulated cube, or the recording; of a stream the cube of its first frame."""
    first_frame: int
    """Number of the first frame that was processed, the one of the maps."""
    power: xr.DataArray
    """Range-Doppler map of the first frame, (velocity, range)."""
    threshold: xr.DataArray
    """Threshold of each of its cells."""
    detections: xr.Dataset
    ego: xr.Dataset | None = None
    """The radar's own motion over frames, from its detections; None where not asked for."""
    clusters: xr.Dataset | None = None
    """None where not asked for, as tracks."""
    tracks: xr.Dataset | None = None
    truth: xr.Dataset | None
    """None for a recording."""
    budget: tuple[BudgetLine, ...] | None
    """Of the first target; None for a recording."""
    findings: tuple[Finding, ...]
    timing_s: dict[str, float]
    times_s: tuple[float, ...]
    """Middle of each frame, from the first to the last."""

    @property
    def cube(self) -> xr.DataArray:
        """All samples that are kept, (frame, chirp, rx, sample); a recording is decoded now.

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
    def n_kept(self) -> int:
        """Number of frames whose samples are kept: of a stream the first alone."""
        return self.source.sizes["frame"]

    def _line(self) -> str:
        parts = [several(self.n_frames, "frame")]
        found = {"detection": self.detections, "cluster": self.clusters, "track": self.tracks}
        parts += [several(of.sizes[one], one) for one, of in found.items() if of is not None]
        parts += [several(len(self.findings), "finding")] if self.findings else []
        return f"{self.scenario.name}: {', '.join(parts)}"

    def _tables(self) -> Iterable[Table]:
        yield findings(self.findings)
        yield rows(self.detections, "Detections")
        if self.tracks is not None:
            yield rows(self.tracks, "Tracks")

    def frames(self) -> Iterator[xr.DataArray]:
        """Cubes of one frame each that are kept, those of a recording decoded when asked for."""
        return _one_by_one(self.source)


def run(
    scenario: Scenario,
    *,
    rng: np.random.Generator | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Result:
    """Simulate the scene, or open the recording, and process every frame.

    Parameters
    ----------
    scenario : Scenario
        As read by `load`, or made in Python.
    rng : Generator, optional
        What chance of a simulation is drawn from; seeded with the scenario's seed without it.
    progress : callable, optional
        Called with the number of steps done and of all: a frame that is simulated is one, a
        frame that is processed another.

    Raises
    ------
    DechirpError
        If a setting cannot work, the recording cannot be read, or memory would not hold it.
    """
    started = perf_counter()
    n_simulated = 0 if scenario.scene is None else scenario.n_frames
    if scenario.tracker is not None:
        with called("tracker", instead_of="Tracker"):
            LiveTracker(scenario.tracker)  # that it is not installed is said before, not after

    def simulated(done: int, of: int) -> None:
        if progress is not None:
            progress(done, 2 * of)

    source, radar, findings = _source(scenario, simulated, rng)
    opened = perf_counter()
    numbers = _numbers(source)
    times_s: list[float] = []
    took_out: list[tuple[Removed, ...]] = []

    def counted() -> Iterator[xr.DataArray]:
        for done, cube in enumerate(_one_by_one(source), 1):
            number = numbers.start + done - 1
            start_s = cube.frame.item() if "frame" in cube.coords else radar.frame.start_s(number)
            times_s.append(start_s + radar.frame.at(number).mid_frame_s)
            yield cube
            if progress is not None:
                progress(n_simulated + done, n_simulated + len(numbers))

    with heard() as crowded:
        detections = detect_each(
            counted(), radar, scenario.chain, first=numbers.start, took_out=took_out.append
        )
    found = Found(
        first_frame=numbers.start,
        detections=detections,
        times_s=tuple(times_s),
        took_out=tuple(took_out),
        n_crowded=len(crowded),
    )
    detected = perf_counter()
    made = concluded(scenario, radar, source, found)
    return replace(
        made,
        truth=None if scenario.scene is None else _truth(scenario, radar),
        budget=None if scenario.scene is None else link_budget(scenario, radar),
        findings=(*findings, *made.findings),
        timing_s={
            "simulate" if scenario.scene is not None else "open": opened - started,
            "process": detected - opened + made.timing_s["process"],
        },
    )


@value
class Found:
    """What detection gave, of all frames."""

    first_frame: int
    detections: xr.Dataset
    times_s: tuple[float, ...]
    """Middle of each frame, from the first to the last."""
    took_out: tuple[tuple[Removed, ...], ...]
    """What clean-up took out of each frame."""
    n_crowded: int
    """Frames with more peaks than are kept."""


def concluded(
    scenario: Scenario, radar: Radar, source: xr.DataArray | Recording, found: Found
) -> Result:
    """Result of what was detected: clusters and tracks, maps of the first frame, remarks."""
    started = perf_counter()
    chain, first = scenario.chain.fitted(radar), found.first_frame
    fitted = replace(scenario, chain=chain)
    with called("tracker", instead_of="Tracker"):
        followed = follow(found.detections, found.times_s, fitted, radar, first=first)
    # Only now: held through the detection, these two maps would be a fourth cube in memory.
    of_first = radar.at(first)
    power = power_map(next(_one_by_one(source)).isel(frame=0), of_first, chain)
    threshold = threshold_map(power, of_first, chain)
    return Result(
        scenario=fitted,
        radar=radar,
        source=source,
        first_frame=first,
        power=power,
        threshold=threshold,
        detections=followed.detections,
        ego=followed.ego,
        clusters=followed.clusters,
        tracks=followed.tracks,
        truth=None,
        budget=None,
        findings=(
            *about_chain(scenario.chain, radar),
            *about_found(found, radar),
            *followed.findings,
        ),
        times_s=found.times_s,
        timing_s={"process": perf_counter() - started},
    )


def about_chain(chain: Chain, radar: Radar) -> tuple[Finding, ...]:
    """What is said about the maps that settings make for a radar."""
    fitted = chain.fitted(radar)
    cells = _fewer_cells(chain.cfar, fitted.cfar)
    return (*cells, *_no_directions(chain, fitted), *remarks(radar, fitted))


def about_found(found: Found, radar: Radar) -> tuple[Finding, ...]:
    """What is said about what was detected."""
    return (
        *near_field.remark(radar, found.detections),
        *_crowded(found.n_crowded),
        *(summary(found.took_out) if found.took_out else ()),
    )


def object_list_of(result: Result) -> xr.Dataset:
    """Object list of a result: of its tracks, else of its clusters, else of its detections.

    Warns
    -----
    PhysicsWarning
        If detections have no direction, so that nobody can tell where they are.
    """
    if result.tracks is not None:
        return object_list(result.tracks)
    rows = result.detections if result.clusters is None else result.clusters
    return object_list(rows, result.times_s, first=result.first_frame)


def one_frame(scenario: Scenario, number: int = 0) -> tuple[xr.DataArray, Radar]:
    """Samples of one frame, (chirp, rx, sample), and the radar as it was in it.

    Raises
    ------
    InvalidSetting
        If there is no frame of that number.
    DechirpError
        If a setting cannot work, the recording cannot be read, or memory would not hold it.
    """
    source, radar, _ = _source(scenario, lambda done, of: None)
    numbers = _numbers(source)
    if number not in numbers:
        raise InvalidSetting(
            "frame",
            got=number,
            need=f"a frame from {numbers.start} to {numbers.stop - 1}",
            fix="Frames count from 0; n_frames says how many are simulated.",
        )
    frames = _one_by_one(source)
    chosen = next(one for here, one in zip(numbers, frames, strict=True) if here == number)
    return chosen.isel(frame=0), radar.at(number)


def simulated(
    scenario: Scenario, *, progress: Callable[[int, int], None] | None = None
) -> tuple[xr.DataArray, xr.Dataset, tuple[Finding, ...]]:
    """Cube of a scene as `run` simulates it, its truth, and what is to be said about it.

    Raises
    ------
    DechirpError
        If a setting cannot work, or memory would not hold it.
    """
    source, radar, findings = _source(scenario, progress or (lambda done, of: None))
    assert isinstance(source, xr.DataArray)  # a scenario with a scene
    return source, _truth(scenario, radar), findings


def opened_recording(scenario: Scenario) -> Recording:
    """The recording of a scenario, opened as it says.

    Raises
    ------
    DechirpError
        If it cannot be read, or does not go with the scenario's settings.
    """
    assert scenario.recording is not None
    told = scenario.recording
    recording = open_recording(
        told.path,
        radar=scenario.radar,
        settings=told.settings_path,
        device=told.device,
        format=told.format,
        axes=told.axes,
        encoding=told.encoding,
        iq=told.iq,
        calibration=told.calibration,
        frames=told.frames,
    )
    recording.must_hold_samples()
    check_chain(scenario.chain, recording.radar)
    check_following(scenario, recording.radar, len(recording.frame_numbers))
    return recording


def _fewer_cells(usual: Cfar, taken: Cfar) -> tuple[Finding, ...]:
    """What is said when the map has no room for the default training cells."""
    if usual == taken:
        return ()
    cells = [
        f"{getattr(taken.n_training, axis)} training and {getattr(taken.n_guard, axis)} guard cells"
        f" along {axis}"
        for axis in ("range", "velocity")
    ]
    return (
        Finding(
            level="note",
            setting="chain.cfar",
            got=f"{' and '.join(cells)}, on each side, fewer than usual",
            need="a ring of cells that fits into the map",
            fix="Set chain.cfar.n_training and chain.cfar.n_guard to choose others.",
        ),
    )


def _no_directions(usual: Chain, taken: Chain) -> tuple[Finding, ...]:
    """What is said when somebody asked for directions that the array cannot tell."""
    was_asked_for = usual.angle is not Chain.angle  # and not the default itself
    if not (was_asked_for and usual.angle is not None and taken.angle is None):
        return ()
    return (
        Finding(
            level="note",
            setting="chain.angle",
            got=f"{usual.angle.kind()}, left out: this array tells no directions",
            need="elements at two places or more",
            fix="Give the radar more elements, or set chain.angle to null.",
        ),
    )


def _crowded(n_frames: int) -> tuple[Finding, ...]:
    """What is said when frames had more peaks than are kept."""
    if not n_frames:
        return ()
    return (
        Finding(
            level="warning",
            setting="chain.cfar",
            got=f"more than {MOST_PEAKS} peaks over threshold in {n_frames} frames, of which the"
            " strongest are kept",
            need=f"at most {MOST_PEAKS} in a frame",
            fix="Lower the false-alarm probability.",
        ),
    )


def _source(
    scenario: Scenario,
    simulated: Callable[[int, int], None],
    rng: np.random.Generator | None = None,
) -> tuple[xr.DataArray | Recording, Radar, tuple[Finding, ...]]:
    """The simulated cube or the recording, its radar, and what is to be said about it."""
    if scenario.scene is not None:
        assert scenario.radar is not None
        with heard() as findings:
            cube = simulate(
                scenario.scene,
                scenario.radar,
                impairments=scenario.impairments,
                n_frames=scenario.n_frames,
                seed=scenario.seed if rng is None else rng,
                engine=scenario.engine,
                progress=simulated,
            )
        return cube, scenario.radar, tuple(findings)
    recording = opened_recording(scenario)
    return recording, recording.radar, recording.findings


def _numbers(source: xr.DataArray | Recording) -> range:
    """Numbers of the frames that are processed."""
    return source.frame_numbers if isinstance(source, Recording) else range(source.sizes["frame"])


def _one_by_one(source: xr.DataArray | Recording) -> Iterator[xr.DataArray]:
    if isinstance(source, Recording):
        yield from source.frames()
    else:
        for index in range(source.sizes["frame"]):
            yield source.isel(frame=slice(index, index + 1))


def _truth(scenario: Scenario, radar: Radar) -> xr.Dataset:
    """Truth about the scene, its signal-to-noise ratio against the noise that was added."""
    assert scenario.scene is not None
    noise_w = added_noise_w(scenario, radar)
    return truth(scenario.scene, radar, n_frames=scenario.n_frames, noise_power_w=noise_w)

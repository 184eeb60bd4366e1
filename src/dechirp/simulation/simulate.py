"""Simulation of a scene, from targets to ADC samples."""

import math
import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_integer
from dechirp.core.compiled_kernels import plain_twins_in_first_calls
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import PhysicsWarning
from dechirp.core.memory import check_free_memory
from dechirp.radar.cube import label_cube
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.scene_warnings import scene_findings
from dechirp.scene.validity import check_scene_echoes_finite
from dechirp.simulation import phase_error
from dechirp.simulation.echo_groups import (
    EchoGroup,
    SampleWindow,
    direct_echo_groups,
    frame_sampling_times,
)
from dechirp.simulation.engine import Engine
from dechirp.simulation.impairments.base import Impairment
from dechirp.simulation.impairments.noise import ThermalNoise
from dechirp.simulation.kernels import selection
from dechirp.simulation.kernels.direct import PreviousRamps
from dechirp.simulation.path_shadowing import shadow_echoes
from dechirp.simulation.stages import (
    Stages,
    check_ramps_supported,
    prefix_errors_with_kind,
    radar_at_shortest_chirp_interval,
    sort_into_stages,
)

# Cubes held at once during simulation and processing, at most.
PEAK_CUBE_COUNT = 3

# Bytes for each scatterer: path, amplitude and gains, tones and series.
_SCATTERER_BYTES = 600
# Samples of a temporary copy of echoes, complex or longer than those kept.
_COPY_BLOCK_SAMPLES = 2**21

_DOUBLE_PRECISION: np.dtype[np.complexfloating] = np.dtype(np.complex128)


@check_argument_types
def simulate(
    scene: Scene,
    radar: Radar,
    *,
    impairments: Sequence[Impairment] | None = None,
    n_frames: int = 1,
    seed: int | np.random.Generator = 0,
    dtype: type[np.complexfloating] = np.complex64,
    engine: Engine | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> xr.DataArray:
    """Simulate the dechirped samples of a scene.

    Parameters
    ----------
    scene, radar
        Targets and radar; the radar needs its hardware, for absolute powers.
    impairments : sequence, optional
        They act stage by stage: oscillator, paths, receiver, and within a stage in the given order.
        Default: thermal noise alone; an empty sequence: none.
    n_frames : int
        Successive frames; targets move on between them.
    seed : int or Generator
        The same seed yields the same cube.
    dtype : complex64 or complex128
        Real sampling yields the real type of that precision. Unless the engine sets another
        tolerance, echoes are accurate to 1e-5 of their root mean square in single precision, and
        within 1e-9 of a computation with 50 digits in double up to 500 m. Beyond, the rounding of
        the range counts: 5e-9 at 5 km and 77 GHz.
    engine : Engine, optional
        Summation method, and treatment of late echoes.
    progress : callable, optional
        Called with the number of finished frames and of all frames.

    Returns
    -------
    DataArray (frame, chirp, rx, sample), sqrt(W)
        Complex sampling: `|.|^2` of an echo is its power. Real sampling: its mean square is.
        The attribute `kernels` lists the kernels that summed it.

    Raises
    ------
    InvalidSetting
        If the hardware of the radar is missing, a target sits on an antenna, an impairment names a
        missing target, or `n_frames`, `seed` or `dtype` is invalid.
    NotEnoughMemory
        If the cube and its processing would not fit.

    Warns
    -----
    PhysicsWarning
        For each finding of `scene_findings`: targets aliased in range or velocity, behind the
        radar, where a pattern has no gain or between its antennas, or with a late echo; coincident
        antennas; codes that are not orthogonal. And for findings of impairments: a preset for
        another band, an oscillator error on a ramp that is too slow for it.

    Notes
    -----
    `kernels/base.py` gives the phase. The amplitude follows the radar equation with both path
    lengths at each sample, so near fields are exact. Gains and mean cross sections are those of
    mid-frame, towards each antenna and towards the radar. Fluctuation is drawn before the noise,
    frame by frame.
    """
    check_integer("n_frames", n_frames, at_least=1, at_most=1_000_000)
    rng = _rng_from_seed(seed)
    sample_type = _check_complex_dtype(dtype)
    stages = build_stages_with_warnings(impairments, scene, radar, n_frames=n_frames)
    n_samples = n_frames * radar.n_samples_per_frame
    with plain_twins_in_first_calls(n_samples * max(scene.n_scatterers, 1)):
        return _simulate_frames(scene, radar, stages, n_frames, sample_type, rng, engine, progress)


def build_stages_with_warnings(
    impairments: Sequence[Impairment] | None, scene: Scene, radar: Radar, *, n_frames: int
) -> Stages:
    """Build the stages, and issue all warnings of `simulate`."""
    for finding in scene_findings(scene, radar, n_frames=n_frames):
        warnings.warn(PhysicsWarning(finding), stacklevel=4)
    stages = build_checked_stages(impairments, scene, radar)
    finding_slow = phase_error.slow_ramp_finding(radar) if stages.oscillators else None
    if finding_slow is not None:
        warnings.warn(PhysicsWarning(finding_slow), stacklevel=4)
    return stages


def build_checked_stages(
    impairments: Sequence[Impairment] | None, scene: Scene, radar: Radar
) -> Stages:
    """Sort impairments into stages and check them; the default is thermal noise alone.

    Raises
    ------
    InvalidSetting
        If an impairment cannot act on that scene or radar.
    """
    stages = sort_into_stages((ThermalNoise(),) if impairments is None else impairments, radar)
    for impairment in stages.impairments:
        check_ramps_supported(impairment, radar.frame)
        with prefix_errors_with_kind(impairment):
            impairment.check(scene, radar_at_shortest_chirp_interval(radar))
    return stages


def simulate_ideal_echoes(
    scene: Scene,
    radar: Radar,
    *,
    n_frames: int = 1,
    dtype: np.dtype[np.complexfloating] = _DOUBLE_PRECISION,
    rng: np.random.Generator | None = None,
    engine: Engine | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> xr.DataArray:
    """Simulate the echoes alone, without impairments and without warnings.

    `rng` is used if targets fluctuate; default: seed 0.
    """
    rng = np.random.default_rng(0) if rng is None else rng
    return _simulate_frames(
        scene, radar, sort_into_stages((), radar), n_frames, dtype, rng, engine, progress
    )


def _simulate_frames(
    scene: Scene,
    radar: Radar,
    stages: Stages,
    n_frames: int,
    dtype: np.dtype[np.complexfloating],
    rng: np.random.Generator,
    engine: Engine | None,
    progress: Callable[[int, int], None] | None,
) -> xr.DataArray:
    check_scene_echoes_finite(scene, radar, n_frames=n_frames)
    frame_numbers = range(n_frames)
    echoes = sum_echoes(scene, radar, stages, frame_numbers, dtype, rng, engine, progress=progress)
    for receiver in make_receiver_operations(stages, scene, radar):
        receiver(echoes.samples, rng)
    trimmed = np.ascontiguousarray(trim_receiver_margins(echoes.samples, radar, stages))
    return label_samples_as_cube(trimmed, echoes.kernels, radar, stages)


class SummedEchoes(NamedTuple):
    """Echoes at the input of the receivers, with the margins that receivers need."""

    samples: np.ndarray
    """(frame, chirp, rx, sample)."""
    kernels: frozenset[str]
    """Kernels that summed them."""


def sum_echoes(
    scene: Scene,
    radar: Radar,
    stages: Stages,
    frame_numbers: Sequence[int],
    dtype: np.dtype[np.complexfloating],
    rng: np.random.Generator,
    engine: Engine | None,
    *,
    make_rng: Callable[[int], np.random.Generator] = np.random.default_rng,
    progress: Callable[[int, int], None] | None = None,
) -> SummedEchoes:
    """Sum the echoes of some frames, with all impairments before the receiver.

    `make_rng` makes the generators of the signals that paths add, from seeds that
    `draw_propagation_seeds` draws from `rng` for each frame. The scene has passed
    `check_scene_echoes_finite`.
    """
    n_before, n_after = stages.sample_margins(radar)
    samples = _allocate_samples(scene, radar, len(frame_numbers), n_before + n_after, dtype)
    kernels: set[str] = set()
    for index, number in enumerate(frame_numbers):
        window = frame_sampling_times(radar, number).widen(n_before, n_after)
        kernels |= _sum_frame_signals(
            samples[index], scene, radar, window, stages, rng, engine or Engine(), make_rng
        )
        if progress is not None:
            progress(index + 1, len(frame_numbers))
    return SummedEchoes(samples, frozenset(kernels))


def draw_propagation_seeds(stages: Stages, rng: np.random.Generator) -> np.ndarray:
    """Draw the seeds of the signals that the paths add to one frame, (n_paths,)."""
    return rng.integers(2**63, size=len(stages.paths))


def make_receiver_operations(
    stages: Stages, scene: Scene, radar: Radar
) -> list[Callable[[np.ndarray, np.random.Generator], None]]:
    """Return the operations of the receivers, in order; each changes samples in place."""
    return [
        receiver.make_sample_operation(scene, radar_at_shortest_chirp_interval(radar))
        for receiver in stages.receivers
    ]


def trim_receiver_margins(samples: np.ndarray, radar: Radar, stages: Stages) -> np.ndarray:
    """Return a view of samples without the margins that receivers need."""
    n_before, _ = stages.sample_margins(radar)
    return samples[..., n_before : n_before + radar.frame.chirp.n_samples]


def label_samples_as_cube(
    samples: np.ndarray,
    kernels: Iterable[str],
    radar: Radar,
    stages: Stages,
    *,
    first_frame: int = 0,
) -> xr.DataArray:
    """Return samples as a labelled cube with the attributes of the last receiver."""
    cube = label_cube(samples, radar, units="W**0.5", first_frame=first_frame)
    attributes = stages.receivers[-1].cube_attributes(radar) if stages.receivers else {}
    cube.attrs |= {"kernels": ", ".join(sorted(kernels)), **attributes}
    return cube


def _rng_from_seed(seed: object) -> np.random.Generator:
    if isinstance(seed, np.random.Generator):
        return seed
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or seed < 0:
        raise InvalidSetting(
            "seed",
            value=repr(seed),
            expected="an integer of at least 0, or a NumPy Generator",
            fix="use an integer such as 0; the same seed yields the same cube",
        )
    return np.random.default_rng(int(seed))


def _check_complex_dtype(dtype: object) -> np.dtype[np.complexfloating]:
    try:
        sample_type = np.dtype(dtype)  # type: ignore[call-overload]
    except TypeError:
        sample_type = None
    if sample_type not in (np.dtype(np.complex64), np.dtype(np.complex128)):
        raise InvalidSetting(
            "dtype",
            value=getattr(dtype, "__name__", repr(dtype)),
            expected="complex64 or complex128; real sampling uses the real type of that precision",
            fix="use np.complex64",
        )
    return sample_type


def _sum_frame_signals(
    samples: np.ndarray,
    scene: Scene,
    radar: Radar,
    window: SampleWindow,
    stages: Stages,
    rng: np.random.Generator,
    engine: Engine,
    make_rng: Callable[[int], np.random.Generator],
) -> set[str]:
    """Sum the echoes of a frame into `samples`, (chirp, rx, sample); return the kernels."""
    groups: list[EchoGroup] = []
    if scene.targets:
        groups += direct_echo_groups(
            scene, radar, window.frame_index, rng, include_zero_gain=bool(stages.paths)
        )
    tail = (
        _previous_ramp_of_each_chirp(radar, window.frame_index) if engine.late == "tail" else None
    )
    radar = radar.for_frame(window.frame_index)
    for path in stages.paths:
        groups = path.transform_echoes(groups, window, scene, radar, rng)
    outbound_gain = math.prod(path.outbound_amplitude_gain(radar) for path in stages.paths)
    if outbound_gain != 1:
        groups = [group.scale_amplitudes(outbound_gain) for group in groups]
    groups = shadow_echoes(groups, window, scene, radar, stages.paths)
    wide_window, delays, phase_rad = window, None, np.zeros(0)
    if stages.oscillators:
        added_s = [path.added_delay_bounds_s(radar) for path in stages.paths]
        delays = phase_error.find_delay_spread(
            groups, window, radar, [stage for stage in added_s if stage is not None]
        )
        wide_window = window.widen(delays.n_before, delays.n_after)
        phase_window = delays.phase_sample_window(wide_window)
        phase_rad = np.sum(
            [stage.phase_error_rad(phase_window, radar, rng) for stage in stages.oscillators],
            axis=0,
        )
    seeds = draw_propagation_seeds(stages, rng)
    in_place = delays is None and np.iscomplexobj(samples)
    kernels: set[str] = set()
    for chirps in _chirp_block_slices(samples, in_place):
        echo = samples[chirps]
        if not in_place:
            shape = (*echo.shape[:2], wide_window.n_times)
            echo = np.zeros(shape, np.result_type(samples, np.complex64))
        kernels |= _add_groups_to_chirps(echo, chirps, groups, wide_window, engine, tail)
        for path, seed in zip(stages.paths, seeds, strict=True):
            path.add_signals(echo, wide_window.select_chirps(chirps), scene, radar, make_rng(seed))
        if delays is not None:
            echo = phase_error.apply_phase_error(echo, phase_rad[chirps], delays, radar)
        if np.iscomplexobj(samples):
            if not in_place:
                samples[chirps] = echo
        else:
            # A single mixer: the same mean power as both of a complex receiver together.
            samples[chirps] = samples.dtype.type(np.sqrt(2)) * echo.real
    return kernels


def _chirp_block_slices(samples: np.ndarray, single_block: bool) -> list[slice]:
    """Return blocks of chirps: all if summed in place, else some for a complex copy."""
    block_length = len(samples) if single_block else max(1, _COPY_BLOCK_SAMPLES // samples[0].size)
    return [
        slice(row, min(row + block_length, len(samples)))
        for row in range(0, len(samples), block_length)
    ]


def _add_groups_to_chirps(
    echo: np.ndarray,
    chirp_block: slice,
    groups: Sequence[EchoGroup],
    window: SampleWindow,
    engine: Engine,
    previous_ramps: PreviousRamps | None,
) -> set[str]:
    """Sum the echoes into some chirps of a frame; return the kernels' names."""
    kernels: set[str] = set()
    for group in groups:
        chirps = range(group.chirps.stop)[group.chirps]
        positions = [
            position
            for position, chirp in enumerate(chirps)
            if chirp_block.start <= chirp < chirp_block.stop
        ]
        if not positions:
            continue
        group_chirps = slice(positions[0], positions[-1] + 1)
        frame_chirps = slice(chirps[positions[0]], chirps[positions[-1]] + 1, chirps.step)
        target = echo[
            frame_chirps.start - chirp_block.start : frame_chirps.stop
            - chirp_block.start : frame_chirps.step
        ]
        scatterers, transmission = selection.select_chirps(
            group.scatterers, group.transmission, group_chirps
        )
        # Kernels sum into chirps that are adjacent in memory.
        summed = target if chirps.step == 1 else np.zeros(target.shape, target.dtype)
        kernels |= selection.add_echoes(
            summed,
            scatterers,
            transmission._replace(adc_start_s=window.first_sample_s),
            engine=engine,
            previous=None if previous_ramps is None else previous_ramps.select_chirps(frame_chirps),
        )
        if summed is not target:
            target += summed
    return kernels


def _previous_ramp_of_each_chirp(radar: Radar, frame_index: int) -> PreviousRamps:
    """Return the ramp sent before each chirp of a frame; nothing before the very first."""
    frame = radar.frame
    if not frame.has_identical_ramps:
        raise InvalidSetting(
            "Engine.late",
            value="tail, with ramps that differ",
            expected="held or onset: the remaining echo of another ramp has another frequency",
            fix="choose onset",
        )
    starts_s = frame.for_frame(frame_index).chirp_starts_s
    gap_s = np.nan  # nothing was sent before the first chirp of all
    if frame_index > 0:
        last_s = (
            frame.frame_start_s(frame_index - 1)
            + frame.for_frame(frame_index - 1).chirp_starts_s[-1]
        )
        gap_s = frame.frame_start_s(frame_index) - last_s
    weights = np.roll(frame.chirp_weights(), 1, axis=0)
    gaps_s = np.diff(starts_s, prepend=starts_s[0] - gap_s)
    return PreviousRamps(gaps_s, weights, frame.chirp.ramp_duration_s)


def _allocate_samples(
    scene: Scene, radar: Radar, n_frames: int, n_margin: int, dtype: np.dtype[np.complexfloating]
) -> np.ndarray:
    frame, chirp = radar.frame, radar.frame.chirp
    shape = (n_frames, frame.n_chirps_total, radar.array.n_rx, chirp.n_samples + n_margin)
    sample_type = dtype if chirp.sampling == "complex" else np.empty(0, dtype).real.dtype
    cubes = PEAK_CUBE_COUNT * float(np.prod(shape, dtype=float)) * sample_type.itemsize
    check_free_memory(
        "simulation",
        needed_bytes=cubes + _SCATTERER_BYTES * scene.n_scatterers,
        fix="simulate fewer frames, chirps, receivers, samples or scatterers",
    )
    return np.zeros(shape, sample_type)

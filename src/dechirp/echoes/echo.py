"""From a scene to what the converter samples."""

import math
import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.checks import whole
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import PhysicsWarning
from dechirp.core.memory import must_fit
from dechirp.echoes import oscillator
from dechirp.echoes.engine import Engine
from dechirp.echoes.impairments.base import Impairment
from dechirp.echoes.impairments.thermal_noise import ThermalNoise
from dechirp.echoes.kernels import choice
from dechirp.echoes.kernels.direct import Before
from dechirp.echoes.parts import Part, Window, direct_parts, window
from dechirp.echoes.stages import Stages, by_stage, must_suit, naming, shortest
from dechirp.radar.cube import labelled_cube
from dechirp.radar.radar import Radar
from dechirp.scene.possible import must_be_possible
from dechirp.scene.scene import Scene
from dechirp.scene.surprises import surprises

# Cubes that simulating and processing hold at once, at most.
CUBES_HELD = 3

# Bytes for each scatterer: its path, amplitude and gains, tones and series.
_SCATTERER_BYTES = 600
# A copy of echoes, complex or longer than what is kept, holds so many samples at a time.
_AT_ONCE = 2**21

_DOUBLE: np.dtype[np.complexfloating] = np.dtype(np.complex128)


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
    """Dechirped samples of a scene, as the radar takes them.

    Parameters
    ----------
    scene, radar
        What is seen and what sees; the radar needs its hardware, for absolute powers.
    impairments : sequence, optional
        Act on the echoes, stage by stage: oscillator, paths, receiver; in this order within a
        stage. Thermal noise alone without it, none when empty.
    n_frames : int
        Frames in succession; targets move on between them.
    seed : int or Generator
        The same seed gives the same cube.
    dtype : complex64 or complex128
        Real sampling gives the real type of that precision. Echoes are right to 1e-5 of
        their root mean square in single precision, and within 1e-9 of 50 digits in double,
        unless the engine says otherwise.
    engine : Engine, optional
        How echoes are summed, and whether late ones begin late.
    progress : callable, optional
        Called with the number of frames done and of all frames.

    Returns
    -------
    DataArray (frame, chirp, rx, sample), sqrt(W)
        Complex sampling: `|.|^2` of an echo is its power. Real sampling: its mean square is.
        The attribute `kernels` names those that summed it.

    Raises
    ------
    InvalidSetting
        If the radar's hardware is not known, a target sits on an antenna, an impairment
        names a target that is not there, or `n_frames`, `seed` or `dtype` is none.
    NotEnoughMemory
        If the cube and its processing would not fit.

    Warns
    -----
    PhysicsWarning
        Whatever `surprises` finds: targets that fold in range or velocity, lie behind the
        radar, where a pattern has no gain or between its antennas, or whose echo comes late;
        antennas at one place; codes that are not orthogonal. And what impairments find: a
        preset for another band, an oscillator's error on a ramp that is too slow to tell it.

    Notes
    -----
    See `kernels/base.py` for the phase. The amplitude follows the radar equation with both
    lengths of each sample, so that near fields are exact. Gains and mean cross sections are
    those of mid-frame, towards each antenna and towards the radar. Fluctuation is drawn
    before the noise, frame by frame.
    """
    whole("n_frames", n_frames, at_least=1, at_most=1_000_000)
    rng = _generator(seed)
    kind = _cube_type(dtype)
    stages = told_stages(impairments, scene, radar, n_frames=n_frames)
    return _simulated(scene, radar, stages, n_frames, kind, rng, engine, progress)


def told_stages(
    impairments: Sequence[Impairment] | None, scene: Scene, radar: Radar, *, n_frames: int
) -> Stages:
    """As `checked_stages`, and warns of all that `simulate` warns of."""
    for finding in surprises(scene, radar, n_frames=n_frames):
        warnings.warn(PhysicsWarning(finding), stacklevel=3)
    stages = checked_stages(impairments, scene, radar)
    slow = oscillator.surprise(radar) if stages.oscillators else None
    if slow is not None:
        warnings.warn(PhysicsWarning(slow), stacklevel=3)
    return stages


def checked_stages(impairments: Sequence[Impairment] | None, scene: Scene, radar: Radar) -> Stages:
    """Impairments by stage, as `simulate` takes them: thermal noise alone without any.

    Raises
    ------
    InvalidSetting
        If one of them cannot act on that scene or radar.
    """
    stages = by_stage((ThermalNoise(),) if impairments is None else impairments, radar)
    for impairment in stages.all:
        must_suit(impairment, radar.frame)
        with naming(impairment):
            impairment.check(scene, shortest(radar))
    return stages


def clean_echoes(
    scene: Scene,
    radar: Radar,
    *,
    n_frames: int = 1,
    dtype: np.dtype[np.complexfloating] = _DOUBLE,
    rng: np.random.Generator | None = None,
    engine: Engine | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> xr.DataArray:
    """Echoes alone, before any impairment, and without a word on what surprises.

    `rng` is drawn from where targets fluctuate; seeded with 0 without it.
    """
    rng = np.random.default_rng(0) if rng is None else rng
    return _simulated(scene, radar, by_stage((), radar), n_frames, dtype, rng, engine, progress)


def _simulated(
    scene: Scene,
    radar: Radar,
    stages: Stages,
    n_frames: int,
    dtype: np.dtype[np.complexfloating],
    rng: np.random.Generator,
    engine: Engine | None,
    progress: Callable[[int, int], None] | None,
) -> xr.DataArray:
    must_be_possible(scene, radar, n_frames=n_frames)
    numbers = range(n_frames)
    arrived = arriving(scene, radar, stages, numbers, dtype, rng, engine, progress=progress)
    for receiver in receivers_of(stages, scene, radar):
        receiver(arrived.samples, rng)
    kept = np.ascontiguousarray(kept_of(arrived.samples, radar, stages))
    return labelled(kept, arrived.kernels, radar, stages)


class Arriving(NamedTuple):
    """Echoes as receivers take them, with the samples that these need before and after."""

    samples: np.ndarray
    """(frame, chirp, rx, sample)"""
    kernels: frozenset[str]
    """That summed them."""


def arriving(
    scene: Scene,
    radar: Radar,
    stages: Stages,
    numbers: Sequence[int],
    dtype: np.dtype[np.complexfloating],
    rng: np.random.Generator,
    engine: Engine | None,
    *,
    seeded: Callable[[int], np.random.Generator] = np.random.default_rng,
    progress: Callable[[int, int], None] | None = None,
) -> Arriving:
    """Sum the echoes of frames of those numbers, with all impairments before the receiver.

    `seeded` makes the generators of what paths add, from seeds that are drawn from `rng`, a
    frame's at a time: `path_seeds`. The scene is one that `must_be_possible`.
    """
    before, after = stages.margins(radar)
    samples = _empty_samples(scene, radar, len(numbers), before + after, dtype)
    kernels: set[str] = set()
    for index, number in enumerate(numbers):
        kept = window(radar, number).wider(before, after)
        kernels |= _add_frame(
            samples[index], scene, radar, kept, stages, rng, engine or Engine(), seeded
        )
        if progress is not None:
            progress(index + 1, len(numbers))
    return Arriving(samples, frozenset(kernels))


def path_seeds(stages: Stages, rng: np.random.Generator) -> np.ndarray:
    """Seeds of what the paths add to one frame, (n_paths,)."""
    return rng.integers(2**63, size=len(stages.paths))


def receivers_of(
    stages: Stages, scene: Scene, radar: Radar
) -> list[Callable[[np.ndarray, np.random.Generator], None]]:
    """What each receiver does to samples of `arriving`, in place, in turn."""
    return [one.prepared(scene, shortest(radar)) for one in stages.receivers]


def kept_of(samples: np.ndarray, radar: Radar, stages: Stages) -> np.ndarray:
    """Samples that are kept of those that `arriving` gave: a view, without what receivers need."""
    before, _ = stages.margins(radar)
    return samples[..., before : before + radar.frame.chirp.n_samples]


def labelled(
    samples: np.ndarray,
    kernels: Iterable[str],
    radar: Radar,
    stages: Stages,
    *,
    first_frame: int = 0,
) -> xr.DataArray:
    """A simulated cube of samples that receivers gave."""
    cube = labelled_cube(samples, radar, units="sqrt(W)", first_frame=first_frame)
    said = stages.receivers[-1].attributes(radar) if stages.receivers else {}
    cube.attrs |= {"kernels": ", ".join(sorted(kernels)), **said}
    return cube


def _generator(seed: object) -> np.random.Generator:
    if isinstance(seed, np.random.Generator):
        return seed
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or seed < 0:
        raise InvalidSetting(
            "seed",
            got=repr(seed),
            need="a whole number of at least 0, or a NumPy Generator",
            fix="Give a number: the same one gives the same cube.",
        )
    return np.random.default_rng(int(seed))


def _cube_type(dtype: object) -> np.dtype[np.complexfloating]:
    try:
        kind = np.dtype(dtype)  # type: ignore[call-overload]
    except TypeError:
        kind = None
    if kind not in (np.dtype(np.complex64), np.dtype(np.complex128)):
        raise InvalidSetting(
            "dtype",
            got=getattr(dtype, "__name__", repr(dtype)),
            need="complex64 or complex128; real sampling takes the real type of that precision",
            fix="Give np.complex64.",
        )
    return kind


class Planned(NamedTuple):
    """A run of chirps whose echoes are summed at once, as `plan` predicts it."""

    chirps: slice
    n_scatterers: int
    kernel: choice.Kernel
    costs_s: choice.Costs
    """Predicted time of each kernel on one thread; infinite where it cannot."""


def plan(
    scene: Scene,
    radar: Radar,
    *,
    engine: Engine | None = None,
    dtype: type[np.complexfloating] = np.complex64,
) -> list[Planned]:
    """Say which kernels would sum the first frame of a scene, and at what cost.

    Raises
    ------
    InvalidSetting
        As `simulate`.
    """
    must_be_possible(scene, radar)
    engine, kind = engine or Engine(), _cube_type(dtype)
    shape = (radar.array.n_rx, radar.frame.chirp.n_samples)
    planned = []
    for part in direct_parts(scene, radar, 0, np.random.default_rng(0)) if scene.targets else ():
        kernel, costs_s = choice.chosen(
            (len(part.sent.starts_s), *shape), part.scatterers, part.sent, engine, kind
        )
        planned.append(Planned(part.chirps, len(part.scatterers.amplitudes), kernel, costs_s))
    return planned


def _add_frame(
    samples: np.ndarray,
    scene: Scene,
    radar: Radar,
    kept: Window,
    stages: Stages,
    rng: np.random.Generator,
    engine: Engine,
    seeded: Callable[[int], np.random.Generator],
) -> set[str]:
    """Add the echoes of one frame to `samples`, (chirp, rx, sample), and name the kernels."""
    found: list[Part] = []
    if scene.targets:
        found += direct_parts(scene, radar, kept.frame, rng, unseen=bool(stages.paths))
    tail = _before(radar, kept.frame) if engine.late == "tail" else None
    radar = radar.at(kept.frame)
    for path in stages.paths:
        found = path.parts(found, kept, scene, radar, rng)
    lit = math.prod(path.way_out(radar) for path in stages.paths)
    if lit != 1:
        found = [part.weaker(lit) for part in found]
    wide, reach, phase_rad = kept, None, np.zeros(0)
    if stages.oscillators:
        added_s = [path.added_delays_s(radar) for path in stages.paths]
        reach = oscillator.reach(found, kept, radar, [one for one in added_s if one is not None])
        wide = kept.wider(reach.before, reach.after)
        seen = reach.phase_window(wide)
        phase_rad = np.sum([one.phase_rad(seen, radar, rng) for one in stages.oscillators], axis=0)
    seeds = path_seeds(stages, rng)
    own = reach is None and np.iscomplexobj(samples)
    kernels: set[str] = set()
    for rows in _some_rows(samples, own):
        echo = samples[rows]
        if not own:
            shape = (*echo.shape[:2], wide.n_times)
            echo = np.zeros(shape, np.result_type(samples, np.complex64))
        kernels |= _sum(echo, rows, found, wide, engine, tail)
        for path, seed in zip(stages.paths, seeds, strict=True):
            path.add(echo, wide.of(rows), scene, radar, seeded(seed))
        if reach is not None:
            echo = oscillator.turned(echo, phase_rad[rows], reach, radar)
        if np.iscomplexobj(samples):
            if not own:
                samples[rows] = echo
        else:
            # One mixer: the same mean power as the two of a complex receiver together.
            samples[rows] = samples.dtype.type(np.sqrt(2)) * echo.real
    return kernels


def _some_rows(samples: np.ndarray, own: bool) -> list[slice]:
    """Chirps at a time: all where they are summed in place, else some, for a complex copy."""
    at_once = len(samples) if own else max(1, _AT_ONCE // samples[0].size)
    return [slice(row, min(row + at_once, len(samples))) for row in range(0, len(samples), at_once)]


def _sum(
    echo: np.ndarray,
    rows: slice,
    parts: Sequence[Part],
    wide: Window,
    engine: Engine,
    tail: Before | None,
) -> set[str]:
    """Sum the echoes in some chirps of a frame, and name the kernels."""
    kernels: set[str] = set()
    for part in parts:
        chirps = range(part.chirps.stop)[part.chirps]
        places = [place for place, chirp in enumerate(chirps) if rows.start <= chirp < rows.stop]
        if not places:
            continue
        of_part = slice(places[0], places[-1] + 1)
        both = slice(chirps[places[0]], chirps[places[-1]] + 1, chirps.step)
        own = echo[both.start - rows.start : both.stop - rows.start : both.step]
        scatterers, run = choice.rows_of(part.scatterers, part.sent, of_part)
        # Kernels sum into chirps that lie side by side.
        summed = own if chirps.step == 1 else np.zeros(own.shape, own.dtype)
        kernels |= choice.add(
            summed,
            scatterers,
            run._replace(adc_start_s=wide.first_s),
            engine=engine,
            before=None if tail is None else tail.of(both),
        )
        if summed is not own:
            own += summed
    return kernels


def _before(radar: Radar, index: int) -> Before:
    """What was sent before each chirp of a frame: nothing before the first of all."""
    frame = radar.frame
    if not frame.ramps_are_alike:
        raise InvalidSetting(
            "Engine.late",
            got="tail, with ramps that differ",
            need="held or onset: what is left of another ramp lies elsewhere in frequency",
            fix="Take onset.",
        )
    starts_s = frame.at(index).chirps_s
    since_s = np.nan  # nothing was sent before the first chirp of all
    if index > 0:
        last_s = frame.start_s(index - 1) + frame.at(index - 1).chirps_s[-1]
        since_s = frame.start_s(index) - last_s
    weights = np.roll(frame.sent_weights(), 1, axis=0)
    gaps_s = np.diff(starts_s, prepend=starts_s[0] - since_s)
    return Before(gaps_s, weights, frame.chirp.ramp_duration_s)


def _empty_samples(
    scene: Scene, radar: Radar, n_frames: int, more: int, dtype: np.dtype[np.complexfloating]
) -> np.ndarray:
    frame, chirp = radar.frame, radar.frame.chirp
    shape = (n_frames, frame.n_sent, radar.array.n_rx, chirp.n_samples + more)
    kind = dtype if chirp.sampling == "complex" else np.empty(0, dtype).real.dtype
    cubes = CUBES_HELD * float(np.prod(shape, dtype=float)) * kind.itemsize
    must_fit(
        "simulation",
        needed_bytes=cubes + _SCATTERER_BYTES * scene.n_scatterers,
        fix="Simulate fewer frames, chirps, receivers, samples or scatterers.",
    )
    return np.zeros(shape, kind)

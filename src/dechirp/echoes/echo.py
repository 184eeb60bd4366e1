"""From a scene to what the converter samples."""

import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.checks import whole
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import PhysicsWarning
from dechirp.core.memory import must_fit
from dechirp.echoes.engine import Engine
from dechirp.echoes.impairments.base import Impairment
from dechirp.echoes.impairments.thermal_noise import ThermalNoise
from dechirp.echoes.kernels import choice
from dechirp.echoes.kernels.base import Scatterers, Sent
from dechirp.echoes.kernels.direct import Before
from dechirp.radar.budget import echo_amplitude
from dechirp.radar.cube import labelled_cube
from dechirp.radar.radar import Radar
from dechirp.scene.fluctuation import power_factors
from dechirp.scene.paths import paths
from dechirp.scene.possible import must_be_possible
from dechirp.scene.rcs import cross_sections_m2
from dechirp.scene.scene import Scene
from dechirp.scene.surprises import surprises

# Cubes that simulating and processing hold at once, at most.
CUBES_HELD = 3

# Bytes for each scatterer: its path, amplitude and gains, tones and series.
_SCATTERER_BYTES = 600
# Grids and tables of the kernels, on two threads.
_KERNEL_BYTES = 300e6
# A real cube is summed as a complex one of so many samples at a time.
_AT_ONCE = 2**20

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
        Act on the echoes in this order; thermal noise alone without it, none when empty.
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
        Complex sampling: |.|^2 of an echo is its power. Real sampling: its mean square is.
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
        antennas at one place; codes that are not orthogonal.

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
    for finding in surprises(scene, radar, n_frames=n_frames):
        warnings.warn(str(finding), PhysicsWarning, stacklevel=2)
    cube = clean_echoes(
        scene, radar, n_frames=n_frames, dtype=kind, rng=rng, engine=engine, progress=progress
    )
    for impairment in (ThermalNoise(),) if impairments is None else impairments:
        impairment.apply(cube, scene=scene, radar=radar, rng=rng)
    return cube


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
    must_be_possible(scene, radar, n_frames=n_frames)
    cube = _empty_cube(scene, radar, n_frames, dtype)
    kernels: set[str] = set()
    for index in range(n_frames):
        if scene.targets:
            kernels |= _add_frame(cube.values[index], scene, radar, index, rng, engine or Engine())
        if progress is not None:
            progress(index + 1, n_frames)
    cube.attrs["kernels"] = ", ".join(sorted(kernels))
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
    for part in _parts(scene, radar, 0, np.random.default_rng(0)) if scene.targets else ():
        kernel, costs_s = choice.chosen(
            (len(part.sent.starts_s), *shape), part.scatterers, part.sent, engine, kind
        )
        planned.append(Planned(part.chirps, len(part.scatterers.amplitudes), kernel, costs_s))
    return planned


class _Part(NamedTuple):
    """Scatterers whose paths are polynomials during a run of chirps."""

    chirps: slice
    scatterers: Scatterers
    sent: Sent


def _parts(scene: Scene, radar: Radar, index: int, rng: np.random.Generator) -> Iterator[_Part]:
    """What is to be summed for one frame; all chirps, as they are sent."""
    frame = radar.frame
    start_s = frame.start_s(index)
    mid_s = start_s + frame.mid_frame_s
    per_frame, per_chirp = power_factors(scene, frame.n_sent, rng)
    positions_m = scene.positions_m([mid_s])
    every = Scatterers(
        positions_m,
        echo_amplitude(radar) * np.sqrt(cross_sections_m2(scene, mid_s) * per_frame),
        *_gains(positions_m[0], radar),
    )
    seen = every.amplitudes * every.tx_gains.max(axis=0) * every.rx_gains.max(axis=0) > 0
    starts_s = frame.interval_s * np.arange(frame.n_sent)
    weights = frame.sent_weights()
    for path in paths(scene, frame, start_s):
        kept = seen[path.scatterers]
        own, chirps = path.scatterers[kept], path.chirps
        factors = None if per_chirp is None else np.sqrt(per_chirp[chirps][:, own])
        scatterers = choice.some(every, own)._replace(
            path_m=path.path_m[:, kept], chirp_factors=factors
        )
        if own.size:
            sent = _sent(radar, starts_s[chirps] - path.mid_s, weights[chirps])
            yield _Part(chirps, scatterers, sent)


def _add_frame(
    samples: np.ndarray,
    scene: Scene,
    radar: Radar,
    index: int,
    rng: np.random.Generator,
    engine: Engine,
) -> set[str]:
    """Add the echoes of one frame to `samples`, (chirp, rx, sample), and name the kernels."""
    before = _before(radar, index) if engine.late == "tail" else None
    kernels = set()
    for part in _parts(scene, radar, index, rng):
        own = None if before is None else before.of(part.chirps)
        kernels |= _add(samples[part.chirps], part.scatterers, part.sent, engine, own)
    return kernels


def _add(
    samples: np.ndarray,
    scatterers: Scatterers,
    sent: Sent,
    engine: Engine,
    before: Before | None,
) -> set[str]:
    if np.iscomplexobj(samples):
        return choice.add(samples, scatterers, sent, engine=engine, before=before)
    # One mixer: the same mean power as the two of a complex receiver together. Some chirps at
    # a time, since a complex copy of the whole frame would be two more cubes.
    kernels = set()
    at_once = max(1, _AT_ONCE // samples[0].size)
    for first in range(0, len(samples), at_once):
        rows = slice(first, first + at_once)
        echo = np.zeros(samples[rows].shape, np.result_type(samples, np.complex64))
        own = None if before is None else before.of(rows)
        kernels |= choice.add(
            echo, *choice.rows_of(scatterers, sent, rows), engine=engine, before=own
        )
        samples[rows] += samples.dtype.type(np.sqrt(2)) * echo.real
    return kernels


def _sent(radar: Radar, starts_s: np.ndarray, weights: np.ndarray) -> Sent:
    chirp = radar.frame.chirp
    return Sent(
        starts_s,
        weights,
        np.array(radar.array.tx_m),
        np.array(radar.array.rx_m),
        chirp.start_frequency_hz,
        chirp.slope_hz_per_s,
        chirp.adc_start_s,
        chirp.sample_rate_hz,
    )


def _before(radar: Radar, index: int) -> Before:
    """What was sent before each chirp of a frame: nothing before the first of all."""
    frame = radar.frame
    gaps_s = np.full(frame.n_sent, frame.interval_s)
    last_s = (frame.n_sent - 1) * frame.interval_s
    gaps_s[0] = np.nan if index == 0 else frame.start_s(index) - frame.start_s(index - 1) - last_s
    weights = np.roll(frame.sent_weights(), 1, axis=0)
    return Before(gaps_s, weights, frame.chirp.ramp_duration_s)


def _gains(positions_m: np.ndarray, radar: Radar) -> tuple[np.ndarray, np.ndarray]:
    """Amplitude gains of every transmitter and receiver towards each scatterer."""
    hardware = radar.known_hardware()

    def towards(antennas_m: tuple[tuple[float, float, float], ...], which: str) -> np.ndarray:
        gain = getattr(hardware, f"{which}_gain")
        if getattr(hardware, f"{which}_pattern") is None:
            return np.full((len(antennas_m), len(positions_m)), np.sqrt(gain()))
        gains = np.empty((len(antennas_m), len(positions_m)))
        for row, antenna_m in zip(gains, antennas_m, strict=True):
            x, y, z = (positions_m - np.array(antenna_m)).T
            row[:] = np.sqrt(gain(np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))))
        return gains

    return towards(radar.array.tx_m, "tx"), towards(radar.array.rx_m, "rx")


def _empty_cube(
    scene: Scene, radar: Radar, n_frames: int, dtype: np.dtype[np.complexfloating]
) -> xr.DataArray:
    frame, chirp = radar.frame, radar.frame.chirp
    shape = (n_frames, frame.n_sent, radar.array.n_rx, chirp.n_samples)
    kind = dtype if chirp.sampling == "complex" else np.empty(0, dtype).real.dtype
    cubes = CUBES_HELD * float(np.prod(shape, dtype=float)) * kind.itemsize
    must_fit(
        "simulation",
        needed_bytes=cubes + _SCATTERER_BYTES * scene.n_scatterers,
        fix="Simulate fewer frames, chirps, receivers, samples or scatterers.",
    )
    return labelled_cube(np.zeros(shape, kind), radar, units="sqrt(W)")

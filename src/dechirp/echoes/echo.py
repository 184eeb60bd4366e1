"""From a scene to what the converter samples."""

import warnings
from collections.abc import Sequence

import numpy as np
import xarray as xr

from dechirp.core.checks import whole
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import PhysicsWarning
from dechirp.core.memory import must_fit
from dechirp.echoes.impairments.base import Impairment
from dechirp.echoes.impairments.thermal_noise import ThermalNoise
from dechirp.echoes.kernels.direct import add_echoes
from dechirp.radar.budget import echo_amplitude
from dechirp.radar.cube import labelled_cube
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene, surprises

# Cubes that simulating and processing hold at once, at most.
CUBES_HELD = 3

_DOUBLE: np.dtype[np.complexfloating] = np.dtype(np.complex128)


def simulate(
    scene: Scene,
    radar: Radar,
    *,
    impairments: Sequence[Impairment] | None = None,
    n_frames: int = 1,
    seed: int | np.random.Generator = 0,
    dtype: type[np.complexfloating] = np.complex64,
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
        Real sampling gives the real type of that precision. The echoes are computed in
        double precision either way, within 1e-9 of 50 digits.

    Returns
    -------
    DataArray (frame, chirp, rx, sample), sqrt(W)
        Complex sampling: |.|^2 of an echo is its power. Real sampling: its mean square is.

    Raises
    ------
    InvalidSetting
        If the radar's hardware is not known, a target sits on the radar, an impairment
        names a target that is not there, or `n_frames`, `seed` or `dtype` is none.
    NotEnoughMemory
        If the cube and its processing would not fit.

    Warns
    -----
    PhysicsWarning
        For each target that folds in range or velocity, or whose echo comes late.

    Notes
    -----
    Every sample holds the echo, also those taken before it arrives; see `add_echoes` for
    the phase. The amplitude follows the radar equation with the range of each sample.
    """
    whole("n_frames", n_frames, at_least=1, at_most=1_000_000)
    rng = _generator(seed)
    kind = _cube_type(dtype)
    for finding in surprises(scene, radar, n_frames=n_frames):
        warnings.warn(str(finding), PhysicsWarning, stacklevel=2)
    cube = clean_echoes(scene, radar, n_frames=n_frames, dtype=kind)
    for impairment in (ThermalNoise(),) if impairments is None else impairments:
        impairment.apply(cube, scene=scene, radar=radar, rng=rng)
    return cube


def clean_echoes(
    scene: Scene,
    radar: Radar,
    *,
    n_frames: int = 1,
    dtype: np.dtype[np.complexfloating] = _DOUBLE,
) -> xr.DataArray:
    """Echoes alone, before any impairment, and without a word on what surprises."""
    cube = _empty_cube(radar, n_frames, dtype)
    amplitudes = echo_amplitude(radar) * np.sqrt([target.rcs_m2 for target in scene.targets])
    for index in range(n_frames if scene.targets else 0):
        start_s = radar.frame.start_s(index)
        positions_m = scene.positions_m(start_s)
        _add_frame(cube.values[index], amplitudes, positions_m, scene.velocities_m_per_s(), radar)
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


def _add_frame(
    samples: np.ndarray,
    amplitudes: np.ndarray,
    positions_m: np.ndarray,
    velocities_m_per_s: np.ndarray,
    radar: Radar,
) -> None:
    """Add the echoes of one frame to `samples`, (chirp, rx, sample), chirps in the order sent."""
    frame, chirp = radar.frame, radar.frame.chirp
    waveform = (
        chirp.start_frequency_hz,
        chirp.slope_hz_per_s,
        frame.repetition_s,
        chirp.adc_start_s,
        chirp.sample_rate_hz,
    )
    tx_m, rx_m = np.array(radar.array.tx_m), np.array(radar.array.rx_m)
    order = [transmitter for (transmitter,) in frame.slots]
    if chirp.sampling == "complex":
        for slot, transmitter in enumerate(order):
            at_m = positions_m + slot * frame.interval_s * velocities_m_per_s
            targets = (amplitudes, at_m, velocities_m_per_s)
            add_echoes(samples[slot :: len(order)], *targets, tx_m[transmitter], rx_m, *waveform)
        return
    # One mixer: the same mean power as the two of a complex receiver together. Chirp by
    # chirp, since a complex copy of the whole frame would be two more cubes.
    amplitude = samples.dtype.type(np.sqrt(2))
    echo = np.empty((1, *samples.shape[1:]), np.result_type(samples, np.complex64))
    for index in range(len(samples)):
        echo[:] = 0
        at_m = positions_m + index * frame.interval_s * velocities_m_per_s
        targets = (amplitudes, at_m, velocities_m_per_s)
        add_echoes(echo, *targets, tx_m[order[index % len(order)]], rx_m, *waveform)
        samples[index] += amplitude * echo[0].real


def _empty_cube(radar: Radar, n_frames: int, dtype: np.dtype[np.complexfloating]) -> xr.DataArray:
    frame, chirp = radar.frame, radar.frame.chirp
    shape = (n_frames, frame.n_sent, radar.array.n_rx, chirp.n_samples)
    kind = dtype if chirp.sampling == "complex" else np.empty(0, dtype).real.dtype
    must_fit(
        "simulation",
        needed_bytes=CUBES_HELD * float(np.prod(shape, dtype=float)) * kind.itemsize,
        fix="Simulate fewer frames, chirps, receivers or samples.",
    )
    return labelled_cube(np.zeros(shape, kind), radar, units="sqrt(W)")

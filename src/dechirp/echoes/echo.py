"""From a scene to what the converter samples."""

import warnings
from collections.abc import Sequence

import numpy as np
import xarray as xr

from dechirp.core.conventions import CUBE_AXES, axis
from dechirp.core.findings import PhysicsWarning
from dechirp.core.memory import must_fit
from dechirp.echoes.impairments.base import Impairment
from dechirp.echoes.impairments.thermal_noise import ThermalNoise
from dechirp.echoes.kernels.direct import add_echoes
from dechirp.radar.budget import echo_amplitude
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene, surprises

# Cubes that simulating and processing hold at once, at most.
CUBES_HELD = 3


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
        If the radar's hardware is not known, a target sits on the radar, or an impairment
        names a target that is not there.
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
    for finding in surprises(scene, radar):
        warnings.warn(str(finding), PhysicsWarning, stacklevel=2)
    cube = _empty_cube(radar, n_frames, np.dtype(dtype))
    amplitudes = echo_amplitude(radar) * np.sqrt([target.rcs_m2 for target in scene.targets])
    for index in range(n_frames if scene.targets else 0):
        start_s = radar.frame.start_s(index)
        positions_m = scene.positions_m(start_s)
        _add_frame(cube.values[index], amplitudes, positions_m, scene.velocities_m_per_s(), radar)
    rng = np.random.default_rng(seed)
    for impairment in (ThermalNoise(),) if impairments is None else impairments:
        impairment.apply(cube, scene=scene, radar=radar, rng=rng)
    return cube


def _add_frame(
    samples: np.ndarray,
    amplitudes: np.ndarray,
    positions_m: np.ndarray,
    velocities_m_per_s: np.ndarray,
    radar: Radar,
) -> None:
    """Add the echoes of one frame to `samples`, (chirp, rx, sample)."""
    chirp = radar.frame.chirp
    waveform = (
        chirp.start_frequency_hz,
        chirp.slope_hz_per_s,
        radar.frame.interval_s,
        chirp.adc_start_s,
        chirp.sample_rate_hz,
    )
    antennas = (np.array(radar.array.tx_m[0]), np.array(radar.array.rx_m))
    targets = (amplitudes, positions_m, velocities_m_per_s)
    if chirp.sampling == "complex":
        add_echoes(samples, *targets, *antennas, *waveform)
        return
    echo = np.zeros(samples.shape, np.complex128 if samples.dtype == float else np.complex64)
    add_echoes(echo, *targets, *antennas, *waveform)
    # One mixer: the same mean power as the two of a complex receiver together.
    samples += np.sqrt(2.0) * echo.real


def _empty_cube(radar: Radar, n_frames: int, dtype: np.dtype[np.complexfloating]) -> xr.DataArray:
    frame, chirp = radar.frame, radar.frame.chirp
    shape = (n_frames, frame.n_chirps, radar.array.n_rx, chirp.n_samples)
    kind = dtype if chirp.sampling == "complex" else np.empty(0, dtype).real.dtype
    must_fit(
        "simulation",
        needed_bytes=CUBES_HELD * float(np.prod(shape, dtype=float)) * kind.itemsize,
        fix="Simulate fewer frames, chirps, receivers or samples.",
    )
    return xr.DataArray(
        np.zeros(shape, kind),
        dims=CUBE_AXES,
        coords={
            "frame": axis("frame", np.array([frame.start_s(i) for i in range(n_frames)])),
            "chirp": axis("chirp", np.arange(frame.n_chirps) * frame.interval_s),
            "rx": axis("rx", np.arange(radar.array.n_rx)),
            "sample": axis(
                "sample", chirp.adc_start_s + np.arange(chirp.n_samples) / chirp.sample_rate_hz
            ),
        },
        name="cube",
        attrs={"units": "sqrt(W)", "convention": "beat = Tx x conj(Rx), receding positive"},
    )

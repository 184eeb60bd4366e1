"""Looks at one target in noise: what the reference radar and its chain make of them."""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.conventions import CUBE_AXES
from dechirp.core.normal import add_white_noise
from dechirp.core.units import SPEED_OF_LIGHT, from_decibels
from dechirp.core.values import value
from dechirp.echoes.echo import clean_echoes
from dechirp.experiment.scenario import reference
from dechirp.process.chain import Chain
from dechirp.process.detect import detect
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target
from dechirp.scene.truth import truth
from dechirp.theory.windows import Window


@value
class Look:
    """One way of looking at a noisy frame."""

    window: Window
    """Over range and over velocity."""
    snr_db: tuple[float, ...]
    """Ratio in each sample; the trials take them in turn."""


def named(window: Window) -> str:
    """What checks and curves call a window."""
    return f"{'Hann' if window == 'hann' else window} windows"


class Motion(NamedTuple):
    """A range and a velocity along the line of sight."""

    range_m: float
    velocity_m_per_s: float


REFERENCE = Motion(50.0, 10.0)
"""The reference target at the start of the frame."""
RCS_M2 = 10.0
QUIET_SNR_DB = -10.0
"""Ratio in each sample at which noise hides nothing."""

COLUMNS = ("snr_db", "hit", "range_error_m", "velocity_error_m_per_s")


@cache
def radar() -> Radar:
    """The reference radar."""
    made = reference().radar
    assert made is not None
    return made


@cache
def echo(range_m: float, velocity_m_per_s: float) -> xr.DataArray:
    """Echo of a target straight ahead, noise-free, of unit mean power in the samples."""
    clean = clean_echoes(scene(range_m, velocity_m_per_s), radar())
    return (clean / np.sqrt(np.mean(abs(clean.values) ** 2))).astype(np.complex64)


def scene(range_m: float, velocity_m_per_s: float) -> Scene:
    """One target straight ahead: the car of the reference scenario, elsewhere."""
    target = Target(
        position_m=(range_m, 0.0, 0.0), velocity_m_per_s=(velocity_m_per_s, 0.0, 0.0), rcs_m2=RCS_M2
    )
    return Scene(targets=(target,))


@cache
def late_echo() -> np.ndarray:
    """Echo of the reference target from its arrival on, of unit mean power, (chirp, 1, sample)."""
    samples = np.array(echo(*REFERENCE).values[0])
    delay_s = 2 * REFERENCE.range_m / SPEED_OF_LIGHT
    samples[..., : round(delay_s * radar().frame.chirp.sample_rate_hz)] = 0
    return np.asarray(samples / np.float32(np.sqrt(np.mean(abs(samples) ** 2))))


def at_mid_frame(start: Motion) -> Motion:
    """Range and velocity at mid-frame, to which estimates refer."""
    known = truth(scene(*start), radar()).isel(frame=0, target=0)
    return Motion(float(known.range), float(known.velocity))


def white_noise(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Complex noise of unit power, complex64."""
    samples = np.zeros(shape, np.complex64)
    add_white_noise(samples, 1.0, rng)
    return samples


def look_at_target(
    rng: np.random.Generator,
    n_trials: int,
    *,
    range_m: float,
    velocity_m_per_s: float,
    looks: Sequence[Look],
) -> np.ndarray:
    """What the chain finds of a target in noise, (n_trials, looks, COLUMNS).

    All looks of a trial see the same noise. A hit lies within one resolution cell of the
    truth on both axes; errors are those of the strongest hit, nan without one.
    """
    clean = echo(range_m, velocity_m_per_s)
    true = at_mid_frame(Motion(range_m, velocity_m_per_s))
    cell_m = radar().frame.chirp.range_resolution_m
    cell_m_per_s = radar().frame.velocity_resolution_m_per_s
    out = np.full((n_trials, len(looks), len(COLUMNS)), np.nan)
    cube = xr.DataArray(np.empty_like(clean.values), dims=CUBE_AXES)
    for trial in range(n_trials):
        noise = white_noise(rng, clean.shape)
        for index, look in enumerate(looks):
            snr_db = look.snr_db[trial % len(look.snr_db)]
            amplitude = np.float32(np.sqrt(from_decibels(snr_db)))
            np.multiply(clean.values, amplitude, out=cube.values)
            cube.values += noise
            chain = Chain(range_window=look.window, doppler_window=look.window)
            found = detect(cube, radar(), chain)
            apart_m = found.range.values - true.range_m
            apart_m_per_s = found.velocity.values - true.velocity_m_per_s
            hits = np.flatnonzero((abs(apart_m) <= cell_m) & (abs(apart_m_per_s) <= cell_m_per_s))
            out[trial, index, :2] = snr_db, hits.size > 0
            if hits.size:
                out[trial, index, 2:] = apart_m[hits[0]], apart_m_per_s[hits[0]]
    return out


def column(looks: np.ndarray, name: str) -> np.ndarray:
    """One of COLUMNS."""
    return looks[..., COLUMNS.index(name)]

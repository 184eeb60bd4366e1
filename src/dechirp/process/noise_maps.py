r"""Maps of nothing but white noise, drawn as they come out of the transforms.

The discrete Fourier transform of white noise is white over its bins. A window that is a sum of
few cosines multiplies samples by few lines, so it convolves bins with as few: those of a Hann
window with -1/2, 1 and -1/2 (Harris 1978), round the ends, along range and along velocity. So a
map is white complex amplitudes, convolved along both axes, their powers averaged over the
channels. Nothing is approximated: a map has the distribution of one that is made of samples.

References
----------
F. J. Harris, On the use of windows for harmonic analysis with the discrete Fourier transform,
Proc. IEEE 66(1), 1978.
"""

from functools import lru_cache

import numba
import numpy as np

from dechirp.core.checks import number
from dechirp.core.errors import InvalidSetting
from dechirp.core.memory import must_fit
from dechirp.core.normal import add_white_noise
from dechirp.core.scratch import lent
from dechirp.process.chain import Chain
from dechirp.process.spectrum import Transform, noise_gain
from dechirp.radar.radar import Radar

# Bins on each side that a window reaches: three for Blackman-Harris. With more, convolving
# takes as long as the transforms that it saves.
_FARTHEST = 3
_ROUNDING = 1e-12  # of window weights, which are sums of a few cosines


def draws_directly(radar: Radar, chain: Chain) -> bool:
    """Whether maps of white noise can be drawn: `draw_noise_map` gives those that samples would.

    Complex samples, no zero padding, windows that are sums of cosines, no clean-up, no walk
    undone, and ramps that all rise, since those of triangles have a map for either side. That
    there is no other noise, interference or leakage the caller knows.
    """
    frame = radar.frame
    return (
        frame.chirp.sampling == "complex"
        and not frame.falls
        and not chain.mitigation
        and chain.range_walk is None
        and _reaches(chain.over_range(frame.chirp)) is not None
        and _reaches(chain.over_velocity(frame)) is not None
    )


def draw_noise_map(
    radar: Radar, chain: Chain, noise_power_w: float, rng: np.random.Generator
) -> np.ndarray:
    """Map of one frame of white noise, (velocity, range) float32.

    In distribution what `process.maps.power_of` makes of samples; `noise_power_w` is the mean
    power of one sample, real and imaginary part together.

    Raises
    ------
    InvalidSetting
        Where maps cannot be drawn, see `draws_directly`, or the power is not finite, 0 or more.
    NotEnoughMemory
        If the map would not fit.
    """
    power = number("noise_power_w", noise_power_w, at_least=0)
    noise = chain.noise(radar)
    over_velocity, over_range = _reaches(noise.over_velocity), _reaches(noise.over_range)
    if over_velocity is None or over_range is None or not draws_directly(radar, chain):
        raise InvalidSetting(
            "chain",
            got="one whose maps of noise cannot be drawn directly",
            need="of complex samples, unpadded, under windows that are sums of cosines, without"
            " clean-up or range walk",
            fix="Make the map of samples of noise, with process.maps.power_of.",
        )
    shape = noise.over_velocity.n_bins, noise.over_range.n_bins
    must_fit(
        "map of noise",
        needed_bytes=shape[0] * shape[1] * (2 * 4.0 + 4.0),  # amplitudes of a channel, power
        fix="Take fewer samples or chirps.",
    )
    mean = power * noise_gain(noise.over_range, noise.over_velocity, radar.frame.chirp)
    bandwidths = noise.over_range.noise_bandwidth_bins * noise.over_velocity.noise_bandwidth_bins
    share = np.float32(mean / bandwidths / (2 * noise.n_channels))
    # Real and imaginary parts are side by side, not in turn: then all loops are vectorised.
    white = lent("noise", shape).view(np.float32).reshape(shape[0], 2, shape[1])
    sums = np.zeros(shape, np.float32)
    for _ in range(noise.n_channels):
        white.fill(0)
        add_white_noise(white, 1.0, rng)
        _add_power(sums, white, over_velocity, over_range, share)
    return sums


@lru_cache(maxsize=32)
def _reaches(transform: Transform) -> np.ndarray | None:
    """Factors of the bins so many from each, (n,) float32, its own first and 1; none if many.

    The transform of the window, which is real and even where that is a sum of cosines.
    """
    if transform.n_bins != transform.n_points:
        return None
    lines = np.fft.fft(transform.weights) / transform.weights.sum()
    half = lines[: lines.size // 2 + 1]
    if abs(half.imag).max() > _ROUNDING:
        return None
    farthest = int(np.flatnonzero(abs(half) > _ROUNDING)[-1])
    if farthest > _FARTHEST:
        return None
    factors = half.real[: farthest + 1].astype(np.float32)
    if 2 * farthest == lines.size and farthest:
        factors[-1] /= 2  # the bin half round is reached from both sides
    factors.setflags(write=False)  # it is kept, and handed out again
    return factors


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _add_power(
    sums: np.ndarray,
    white: np.ndarray,
    over_velocity: np.ndarray,
    over_range: np.ndarray,
    share: np.float32,
) -> None:
    """Add a share of the power of white amplitudes (velocity, 2, range), convolved, in place.

    Row by row, so that what is between the two convolutions stays in the innermost cache.
    """
    n_v, n_r = sums.shape
    far = over_range.size - 1
    line = np.empty(n_r + 2 * far, np.float32)
    middle = line[far : far + n_r]
    for v in range(n_v):
        out = sums[v]
        for part in range(2):
            own = white[v, part]
            for j in range(n_r):
                middle[j] = own[j]
            for m in range(1, over_velocity.size):
                factor = over_velocity[m]
                before, after = white[(v - m) % n_v, part], white[(v + m) % n_v, part]
                for j in range(n_r):
                    middle[j] += factor * (before[j] + after[j])
            for m in range(1, far + 1):  # round the ends
                line[far - m] = middle[-m % n_r]
                line[far + n_r - 1 + m] = middle[(m - 1) % n_r]
            _add_squares(out, line, over_range, share)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _add_squares(out: np.ndarray, line: np.ndarray, factors: np.ndarray, share: np.float32) -> None:
    """Add a share of the squares of a row after the convolution along it."""
    n, far = out.size, factors.size - 1
    middle = line[far : far + n]
    if far == 1:  # one pass: most maps are Hann's
        one = factors[1]
        before, after = line[:n], line[2 : 2 + n]
        for j in range(n):
            z = middle[j] + one * (before[j] + after[j])
            out[j] += share * z * z
        return
    total = np.empty(n, np.float32)
    for j in range(n):
        total[j] = middle[j]
    for m in range(1, far + 1):
        factor = factors[m]
        before, after = line[far - m : far - m + n], line[far + m : far + m + n]
        for j in range(n):
            total[j] += factor * (before[j] + after[j])
    for j in range(n):
        out[j] += share * total[j] * total[j]

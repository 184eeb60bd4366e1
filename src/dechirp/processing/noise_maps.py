r"""Range-Doppler maps of white noise, drawn directly in the transform domain.

The discrete Fourier transform of white noise is white over its bins. A window that is a sum of
few cosines has few spectral lines, so it convolves bins circularly with as few: those of a Hann
window with -1/2, 1 and -1/2 (Harris 1978), along range and along velocity. So a map is white
complex amplitudes, convolved along both axes, their powers averaged over the channels. Nothing is
approximated: a map has the distribution of one computed from samples.

References
----------
F. J. Harris, On the use of windows for harmonic analysis with the discrete Fourier transform,
Proc. IEEE 66(1), 1978.
"""

from functools import lru_cache

import numpy as np

from dechirp.core.buffers import scratch_complex64_array
from dechirp.core.checks import check_number
from dechirp.core.compiled_kernels import kernel
from dechirp.core.errors import InvalidSetting
from dechirp.core.gaussian_noise import add_white_noise
from dechirp.core.memory import check_free_memory
from dechirp.processing.chain import Chain
from dechirp.processing.spectrum import Transform, noise_gain
from dechirp.radar.radar import Radar

# Bins on each side that a window couples: three for Blackman-Harris. With more, the convolution
# takes as long as the transforms that it replaces.
_MAX_WINDOW_REACH = 3
_ROUNDING = 1e-12  # of window weights, which are sums of a few cosines


def can_draw_noise_maps(radar: Radar, chain: Chain) -> bool:
    """Return whether `draw_noise_map` can draw the noise maps of a radar and a chain.

    It requires complex samples, no zero padding, windows that are sums of cosines, no mitigation,
    no range-walk correction, and rising ramps only, since triangles have a map for either side.
    The caller excludes other noise, interference and leakage.
    """
    frame = radar.frame
    return (
        frame.chirp.sampling == "complex"
        and not frame.has_falling_ramps
        and not chain.mitigation
        and chain.range_walk is None
        and _window_convolution_factors(chain.range_transform(frame.chirp)) is not None
        and _window_convolution_factors(chain.doppler_transform(frame)) is not None
    )


def draw_noise_map(
    radar: Radar, chain: Chain, noise_power_w: float, rng: np.random.Generator
) -> np.ndarray:
    """Draw the map of one frame of white noise, (velocity, range) float32.

    It has the distribution of `processing.range_doppler_map.range_doppler_power` of white samples;
    `noise_power_w` is the mean power of one sample, real and imaginary part together.

    Raises
    ------
    InvalidSetting
        If maps cannot be drawn, see `can_draw_noise_maps`, or the power is negative or not finite.
    NotEnoughMemory
        If the map would not fit.
    """
    power = check_number("noise_power_w", noise_power_w, at_least=0)
    noise = chain.map_noise_statistics(radar)
    velocity_factors, range_factors = (
        _window_convolution_factors(noise.doppler_transform),
        _window_convolution_factors(noise.range_transform),
    )
    if velocity_factors is None or range_factors is None or not can_draw_noise_maps(radar, chain):
        raise InvalidSetting(
            "chain",
            value="one whose noise maps cannot be drawn directly",
            expected="complex samples, unpadded, under windows that are sums of cosines, without"
            " mitigation or range walk",
            fix="compute the map of noise samples with power_map",
        )
    shape = noise.doppler_transform.n_bins, noise.range_transform.n_bins
    check_free_memory(
        "map of noise",
        needed_bytes=shape[0] * shape[1] * (2 * 4.0 + 4.0),  # amplitudes of a channel, power
        fix="take fewer samples or chirps",
    )
    mean = power * noise_gain(noise.range_transform, noise.doppler_transform, radar.frame.chirp)
    bandwidths = (
        noise.range_transform.noise_bandwidth_bins * noise.doppler_transform.noise_bandwidth_bins
    )
    share = np.float32(mean / bandwidths / (2 * noise.n_channels))
    # Real and imaginary parts are stored in separate rows, so that all loops are vectorised.
    white = scratch_complex64_array("noise", shape).view(np.float32).reshape(shape[0], 2, shape[1])
    sums = np.zeros(shape, np.float32)
    for _ in range(noise.n_channels):
        white.fill(0)
        add_white_noise(white, 1.0, rng)
        _add_convolved_power(sums, white, velocity_factors, range_factors, share)
    return sums


@lru_cache(maxsize=32)
def _window_convolution_factors(transform: Transform) -> np.ndarray | None:
    """Return the factors of bins at distance 0, 1, ... of the convolution by a window, or None.

    (n,) float32, the first is 1: the transform of the window, which is real and even where the
    window is a sum of cosines. None if it couples more than three bins on each side.
    """
    if transform.n_bins != transform.n_points:
        return None
    lines = np.fft.fft(transform.weights) / transform.weights.sum()
    half = lines[: lines.size // 2 + 1]
    if abs(half.imag).max() > _ROUNDING:
        return None
    farthest = int(np.flatnonzero(abs(half) > _ROUNDING)[-1])
    if farthest > _MAX_WINDOW_REACH:
        return None
    factors = half.real[: farthest + 1].astype(np.float32)
    if 2 * farthest == lines.size and farthest:
        factors[-1] /= 2  # the opposite bin is reached from both sides
    factors.setflags(write=False)  # cached
    return factors


def _add_convolved_power_in_numpy(
    sums: np.ndarray,
    white: np.ndarray,
    velocity_factors: np.ndarray,
    range_factors: np.ndarray,
    power_factor: np.float32,
) -> None:
    """Plain twin of `_add_convolved_power`: equal within rounding."""
    for axis, factors in ((0, velocity_factors), (2, range_factors)):
        convolved = white.copy()
        for m, factor in enumerate(factors[1:], start=1):
            convolved += factor * (np.roll(white, m, axis) + np.roll(white, -m, axis))
        white = convolved
    sums += power_factor * np.sum(white**2, axis=1)


@kernel(plain=_add_convolved_power_in_numpy, fastmath={"contract", "reassoc"})
def _add_convolved_power(
    sums: np.ndarray,
    white: np.ndarray,
    velocity_factors: np.ndarray,
    range_factors: np.ndarray,
    power_factor: np.float32,
) -> None:
    """Add a share of the power of white amplitudes (velocity, 2, range), convolved, in place.

    Row by row, so that the row between the two convolutions stays in the L1 cache.
    """
    n_v, n_r = sums.shape
    far = range_factors.size - 1
    line = np.empty(n_r + 2 * far, np.float32)
    middle = line[far : far + n_r]
    for v in range(n_v):
        out = sums[v]
        for part in range(2):
            amplitudes = white[v, part]
            for j in range(n_r):
                middle[j] = amplitudes[j]
            for m in range(1, velocity_factors.size):
                factor = velocity_factors[m]
                row_before, row_after = white[(v - m) % n_v, part], white[(v + m) % n_v, part]
                for j in range(n_r):
                    middle[j] += factor * (row_before[j] + row_after[j])
            for m in range(1, far + 1):  # circular ends
                line[far - m] = middle[-m % n_r]
                line[far + n_r - 1 + m] = middle[(m - 1) % n_r]
            _add_convolved_squares(out, line, range_factors, power_factor)


@kernel(fastmath={"contract", "reassoc"})
def _add_convolved_squares(
    out: np.ndarray, line: np.ndarray, factors: np.ndarray, power_factor: np.float32
) -> None:
    """Add a share of the squares of a row after the convolution along it."""
    n, far = out.size, factors.size - 1
    middle = line[far : far + n]
    if far == 1:  # one pass for Hann windows, the usual case
        neighbour_factor = factors[1]
        lower, upper = line[:n], line[2 : 2 + n]
        for j in range(n):
            z = middle[j] + neighbour_factor * (lower[j] + upper[j])
            out[j] += power_factor * z * z
        return
    total = np.empty(n, np.float32)
    for j in range(n):
        total[j] = middle[j]
    for m in range(1, far + 1):
        factor = factors[m]
        lower, upper = line[far - m : far - m + n], line[far + m : far + m + n]
        for j in range(n):
            total[j] += factor * (lower[j] + upper[j])
    for j in range(n):
        out[j] += power_factor * total[j] * total[j]

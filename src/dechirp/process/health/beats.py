"""The mean beat spectrum of a frame: on which side echoes lie, and what mirrors them."""

from dataclasses import dataclass

import numba
import numpy as np
import scipy.fft
from scipy.special import gammainccinv, gammaincinv

from dechirp.theory.windows import taper

NEAR_BINS = 3
"""Beat frequencies next to 0 and to half the sample rate that count for no side: a Hann
window spreads the converter's offset and the leakage of the transmitter over them."""
_FEWEST_SAMPLES = 16  # fewer leave no bins between those
_CHANCE = 1e-9  # that noise alone makes a beat frequency of a frame stand out
_FOR_A_SIDE = 4.0  # 6 dB over the noise, so that no slope of a filter is taken for echoes
_FOR_AN_IMAGE = 10.0  # 10 dB: weaker echoes have images far below the noise
_OVER_ITS_SURROUNDINGS = 10.0
_BLOCK_NUMBERS = 2**17  # transformed and summed before they leave the cache of a core


@dataclass(frozen=True)
class Spectrum:
    """Mean over chirps of a frame, of each receiver, under a Hann window."""

    power: np.ndarray
    """(rx, bin): all bins of complex samples, those up to half the sample rate of real ones."""
    mirror: np.ndarray | None
    """(rx, bins from 1 to below half): mean of Y(k) Y(-k); None of real samples."""
    unlike: np.ndarray | None
    """Of the same bins: mean of the difference, without its sign, of |Y(k)|^2 and |Y(-k)|^2."""
    n_samples: int
    n_chirps: int


def mean_spectrum(samples: np.ndarray, lost: np.ndarray, scale: float) -> Spectrum:
    """Mean spectrum of samples (chirp, rx, sample) divided by `scale`."""
    n_rx, n_samples = samples.shape[1:]
    is_complex = np.iscomplexobj(samples)
    n_bins = n_samples if is_complex else n_samples // 2 + 1
    weights = (taper("hann", n_samples) / scale).astype(np.float32)
    power = np.zeros((n_rx, n_bins))
    mirror = np.zeros((n_rx, (n_samples - 1) // 2 if is_complex else 0), np.complex128)
    unlike = np.zeros(mirror.shape)
    kept = np.flatnonzero(~lost)
    per_block = max(1, _BLOCK_NUMBERS // n_samples)
    for first in range(0, kept.size, per_block):
        chosen = kept[first : first + per_block]
        is_whole = chosen[-1] - chosen[0] + 1 == chosen.size
        rows: slice | np.ndarray = slice(chosen[0], chosen[-1] + 1) if is_whole else chosen
        for k in range(n_rx):
            tapered = samples[rows, k] * weights
            spectra = scipy.fft.fft(tapered) if is_complex else scipy.fft.rfft(tapered)
            _add(spectra, power[k], mirror[k], unlike[k])
    n_chirps = max(kept.size, 1)
    return Spectrum(
        power=power / n_chirps,
        mirror=mirror / n_chirps if is_complex else None,
        unlike=unlike / n_chirps if is_complex else None,
        n_samples=n_samples,
        n_chirps=kept.size,
    )


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _add(spectra: np.ndarray, power: np.ndarray, mirror: np.ndarray, unlike: np.ndarray) -> None:
    """Add powers, and what mirrored bins have in common, of spectra (chirp, bin) to their sums."""
    n_chirps, n_bins = spectra.shape
    for m in range(n_chirps):
        for k in range(n_bins):
            z = spectra[m, k]
            power[k] += z.real * z.real + z.imag * z.imag
        for k in range(mirror.size):
            y, z = spectra[m, k + 1], spectra[m, n_bins - k - 1]
            mirror[k] += y * z
            unlike[k] += abs(y.real * y.real + y.imag * y.imag - z.real * z.real - z.imag * z.imag)


@dataclass(frozen=True)
class Beats:
    """What the spectrum of one frame tells; NaN where it cannot."""

    n_echoes: float
    """Beat frequencies that stand out of the noise."""
    echo_energy: np.ndarray
    """(side,): at positive and at negative beat frequencies, over the noise's."""
    mirrored: float
    """How alike both sides are, 0 to 1: 1 if samples are real but for a phase."""
    image: np.ndarray
    """(rx,), power of the image of the strongest echo over the echo's; NaN where none shows."""
    strongest_bin: float
    """Where that echo is; above half the number of samples: at a negative frequency."""


def beats(spectrum: Spectrum, alive: np.ndarray) -> Beats:
    """Judge the sides of a spectrum by the receivers that are `alive`, (rx,)."""
    n_rx, n_bins = spectrum.power.shape
    nothing = Beats(
        n_echoes=np.nan,
        echo_energy=np.zeros(2),
        mirrored=np.nan,
        image=np.full(n_rx, np.nan),
        strongest_bin=np.nan,
    )
    half = spectrum.n_samples / 2
    bins = np.arange(n_bins)
    from_zero = np.minimum(bins, spectrum.n_samples - bins)
    counted = (from_zero >= NEAR_BINS) & (from_zero <= half - NEAR_BINS)
    usable = alive & np.any(spectrum.power[:, counted] > 0, axis=1)
    if spectrum.n_samples < _FEWEST_SAMPLES or not spectrum.n_chirps or not usable.any():
        return nothing
    power = spectrum.power[usable]
    over_noise = np.mean(power / _noise(power[:, counted], spectrum.n_chirps), axis=0)
    # Receivers may share their noise, so that they count as one: at worst a weak echo is missed.
    stands_out = gammainccinv(spectrum.n_chirps, _CHANCE / n_bins) / spectrum.n_chirps
    n_echoes = float(np.count_nonzero(over_noise[counted] > stands_out))
    echoes = counted & (over_noise > max(stands_out, _FOR_A_SIDE))
    positive = bins < half
    energy = np.array([over_noise[echoes & side].sum() for side in (positive, ~positive)])
    if spectrum.mirror is None or spectrum.unlike is None:
        return Beats(
            n_echoes=n_echoes,
            echo_energy=energy,
            mirrored=np.nan,
            image=nothing.image,
            strongest_bin=np.nan,
        )
    # A peak of its own: the slope of the leakage about 0 has some of itself on the other side.
    is_peak = (over_noise >= np.roll(over_noise, 1)) & (over_noise >= np.roll(over_noise, -1))
    strongest = int(np.argmax(np.where(counted & is_peak, over_noise, 0.0)))
    image = np.full(n_rx, np.nan)
    if over_noise[strongest] > _FOR_AN_IMAGE:
        for k in np.flatnonzero(usable):
            image[k] = _image(spectrum.power[k], spectrum.mirror[k], strongest, spectrum.n_chirps)
    return Beats(
        n_echoes=n_echoes,
        echo_energy=energy,
        mirrored=_mirrored(power, spectrum.unlike[usable], spectrum.n_chirps),
        image=image,
        strongest_bin=float(strongest),
    )


def _noise(power: np.ndarray, n_chirps: int) -> np.ndarray:
    """Mean power of noise in a bin, (rx, 1), from the median: echoes fill few of many bins."""
    median = np.median(power, axis=1, keepdims=True)
    smallest = np.maximum(power.max(axis=1, keepdims=True) * 1e-15, 1e-300)
    return np.maximum(median, smallest) / (gammaincinv(n_chirps, 0.5) / n_chirps)


def _mirrored(power: np.ndarray, unlike: np.ndarray, n_chirps: int) -> float:
    """How alike mirrored bins are in every chirp: 1 if samples are real but for a phase.

    Bins near 0 and half the sample rate are left out: leakage lies on both sides of them. Of
    noise, the power of one bin has an even chance of any share of both, so that it is 0.5 on
    average, and of the 16 pairs or more that are asked for near 1 with no chance to speak of.
    """
    last = unlike.shape[1] - NEAR_BINS + 1
    pairs = np.arange(NEAR_BINS, last + 1)
    if pairs.size * n_chirps < 16:
        return np.nan
    both = np.maximum((power[:, pairs] + power[:, -pairs]).sum(axis=1), 1e-300)
    return float(np.mean(1 - unlike[:, pairs - 1].sum(axis=1) / both))


def _image(power: np.ndarray, mirror: np.ndarray, strongest: int, n_chirps: int) -> float:
    """Power of the image of an echo over the echo's; NaN if none stands out.

    Errors of the I/Q mixer turn x into x + b conj(x): what is at -k is b times the conjugate
    of what is at k, chirp by chirp. So products Y(k) Y(-k) add up where there is an image, and
    do not of noise and of echoes that move otherwise than the mirrored one.
    """
    n_bins = power.size
    lobe = strongest + np.arange(-1, 2)
    folded = np.minimum(lobe, n_bins - lobe)
    product = abs(mirror[folded - 1].sum())
    echo, mirrored = power[lobe].sum(), power[-lobe].sum()
    away = np.concatenate([np.arange(-9, -3), np.arange(4, 10)])
    around = (-strongest + away) % n_bins
    # Not the leakage about 0, nor the echo itself where it is near half the sample rate.
    to_zero, to_echo = np.minimum(around, n_bins - around), abs(around - strongest)
    around = around[(to_zero > 1) & (np.minimum(to_echo, n_bins - to_echo) > 3)]
    if not echo * mirrored > 0 or around.size < 4 or n_chirps < 2:
        return np.nan
    level = float((product / echo) ** 2)
    # Of n chirps of noise, the coherence exceeds r with the chance (1 - r)^(n - 1).
    coherence = min(product**2 / (echo * mirrored), 1.0)
    by_chance = (1 - coherence) ** (n_chirps - 1) > _CHANCE
    surroundings = 3 * float(power[around].mean())
    if by_chance or coherence < 0.5 or level * echo < _OVER_ITS_SURROUNDINGS * surroundings:
        return np.nan
    return level

"""Mean beat spectrum of a frame: sides of the echoes, and their mirror images."""

from dataclasses import dataclass

import numpy as np
import scipy

from dechirp.core.compiled_kernels import kernel
from dechirp.theory.detection import detection_threshold
from dechirp.theory.windows import window_weights

NEAR_BINS = 3
"""Beat frequencies next to 0 and to half the sample rate that count for no side: a Hann window
spreads the ADC offset and the transmitter leakage over them."""
_MIN_SAMPLES = 16  # fewer leave no bins in between
_FALSE_ALARM_PROBABILITY = 1e-9  # of noise, in the spectrum of a frame
_MIN_SIDE_RATIO = 4.0  # 6 dB over the noise, so that no filter slope counts as an echo
_MIN_IMAGE_RATIO = 10.0  # 10 dB; weaker echoes have images far below the noise
_MIN_SURROUNDINGS_RATIO = 10.0
_BLOCK_NUMBERS = 2**17  # values of a block that fit the cache of a core


@dataclass(frozen=True)
class MeanSpectrum:
    """Mean spectrum of each receiver over the chirps of a frame, under a Hann window."""

    power: np.ndarray
    """Power (rx, bin): all bins of complex samples, those up to half the sample rate of real
    ones."""
    mirror_product: np.ndarray | None
    """Mean of Y(k) Y(-k), (rx, bins from 1 to below half); None for real samples."""
    mirror_difference: np.ndarray | None
    """Mean of the absolute difference of |Y(k)|^2 and |Y(-k)|^2 in the same bins."""
    n_samples: int
    n_chirps: int


def mean_spectrum_and_mirror_products(
    samples: np.ndarray, is_lost: np.ndarray, largest_value: float
) -> MeanSpectrum:
    """Return the mean spectrum of samples (chirp, rx, sample) divided by `largest_value`."""
    n_rx, n_samples = samples.shape[1:]
    is_complex = np.iscomplexobj(samples)
    n_bins = n_samples if is_complex else n_samples // 2 + 1
    weights = (window_weights("hann", n_samples) / largest_value).astype(np.float32)
    power = np.zeros((n_rx, n_bins))
    mirror_product = np.zeros((n_rx, (n_samples - 1) // 2 if is_complex else 0), np.complex128)
    mirror_difference = np.zeros(mirror_product.shape)
    kept_chirps = np.flatnonzero(~is_lost)
    per_block = max(1, _BLOCK_NUMBERS // n_samples)
    for first in range(0, kept_chirps.size, per_block):
        block = kept_chirps[first : first + per_block]
        is_contiguous = block[-1] - block[0] + 1 == block.size
        rows: slice | np.ndarray = slice(block[0], block[-1] + 1) if is_contiguous else block
        for k in range(n_rx):
            tapered = samples[rows, k] * weights
            spectra = scipy.fft.fft(tapered) if is_complex else scipy.fft.rfft(tapered)
            _add_powers_and_mirror_products(
                spectra, power[k], mirror_product[k], mirror_difference[k]
            )
    n_chirps = max(kept_chirps.size, 1)
    return MeanSpectrum(
        power=power / n_chirps,
        mirror_product=mirror_product / n_chirps if is_complex else None,
        mirror_difference=mirror_difference / n_chirps if is_complex else None,
        n_samples=n_samples,
        n_chirps=kept_chirps.size,
    )


def _add_powers_and_mirror_products_in_numpy(
    spectra: np.ndarray, power: np.ndarray, mirror: np.ndarray, mirror_difference: np.ndarray
) -> None:
    squares = spectra.real**2 + spectra.imag**2
    power += squares.sum(axis=0, dtype=float)
    n = mirror.size
    mirror += (spectra[:, 1 : n + 1] * spectra[:, : -n - 1 : -1]).sum(axis=0, dtype=complex)
    differences = squares[:, 1 : n + 1] - squares[:, : -n - 1 : -1]
    mirror_difference += abs(differences).sum(axis=0, dtype=float)


@kernel(plain=_add_powers_and_mirror_products_in_numpy, fastmath={"contract", "reassoc"})
def _add_powers_and_mirror_products(
    spectra: np.ndarray, power: np.ndarray, mirror: np.ndarray, mirror_difference: np.ndarray
) -> None:
    """Add powers, mirror products and mirror differences of spectra (chirp, bin) to their sums."""
    n_chirps, n_bins = spectra.shape
    for m in range(n_chirps):
        for k in range(n_bins):
            z = spectra[m, k]
            power[k] += z.real * z.real + z.imag * z.imag
        for k in range(mirror.size):
            y, z = spectra[m, k + 1], spectra[m, n_bins - k - 1]
            mirror[k] += y * z
            mirror_difference[k] += abs(
                y.real * y.real + y.imag * y.imag - z.real * z.real - z.imag * z.imag
            )


@dataclass(frozen=True)
class SpectrumSides:
    """Measures of both sides of the spectrum of one frame; NaN where not available."""

    n_echoes: float
    """Number of beat frequencies above the noise."""
    echo_energy: np.ndarray
    """Energy at positive and at negative beat frequencies, over the noise, (side,)."""
    mirror_similarity: float
    """Similarity of both sides, 0 to 1: 1 for samples that are real except for a phase."""
    image_level: np.ndarray
    """Power of the image of the strongest echo over the echo's, (rx,); NaN without one."""
    strongest_bin: float
    """Bin of that echo; above half the number of samples: at a negative frequency."""


def measure_echoes_and_mirror_images(spectrum: MeanSpectrum, is_alive: np.ndarray) -> SpectrumSides:
    """Measure the sides of a spectrum from the receivers with a signal, (rx,)."""
    n_rx, n_bins = spectrum.power.shape
    no_result = SpectrumSides(
        n_echoes=np.nan,
        echo_energy=np.zeros(2),
        mirror_similarity=np.nan,
        image_level=np.full(n_rx, np.nan),
        strongest_bin=np.nan,
    )
    half_bins = spectrum.n_samples / 2
    bins = np.arange(n_bins)
    from_zero = np.minimum(bins, spectrum.n_samples - bins)
    is_counted = (from_zero >= NEAR_BINS) & (from_zero <= half_bins - NEAR_BINS)
    is_usable = is_alive & np.any(spectrum.power[:, is_counted] > 0, axis=1)
    if spectrum.n_samples < _MIN_SAMPLES or not spectrum.n_chirps or not is_usable.any():
        return no_result
    power = spectrum.power[is_usable]
    over_noise = np.mean(
        power / _noise_power_per_bin(power[:, is_counted], spectrum.n_chirps), axis=0
    )
    # Receivers may share their noise, so they count as one: at worst a weak echo is missed.
    threshold = (
        detection_threshold(_FALSE_ALARM_PROBABILITY / n_bins, n_summed=spectrum.n_chirps)
        / spectrum.n_chirps
    )
    n_echoes = float(np.count_nonzero(over_noise[is_counted] > threshold))
    is_echo = is_counted & (over_noise > max(threshold, _MIN_SIDE_RATIO))
    is_positive = bins < half_bins
    energy = np.array([over_noise[is_echo & side].sum() for side in (is_positive, ~is_positive)])
    if spectrum.mirror_product is None or spectrum.mirror_difference is None:
        return SpectrumSides(
            n_echoes=n_echoes,
            echo_energy=energy,
            mirror_similarity=np.nan,
            image_level=no_result.image_level,
            strongest_bin=np.nan,
        )
    # Only peaks count: the slope of the leakage about 0 also lies on the other side.
    is_peak = (over_noise >= np.roll(over_noise, 1)) & (over_noise >= np.roll(over_noise, -1))
    strongest = int(np.argmax(np.where(is_counted & is_peak, over_noise, 0.0)))
    image = np.full(n_rx, np.nan)
    if over_noise[strongest] > _MIN_IMAGE_RATIO:
        for k in np.flatnonzero(is_usable):
            image[k] = _image_to_echo_ratio(
                spectrum.power[k], spectrum.mirror_product[k], strongest, spectrum.n_chirps
            )
    return SpectrumSides(
        n_echoes=n_echoes,
        echo_energy=energy,
        mirror_similarity=_mirror_similarity(
            power, spectrum.mirror_difference[is_usable], spectrum.n_chirps
        ),
        image_level=image,
        strongest_bin=float(strongest),
    )


def _noise_power_per_bin(power: np.ndarray, n_chirps: int) -> np.ndarray:
    """Return the mean noise power in a bin, (rx, 1), from the median over bins."""
    median = np.median(power, axis=1, keepdims=True)
    smallest = np.maximum(power.max(axis=1, keepdims=True) * 1e-15, 1e-300)
    return np.maximum(median, smallest) / (detection_threshold(0.5, n_summed=n_chirps) / n_chirps)


def _mirror_similarity(power: np.ndarray, mirror_difference: np.ndarray, n_chirps: int) -> float:
    """Return the similarity of mirrored bins: 1 for samples that are real except for a phase.

    Bins near 0 and half the sample rate are left out, where leakage lies on both sides. In noise,
    the share of one bin in the power of both is uniform, so the similarity is 0.5 on average; for
    at least 16 pairs it is near 1 with negligible probability.
    """
    last = mirror_difference.shape[1] - NEAR_BINS + 1
    pairs = np.arange(NEAR_BINS, last + 1)
    if pairs.size * n_chirps < 16:
        return np.nan
    pair_power = np.maximum((power[:, pairs] + power[:, -pairs]).sum(axis=1), 1e-300)
    return float(np.mean(1 - mirror_difference[:, pairs - 1].sum(axis=1) / pair_power))


def _image_to_echo_ratio(
    power: np.ndarray, mirror: np.ndarray, strongest: int, n_chirps: int
) -> float:
    """Return the power of the image of an echo over the echo's; NaN if there is none.

    Errors of the I/Q mixer turn x into x + b conj(x): the value at -k is b times the conjugate of
    that at k, chirp by chirp. Products Y(k) Y(-k) add up coherently for an image, but not for
    noise or for echoes that move otherwise than the mirrored one.
    """
    n_bins = power.size
    lobe = strongest + np.arange(-1, 2)
    aliased = np.minimum(lobe, n_bins - lobe)
    product = abs(mirror[aliased - 1].sum())
    echo, mirrored = power[lobe].sum(), power[-lobe].sum()
    distances = np.concatenate([np.arange(-9, -3), np.arange(4, 10)])
    neighbours = (-strongest + distances) % n_bins
    # Leave out the leakage about 0, and the echo itself near half the sample rate.
    to_zero, to_echo = np.minimum(neighbours, n_bins - neighbours), abs(neighbours - strongest)
    neighbours = neighbours[(to_zero > 1) & (np.minimum(to_echo, n_bins - to_echo) > 3)]
    if not echo * mirrored > 0 or neighbours.size < 4 or n_chirps < 2:
        return np.nan
    level = float((product / echo) ** 2)
    # For n chirps of noise, the coherence exceeds r with probability (1 - r)^(n - 1).
    coherence = min(product**2 / (echo * mirrored), 1.0)
    is_random = (1 - coherence) ** (n_chirps - 1) > _FALSE_ALARM_PROBABILITY
    surroundings = 3 * float(power[neighbours].mean())
    if is_random or coherence < 0.5 or level * echo < _MIN_SURROUNDINGS_RATIO * surroundings:
        return np.nan
    return level

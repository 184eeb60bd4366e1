"""Measurements of receiver impairments, and of the typical 77 GHz chip that combines them."""

from collections.abc import Sequence

import numpy as np

from dechirp.certificate.impairments.measurement import MeasuredPair, Measurement, Quantity
from dechirp.certificate.impairments.reference_radar import (
    EMPTY_SCENE,
    N_SAMPLES,
    RATE_HZ,
    THERMAL_W_PER_HZ,
    beat_frequency_hz,
    equal_power_stationary_scene,
    impairment_radar,
    mean_power_w,
    power_ratio_db,
    simulate_samples,
    to_dbm,
    tone_power_w,
)
from dechirp.core.units import from_decibels, to_decibels
from dechirp.simulation.impairments.automotive_chip import AutomotiveChip
from dechirp.simulation.impairments.channel_mismatch import ChannelMismatch
from dechirp.simulation.impairments.compression import Compression
from dechirp.simulation.impairments.dc_offset import DcOffset
from dechirp.simulation.impairments.if_filter import IfFilter
from dechirp.simulation.impairments.iq_imbalance import IqImbalance
from dechirp.simulation.impairments.leakage import Leakage
from dechirp.theory.windows import window_weights

_RANGE_M = 20.0
_SECOND_RANGE_M = 28.0
_BACKOFF_DB = 20.0
_INTERCEPT_DB = 9.64


def _measure_compression_and_intermodulation(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    """Measure the compression at the 1 dB point, and the products of two echoes 20 dB below it."""
    single_echo = simulate_samples(equal_power_stationary_scene(_RANGE_M))
    saturated_receiver = Compression(p1db_w=mean_power_w(single_echo))
    compression_db = power_ratio_db(
        simulate_samples(equal_power_stationary_scene(_RANGE_M), saturated_receiver), single_echo
    )
    near_hz, far_hz = beat_frequency_hz(_RANGE_M), beat_frequency_hz(_SECOND_RANGE_M)
    backed_off_receiver = Compression(
        p1db_w=mean_power_w(single_echo) * float(from_decibels(_BACKOFF_DB))
    )
    two_echoes = simulate_samples(
        equal_power_stationary_scene(_RANGE_M, _SECOND_RANGE_M), backed_off_receiver
    )
    products_db = [
        float(
            to_decibels(
                tone_power_w(two_echoes, 2 * first_hz - second_hz)
                / tone_power_w(two_echoes, first_hz)
            )
        )
        for first_hz, second_hz in ((near_hz, far_hz), (far_hz, near_hz))
    ]
    formula_db = -2 * (_INTERCEPT_DB + _BACKOFF_DB)
    return [(compression_db, -1.0), *((product_db, formula_db) for product_db in products_db)]


def _theoretical_image_rejection_db(gain_db: float, phase_rad: float) -> float:
    """Return the image rejection of an unbalanced mixer (Razavi)."""
    g = 10 ** (gain_db / 20)
    wanted, image = (1 + sign * 2 * g * np.cos(phase_rad) + g**2 for sign in (1, -1))
    return float(to_decibels(wanted / image))


def _measured_image_rejection_db(samples: np.ndarray) -> float:
    """Return the power of the echo over its image, over all chirps and receivers."""
    beat = beat_frequency_hz(_RANGE_M)
    return float(to_decibels(tone_power_w(samples, beat) / tone_power_w(samples, -beat)))


def _measure_image_rejection_by_iq_imbalance(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    results = []
    for gain_db, degrees in ((0.1, 1.0), (1.0, 5.0)):
        imbalance = IqImbalance(
            gain=float(from_decibels(gain_db)), phase_rad=float(np.radians(degrees))
        )
        rejection_db = _measured_image_rejection_db(
            simulate_samples(equal_power_stationary_scene(_RANGE_M), imbalance)
        )
        results.append(
            (rejection_db, _theoretical_image_rejection_db(gain_db, np.radians(degrees)))
        )
    return results


def _measure_dc_offset_power(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    """Measure the power of the samples and of their mean, which are equal for a constant."""
    samples = simulate_samples(EMPTY_SCENE, DcOffset(power_w=1e-9), rng=rng)
    return [
        (to_dbm(mean_power_w(values)), to_dbm(1e-9)) for values in (samples, samples.mean(axis=-1))
    ]


_HIGH_PASS_HZ, _LOW_PASS_HZ, _LOW_PASS_ORDER = 700e3, 6e6, 4


def _measure_if_filter_gain(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    """Measure the gain of echoes below, within and above the passband."""
    filters = IfFilter(
        high_pass_hz=_HIGH_PASS_HZ,
        high_pass_order=2,
        low_pass_hz=_LOW_PASS_HZ,
        low_pass_order=_LOW_PASS_ORDER,
    )
    results = []
    for range_m in (3.0, _RANGE_M, 60.0):
        scene, echo_hz = equal_power_stationary_scene(range_m), beat_frequency_hz(range_m)
        high_pass_gain = 1 / (1 + (_HIGH_PASS_HZ / echo_hz) ** 4)
        low_pass_gain = 1 / (1 + (echo_hz / _LOW_PASS_HZ) ** (2 * _LOW_PASS_ORDER))
        gain_db = power_ratio_db(simulate_samples(scene, filters), simulate_samples(scene))
        results.append((gain_db, float(to_decibels(high_pass_gain * low_pass_gain))))
    return results


def _measure_channel_mismatch_gain_and_phase(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    mismatch = ChannelMismatch(gains=(1.0, float(from_decibels(0.5))), phases_rad=(0.0, 0.2))
    ratio = np.mean(
        simulate_samples(equal_power_stationary_scene(_RANGE_M), mismatch)[0, :, 1]
        / simulate_samples(equal_power_stationary_scene(_RANGE_M))[0, :, 1]
    )
    return (float(2 * to_decibels(abs(ratio))), 0.5), (float(np.angle(ratio)), 0.2)


def _measure_chip_image_rejection_and_noise(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    """Measure the image rejection of a strong echo, and the noise without echoes.

    The image is measured without the leakage: their compression product lies at the frequency of
    the image, 11 dB lower.
    """
    radar = impairment_radar(128)
    impairments = AutomotiveChip().impairments(radar)
    without_leakage = [
        impairment for impairment in impairments if not isinstance(impairment, Leakage)
    ]
    # The mean of the chirps lowers all but the echo of a stationary target by 21 dB.
    echo = simulate_samples(
        equal_power_stationary_scene(_RANGE_M, rcs_m2=100.0), *without_leakage, radar=radar, rng=rng
    ).mean(axis=1)
    weights = window_weights("blackman-harris", N_SAMPLES)
    spectrum = (
        abs(
            np.fft.fft(
                simulate_samples(EMPTY_SCENE, AutomotiveChip(), radar=radar, rng=rng) * weights
            )
        )
        ** 2
    )
    frequency_hz = np.arange(N_SAMPLES) * RATE_HZ / N_SAMPLES
    band = (frequency_hz > 4e6) & (frequency_hz < 8e6)  # beyond the high-pass
    density = np.mean(spectrum[..., band]) / (RATE_HZ * np.sum(weights**2))
    return (
        (
            _measured_image_rejection_db(echo),
            _theoretical_image_rejection_db(0.45, np.radians(2.0)),
        ),
        (to_dbm(float(density)), to_dbm(THERMAL_W_PER_HZ)),
    )


MEASUREMENTS = (
    Measurement(
        kind="compression",
        claim="A tone at the compression point loses 1 dB; two tones have the products of a"
        " third-order intercept point 9.64 dB higher.",
        quantities=(
            Quantity(name="gain at the compression point", unit="dB", tolerance=0.01),
            Quantity(name="lower product of two echoes 20 dB weaker", unit="dB", tolerance=0.2),
            Quantity(name="upper product of two echoes 20 dB weaker", unit="dB", tolerance=0.2),
        ),
        measure=_measure_compression_and_intermodulation,
    ),
    Measurement(
        kind="iq-imbalance",
        claim="The image rejection of an unbalanced I/Q mixer follows from its gain and phase"
        " errors.",
        quantities=(
            Quantity(name="image rejection, 0.1 dB and 1 degree", unit="dB", tolerance=0.05),
            Quantity(name="image rejection, 1 dB and 5 degrees", unit="dB", tolerance=0.05),
        ),
        measure=_measure_image_rejection_by_iq_imbalance,
    ),
    Measurement(
        kind="dc-offset",
        claim="A DC offset is a constant of the specified power.",
        quantities=(
            Quantity(name="power of the samples", unit="dBm", tolerance=0.001),
            Quantity(name="power of their mean", unit="dBm", tolerance=0.001),
        ),
        measure=_measure_dc_offset_power,
    ),
    Measurement(
        kind="if-filter",
        claim="Echoes are attenuated as by analogue Butterworth filters at their beat frequencies.",
        quantities=(
            Quantity(name="echo at 0.40 MHz, high-pass 0.7 MHz", unit="dB", tolerance=0.05),
            Quantity(name="echo at 2.7 MHz", unit="dB", tolerance=0.02),
            Quantity(name="echo at 8.0 MHz, low-pass 6 MHz", unit="dB", tolerance=0.1),
        ),
        measure=_measure_if_filter_gain,
    ),
    Measurement(
        kind="channel-mismatch",
        claim="Channel mismatch multiplies a receiver by its gain and rotates it by its phase.",
        quantities=(
            Quantity(name="gain", unit="dB", tolerance=0.001),
            Quantity(name="phase", unit="rad", tolerance=0.0001),
        ),
        measure=_measure_channel_mismatch_gain_and_phase,
    ),
    Measurement(
        kind="automotive-chip",
        claim="With all impairments of a typical chip, the image rejection is that of the data"
        " sheet"
        " and the noise that of the noise factor.",
        quantities=(
            Quantity(name="image rejection, without the leakage", unit="dB", tolerance=0.5),
            Quantity(name="noise density in 1 Hz, without echoes", unit="dBm", tolerance=0.5),
        ),
        measure=_measure_chip_image_rejection_and_noise,
        n_trials=64,
    ),
)

"""What receivers do to echoes: compress, mirror, offset, filter, differ; and a chip of all that."""

from collections.abc import Sequence

import numpy as np

from dechirp.core.units import decibels, from_decibels
from dechirp.echoes.impairments.compression import Compression
from dechirp.echoes.impairments.dc_offset import DcOffset
from dechirp.echoes.impairments.if_filter import IfFilter
from dechirp.echoes.impairments.iq_imbalance import IqImbalance
from dechirp.echoes.impairments.leakage import Leakage
from dechirp.echoes.impairments.mismatch import Mismatch
from dechirp.echoes.impairments.typical_77ghz import Typical77Ghz
from dechirp.experiment.verify.impairments.bench import (
    N_SAMPLES,
    NOTHING,
    RATE_HZ,
    THERMAL_W_PER_HZ,
    beat_hz,
    dbm,
    level_db,
    power_w,
    radar,
    samples,
    still,
    tone_w,
)
from dechirp.experiment.verify.impairments.measurement import Measured, Measurement, Quantity
from dechirp.theory.windows import taper

_AT_M = 20.0
_FAR_M = 28.0
_BACKOFF_DB = 20.0
_INTERCEPT_DB = 9.64


def _compression(rng: np.random.Generator) -> Sequence[Measured]:
    """Loss of an echo at the compression point, and products of two, 20 dB below it."""
    alone = samples(still(_AT_M))
    at_point = Compression(p1db_w=power_w(alone))
    lost_db = level_db(samples(still(_AT_M), at_point), alone)
    near_hz, far_hz = beat_hz(_AT_M), beat_hz(_FAR_M)
    weak = Compression(p1db_w=power_w(alone) * float(from_decibels(_BACKOFF_DB)))
    both = samples(still(_AT_M, _FAR_M), weak)
    products_db = [
        float(decibels(tone_w(both, 2 * one - other) / tone_w(both, one)))
        for one, other in ((near_hz, far_hz), (far_hz, near_hz))
    ]
    formula_db = -2 * (_INTERCEPT_DB + _BACKOFF_DB)
    return [(lost_db, -1.0), *((found_db, formula_db) for found_db in products_db)]


def _rejection_db(gain_db: float, phase_rad: float) -> float:
    """Of the image of an unlike mixer (Razavi)."""
    g = 10 ** (gain_db / 20)
    like, unlike = (1 + sign * 2 * g * np.cos(phase_rad) + g**2 for sign in (1, -1))
    return float(decibels(like / unlike))


def _over_image_db(found: np.ndarray) -> float:
    """Echo over its image, of all chirps and receivers together."""
    beat = beat_hz(_AT_M)
    return float(decibels(tone_w(found, beat) / tone_w(found, -beat)))


def _iq_imbalance(rng: np.random.Generator) -> Sequence[Measured]:
    found = []
    for gain_db, degrees in ((0.1, 1.0), (1.0, 5.0)):
        unlike = IqImbalance(
            gain=float(from_decibels(gain_db)), phase_rad=float(np.radians(degrees))
        )
        over_db = _over_image_db(samples(still(_AT_M), unlike))
        found.append((over_db, _rejection_db(gain_db, np.radians(degrees))))
    return found


def _dc_offset(rng: np.random.Generator) -> Sequence[Measured]:
    """Power of the samples, and of their mean: alike where they are constant."""
    found = samples(NOTHING, DcOffset(power_w=1e-9), rng=rng)
    return [(dbm(power_w(one)), dbm(1e-9)) for one in (found, found.mean(axis=-1))]


_HIGH_HZ, _LOW_HZ, _LOW_ORDER = 700e3, 6e6, 4


def _if_filter(rng: np.random.Generator) -> Sequence[Measured]:
    """What is left of echoes below, within and above the passband."""
    filters = IfFilter(
        high_pass_hz=_HIGH_HZ, high_pass_order=2, low_pass_hz=_LOW_HZ, low_pass_order=_LOW_ORDER
    )
    found = []
    for range_m in (3.0, _AT_M, 60.0):
        scene, at_hz = still(range_m), beat_hz(range_m)
        high = 1 / (1 + (_HIGH_HZ / at_hz) ** 4)
        low = 1 / (1 + (at_hz / _LOW_HZ) ** (2 * _LOW_ORDER))
        left_db = level_db(samples(scene, filters), samples(scene))
        found.append((left_db, float(decibels(high * low))))
    return found


def _mismatch(rng: np.random.Generator) -> Sequence[Measured]:
    unlike = Mismatch(gains=(1.0, float(from_decibels(0.5))), phases_rad=(0.0, 0.2))
    ratio = np.mean(samples(still(_AT_M), unlike)[0, :, 1] / samples(still(_AT_M))[0, :, 1])
    return (float(2 * decibels(abs(ratio))), 0.5), (float(np.angle(ratio)), 0.2)


def _typical(rng: np.random.Generator) -> Sequence[Measured]:
    """Noise in silence, and the image of a strong echo.

    The image without the leakage: what compression makes of both lies where it does, 11 dB lower.
    """
    by = radar(128)
    whole = Typical77Ghz().impairments(by)
    without_leakage = [one for one in whole if not isinstance(one, Leakage)]
    # Chirps are summed: what is not the echo of a target at rest goes down by 21 dB.
    echo = samples(still(_AT_M, rcs_m2=100.0), *without_leakage, by=by, rng=rng).mean(axis=1)
    weights = taper("blackman-harris", N_SAMPLES)
    lines = abs(np.fft.fft(samples(NOTHING, Typical77Ghz(), by=by, rng=rng) * weights)) ** 2
    at_hz = np.arange(N_SAMPLES) * RATE_HZ / N_SAMPLES
    band = (at_hz > 4e6) & (at_hz < 8e6)  # beyond the high-pass
    density = np.mean(lines[..., band]) / (RATE_HZ * np.sum(weights**2))
    return (
        (_over_image_db(echo), _rejection_db(0.45, np.radians(2.0))),
        (dbm(float(density)), dbm(THERMAL_W_PER_HZ)),
    )


MEASUREMENTS = (
    Measurement(
        kind="compression",
        claim="A tone at the compression point loses 1 dB; two have products by the third"
        " intercept, 9.64 dB above it.",
        quantities=(
            Quantity(name="at the compression point", unit="dB", within=0.01),
            Quantity(name="product below two echoes 20 dB weaker", unit="dB", within=0.2),
            Quantity(name="product above them", unit="dB", within=0.2),
        ),
        measure=_compression,
    ),
    Measurement(
        kind="iq-imbalance",
        claim="A mixer with unlike halves makes an image as weak as its errors say.",
        quantities=(
            Quantity(name="echo over image, 0.1 dB and 1 degree", unit="dB", within=0.05),
            Quantity(name="echo over image, 1 dB and 5 degrees", unit="dB", within=0.05),
        ),
        measure=_iq_imbalance,
    ),
    Measurement(
        kind="dc-offset",
        claim="An offset is a constant of its power.",
        quantities=(
            Quantity(name="power of the samples", unit="dBm", within=0.001),
            Quantity(name="power of their mean", unit="dBm", within=0.001),
        ),
        measure=_dc_offset,
    ),
    Measurement(
        kind="if-filter",
        claim="Echoes are weakened as by analog Butterworth filters at their beat frequencies.",
        quantities=(
            Quantity(name="echo at 0.40 MHz, high-pass 0.7 MHz", unit="dB", within=0.05),
            Quantity(name="echo at 2.7 MHz", unit="dB", within=0.02),
            Quantity(name="echo at 8.0 MHz, low-pass 6 MHz", unit="dB", within=0.1),
        ),
        measure=_if_filter,
    ),
    Measurement(
        kind="mismatch",
        claim="A receiver that is unlike scales and turns what it receives.",
        quantities=(
            Quantity(name="gain", unit="dB", within=0.001),
            Quantity(name="phase", unit="rad", within=0.0001),
        ),
        measure=_mismatch,
    ),
    Measurement(
        kind="typical-77ghz",
        claim="Among all else that a typical chip does, its image is that of its data sheet and its"
        " noise that of the noise factor.",
        quantities=(
            Quantity(name="echo over image, without the leakage", unit="dB", within=0.5),
            Quantity(name="noise in 1 Hz, in silence", unit="dBm", within=0.5),
        ),
        measure=_typical,
        n_trials=64,
    ),
)

"""Radar equation and resolution of FMCW signals, on numbers and arrays.

Arguments in SI units, gains, losses and noise factors as ratios (not in dB); arrays of any shape
are broadcast against each other, and numbers give NumPy scalars. Each function raises
`InvalidSetting` that names an argument which is not finite or, unless stated otherwise, not above
0, or whose magnitude is beyond 1e20 or its inverse; noise factors and losses are at least 1.
`Radar` values have the same quantities as properties.

References
----------
M. A. Richards, Fundamentals of Radar Signal Processing, 2nd ed., 2014. A. G. Stove, Linear FMCW
radar techniques, IEE Proc. F 139(5), 1992. H. L. Van Trees, Optimum Array Processing, 2002.
"""

import numpy as np
import scipy
from numpy.typing import ArrayLike

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import (
    broadcast_arguments,
    check_finite_array,
    check_integer,
    check_positive_ratios,
)
from dechirp.core.elementwise import elementwise, scalar_results
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import BOLTZMANN, REFERENCE_TEMPERATURE, SPEED_OF_LIGHT

__all__ = [
    "beat_frequency",
    "max_range",
    "noise_power",
    "range_from_beat",
    "range_resolution",
    "received_power",
    "sample_snr",
    "ula_beamwidth",
    "unambiguous_range",
    "unambiguous_velocity",
    "velocity_resolution",
]

# Far beyond all that is physical; products of the radar equation stay within 1e-230 to 1e260.
_LARGEST = 1e20


@scalar_results
def beat_frequency(
    range_m: ArrayLike,
    *,
    slope_hz_per_s: ArrayLike,
    velocity_m_per_s: ArrayLike = 0.0,
    frequency_hz: ArrayLike = 0.0,
) -> np.ndarray:
    """Return the beat frequency of an echo in Hz, (2 / c) (S R + f v).

    Positive for a rising ramp, whose transmitted signal is mixed with the conjugate of the echo.
    The Doppler term needs the carrier frequency: with a velocity and without `frequency_hz`,
    `InvalidSetting` is raised.

    Parameters
    ----------
    range_m : array_like
        At least 0.
    slope_hz_per_s : array_like
        Slope S of the ramp, of either sign.
    velocity_m_per_s : array_like
        Radial velocity, positive for a receding target.
    frequency_hz : array_like
        Carrier frequency f, at least 0.
    """
    distance, slope, velocity, frequency = broadcast_arguments(
        range_m=check_finite_array("range_m", range_m, at_least=0),
        slope_hz_per_s=check_finite_array("slope_hz_per_s", slope_hz_per_s),
        velocity_m_per_s=check_finite_array("velocity_m_per_s", velocity_m_per_s),
        frequency_hz=check_finite_array("frequency_hz", frequency_hz, at_least=0),
    )
    if np.any((frequency == 0) & (velocity != 0)):
        raise InvalidSetting(
            "frequency_hz",
            value=0,
            expected="the carrier frequency, since velocity_m_per_s is not 0",
            fix="give frequency_hz=77e9, or that of your radar",
        )
    return np.asarray(2 / SPEED_OF_LIGHT * (slope * distance + frequency * velocity))


@scalar_results
def range_from_beat(beat_frequency_hz: ArrayLike, *, slope_hz_per_s: ArrayLike) -> np.ndarray:
    """Return the range of a static target in m, c f / 2 S; beat frequencies of either sign.

    Parameters
    ----------
    beat_frequency_hz : array_like
        Beat frequency f of a static target.
    slope_hz_per_s : array_like
        Slope S of the ramp, above 0.
    """
    beat, slope = broadcast_arguments(
        beat_frequency_hz=check_finite_array(
            "beat_frequency_hz", beat_frequency_hz, largest=_LARGEST
        ),
        slope_hz_per_s=check_finite_array(
            "slope_hz_per_s", slope_hz_per_s, above=0, largest=_LARGEST
        ),
    )
    return np.asarray(SPEED_OF_LIGHT * beat / (2 * slope))


@scalar_results
def received_power(
    range_m: ArrayLike,
    rcs_m2: ArrayLike,
    *,
    transmit_power_w: ArrayLike,
    frequency_hz: ArrayLike,
    tx_gain: ArrayLike = 1.0,
    rx_gain: ArrayLike = 1.0,
    loss: ArrayLike = 1.0,
) -> np.ndarray:
    r"""Return the power of the echo of a point target in W, by the radar equation.

    .. math:: P_r = \frac{P_t G_t G_r \lambda^2 \sigma}{(4\pi)^3 R^4 L}

    Parameters
    ----------
    range_m, rcs_m2 : array_like
        Range and radar cross section of the target.
    transmit_power_w, frequency_hz : array_like
        Power at the transmitting antenna, and carrier frequency.
    tx_gain, rx_gain, loss : array_like
        Antenna gains towards the target, and losses, as ratios; the losses are at least 1.
    """
    distance, rcs, power, frequency, gain_tx, gain_rx, attenuation = _broadcast_positive(
        range_m=range_m,
        rcs_m2=rcs_m2,
        transmit_power_w=transmit_power_w,
        frequency_hz=frequency_hz,
        tx_gain=tx_gain,
        rx_gain=rx_gain,
        loss=loss,
    )
    wavelength = SPEED_OF_LIGHT / frequency
    return np.asarray(
        power
        * gain_tx
        * gain_rx
        * wavelength**2
        * rcs
        / ((4 * np.pi) ** 3 * attenuation * distance**4)
    )


@scalar_results
def noise_power(*, noise_factor: ArrayLike, sample_rate_hz: ArrayLike) -> np.ndarray:
    """Return the thermal noise power in a sample in W, k T0 F fs, with T0 = 290 K.

    Parameters
    ----------
    noise_factor : array_like
        Noise factor F of the receiver, a ratio, at least 1.
    sample_rate_hz : array_like
        Sample rate fs, above 0.
    """
    factor, rate = _broadcast_positive(noise_factor=noise_factor, sample_rate_hz=sample_rate_hz)
    return np.asarray(BOLTZMANN * REFERENCE_TEMPERATURE * factor * rate)


@scalar_results
def sample_snr(
    range_m: ArrayLike,
    rcs_m2: ArrayLike,
    *,
    transmit_power_w: ArrayLike,
    frequency_hz: ArrayLike,
    noise_factor: ArrayLike,
    sample_rate_hz: ArrayLike,
    tx_gain: ArrayLike = 1.0,
    rx_gain: ArrayLike = 1.0,
    loss: ArrayLike = 1.0,
) -> np.ndarray:
    """Return the SNR in one sample, `received_power` over `noise_power`.

    N samples of M chirps give N M times this ratio in a cell of the map, divided by the noise
    bandwidth of each window (`dechirp.windows.noise_bandwidth_bins`).

    Parameters
    ----------
    range_m, rcs_m2 : array_like
        Range and radar cross section of the target.
    transmit_power_w, frequency_hz : array_like
        Power at the transmitting antenna, and carrier frequency.
    noise_factor, sample_rate_hz : array_like
        Noise factor of the receiver, a ratio of at least 1, and rate of complex samples, which is
        the bandwidth of their noise.
    tx_gain, rx_gain, loss : array_like
        Antenna gains towards the target, and losses, as ratios; the losses are at least 1.
    """
    echo, noise = broadcast_arguments(
        **{
            "range_m with rcs_m2": received_power(
                range_m,
                rcs_m2,
                transmit_power_w=transmit_power_w,
                frequency_hz=frequency_hz,
                tx_gain=tx_gain,
                rx_gain=rx_gain,
                loss=loss,
            ),
            "noise_factor with sample_rate_hz": noise_power(
                noise_factor=noise_factor, sample_rate_hz=sample_rate_hz
            ),
        }
    )
    return np.asarray(echo / noise)


@scalar_results
def max_range(
    required_snr: ArrayLike,
    rcs_m2: ArrayLike,
    *,
    transmit_power_w: ArrayLike,
    frequency_hz: ArrayLike,
    noise_factor: ArrayLike,
    sample_rate_hz: ArrayLike,
    integration_gain: ArrayLike = 1.0,
    tx_gain: ArrayLike = 1.0,
    rx_gain: ArrayLike = 1.0,
    loss: ArrayLike = 1.0,
) -> np.ndarray:
    """Return the range in m at which a target has the required SNR after integration.

    The radar equation solved for the range, in free space. Beat frequencies limit the range as
    well, see `unambiguous_range`.

    Parameters
    ----------
    required_snr : array_like
        Ratio after integration; `dechirp.theory.required_snr` gives that of a detection
        probability.
    rcs_m2 : array_like
        Radar cross section of the target.
    transmit_power_w, frequency_hz : array_like
        Power at the transmitting antenna, and carrier frequency.
    noise_factor, sample_rate_hz : array_like
        Noise factor of the receiver, a ratio of at least 1, and rate of complex samples, which is
        the bandwidth of their noise.
    integration_gain : array_like
        Samples times chirps that are integrated coherently, over the noise bandwidths of the
        windows.
    tx_gain, rx_gain, loss : array_like
        Antenna gains towards the target, and losses, as ratios; the losses are at least 1.
    """
    snr = check_finite_array("required_snr", required_snr, above=0, largest=_LARGEST)
    gain = check_finite_array("integration_gain", integration_gain, above=0, largest=_LARGEST)
    snr_at_one_metre = sample_snr(
        1.0,
        rcs_m2,
        transmit_power_w=transmit_power_w,
        frequency_hz=frequency_hz,
        noise_factor=noise_factor,
        sample_rate_hz=sample_rate_hz,
        tx_gain=tx_gain,
        rx_gain=rx_gain,
        loss=loss,
    )
    snr, gain, snr_at_one_metre = broadcast_arguments(
        required_snr=snr,
        integration_gain=gain,
        rcs_m2=snr_at_one_metre,
    )
    return np.asarray((snr_at_one_metre * gain / snr) ** 0.25)


@scalar_results
def range_resolution(bandwidth_hz: ArrayLike) -> np.ndarray:
    """Return the width of a range bin in m, c / 2 B, with the bandwidth of the samples.

    Parameters
    ----------
    bandwidth_hz : array_like
        Bandwidth B that the ramp sweeps while samples are taken, above 0.
    """
    return np.asarray(
        SPEED_OF_LIGHT
        / (2 * check_finite_array("bandwidth_hz", bandwidth_hz, above=0, largest=_LARGEST))
    )


@check_argument_types
@scalar_results
def unambiguous_range(
    *, sample_rate_hz: ArrayLike, slope_hz_per_s: ArrayLike, is_complex: bool = True
) -> np.ndarray:
    """Return the range of the highest beat frequency in m: c fs / 2 S, half of it for real samples.

    Farther echoes are aliased.

    Parameters
    ----------
    sample_rate_hz : array_like
        Sample rate fs, above 0.
    slope_hz_per_s : array_like
        Slope S of the ramp, above 0.
    is_complex : bool
        True for samples with I and Q, False for real ones.
    """
    if not isinstance(is_complex, bool | np.bool_):
        raise InvalidSetting(
            "is_complex",
            value=repr(is_complex),
            expected="True or False",
            fix="give False for real samples, without I and Q",
        )
    rate, slope = _broadcast_positive(sample_rate_hz=sample_rate_hz, slope_hz_per_s=slope_hz_per_s)
    return range_from_beat(rate if is_complex else rate / 2, slope_hz_per_s=slope)


@scalar_results
def velocity_resolution(*, frequency_hz: ArrayLike, duration_s: ArrayLike) -> np.ndarray:
    """Return the width of a velocity bin in m/s, lambda / 2 M T: chirps times their interval.

    Parameters
    ----------
    frequency_hz : array_like
        Carrier frequency, above 0.
    duration_s : array_like
        Duration M T of the frame, above 0.
    """
    frequency, duration = _broadcast_positive(frequency_hz=frequency_hz, duration_s=duration_s)
    return np.asarray(SPEED_OF_LIGHT / frequency / (2 * duration))


@scalar_results
def unambiguous_velocity(*, frequency_hz: ArrayLike, interval_s: ArrayLike) -> np.ndarray:
    """Return the largest unambiguous velocity of either sign in m/s, lambda / 4 T.

    T is the interval between chirps of the same transmitter.

    Parameters
    ----------
    frequency_hz : array_like
        Carrier frequency, above 0.
    interval_s : array_like
        Interval T between chirps of the same transmitter, above 0.
    """
    frequency, interval = _broadcast_positive(frequency_hz=frequency_hz, interval_s=interval_s)
    return np.asarray(SPEED_OF_LIGHT / frequency / (4 * interval))


@elementwise
def ula_beamwidth(
    n_elements: int, *, spacing: ArrayLike = 0.5, angle_rad: ArrayLike = 0.0
) -> np.ndarray:
    r"""Return the half-power width of the beam of a uniform linear array in rad.

    The width between the directions on both sides of the steering angle at which

    .. math:: \left|\frac{\sin(L u)}{L \sin u}\right|^2 = \frac12, \quad
        u = \pi d (\sin\theta - \sin\theta_0)

    0.886 lambda / (L d) for a long array at boresight. A beam whose power stays above one half up
    to +-90 degrees ends there.

    Parameters
    ----------
    n_elements : array of int
        L, at least 2, with equal weights.
    spacing : array
        d, in wavelengths.
    angle_rad : array
        Steering angle from the normal of the array, within pi / 2 of it; broadcast with `spacing`.
    """
    check_integer("n_elements", n_elements, at_least=2)
    distance, angle = broadcast_arguments(
        spacing=check_finite_array("spacing", spacing, above=0, largest=_LARGEST),
        angle_rad=check_finite_array("angle_rad", angle_rad, above=-np.pi / 2, below=np.pi / 2),
    )
    half_power_phase = scipy.optimize.brentq(
        lambda u: np.sin(n_elements * u) / (n_elements * np.sin(u)) - np.sqrt(0.5),
        1e-9 / n_elements,
        np.pi / n_elements,
        xtol=1e-15,
    )
    half_width = half_power_phase / (np.pi * distance)
    sine = np.sin(angle)
    last_angle = np.arcsin(np.minimum(sine + half_width, 1))
    first_angle = np.arcsin(np.maximum(sine - half_width, -1))
    return np.asarray(last_angle - first_angle)


def _broadcast_positive(**arguments: ArrayLike) -> tuple[np.ndarray, ...]:
    """Broadcast arguments, or raise `InvalidSetting` unless all are finite and above 0.

    Passive parts have a noise factor and a loss of at least 1, as those of `Radar` have.
    """
    return broadcast_arguments(
        **{
            name: check_positive_ratios(name, array, at_least=1, at_most=_LARGEST)
            if name in {"noise_factor", "loss"}
            else check_finite_array(name, array, above=0, largest=_LARGEST)
            for name, array in arguments.items()
        }
    )

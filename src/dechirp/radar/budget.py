"""The link budget: powers from the transmitter to the samples, in watts."""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.errors import InvalidSetting
from dechirp.core.units import BOLTZMANN, REFERENCE_TEMPERATURE
from dechirp.core.values import value
from dechirp.radar.radar import Radar


def received_power_w(
    radar: Radar,
    *,
    range_m: ArrayLike,
    rcs_m2: ArrayLike,
    azimuth_rad: ArrayLike | None = None,
    elevation_rad: ArrayLike | None = None,
) -> np.ndarray:
    r"""Echo power of a point target, by the radar equation.

    .. math:: P_r = \frac{P_t G_t G_r \lambda^2 \sigma}{(4\pi)^3 R^4 L}

    Parameters
    ----------
    radar : Radar
        Power, gain, loss and the mid-window wavelength are taken from it.
    range_m : array, m
        Distance to the target; any shape, broadcast with `rcs_m2`.
    rcs_m2 : array, m^2
        Radar cross section, not in dBsm.
    azimuth_rad, elevation_rad : array, rad, optional
        Where the target is seen, for the gains towards it; the peaks of both antennas
        without them.

    Returns
    -------
    array, W
        Power of the echo in one receiver; the broadcast shape.

    Raises
    ------
    InvalidSetting
        If the hardware is not known or a range is not positive.

    Notes
    -----
    Holds in the far field, beyond 2 D^2 / lambda: 0.5 m for a 3 cm array at 77 GHz. Free
    space, at the polarisation of the antennas.

    References
    ----------
    M. A. Richards, Fundamentals of Radar Signal Processing, 2nd ed., 2.2.1.
    """
    range_m = np.asarray(range_m, dtype=float)
    if not np.all(range_m > 0):
        raise InvalidSetting(
            "range_m", got=f"{range_m.min()} m", need="above 0", fix="Move the target away."
        )
    hardware = radar.known_hardware()
    gains = hardware.tx_gain(azimuth_rad, elevation_rad)
    gains = gains * hardware.rx_gain(azimuth_rad, elevation_rad)
    return np.asarray(echo_amplitude(radar) ** 2 * gains * np.asarray(rcs_m2) / range_m**4)


def echo_amplitude(radar: Radar) -> float:
    """Amplitude of an echo between antennas of gain 1, sqrt(W) m.

    Times the lengths of both ways (range squared), over the square root of the RCS: the
    amplitude itself takes the square root of both gains as well.
    """
    hardware = radar.known_hardware()
    spreading = radar.frame.chirp.wavelength_m**2 / (4 * np.pi) ** 3
    return float(np.sqrt(hardware.transmit_power_w * spreading / hardware.loss))


def noise_power_w(radar: Radar) -> float:
    """Thermal noise in one sample, k T0 F fs.

    Complex samples: the noise bandwidth is the sample rate. Real samples: the band is
    half of it, but one mixer folds the noise of the image band onto it, so the power is
    the same (Barton 2005).
    """
    sample_rate_hz = radar.frame.chirp.sample_rate_hz
    noise_factor = radar.known_hardware().noise_factor
    return BOLTZMANN * REFERENCE_TEMPERATURE * noise_factor * sample_rate_hz


def snr(
    radar: Radar,
    *,
    range_m: ArrayLike,
    rcs_m2: ArrayLike,
    azimuth_rad: ArrayLike | None = None,
    elevation_rad: ArrayLike | None = None,
) -> np.ndarray:
    """Signal-to-noise ratio in one sample of one receiver, thermal noise alone."""
    echo_w = received_power_w(
        radar,
        range_m=range_m,
        rcs_m2=rcs_m2,
        azimuth_rad=azimuth_rad,
        elevation_rad=elevation_rad,
    )
    return echo_w / noise_power_w(radar)


@value
class BudgetLine:
    """One line of a link budget: a level that is reached, or a step towards the next."""

    name: str
    kind: Literal["level", "step"]
    level_db: float
    """dBm or dB for a level, dB for a step."""
    unit: Literal["dBm", "dB"]
    formula: str

"""Link budget: powers from the transmitter to the samples, in watts."""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.errors import InvalidSetting
from dechirp.core.units import BOLTZMANN, REFERENCE_TEMPERATURE
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar


def received_power_w(
    radar: Radar,
    *,
    range_m: ArrayLike,
    rcs_m2: ArrayLike,
    azimuth_rad: ArrayLike | None = None,
    elevation_rad: ArrayLike | None = None,
) -> np.ndarray:
    r"""Return the echo power of a point target by the radar equation.

    .. math:: P_r = \frac{P_t G_t G_r \lambda^2 \sigma}{(4\pi)^3 R^4 L}

    Parameters
    ----------
    radar : Radar
        Provides power, gains, loss and the mid-window wavelength.
    range_m : array, m
        Distance to the target; any shape, broadcast with `rcs_m2`.
    rcs_m2 : array, m^2
        Radar cross section, not in dBsm.
    azimuth_rad, elevation_rad : array, rad, optional
        Direction of the target, for the antenna gains towards it; the peak gains of both
        antennas by default.

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
            "range_m", value=f"{range_m.min()} m", expected="above 0", fix="move the target away"
        )
    hardware = radar.require_hardware()
    gains = hardware.tx_gain(azimuth_rad, elevation_rad)
    gains = gains * hardware.rx_gain(azimuth_rad, elevation_rad)
    return np.asarray(unit_echo_amplitude(radar) ** 2 * gains * np.asarray(rcs_m2) / range_m**4)


def unit_echo_amplitude(radar: Radar) -> float:
    """Return the amplitude of an echo between antennas of gain 1, in sqrt(W) m.

    Divide by the product of both path lengths (range squared) and multiply by the square roots of
    RCS and gains to get the amplitude of an echo.
    """
    hardware = radar.require_hardware()
    spreading = radar.frame.chirp.wavelength_m**2 / (4 * np.pi) ** 3
    return float(np.sqrt(hardware.transmit_power_w * spreading / hardware.loss))


def noise_power_w(radar: Radar) -> float:
    """Return the thermal noise power in one sample, k T0 F fs.

    The noise bandwidth of complex samples is the sample rate. That of real samples is half of it,
    but a single mixer also converts the noise of the image band, so the power is the same (Barton
    2005).
    """
    sample_rate_hz = radar.frame.chirp.sample_rate_hz
    noise_factor = radar.require_hardware().noise_factor
    return BOLTZMANN * REFERENCE_TEMPERATURE * noise_factor * sample_rate_hz


def sample_snr(
    radar: Radar,
    *,
    range_m: ArrayLike,
    rcs_m2: ArrayLike,
    azimuth_rad: ArrayLike | None = None,
    elevation_rad: ArrayLike | None = None,
) -> np.ndarray:
    """Return the signal-to-noise ratio in one sample of one receiver, with thermal noise only."""
    echo_w = received_power_w(
        radar,
        range_m=range_m,
        rcs_m2=rcs_m2,
        azimuth_rad=azimuth_rad,
        elevation_rad=elevation_rad,
    )
    return echo_w / noise_power_w(radar)


@frozen_dataclass
class BudgetLine:
    """A line of a link budget: a power level, or the gain or loss between two levels."""

    name: str
    kind: Literal["level", "step"]
    level_db: float
    """Level in dBm or dB, or step in dB."""
    unit: Literal["dBm", "dB"]
    formula: str

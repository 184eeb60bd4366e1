"""A VCO with a curved tuning characteristic in a phase-locked loop that sweeps it."""

from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

from dechirp.core.checks import listed, positive, series
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.echoes.impairments.frequency_error import FrequencyError
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene


@value
class Pll(FrequencyError):
    r"""What a second-order loop of type 2 leaves of the errors of a swept VCO.

    An error of the frequency, of whatever cause, comes out of the loop through its error
    transfer function

    .. math:: E(s) = \frac{s^2}{s^2 + 2 \zeta \omega_n s + \omega_n^2}.

    Three causes go in: the tuning curve, as the voltage rises evenly over the ramp; the ramp
    that the reference begins and ends, which a type-2 loop follows with a lag of phase, not of
    frequency, once it has settled; and the jump of the reference back to the start frequency at
    the end of the ramp. The time from there to the next ramp, and from its start to the first
    sample, is what the loop has to settle. Chirps are taken to have gone on before the first.

    Linear: the gain of the loop is the same over the ramp, and neither charge pump nor VCO
    saturates in the jump.

    References
    ----------
    F. M. Gardner, Phaselock Techniques, 3rd ed., 2005, chapters 2 and 5.
    D. Banerjee, PLL Performance, Simulation and Design, 5th ed., 2017.
    """

    # Jump and pause are those of equal ramps at equal intervals.
    ramps = "even"
    natural_frequency_hz: float
    """Of the loop, omega_n / 2 pi; open, its gain is 1 at about 2 zeta times that."""
    damping: float = 0.7071
    """Of the loop, zeta."""
    gain_change: tuple[float, ...] = ()
    """Gain of the VCO over that at the start of the ramp, 1 + c_1 u + c_2 u^2 ..., by its
    coefficients c_1, c_2 ...; u is the tuning voltage, 0 at the start and 1 at the end."""

    def __post_init__(self) -> None:
        positive(self, "natural_frequency_hz", at_least=1e-3, at_most=1e12)
        positive(self, "damping", at_least=0.05, at_most=20.0)
        given = listed(self.gain_change)
        if given is None or len(given) > 8:
            raise InvalidSetting(
                "Pll.gain_change",
                got=self.gain_change,
                need="a list of at most 8 ratios, of the powers 1, 2 ... of the tuning voltage",
                fix="Write [-0.3] for a gain that falls by 30 % over the ramp.",
            )
        made = series("Pll.gain_change", given, at_least=-1e3, at_most=1e3)
        object.__setattr__(self, "gain_change", made)
        gains = Polynomial([1.0, *self.gain_change])(np.linspace(0.0, 1.0, 1001))
        if gains.min() <= 0:
            raise InvalidSetting(
                "Pll.gain_change",
                got=f"{list(self.gain_change)}, with which the gain falls to 0 within the ramp",
                need="a gain above 0 from the start of the ramp to its end",
                fix="Give smaller coefficients: -0.3 is a loss of 30 % at the end.",
            )

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise for a loop that is slower than the ramp, warn of one that has not settled."""
        ramp_s = radar.frame.chirp.ramp_duration_s
        slowest_hz = 1 / (2 * np.pi * ramp_s)
        if self.natural_frequency_hz < slowest_hz:
            raise InvalidSetting(
                "natural_frequency",
                got=f"{self.natural_frequency_hz:.6g} Hz",
                need=f"at least {slowest_hz:.6g} Hz: a slower loop does not follow a ramp of"
                f" {ramp_s * 1e6:.6g} us",
                fix="Give a faster loop; 100 kHz to 1 MHz are usual.",
            )
        super().check(scene, radar)

    def frequency_hz(self, times_s: np.ndarray, radar: Radar) -> np.ndarray:
        """What the loop leaves: a part that goes with the tuning curve, and one that decays."""
        loop = _settled(self, radar)
        swept, _ = loop.decaying(times_s)
        return loop.curve(times_s) + swept

    def cycles(self, times_s: np.ndarray, radar: Radar) -> np.ndarray:
        """Its integral; of what decays by the differential equation that it solves."""
        loop = _settled(self, radar)
        frequency, rate = loop.decaying(times_s)
        first, first_rate = loop.begin
        gone = first_rate - rate + 2 * loop.damping_per_s * (first - frequency)
        return loop.curve.integ()(times_s) + gone / loop.natural_rad_per_s**2


class _Loop(NamedTuple):
    """The frequency error y over a ramp: y'' + 2 a y' + w^2 y is that of the tuning curve, ''."""

    curve: Polynomial
    """Of time: the solution that is a polynomial, Hz."""
    begin: np.ndarray
    """(2,): what is left for the solution that decays, and its rate, at the start."""
    damping_per_s: float
    natural_rad_per_s: float

    def decaying(self, times_s: np.ndarray) -> np.ndarray:
        """The solution that decays, and its rate, (2, n_times)."""
        over = _over(times_s, self.damping_per_s, self.natural_rad_per_s)
        return np.einsum("ij...,j->i...", over, self.begin)


def _settled(pll: Pll, radar: Radar) -> _Loop:
    """The loop as it is in every chirp, when chirps have gone on for long."""
    frame, chirp = radar.frame, radar.frame.chirp
    ramp_s, slope = chirp.ramp_duration_s, chirp.slope_hz_per_s
    natural = 2 * np.pi * pll.natural_frequency_hz
    damping = pll.damping * natural
    curve_hz = _curve_hz(pll.gain_change, chirp.ramp_bandwidth_hz, ramp_s)
    left = _followed(curve_hz, damping, natural)
    rates = curve_hz.deriv()
    # The curve's kinks and those of the reference, which is subtracted; the jump by the ramp.
    kinks = np.array([0.0, rates(0.0) - slope])
    jump_hz = chirp.ramp_bandwidth_hz
    back = np.array([jump_hz, slope - rates(ramp_s) - 2 * damping * jump_hz])
    first, last = (np.array([left(t), left.deriv()(t)]) for t in (0.0, ramp_s))
    ramp, pause = (
        _over(np.array(t), damping, natural) for t in (ramp_s, frame.only_interval_s - ramp_s)
    )
    # After a ramp and a pause the state is the same again.
    begin = np.linalg.solve(np.eye(2) - pause @ ramp, pause @ (last - ramp @ first + back) + kinks)
    return _Loop(left, begin - first, damping, natural)


def _curve_hz(gain_change: tuple[float, ...], bandwidth_hz: float, ramp_s: float) -> Polynomial:
    """Frequency of the VCO alone less that of the ramp, as its voltage rises evenly."""
    tuned = Polynomial([1.0, *gain_change]).integ()
    even = Polynomial([0.0, 1 / ramp_s])
    return bandwidth_hz * (tuned(even) / tuned(1.0) - even)


def _followed(curve_hz: Polynomial, damping: float, natural: float) -> Polynomial:
    """The polynomial y for which y'' + 2 a y' + w^2 y = curve''."""
    wanted = curve_hz.deriv(2).coef
    found = np.zeros(len(wanted) + 2)
    for k in range(len(wanted) - 1, -1, -1):
        above = 2 * damping * (k + 1) * found[k + 1] + (k + 1) * (k + 2) * found[k + 2]
        found[k] = (wanted[k] - above) / natural**2
    return Polynomial(found[: len(wanted)])


def _over(times_s: np.ndarray, damping: float, natural: float) -> np.ndarray:
    """What times do to a state (y, y') that decays, (2, 2, ...)."""
    root = np.sqrt(complex(damping**2 - natural**2))
    slow, fast = np.exp((root - damping) * times_s), np.exp((-root - damping) * times_s)
    # At critical damping both are one, and the quotient is its limit.
    near = abs(root) < 1e-6 * natural
    over_root = times_s * slow if near else ((slow - fast) / (2 * root))
    even, odd = ((slow + fast) / 2).real, over_root.real
    return np.array([[even + damping * odd, odd], [-(natural**2) * odd, even - damping * odd]])

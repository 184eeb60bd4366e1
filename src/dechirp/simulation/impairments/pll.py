"""Phase-locked loop that sweeps a VCO with a curved tuning characteristic."""

from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

from dechirp.core.checks import as_tuple_or_none, check_numbers, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.text import format_si
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.impairments.frequency_error import FrequencyError


@frozen_dataclass
class Pll(FrequencyError):
    r"""Residual frequency error of a swept VCO in a second-order type-2 loop.

    The loop filters an error of the frequency, whatever its cause, by its error transfer function

    .. math:: E(s) = \frac{s^2}{s^2 + 2 \zeta \omega_n s + \omega_n^2}.

    Three causes act: the tuning curve, as the voltage rises linearly over the ramp; the start and
    end
    of the reference ramp, which a settled type-2 loop follows with a lag of phase, not of
    frequency;
    and the jump of the reference back to the start frequency at the end of the ramp. The loop
    settles
    from there to the next ramp, and from its start to the first sample. Chirps are assumed to have
    run
    for long before the first one.

    The model is linear: the gain of the loop is constant over the ramp, and neither charge pump nor
    VCO saturates in the jump.

    References
    ----------
    F. M. Gardner, Phaselock Techniques, 3rd ed., 2005, chapters 2 and 5.
    D. Banerjee, PLL Performance, Simulation and Design, 5th ed., 2017.
    """

    # The solution assumes equal ramps at equal intervals.
    supported_ramps = "even"
    natural_frequency_hz: float
    """Natural frequency of the loop, omega_n / 2 pi; its open-loop gain is 1 at about 2 zeta
    times that."""
    damping: float = 0.7071
    """Damping ratio of the loop, zeta."""
    gain_change: tuple[float, ...] = ()
    """Gain of the VCO relative to the start of the ramp, 1 + c_1 u + c_2 u^2 ..., as its
    coefficients c_1, c_2 ...; u is the tuning voltage, 0 at the start and 1 at the end."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "natural_frequency_hz", at_least=1e-3, at_most=1e12)
        check_positive_fields(self, "damping", at_least=0.05, at_most=20.0)
        coefficients = as_tuple_or_none(self.gain_change)
        if coefficients is None or len(coefficients) > 8:
            raise InvalidSetting(
                "Pll.gain_change",
                value=self.gain_change,
                expected="a list of at most 8 ratios, for powers 1, 2 ... of the tuning voltage",
                fix="write [-0.3] for a gain that falls by 30 % over the ramp",
            )
        gain_change = check_numbers("Pll.gain_change", coefficients, at_least=-1e3, at_most=1e3)
        object.__setattr__(self, "gain_change", gain_change)
        gains = Polynomial([1.0, *self.gain_change])(np.linspace(0.0, 1.0, 1001))
        if gains.min() <= 0:
            raise InvalidSetting(
                "Pll.gain_change",
                value=f"{list(self.gain_change)}, with which the gain falls to 0 within the ramp",
                expected="a gain above 0 over the whole ramp",
                fix="give smaller coefficients, for example -0.3 for a loss of 30 % at the end",
            )

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise for a loop slower than the ramp; warn about one that has not settled."""
        ramp_s = radar.frame.chirp.ramp_duration_s
        slowest_hz = 1 / (2 * np.pi * ramp_s)
        if self.natural_frequency_hz < slowest_hz:
            raise InvalidSetting(
                "natural_frequency",
                value=format_si(self.natural_frequency_hz, "hz"),
                expected=f"at least {format_si(slowest_hz, 'hz')}: a slower loop does not follow"
                " a ramp of"
                f" {ramp_s * 1e6:.6g} us",
                fix="choose a faster loop, usually 100 kHz to 1 MHz",
            )
        super().check(scene, radar)

    def frequency_error_hz(self, times_s: np.ndarray, radar: Radar) -> np.ndarray:
        """Return the forced response to the tuning curve plus the transient."""
        loop = _solve_periodic_loop_state(self, radar)
        transient, _ = loop.transient_and_rate(times_s)
        return loop.forced_response(times_s) + transient

    def phase_error_cycles(self, times_s: np.ndarray, radar: Radar) -> np.ndarray:
        """Return its integral; that of the transient follows from its differential equation."""
        loop = _solve_periodic_loop_state(self, radar)
        frequency, rate = loop.transient_and_rate(times_s)
        first, first_rate = loop.initial_transient
        transient_change = first_rate - rate + 2 * loop.damping_per_s * (first - frequency)
        return loop.forced_response.integ()(times_s) + transient_change / loop.natural_rad_per_s**2


class _SettledLoop(NamedTuple):
    """Frequency error y over a ramp: y'' + 2 a y' + w^2 y is the tuning error''."""

    forced_response: Polynomial
    """Polynomial solution over time, Hz."""
    initial_transient: np.ndarray
    """(2,): transient and its rate at the start of the ramp."""
    damping_per_s: float
    natural_rad_per_s: float

    def transient_and_rate(self, times_s: np.ndarray) -> np.ndarray:
        """Return the transient and its rate, (2, n_times)."""
        transition = _transient_transition_matrix(
            times_s, self.damping_per_s, self.natural_rad_per_s
        )
        return np.einsum("ij...,j->i...", transition, self.initial_transient)


def _solve_periodic_loop_state(pll: Pll, radar: Radar) -> _SettledLoop:
    """Solve for the loop state that repeats in every chirp."""
    frame, chirp = radar.frame, radar.frame.chirp
    ramp_s, slope = chirp.ramp_duration_s, chirp.slope_hz_per_s
    natural_rad_per_s = 2 * np.pi * pll.natural_frequency_hz
    damping = pll.damping * natural_rad_per_s
    curve_hz = _tuning_error_polynomial_hz(pll.gain_change, chirp.ramp_bandwidth_hz, ramp_s)
    response = _forced_response_polynomial(curve_hz, damping, natural_rad_per_s)
    rates = curve_hz.deriv()
    # Kinks of the tuning error minus those of the reference, and the jump back by the ramp
    # bandwidth.
    kinks = np.array([0.0, rates(0.0) - slope])
    jump_hz = chirp.ramp_bandwidth_hz
    return_jump = np.array([jump_hz, slope - rates(ramp_s) - 2 * damping * jump_hz])
    first, last = (np.array([response(t), response.deriv()(t)]) for t in (0.0, ramp_s))
    ramp, pause = (
        _transient_transition_matrix(np.array(t), damping, natural_rad_per_s)
        for t in (ramp_s, frame.single_interval_s - ramp_s)
    )
    # Periodicity: the state is the same again after a ramp and a pause.
    initial_state = np.linalg.solve(
        np.eye(2) - pause @ ramp, pause @ (last - ramp @ first + return_jump) + kinks
    )
    return _SettledLoop(response, initial_state - first, damping, natural_rad_per_s)


def _tuning_error_polynomial_hz(
    gain_change: tuple[float, ...], bandwidth_hz: float, ramp_s: float
) -> Polynomial:
    """Return the frequency of the free VCO minus that of the ramp, for a linear voltage."""
    tuning_integral = Polynomial([1.0, *gain_change]).integ()
    linear_time = Polynomial([0.0, 1 / ramp_s])
    return bandwidth_hz * (tuning_integral(linear_time) / tuning_integral(1.0) - linear_time)


def _forced_response_polynomial(
    tuning_error_hz: Polynomial, damping: float, natural_frequency: float
) -> Polynomial:
    """Return the polynomial y with y'' + 2 a y' + w^2 y = curve''."""
    excitation = tuning_error_hz.deriv(2).coef
    coefficients = np.zeros(len(excitation) + 2)
    for k in range(len(excitation) - 1, -1, -1):
        higher_terms = (
            2 * damping * (k + 1) * coefficients[k + 1] + (k + 1) * (k + 2) * coefficients[k + 2]
        )
        coefficients[k] = (excitation[k] - higher_terms) / natural_frequency**2
    return Polynomial(coefficients[: len(excitation)])


def _transient_transition_matrix(
    times_s: np.ndarray, damping: float, natural_frequency: float
) -> np.ndarray:
    """Return the transition matrix of the transient (y, y') over given times, (2, 2, ...)."""
    root = np.sqrt(complex(damping**2 - natural_frequency**2))
    slow, fast = np.exp((root - damping) * times_s), np.exp((-root - damping) * times_s)
    # At critical damping both exponentials are equal, and the quotient is its limit.
    is_critical = abs(root) < 1e-6 * natural_frequency
    odd_part = times_s * slow if is_critical else ((slow - fast) / (2 * root))
    even, odd = ((slow + fast) / 2).real, odd_part.real
    return np.array(
        [[even + damping * odd, odd], [-(natural_frequency**2) * odd, even - damping * odd]]
    )

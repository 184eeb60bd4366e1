r"""Rate of a periodic movement at any sampling times, with its significance.

Each component y of a movement, such as a displacement or I and Q, is described over times t by

.. math:: y(t) = \sum_j b_j q_j(t) + \sum_{k=1}^{K} \left(A_k \cos 2\pi k f t + B_k \sin 2\pi k f t
    \right) + w(t)

with known slow functions q. The energy E(f) that the K harmonics take from the remainder of the q
is the periodogram generalised to uneven times, a trend, and any shape of the period. The noise w
has a power of f^-a between the lowest rate and K times the highest one, white for a = 0; energies
are weighted with f^a. Its variance s^2 for each degree of freedom is the mean of the weighted
periodogram there, without the harmonics: slower and faster movements have no effect. By chance,
z = E / (2 s^2) of C components has at one frequency the distribution of m C times a beta-prime
variable with shapes K C and m C, m the number of lines left in the band. The highest of the band
exceeds z with the probability

.. math:: p \le Q(z) + B \sqrt{4\pi \operatorname{var}(t)\, \overline{k^2}}\, \sqrt{z}
    \left(1 + \frac{z}{m C}\right) q(z)

with the tail Q and the density q of z, and the width B of the band (Rice's rate of crossings;
Davies 1987, Baluev 2008). The number of harmonics is the one of the least p, which is multiplied
by the number of choices. A part 1/n of a rate has its harmonics, too: where the multiple of a
frequency is significant, it is the rate if its harmonics have 80 % of the energy; the double also
unless the odd harmonics lower p by a factor of 100.
The exponent a is fitted to the logarithms of some tens of energies, so
its error tilts the noise by a factor of up to two at the ends of the band: p is the mean over the
normal distribution of a about its estimate (as Vaughan 2005).

The rate is the least-squares solution of all parameters together. Its standard error attains the
Cramer-Rao bound for white noise, of one sinusoid of amplitude A at N even times T apart

.. math:: \sigma_f^2 = \frac{24 s^2}{(2\pi)^2 A^2 T^2 N (N^2 - 1)}

Periods of a living body are unequal. With independent errors of the periods, the phase in cycles is
a random walk, of variance D t. Least squares weigh the rate in a duration T by a parabola, 6 t (T -
t) / T^3, so the fitted rate differs from the mean rate, cycles over duration, by the variance

.. math:: \sigma_u^2 = \frac{D}{T} \left(\frac{6}{5} - 1\right) = \frac{R}{5 S T^2}, \qquad
    S = \sum_{j=2}^{n-1} \frac{1}{(\pi j)^2}

which is added to that of the noise. R is the mean square of the phase in cycles about a line, over
the order for harmonics, and the mean over them with the weights of their information, power times
squared order. Its expectation is D T S, with the power of a random walk in the cosines j of the n
slow functions that describe the phase. R has (sum l)^2 / sum l^2 degrees of freedom for the terms l
of S. The noise in R is not subtracted: intervals are rather too wide in noise.

Sidebands of a heart end at the nearest harmonic of breathing, without its resolution cell. Those
beyond are hidden in part: with them, the interval of a steady heart was 16 to 260 times that of the
Cramer-Rao bound. Two or three functions j are left. Noise of variance v in each phase adds about
(pi j)^2 v / (5 T^2) to the variance of the rate, where the bound is 12 v / T^2.

References
----------
D. C. Rife and R. R. Boorstyn, Single-tone parameter estimation from discrete-time observations,
IEEE Trans. IT 20(5), 1974 (complex tones; twice the noise for real ones). R. B. Davies, Hypothesis
testing when a nuisance parameter is present only under the alternative, Biometrika 74(1), 1987.
R. V. Baluev, Assessing the statistical significance of periodogram peaks, MNRAS 385, 2008.
S. Vaughan, A simple test for periodic signals in red noise, Astronomy and Astrophysics 431, 2005.
S. K. Banerjee, On confidence interval for two-means problem based on separate estimates of
variances and tabulated values of t-table, Sankhya A 23, 1961. J. Geweke and S. Porter-Hudak, The
estimation and application of long memory time series models, Journal of Time Series Analysis 4(4),
1983 (the exponent a). E. Rubiola, M. Lenczner, P.-Y. Bourgeois and F. Vernotte, The Omega counter,
a frequency counter based on the linear regression, IEEE Trans. UFFC 63(7), 2016 (the parabola, and
white noise of the frequency).
"""

import math
from dataclasses import replace

import numpy as np
import scipy

from dechirp.core.values import frozen_dataclass

_GRID_OVERSAMPLING = 3  # per 1/T and harmonic: Gauss-Newton converges from a sixth of a peak
_MAX_ITERATIONS = 20
_N_SLOPES = 200  # the tails decide: the outermost lies 2.8 standard errors out
# Least energy of the fundamental over that of the second harmonic: half of a rate has less.
_MIN_FUNDAMENTAL = 0.5
# Unequal periods give half of a rate odd harmonics: in recorded breathing, chance became up to 30
# times less probable by them. The double is a rate by itself at a probability of one in a hundred.
_MAX_PROBABILITY_OF_MULTIPLE = 1e-2
_MIN_GAIN_OF_HALF = 100.0
# Share of the energy of all harmonics: breaths that differ by a fifth leave a part of the rate
# 0.9 and more. A rotation by large angles, whose harmonics are Bessel functions, has up to 0.6.
_MIN_SHARE = 0.8


@frozen_dataclass
class NoiseSlope:
    """Exponent a of a noise power f^-a, fitted to energies."""

    exponent: float = 0.0
    std: float = 0.0

    def quantiles(self) -> np.ndarray:
        """Return exponents of equal probability, by the normal distribution."""
        if self.std == 0:
            return np.array([self.exponent])
        centres = (np.arange(_N_SLOPES) + 0.5) / _N_SLOPES
        return np.asarray(self.exponent + self.std * scipy.special.ndtri(centres))


_WHITE = NoiseSlope()


@frozen_dataclass
class Line:
    """Strongest periodic part of a movement within a band."""

    frequency_hz: float
    noise_std_hz: float
    """Standard error of the mean rate by noise."""
    n_noise_degrees: float
    """Degrees of freedom of its estimate."""
    amplitude: float
    """Of the fundamental, of all components together."""
    harmonic_energies: tuple[float, ...]
    """Of the fundamental and its multiples."""
    false_alarm_probability: float
    """Probability that noise alone has a line of this significance somewhere in the band."""
    irregularity_std_hz: float = 0.0
    """Standard error of the mean rate by unequal periods."""
    n_irregularity_degrees: float = 1.0
    """Degrees of freedom of its estimate."""

    @property
    def frequency_std_hz(self) -> float:
        """Standard error of the mean rate, by noise and unequal periods."""
        return math.hypot(self.noise_std_hz, self.irregularity_std_hz)

    @property
    def n_harmonics(self) -> int:
        """Number of harmonics, with the fundamental."""
        return len(self.harmonic_energies)


def slow_functions(times_s: np.ndarray, below_hz: float) -> np.ndarray:
    """Return an orthonormal basis of trends, (time, function): cosines up to a frequency."""
    from_start_s = times_s - times_s[0]
    n_functions = 1 + math.floor(2 * from_start_s[-1] * below_hz)
    phase = np.pi / from_start_s[-1] * np.outer(from_start_s, np.arange(n_functions))
    return np.linalg.qr(np.cos(phase))[0]


def sinusoids(times_s: np.ndarray, frequencies_hz: np.ndarray) -> np.ndarray:
    """Return the columns cos of all frequencies, then sin, (time, 2 frequency)."""
    phase = 2 * np.pi * np.outer(times_s, frequencies_hz)
    return np.concatenate([np.cos(phase), np.sin(phase)], axis=1)


def join_bases(*bases: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis of all columns together."""
    return np.linalg.qr(np.concatenate(bases, axis=1))[0]


def find_line(
    movement: np.ndarray,
    times_s: np.ndarray,
    band_hz: tuple[float, float],
    *,
    basis: np.ndarray,
    max_harmonics: int = 1,
    noise_slope: NoiseSlope = _WHITE,
    excluded_hz: tuple[tuple[float, float], ...] = (),
) -> Line | None:
    """Find the strongest line of a band; None if too little of the band is left to judge it.

    Parameters
    ----------
    movement : array (time, component)
    times_s : array (time,)
        With a mean of 0.
    band_hz : (float, float)
        Lowest and highest frequency of the fundamental.
    basis : array (time, function)
        Orthonormal columns that are no part of the line.
    max_harmonics : int
        Largest number of harmonics, with the fundamental.
    noise_slope : NoiseSlope
        Exponent of the power law of the noise, see `fit_noise_slope`.
    excluded_hz : tuple of intervals
        Neither searched nor used as noise.
    """
    remainder = movement - basis @ (basis.T @ movement)
    duration_s = float(np.ptp(times_s)) * len(times_s) / (len(times_s) - 1)
    step_hz = 1 / (duration_s * _GRID_OVERSAMPLING * max_harmonics)
    first, last = math.ceil(band_hz[0] / step_hz), math.floor(band_hz[1] / step_hz)
    fundamentals = np.arange(first, last + 1)
    is_searched = ~_is_inside(fundamentals * step_hz, excluded_hz)
    searched_hz = float(is_searched.sum()) * step_hz
    # Energies at multiples of the step that are a fundamental or a harmonic.
    orders = np.arange(1, max(max_harmonics, 2) + 1)
    rows = np.unique(np.outer(orders, fundamentals))
    energy_of_row = np.zeros(rows[-1] + 1)
    energy_of_row[rows] = _line_energies(remainder, times_s, rows * step_hz, basis)
    if max_harmonics > 1:
        second = energy_of_row[2 * fundamentals]
        is_searched &= energy_of_row[fundamentals] >= _MIN_FUNDAMENTAL * second
    if not is_searched.any():
        return None

    def judge_line(start_hz: float, n_harmonics: int) -> Line | None:
        return _judge_line(
            remainder,
            times_s,
            start_hz,
            band_hz,
            basis,
            n_harmonics,
            noise_slope,
            excluded_hz,
            searched_hz=searched_hz,
            n_choices=max_harmonics,
        )

    lines = []
    energies = np.zeros(len(fundamentals))
    for n_harmonics in range(1, max_harmonics + 1):
        harmonics = n_harmonics * fundamentals
        energies += energy_of_row[harmonics] * (harmonics * step_hz) ** noise_slope.exponent
        peak = int(np.argmax(np.where(is_searched, energies, -1.0)))
        lines.append(judge_line(float(fundamentals[peak] * step_hz), n_harmonics))
    line = _most_significant_line(lines)
    if line is None:
        return None
    if line.false_alarm_probability <= _MAX_PROBABILITY_OF_MULTIPLE:
        for order in _orders_of_possible_rates(line):
            multiple_hz = order * line.frequency_hz
            multiple = _most_significant_line(
                [
                    judge_line(multiple_hz, n_harmonics)
                    for n_harmonics in range(1, max_harmonics + 1)
                ]
            )
            if multiple is not None and _is_rate(multiple, order, line):
                # Noise alone has neither; the other harmonics are noise to the multiple only.
                probability = min(line.false_alarm_probability, multiple.false_alarm_probability)
                line = replace(multiple, false_alarm_probability=probability)
                break
    irregular_hz2, n_irregular = _rate_variance_of_irregularity(
        remainder, times_s, line.frequency_hz, line.n_harmonics, basis, excluded_hz
    )
    return replace(
        line,
        irregularity_std_hz=math.sqrt(irregular_hz2),
        n_irregularity_degrees=n_irregular,
    )


def find_fundamental(
    line: Line,
    movement: np.ndarray,
    times_s: np.ndarray,
    band_hz: tuple[float, float],
    *,
    basis: np.ndarray,
    noise_slope: NoiseSlope,
    excluded_hz: tuple[tuple[float, float], ...],
    false_alarm_probability: float,
) -> Line | None:
    """Return the line of which a single line is the second or third harmonic; the line if none.

    Short pulses, such as those of a heart, may have harmonics as strong as the fundamental. A
    half or third of the frequency is the fundamental if it has a line of its own: the line is no
    harmonic of a movement without odd harmonics. None if it is excluded, so that it cannot be
    judged.

    Parameters
    ----------
    line : Line
        From `find_line`, without harmonics; the other parameters are as there.
    false_alarm_probability : float
        Largest probability that noise alone has a line within a resolution cell of the part.
    """
    duration_s = float(np.ptp(times_s)) * len(times_s) / (len(times_s) - 1)
    with_line = join_bases(basis, sinusoids(times_s, np.array([line.frequency_hz])))
    remainder = movement - with_line @ (with_line.T @ movement)
    around_line = line.frequency_hz - 0.5 / duration_s, line.frequency_hz + 0.5 / duration_s
    fundamentals: list[Line | None] = []
    for order in (2, 3):
        part_hz = line.frequency_hz / order
        if part_hz < band_hz[0]:
            continue
        if _is_inside(np.array([part_hz]), excluded_hz)[0]:
            return None
        fundamental = _judge_line(
            remainder,
            times_s,
            part_hz,
            band_hz,
            with_line,
            1,
            noise_slope,
            (*excluded_hz, around_line),
            searched_hz=1 / duration_s,
            n_choices=1,
        )
        if fundamental is not None and abs(fundamental.frequency_hz - part_hz) < 0.5 / duration_s:
            fundamentals.append(fundamental)
    fundamental = _most_significant_line(fundamentals)
    if fundamental is None or fundamental.false_alarm_probability > false_alarm_probability:
        return line
    irregular_hz2, n_irregular = _rate_variance_of_irregularity(
        remainder, times_s, fundamental.frequency_hz, 1, basis, excluded_hz
    )
    # Noise alone has neither line.
    return replace(
        fundamental,
        false_alarm_probability=line.false_alarm_probability,
        irregularity_std_hz=math.sqrt(irregular_hz2),
        n_irregularity_degrees=n_irregular,
    )


def _most_significant_line(lines: list[Line | None]) -> Line | None:
    judged = [line for line in lines if line is not None]
    return min(judged, key=lambda line: line.false_alarm_probability, default=None)


def _orders_of_possible_rates(part: Line) -> list[int]:
    """Return the orders of the harmonics that may be the rate, the highest first."""
    orders = range(part.n_harmonics, 1, -1)
    return [
        order for order in orders if order == 2 or _share_of_multiples(part, order) >= _MIN_SHARE
    ]


def _share_of_multiples(line: Line, order: int) -> float:
    """Return the share of the energy in the harmonics whose order a number divides."""
    return sum(line.harmonic_energies[order - 1 :: order]) / sum(line.harmonic_energies)


def _is_rate(multiple: Line, order: int, part: Line) -> bool:
    """Return whether the multiple of a frequency is the rate, and its other harmonics are not.

    The harmonics of the multiple are those of the part with orders that it divides. Both stand out,
    since the other ones are noise to the multiple.
    """
    probability = multiple.false_alarm_probability
    return probability <= _MAX_PROBABILITY_OF_MULTIPLE and (
        _share_of_multiples(part, order) >= _MIN_SHARE
        or probability < _MIN_GAIN_OF_HALF * part.false_alarm_probability
    )


def fit_noise_slope(
    movement: np.ndarray,
    times_s: np.ndarray,
    band_hz: tuple[float, float],
    basis: np.ndarray,
    *,
    excluded_hz: tuple[tuple[float, float], ...] = (),
) -> NoiseSlope:
    """Fit the exponent a of a noise power that falls as f^-a over a band, from -2 to 2.

    The slope of the logarithm of the periodogram, which few lines do not change (Geweke and
    Porter-Hudak, 1983): 0 for white noise, 2 for a random walk.
    """
    duration_s = float(np.ptp(times_s)) * len(times_s) / (len(times_s) - 1)
    bins_hz = np.arange(math.ceil(band_hz[0] * duration_s), band_hz[1] * duration_s) / duration_s
    bins_hz = bins_hz[~_is_inside(bins_hz, excluded_hz)]
    energies = _line_energies(movement, times_s, bins_hz, basis)
    if len(bins_hz) < 8 or not (energies > 0).all():
        return _WHITE
    abscissa, logarithms = np.log(bins_hz), np.log(energies)
    line = np.polyfit(abscissa, logarithms, 1)
    # The logarithm of the energy of C components has the variance psi'(C). Noise that is no power
    # law has more; the median of the deviations ignores lines.
    deviations = np.abs(logarithms - np.polyval(line, abscissa))
    variance = max(
        float(scipy.special.polygamma(1, movement.shape[1])),
        float(np.median(deviations) / scipy.special.ndtri(0.75)) ** 2,
    )
    variance /= len(bins_hz) * float(np.var(abscissa))
    return NoiseSlope(exponent=float(np.clip(-line[0], -2.0, 2.0)), std=math.sqrt(variance))


def rate_interval_hz(line: Line, confidence: float) -> tuple[float, float]:
    """Return the confidence interval of the frequency of a line, of at least that confidence.

    Squares of the half widths by noise and by unequal periods add up, each with the quantile of its
    own degrees of freedom (Banerjee, 1961). With those of the sum (Welch and Satterthwaite), 95 %
    intervals of irregular hearts contained 88 %: one or two degrees of freedom are often far too
    small by chance.
    """
    half_hz = math.hypot(
        *(
            std_hz * float(scipy.stats.t.ppf((1 + confidence) / 2, n_degrees))
            for std_hz, n_degrees in (
                (line.noise_std_hz, line.n_noise_degrees),
                (line.irregularity_std_hz, line.n_irregularity_degrees),
            )
        )
    )
    return line.frequency_hz - half_hz, line.frequency_hz + half_hz


def _judge_line(
    remainder: np.ndarray,
    times_s: np.ndarray,
    start_hz: float,
    band_hz: tuple[float, float],
    basis: np.ndarray,
    n_harmonics: int,
    noise_slope: NoiseSlope,
    excluded_hz: tuple[tuple[float, float], ...],
    *,
    searched_hz: float,
    n_choices: int,
) -> Line | None:
    """Refine a line and compute its significance.

    None if it leaves the band, or if no noise is left to compare it with.
    """
    duration_s = float(np.ptp(times_s)) * len(times_s) / (len(times_s) - 1)
    n_components = remainder.shape[1]
    bins = np.arange(
        math.ceil(band_hz[0] * duration_s), n_harmonics * band_hz[1] * duration_s + 1e-9
    )
    bins_hz = bins / duration_s
    bins_hz = bins_hz[~_is_inside(bins_hz, excluded_hz)]
    n_left = len(bins_hz) - n_harmonics
    if n_left < 2:
        return None
    fit = _fit_rate(remainder, times_s, start_hz, n_harmonics, basis)
    if not band_hz[0] <= fit.frequency_hz <= band_hz[1]:
        return None  # the flank of a movement outside the band
    energies = _line_energies(remainder, times_s, bins_hz, fit.basis)
    total_energy = float(np.sum(remainder**2))
    harmonics_hz = fit.frequency_hz * np.arange(1, n_harmonics + 1)
    shape, scale = n_harmonics * n_components, n_left * n_components
    mean_square_order = float(np.mean(np.arange(1, n_harmonics + 1) ** 2))
    independent = searched_hz * math.sqrt(4 * np.pi * float(np.var(times_s)) * mean_square_order)

    def noise_for(exponents: np.ndarray) -> np.ndarray:
        """Return the variance of the noise at 1 Hz for exponents of its power."""
        noise = energies @ bins_hz[:, None] ** exponents / (2 * n_left * n_components)
        # Rounding of samples and regression remains without any noise.
        return np.asarray(np.maximum(noise, max(1e-20 * total_energy, 1e-300)))

    exponents = noise_slope.quantiles()
    z = fit.energies @ harmonics_hz[:, None] ** exponents / (2 * noise_for(exponents))
    tail = scipy.stats.betaprime.sf(z / scale, shape, scale)
    density = scipy.stats.betaprime.pdf(z / scale, shape, scale) / scale
    # Rice's bound exceeds 1 for low lines.
    probabilities = tail + independent * np.sqrt(z) * (1 + z / scale) * density
    probability = float(np.mean(np.minimum(probabilities, 1.0)))
    exponent = noise_slope.exponent
    noise = float(noise_for(np.array([exponent]))[0])
    return Line(
        frequency_hz=fit.frequency_hz,
        noise_std_hz=math.sqrt(noise / fit.frequency_hz**exponent / max(fit.information, 1e-300)),
        amplitude=fit.amplitude,
        harmonic_energies=tuple(fit.energies.tolist()),
        false_alarm_probability=min(n_choices * probability, 1.0),
        n_noise_degrees=2 * scale,
    )


def _rate_variance_of_irregularity(
    remainder: np.ndarray,
    times_s: np.ndarray,
    frequency_hz: float,
    n_harmonics: int,
    basis: np.ndarray,
    excluded_hz: tuple[tuple[float, float], ...],
) -> tuple[float, float]:
    """Return the variance of a fitted rate by unequal periods, and its degrees of freedom.

    R / (5 S T^2), of the phases of all harmonics with the sidebands up to half the rate, or to the
    nearest excluded frequency.
    """
    duration_s = float(np.ptp(times_s))
    to_excluded_hz = [max(low - frequency_hz, frequency_hz - high) for low, high in excluded_hz]
    below_hz = min([frequency_hz / 2, *to_excluded_hz])
    # At least one function beyond a constant and a slope.
    slow = slow_functions(times_s, max(below_hz, 1.001 / duration_s))
    n_slow = slow.shape[1]
    orders = np.arange(1, n_harmonics + 1)
    squares, information = 0.0, 0.0
    for order in orders.tolist():
        cosine, sine = sinusoids(times_s, np.array([order * frequency_hz])).T
        others = sinusoids(times_s, orders[orders != order] * frequency_hz)
        columns = np.concatenate(
            [slow * cosine[:, None], slow * sine[:, None], others, basis], axis=1
        )
        coefficients = np.linalg.lstsq(columns, remainder, rcond=None)[0]
        envelopes = slow @ (coefficients[:n_slow] - 1j * coefficients[n_slow : 2 * n_slow])
        principal = np.linalg.svd(envelopes, full_matrices=False)[2][0]
        envelope = envelopes @ principal.conj()
        cycles = np.unwrap(np.angle(envelope)) / (2 * np.pi)
        deviations = cycles - np.polyval(np.polyfit(times_s, cycles, 1), times_s)
        power = float(np.mean(abs(envelope) ** 2))
        squares += power * float(np.mean(deviations**2))
        information += power * order**2
    terms = 1 / (np.pi * np.arange(2, n_slow)) ** 2
    variance_hz2 = squares / max(information, 1e-300) / (5 * terms.sum() * duration_s**2)
    return variance_hz2, float(terms.sum() ** 2 / np.sum(terms**2))


def _line_energies(
    movement: np.ndarray, times_s: np.ndarray, frequencies_hz: np.ndarray, basis: np.ndarray
) -> np.ndarray:
    """Return the energy that one sinusoid of each frequency takes from the remainder of a basis."""
    remainder = movement - basis @ (basis.T @ movement)
    columns = sinusoids(times_s, frequencies_hz)
    columns -= basis @ (basis.T @ columns)
    cosine, sine = np.split(columns, 2, axis=1)
    cc, ss = np.sum(cosine**2, axis=0), np.sum(sine**2, axis=0)
    cs = np.sum(cosine * sine, axis=0)
    c, s = cosine.T @ remainder, sine.T @ remainder
    determinant = cc * ss - cs**2
    # Frequencies inside the basis have no energy left, apart from rounding.
    is_free = determinant > 1e-6 * len(times_s) ** 2 / 4
    energy = np.sum(ss[:, None] * c**2 - 2 * cs[:, None] * c * s + cc[:, None] * s**2, axis=1)
    return np.where(is_free, energy / np.where(is_free, determinant, 1.0), 0.0)


def _is_inside(
    frequencies_hz: np.ndarray, intervals_hz: tuple[tuple[float, float], ...]
) -> np.ndarray:
    is_inside = np.zeros(len(frequencies_hz), bool)
    for low_hz, high_hz in intervals_hz:
        is_inside |= (low_hz <= frequencies_hz) & (frequencies_hz <= high_hz)
    return is_inside


@frozen_dataclass
class _RateFit:
    frequency_hz: float
    basis: np.ndarray
    """With the harmonics, orthonormal."""
    energies: np.ndarray
    """Of each harmonic."""
    amplitude: float
    information: float
    """On the frequency, per variance of the noise: its inverse is the bound."""


def _fit_rate(
    remainder: np.ndarray, times_s: np.ndarray, start_hz: float, n_harmonics: int, basis: np.ndarray
) -> _RateFit:
    """Refine a frequency by Gauss-Newton, within the width of its peak."""
    width_hz = 1 / (n_harmonics * float(np.ptp(times_s)))
    frequency_hz, fit = start_hz, None
    for _ in range(_MAX_ITERATIONS):
        orders = np.arange(1, n_harmonics + 1)
        columns = sinusoids(times_s, orders * frequency_hz)
        free = columns - basis @ (basis.T @ columns)
        joined = join_bases(basis, columns)
        coefficients = np.linalg.lstsq(free, remainder, rcond=None)[0]
        cosine, sine = np.split(columns, 2, axis=1)
        slopes = cosine @ (orders[:, None] * coefficients[n_harmonics:])
        slopes -= sine @ (orders[:, None] * coefficients[:n_harmonics])
        slopes *= 2 * np.pi * times_s[:, None]
        slopes -= joined @ (joined.T @ slopes)
        information = float(np.sum(slopes**2))
        fit = _RateFit(
            frequency_hz=frequency_hz,
            basis=joined,
            energies=np.sum(
                ((free.T @ remainder) * coefficients).reshape(2, n_harmonics, -1), axis=(0, 2)
            ),
            amplitude=float(np.linalg.norm(coefficients[[0, n_harmonics]])),
            information=information,
        )
        step_hz = float(np.sum(slopes * remainder)) / max(information, 1e-300)
        if abs(step_hz) < 1e-6 * width_hz or abs(frequency_hz + step_hz - start_hz) > width_hz:
            break
        frequency_hz += step_hz
    assert fit is not None
    return fit

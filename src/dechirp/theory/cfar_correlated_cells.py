"""False-alarm law of cell averaging for correlated cells.

A window or zero padding correlates neighbouring cells. The cell under test and the
training cells are squared magnitudes of jointly Gaussian, circular amplitudes, each summed
over K powers: receivers, or pulses. An alarm is

    z_0 > a (z_1 + ... + z_N),   a = factor / N,

an indefinite quadratic form. Let 1 and -mu_1, -mu_2, ... be its eigenvalues relative to the
only positive one. Given the training sum, z_0 is a gamma variate of K, so that with
M(s) = prod_j (1 + s mu_j)^-K

    Pfa = sum_{j < K} (-1)^j M^(j)(1) / j!

For K = 1 this is prod 1 / (1 + mu_j); where the cell under test is independent of the
training cells, mu_j = a l_j with l_j the eigenvalues of their covariance. For independent
cells every mu is a: the closed forms of `theory.cfar`.

References
----------
G. L. Turin, The characteristic function of Hermitian quadratic forms in complex normal
variables, Biometrika 47, 1960. J. P. Imhof, Computing the distribution of quadratic forms in
normal variables, Biometrika 48, 1961.
"""

import math

import numpy as np
import scipy

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import as_tuple_or_none, check_finite_samples, check_integer
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.theory.cfar import cell_averaging_factor

__all__ = ["CorrelatedWindow", "correlated_factor"]

# Terms of the series of an ordered statistic: rho^2 of 0.9 is 1e-5 by then.
_MAX_LAGUERRE_ORDER = 100
_MIN_POSITIVE = 5e-324  # keeps the logarithm of a probability that underflows


@frozen_dataclass
class CorrelatedWindow:
    """Covariance of the cells of a CFAR window, as a product of two axes.

    The window is a rectangle of range by velocity cells: training cells, guard cells and the cell
    under test. White noise after a separable transform has the covariance
    `range_covariance` x `velocity_covariance` there. Instances have no `==` and no hash.

    Raises `InvalidSetting` unless the covariances are Hermitian with ones on the diagonal, the
    guard lies within the window, and the cell under test within the guard.
    """

    range_covariance: np.ndarray
    """(n, n), Hermitian, ones on the diagonal."""
    velocity_covariance: np.ndarray
    """(m, m), Hermitian, ones on the diagonal."""
    guard_range: slice
    """Rows of the guard, including the cell under test."""
    guard_velocity: slice
    """Columns of the guard."""
    cell_under_test: tuple[int, int]
    """Position of the cell under test in the window, (range, velocity)."""

    def __post_init__(self) -> None:
        position = as_tuple_or_none(self.cell_under_test)
        if position is None or len(position) != 2:
            raise InvalidSetting(
                "CorrelatedWindow.cell_under_test",
                value=self.cell_under_test,
                expected="a pair of whole numbers, (range, velocity)",
                fix="give the position of the cell under test in the window",
            )
        axes = (
            ("range", self.guard_range, position[0]),
            ("velocity", self.guard_velocity, position[1]),
        )
        for axis, guard, under_test in axes:
            covariance = _check_covariance(
                f"CorrelatedWindow.{axis}_covariance", getattr(self, f"{axis}_covariance")
            )
            object.__setattr__(self, f"{axis}_covariance", covariance)
            where = f"CorrelatedWindow.guard_{axis}"
            check_integer(f"{where}.start", guard.start, at_least=0, at_most=len(covariance) - 1)
            check_integer(
                f"{where}.stop", guard.stop, at_least=guard.start + 1, at_most=len(covariance)
            )
            if guard.step is not None:
                check_integer(f"{where}.step", guard.step, at_least=1, at_most=1)
            check_integer(
                f"CorrelatedWindow.cell_under_test of {axis}",
                under_test,
                at_least=guard.start,
                at_most=guard.stop - 1,
            )
        object.__setattr__(self, "cell_under_test", (int(position[0]), int(position[1])))

    @property
    def n_training(self) -> int:
        """Number of training cells."""
        box = len(self.range_covariance) * len(self.velocity_covariance)
        return box - self._slice_length(self.guard_range) * self._slice_length(self.guard_velocity)

    @property
    def training_offsets(self) -> np.ndarray:
        """Offsets of the training cells from the cell under test, (n_training, 2): velocity, range.

        In order of range, then velocity.
        """
        return self._training_positions - np.array(self.cell_under_test[::-1])

    @property
    def is_white(self) -> bool:
        """True if noise is independent from cell to cell."""
        axes = (self.range_covariance, self.velocity_covariance)
        return all(np.array_equal(axis, np.eye(len(axis))) for axis in axes)

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the training cells and, last, the cell under test, (n + 1, n + 1)."""
        velocity, row = np.vstack([self._training_positions, self.cell_under_test[::-1]]).T
        return np.asarray(
            self.range_covariance[np.ix_(row, row)]
            * self.velocity_covariance[np.ix_(velocity, velocity)]
        )

    @property
    def _training_positions(self) -> np.ndarray:
        """Columns and rows of the training cells in the window, (n_training, 2)."""
        trains = np.ones((len(self.range_covariance), len(self.velocity_covariance)), bool)
        trains[self.guard_range, self.guard_velocity] = False
        return np.argwhere(trains)[:, ::-1]

    @property
    def n_independent(self) -> float:
        r"""Number of independent cells whose mean has the same variance.

        .. math:: N_\mathrm{eff} = N^2 / \sum_{ij} |\rho_{ij}|^2

        over the N training cells: the correlation of two squared magnitudes is the square of that
        of their amplitudes. Closed forms for this number of independent cells, rounded, are an
        approximation: in the reference window, factors for 1e-6 within 0.05 % under Hann
        windows and 0.5 % padded twofold. The exact factor is `correlated_factor`.

        F. E. Satterthwaite, An approximate distribution of estimates of variance components,
        Biometrics Bulletin 2(6), 1946.
        """
        return float(self.n_training**2 / self._sum_of_correlation_powers(1))

    def n_independent_for_quantile(self, quantile_level: float) -> float:
        r"""Return the number of independent cells whose quantile has the same variance.

        .. math:: N_\mathrm{eff} = \frac{N^2 p q}{\sum_{ij} C(|\rho_{ij}|)}, \quad
            C(\rho) = \sum_{k \ge 1} \rho^{2 k} \left(p\, [L_k(t) - L_{k-1}(t)]\right)^2

        with q the quantile level, p = 1 - q, t = -ln p the level between
        them, and C the covariance of
        the events that two squared magnitudes exceed it, by the Laguerre series of their density
        (Watson).
        C falls faster with distance than the covariance of the magnitudes, so an ordered
        statistic has more effective cells than the mean: 76 of 196 under Hann windows, not 58.

        G. N. Watson, Notes on generating functions of polynomials: (1) Laguerre polynomials,
        J. London Math. Soc. 8, 1933. Bahadur's relation of quantiles to shares: Ann. Math.
        Stat. 37(3), 1966.
        """
        above = 1.0 - quantile_level
        orders = np.arange(_MAX_LAGUERRE_ORDER + 1)
        values = scipy.special.eval_laguerre(orders, -np.log(above))
        terms = (above * np.diff(values)) ** 2  # of k = 1, 2, ...
        n = self.n_training
        # Pairs of a cell with itself are the variance, and need no series.
        apart = sum(
            c * (self._sum_of_correlation_powers(k) - n)
            for k, c in zip(orders[1:], terms, strict=True)
        )
        return float(n**2 * above * quantile_level / (n * above * quantile_level + apart))

    def _sum_of_correlation_powers(self, half_exponent: int) -> float:
        """Return the sum of |rho|^(2 order) over all pairs of training cells."""
        # Training cells are the window without its guard, and both are products of axes.
        in_range = _axis_sums_of_correlation_powers(
            self.range_covariance, self.guard_range, half_exponent
        )
        in_velocity = _axis_sums_of_correlation_powers(
            self.velocity_covariance, self.guard_velocity, half_exponent
        )
        box, across, guard = in_range * in_velocity
        return float(box - 2 * across + guard)

    @staticmethod
    def _slice_length(guard: slice) -> int:
        return int(guard.stop - guard.start)


def _check_covariance(setting: str, covariance: np.ndarray) -> np.ndarray:
    """Return a covariance in double precision, or raise `InvalidSetting`."""
    array = check_finite_samples(
        setting,
        covariance,
        axes="(cell, cell)",
        fits=lambda x: x.ndim == 2 and x.shape[0] == x.shape[1],
    )
    array = array.astype(complex if np.iscomplexobj(array) else float)
    adjoint = array.conj().T
    # Rounding errors of single precision.
    if np.any(abs(array - adjoint) > 1e-5) or np.any(abs(np.diag(array) - 1) > 1e-5):
        raise InvalidSetting(
            setting,
            value=f"an array {array.shape} that is not Hermitian with ones on the diagonal",
            expected="the covariance of noise of power 1, of each cell with each along this axis",
            fix="divide it by the noise power, or take it from dechirp.windows.bin_correlation",
        )
    return array


def _axis_sums_of_correlation_powers(
    covariance: np.ndarray, guard: slice, half_exponent: int
) -> np.ndarray:
    """Sum |rho|^(2 order) over pairs of cells: window, window and guard, guard; (3,)."""
    power = np.abs(covariance) ** (2 * half_exponent)
    return np.array([power.sum(), power[guard].sum(), power[guard, guard].sum()])


@check_argument_types
def correlated_factor(
    false_alarm_probability: float, window: CorrelatedWindow, *, n_summed: int = 1
) -> float:
    """Return the ratio of threshold to the mean of correlated training cells, by the exact law.

    The law needs det(I + x R) over the training cells, for R the covariance. Their covariance is
    not a product of axes, but that of the window is: with V = (I + x R_window)^-1, whose
    eigenvectors are products, and G the guard with the cell under test, Schur's complement gives

        det over training cells = det(I + x R_window) det V_GG,   1 + a = h(x) = [V_GG^-1]_00,

    where x is a over the positive eigenvalue. So only matrices of the size of the guard are
    inverted (81 for 4 x 4 guard cells, against 644 training cells): 4 ms, not 100.

    Parameters
    ----------
    false_alarm_probability : float
        For the cell under test.
    window : CorrelatedWindow
        The covariance of the noise.
    n_summed : int
        Powers that are summed in each cell, of receivers or pulses.

    Raises
    ------
    InvalidSetting
        If the training cells predict the cell under test, so that no factor exists, and as in
        `cell_averaging_factor`.
    """
    from scipy.optimize import newton  # 0.2 s, unused by most commands

    independent = cell_averaging_factor(
        false_alarm_probability, n_training=window.n_training, n_summed=n_summed
    )
    start, log_pfa = np.log(independent / window.n_training), np.log(false_alarm_probability)
    law = _FalseAlarmLaw(window)

    def excess(log_x: float) -> float:
        return law.log_false_alarm_probability(float(np.exp(log_x)), n_summed) - log_pfa

    try:
        log_x, solution = newton(
            excess, start, x1=start + 0.1, tol=1e-8, full_output=True, disp=False
        )
    except np.linalg.LinAlgError:
        log_x, solution = np.nan, None
    # Correlation changes the factor by 10 % to 20 %, unless the guard is so small that the
    # training cells predict the cell under test.
    if solution is None or not solution.converged or not abs(log_x - start) < 5:
        raise InvalidSetting(
            "Cfar.n_guard",
            value="too small for this window and zero padding",
            expected="guard cells beyond the main lobe of the window",
            fix="widen the guard, or pad less",
        )
    return law.factor_over_n_training(float(np.exp(log_x))) * window.n_training


class _FalseAlarmLaw:
    """False-alarm law of `correlated_factor`: det V_GG and h(x) from eigenvectors of both axes."""

    def __init__(self, box: CorrelatedWindow) -> None:
        range_values, range_vectors = np.linalg.eigh(box.range_covariance)
        velocity_values, velocity_vectors = np.linalg.eigh(box.velocity_covariance)
        self._eigenvalues = np.outer(
            np.clip(range_values, 0, None), np.clip(velocity_values, 0, None)
        )
        in_range = range_vectors[box.guard_range]
        in_velocity = velocity_vectors[box.guard_velocity]
        # Outer products of each eigenvector over the guard: V_GG is a weighted sum of them.
        self._range = np.einsum("ai,bi->abi", in_range, in_range.conj())
        self._velocity = np.einsum("cj,dj->cdj", in_velocity, in_velocity.conj())
        self._n_training = box.n_training
        row = box.cell_under_test[0] - box.guard_range.start
        self._n_guard = len(in_range) * len(in_velocity)
        self._cut = row * len(in_velocity) + box.cell_under_test[1] - box.guard_velocity.start

    def _weighted_eigenvector_sum_over_guard(self, weights: np.ndarray) -> np.ndarray:
        """Sum weights_ij u_i u_i^H x v_j v_j^H over the guard, (..., guard, guard)."""
        by_velocity = np.einsum("...ij,cdj->...icd", weights, self._velocity)
        block = np.einsum("abi,...icd->...acbd", self._range, by_velocity, optimize=True)
        return block.reshape(*weights.shape[:-2], self._n_guard, self._n_guard)

    def factor_over_n_training(self, root: float) -> float:
        """Return factor / N for a root x: h(x) - 1."""
        inverse = np.linalg.inv(
            self._weighted_eigenvector_sum_over_guard(1 / (1 + root * self._eigenvalues))
        )
        return float(inverse[self._cut, self._cut].real - 1)

    def log_false_alarm_probability(self, root: float, n_summed: int) -> float:
        """Return the natural logarithm of the false-alarm probability at the root x."""
        return (
            self._log_false_alarm_probability_of_one_power(root)
            if n_summed == 1
            else self._log_false_alarm_probability_of_sum(root, n_summed)
        )

    def _log_false_alarm_probability_of_one_power(self, root: float) -> float:
        """Return ln of (h - 1) / (x h' det over the training cells)."""
        spread = 1 / (1 + root * self._eigenvalues)
        block = self._weighted_eigenvector_sum_over_guard(spread)
        column = np.linalg.solve(block, np.eye(self._n_guard)[:, self._cut])
        h = column[self._cut].real
        slope = (
            column.conj()
            @ self._weighted_eigenvector_sum_over_guard(self._eigenvalues * spread**2)
            @ column
        )
        log_det = np.linalg.slogdet(block)[1] - np.sum(np.log(spread))
        return float(np.log(h - 1) - np.log(root * slope.real) - log_det)

    def _log_false_alarm_probability_of_sum(self, root: float, n_summed: int) -> float:
        r"""Return ln of the sum over derivatives, as an integral around them.

        With q(s) = M(s)^(-1/K) and t = 1 - s, the sum of the first K Taylor coefficients is

        .. math:: P = \frac{1}{2 \pi i} \oint \frac{[q(1 - t)\, t]^{-K}}{1 - t} dt

        on a circle within |t| < 1; on a larger one it is P - 1. Of the saddle point of independent
        cells, |t| = (1 + a) / ((N + 1) a), the integrand falls over the angle with a standard
        deviation of 1 / sqrt(K), and equal steps converge exponentially; 20 to 60 suffice for
        any K. q(s) = det over the training cells at s x, times
        (a - (h(s x) - 1)) / (a (1 - s)).
        """
        a = self.factor_over_n_training(root)
        log_radius, deviation = math.log((1 + a) / ((self._n_training + 1) * a)), n_summed**-0.5
        if abs(log_radius) < deviation:  # 1 / (1 - t) is not resolved beside its pole
            log_radius = -deviation
        span = min(math.pi, 12 * deviation)
        n_steps = math.ceil(span / min(0.8 * deviation, 0.2 * abs(log_radius)))
        log_t = log_radius + 1j * span * (np.arange(n_steps) + 0.5) / n_steps
        t = np.exp(log_t)
        spread = 1 / (1 + (1 - t)[:, None, None] * root * self._eigenvalues)
        block = self._weighted_eigenvector_sum_over_guard(spread)
        h = np.linalg.inv(block)[:, self._cut, self._cut]
        sign, log_det = np.linalg.slogdet(block)
        log_q = np.log(sign * (1 + a - h) / (a * t)) + log_det - np.sum(np.log(spread), axis=(1, 2))
        # Whole turns of log q do not matter: K is whole.
        log_integrand = -n_summed * (log_q + log_t) + log_t - np.log(1 - t)
        log_scale = float(log_integrand.real.max())
        # The lower half of the circle adds the conjugate of the upper.
        integral = span / math.pi * float(np.mean(np.exp(log_integrand - log_scale)).real)
        if log_radius < 0:
            return log_scale + math.log(max(integral, _MIN_POSITIVE))
        return math.log1p(max(math.exp(log_scale) * integral, _MIN_POSITIVE - 1))

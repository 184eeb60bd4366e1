"""False-alarm law of cell averaging for correlated cells.

A window, or zero padding, ties neighbouring cells together. The cell under test and the
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

import numpy as np
from scipy.optimize import newton
from scipy.special import eval_laguerre

from dechirp.core.checks import whole
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.theory.cfar import cell_averaging_factor

# Terms of the series of an ordered statistic: rho^2 of 0.9 is 1e-5 by then.
_MOST_LAGUERRE = 100


@value
class Box:
    """Covariance of the cells in and around a training ring, as a product of two axes.

    A box of range by velocity cells holds the ring; the guard cells and the cell under test
    are the rest of the box. White noise after a separable transform has the covariance
    `range_covariance` x `velocity_covariance` there. Boxes have no `==` and no hash.

    Raises `InvalidSetting` unless the covariances are square, the guard is whole cells
    within the box, and the cell under test within the guard.
    """

    range_covariance: np.ndarray
    """(n, n), Hermitian, ones on the diagonal."""
    velocity_covariance: np.ndarray
    """(m, m), the same."""
    guard_range: slice
    """Rows of the box that the guard takes, cell under test included."""
    guard_velocity: slice
    """Columns of the box that it takes."""
    under_test: tuple[int, int]
    """Place of the cell under test in the box, (range, velocity)."""

    def __post_init__(self) -> None:
        axes = (
            ("range", self.range_covariance, self.guard_range, self.under_test[0]),
            ("velocity", self.velocity_covariance, self.guard_velocity, self.under_test[1]),
        )
        for axis, covariance, guard, under_test in axes:
            if covariance.ndim != 2 or covariance.shape[0] != covariance.shape[1]:
                raise InvalidSetting(
                    f"Box.{axis}_covariance",
                    got=f"an array {covariance.shape}",
                    need="square",
                    fix="Give the covariance of each cell with each along this axis.",
                )
            where = f"Box.guard_{axis}"
            whole(f"{where}.start", guard.start, at_least=0, at_most=len(covariance) - 1)
            whole(f"{where}.stop", guard.stop, at_least=guard.start + 1, at_most=len(covariance))
            if guard.step is not None:
                whole(f"{where}.step", guard.step, at_least=1, at_most=1)
            whole(
                f"Box.under_test of {axis}",
                under_test,
                at_least=guard.start,
                at_most=guard.stop - 1,
            )

    @property
    def n_training(self) -> int:
        """Cells of the ring."""
        box = len(self.range_covariance) * len(self.velocity_covariance)
        return box - self._n_guard(self.guard_range) * self._n_guard(self.guard_velocity)

    @property
    def offsets(self) -> np.ndarray:
        """Places of the training cells, (n_training, 2): velocity, range from the cell under test.

        In order of range, then velocity.
        """
        return self._training - np.array(self.under_test[::-1])

    @property
    def is_white(self) -> bool:
        """Whether noise is independent from cell to cell."""
        axes = (self.range_covariance, self.velocity_covariance)
        return all(np.array_equal(axis, np.eye(len(axis))) for axis in axes)

    @property
    def covariance(self) -> np.ndarray:
        """Of the training cells and, last, of the cell under test, (n_training + 1, the same)."""
        velocity, row = np.vstack([self._training, self.under_test[::-1]]).T
        return np.asarray(
            self.range_covariance[np.ix_(row, row)]
            * self.velocity_covariance[np.ix_(velocity, velocity)]
        )

    @property
    def _training(self) -> np.ndarray:
        """Columns and rows of the training cells in the box, (n_training, 2)."""
        trains = np.ones((len(self.range_covariance), len(self.velocity_covariance)), bool)
        trains[self.guard_range, self.guard_velocity] = False
        return np.argwhere(trains)[:, ::-1]

    @property
    def n_independent(self) -> float:
        r"""Independent cells whose mean has the variance of that of the ring.

        .. math:: N_\mathrm{eff} = N^2 / \sum_{ij} |\rho_{ij}|^2

        over the N cells of the ring: two squared magnitudes are correlated by the square of
        what their amplitudes are. Closed forms for so many independent cells, rounded, are an
        approximate law: in the reference ring, factors for 1e-6 within 0.05 % under Hann
        windows and 0.5 % padded twofold. The exact factor is `correlated_factor`.

        F. E. Satterthwaite, An approximate distribution of estimates of variance components,
        Biometrics Bulletin 2(6), 1946.
        """
        return float(self.n_training**2 / self._pairs(1))

    def n_independent_at(self, share: float) -> float:
        r"""Independent cells whose ordered statistic, below it this share, varies as the ring's.

        .. math:: N_\mathrm{eff} = \frac{N^2 p q}{\sum_{ij} C(|\rho_{ij}|)}, \quad
            C(\rho) = \sum_{k \ge 1} \rho^{2 k} \left(p\, [L_k(t) - L_{k-1}(t)]\right)^2

        with q the share, p = 1 - q, t = -ln p the level between them, and C the covariance of
        two squared magnitudes' exceeding it, by the Laguerre series of their density (Watson).
        That falls faster with the distance than the covariance of the magnitudes, so an ordered
        statistic is worth more cells than their mean: 76 of 196 under Hann windows, not 58.

        G. N. Watson, Notes on generating functions of polynomials: (1) Laguerre polynomials,
        J. London Math. Soc. 8, 1933. Bahadur's relation of quantiles to shares: Ann. Math.
        Stat. 37(3), 1966.
        """
        above = 1.0 - share
        orders = np.arange(_MOST_LAGUERRE + 1)
        values = eval_laguerre(orders, -np.log(above))
        terms = (above * np.diff(values)) ** 2  # of k = 1, 2, ...
        n = self.n_training
        # Pairs of a cell with itself are the variance, and need no series.
        apart = sum(c * (self._pairs(k) - n) for k, c in zip(orders[1:], terms, strict=True))
        return float(n**2 * above * share / (n * above * share + apart))

    def _pairs(self, order: int) -> float:
        """Sum of |rho|^(2 order) over all pairs of cells of the ring."""
        # A ring is a box less its guard, and each of the two a product.
        in_range = _sums(self.range_covariance, self.guard_range, order)
        in_velocity = _sums(self.velocity_covariance, self.guard_velocity, order)
        box, across, guard = in_range * in_velocity
        return float(box - 2 * across + guard)

    @staticmethod
    def _n_guard(along: slice) -> int:
        return int(along.stop - along.start)


def _sums(covariance: np.ndarray, guard: slice, order: int) -> np.ndarray:
    """Sum of |rho|^(2 order) over pairs of cells: in the box, box and guard, guard; (3,)."""
    power = np.abs(covariance) ** (2 * order)
    return np.array([power.sum(), power[guard].sum(), power[guard, guard].sum()])


def correlated_factor(false_alarm_probability: float, box: Box, *, n_summed: int = 1) -> float:
    """Threshold over the mean of the training cells of a box, by the exact law.

    The law needs det(I + x R) over the ring, for R the covariance. A ring is no product,
    but the box is: with V = (I + x R_box)^-1, whose eigenvectors are products, and G the
    guard with the cell under test, Schur's complement gives

        det over the ring = det(I + x R_box) det V_GG,   1 + a = h(x) = [V_GG^-1]_00,

    where x is a over the positive eigenvalue. So only matrices of the size of the guard are
    inverted (81 for 4 x 4 guard cells, against 644 training cells): 4 ms, not 100.

    Parameters
    ----------
    false_alarm_probability : float
        For the cell under test.
    box : Box
        The covariance of the noise.
    n_summed : int
        Powers that are summed in each cell, of receivers or pulses.

    Raises
    ------
    InvalidSetting
        If the training cells foretell the cell under test, so that no factor is found, or as
        `cell_averaging_factor` does.
    """
    independent = cell_averaging_factor(
        false_alarm_probability, n_training=box.n_training, n_summed=n_summed
    )
    start, log_pfa = np.log(independent / box.n_training), np.log(false_alarm_probability)
    law = _Law(box)

    def excess(log_x: float) -> float:
        return law.log_probability(float(np.exp(log_x)), n_summed) - log_pfa

    try:
        log_x, found = newton(excess, start, x1=start + 0.1, tol=1e-8, full_output=True, disp=False)
    except np.linalg.LinAlgError:
        log_x, found = np.nan, None
    # Correlation moves the factor by a tenth or two, unless the guard is so small that the
    # training cells foretell the cell under test.
    if found is None or not found.converged or not abs(log_x - start) < 5:
        raise InvalidSetting(
            "Cfar.n_guard",
            got="too small for this window and zero padding",
            need="guard cells beyond the main lobe of the window",
            fix="Widen the guard, or pad less.",
        )
    return law.a(float(np.exp(log_x))) * box.n_training


class _Law:
    """det V_GG and h(x) of `correlated_factor`, from the eigenvectors of the two axes."""

    def __init__(self, box: Box) -> None:
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
        row = box.under_test[0] - box.guard_range.start
        self._n_guard = len(in_range) * len(in_velocity)
        self._cut = row * len(in_velocity) + box.under_test[1] - box.guard_velocity.start

    def _on_guard(self, weights: np.ndarray) -> np.ndarray:
        """Sum of weights_ij u_i u_i^H x v_j v_j^H over the guard, (..., guard, guard)."""
        by_velocity = np.einsum("...ij,cdj->...icd", weights, self._velocity)
        block = np.einsum("abi,...icd->...acbd", self._range, by_velocity, optimize=True)
        return block.reshape(*weights.shape[:-2], self._n_guard, self._n_guard)

    def a(self, x: float) -> float:
        """Factor over N that belongs to a root x: h(x) - 1."""
        inverse = np.linalg.inv(self._on_guard(1 / (1 + x * self._eigenvalues)))
        return float(inverse[self._cut, self._cut].real - 1)

    def log_probability(self, x: float, n_summed: int) -> float:
        """Natural logarithm of the false-alarm probability at the root x."""
        return self._one(x) if n_summed == 1 else self._several(x, n_summed)

    def _one(self, x: float) -> float:
        """Ln of (h - 1) / (x h' det over the ring)."""
        spread = 1 / (1 + x * self._eigenvalues)
        block = self._on_guard(spread)
        column = np.linalg.solve(block, np.eye(self._n_guard)[:, self._cut])
        h = column[self._cut].real
        slope = column.conj() @ self._on_guard(self._eigenvalues * spread**2) @ column
        log_det = np.linalg.slogdet(block)[1] - np.sum(np.log(spread))
        return float(np.log(h - 1) - np.log(x * slope.real) - log_det)

    def _several(self, x: float, n_summed: int) -> float:
        """Ln of the sum over derivatives, from q(s) = prod (1 + s mu_j) around s = 1.

        q(s) = det over the ring at s x, times (a - (h(s x) - 1)) / (a (1 - s)). Its logarithm
        is analytic within |s - 1| < 1 + 1 / mu_max, about 5 or more, so its Taylor
        coefficients follow from a few points on the unit circle around s = 1; those of the
        lower half are conjugates of the upper.
        """
        n_upper = 8 + n_summed
        turn = np.exp(1j * np.pi * (np.arange(n_upper) + 0.5) / n_upper)
        a = self.a(x)
        spread = 1 / (1 + (1 + turn)[:, None, None] * x * self._eigenvalues)
        block = self._on_guard(spread)
        h = np.linalg.inv(block)[:, self._cut, self._cut]
        sign, log_det = np.linalg.slogdet(block)
        log_q = np.log(sign * (h - 1 - a) / (a * turn)) + log_det
        log_q -= np.sum(np.log(spread), axis=(1, 2))
        log_q = log_q.real + 1j * np.unwrap(log_q.imag)
        taylor = [float(np.mean(log_q * turn**-j).real) for j in range(n_summed)]
        # M = q^-K; its terms (-1)^j M^(j)(1) / j! follow from those of log q, all positive.
        power = [-n_summed * (-1) ** j * j * taylor[j] for j in range(n_summed)]
        terms = [1.0]
        for j in range(1, n_summed):
            terms.append(sum(power[i] * terms[j - i] for i in range(1, j + 1)) / j)
        return float(-n_summed * taylor[0] + np.log(sum(terms)))

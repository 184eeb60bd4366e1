"""Windows: weights, gain, bandwidth, scalloping loss and correlation of bins.

Sums of cosines are periodic (DFT-even): the last point of the period is omitted, so that their
nulls fall on bins. Chebyshev, Taylor and Kaiser windows are symmetric, with equal first and last
weights: only then their sidelobes are as designed (a periodic Chebyshev window of 256 points has
-56 dB instead of -60 dB). Formulas are 1 in the middle, which may lie between two points; a
Chebyshev window is 1 at its largest weight. A single weight is 1. Windows of SciPy are periodic, as
`scipy.signal.get_window` returns them by default: "hann" is the same of both, `("chebwin", 60)`
is the periodic form of the symmetric "chebyshev-60".

`window_weights`, `chebyshev_weights`, `taylor_weights` and `kaiser_weights` return `n` weights, an
integer of at least 1, and raise `InvalidSetting` if a parameter is out of bounds. Figures of merit
raise it for weights that are not finite numbers along the last axis.
"""

import math
import reprlib
from functools import lru_cache
from typing import Any, Literal, TypeGuard, cast, get_args

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import as_tuple_or_none, check_finite_array, check_integer, check_number
from dechirp.core.elementwise import scalar_results
from dechirp.core.errors import InvalidSetting
from dechirp.core.memory import check_free_memory
from dechirp.core.suggestions import did_you_mean_fix

__all__ = [
    "bin_correlation",
    "chebyshev_weights",
    "coherent_gain",
    "half_main_lobe_bins",
    "kaiser_weights",
    "noise_bandwidth_bins",
    "scalloping_loss",
    "taylor_weights",
    "window_names",
    "window_weights",
]

Window = Literal[
    "rectangular",
    "hann",
    "hamming",
    "blackman",
    "blackman-harris",
    "chebyshev-60",
    "chebyshev-80",
    "taylor-30",
    "taylor-50",
    "kaiser-6",
]

# A name of ours or of SciPy, a tuple of SciPy's, the beta of a Kaiser window, or weights.
WindowSpec = Window | str | float | tuple[Any, ...] | ArrayLike
HashableWindow = str | float | tuple[Any, ...]

_COSINES: dict[Window, tuple[float, ...]] = {
    "rectangular": (1.0,),
    "hann": (0.5, 0.5),
    "hamming": (0.54, 0.46),
    "blackman": (0.42, 0.5, 0.08),
    "blackman-harris": (0.35875, 0.48829, 0.14128, 0.01168),
}
_CHEBYSHEV_DB: dict[Window, float] = {"chebyshev-60": 60.0, "chebyshev-80": 80.0}
_TAYLOR_N_BAR_DB: dict[Window, tuple[int, float]] = {
    "taylor-30": (4, 30.0),
    "taylor-50": (6, 50.0),
}
_KAISER_BETA: dict[Window, float] = {"kaiser-6": 6.0}


def window_names() -> tuple[str, ...]:
    """Return the names of the windows."""
    return get_args(Window)


@check_argument_types
def window_weights(window: WindowSpec, n: int) -> np.ndarray:
    """Return the weights of a window, (n,), read-only; refuse unknown names.

    Parameters
    ----------
    window : str, tuple, float or array (n,)
        A name of `window_names`; a window of `scipy.signal.get_window`, by its name, a tuple of
        name and parameters such as `("chebwin", 80)` or `("taylor", 4, 30)`, or a number, the beta
        of a Kaiser window, all of them periodic; or the weights themselves, with a sum above 0.
    n : int
        Number of weights.
    """
    _check_number_of_weights(n, bytes_per_weight=32)
    spec = hashable_window(window)
    if is_explicit_window(spec):
        weights = _check_weights(np.array(spec), setting="window")
        if weights.size != n:
            raise InvalidSetting(
                "window",
                value=f"{weights.size} weights",
                expected=f"{n}, one for each point",
                fix="compute the weights for the length of the axis",
            )
        return weights
    return _cached_window_weights(spec, n)


def hashable_window(window: WindowSpec) -> HashableWindow:
    """Return a window as text, number or tuple, which a cache can use as a key."""
    if isinstance(window, str):
        return window
    if isinstance(window, int | float):
        return check_number("window", window)
    members = as_tuple_or_none(window)
    if members is None:
        raise _unknown_window(window)
    if isinstance(window, tuple) and members and isinstance(members[0], str):
        spec = tuple(as_tuple_or_none(member) or member for member in members)
        try:
            hash(spec)
        except TypeError:  # rows of rows, mappings, masked numbers
            raise _unknown_window(window) from None
        return spec
    if any(isinstance(member, str) for member in members):
        raise _unknown_window(window)
    return tuple(map(float, _check_weights(window, setting="window")))


def is_explicit_window(window: HashableWindow) -> TypeGuard[tuple[float, ...]]:
    """Return whether a hashable window consists of weights."""
    return isinstance(window, tuple) and not isinstance(window[0], str)


def is_pair_of_windows(window: object) -> bool:
    """Return whether a tuple or list contains one window for each of two axes.

    `("hann", "hamming")` does; `("chebwin", 80)` and `("general_cosine", [0.5, 0.5])` are single
    windows of SciPy, and `[0.5, 1.0]` are weights.
    """
    if not isinstance(window, tuple | list) or len(window) != 2:
        return False
    are_windows = all(isinstance(member, str | tuple | list | np.ndarray) for member in window)
    return are_windows and not _needs_parameters(window[0])


def _needs_parameters(name: object) -> bool:
    """Return whether a name is a window of SciPy only with parameters."""
    if not isinstance(name, str) or name in get_args(Window):
        return False
    from scipy.signal import get_window  # 0.3 s, unused by most commands

    try:
        get_window(name, 2)
    except ValueError as error:
        return "must have parameters" in str(error)
    return False


@lru_cache(maxsize=64)
def _cached_window_weights(window: HashableWindow, n: int) -> np.ndarray:
    name = cast("Window", window)
    if name in _COSINES:
        weights = _cosine_sum_window(n, _COSINES[name])
    elif name in _CHEBYSHEV_DB:
        weights = chebyshev_weights(n, _CHEBYSHEV_DB[name])
    elif name in _TAYLOR_N_BAR_DB:
        weights = taylor_weights(n, *_TAYLOR_N_BAR_DB[name])
    elif name in _KAISER_BETA:
        weights = kaiser_weights(n, _KAISER_BETA[name])
    else:
        weights = _scipy_window_weights(window, n)
    weights.flags.writeable = False
    return weights


def _scipy_window_weights(window: HashableWindow, n: int) -> np.ndarray:
    """Return the periodic weights of `scipy.signal.get_window`, (n,)."""
    from scipy.signal import get_window  # 0.3 s, unused by most commands

    try:
        with np.errstate(all="ignore"):
            weights = np.asarray(get_window(cast("Any", window), n))
    # Parameters of a wrong type or number raise several kinds of errors.
    except Exception as error:
        raise _unknown_window(window, reason=str(error)) from None
    if not np.isfinite(weights).all():
        raise _unknown_window(window, reason="weights that are not finite")
    return _check_weights(weights, setting="window")


def _unknown_window(window: object, *, reason: str = "") -> InvalidSetting:
    value = reprlib.repr(window)
    return InvalidSetting(
        "window",
        value=f"{value} ({reason})" if reason and not isinstance(window, str) else value,
        expected=f"{' or '.join(get_args(Window))}; or a window of SciPy, such as ('chebwin', 80);"
        " or an array of weights",
        fix="choose one of them",
    )


def _cosine_sum_window(n: int, coefficients: tuple[float, ...]) -> np.ndarray:
    """Sum (-1)^k a_k cos(2 pi k i / n) over k, (n,), periodic.

    F. J. Harris, On the use of windows for harmonic analysis with the discrete Fourier
    transform, Proc. IEEE 66(1), 1978.
    """
    if n == 1:
        return np.ones(1)  # the formula starts with its null: Hann would have no gain
    phase = 2 * np.pi * np.arange(n) / n
    weights = np.zeros(n)
    for k, coefficient in enumerate(coefficients):
        weights += (-1) ** k * coefficient * np.cos(k * phase)
    return weights


@check_argument_types
def chebyshev_weights(n: int, sidelobe_db: float) -> np.ndarray:
    r"""Return the Dolph-Chebyshev weights: narrowest main lobe for a sidelobe level, (n,).

    .. math:: W(k) = T_{n-1}(x_0 \cos(\pi k / n)), \quad T_{n-1}(x_0) = 10^{L/20}

    with T the Chebyshev polynomial and W the transform at bin k about the middle. All
    sidelobes are L dB down, even the farthest, so the first and the last weight rise for many
    points (60 dB: 0.5 at 2,200 points, and beyond 4,200 larger than the
    middle). The largest weight is 1.

    Parameters
    ----------
    n : int
        Number of weights, at least 1.
    sidelobe_db : float
        Level of the sidelobes below the main lobe, above 0 and at most 300.

    References
    ----------
    C. L. Dolph, A current distribution for broadside arrays which optimizes the
    relationship between beam width and side-lobe level, Proc. IRE 34(6), 1946.
    """
    _check_number_of_weights(n, bytes_per_weight=96)
    _check_sidelobe_level(sidelobe_db)
    if n == 1:
        return np.ones(1)
    order, k = n - 1, np.arange(n)
    x = np.cosh(np.pi * _dolph_taylor_parameter_a(sidelobe_db) / order) * np.cos(np.pi * k / n)
    # Beyond 1 the arc cosine is imaginary, and its cosine a hyperbolic one.
    polynomial = np.cos(order * np.arccos(x.astype(complex)))
    weights = np.fft.ifft(polynomial * np.exp(-1j * np.pi * k * order / n)).real
    return np.asarray(weights / weights.max())


@check_argument_types
def taylor_weights(n: int, n_bar: int, sidelobe_db: float) -> np.ndarray:
    r"""Return the Taylor weights: near sidelobes of about one level, falling beyond, (n,).

    .. math::

        w_i &= 1 + 2 \sum_{m=1}^{\bar n - 1} F_m \cos \frac{2 \pi m (i - (n-1)/2)}{n}

        F_m &= \frac{(-1)^{m+1} \prod_{j=1}^{\bar n - 1}
            \left(1 - \frac{m^2 / \sigma^2}{A^2 + (j - 1/2)^2}\right)}
            {2 \prod_{j \ne m} (1 - m^2 / j^2)}, \quad
        \sigma^2 = \frac{\bar n^2}{A^2 + (\bar n - 1/2)^2}

    with cosh(pi A) = 10^(L/20), divided by its value at i = (n-1)/2. The level is met within
    a decibel where n_bar is at least 2 A^2 + 1/2 (4 for 30 dB); 6 at 50 dB gives 49.3 dB.

    Parameters
    ----------
    n : int
        Number of weights, at least 1.
    n_bar : int
        Nulls from this one on are those of a rectangular window, 1 to 100.
    sidelobe_db : float
        Level of the near sidelobes below the main lobe, above 0 and at most 300.

    References
    ----------
    T. T. Taylor, Design of line-source antennas for narrow beamwidth and low side lobes,
    IRE Trans. Antennas and Propagation 3(1), 1955.
    """
    check_integer("n_bar", n_bar, at_least=1, at_most=100)
    _check_number_of_weights(n, bytes_per_weight=24 + 16 * n_bar)
    _check_sidelobe_level(sidelobe_db)
    m = np.arange(1, n_bar)[:, None]
    j = np.arange(1, n_bar)
    nulls = _taylor_dilation(n_bar, sidelobe_db) ** 2 * (
        _dolph_taylor_parameter_a(sidelobe_db) ** 2 + (j - 0.5) ** 2
    )
    others = np.where(j == m, 1.0, 1 - m**2 / j**2)
    f = (-1.0) ** (j + 1) * np.prod(1 - m**2 / nulls, axis=1) / (2 * np.prod(others, axis=1))
    turns = (np.arange(n) - (n - 1) / 2) / n
    weights = 1 + 2 * f @ np.cos(2 * np.pi * m * turns)
    return np.asarray(weights / (1 + 2 * np.sum(f)))


@check_argument_types
def kaiser_weights(n: int, beta: float) -> np.ndarray:
    r"""Return the Kaiser weights: nearly maximal energy in the main lobe, (n,).

    .. math:: w_i = I_0(\beta \sqrt{1 - (2 i / (n - 1) - 1)^2}) / I_0(\beta)

    with I_0 the modified Bessel function. Sidelobes fall from 44 dB at beta 6.

    Parameters
    ----------
    n : int
        Number of weights, at least 1.
    beta : float
        Taper, 0 (rectangular) to 700.

    References
    ----------
    J. F. Kaiser, Nonrecursive digital filter design using the I0-sinh window function,
    Proc. IEEE Int. Symp. Circuits and Systems, 1974.
    """
    _check_number_of_weights(n, bytes_per_weight=92)
    return np.kaiser(n, check_number("beta", beta, at_least=0, at_most=700))


def half_main_lobe_bins(window: WindowSpec) -> float:
    """Return half the width of the main lobe in unpadded bins, from its peak to its first null.

    Exact for sums of cosines; for the others the limit for many points, exceeded by up to 4 %
    at 32 points. Of windows of SciPy and of weights it is the first minimum of their transform, to
    1/64 bin; infinite for a single weight, which has no null. Raises `InvalidSetting` for another
    name.

    Parameters
    ----------
    window : str, tuple, float or array (n,)
        As of `window_weights`: a name, a window of SciPy, or weights.
    """
    spec = hashable_window(window)
    if spec not in get_args(Window):
        return _measured_half_main_lobe_bins(spec)
    window = cast("Window", spec)
    if window in _COSINES:
        return float(len(_COSINES[window]))
    if window in _CHEBYSHEV_DB:
        return float(np.hypot(_dolph_taylor_parameter_a(_CHEBYSHEV_DB[window]), 0.5))
    if window in _TAYLOR_N_BAR_DB:
        n_bar, sidelobe_db = _TAYLOR_N_BAR_DB[window]
        return float(
            _taylor_dilation(n_bar, sidelobe_db)
            * np.hypot(_dolph_taylor_parameter_a(sidelobe_db), 0.5)
        )
    return float(np.hypot(_KAISER_BETA[window] / np.pi, 1.0))


def _measured_half_main_lobe_bins(window: HashableWindow) -> float:
    """Return the first minimum of the transform of weights, in unpadded bins."""
    n, padding = len(window) if is_explicit_window(window) else 1024, 64
    magnitude = abs(np.fft.fft(window_weights(window, n), padding * n))
    rising = np.flatnonzero(np.diff(magnitude) > 0)
    return float(rising[0] / padding) if rising.size else math.inf


def _dolph_taylor_parameter_a(sidelobe_db: float) -> float:
    """Return A of Dolph and Taylor: cosh(pi A) is the amplitude ratio of main lobe to sidelobe."""
    return float(np.arccosh(10.0 ** (sidelobe_db / 20)) / np.pi)


def _taylor_dilation(n_bar: int, sidelobe_db: float) -> float:
    """Return Taylor's dilation sigma of the nulls before n_bar."""
    return float(n_bar / np.hypot(_dolph_taylor_parameter_a(sidelobe_db), n_bar - 0.5))


def check_window_name(setting: str, window: object) -> None:
    """Raise `InvalidSetting` unless a window is a name of ours, as settings need."""
    # An array of names compares as an array, and a list has no hash.
    if not isinstance(window, str) or window not in get_args(Window):
        raise InvalidSetting(
            setting,
            value=window,
            expected=" or ".join(get_args(Window)),
            fix=_fix_of_window_name(window),
        )


def _fix_of_window_name(window: object) -> str:
    """Return the fix for a window that is no name of ours: the name of equal weights, if any."""
    otherwise = "choose one of them"
    try:
        weights = window_weights(cast("Any", window), 64)
    except (InvalidSetting, TypeError):
        pass
    else:
        for name in get_args(Window):
            if np.allclose(weights, window_weights(name, 64), rtol=0, atol=1e-9):
                return f"write {name}, which has the same weights"
        otherwise += "; only functions on plain arrays accept this window"
    word = window[0] if isinstance(window, tuple) and window else window
    return did_you_mean_fix(str(word), get_args(Window), otherwise)


def _check_number_of_weights(n: int, *, bytes_per_weight: int) -> None:
    """Raise `InvalidSetting` unless n is at least 1, `NotEnoughMemory` if weights do not fit."""
    check_integer("n", n, at_least=1)
    check_free_memory(
        f"a window of n={n} weights",
        needed_bytes=float(bytes_per_weight) * n,
        fix="give fewer weights",
    )


def _check_sidelobe_level(sidelobe_db: float) -> None:
    check_number("sidelobe_db", sidelobe_db, above=0, at_most=300)


@scalar_results
def coherent_gain(weights: ArrayLike) -> np.ndarray:
    """Return the coherent gain, the amplitude of a tone after windowing: sum(w) / N.

    Parameters
    ----------
    weights : array (..., n)
        Weights of windows, finite, with sums above 0.

    Returns
    -------
    array (...)
        Ratio of amplitudes of each window.
    """
    return _check_weights(weights, may_have_rows=True).mean(axis=-1)


@scalar_results
def noise_bandwidth_bins(weights: ArrayLike) -> np.ndarray:
    """Return the equivalent noise bandwidth N sum(w^2) / sum(w)^2, the SNR loss as a ratio.

    Parameters
    ----------
    weights : array (..., n)
        Weights of windows, finite, with sums above 0.

    Returns
    -------
    array (...)
        Bandwidth of each window in bins, at least 1.
    """
    weights = _check_weights(weights, may_have_rows=True)
    return weights.shape[-1] * np.sum(weights**2, axis=-1) / np.sum(weights, axis=-1) ** 2


@scalar_results
def scalloping_loss(weights: ArrayLike) -> np.ndarray:
    """Return the power of a tone on a bin over that of one half a bin off, at least 1.

    Parameters
    ----------
    weights : array (..., n)
        Weights of windows, finite, with sums above 0.

    Returns
    -------
    array (...)
        Ratio of powers of each window.
    """
    weights = _check_weights(weights, may_have_rows=True)
    n = weights.shape[-1]
    half_bin_shift = np.exp(1j * np.pi * np.arange(n) / n)
    return np.sum(weights, axis=-1) ** 2 / abs(np.sum(weights * half_bin_shift, axis=-1)) ** 2


def _check_weights(
    weights: ArrayLike, *, setting: str = "weights", may_have_rows: bool = False
) -> np.ndarray:
    """Return the weights of a window, (n,), or those of several, (..., n).

    Raises `InvalidSetting` unless their sums are above 0.
    """
    if isinstance(weights, str):
        raise InvalidSetting(
            setting,
            value=reprlib.repr(weights),
            expected="the weights of a window",
            fix=f"give the weights, such as window_weights({reprlib.repr(weights)}, n)",
        )
    values = check_finite_array(setting, weights)
    least_sum = values.sum(axis=-1).min()
    is_row = values.ndim > 0 if may_have_rows else values.ndim == 1
    if not (is_row and least_sum > 1e-60):
        alternative = ", or several rows of them" if may_have_rows else ""
        raise InvalidSetting(
            setting,
            value=f"an array {values.shape} with the sum {least_sum:g}",
            expected=f"one row of weights with a sum above 0{alternative}",
            fix="give the weights of one window, as of window_weights",
        )
    return values


@check_argument_types
def bin_correlation(weights: ArrayLike, n_bins: int, lags: ArrayLike) -> np.ndarray:
    """Return the correlation of white noise between bins of a windowed, zero-padded transform.

    rho(k) = sum_n w[n]^2 exp(-2 pi i k n / n_bins) / sum_n w[n]^2 for each lag k (bins, any
    shape); periodic in n_bins, as the bins are. Raises `InvalidSetting` unless lags are whole.

    Parameters
    ----------
    weights : array (n,)
        Weights of a window, finite, with a sum above 0.
    n_bins : int
        Bins of the transform, at least 1.
    lags : array of int
        Distances between bins k, in bins, of either sign.
    """
    weights = _check_weights(weights)
    check_integer("n_bins", n_bins, at_least=1)
    check_free_memory(
        f"a transform of n_bins={n_bins}", needed_bytes=72.0 * n_bins, fix="give fewer bins"
    )
    whole_lags = check_finite_array("lags", lags)
    for lag in whole_lags[whole_lags % 1 != 0]:
        check_integer("lags", float(lag), at_least=0)
    weight_fractions = weights**2 / np.sum(weights**2)
    # One transform gives all lags: 0.3 ms for 2,200 points, instead of 0.4 s of exponentials.
    wrapped = np.bincount(np.arange(weights.size) % n_bins, weight_fractions, n_bins)
    return np.asarray(np.fft.fft(wrapped)[(whole_lags % n_bins).astype(int)])

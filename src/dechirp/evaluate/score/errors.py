"""What scores of errors share: how far off the strongest detection of a target is."""

from typing import ClassVar, Literal

import numpy as np
from scipy.special import gammainccinv, gammaincinv, ndtri, stdtrit

from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.evaluate.accuracy import smallest_errors
from dechirp.evaluate.found import strongest
from dechirp.evaluate.independent import ratio
from dechirp.evaluate.look import Case, Look
from dechirp.evaluate.needed import must_have_targets
from dechirp.evaluate.score.base import NOTHING, Better, Estimate, Score
from dechirp.process.sources import aperture_of

Axis = Literal["range", "velocity", "azimuth", "elevation"]


@value
class Errors(Score):
    """Errors on one axis, of the strongest detection of a target in each frame.

    Frames in which a target is missed, or its detection tells nothing on the axis, do not
    count; nor do bodies, which have no one place to be off from.
    """

    axis: ClassVar[Axis]
    power: ClassVar[int]
    """Of the errors that are added."""
    n_sums: ClassVar[int] = 2

    def check(self, case: Case) -> None:
        """There must be points, and the radar and its chain must tell the axis."""
        must_have_targets(case, self.label())
        if all(target.body is not None for target in case.scene.targets):
            self._refuse(
                "in a scene of bodies alone",
                "a target without a body: a body has no one place to be off from",
                "Add a target without a body",
            )
        if self.axis == "velocity" and not case.radar.frame.tells_velocity:
            self._refuse("of one chirp", "several chirps, which tell velocities", "Send more")
        if self.axis in ("azimuth", "elevation"):
            self._check_angle(case)

    def _check_angle(self, case: Case) -> None:
        chain = case.chain
        if chain.angle is None:
            self._refuse(
                "with chain.angle none",
                "a direction estimator, and an array that tells directions",
                "Set chain.angle to {kind: fft}, with two virtual elements or more",
            )
        tells = aperture_of(case.radar, chain.field_of_view).tells
        if not tells[("azimuth", "elevation").index(self.axis)]:
            way = "to the side" if self.axis == "azimuth" else "in height"
            self._refuse(
                f"of an array that tells no {self.axis}",
                f"elements that lie apart {way}",
                "Correct radar.array",
            )

    def _refuse(self, got: str, need: str, fix: str) -> None:
        raise InvalidSetting(
            "scores",
            got=f"{self.label()}, {got}",
            need=need,
            fix=f"{fix}, or leave out {self.label()}.",
        )

    def sums(self, look: Look, case: Case) -> np.ndarray:
        """Sum of the errors, to the power, of each target, and their number."""
        at = strongest(look, case)
        units = {"range": "m", "velocity": "m_per_s"}
        off = getattr(look.match, f"{self.axis}_error_{units.get(self.axis, 'rad')}")[at]
        told = np.isfinite(off)
        of, n = look.match.target[at][told], len(case.names)
        return np.stack(
            [np.bincount(of, off[told] ** self.power, n), np.bincount(of, minlength=n)], axis=1
        )


@value
class Bias(Errors):
    """Mean of the errors."""

    power: ClassVar[int] = 1

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """Student's interval for what trials scatter, see `independent.ratio`."""
        return ratio(*sums[_told(sums)].T, confidence=confidence)

    def theory(self, case: Case) -> np.ndarray:
        """None, where errors have a bound: estimates are the likeliest values."""
        return 0.0 * smallest_errors(case)[self.axis]


@value
class Rmse(Errors):
    """Root of the mean square of the errors."""

    better: ClassVar[Better] = "less"
    power: ClassVar[int] = 2

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        r"""Chi-square interval, for as many independent normal errors as trials are worth.

        .. math:: \nu = 2 q^2 / \mathrm{var}(q), \quad
            \mathrm{var}(q) = \frac{n}{n - 1} \frac{\sum (s_t - q c_t)^2}{(\sum c_t)^2}

        with s_t the sum of squares and c_t the number of errors of trial t, q = sum s / sum c
        (Satterthwaite 1946): about the number of errors where they are normal and independent,
        and never more; less where errors of a trial belong together, or some are far out. Times
        the square of the normal over Student's quantile, as the variance is known from n trials
        only; one error at the least, which is what one trial is worth.
        """
        squares, counts = sums[_told(sums)].T
        if not len(counts):
            return NOTHING
        n, tail, mean = len(counts), (1 - confidence) / 2, squares.sum() / counts.sum()
        worth, variance = 1.0, 0.0
        if n > 1:
            spread = np.sum((squares - mean * counts) ** 2) * n / (n - 1)
            variance = float(spread / counts.sum() ** 2)
            known = ndtri(tail) / stdtrit(n - 1, tail)
            worth = float(counts.sum())
            if variance > 0:
                worth = max(min(worth, 2 * mean**2 / variance) * known**2, 1.0)
        half = worth / 2
        low, high = (mean * half / of for of in (gammainccinv(half, tail), gammaincinv(half, tail)))
        return Estimate(*np.sqrt([mean, low, high]).tolist())

    def theory(self, case: Case) -> np.ndarray:
        """The Cramer-Rao bound, see `accuracy.smallest_errors`."""
        return smallest_errors(case)[self.axis]

    def together(self, theory: np.ndarray) -> float:
        """Theory of several targets together: none, as it hangs on how often each is found."""
        return float(theory[0]) if len(theory) == 1 else np.nan


def _told(sums: np.ndarray) -> np.ndarray:
    """Trials with errors: those that failed are NaN, and one may have found nothing."""
    return np.asarray(np.nan_to_num(sums[:, 1]) > 0)

"""The radar's own motion, from the detections of one frame: most of what there is stands still."""

import math

import numpy as np
import xarray as xr
from scipy.special import chdtri

from dechirp.core.checks import count, number, positive, probability, whole
from dechirp.core.values import value
from dechirp.process.columns import columns, is_frame_number, must_be, must_hold
from dechirp.process.sources import from_origin, is_sure, middle_m
from dechirp.radar.folds import n_told, span_m_per_s
from dechirp.radar.radar import Radar
from dechirp.tracking.doppler_fit import Fit, Sighted, fit, residuals
from dechirp.tracking.motion import UNITS, motions

_NEEDED = ("frame", "range", "velocity", "azimuth", "velocity_std", "azimuth_std")
_OTHERS = ("time", "elevation", "elevation_std", "fold")

# Another velocity might as well be it unless it is e^10 times less likely: 20 in chi-squares.
_RIVAL = 20.0
_MOST_HYPOTHESES = 200_000
_FASTEST_M_PER_S = 1e5
_AT_ONCE = 2**20  # residuals: 8 MiB


@value
class EgoMotion:
    """How the velocity of the radar is found among detections that stand still and that move."""

    gate_probability: float = 0.997
    """How much of what stands still is taken for it: three standard errors."""
    tolerance_m_per_s: float = 0.1
    """What static detections may be off, as a standard deviation, besides their own: heights
    that the array does not tell, two posts in one cell."""
    min_static: int = 5
    """Fewer tell nothing."""
    min_share: float = 0.5
    """Of all detections that must agree. Below a half a convoy may be taken for the road."""
    min_spread_rad: float = math.radians(2)
    """Standard deviation of azimuths. Less is one direction, and velocity across it untold."""
    max_speed_m_per_s: float = 80.0
    """Of the radar; where folds are not known, one of those within it."""
    n_draws: int = 200
    """Pairs of detections that are tried. With a share of 0.5 none of 200 pairs is static once
    in 1e25 frames."""
    seed: int = 0
    """Of the draws; those of a frame depend on its number and not on other frames."""

    def __post_init__(self) -> None:
        probability("EgoMotion.gate_probability", self.gate_probability)
        positive(self, "tolerance_m_per_s", "max_speed_m_per_s", at_most=1e4)
        count(self, "min_static", at_least=3)
        share = number("EgoMotion.min_share", self.min_share, above=0.0, at_most=1.0)
        object.__setattr__(self, "min_share", share)
        positive(self, "min_spread_rad", at_most=math.pi / 2)
        count(self, "n_draws", at_most=100_000)
        whole("EgoMotion.seed", self.seed, at_least=0, at_most=2**63 - 1)

    @property
    def gate(self) -> float:
        """Squares of residuals over their variances that pass."""
        return float(chdtri(1, 1 - self.gate_probability))


_DEFAULT = EgoMotion()


def ego_motion(detections: xr.Dataset, radar: Radar, settings: EgoMotion = _DEFAULT) -> xr.Dataset:
    r"""Velocity of the radar in each frame, by what most of its detections agree on.

    What stands still has the radial velocity

    .. math:: v_i = -(v_x \cos\phi_i + v_y \sin\phi_i) \cos\theta_i

    with (v_x, v_y) the velocity of the radar itself along its own axes, x where it looks: not
    that of the car's axle, from which it differs by the yaw rate times the way between them.
    So :math:`\sqrt{v_x^2 + v_y^2}` is its speed, and the direction that it moves in tells
    the angle at which it is mounted, see `mounting`. Vertical motion is left out.

    Pairs of detections give hypotheses, all detections vote; those that agree with the best are
    fitted by least squares with the errors of both velocities and azimuths, see
    `tracking.doppler_fit`.

    Parameters
    ----------
    detections : Dataset over `detection`
        As `detect` gives them, with azimuths and standard errors. Those whose direction is not
        sure, since the fold of the velocity is not and transmitters share the frame, do not
        count. Without elevations the angle of a row counts, as if all were on its level.
    radar : Radar
        For the folds: where they are not known, residuals are taken modulo what is.
    settings : EgoMotion, optional

    Returns
    -------
    Dataset over `frame`
        Frames that have detections. `vx vy` (m/s), `vx_std vy_std` (m/s),
        `vx_vy_covariance` (m^2/s^2) and `n_static`, how many agree; `time` (s) of each.
        NaN, and n_static 0, where it cannot tell: too few agree, they are no majority, they lie
        in one direction, or another velocity is as likely, as where folds are not known.

    Raises
    ------
    InvalidSetting
        If a column is missing or holds what it cannot.

    References
    ----------
    D. Kellner, M. Barjenbruch, J. Klappstein, J. Dickmann, K. Dietmayer, Instantaneous
    ego-motion estimation using Doppler radar, IEEE ITSC 2013. M. Fischler and R. Bolles, Random
    sample consensus, Communications of the ACM 24(6), 1981; votes are weighed as by P. Torr and
    A. Zisserman, MLESAC, Computer Vision and Image Understanding 78(1), 2000.
    """
    told = _checked(detections, radar, settings)
    numbers = np.unique(told["frame"]).astype(np.int64)
    found = np.full((5, numbers.size), np.nan)
    n_static, time_s = np.zeros(numbers.size, np.int64), np.full(numbers.size, np.nan)
    for place, frame in enumerate(numbers.tolist()):
        own = {name: column[told["frame"] == frame] for name, column in told.items()}
        time_s[place] = own["time"][0]
        sighted = _sighted(own, radar, frame)
        rng = np.random.default_rng([settings.seed, frame])
        agreed = _agreed(sighted.of(_counts(own, radar)), settings, rng)
        if agreed is not None:
            (vx, vy), ((var_x, cov), (_, var_y)) = agreed.velocity, agreed.covariance
            found[:, place] = vx, vy, math.sqrt(var_x), math.sqrt(var_y), cov
            n_static[place] = agreed.n
    return xr.Dataset(
        {
            **{
                name: ("frame", column, {"units": unit})
                for (name, unit), column in zip(UNITS.items(), found, strict=True)
            },
            "n_static": ("frame", n_static, {"units": "1"}),
        },
        coords={"frame": numbers, "time": ("frame", time_s, {"units": "s"})},
    )


def labelled(
    detections: xr.Dataset, ego: xr.Dataset, radar: Radar, settings: EgoMotion = _DEFAULT
) -> xr.Dataset:
    """Detections with `motion`: "static", "moving", or "" where that is not known.

    Static is what agrees with the motion of the radar: its residual within the gate, with the
    variances of velocity, azimuth, elevation, tolerance, and of the motion itself. So what moves
    across the line of sight is static too. Not known: without an azimuth, in frames whose motion
    is not, and where the direction is not sure and disagrees.

    Parameters
    ----------
    detections, radar, settings
        As for `ego_motion`.
    ego : Dataset over `frame`
        From `ego_motion`; of frames that it lacks nothing is known.

    Raises
    ------
    InvalidSetting
        If a column of either is missing or holds what it cannot.
    """
    told = _checked(detections, radar, settings)
    motion = np.full(detections.sizes["detection"], "", dtype="<U6")
    known = motions(ego).T
    of_frame = dict(zip(ego["frame"].values.tolist(), known, strict=True))
    for frame in np.unique(told["frame"]).astype(int).tolist():
        vx, vy, vx_std, vy_std, cov = of_frame.get(frame, np.full(len(UNITS), np.nan))
        rows = told["frame"] == frame
        own = {name: column[rows] for name, column in told.items()}
        sighted = _sighted(own, radar, frame)
        towards = sighted.towards(sighted.azimuth_rad)
        off, variance = residuals(sighted, np.array([vx, vy]))
        of_motion = np.array([[vx_std**2, cov], [cov, vy_std**2]])
        variance = variance + np.einsum("ni,ij,nj->n", towards, of_motion, towards)
        squares = off**2 / (variance + settings.tolerance_m_per_s**2)
        moves = (squares > settings.gate) & is_sure(own["fold"], radar.frame)  # NaN is neither
        motion[rows] = np.where(squares <= settings.gate, "static", np.where(moves, "moving", ""))
    return detections.assign(motion=("detection", motion))


def _checked(detections: xr.Dataset, radar: Radar, settings: EgoMotion) -> dict[str, np.ndarray]:
    """Columns of detections, or `InvalidSetting`."""
    must_be("radar", radar, Radar, fix="Give the radar that they were detected with.")
    must_be("settings", settings, EgoMotion, fix="Give EgoMotion(), or leave it out.")
    told = columns(detections, _NEEDED, _OTHERS)
    must_hold(
        told,
        {
            "frame": (is_frame_number(told["frame"]), "the number of a frame, 0 or more"),
            "range": (np.isfinite(told["range"]), "a finite number"),
            # Each fold up to it would be a hypothesis.
            "velocity": (~(abs(told["velocity"]) > _FASTEST_M_PER_S), "at most 1e5 m/s, or NaN"),
            "velocity_std": (~(told["velocity_std"] <= 0), "above 0, or NaN"),
            "azimuth_std": (~(told["azimuth_std"] < 0), "0 or more, or NaN"),
        },
    )
    return told


def _sighted(own: dict[str, np.ndarray], radar: Radar, frame: int) -> Sighted:
    """What the fit needs of the detections of one frame."""
    span = span_m_per_s(own["range"], radar.at(frame).frame)
    # Velocities are towards the middle of the array: at 15 m, 3 mm beside the origin are 0.013 deg.
    middle = middle_m(own["azimuth"], own["elevation"], own["fold"], radar)
    place = own["range"], own["azimuth"], own["elevation"]
    _, azimuth, elevation = from_origin(*place, -middle)
    return Sighted(
        velocity_m_per_s=own["velocity"],
        azimuth_rad=azimuth,
        elevation_rad=np.nan_to_num(elevation),
        velocity_std=own["velocity_std"],
        azimuth_std=own["azimuth_std"],
        elevation_std=np.nan_to_num(own["elevation_std"]),
        period_m_per_s=span * n_told(own["fold"], radar.frame, frame),
    )


def _counts(own: dict[str, np.ndarray], radar: Radar) -> np.ndarray:
    """Which detections have a vote, (n,): those of a known direction and velocity."""
    names = ("velocity", "azimuth", "velocity_std", "azimuth_std")
    known = np.isfinite([own[name] for name in names]).all(axis=0)
    return np.asarray(known & is_sure(own["fold"], radar.frame))


def _agreed(sighted: Sighted, settings: EgoMotion, rng: np.random.Generator) -> Fit | None:
    """What most of the detections of a frame say; none where that is not clear."""
    n = sighted.azimuth_rad.size
    least = max(settings.min_static, math.ceil(settings.min_share * n))
    if n < settings.min_static:
        return None
    hypotheses = _hypotheses(sighted, settings, rng)
    if not len(hypotheses):
        return None
    cost = _costs(sighted, hypotheses, settings)
    velocity = hypotheses[cost.argmin()]
    static = np.zeros(n, bool)
    for _ in range(10):
        agree = _agree(sighted, velocity, settings)
        if agree.sum() < least or sighted.azimuth_rad[agree].std() < settings.min_spread_rad:
            return None
        if (agree == static).all():
            break
        static = agree
        found = fit(sighted.of(static), velocity)
        velocity = found.velocity
    is_sole = not _has_rival(sighted, sighted.of(static), velocity, hypotheses, cost, settings)
    return found if is_sole else None


def _hypotheses(sighted: Sighted, settings: EgoMotion, rng: np.random.Generator) -> np.ndarray:
    """Velocities that pairs of detections would have if they stood still, (n, 2), in any fold."""
    n, most = sighted.azimuth_rad.size, settings.max_speed_m_per_s
    velocity, period = sighted.velocity_m_per_s, sighted.period_m_per_s
    n_folds = int(np.ceil((most + abs(velocity)) / period).max())
    folds = np.arange(-n_folds, n_folds + 1)
    n_draws = min(settings.n_draws, _MOST_HYPOTHESES // folds.size**2)
    first = rng.integers(n, size=n_draws)
    second = (first + rng.integers(1, n, size=n_draws)) % n
    radial = [velocity[of, None] + period[of, None] * folds for of in (first, second)]
    draw, one, other = np.nonzero(
        (abs(radial[0]) <= most)[:, :, None] & (abs(radial[1]) <= most)[:, None, :]
    )
    a, b = radial[0][draw, one], radial[1][draw, other]
    towards = sighted.towards(sighted.azimuth_rad)
    (ax, ay), (bx, by) = towards[first[draw]].T, towards[second[draw]].T
    across = ax * by - ay * bx
    with np.errstate(divide="ignore", invalid="ignore"):  # both in one direction
        made = np.stack([ay * b - by * a, bx * a - ax * b], axis=-1) / across[:, None]
        return made[np.hypot(*made.T) <= most]


def _costs(sighted: Sighted, velocities: np.ndarray, settings: EgoMotion) -> np.ndarray:
    """Squares of residuals over variances, each at most the gate, summed, (n_velocities,)."""
    at_once = max(_AT_ONCE // sighted.azimuth_rad.size, 1)
    costs = np.empty(len(velocities))
    for begin in range(0, len(velocities), at_once):
        some = slice(begin, begin + at_once)
        off, variance = residuals(sighted, velocities[some, None])
        squares = off**2 / (variance + settings.tolerance_m_per_s**2)
        costs[some] = np.minimum(squares, settings.gate).sum(axis=-1)
    return costs


def _agree(sighted: Sighted, velocity: np.ndarray, settings: EgoMotion) -> np.ndarray:
    """Which detections would stand still, (n,)."""
    off, variance = residuals(sighted, velocity)
    return np.asarray(off**2 <= settings.gate * (variance + settings.tolerance_m_per_s**2))


def _has_rival(
    sighted: Sighted,
    static: Sighted,
    velocity: np.ndarray,
    hypotheses: np.ndarray,
    cost: np.ndarray,
    settings: EgoMotion,
) -> bool:
    """Whether a hypothesis far outside of the errors of a velocity is almost as likely.

    Near it the cost grows by the square of the distance in standard errors.
    """
    _, variance = residuals(static, velocity)
    towards = static.towards(static.azimuth_rad)
    weight = 1 / (variance + settings.tolerance_m_per_s**2)
    apart = hypotheses - velocity
    squares = np.einsum("hi,ij,hj->h", apart, (towards.T * weight) @ towards, apart)
    best = _costs(sighted, velocity[None], settings)[0]
    return bool(((squares > 2 * _RIVAL) & (cost < best + _RIVAL)).any())

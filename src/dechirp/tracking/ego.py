"""Ego motion of the radar from the static detections of one frame."""

import math

import numpy as np
import scipy
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import (
    check_integer,
    check_integer_fields,
    check_number,
    check_positive_fields,
    check_probability,
)
from dechirp.core.detection_columns import (
    check_detection_rows,
    check_type,
    detection_columns_as_floats,
    valid_frame_number_mask,
)
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.processing.direction_finding import (
    known_direction_mask,
    phase_centres_m,
    range_and_direction_from_origin,
)
from dechirp.radar.radar import Radar
from dechirp.radar.velocity_ambiguity import (
    n_spans_until_aliasing,
    unambiguous_velocity_span_m_per_s,
)
from dechirp.tracking.doppler_fit import (
    Sightings,
    VelocityEstimate,
    fit_radar_velocity,
    static_velocity_residuals_and_variances,
)

EGO_UNITS = {
    "vx": "m/s",
    "vy": "m/s",
    "vx_std": "m/s",
    "vy_std": "m/s",
    "vx_vy_covariance": "m2/s2",
}
"""Columns of the table of the radar's own motion, and their units."""
VERTICAL_UNITS = {
    "vz": "m/s",
    "vz_std": "m/s",
    "vx_vz_covariance": "m2/s2",
    "vy_vz_covariance": "m2/s2",
}
"""Further columns with `EgoMotion.with_vertical`."""

_REQUIRED = ("frame", "range", "velocity", "azimuth", "velocity_std", "azimuth_std")
_OPTIONAL = ("time", "elevation", "elevation_std", "ambiguity_number", "number")

# A rival velocity must be e^10 times less likely: 20 in chi-squares.
_RIVAL_COST = 20.0
# A second velocity with a third of the supporters, among the other detections, may be the true one.
_RIVAL_SHARE = 1 / 3
# Residuals of static detections end at the gate; those of traffic go on. Of normal errors 0.3 % lie
# between the gate and twice it, of uniform ones as many as within.
_MAX_SHARE_BEYOND_GATE = 0.2
_MAX_HYPOTHESES = 200_000
_MAX_VELOCITY_M_PER_S = 1e5
_UNAMBIGUOUS_M_PER_S = 1e9  # a period that no velocity reaches
_MIN_VOLUME = 1e-9  # of three directions; smaller ones determine no velocity
_ROUNDING = 1e-6  # of sums of shares
_RESIDUALS_PER_BLOCK = 2**20  # 8 MiB


@frozen_dataclass
class EgoMotion:
    """Settings of the ego motion estimate from static and moving detections."""

    gate_probability: float = 0.997
    """Probability that a static detection passes the gate: three standard errors."""
    tolerance_m_per_s: float = 0.1
    """Standard deviation of static velocities beyond their own errors: unknown heights, two posts
    in one cell."""
    min_static: int = 5
    """Least number of static detections."""
    min_share: float = 0.5
    """Least share of static detections. Below a half, a convoy may be taken for the road."""
    min_spread_rad: float = math.radians(2)
    """Least standard deviation of azimuths: detections in one direction do not determine the
    velocity across it."""
    max_speed_m_per_s: float = 80.0
    """Largest speed of the radar; limits the hypotheses of ambiguous velocities."""
    with_vertical: bool = False
    """Whether the vertical velocity is estimated, from detections with an elevation alone. Their
    elevations must spread like the azimuths."""
    n_draws: int = 200
    """Pairs of detections that are drawn; triples with the vertical velocity, of which none of 200
    is static in one of 1e11 frames. With a static share of 0.5, no pair of 200 is static in
    one of 1e25 frames."""
    seed: int = 0
    """Seed of the draws, which depend on the number of the frame and not on other frames."""

    def __post_init__(self) -> None:
        check_probability("EgoMotion.gate_probability", self.gate_probability)
        check_positive_fields(self, "tolerance_m_per_s", "max_speed_m_per_s", at_most=1e4)
        check_integer_fields(self, "min_static", at_least=3)
        share = check_number("EgoMotion.min_share", self.min_share, above=0.0, at_most=1.0)
        object.__setattr__(self, "min_share", share)
        check_positive_fields(self, "min_spread_rad", at_most=math.pi / 2)
        if not isinstance(self.with_vertical, bool | np.bool_):
            raise InvalidSetting(
                "EgoMotion.with_vertical",
                value=repr(self.with_vertical),
                expected="true or false",
                fix="write true if the array measures elevations",
            )
        check_integer_fields(self, "n_draws", at_most=100_000)
        check_integer("EgoMotion.seed", self.seed, at_least=0, at_most=2**63 - 1)

    @property
    def max_normalised_squared_residual(self) -> float:
        """Largest squared residual over its variance that passes."""
        return float(scipy.special.chdtri(1, 1 - self.gate_probability))


_DEFAULT = EgoMotion()


@check_argument_types
def ego_motion(
    detections: xr.Dataset, radar: Radar | None, settings: EgoMotion = _DEFAULT
) -> xr.Dataset:
    r"""Estimate the velocity of the radar in each frame from its static detections.

    A static target has the radial velocity

    .. math:: v_i = -(v_x \cos\phi_i + v_y \sin\phi_i) \cos\theta_i

    with (v_x, v_y) the velocity of the radar itself along its own axes, x its boresight: not that
    of the car's axle, from which it differs by the yaw rate times the distance between them.
    So :math:`\sqrt{v_x^2 + v_y^2}` is its speed, and the direction of motion determines the
    mounting angle, see `mounting`. Vertical motion is left out, unless `with_vertical` adds
    :math:`- v_z \sin\theta_i`.

    Pairs of detections give hypotheses, all detections vote; those that agree with the best are
    fitted by least squares with the errors of both velocities and azimuths, see
    `tracking.doppler_fit`.

    Any two directions agree with some velocity, so the static detections need two directions more
    than components, `min_spread_rad` apart. Cars that keep together agree with a velocity, too:
    the result is NaN if a third as many of the other detections agree with a second one, or if
    many residuals lie just beyond the gate. Traffic of one common velocity, without a third as
    many static detections beside it, cannot be told from a static scene.

    Parameters
    ----------
    detections : Dataset over `detection`
        Detections from `detect`, with azimuths and standard errors. Those with unknown direction,
        because their ambiguity number is unknown under multiplexing, are ignored. Without
        elevations, all detections are assumed level with the radar. With `number`, several
        detections of one object in a frame count as one, and their errors as equal.
    radar : Radar or None
        For the velocity ambiguity: residuals are taken modulo the unambiguous span. None for lists
        of a vendor's radar, whose velocities and directions are resolved.
    settings : EgoMotion, optional

    Returns
    -------
    Dataset over `frame`
        Frames that have detections. `vx vy` (m/s), `vx_std vy_std` (m/s),
        `vx_vy_covariance` (m^2/s^2) and `n_static`, the number of static detections; `time` (s).
        With the vertical velocity also `vz vz_std vx_vz_covariance vy_vz_covariance`.
        NaN, and n_static 0, if the velocity is undetermined: too few static detections, no
        majority, too few directions, a speed above the largest, or another velocity as likely, as
        with unknown ambiguity numbers or in dense traffic.

    Raises
    ------
    InvalidSetting
        If a column is missing or has invalid values.

    References
    ----------
    D. Kellner, M. Barjenbruch, J. Klappstein, J. Dickmann, K. Dietmayer, Instantaneous
    ego-motion estimation using Doppler radar, IEEE ITSC 2013. M. Fischler and R. Bolles, Random
    sample consensus, Communications of the ACM 24(6), 1981; votes are weighed as by P. Torr and
    A. Zisserman, MLESAC, Computer Vision and Image Understanding 78(1), 2000.
    """
    columns = _checked_detection_columns(detections, radar, settings)
    numbers = np.unique(columns["frame"]).astype(np.int64)
    units = {**EGO_UNITS, **(VERTICAL_UNITS if settings.with_vertical else {})}
    motion = np.full((len(units), numbers.size), np.nan)
    n_static, time_s = np.zeros(numbers.size, np.int64), np.full(numbers.size, np.nan)
    for index, frame in enumerate(numbers.tolist()):
        frame_columns = {
            name: column[columns["frame"] == frame] for name, column in columns.items()
        }
        time_s[index] = frame_columns["time"][0]
        sightings = _frame_columns_to_sightings(frame_columns, radar, frame)
        rng = np.random.default_rng([settings.seed, frame])
        is_usable = _usable_detection_mask(frame_columns, radar, settings)
        estimate = _estimate_radar_velocity_by_ransac(
            sightings.select_detections(is_usable),
            _share_of_each_detection(frame_columns["number"][is_usable]),
            settings,
            rng,
        )
        if estimate is not None:
            motion[:, index] = _motion_columns(estimate)
            n_static[index] = estimate.n_detections
    return xr.Dataset(
        {
            **{
                name: ("frame", column, {"units": unit})
                for (name, unit), column in zip(units.items(), motion, strict=True)
            },
            "n_static": ("frame", n_static, {"units": "1"}),
        },
        coords={"frame": numbers, "time": ("frame", time_s, {"units": "s"})},
    )


def _motion_columns(estimate: VelocityEstimate) -> list[float]:
    """Return a velocity and its covariance in the order of the columns."""
    velocity, covariance = estimate.velocity, estimate.covariance
    std = np.sqrt(np.diag(covariance))
    columns = [*velocity[:2], *std[:2], covariance[0, 1]]
    return columns + ([velocity[2], std[2], *covariance[:2, 2]] if len(velocity) == 3 else [])


def label_static_and_moving(
    detections: xr.Dataset, ego: xr.Dataset, radar: Radar | None, settings: EgoMotion = _DEFAULT
) -> xr.Dataset:
    """Label detections with `motion`: "static", "moving", or "" if unknown.

    A static detection agrees with the motion of the radar: its residual is within the gate, given
    the variances of velocity, azimuth, elevation, tolerance, and of the motion itself. A target
    that moves across the line of sight has no radial velocity, so it is classified as static.
    Unknown without an azimuth, in frames without ego motion, and where the direction is ambiguous
    and disagrees.

    Parameters
    ----------
    detections, radar, settings
        As for `ego_motion`.
    ego : Dataset over `frame`
        From `ego_motion`; motion is unknown in missing frames.

    Raises
    ------
    InvalidSetting
        If a column of either is missing or has invalid values.
    """
    columns = _checked_detection_columns(detections, radar, settings)
    motion = np.full(detections.sizes["detection"], "", dtype="<U6")
    velocities, covariances = _velocities_and_covariances(ego)
    n_axes = velocities.shape[1]
    index_of = {number: index for index, number in enumerate(ego["frame"].values.tolist())}
    for frame in np.unique(columns["frame"]).astype(int).tolist():
        rows = columns["frame"] == frame
        if frame not in index_of:
            continue
        frame_columns = {name: column[rows] for name, column in columns.items()}
        sightings = _frame_columns_to_sightings(frame_columns, radar, frame)
        towards = sightings.direction_components(n_axes)
        velocity, of_motion = velocities[index_of[frame]], covariances[index_of[frame]]
        residual, variance = static_velocity_residuals_and_variances(sightings, velocity)
        variance = variance + np.einsum("ni,ij,nj->n", towards, of_motion, towards)
        squares = residual**2 / (variance + settings.tolerance_m_per_s**2)
        # NaN is neither.
        moves = (squares > settings.max_normalised_squared_residual) & _known_number_mask(
            frame_columns, radar
        )
        motion[rows] = np.where(
            squares <= settings.max_normalised_squared_residual,
            "static",
            np.where(moves, "moving", ""),
        )
    return detections.assign(motion=("detection", motion))


def _velocities_and_covariances(ego: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Return velocities (frame, axis) and covariances (frame, axis, axis), two axes or three."""
    vx, vy, vx_std, vy_std, covariance = ego_velocity_and_covariance_columns(ego)
    rows = [[vx_std**2, covariance], [covariance, vy_std**2]]
    velocity = [vx, vy]
    if set(VERTICAL_UNITS) <= set(ego.variables):
        vz, vz_std, xz, yz = (ego[name].values.astype(float) for name in VERTICAL_UNITS)
        velocity.append(vz)
        rows = [[*rows[0], xz], [*rows[1], yz], [xz, yz, vz_std**2]]
    return np.stack(velocity, axis=-1), np.moveaxis(np.array(rows), -1, 0)


def ego_velocity_and_covariance_columns(ego: xr.Dataset) -> np.ndarray:
    """Return the columns of `EGO_UNITS`, (5, n_frames); NaN where the motion is unknown.

    Raises `InvalidSetting` if a column is missing.
    """
    problem = None
    if not isinstance(ego, xr.Dataset):
        problem = f"a {type(ego).__name__}"
    elif missing := [name for name in ("frame", *EGO_UNITS) if name not in ego]:
        problem = f"a dataset without {', '.join(missing)}"
    if problem is not None:
        raise InvalidSetting(
            "ego",
            value=problem,
            expected="the motion of each frame",
            fix="pass what `ego_motion` returns",
        )
    return np.array([ego[name].values for name in EGO_UNITS], dtype=float)


def _checked_detection_columns(
    detections: xr.Dataset, radar: Radar | None, settings: EgoMotion
) -> dict[str, np.ndarray]:
    """Return the columns of detections; raise `InvalidSetting` if one is invalid."""
    if radar is not None:
        check_type("radar", radar, Radar, fix="give the radar that they were detected with")
    check_type("settings", settings, EgoMotion, fix="give EgoMotion(), or leave it out")
    columns = detection_columns_as_floats(detections, _REQUIRED, _OPTIONAL)
    check_detection_rows(
        columns,
        {
            "frame": (
                valid_frame_number_mask(columns["frame"]),
                "the number of a frame, 0 or more",
            ),
            "range": (np.isfinite(columns["range"]), "a finite number"),
            # Each alias up to it is a hypothesis.
            "velocity": (
                ~(abs(columns["velocity"]) > _MAX_VELOCITY_M_PER_S),
                "at most 1e5 m/s, or NaN",
            ),
            "velocity_std": (~(columns["velocity_std"] <= 0), "above 0, or NaN"),
            "azimuth_std": (~(columns["azimuth_std"] < 0), "0 or more, or NaN"),
        },
    )
    return columns


def _frame_columns_to_sightings(
    frame_columns: dict[str, np.ndarray], radar: Radar | None, frame: int
) -> Sightings:
    """Convert the columns of one frame to sightings for the fit."""
    azimuth, elevation = frame_columns["azimuth"], frame_columns["elevation"]
    period = np.full(azimuth.shape, _UNAMBIGUOUS_M_PER_S)
    if radar is not None:
        azimuth, elevation, period = _directions_from_array_and_periods(frame_columns, radar, frame)
    return Sightings(
        velocity_m_per_s=frame_columns["velocity"],
        azimuth_rad=azimuth,
        elevation_rad=np.nan_to_num(elevation),
        velocity_std=frame_columns["velocity_std"],
        azimuth_std=frame_columns["azimuth_std"],
        elevation_std=np.nan_to_num(frame_columns["elevation_std"]),
        period_m_per_s=period,
    )


def _directions_from_array_and_periods(
    frame_columns: dict[str, np.ndarray], radar: Radar, frame: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return azimuths and elevations from the middle of the array, and periods of velocities."""
    span = unambiguous_velocity_span_m_per_s(frame_columns["range"], radar.for_frame(frame).frame)
    # Velocities refer to the middle of the array: at 15 m, an offset of 3 mm is 0.013 deg.
    middle = phase_centres_m(
        frame_columns["azimuth"],
        frame_columns["elevation"],
        frame_columns["ambiguity_number"],
        radar,
    )
    place = frame_columns["range"], frame_columns["azimuth"], frame_columns["elevation"]
    _, azimuth, elevation = range_and_direction_from_origin(*place, -middle)
    period = span * n_spans_until_aliasing(frame_columns["ambiguity_number"], radar.frame, frame)
    return azimuth, elevation, period


def _known_number_mask(frame_columns: dict[str, np.ndarray], radar: Radar | None) -> np.ndarray:
    """Return True where the ambiguity number is known as far as directions depend on it."""
    if radar is None:
        return np.ones(frame_columns["azimuth"].shape, bool)
    return known_direction_mask(frame_columns["ambiguity_number"], radar.frame)


def _usable_detection_mask(
    frame_columns: dict[str, np.ndarray], radar: Radar | None, settings: EgoMotion
) -> np.ndarray:
    """Return the mask of detections with known direction and velocity, (n,)."""
    vertical = ("elevation", "elevation_std") if settings.with_vertical else ()
    names = ("velocity", "azimuth", "velocity_std", "azimuth_std", *vertical)
    is_known = np.isfinite([frame_columns[name] for name in names]).all(axis=0)
    return np.asarray(is_known & _known_number_mask(frame_columns, radar))


def _share_of_each_detection(number: np.ndarray) -> np.ndarray:
    """Return 1 over the number of detections of the same object, (n,); 1 for unknown objects."""
    _, index, counts = np.unique(number, equal_nan=False, return_inverse=True, return_counts=True)
    return np.asarray(1 / counts[index])


def _estimate_radar_velocity_by_ransac(
    sightings: Sightings, share: np.ndarray, settings: EgoMotion, rng: np.random.Generator
) -> VelocityEstimate | None:
    """Estimate the velocity from most detections of a frame; None if undetermined.

    `share` is the part of a vote that each detection has.
    """
    n_votes = share.sum() + _ROUNDING
    min_votes = max(settings.min_static, math.ceil(settings.min_share * n_votes - 2 * _ROUNDING))
    if n_votes < settings.min_static:
        return None
    if settings.with_vertical:
        hypotheses = _radar_velocity_hypotheses_from_triples(sightings, settings, rng)
    else:
        hypotheses = _radar_velocity_hypotheses_from_pairs(sightings, settings, rng)
    if not len(hypotheses):
        return None
    cost = _truncated_residual_costs(sightings, share, hypotheses, settings)
    velocity = hypotheses[cost.argmin()]
    static = np.zeros(share.size, bool)
    for _ in range(10):
        is_static = _static_detection_mask(sightings, velocity, settings)
        if share[is_static].sum() + _ROUNDING < min_votes or not _determines_velocity(
            sightings.select_detections(is_static), settings
        ):
            return None
        if (is_static == static).all():
            break
        static = is_static
        estimate = fit_radar_velocity(sightings.select_detections(static), velocity)
        velocity = estimate.velocity
    if (
        np.linalg.norm(velocity) > settings.max_speed_m_per_s
        or _has_rival_velocity_hypothesis(
            sightings, share, static, velocity, hypotheses, cost, settings
        )
        or _has_no_gap_at_gate(sightings, share, velocity, settings)
        or _has_second_velocity(sightings, share, static, hypotheses, settings)
    ):
        return None
    # Errors of one object are equal, at worst: its detections count as one.
    n_per_vote = static.sum() / share[static].sum()
    return estimate._replace(covariance=estimate.covariance * n_per_vote)


def _determines_velocity(static: Sightings, settings: EgoMotion) -> bool:
    """Return whether the directions of detections determine all components of the velocity."""
    angles = [static.azimuth_rad, *([static.elevation_rad] * settings.with_vertical)]
    if min(angle.std() for angle in angles) < settings.min_spread_rad:
        return False
    cells = np.unique(np.floor_divide(angles, settings.min_spread_rad), axis=1)
    return cells.shape[1] >= 3 + len(angles)


def _has_no_gap_at_gate(
    sightings: Sightings, share: np.ndarray, velocity: np.ndarray, settings: EgoMotion
) -> bool:
    """Return whether many residuals lie just beyond the gate, as if it cut through traffic."""
    residual, variance = static_velocity_residuals_and_variances(sightings, velocity)
    squares = residual**2 / (variance + settings.tolerance_m_per_s**2)
    within = squares <= settings.max_normalised_squared_residual
    beyond = ~within & (squares <= 4 * settings.max_normalised_squared_residual)
    return bool(share[beyond].sum() > _MAX_SHARE_BEYOND_GATE * share[within].sum())


def _has_second_velocity(
    sightings: Sightings,
    share: np.ndarray,
    static: np.ndarray,
    hypotheses: np.ndarray,
    settings: EgoMotion,
) -> bool:
    """Return whether many of the other detections agree with a velocity, as those of a convoy."""
    others, share_of_others = sightings.select_detections(~static), share[~static]
    needed = max(settings.min_static, _RIVAL_SHARE * share[static].sum()) - _ROUNDING
    if share_of_others.sum() < needed:
        return False
    cost = _truncated_residual_costs(others, share_of_others, hypotheses, settings)
    agrees = _static_detection_mask(others, hypotheses[cost.argmin()], settings)
    return bool(share_of_others[agrees].sum() >= needed) and _determines_velocity(
        others.select_detections(agrees), settings
    )


def _radar_velocity_hypotheses_from_pairs(
    sightings: Sightings, settings: EgoMotion, rng: np.random.Generator
) -> np.ndarray:
    """Return velocities of the radar for which pairs of detections are static, (n, 2)."""
    n, max_speed = sightings.azimuth_rad.size, settings.max_speed_m_per_s
    velocity, period = sightings.velocity_m_per_s, sightings.period_m_per_s
    n_aliases = int(np.ceil((max_speed + abs(velocity)) / period).max())
    aliases = np.arange(-n_aliases, n_aliases + 1)
    n_draws = min(settings.n_draws, _MAX_HYPOTHESES // aliases.size**2)
    first = rng.integers(n, size=n_draws)
    second = (first + rng.integers(1, n, size=n_draws)) % n
    radial = [velocity[rows, None] + period[rows, None] * aliases for rows in (first, second)]
    draw, first_alias, second_alias = np.nonzero(
        (abs(radial[0]) <= max_speed)[:, :, None] & (abs(radial[1]) <= max_speed)[:, None, :]
    )
    a, b = radial[0][draw, first_alias], radial[1][draw, second_alias]
    towards = sightings.horizontal_direction_components(sightings.azimuth_rad)
    (ax, ay), (bx, by) = towards[first[draw]].T, towards[second[draw]].T
    across = ax * by - ay * bx
    with np.errstate(divide="ignore", invalid="ignore"):  # both in one direction
        velocities = np.stack([ay * b - by * a, bx * a - ax * b], axis=-1) / across[:, None]
        return velocities[np.hypot(*velocities.T) <= max_speed]


def _radar_velocity_hypotheses_from_triples(
    sightings: Sightings, settings: EgoMotion, rng: np.random.Generator
) -> np.ndarray:
    """Return velocities of the radar for which triples of detections are static, (n, 3)."""
    n, max_speed = sightings.azimuth_rad.size, settings.max_speed_m_per_s
    velocity, period = sightings.velocity_m_per_s, sightings.period_m_per_s
    n_aliases = int(np.ceil((max_speed + abs(velocity)) / period).max())
    shifts = np.arange(-n_aliases, n_aliases + 1)
    n_draws = max(min(settings.n_draws, _MAX_HYPOTHESES // shifts.size**3), 1)
    triples = rng.random((n_draws, n)).argsort(axis=1)[:, :3]
    combinations = np.stack(np.meshgrid(shifts, shifts, shifts), axis=-1).reshape(-1, 3)
    radial = velocity[triples][:, None] + period[triples][:, None] * combinations
    draw, combination = np.nonzero((abs(radial) <= max_speed).all(axis=-1))
    towards = sightings.direction_components(3)[triples]
    is_solvable = abs(np.linalg.det(towards)) > _MIN_VOLUME
    inverse = np.zeros_like(towards)
    inverse[is_solvable] = np.linalg.inv(towards[is_solvable])
    velocities = -np.einsum("hij,hj->hi", inverse[draw], radial[draw, combination])
    is_possible = is_solvable[draw] & (np.linalg.norm(velocities, axis=1) <= max_speed)
    return np.asarray(velocities[is_possible])


def _truncated_residual_costs(
    sightings: Sightings, share: np.ndarray, radar_velocities: np.ndarray, settings: EgoMotion
) -> np.ndarray:
    """Sum shares of squared residuals over variances, clipped at the gate, (n_velocities,)."""
    at_once = max(_RESIDUALS_PER_BLOCK // sightings.azimuth_rad.size, 1)
    costs = np.empty(len(radar_velocities))
    for begin in range(0, len(radar_velocities), at_once):
        block = slice(begin, begin + at_once)
        residual, variance = static_velocity_residuals_and_variances(
            sightings, radar_velocities[block, None]
        )
        squares = residual**2 / (variance + settings.tolerance_m_per_s**2)
        costs[block] = np.minimum(squares, settings.max_normalised_squared_residual) @ share
    return costs


def _static_detection_mask(
    sightings: Sightings, radar_velocity: np.ndarray, settings: EgoMotion
) -> np.ndarray:
    """Return the mask of detections that are static for a velocity of the radar, (n,)."""
    residual, variance = static_velocity_residuals_and_variances(sightings, radar_velocity)
    return np.asarray(
        residual**2
        <= settings.max_normalised_squared_residual * (variance + settings.tolerance_m_per_s**2)
    )


def _has_rival_velocity_hypothesis(
    sightings: Sightings,
    share: np.ndarray,
    static: np.ndarray,
    velocity: np.ndarray,
    hypotheses: np.ndarray,
    cost: np.ndarray,
    settings: EgoMotion,
) -> bool:
    """Return whether a hypothesis far outside the errors of a velocity is almost as likely.

    Near the velocity the cost grows by the square of the distance in standard errors.
    """
    fitted = sightings.select_detections(static)
    _, variance = static_velocity_residuals_and_variances(fitted, velocity)
    towards = fitted.direction_components(len(velocity))
    weight = share[static] / (variance + settings.tolerance_m_per_s**2)
    differences = hypotheses - velocity
    squares = np.einsum("hi,ij,hj->h", differences, (towards.T * weight) @ towards, differences)
    best = _truncated_residual_costs(sightings, share, velocity[None], settings)[0]
    return bool(((squares > 2 * _RIVAL_COST) & (cost < best + _RIVAL_COST)).any())

"""Monte Carlo trials of a tracker: random measurements of known paths, tracked and assessed."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import (
    check_integer_fields,
    check_number,
    check_positive_fields,
    check_probability,
)
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.identity import track_identities
from dechirp.scene.scene import Scene
from dechirp.tracking.false_alarms import FalseAlarms
from dechirp.tracking.tracker import Tracker


@frozen_dataclass
class TrackTrial:
    """Scene, measurement errors and tracker of a trial.

    Measurements are random, not simulated: each target independently gives one detection or none,
    so that only the tracker is assessed.
    """

    name: str = "track-trial"
    seed: int = 0
    n_frames: int = 100
    period_s: float = 0.1
    """Frame period."""
    scene: Scene
    """Targets in the plane; cross sections are not used."""
    wander_m2_per_s3: float = 0.0
    """Spectral density of white acceleration along x and along y, with which the targets deviate
    from their paths from the first frame on.
    """
    detection_probability: float = 0.9
    """Probability for each target in each frame."""
    range_std_m: float = 0.1
    """Standard deviation of measured ranges."""
    azimuth_std_rad: float = 0.01
    """Standard deviation of measured azimuths."""
    velocity_std_m_per_s: float = 0.1
    """Standard deviation of measured velocities."""
    false_alarms: FalseAlarms = FalseAlarms()
    cutoff_m: float = 3.0
    """Largest distance of a track from its target."""
    acquired_within: int = 15
    """Number of frames within which every target must have a track."""
    tracker: Tracker = Tracker()

    def __post_init__(self) -> None:
        check_integer_fields(self, "seed", at_least=0, at_most=2**63 - 1)
        check_integer_fields(self, "n_frames", "acquired_within", at_most=100_000)
        check_positive_fields(self, "period_s", "cutoff_m")
        check_positive_fields(self, "range_std_m", "azimuth_std_rad", "velocity_std_m_per_s")
        check_number("TrackTrial.wander_m2_per_s3", self.wander_m2_per_s3, at_least=0)
        check_probability("TrackTrial.detection_probability", self.detection_probability)
        for name, kind in (("scene", Scene), ("false_alarms", FalseAlarms), ("tracker", Tracker)):
            if not isinstance(getattr(self, name), kind):
                raise InvalidSetting(
                    f"TrackTrial.{name}",
                    value=repr(getattr(self, name)),
                    expected=f"a {kind.__name__}",
                    fix="make one",
                )
        hits, _ = self.tracker.confirm_after
        if self.n_frames < hits:
            raise InvalidSetting(
                "TrackTrial.n_frames",
                value=self.n_frames,
                expected=f"at least {hits}, the detections that confirm a track",
                fix="simulate more frames, or lower tracker.confirm_after",
            )
        if not self.scene.targets:
            raise InvalidSetting(
                "TrackTrial.scene.targets",
                value="empty",
                expected="at least one target to track",
                fix="give targets with a position and a velocity",
            )

    @property
    def times_s(self) -> np.ndarray:
        """Time of each frame, (n_frames,)."""
        return np.arange(self.n_frames) * self.period_s


class TrialData(NamedTuple):
    """Random truth and detections of a trial."""

    truth: xr.Dataset
    """Over (target, frame): x y vx vy, m and m/s, radar coordinates."""
    detections: xr.Dataset
    """Over `detection`, as from `detect`, with fewer columns; false alarms have target -1."""


class TrackingOutcome(NamedTuple):
    """Tracks of a trial, and their assessment."""

    data: TrialData
    tracks: xr.Dataset
    identities: xr.Dataset
    is_complete: bool
    """True if every target was acquired in time and kept one track to the end."""


@check_argument_types
def draw_truth_and_detections(trial: TrackTrial, trial_number: int) -> TrialData:
    """Draw targets and detections of the trial of that number.

    Parameters
    ----------
    trial : TrackTrial
        Targets, sensor and seed.
    trial_number : int
        Number of the trial, 0 or more: each has its own random numbers.
    """
    rng = np.random.default_rng(np.random.SeedSequence(trial.seed, spawn_key=(trial_number,)))
    state = _draw_target_states(trial, rng)
    axes = ("target", "frame")
    truth = xr.Dataset(
        {name: (axes, state[..., i]) for i, name in enumerate(("x", "vx", "y", "vy"))},
        coords={
            "target": list(trial.scene.names),
            "frame": np.arange(trial.n_frames),
            "time": ("frame", trial.times_s, {"units": "s"}),
        },
    )
    return TrialData(truth, _draw_detections(trial, state, rng))


@check_argument_types
def assess_track_completeness(
    trial: TrackTrial, data: TrialData, tracks: xr.Dataset
) -> TrackingOutcome:
    """Assess the tracks of a trial for completeness.

    Parameters
    ----------
    trial : TrackTrial
        Limits of distance and of the time to acquire a target.
    data : TrialData
        Truth and detections, as `draw_truth_and_detections` returns them.
    tracks : Dataset
        Tracks of these detections.
    """
    identities = track_identities(tracks, data.truth, cutoff_m=trial.cutoff_m)
    in_time = (identities.first_held >= 0) & (identities.first_held < trial.acquired_within)
    is_whole = bool((in_time & (identities.n_lost == 0) & (identities.n_swaps == 0)).all())
    return TrackingOutcome(data, tracks, identities, is_whole)


def _draw_target_states(trial: TrackTrial, rng: np.random.Generator) -> np.ndarray:
    """Draw x, vx, y, vy of each target in each frame, (n_targets, n_frames, 4)."""
    scene, times_s = trial.scene, trial.times_s
    position_m = np.swapaxes(scene.target_positions_m(times_s), 0, 1)[..., :2]
    velocity = np.swapaxes(scene.target_velocities_m_per_s(times_s), 0, 1)[..., :2]
    # Axes: target, frame, x or y, position or velocity.
    state = np.stack([position_m, velocity], axis=-1)
    # White acceleration over a period, exactly: Bar-Shalom 2001, 6.2.2.
    t = trial.period_s
    covariance = trial.wander_m2_per_s3 * np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, t]])
    transition = np.array([[1, t], [0, 1]])
    deviation = np.zeros_like(state)
    increments = rng.standard_normal(state.shape) @ _cholesky_or_zero(covariance).T
    for frame in range(1, trial.n_frames):
        deviation[:, frame] = deviation[:, frame - 1] @ transition.T + increments[:, frame]
    return (state + deviation).reshape(*state.shape[:2], 4)


def _cholesky_or_zero(covariance: np.ndarray) -> np.ndarray:
    return np.linalg.cholesky(covariance) if covariance.any() else np.zeros_like(covariance)


def _draw_detections(trial: TrackTrial, state: np.ndarray, rng: np.random.Generator) -> xr.Dataset:
    x, vx, y, vy = np.moveaxis(state, -1, 0)
    range_m = np.hypot(x, y)
    true_values = np.stack([range_m, np.arctan2(y, x), (x * vx + y * vy) / range_m], axis=-1)
    std = np.array([trial.range_std_m, trial.azimuth_std_rad, trial.velocity_std_m_per_s])
    target, frame = np.nonzero(rng.random(range_m.shape) < trial.detection_probability)
    measured = true_values[target, frame] + std * rng.standard_normal((len(target), 3))
    n_false = rng.poisson(trial.false_alarms.per_frame, trial.n_frames)
    lower, upper = np.array(list(trial.false_alarms.range_azimuth_velocity_bounds)).T
    false_alarms = rng.uniform(lower, upper, (n_false.sum(), 3))
    frames = np.concatenate([frame, np.repeat(np.arange(trial.n_frames), n_false)])
    owners = np.concatenate([target, np.full(len(false_alarms), -1)])
    # Random order, so that no tracker benefits from it.
    order = np.lexsort((rng.random(len(frames)), frames))
    rows = np.concatenate([measured, false_alarms])[order]
    columns = {
        "frame": frames[order],
        "time": trial.times_s[frames[order]],
        "target": owners[order],
    }
    for i, name in enumerate(("range", "azimuth", "velocity")):
        columns |= {name: rows[:, i], f"{name}_std": np.full(len(rows), std[i])}
    return xr.Dataset({name: ("detection", column) for name, column in columns.items()})

"""Trials of a tracker: targets on known paths, measured with chance, tracked and judged."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.checks import count, number, positive, probability
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.evaluate.identity import identities
from dechirp.scene.scene import Scene
from dechirp.tracking.false_alarms import FalseAlarms
from dechirp.tracking.tracker import Tracker
from dechirp.tracking.tracks import track


@value
class TrackTrial:
    """What is there, how it is measured, and what tracks it.

    Measurements are drawn, not simulated: each target by itself gives a detection or none, so
    that what is judged is the tracker alone.
    """

    name: str = "track-trial"
    seed: int = 0
    n_frames: int = 100
    period_s: float = 0.1
    """From frame to frame."""
    scene: Scene
    """Targets, seen from above, their cross sections of no matter."""
    wander_m2_per_s3: float = 0.0
    """Spectral density of white acceleration along x and along y, by which the targets of each
    trial leave their paths; from the first frame on."""
    detection_probability: float = 0.9
    """Of each target in each frame."""
    range_std_m: float = 0.1
    """Standard deviation of measured ranges."""
    azimuth_std_rad: float = 0.01
    """Standard deviation of measured azimuths."""
    velocity_std_m_per_s: float = 0.1
    """Standard deviation of measured velocities."""
    false_alarms: FalseAlarms = FalseAlarms()
    cutoff_m: float = 3.0
    """Distance up to which a track holds a target."""
    acquired_within: int = 15
    """Frames after which every target must be held."""
    tracker: Tracker = Tracker()

    def __post_init__(self) -> None:
        count(self, "seed", at_least=0, at_most=2**63 - 1)
        count(self, "n_frames", "acquired_within", at_most=100_000)
        positive(self, "period_s", "cutoff_m")
        positive(self, "range_std_m", "azimuth_std_rad", "velocity_std_m_per_s")
        number("TrackTrial.wander_m2_per_s3", self.wander_m2_per_s3, at_least=0)
        probability("TrackTrial.detection_probability", self.detection_probability)
        for name, kind in (("scene", Scene), ("false_alarms", FalseAlarms), ("tracker", Tracker)):
            if not isinstance(getattr(self, name), kind):
                raise InvalidSetting(
                    f"TrackTrial.{name}",
                    got=repr(getattr(self, name)),
                    need=f"a {kind.__name__}",
                    fix="Make one.",
                )
        self.tracker.must_confirm_within(self.n_frames)
        if not self.scene.targets:
            raise InvalidSetting(
                "TrackTrial.scene.targets",
                got="empty",
                need="at least one target to track",
                fix="Give targets with a position and a velocity.",
            )

    @property
    def times_s(self) -> np.ndarray:
        """Of each frame, (n_frames,)."""
        return np.arange(self.n_frames) * self.period_s


class Drawn(NamedTuple):
    """What chance makes of a trial."""

    truth: xr.Dataset
    """Over (target, frame): x y vx vy, m and m/s, coordinates of the radar."""
    detections: xr.Dataset
    """Over `detection`, as `detect` gives them, fewer columns; false alarms have target -1."""


class Outcome(NamedTuple):
    """What the tracker made of it."""

    drawn: Drawn
    tracks: xr.Dataset
    identities: xr.Dataset
    is_whole: bool
    """Whether every target was acquired in time, and then held by one track to the end."""


def draw(trial: TrackTrial, number: int) -> Drawn:
    """Targets and detections of the trial of that number."""
    rng = np.random.default_rng(np.random.SeedSequence(trial.seed, spawn_key=(number,)))
    state = _paths(trial, rng)
    over = ("target", "frame")
    truth = xr.Dataset(
        {name: (over, state[..., i]) for i, name in enumerate(("x", "vx", "y", "vy"))},
        coords={
            "target": list(trial.scene.names),
            "frame": np.arange(trial.n_frames),
            "time": ("frame", trial.times_s, {"units": "s"}),
        },
    )
    return Drawn(truth, _detections(trial, state, rng))


def judge(trial: TrackTrial, drawn: Drawn, tracks: xr.Dataset) -> Outcome:
    """Whether tracks of what was drawn are whole."""
    held = identities(tracks, drawn.truth, cutoff_m=trial.cutoff_m)
    in_time = (held.first_held >= 0) & (held.first_held < trial.acquired_within)
    is_whole = bool((in_time & (held.n_lost == 0) & (held.n_swaps == 0)).all())
    return Outcome(drawn, tracks, held, is_whole)


def hold(trial: TrackTrial, number: int) -> Outcome:
    """Draw the trial of that number, track it, and judge the tracks."""
    drawn = draw(trial, number)
    return judge(trial, drawn, track(drawn.detections, trial.times_s, trial.tracker))


def _paths(trial: TrackTrial, rng: np.random.Generator) -> np.ndarray:
    """x, vx, y, vy of each target in each frame, (n_targets, n_frames, 4)."""
    scene, times_s = trial.scene, trial.times_s
    place = np.swapaxes(scene.target_positions_m(times_s), 0, 1)[..., :2]
    speed = np.swapaxes(scene.target_velocities_m_per_s(times_s), 0, 1)[..., :2]
    state = np.stack([place, speed], axis=-1)  # (target, frame, x or y, place or speed)
    # White acceleration over a period, exactly: Bar-Shalom 2001, 6.2.2.
    t = trial.period_s
    spread = trial.wander_m2_per_s3 * np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, t]])
    step = np.array([[1, t], [0, 1]])
    left = np.zeros_like(state)
    kicks = rng.standard_normal(state.shape) @ _root(spread).T
    for frame in range(1, trial.n_frames):
        left[:, frame] = left[:, frame - 1] @ step.T + kicks[:, frame]
    return (state + left).reshape(*state.shape[:2], 4)


def _root(spread: np.ndarray) -> np.ndarray:
    return np.linalg.cholesky(spread) if spread.any() else np.zeros_like(spread)


def _detections(trial: TrackTrial, state: np.ndarray, rng: np.random.Generator) -> xr.Dataset:
    x, vx, y, vy = np.moveaxis(state, -1, 0)
    range_m = np.hypot(x, y)
    true = np.stack([range_m, np.arctan2(y, x), (x * vx + y * vy) / range_m], axis=-1)
    std = np.array([trial.range_std_m, trial.azimuth_std_rad, trial.velocity_std_m_per_s])
    target, frame = np.nonzero(rng.random(range_m.shape) < trial.detection_probability)
    seen = true[target, frame] + std * rng.standard_normal((len(target), 3))
    n_false = rng.poisson(trial.false_alarms.per_frame, trial.n_frames)
    low, high = np.array(list(trial.false_alarms.bounds)).T
    false = rng.uniform(low, high, (n_false.sum(), 3))
    frames = np.concatenate([frame, np.repeat(np.arange(trial.n_frames), n_false)])
    owners = np.concatenate([target, np.full(len(false), -1)])
    order = np.lexsort((rng.random(len(frames)), frames))  # no tracker may gain by their order
    rows = np.concatenate([seen, false])[order]
    columns = {
        "frame": frames[order],
        "time": trial.times_s[frames[order]],
        "target": owners[order],
    }
    for i, name in enumerate(("range", "azimuth", "velocity")):
        columns |= {name: rows[:, i], f"{name}_std": np.full(len(rows), std[i])}
    return xr.Dataset({name: ("detection", column) for name, column in columns.items()})

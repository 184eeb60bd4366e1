"""Kalman filters and association by Stone Soup, behind arrays.

Imported only when a tracker is made: Stone Soup comes with the extra `track`.

Stone Soup predicts, associates and updates. Gates are ours: its hypothesisers linearise the
measurement anew for each pair of a track and a detection, as each detection has an error of its
own, at 0.2 ms a pair; here once for each track, and pairs outside the gate cost nothing more.
"""

from collections.abc import Sequence
from datetime import datetime, timedelta
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.special import chdtri
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
from stonesoup.dataassociator.probability import JPDAwithEHM2, JPDAwithLBP
from stonesoup.models.measurement.nonlinear import CartesianToBearingRangeRate2D
from stonesoup.models.transition.linear import (
    CombinedLinearGaussianTransitionModel,
    ConstantVelocity,
    LinearGaussianTimeInvariantTransitionModel,
)
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.detection import Detection, MissedDetection
from stonesoup.types.hypothesis import SingleDistanceHypothesis, SingleProbabilityHypothesis
from stonesoup.types.numeric import Probability
from stonesoup.types.prediction import GaussianMeasurementPrediction
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import ExtendedKalmanUpdater, UnscentedKalmanUpdater
from stonesoup.updater.probability import PDAUpdater

from dechirp.core.memory import must_fit
from dechirp.tracking.measured import Measured
from dechirp.tracking.tracker import Tracker

Hypotheses = dict[int, list[Any]]
"""Of each track, by its place."""

# Exact sums over a group in which all compete for the same detections take 0.1 s for 8 tracks,
# and 2.3 times that for each more. Loopy belief propagation (Williams and Lau 2014) takes no time.
_MOST_EXACT = 8

_PAIR_BYTES = 200.0  # of a track and a detection: covariances, also scaled, and residuals

_EPOCH = datetime(2000, 1, 1)  # its clocks are dates, to a microsecond: 0.1 mm at 100 m/s


class Belief(NamedTuple):
    """Mean (4,) and covariance (4, 4) of x, vx, y, vy."""

    mean: np.ndarray
    covariance: np.ndarray


class Step(NamedTuple):
    """What a frame did to some tracks."""

    beliefs: list[Belief]
    """After it."""
    shares: np.ndarray
    """(n_tracks, n_detections): probability, or 0 and 1, that a detection is of a track."""


class StoneSoup:
    """Filters and association of a tracker; it remembers nothing between frames."""

    def __init__(self, tracker: Tracker) -> None:
        seen = CartesianToBearingRangeRate2D(
            ndim_state=4, mapping=(0, 2), velocity_mapping=(1, 3), noise_covar=np.eye(3)
        )
        # No sigma point with a negative weight, or covariances could lose their sign: Stone
        # Soup's own weights did, once in 4,000 frames of the crossing.
        self._seen_by = (
            ExtendedKalmanUpdater(seen)
            if tracker.filter == "extended"
            else UnscentedKalmanUpdater(seen, alpha=1, beta=2, kappa=0)
        )
        joint = tracker.association == "joint"
        # A mixture of updates, for each detection has an error of its own.
        self._updater = PDAUpdater(None, gm_method=True) if joint else self._seen_by
        self._gate = chdtri(3, 1 - tracker.gate_probability)
        self._tracker = tracker

    def step(self, beliefs: Sequence[Belief], passed_s: float, frame: Measured) -> Step:
        """Predict over a time, associate, update: `beliefs` to those after the frame."""
        shares = np.zeros((len(beliefs), len(frame.seen)))
        if not beliefs:
            return Step([], shares)
        passed = timedelta(seconds=passed_s)
        now = _EPOCH + passed
        priors = [GaussianState(*belief, timestamp=_EPOCH) for belief in beliefs]
        predictor = _predictor(self._tracker.process_noise_m2_per_s3, passed)
        predictions = [predictor.predict(prior, timestamp=now) for prior in priors]
        # A rate that is not told leaves no residual, see `_innovations`: any number will do.
        told = np.nan_to_num(frame.seen)
        detections = [Detection(seen[:, None], timestamp=now) for seen in told]
        offered = self._hypotheses(predictions, detections, frame, now)
        joint = self._tracker.association == "joint"
        associate = _jointly if joint else _nearest
        chosen = associate(offered, detections, now)
        place_of = {id(detection): place for place, detection in enumerate(detections)}
        after = []
        for place, prediction in enumerate(predictions):
            taken = chosen[place]
            # One that only missed is as predicted: most tracks that false alarms start.
            hits = [one for one in (taken if joint else [taken]) if one]
            for one in hits:
                shares[place, place_of[id(one.measurement)]] = one.probability if joint else 1
            after.append(_belief(self._updater.update(taken) if hits else prediction))
        return Step(after, shares)

    def _hypotheses(
        self, predictions: Sequence[Any], detections: Sequence[Any], frame: Measured, now: datetime
    ) -> Hypotheses:
        """That a track was missed, or that it is any one of the detections in its gate."""
        tracker = self._tracker
        missed, nothing = np.log(1 - tracker.hit_probability), MissedDetection(timestamp=now)
        made = {
            place: [self._weighed(missed, prediction, nothing)]
            for place, prediction in enumerate(predictions)
        }
        if not detections:
            return made
        expected = [
            self._seen_by.predict_measurement(prediction, measurement_noise=False)
            for prediction in predictions
        ]
        residual, covariance, told = _innovations(expected, frame, tracker)
        distance2 = np.einsum(
            "tni,tni->tn", residual, np.linalg.solve(covariance, residual[..., None])[..., 0]
        )
        log_density = -distance2 / 2 - np.linalg.slogdet(2 * np.pi * covariance)[1] / 2
        weight = tracker.detection_probability / tracker.false_alarms.density_per_m_rad_m_per_s
        score = np.log(weight) + log_density
        for at in zip(*np.nonzero(distance2 <= self._gate), strict=True):
            place, one = at
            # Told as the place that leaves the residual, so that turns and folds are no matter.
            pair = GaussianMeasurementPrediction(
                detections[one].state_vector - residual[at][:, None],
                covariance[at],
                timestamp=now,
                cross_covar=np.asarray(expected[place].cross_covar, float) * [1, 1, told[at]],
            )
            made[place].append(self._weighed(score[at], predictions[place], detections[one], pair))
        return made

    def _weighed(
        self, log_weight: float, prediction: Any, measurement: Any, pair: Any = None
    ) -> Any:
        """A hypothesis with its weight; assignment adds distances, so those are logarithms."""
        parts = {
            "prediction": prediction,
            "measurement": measurement,
            "measurement_prediction": pair,
        }
        if self._tracker.association == "joint":
            weight = Probability(log_weight, log_value=True)
            return SingleProbabilityHypothesis(**parts, probability=weight)
        return SingleDistanceHypothesis(**parts, distance=-log_weight)


@lru_cache(maxsize=16)
def _predictor(process_noise_m2_per_s3: float, passed: timedelta) -> KalmanPredictor:
    """Of a step as long as this; Stone Soup makes its matrices anew for each track, in 0.14 ms."""
    along = ConstantVelocity(process_noise_m2_per_s3)
    motion = CombinedLinearGaussianTransitionModel([along, along])
    step = LinearGaussianTimeInvariantTransitionModel(
        transition_matrix=motion.matrix(time_interval=passed),
        covariance_matrix=motion.covar(time_interval=passed),
    )
    # Motion is linear, so sigma points through it would give the same.
    return KalmanPredictor(step)


class _Offered:
    """What an associator of Stone Soup asks for hypotheses."""

    def __init__(self, hypotheses: Hypotheses) -> None:
        self._hypotheses = hypotheses

    def hypothesise(self, track: int, *_: Any) -> list[Any]:
        return self._hypotheses[track]


def _nearest(offered: Hypotheses, detections: Sequence[Any], now: datetime) -> dict[int, Any]:
    chosen: dict[int, Any] = GNNWith2DAssignment(_Offered(offered)).associate(
        list(offered), detections, now
    )
    return chosen


def _jointly(offered: Hypotheses, detections: Sequence[Any], now: datetime) -> dict[int, Any]:
    """Hypotheses of each track with their probabilities, given that no two share a detection.

    Exact, but where many tracks are linked by detections in several gates.
    """
    group = _groups(offered, detections)
    is_crowded = (np.bincount(group) > _MOST_EXACT)[group]
    chosen: dict[int, Any] = {}
    for associator, mask in ((JPDAwithEHM2, ~is_crowded), (JPDAwithLBP, is_crowded)):
        tracks = [place for place in offered if mask[place]]
        if tracks:
            some = {place: offered[place] for place in tracks}
            chosen |= associator(_Offered(some)).associate(tracks, detections, now)
    return chosen


def _groups(offered: Hypotheses, detections: Sequence[Any]) -> np.ndarray:
    """Number of the group of each track: those that are linked by detections."""
    place_of = {id(detection): place for place, detection in enumerate(detections)}
    pairs = [
        (track, len(offered) + place_of[id(one.measurement)])
        for track, hypotheses in offered.items()
        for one in hypotheses
        if one
    ]
    rows, columns = np.array(pairs, int).reshape(-1, 2).T
    n = len(offered) + len(detections)
    links = coo_array((np.ones(len(pairs)), (rows, columns)), shape=(n, n))
    return np.asarray(connected_components(links, directed=False)[1][: len(offered)])


def _innovations(
    expected: Sequence[Any], frame: Measured, tracker: Tracker
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals (n_tracks, n, 3), their covariances, and whether rates tell something.

    A rate that is known up to a fold tells its track something where its spread, 4 standard
    deviations, is within half a span. One that tells nothing leaves no residual, gains nothing,
    and is as likely as of a false alarm.
    """
    must_fit(
        "the pairs of tracks and detections",
        needed_bytes=_PAIR_BYTES * len(expected) * len(frame.seen),
        fix="Raise the threshold of the detector, or cluster its detections.",
    )
    at = np.array([np.asarray(one.state_vector, float)[:, 0] for one in expected])
    spread = np.array([np.asarray(one.covar, float) for one in expected])
    residual = frame.seen - at[:, None]
    residual[..., 0] = np.mod(residual[..., 0] + np.pi, 2 * np.pi) - np.pi
    covariance = np.repeat(spread[:, None], len(frame.seen), axis=1)
    np.einsum("tnii->tni", covariance)[:] += frame.variance
    span = frame.span_m_per_s
    folded = np.where(np.isfinite(span), span, 0)
    residual[..., 2] -= folded * np.round(residual[..., 2] / span)
    with np.errstate(invalid="ignore"):
        told = 4 * np.sqrt(covariance[..., 2, 2]) < span / 2
    silent = ~told
    residual[silent, 2] = 0
    covariance[silent, 2, :] = covariance[silent, :, 2] = 0
    covariance[silent, 2, 2] = tracker.false_alarms.velocity_extent_m_per_s**2 / (2 * np.pi)
    return residual, covariance, told


def _belief(state: Any) -> Belief:
    covariance = np.asarray(state.covar, float)
    return Belief(np.asarray(state.state_vector, float)[:, 0], (covariance + covariance.T) / 2)

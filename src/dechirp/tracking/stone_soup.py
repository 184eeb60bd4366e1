"""Kalman filters and association by Stone Soup, behind arrays.

Imported only when a tracker is made: Stone Soup comes with the extra `track`.

Stone Soup predicts, associates and updates. Gates are ours: its hypothesisers linearise the
measurement anew for each pair of a track and a detection, as each detection has an error of its
own, at 0.2 ms a pair; here once for each track, and pairs outside the gate cost nothing.
"""

from collections.abc import Sequence
from datetime import datetime, timedelta
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
)
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.detection import Detection, MissedDetection
from stonesoup.types.hypothesis import SingleDistanceHypothesis, SingleProbabilityHypothesis
from stonesoup.types.numeric import Probability
from stonesoup.types.prediction import GaussianMeasurementPrediction
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import ExtendedKalmanUpdater, UnscentedKalmanUpdater
from stonesoup.updater.probability import PDAUpdater

from dechirp.tracking.measured import Measured
from dechirp.tracking.tracker import Tracker

Hypotheses = dict[int, list[Any]]
"""Of each track, by its place."""

# Exact sums over a group in which all compete for the same detections take 0.1 s for 8 tracks,
# and 2.3 times that for each more. Loopy belief propagation (Williams and Lau 2014) takes no time.
_MOST_EXACT = 8

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
        q = tracker.process_noise_m2_per_s3
        motion = CombinedLinearGaussianTransitionModel([ConstantVelocity(q), ConstantVelocity(q)])
        # Motion is linear, so sigma points through it would give the same.
        self._predictor = KalmanPredictor(motion)
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
        now = _EPOCH + timedelta(seconds=passed_s)
        priors = [GaussianState(*belief, timestamp=_EPOCH) for belief in beliefs]
        predictions = [self._predictor.predict(prior, timestamp=now) for prior in priors]
        # A rate that is not told leaves no residual, see `_innovations`: any number will do.
        told = np.nan_to_num(frame.seen)
        detections = [Detection(seen[:, None], timestamp=now) for seen in told]
        offered = {
            place: self._hypotheses(prediction, detections, frame)
            for place, prediction in enumerate(predictions)
        }
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

    def _hypotheses(self, prediction: Any, detections: Sequence[Any], frame: Measured) -> list[Any]:
        """That a track was missed, or that it is any one of the detections in its gate."""
        tracker = self._tracker
        missed = 1 - tracker.hit_probability
        nothing = MissedDetection(timestamp=prediction.timestamp)
        made = [self._weighed(np.log(missed), prediction, nothing)]
        if not detections:
            return made
        expected = self._seen_by.predict_measurement(prediction, measurement_noise=False)
        at = expected.state_vector[:, 0].astype(float)
        spread = np.asarray(expected.covar, float)
        residual, covariance, told = _innovations(at, spread, frame, tracker)
        distance2 = np.einsum(
            "ni,ni->n", residual, np.linalg.solve(covariance, residual[..., None])[..., 0]
        )
        log_density = -distance2 / 2 - np.linalg.slogdet(2 * np.pi * covariance)[1] / 2
        weight = tracker.detection_probability / tracker.false_alarms.density_per_m_rad_m_per_s
        for place in np.flatnonzero(distance2 <= self._gate).tolist():
            cross = np.asarray(expected.cross_covar, float) * [1, 1, told[place]]
            # Told as the place that leaves the residual, so that turns and folds are no matter.
            pair = GaussianMeasurementPrediction(
                detections[place].state_vector - residual[place][:, None],
                covariance[place],
                timestamp=prediction.timestamp,
                cross_covar=cross,
            )
            score = np.log(weight) + log_density[place]
            made.append(self._weighed(score, prediction, detections[place], pair))
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
    at: np.ndarray, spread: np.ndarray, frame: Measured, tracker: Tracker
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals (n, 3), their covariances (n, 3, 3), and whether rates tell something (n,).

    A rate that is known up to a fold tells its track something where its spread, 4 standard
    deviations, is within half a span. One that tells nothing leaves no residual, gains nothing,
    and is as likely as of a false alarm.
    """
    residual = frame.seen - at
    residual[:, 0] = np.mod(residual[:, 0] + np.pi, 2 * np.pi) - np.pi
    covariance = np.repeat(spread[None], len(residual), axis=0)
    np.einsum("nii->ni", covariance)[:] += frame.variance
    span = frame.span_m_per_s
    folded = np.isfinite(span)
    residual[folded, 2] -= span[folded] * np.round(residual[folded, 2] / span[folded])
    with np.errstate(invalid="ignore"):
        told = 4 * np.sqrt(covariance[:, 2, 2]) < span / 2
    silent = ~told
    residual[silent, 2] = 0
    covariance[silent, 2, :] = covariance[silent, :, 2] = 0
    covariance[silent, 2, 2] = tracker.false_alarms.velocity_extent_m_per_s**2 / (2 * np.pi)
    return residual, covariance, told


def _belief(state: Any) -> Belief:
    covariance = np.asarray(state.covar, float)
    return Belief(np.asarray(state.state_vector, float)[:, 0], (covariance + covariance.T) / 2)

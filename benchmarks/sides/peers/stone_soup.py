"""Stone Soup: multi-target tracker, assembled as in its tutorials."""

from datetime import datetime, timedelta
from typing import Any

import numpy as np

from sides.job_types import Inputs, Timed

REQUIRES = ("stonesoup==1.9.1",)
BEGIN = datetime(2000, 1, 1)


def tracking(x: Inputs) -> Timed:
    from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
    from stonesoup.deleter.time import UpdateTimeStepsDeleter
    from stonesoup.hypothesiser.distance import DistanceHypothesiser
    from stonesoup.initiator.simple import MultiMeasurementInitiator
    from stonesoup.measures import Mahalanobis
    from stonesoup.models.transition.linear import (
        CombinedLinearGaussianTransitionModel,
        ConstantVelocity,
    )
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.tracker.simple import MultiTargetTracker
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import UnscentedKalmanUpdater

    stds = [x[f"detections_{name}_std"][0] for name in ("azimuth", "range", "velocity")]
    model = build_measurement_model()(
        ndim_state=4, mapping=(0, 2), velocity_mapping=(1, 3), noise_covar=np.diag(stds) ** 2
    )
    noise = ConstantVelocity(float(x["process_noise_m2_per_s3"]))
    predictor = KalmanPredictor(CombinedLinearGaussianTransitionModel([noise, noise]))
    updater = UnscentedKalmanUpdater(model)
    prior = GaussianState(
        np.zeros(4), np.diag([0.0, 1.0, 0.0, 1.0]) * float(x["speed_std_m_per_s"]) ** 2
    )
    # Gate probability 0.999 for three measured values: 4.03 standard deviations.
    hypothesiser = DistanceHypothesiser(predictor, updater, Mahalanobis(), missed_distance=4.03)
    associator = GNNWith2DAssignment(hypothesiser)
    hits, frames = x["confirm_after"].tolist()
    detections_by_frame = group_detections(x, model)

    def positions() -> np.ndarray:
        tracker = MultiTargetTracker(
            initiator=MultiMeasurementInitiator(
                prior,
                UpdateTimeStepsDeleter(frames - hits),
                associator,
                updater,
                model,
                min_points=hits,
            ),
            deleter=UpdateTimeStepsDeleter(int(x["drop_after"])),
            detector=detections_by_frame,
            data_associator=associator,
            updater=updater,
        )
        tracks_by_frame = [[t.state_vector[[0, 2], 0] for t in tracks] for _, tracks in tracker]
        positions_m = np.full((len(detections_by_frame), max(map(len, tracks_by_frame)), 2), np.nan)
        for frame, tracks in enumerate(tracks_by_frame):
            positions_m[frame, : len(tracks)] = np.reshape(tracks, (-1, 2)).astype(float)
        return positions_m

    return positions


def build_measurement_model() -> Any:
    """Build the model of azimuth, range and velocity, with the inverse that starts a track."""
    from stonesoup.models.base import ReversibleModel
    from stonesoup.models.measurement.nonlinear import CartesianToBearingRangeRate2D
    from stonesoup.types.array import StateVector

    class ReversibleMeasurementModel(CartesianToBearingRangeRate2D, ReversibleModel):
        def inverse_function(self, detection: Any, **kwargs: Any) -> Any:
            azimuth, range_m, velocity = (float(value) for value in detection.state_vector[:, 0])
            direction = np.array([np.cos(azimuth), np.sin(azimuth)])
            position, speed = range_m * direction, velocity * direction
            return StateVector([position[0], speed[0], position[1], speed[1]])

    return ReversibleMeasurementModel


def group_detections(x: Inputs, model: Any) -> list[tuple[datetime, set[Any]]]:
    """Group the detections by frame, with the time of each."""
    from stonesoup.types.angle import Bearing
    from stonesoup.types.detection import Detection

    frames = []
    for frame, time_s in enumerate(x["times_s"]):
        rows = np.flatnonzero(x["detections_frame"] == frame)
        time = BEGIN + timedelta(seconds=float(time_s))
        frame_detections = {
            Detection(
                np.array(
                    [
                        [Bearing(x["detections_azimuth"][i])],
                        [x["detections_range"][i]],
                        [x["detections_velocity"][i]],
                    ],
                    dtype=object,
                ),
                timestamp=time,
                measurement_model=model,
            )
            for i in rows
        }
        frames.append((time, frame_detections))
    return frames

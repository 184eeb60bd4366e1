"""Benchmark jobs implemented with dechirp."""

import warnings
from dataclasses import replace
from functools import partial

import numpy as np
import xarray as xr

import dechirp as dc
from dechirp.config import loading
from dechirp.core.findings import PhysicsWarning
from dechirp.evaluation.track_trial import TrackTrial
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.bartlett import bartlett_spectrum
from dechirp.processing.angle.capon import Capon
from dechirp.processing.angle.music import Music
from dechirp.processing.cfar.base import NoiseEstimator, TrainingWindow
from dechirp.processing.cluster import Dbscan, cluster
from dechirp.radar.cube import label_cube
from dechirp.recordings.samples.layouts import SampleCode, TwoLanes
from dechirp.simulation.engine import Engine
from dechirp.simulation.kernels import selection
from dechirp.tracking.batch import track
from sides.frames import CROSSING, build_radar
from sides.inputs import unpack_case
from sides.job_types import Inputs, Timed
from sides.plain_maps import GUARD, TRAINING

warnings.simplefilter("ignore", PhysicsWarning)


def echoes(x: Inputs) -> Timed:
    scatterers, transmission = unpack_case(x)
    engine = Engine()
    shape = (len(transmission.starts_s), len(transmission.rx_m), int(x["n_samples"]))
    samples = np.zeros(shape, np.complex64)

    def add() -> np.ndarray:
        samples[:] = 0
        selection.add_echoes(samples, scatterers, transmission, engine=engine)
        return samples

    return add


def power_map(x: Inputs) -> Timed:
    n_chirps, n_samples = x["samples"].shape
    radar = build_radar(n_samples, n_chirps, 1, 1)
    cube = label_cube(x["samples"][None, :, None], radar, units="W**0.5").isel(frame=0)
    chain = dc.Chain(n_range_bins=int(x["n_bins"]))
    return lambda: dc.power_map(cube, radar, chain).values


def cell_averaging(x: Inputs) -> Timed:
    return build_mask_call(dc.cfar.CellAveraging(), x)


def ordered_statistic(x: Inputs) -> Timed:
    return build_mask_call(dc.cfar.OrderedStatistic(rank=int(x["rank"])), x)


def build_mask_call(estimator: NoiseEstimator, x: Inputs) -> Timed:
    """Build the detector call, with the factors for the shifted windows at the ends of range."""
    training, guard = (dc.Cells(velocity=n[0], range=n[1]) for n in (TRAINING, GUARD))
    window = TrainingWindow(n_training=training, n_guard=guard)
    row_positions = window.tested_rows_in_training_box(x["power"].shape[2])
    factors = {
        position: estimator.independent_cells_threshold_factor(
            float(x["false_alarm_probability"]),
            window.training_cell_offsets(position),
            n_channels=1,
        )
        for position in np.unique(row_positions).tolist()
    }
    row_factors = np.array([factors[position] for position in row_positions.tolist()], np.float32)
    return lambda: [estimator.exceeds_threshold(power, window, row_factors) for power in x["power"]]


def frame(x: Inputs) -> Timed:
    """Build the call of `detect`, which includes peaks, refinement, labels and directions."""
    n_tx, n_rx, n_chirps, n_samples = x["sizes"].tolist()
    radar = build_radar(n_samples, n_chirps, n_tx, n_rx)
    samples = x["samples"].reshape(1, n_chirps * n_tx, n_rx, n_samples)
    cube = label_cube(samples, radar, units="W**0.5")

    def detected_positions() -> np.ndarray:
        dataset = dc.detect(cube, radar)
        return np.column_stack([dataset.range.values, dataset.velocity.values])

    return detected_positions


def bartlett(x: Inputs) -> Timed:
    return partial(bartlett_spectrum, x["snapshots"][:, None], x["steering"])


def capon(x: Inputs) -> Timed:
    return build_azimuth_call(Capon(), x)


def music(x: Inputs) -> Timed:
    return build_azimuth_call(Music(), x)


def build_azimuth_call(estimator: Capon | Music, x: Inputs) -> Timed:
    """Build the call that estimates directions with their standard errors."""
    n, n_elements = x["snapshots"].shape
    aperture = Aperture(np.array([(0, i / 2, 0) for i in range(n_elements)]))
    snapshots, noise = x["snapshots"][:, None], np.ones(n)
    return lambda: estimator.find_directions(snapshots, aperture, noise).azimuth_rad[:, 0]


def dbscan(x: Inputs) -> Timed:
    """Build the call that computes clusters and their centroids."""
    detections = build_detections(x, "detections_")
    radar = build_radar(256, 128, 3, 4)
    return lambda: cluster(detections, radar, Dbscan())[0].cluster.values


def tracking(x: Inputs) -> Timed:
    """Build the call that returns the positions of confirmed tracks by frame, NaN for no track."""
    detections, times_s = build_detections(x, "detections_"), x["times_s"]
    tracker = replace(loading.read_settings(CROSSING, TrackTrial).tracker, association="nearest")

    def positions() -> np.ndarray:
        dataset = track(detections, times_s, tracker)
        positions_m = np.stack([dataset.x.values, dataset.y.values], axis=-1)
        positions_m[dataset.status.values != "confirmed"] = np.nan
        return np.swapaxes(positions_m, 0, 1)

    return positions


def build_detections(x: Inputs, prefix: str) -> xr.Dataset:
    return xr.Dataset(
        {
            name.removeprefix(prefix): ("detection", values)
            for name, values in x.items()
            if name.startswith(prefix)
        }
    )


def decode(x: Inputs) -> Timed:
    codes, out = x["codes"], np.empty(tuple(x["shape"]), np.complex64)

    def samples() -> np.ndarray:
        # The decoder reorders codes in place, so each call needs a copy.
        TwoLanes().decode(codes.copy().reshape(len(out), -1), out, SampleCode())
        return out

    return samples

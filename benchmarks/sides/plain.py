"""Plain reference code of each job with NumPy, SciPy, numba and FINUFFT."""

from functools import partial

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from sides import plain_angles, plain_echoes, plain_maps
from sides.inputs import unpack_case
from sides.job_types import Inputs, Timed


def echoes(x: Inputs) -> Timed:
    scatterers, transmission = unpack_case(x)
    n_samples = int(x["n_samples"])
    work = plain_echoes.select_fastest(scatterers, len(transmission.rx_m))
    shape = (len(transmission.starts_s), len(transmission.rx_m), n_samples)
    return lambda: work(scatterers, transmission, n_samples).reshape(shape)


def power_map(x: Inputs) -> Timed:
    n_chirps, n_samples = x["samples"].shape
    taper = plain_maps.window_weights((n_chirps, n_samples))
    return partial(plain_maps.plain_map, x["samples"], taper, int(x["n_bins"]))


def cell_averaging(x: Inputs) -> Timed:
    factor = float(x["mean_factor"])
    return lambda: [plain_maps.plain_cell_averaging(power, factor) for power in x["power"]]


def ordered_statistic(x: Inputs) -> Timed:
    factor, rank = float(x["rank_factor"]), int(x["rank"])
    return lambda: [plain_maps.plain_ordered_statistic(power, factor, rank) for power in x["power"]]


def frame(x: Inputs) -> Timed:
    n_chirps, _, n_samples = x["samples"].shape
    taper = plain_maps.window_weights((n_chirps, n_samples))
    return partial(plain_maps.plain_chain, x["samples"], taper, float(x["mean_factor"]))


def bartlett(x: Inputs) -> Timed:
    return partial(plain_angles.beam_power, x["snapshots"], x["steering"])


def capon(x: Inputs) -> Timed:
    return partial(plain_angles.capon, x["snapshots"], x["steering"], x["sines"], float(x["load"]))


def music(x: Inputs) -> Timed:
    return partial(plain_angles.music, x["snapshots"], x["steering"], x["sines"])


def dbscan(x: Inputs) -> Timed:
    points = x["points"]

    def labels() -> np.ndarray:
        first, second = KDTree(points).query_pairs(1.0, p=np.inf, output_type="ndarray").T
        links = coo_array((np.ones(len(first)), (first, second)), shape=(len(points),) * 2)
        return connected_components(links, directed=False)[1]

    return labels


def decode(x: Inputs) -> Timed:
    codes, shape = x["codes"], tuple(x["shape"])

    def samples() -> np.ndarray:
        groups = codes.reshape(-1, 2, 2)
        out = np.empty((len(groups), 2), np.complex64)
        out.real, out.imag = groups[:, 0], groups[:, 1]
        out *= np.float32(1 / 32768)
        return out.reshape(shape)

    return samples

"""The certificate of the false-alarm rate: 1e9 cells of noise at 1e-6, through the whole chain.

Noise in the samples, windows, transforms, power, threshold of every cell, on the reference
map of 2200 x 128, unpadded and padded to 4096, under rectangular and Hann windows; one
receiver. Two processes, about two minutes for the four together.

    python benchmarks/false_alarms.py [CELLS] [PROBABILITY]
"""

import json
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import numpy as np
import xarray as xr
from rich.progress import track
from scipy.stats import gamma

import dechirp as dc
from dechirp.echoes.impairments.white_noise import add_white_noise

BLOCK = 32
"""Maps to a numbered block of its own seed: the counts do not depend on the workers."""


def alarms(window: str, n_range_bins: int, probability: float, block: int) -> int:
    """Alarms in one block of maps."""
    radar = dc.reference().radar
    assert radar is not None
    cfar = replace(dc.Chain().cfar, false_alarm_probability=probability)
    chain = dc.Chain(
        range_window=window, doppler_window=window, n_range_bins=n_range_bins, cfar=cfar
    )
    rng = np.random.default_rng([n_range_bins, len(window), block])
    cube = xr.DataArray(np.zeros((128, 1, 2200), np.complex64), dims=("chirp", "rx", "sample"))
    count = 0
    for _ in range(BLOCK):
        cube.values[:] = 0
        add_white_noise(cube.values, 1.0, rng)
        power = dc.power_map(cube, radar, chain)
        count += int((power.values > dc.threshold_map(power, radar, chain).values).sum())
    return count


def main(cells: float = 1e9, probability: float = 1e-6) -> None:
    results = {}
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        for window in ("rectangular", "hann"):
            for n_range_bins in (2200, 4096):
                n_blocks = int(np.ceil(cells / (BLOCK * 128 * n_range_bins)))
                waiting = [
                    pool.submit(alarms, window, n_range_bins, probability, block)
                    for block in range(n_blocks)
                ]
                name = f"{window}, {n_range_bins} range bins"
                bar = track(waiting, description=name, disable=not sys.stderr.isatty())
                count = sum(job.result() for job in bar)
                n_cells = n_blocks * BLOCK * 128 * n_range_bins
                # As for independent alarms; where bins are correlated they come in clusters.
                low, high = gamma.ppf([0.025, 0.975], [count, count + 1])
                results[name] = {
                    "cells": n_cells,
                    "alarms": count,
                    "over_design": count / n_cells / probability,
                    "low": float(low / n_cells / probability),
                    "high": float(high / n_cells / probability),
                }
                print(
                    f"{name:30s} {count} alarms in {n_cells:.3g} cells:"
                    f" {results[name]['over_design']:.3f} of the design"
                    f" ({results[name]['low']:.3f} to {results[name]['high']:.3f})",
                    file=sys.stderr,
                )
    print(json.dumps(results))


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))

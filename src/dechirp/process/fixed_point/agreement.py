"""How far whole numbers find what floating point finds, and how that goes with word lengths."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.checks import whole
from dechirp.core.units import decibels
from dechirp.process.chain import Chain
from dechirp.process.fixed_point.chain import fixed_point_map
from dechirp.process.fixed_point.words import WordLengths
from dechirp.process.maps import power_map, threshold_map
from dechirp.radar.radar import Radar


class Agreement(NamedTuple):
    """Cells over threshold in whole numbers and in floating point."""

    n_fixed: int
    n_float: int
    n_only_one: int
    """Cells that only one of them has."""
    farthest_db: float
    """Of these, the power of the one farthest from its threshold, in floating point; 0 for none."""
    floor: float
    """Median power of the cells over that in floating point: 1 where words keep the noise."""


def agreement(found: xr.Dataset, power: xr.DataArray, threshold: xr.DataArray) -> Agreement:
    """Compare `fixed_point_map` with `power_map` and `threshold_map` of the same frame."""
    over = power.values > threshold.values
    differs = found.detected.values != over
    with np.errstate(divide="ignore"):  # of no power at all
        margin_db = abs(decibels(power.values[differs] / threshold.values[differs]))
    watts = found.power.values * found.power.attrs["scale"]
    return Agreement(
        n_fixed=int(found.detected.sum()),
        n_float=int(over.sum()),
        n_only_one=int(differs.sum()),
        farthest_db=float(margin_db.max(initial=0.0)),
        floor=float(np.median(watts) / np.median(power)),
    )


def agreement_over_bits(
    cube: xr.DataArray,
    radar: Radar,
    chain: Chain,
    bits: tuple[int, ...] = tuple(range(6, 21, 2)),
    words: WordLengths | None = None,
) -> xr.Dataset:
    """`Agreement` for several lengths of samples, weights, twiddle factors and both transforms.

    Of a frame of noise, `n_fixed` over the number of cells is the false-alarm rate; a strong echo
    beside it shows what words make of the noise under it.

    Parameters
    ----------
    cube : DataArray (chirp, rx, sample)
        One frame of samples, see `fixed_point_map`.
    radar, chain
        Transforms must be powers of two long.
    bits : ints
        Of each of those words.
    words : WordLengths, optional
        The other words, scaling and rounding; the default's without it.

    Returns
    -------
    Dataset over `bits`
        The fields of `Agreement`, and `overflows`: words saturated anywhere.
    """
    whole("number of bits", len(bits), at_least=1)
    chain = chain.fitted(radar)
    power = power_map(cube, radar, chain)
    threshold = threshold_map(power, radar, chain)
    rows = []
    for length in bits:
        one = replace(
            words or WordLengths(),
            sample_bits=length,
            window_bits=length,
            twiddle_bits=length,
            range_bits=length,
            doppler_bits=length,
        )
        found = fixed_point_map(cube, radar, chain, one)
        rows.append((*agreement(found, power, threshold), int(found.overflows.sum())))
    names = (*Agreement._fields, "overflows")
    columns = zip(names, zip(*rows, strict=True), strict=True)
    return xr.Dataset(
        {name: ("bits", np.array(values)) for name, values in columns}, coords={"bits": list(bits)}
    )

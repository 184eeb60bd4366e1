"""Comparison of fixed-point and floating-point detections over word lengths."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_integer
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import to_decibels
from dechirp.processing.chain import Chain
from dechirp.processing.fixed_point.chain import fixed_point_map
from dechirp.processing.fixed_point.word_lengths import WordLengths
from dechirp.processing.range_doppler_map import power_map, threshold_map
from dechirp.radar.radar import Radar

__all__ = ["DetectionAgreement", "compare_detections", "compare_detections_over_bits"]


class DetectionAgreement(NamedTuple):
    """Agreement of cells over threshold in fixed point and in floating point."""

    n_fixed: int
    n_float: int
    n_only_one: int
    """Number of cells over only one of the thresholds."""
    farthest_db: float
    """Largest margin to the threshold of these cells, in floating point; 0 without any."""
    floor: float
    """Median power of the cells over that in floating point: 1 where words keep the noise."""


@check_argument_types
def compare_detections(
    fixed_point: xr.Dataset, power: xr.DataArray, threshold: xr.DataArray
) -> DetectionAgreement:
    """Compare `fixed_point_map` with `power_map` and `threshold_map` of the same frame.

    Parameters
    ----------
    fixed_point : Dataset
        As `fixed_point_map` returns it.
    power, threshold : DataArray
        As `power_map` and `threshold_map` return them for the same frame, in floating point.
    """
    missing = [name for name in ("detected", "power") if name not in fixed_point]
    if missing:
        raise InvalidSetting(
            "fixed_point",
            value=f"a dataset without {', '.join(missing)}",
            expected="maps over velocity and range",
            fix="pass what fixed_point_map returns",
        )
    is_detected = power.values > threshold.values
    differs = fixed_point.detected.values != is_detected
    with np.errstate(divide="ignore"):  # cells without power
        margin_db = abs(to_decibels(power.values[differs] / threshold.values[differs]))
    watts = fixed_point.power.values * fixed_point.power.attrs["scale"]
    return DetectionAgreement(
        n_fixed=int(fixed_point.detected.sum()),
        n_float=int(is_detected.sum()),
        n_only_one=int(differs.sum()),
        farthest_db=float(margin_db.max(initial=0.0)),
        floor=float(np.median(watts) / np.median(power)),
    )


@check_argument_types
def compare_detections_over_bits(
    cube: xr.DataArray,
    radar: Radar,
    chain: Chain,
    bits: tuple[int, ...] = tuple(range(6, 21, 2)),
    words: WordLengths | None = None,
) -> xr.Dataset:
    """Compare detections for several lengths of samples, weights, twiddles and both transforms.

    For a frame of noise, `n_fixed` over the number of cells is the false-alarm rate; an additional
    strong echo shows the effect of word lengths on the noise under it.

    Parameters
    ----------
    cube : DataArray (chirp, rx, sample)
        One frame of samples, see `fixed_point_map`.
    radar, chain
        Transform lengths must be powers of two.
    bits : ints
        Bits of each of those words.
    words : WordLengths, optional
        Other words, scaling and rounding; the default words if omitted.

    Returns
    -------
    Dataset over `bits`
        Fields of `DetectionAgreement`, and `overflows`: number of saturated words.
    """
    check_integer("number of bits", len(bits), at_least=1)
    chain = chain.fit_to_radar(radar)
    power = power_map(cube, radar, chain)
    threshold = threshold_map(power, radar, chain)
    rows = []
    for length in bits:
        trial_words = replace(
            words or WordLengths(),
            sample_bits=length,
            window_bits=length,
            twiddle_bits=length,
            range_bits=length,
            doppler_bits=length,
        )
        fixed_point = fixed_point_map(cube, radar, chain, trial_words)
        rows.append(
            (*compare_detections(fixed_point, power, threshold), int(fixed_point.overflows.sum()))
        )
    names = (*DetectionAgreement._fields, "overflows")
    columns = zip(names, zip(*rows, strict=True), strict=True)
    return xr.Dataset(
        {name: ("bits", np.array(values)) for name, values in columns}, coords={"bits": list(bits)}
    )

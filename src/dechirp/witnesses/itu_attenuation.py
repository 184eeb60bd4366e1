"""Attenuation by air, rain and cloud from ITU's validation examples."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.theory.attenuation import (
    fog_db_per_km,
    gas_db_per_km,
    oxygen_db_per_km,
    rain_db_per_km,
    vapour_db_per_km,
)
from dechirp.witnesses.base import Comparison, Witness, compare_arrays

_BASIS = "1e-3 of the value, as ITU's examples are used"
_MM_PER_H = 1 / 3.6e6  # m/s
_LIQUID_WATER_K = 273.15  # of P.840's reference for cloud


class ItuAttenuation(Witness):
    """Recommendations P.676, P.838 and P.840, all rows."""

    folder: ClassVar[str] = "itu_validation"
    source: ClassVar[str] = "ITU-R study group 3 validation examples, by ITU-Rpy 6d7f35c"
    licence: ClassVar[str] = "MIT"

    def compare(self, folder: Path) -> Iterator[Comparison]:
        """Compare specific attenuations; of cloud, the ratio of two frequencies at one place.

        The attenuation of cloud itself needs ITU's maps of liquid water, which dechirp has not.
        """
        for edition in ("12", "13"):
            yield from _compare_gases(folder / f"ITURP676-{edition}_gamma.csv", edition)
        yield _compare_rain(folder / "ITURP838-3_rain_specific_attenuation.csv")
        yield _compare_cloud(folder / "ITURP840-8_cloud_attenuation.csv")


def _compare_gases(path: Path, edition: str) -> Iterator[Comparison]:
    rows = _read_rows(path)
    for name, function, theirs in zip(
        ("dry air", "vapour", "air"),
        (oxygen_db_per_km, vapour_db_per_km, gas_db_per_km),
        rows[:, 4:].T,
        strict=True,
    ):
        ours = [
            function(
                ghz * 1e9,
                pressure_pa=hectopascals * 100,
                temperature_k=kelvins,
                vapour_kg_per_m3=grams * 1e-3,
            )
            for ghz, hectopascals, kelvins, grams in rows[:, :4]
        ]
        quantity = f"P.676-{edition}, {name}, {len(rows)} frequencies from 1 to 350 GHz"
        yield compare_arrays(quantity, theirs, ours, unit="dB/km", relative=1e-3, basis=_BASIS)


def _compare_rain(path: Path) -> Comparison:
    rows = _read_rows(path)
    ours = []
    for elevation_deg, ghz, rate, tilt_deg, *_ in rows:
        # On a path that rises, P.838 has cos^2(elevation) cos(2 tilt) in place of cos(2 tilt).
        cosine = math.cos(math.radians(elevation_deg)) ** 2 * math.cos(2 * math.radians(tilt_deg))
        tilt_rad = math.acos(cosine) / 2
        ours.append(rain_db_per_km(ghz * 1e9, rate * _MM_PER_H, tilt_rad=tilt_rad))
    quantity = f"P.838-3, rain, {len(rows)} paths at 14 and 29 GHz"
    return compare_arrays(quantity, rows[:, 6], ours, unit="dB/km", relative=1e-3, basis=_BASIS)


def _compare_cloud(path: Path) -> Comparison:
    rows = _read_rows(path)
    by_frequency = [rows[rows[:, 2] == ghz] for ghz in np.unique(rows[:, 2])]
    low, high = by_frequency
    if not np.array_equal(np.delete(low, (2, 5), axis=1), np.delete(high, (2, 5), axis=1)):
        raise ValueError(f"{path.name}: places differ between both frequencies")
    low_db, high_db = (
        fog_db_per_km(part[0, 2] * 1e9, 1e-3, temperature_k=_LIQUID_WATER_K)
        for part in by_frequency
    )
    return compare_arrays(
        f"P.840-8, cloud, {len(low)} ratios of 29 to 14 GHz",
        high[:, 5] / low[:, 5],
        np.full(len(low), high_db / low_db),
        unit="1",
        relative=1e-3,
        basis=_BASIS,
    )


def _read_rows(path: Path) -> np.ndarray:
    """Return the numbers below the two header lines, whose degree signs are Latin or UTF-8."""
    return np.genfromtxt(path, delimiter=",", skip_header=2, encoding="latin1")

"""Attenuation by air, rain and cloud from ITU's validation examples."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np
import scipy

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
_MAP_PERCENT = [0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 3.0, 5.0]
_MAP_PERCENT += [10.0, 20.0, 30.0, 50.0, 60.0, 70.0, 80.0, 90.0, 95.0, 99.0, 100.0]
_MAPS = "840"  # folder of ITU's maps of liquid water, `itur/data/840` of ITU-Rpy


class ItuAttenuation(Witness):
    """Recommendations P.676, P.838 and P.840, all rows; P.840 with ITU's maps of liquid water."""

    folder: ClassVar[str] = "itu_validation"
    source: ClassVar[str] = "ITU-R study group 3 validation examples, by ITU-Rpy 6d7f35c"
    licence: ClassVar[str] = "MIT"

    def compare(self, folder: Path) -> Iterator[Comparison]:
        """Compare specific attenuations, and the attenuation of cloud on paths to space.

        Without the folder of the maps, of cloud only the ratio of two frequencies at one place.
        """
        for edition in ("12", "13"):
            yield from _compare_gases(folder / f"ITURP676-{edition}_gamma.csv", edition)
        yield _compare_rain(folder / "ITURP838-3_rain_specific_attenuation.csv")
        cloud = folder / "ITURP840-8_cloud_attenuation.csv"
        yield _compare_cloud_ratios(cloud)
        maps = folder / _MAPS
        yield _compare_cloud(cloud, 8, maps, "v7_lred", _reduced_cloud_water_db)
        cloud = folder / "ITURP840-9_cloud_attenuation.csv"
        yield _compare_cloud(cloud, 9, maps, "v9_l", _cloud_water_db)


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


def _compare_cloud_ratios(path: Path) -> Comparison:
    rows = _read_rows(path)
    low, high = (rows[rows[:, 2] == ghz] for ghz in np.unique(rows[:, 2]))
    if not np.array_equal(np.delete(low, (2, 5), axis=1), np.delete(high, (2, 5), axis=1)):
        raise ValueError(f"{path.name}: places differ between both frequencies")
    low_db, high_db = (_reduced_cloud_water_db(part[0, 2]) for part in (low, high))
    return compare_arrays(
        f"P.840-8, cloud, {len(low)} ratios of 29 to 14 GHz",
        high[:, 5] / low[:, 5],
        np.full(len(low), high_db / low_db),
        unit="1",
        relative=1e-3,
        basis=_BASIS,
    )


def _compare_cloud(
    path: Path, edition: int, maps: Path, stem: str, water_db: Callable[[float], float]
) -> Comparison:
    if not maps.is_dir():
        raise FileNotFoundError(
            f"ITU's maps of liquid water, folder {maps.parent.name}/{maps.name}"
        )
    rows = _read_rows(path)
    grid = stem.partition("_")[0]
    axes = [_read_map(maps / f"{grid}_{axis}.npz") for axis in ("lat", "lon")]
    latitudes_deg, longitudes_deg = axes[0][:, 0], axes[1][0]
    ours = []
    for latitude_deg, longitude_deg, ghz, elevation_deg, percent, _ in rows:
        # P.840 interpolates the places on a plane, and the probability by its logarithm.
        lower = max(p for p in _MAP_PERCENT if p <= percent)
        upper = min(p for p in _MAP_PERCENT if p >= percent)
        water = [
            float(
                scipy.interpolate.RegularGridInterpolator(
                    (latitudes_deg[::-1], longitudes_deg),
                    _read_map(maps / f"{stem}_{f'{p:g}'.replace('.', '')}.npz")[::-1],
                )((latitude_deg, longitude_deg % 360)).item()
            )
            for p in (lower, upper)
        ]
        if upper > lower:
            weight = math.log(percent / lower) / math.log(upper / lower)
            water[0] += weight * (water[1] - water[0])
        ours.append(water[0] * water_db(ghz) / math.sin(math.radians(elevation_deg)))
    return compare_arrays(
        f"P.840-{edition}, cloud, {len(rows)} paths to space, with ITU's maps",
        rows[:, 5],
        ours,
        unit="dB",
        relative=1e-3,
        basis=_BASIS,
    )


def _reduced_cloud_water_db(ghz: float) -> float:
    """Return the attenuation by 1 kg/m^2 of water at 0 degrees Celsius, by P.840-8."""
    return float(fog_db_per_km(ghz * 1e9, 1e-3, temperature_k=273.15))


def _cloud_water_db(ghz: float) -> float:
    """Return the attenuation by 1 kg/m^2 of liquid water at its own temperature, by P.840-9."""
    at_reference_db = fog_db_per_km(ghz * 1e9, 1e-3, temperature_k=273.75)
    correction = (
        0.1522 * math.exp(-((ghz + 23.9589) ** 2) / 3.2991e3)
        + 11.51 * math.exp(-((ghz - 219.2096) ** 2) / 2.7595e6)
        - 10.4912
    )
    return float(at_reference_db) * correction


def _read_map(path: Path) -> np.ndarray:
    with np.load(path) as arrays:
        return np.asarray(next(iter(arrays.values())))


def _read_rows(path: Path) -> np.ndarray:
    """Return the numbers below the two header lines, whose degree signs are Latin or UTF-8."""
    return np.genfromtxt(path, delimiter=",", skip_header=2, encoding="latin1")

"""Attenuation of cloud by P.840 from maps of liquid water, on maps that are known functions."""

import math

import numpy as np
import pytest

import dechirp as dc
from dechirp.witnesses import itu_attenuation

LATITUDES_DEG, LONGITUDES_DEG = np.linspace(90, -90, 19), np.linspace(0, 360, 37)
PERCENT = (0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5, 1, 2, 3, 5)
PERCENT += (10, 20, 30, 50, 60, 70, 80, 90, 95, 99, 100)
# Latitude, longitude, GHz, elevation, percent.
PATHS = [
    (51.5, -0.14, 14.25, 31.0, 1.0),
    (51.5, -0.14, 29.0, 31.0, 1.0),
    (-33.9, 18.4, 45.0, 90, 65),
]


def liquid_water(latitude_deg, longitude_deg, percent):
    """Return a map in kg/m^2 that is bilinear over places and linear over the log of percent."""
    return (1 + latitude_deg / 200) * (1 + longitude_deg / 400) * (2 - math.log10(percent) / 4)


def write_set(folder, stem, reference_k, correction):
    (folder / "840").mkdir(exist_ok=True)
    latitudes, longitudes = np.meshgrid(LATITUDES_DEG, LONGITUDES_DEG, indexing="ij")
    grid = stem.partition("_")[0]
    np.savez(folder / "840" / f"{grid}_lat.npz", latitudes)
    np.savez(folder / "840" / f"{grid}_lon.npz", longitudes)
    for percent in PERCENT:
        name = f"{stem}_{f'{percent:g}'.replace('.', '')}.npz"
        np.savez(folder / "840" / name, liquid_water(latitudes, longitudes, percent))
    lines = ["lat,lon,f,el,p,Ac", "header"]
    for latitude, longitude, ghz, elevation, percent in PATHS:
        coefficient = dc.theory.fog_db_per_km(ghz * 1e9, 1e-3, temperature_k=reference_k)
        db = liquid_water(latitude, longitude % 360, percent) * coefficient * correction(ghz)
        db /= math.sin(math.radians(elevation))
        lines.append(f"{latitude},{longitude},{ghz},{elevation},{percent},{db!r}")
    return "\n".join(lines).replace("np.float64(", "").replace(")", "")


def ninth_edition_correction(ghz):
    first = 0.1522 * math.exp(-((ghz + 23.9589) ** 2) / 3299.1)
    return first + 11.51 * math.exp(-((ghz - 219.2096) ** 2) / 2759500) - 10.4912


@pytest.mark.parametrize("is_ninth", [False, True])
def test_rows_of_both_editions_follow_the_maps(tmp_path, is_ninth):
    stem, reference_k = ("v9_l", 273.75) if is_ninth else ("v7_lred", 273.15)
    correction = ninth_edition_correction if is_ninth else lambda ghz: 1.0
    path = tmp_path / "rows.csv"
    path.write_text(write_set(tmp_path, stem, reference_k, correction), encoding="utf-8")
    water_db = (
        itu_attenuation._cloud_water_db if is_ninth else itu_attenuation._reduced_cloud_water_db
    )

    comparison = itu_attenuation._compare_cloud(path, 9, tmp_path / "840", stem, water_db)

    assert comparison.ours == pytest.approx(comparison.theirs, rel=1e-9)


def test_maps_that_are_not_there_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="ITU's maps of liquid water"):
        itu_attenuation._compare_cloud(tmp_path / "rows.csv", 8, tmp_path / "840", "v7_lred", float)

"""Radar cross sections of conducting spheres and plates from the Austin benchmark suite."""

import io
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.scene.bodies.plate import Plate
from dechirp.theory.mie import sphere_rcs_m2
from dechirp.witnesses.base import Comparison, Witness

_SPHERE_RADII_M = {"s2": 0.3, "s7": 9.6}
_INCH_M = 0.0254
# Set sx1, seen along its normal and round its short edge: heights of 6 inches and widths of 10.5,
# the ratio that all plates of the suite have.
_PLATE = Plate(height_m=6 * _INCH_M, width_m=10.5 * _INCH_M)
# At least two wavelengths high, where physical optics is offered: f9, 2.56 GHz, is left out.
_PLATE_FREQUENCIES = ("f10", "fx1", "f11")


class AustinCrossSections(Witness):
    """Spheres by Mie's series, plates by physical optics within 20 dB of the peak."""

    folder: ClassVar[str] = "austin_rcs"
    source: ClassVar[str] = "UTAustinCEMGroup/AustinCEMBenchmarks 300010c, problem sets IA and IIA"
    licence: ClassVar[str] = "permissive"

    def compare(self, folder: Path) -> Iterator[Comparison]:
        """Compare the backscatter of spheres, and of plates the rms difference in dB."""
        yield from _compare_spheres(folder / "IA-spheres.zip")
        yield from _compare_plates(folder / "IIA-plates.zip")


def _compare_spheres(path: Path) -> Iterator[Comparison]:
    for size, radius_m in _SPHERE_RADII_M.items():
        for frequency in ("f1", "f6"):
            rows = _read_rows(path, f"IA-Reference Data/ref_rcs.I.A.{size}.{frequency}.H.txt")
            frequency_hz, backscatter_db = rows[0, 0], rows[0, 3]
            ours = sphere_rcs_m2(radius_m, SPEED_OF_LIGHT / frequency_hz)
            yield Comparison(
                quantity=f"sphere of {2 * radius_m:g} m at {frequency_hz / 1e6:g} MHz",
                theirs=float(backscatter_db),
                ours=float(10 * np.log10(ours)),
                unit="dB",
                tolerance=2e-6,
                basis="six decimals in the file, computed by the series",
            )


def _compare_plates(path: Path) -> Iterator[Comparison]:
    for frequency in _PLATE_FREQUENCIES:
        for polarisation in ("H", "V"):
            name = f"IIA-Reference Data/ref_rcs.II.A.sx1.{frequency}.{polarisation}.txt"
            rows = _read_rows(path, name)
            wavelength_m = SPEED_OF_LIGHT / rows[0, 0]
            azimuth, theirs_db = np.radians(rows[:, 2]), rows[:, 3]
            towards = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)], axis=1)
            ours_db = 10 * np.log10(_PLATE.cross_sections_towards_m2(towards, wavelength_m)[:, 0])
            is_high = theirs_db > theirs_db.max() - 20
            rms_db = np.sqrt(np.mean((ours_db - theirs_db)[is_high] ** 2))
            yield Comparison(
                quantity=f"plate of 6 x 10.5 inches at {rows[0, 0] / 1e9:g} GHz, {polarisation}"
                f" polarised: rms difference of {is_high.sum()} directions",
                theirs=0.0,
                ours=float(rms_db),
                unit="dB",
                tolerance=1.0,
                basis="1 dB rms within 20 dB of the peak, where physical optics holds",
            )


def _read_rows(path: Path, name: str) -> np.ndarray:
    """Return frequency, theta, phi and cross section in dB m^2 of a text in an archive."""
    with zipfile.ZipFile(path) as archive:
        return np.loadtxt(io.BytesIO(archive.read(name)))

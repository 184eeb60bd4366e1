"""Threshold factors that were calibrated before: those that the package contains, and on disk.

A factor depends on the detector and, through the windows and the zero padding, on the correlation
of the noise among neighbouring cells. This correlation is the same for all lengths of a transform
under windows of cosines, such as Hann: `factors.json` therefore serves radars of any size. It holds
the factors of the default windows and those of the scenario with which the studio starts.
`python tests/physics/test_cfar_factor_cache.py` writes it anew.
"""

import hashlib
import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import is_dataclass
from functools import cache
from pathlib import Path

from dechirp.core.disk_cache import (
    key_hash,
    read_cached_numbers,
    source_hash,
    write_cached_numbers,
)
from dechirp.core.values import frozen_dataclass
from dechirp.processing.spectrum import Transform
from dechirp.theory import cfar_calibration

SHIPPED_FACTORS_FILE = Path(__file__).with_name("factors.json")
# Correlations are rounded to this number of decimals, so that those of transforms of different
# lengths, and of other processors, are the same key: they differ by 1e-15.
_CORRELATION_DECIMALS = 12


@frozen_dataclass
class RowFactors:
    """Threshold factor for each row of the cell under test in the box."""

    values: tuple[float, ...]
    relative_error: float
    """Largest relative standard error of the false-alarm probability; 0 if exact."""

    def to_numbers(self) -> list[float]:
        """Return the error and the factors, as files hold them."""
        return [self.relative_error, *self.values]


def find_or_calibrate_factors(
    key: Mapping[str, object],
    estimator_class: type,
    n_rows: int,
    calibrate: Callable[[], RowFactors],
) -> RowFactors:
    """Return the factors of a detector from the package or the disk, else calibrate and keep them.

    Detectors without a file, as in a notebook, or without fields that state all of their settings,
    are calibrated in each process.

    Parameters
    ----------
    key : mapping
        Everything on which the factors depend, apart from the code of the detector.
    estimator_class : type
        Class of the noise estimator, whose code is a part of the key on disk.
    n_rows : int
        Number of rows of the box.
    calibrate : callable
        Computes the factors.
    """
    code_hash = calibration_code_hash(estimator_class)
    key_on_disk = {**key, "source": code_hash}
    numbers = _shipped_factors().get(key_hash(key))
    if numbers is None and code_hash is not None:
        numbers = read_cached_numbers("cfar-factors", key_on_disk)
    if numbers is not None and len(numbers) == n_rows + 1:
        return RowFactors(values=tuple(numbers[1:]), relative_error=numbers[0])
    factors = calibrate()
    if code_hash is not None:
        write_cached_numbers("cfar-factors", key_on_disk, factors.to_numbers())
    return factors


def correlation_hash(transform: Transform, n_neighbours: int) -> str:
    """Return the hash of the rounded correlation of a cell with its neighbours."""
    correlation = transform.noise_correlation_of_bins(n_neighbours)[0].astype(complex)
    rounded = correlation.round(_CORRELATION_DECIMALS) + 0.0  # no negative zeros
    return hashlib.sha256(rounded.tobytes()).hexdigest()[:16]


@cache
def _shipped_factors() -> dict[str, list[float]]:
    """Return the factors that the package contains, by the hash of their key."""
    try:
        factors: dict[str, list[float]] = json.loads(SHIPPED_FACTORS_FILE.read_bytes())
    except FileNotFoundError:  # while it is written anew
        return {}
    return factors


def calibration_code_hash(estimator_class: type, *more_files: Path) -> str | None:
    """Return the hash of the code behind a factor, and of more files.

    None if the code of the detector has no file, or its fields do not state all of its settings.
    """
    if not is_dataclass(estimator_class):
        return None
    return _calibration_code_hash_of_module(estimator_class.__module__, *more_files)


@cache  # by the name: a class would be kept, and remain a detector
def _calibration_code_hash_of_module(estimator_module: str, *more_files: Path) -> str | None:
    own_folder, theory_folder = Path(__file__).parent, Path(cfar_calibration.__file__).parent
    estimator_file = getattr(sys.modules.get(estimator_module), "__file__", None)
    if estimator_file is None:
        return None
    return source_hash(
        *own_folder.glob("*.py"),
        *theory_folder.glob("cfar*.py"),
        Path(estimator_file),
        *more_files,
    )

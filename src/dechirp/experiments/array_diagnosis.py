"""Diagnosis of a file with arrays that another program made."""

from pathlib import Path

import numpy as np

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_false_alarm_probability
from dechirp.core.errors import InvalidSetting, RecordingError
from dechirp.core.text import join_names
from dechirp.processing.diagnosis.diagnose import (
    diagnose_map,
    diagnose_samples,
    diagnose_threshold,
)
from dechirp.processing.diagnosis.diagnosis import Diagnosis
from dechirp.radar.radar import Radar
from dechirp.recordings.array_file import read_array_file

_AXES = ("range_m", "velocity_m_per_s")
_THRESHOLD = "threshold"


@check_argument_types
def diagnose_file(
    path: str | Path,
    *,
    radar: Radar | None = None,
    scale: str = "power",
    n_summed: int | None = None,
    target_range_m: float | None = None,
    target_velocity_m_per_s: float | None = None,
    n_training: int | tuple[int, int] | None = None,
    n_guard: int | tuple[int, int] | None = None,
    pfa: float | None = None,
) -> Diagnosis:
    """Look for well-known mistakes in the arrays of a file.

    A file with an array `range_m` contains a range profile, or with `velocity_m_per_s` too a
    range-Doppler map; without `range_m` it contains beat samples. The samples, profile or map is
    the only other array, and `threshold` is the threshold of a map of powers.

    Parameters
    ----------
    path : path
        NumPy (`.npy`, `.npz`) or MATLAB file (`.mat` up to version 7).
    radar : Radar, optional
        Settings of the radar, required for samples.
    scale, n_summed, target_range_m, target_velocity_m_per_s
        As in `dechirp.diagnosis.diagnose_map`.
    n_training, n_guard, pfa
        As in `dechirp.diagnosis.diagnose_threshold`, required for a threshold.

    Raises
    ------
    RecordingError
        If the file cannot be read, or contains other arrays or no settings for them.
    InvalidSetting
        If an array or setting is invalid, or settings of a threshold are given without one.
    """
    path = Path(path)
    arrays = read_array_file(path)
    names = [name for name in arrays if name not in (*_AXES, _THRESHOLD)]
    if len(names) != 1:
        raise RecordingError(
            path,
            value=f"arrays {join_names(arrays) or 'none'}",
            expected="one array of samples or cells, with range_m for a profile, velocity_m_per_s"
            " too for a map, and threshold if there is one",
            fix="save these arrays under these names",
        )
    if pfa is not None:
        check_false_alarm_probability("pfa", pfa)
    _check_threshold_settings(
        {"n_training": n_training, "n_guard": n_guard, "pfa": pfa},
        has_threshold=_THRESHOLD in arrays,
    )
    values = arrays[names[0]]
    if _AXES[0] not in arrays:
        if radar is None:
            raise _missing_settings(path, "samples", "radar")
        return diagnose_samples(
            values,
            radar,
            target_range_m=target_range_m,
            target_velocity_m_per_s=target_velocity_m_per_s,
        )
    # MATLAB saves vectors as matrices of one row or one column.
    range_m, velocity_m_per_s = (
        np.ravel(arrays[name]) if name in arrays else None for name in _AXES
    )
    if velocity_m_per_s is None and values.ndim == 2 and 1 in values.shape:
        values = np.ravel(values)
    diagnosis = diagnose_map(
        values,
        np.asarray(range_m),
        velocity_m_per_s,
        scale=scale,
        n_summed=n_summed,
        radar=radar,
        target_range_m=target_range_m,
        target_velocity_m_per_s=target_velocity_m_per_s,
    )
    if _THRESHOLD not in arrays:
        return diagnosis
    if n_training is None or n_guard is None or pfa is None:
        raise _missing_settings(path, "threshold", "n_training, n_guard or pfa")
    if scale != "power":
        raise RecordingError(
            path,
            value=f"a threshold of a map of {scale}",
            expected="linear powers",
            fix="save map and threshold as powers",
        )
    return diagnosis + diagnose_threshold(
        np.reshape(arrays[_THRESHOLD], values.shape)
        if arrays[_THRESHOLD].size == values.size
        else arrays[_THRESHOLD],
        values,
        n_training,
        n_guard,
        pfa,
        n_summed=n_summed or 1,
    )


def _check_threshold_settings(settings: dict[str, object], *, has_threshold: bool) -> None:
    """Raise `InvalidSetting` for settings of a threshold without one."""
    given = [name for name, value in settings.items() if value is not None]
    if given and not has_threshold:
        raise InvalidSetting(
            given[0],
            value=settings[given[0]],
            expected=f"an array {_THRESHOLD} in the file, to which {join_names(given)} would apply",
            fix=f"save the threshold as {_THRESHOLD}, or leave out {join_names(given)}",
        )


def _missing_settings(path: Path, content: str, settings: str) -> RecordingError:
    return RecordingError(
        path,
        value=f"{content} without {settings}",
        expected=f"the settings with which the {content} were made",
        fix=f"give {settings}",
    )

"""Engine of xarray: `xr.open_dataset(path, engine="dechirp")` for data sets and recordings."""

from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar

import xarray as xr
from xarray.backends import BackendEntrypoint

from dechirp.core.errors import InvalidSetting
from dechirp.recordings.recording import open as open_recording
from dechirp.results.data_set import is_data_set, open_data_set_groups


class DechirpBackend(BackendEntrypoint):
    """Opens data sets of studies and recordings of all formats lazily, in chunks of one frame."""

    description = "Radar recordings and data sets of dechirp studies"
    url = "https://dechirp.readthedocs.io"
    open_dataset_parameters: ClassVar[Any] = (
        "filename_or_obj",
        "drop_variables",
        "group",
        "radar",
        "settings",
        "device",
        "format",
        "axes",
        "encoding",
        "iq",
        "calibration",
        "frames",
    )

    def open_dataset(  # type: ignore[override]
        self,
        filename_or_obj: str | Path,
        *,
        drop_variables: str | Iterable[str] | None = None,
        group: str | None = None,
        **options: Any,
    ) -> xr.Dataset:
        """Open a data set or a recording.

        Parameters
        ----------
        filename_or_obj : path
            Folder `data.zarr` of a study, or a recording as for `dechirp.open`.
        drop_variables : str or names, optional
            Variables to leave out.
        group : str, optional
            Group of a data set, as `truth`, or a table of a recording, as `detections`; by default
            the samples.
        **options
            Of `dechirp.open`: `radar`, `device`, `axes` and so on.

        Raises
        ------
        InvalidSetting
            If the group does not exist, or a data set is opened with options of recordings.
        RecordingError
            As `dechirp.open` does, or when damaged samples are loaded.
        """
        if not isinstance(filename_or_obj, str | PathLike):
            raise InvalidSetting(
                "filename_or_obj",
                value=f"a {type(filename_or_obj).__name__}",
                expected="a path",
                fix="write open files and bytes to a file, and give its name",
            )
        path = Path(filename_or_obj)
        if is_data_set(path):
            _check_no_options(path, options)
            groups = open_data_set_groups(path)
        else:
            recording = open_recording(path, **options)
            groups = dict(recording.tables)
            if recording.sizes:
                groups[""] = recording.lazy_cube.to_dataset(name="cube")
            if recording.points is not None:
                groups.setdefault("detections", recording.points)
                groups.setdefault("", recording.points)
        if (group or "") not in groups:
            raise InvalidSetting(
                "group",
                value=group,
                expected=" or ".join(filter(None, groups)) or "no group",
                fix="choose one of them, or none for the samples",
            )
        dropped = [drop_variables] if isinstance(drop_variables, str) else drop_variables or ()
        return groups[group or ""].drop_vars(dropped, errors="ignore")


def _check_no_options(path: Path, options: dict[str, Any]) -> None:
    for name, value in options.items():
        raise InvalidSetting(
            name,
            value=value,
            expected=f"no options of recordings for the data set {path}",
            fix="leave it out; select parts of the arrays by .isel",
        )

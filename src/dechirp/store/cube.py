"""The samples of an experiment on disk, with its truth and its detections (zarr 3)."""

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
import zarr

from dechirp.config.texts import as_text
from dechirp.core.conventions import CUBE_AXES, axis, chirp_times
from dechirp.echoes.codes import codes, is_coded, whole_numbers
from dechirp.radar.calibration import Calibration
from dechirp.radar.radar import Radar

FORMAT_VERSION = 1

# Readers that take chunks whole hold one of so many bytes: a piece of a frame, or whole frames.
_CHUNK_BYTES = 2**25
# Small frames share a file: making one takes as long as writing 0.5 MiB.
_FILE_BYTES = 2**22
BESIDE = ("transmitter", "chirp_time", "gap")
"""Coordinates along frames and chirps that are no axes."""


def write_cube(
    path: Path,
    frames: Iterable[xr.DataArray],
    *,
    n_frames: int,
    radar: Radar,
    groups: Mapping[str, xr.Dataset | None],
    device: str | None = None,
    iq: str | None = None,
) -> None:
    """Write a new store, one frame after the other, so that one is held at a time.

    Samples that a converter rounded are written as its codes, int16, with an axis `iq` where
    they are complex; times the attribute `scale` they are the samples. Nothing is compressed:
    chunks are the numbers one after the other, as fast on disk as the disk takes them.

    Parameters
    ----------
    path : Path
        Folder of the store.
    frames : iterable of DataArray (frame, chirp, rx, sample)
        One frame each, n_frames of them; int16 as `codes` gives them, else floats.
    radar : Radar
        Becomes the attribute `radar`, as a settings file writes it; its calibration, where it
        has one, is also a group of that name, over `element`.
    groups : mapping
        Detections, truth and what else there is: become groups of these names.
    device, iq : str, optional
        Kind of the chip that made the samples, and which part of them came first, where known.
    """
    attributes = {"format_version": FORMAT_VERSION, "radar": as_text(radar, None)}
    attributes |= {name: of for name, of in (("device", device), ("iq", iq)) if of is not None}
    store = zarr.create_group(path, zarr_format=3, attributes=attributes)
    starts_s = np.zeros(n_frames)
    beside: dict[str, list[np.ndarray]] = {"chirp_time": [], "gap": []}
    array, as_codes = None, False
    for index, frame in enumerate(frames):
        in_order = frame.dims[: len(CUBE_AXES)] == CUBE_AXES  # xarray takes as long as the disk
        labelled = frame if in_order else frame.transpose(*CUBE_AXES, ...)
        if array is None:
            as_codes = labelled.dtype != np.int16 and is_coded(labelled)
            array = _empty(store, codes(labelled) if as_codes else labelled, n_frames)
            for name in (*CUBE_AXES[1:], "transmitter"):
                if name in labelled.coords:
                    _add_array(store, name, labelled[name])
        numbers = labelled.values[0]
        if as_codes:
            numbers = whole_numbers(numbers, labelled.attrs["scale"])
        _put(path / "cube", array, index, numbers)
        starts_s[index] = labelled["frame"].values[0]
        for name, of_frames in beside.items():
            if name in labelled.coords:
                of_frames.append(labelled[name].transpose("frame", "chirp").values[0])
    _add_array(store, "frame", xr.DataArray(axis("frame", starts_s)))
    if beside["chirp_time"]:
        _add_array(store, "chirp_time", xr.DataArray(chirp_times(np.array(beside["chirp_time"]))))
    if beside["gap"]:
        _add_array(store, "gap", xr.DataArray(np.array(beside["gap"]), dims=("frame", "chirp")))
    calibration = None if radar.calibration is None else _calibration(radar.calibration)
    for name, dataset in {**groups, "calibration": calibration}.items():
        if dataset is not None:
            _add_group(path, name, dataset)


def _calibration(calibration: Calibration) -> xr.Dataset:
    tx, rx = np.array(calibration.elements).T
    made = xr.Dataset(
        {
            "tx": ("element", tx),
            "rx": ("element", rx),
            "gain": ("element", np.array(calibration.gain) @ np.array([1, 1j])),
        },
        attrs={"range_offset_m": calibration.range_offset_m},
    )
    if calibration.position_error_m is not None:
        errors_m = np.array(calibration.position_error_m)
        made["position_error"] = (("element", "axis"), errors_m, {"units": "m"})
    if calibration.residual is not None:
        made.attrs["residual"] = calibration.residual
    return made


def _empty(store: zarr.Group, frame: xr.DataArray, n_frames: int) -> zarr.Array[Any]:
    n_chirps = frame.sizes["chirp"]
    chirps = max(1, min(n_chirps, _CHUNK_BYTES * n_chirps // frame.nbytes))
    frames = max(1, min(n_frames, min(_FILE_BYTES, _CHUNK_BYTES) // frame.nbytes))
    # LZ4 would save a quarter of int16 noise, with bits shuffled a half, and take ten times as
    # long as writing it; the samples of floats it does not make smaller at all.
    return store.create_array(
        "cube",
        shape=(n_frames, *frame.shape[1:]),
        chunks=(frames, chirps, *frame.shape[2:]),
        dtype=frame.dtype,
        compressors=None,
        chunk_key_encoding={"name": "default", "separator": "."},
        dimension_names=tuple(map(str, frame.dims)),
        attributes={**_attributes(frame), **_labels(frame)},
    )


def _put(folder: Path, array: zarr.Array[Any], index: int, samples: np.ndarray) -> None:
    """Append a frame to its chunks: zarr would take 2 ms for each, and hold all of it."""
    frames, chirps = array.chunks[:2]
    is_full = (index + 1) % frames == 0 or index + 1 == array.shape[0]
    for start in range(0, len(samples), chirps):
        place = (index // frames, start // chirps, *(0 for _ in array.shape[2:]))
        numbers = np.ascontiguousarray(samples[start : start + chirps])
        with (folder / array.metadata.encode_chunk_key(place)).open("ab") as file:
            file.write(numbers.astype(numbers.dtype.newbyteorder("<"), copy=False).data)
            if is_full:  # the last of all is as long as the others
                file.truncate(math.prod(array.chunks) * array.dtype.itemsize)


def _attributes(frame: xr.DataArray) -> dict[str, Any]:
    """Attributes of the samples; `scale` of codes alone, as a reader multiplies with it."""
    no_codes = () if frame.dtype == np.int16 else ("scale",)
    return {str(name): said for name, said in frame.attrs.items() if name not in no_codes}


def _labels(frame: xr.DataArray) -> dict[str, str]:
    """Name the coordinates that are no axes, so that xarray reads them as coordinates."""
    named = [name for name in BESIDE if name in frame.coords]
    return {"coordinates": " ".join(named)} if named else {}


def _add_array(store: zarr.Group, name: str, array: xr.DataArray) -> None:
    store.create_array(
        name,
        data=array.values,
        dimension_names=tuple(map(str, array.dims)),
        attributes=dict(array.attrs),
    )


def _add_group(store: Path, name: str, dataset: xr.Dataset) -> None:
    # Texts of variable length: zarr has no settled form for those of a fixed one.
    texts = {key: v.astype(object) for key, v in dataset.variables.items() if v.dtype.kind == "U"}
    of_axes = {key: texts.pop(key) for key in list(texts) if key in dataset.coords}
    plain = dataset.drop_encoding()  # of the file that it may come from
    plain.assign(texts).assign_coords(of_axes).to_zarr(
        store, group=name, mode="a", zarr_format=3, consolidated=False
    )

"""The samples of an experiment on disk, with its truth and its detections (zarr 3)."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
import zarr
from zarr.codecs import BloscCodec

from dechirp.config.texts import dump
from dechirp.config.tree import read_tree
from dechirp.core.conventions import CUBE_AXES, axis, chirp_times
from dechirp.echoes.codes import codes, is_coded
from dechirp.radar.calibration import Calibration
from dechirp.radar.radar import Radar

FORMAT_VERSION = 1

_CHUNK_BYTES = 2**25  # a frame, unless it is larger: one chunk is held at a time


def write_cube(
    path: Path,
    frames: Iterable[xr.DataArray],
    *,
    n_frames: int,
    radar: Radar,
    groups: Mapping[str, xr.Dataset | None],
) -> None:
    """Write a new store, one frame after the other, so that one is held at a time.

    Samples that a simulated converter rounded are written as its codes, int16, with an axis
    `iq` where they are complex; times the attribute `scale` they are the samples.

    Parameters
    ----------
    path : Path
        Folder of the store.
    frames : iterable of DataArray (frame, chirp, rx, sample)
        One frame each, n_frames of them.
    radar : Radar
        Becomes the attribute `radar`, as a settings file writes it; its calibration, where it
        has one, is also a group of that name, over `element`.
    groups : mapping
        Detections, truth and what else there is: become groups of these names.
    """
    attributes = {"format_version": FORMAT_VERSION, "radar": read_tree(dump(radar), "").plain}
    store = zarr.create_group(path, zarr_format=3, attributes=attributes)
    starts_s, chirp_times_s = np.zeros(n_frames), []
    array, as_codes = None, False
    for index, frame in enumerate(frames):
        labelled = frame.transpose(*CUBE_AXES)
        if array is None:
            as_codes = is_coded(labelled)
        labelled = codes(labelled) if as_codes else labelled
        if array is None:
            array = _empty(store, labelled, n_frames)
            for name in CUBE_AXES[1:]:
                _add_array(store, name, labelled[name])
            if "transmitter" in labelled.coords:
                _add_array(store, "transmitter", labelled.transmitter)
        per_chunk = array.chunks[1]
        for start in range(0, labelled.sizes["chirp"], per_chunk):
            array[index, start : start + per_chunk] = labelled.values[0, start : start + per_chunk]
        starts_s[index] = labelled.frame.item()
        if "chirp_time" in labelled.coords:
            chirp_times_s.append(labelled.chirp_time.values[0])
    _add_array(store, "frame", xr.DataArray(axis("frame", starts_s)))
    if chirp_times_s:
        _add_array(store, "chirp_time", xr.DataArray(chirp_times(np.array(chirp_times_s))))
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
    per_chunk = max(1, min(n_chirps, _CHUNK_BYTES * n_chirps // frame.nbytes))
    # LZ4 halves what came from a converter, as quickly as the disk would take it whole; the
    # default, zstd, would gain 4 % more at a quarter of the speed.
    return store.create_array(
        "cube",
        shape=(n_frames, *frame.shape[1:]),
        chunks=(1, per_chunk, *frame.shape[2:]),
        dtype=frame.dtype,
        compressors=BloscCodec(cname="lz4"),
        dimension_names=tuple(map(str, frame.dims)),
        attributes={**_attributes(frame), **_labels(frame)},
    )


def _attributes(frame: xr.DataArray) -> dict[str, Any]:
    """Attributes of the samples; `scale` of codes alone, as a reader multiplies with it."""
    no_codes = () if frame.dtype == np.int16 else ("scale",)
    return {str(name): said for name, said in frame.attrs.items() if name not in no_codes}


def _labels(frame: xr.DataArray) -> dict[str, str]:
    """Name the coordinates that are no axes, so that xarray reads them as coordinates."""
    named = [name for name in ("transmitter", "chirp_time") if name in frame.coords]
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
    dataset.assign_coords(texts).to_zarr(
        store, group=name, mode="a", zarr_format=3, consolidated=False
    )

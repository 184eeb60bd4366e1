"""Zarr 3 store of the samples of an experiment, with its truth and detections."""

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd  # type: ignore[import-untyped]
import xarray as xr

from dechirp.config.dumping import to_yaml_data
from dechirp.core.conventions import CUBE_AXES, axis_coordinate, chirp_time_coordinate
from dechirp.radar.calibration import Calibration
from dechirp.radar.radar import Radar
from dechirp.simulation.adc_codes import extract_adc_codes, has_adc_codes, samples_to_codes

if TYPE_CHECKING:
    import zarr

FORMAT_VERSION = 1

# Readers hold one chunk of this size: a part of a frame, or several frames.
_CHUNK_BYTES = 2**25
# Small frames share a file: creating one takes as long as writing 0.5 MiB.
_FILE_BYTES = 2**22
NON_AXIS_COORDINATES = ("transmitter", "chirp_time", "gap")
"""Coordinates over frames and chirps that are not axes."""


def write_cube_store(
    path: Path,
    frames: Iterable[xr.DataArray],
    *,
    n_frames: int,
    radar: Radar,
    groups: Mapping[str, xr.Dataset | None],
    device: str | None = None,
    iq: str | None = None,
) -> None:
    """Write a new store frame by frame, so that one frame is held at a time.

    Quantised samples are written as converter codes, int16, with an axis `iq` if complex; codes
    times
    the attribute `scale` are the samples. Nothing is compressed: chunks are contiguous numbers, so
    writing is as fast as the disk.

    Parameters
    ----------
    path : Path
        Folder of the store.
    frames : iterable of DataArray (frame, chirp, rx, sample)
        n_frames cubes of one frame each; int16 as `codes` returns them, else floats.
    radar : Radar
        Becomes the attribute `radar`, in the form of a settings file; its calibration, if any, is
        also a group of that name, over `element`.
    groups : mapping
        Detections, truth and other tables: become groups of these names.
    device, iq : str, optional
        Kind of the chip that recorded the samples, and the order of their I and Q parts.
    """
    import zarr  # takes 0.15 s, and this module has names that others need

    attributes = {"format_version": FORMAT_VERSION, "radar": to_yaml_data(radar, None)}
    attributes |= {
        name: text for name, text in (("device", device), ("iq", iq)) if text is not None
    }
    store = zarr.create_group(path, zarr_format=3, attributes=attributes)
    starts_s = np.zeros(n_frames)
    frame_coordinates: dict[str, list[np.ndarray]] = {"chirp_time": [], "gap": []}
    array, is_quantised = None, False
    for index, frame in enumerate(frames):
        # Transposing with xarray takes as long as the disk.
        in_order = frame.dims[: len(CUBE_AXES)] == CUBE_AXES
        labelled = frame if in_order else frame.transpose(*CUBE_AXES, ...)
        if array is None:
            is_quantised = labelled.dtype != np.int16 and has_adc_codes(labelled)
            array = _create_cube_array(
                store, extract_adc_codes(labelled) if is_quantised else labelled, n_frames
            )
            for name in (*CUBE_AXES[1:], "transmitter"):
                if name in labelled.coords:
                    _add_array(store, name, labelled[name])
        frame_samples = labelled.values[0]
        if is_quantised:
            frame_samples = samples_to_codes(frame_samples, labelled.attrs["scale"])
        _append_frame_to_chunks(path / "cube", array, index, frame_samples)
        starts_s[index] = labelled["frame"].values[0]
        for name, rows in frame_coordinates.items():
            if name in labelled.coords:
                rows.append(labelled[name].transpose("frame", "chirp").values[0])
    _add_array(store, "frame", xr.DataArray(axis_coordinate("frame", starts_s)))
    if frame_coordinates["chirp_time"]:
        _add_array(
            store,
            "chirp_time",
            xr.DataArray(chirp_time_coordinate(np.array(frame_coordinates["chirp_time"]))),
        )
    if frame_coordinates["gap"]:
        _add_array(
            store, "gap", xr.DataArray(np.array(frame_coordinates["gap"]), dims=("frame", "chirp"))
        )
    calibration = None if radar.calibration is None else _calibration_to_dataset(radar.calibration)
    for name, dataset in {**groups, "calibration": calibration}.items():
        if dataset is not None:
            _add_dataset_group(path, name, dataset)


def _calibration_to_dataset(calibration: Calibration) -> xr.Dataset:
    tx, rx = np.array(calibration.elements).T
    dataset = xr.Dataset(
        {
            "tx": ("element", tx),
            "rx": ("element", rx),
            "gain": ("element", np.array(calibration.gain) @ np.array([1, 1j])),
        },
        attrs={"range_offset_m": calibration.range_offset_m},
    )
    if calibration.position_error_m is not None:
        errors_m = np.array(calibration.position_error_m)
        dataset["position_error"] = (("element", "axis"), errors_m, {"units": "m"})
    if calibration.residual is not None:
        dataset.attrs["residual"] = calibration.residual
    return dataset


def _create_cube_array(
    store: "zarr.Group", frame: xr.DataArray, n_frames: int
) -> "zarr.Array[Any]":
    n_chirps = frame.sizes["chirp"]
    chirps = max(1, min(n_chirps, _CHUNK_BYTES * n_chirps // frame.nbytes))
    frames = max(1, min(n_frames, min(_FILE_BYTES, _CHUNK_BYTES) // frame.nbytes))
    # LZ4 would save a quarter of int16 noise, half with shuffled bits, and take ten times as long
    # as writing; it does not compress float samples at all.
    return store.create_array(
        "cube",
        shape=(n_frames, *frame.shape[1:]),
        chunks=(frames, chirps, *frame.shape[2:]),
        dtype=frame.dtype,
        compressors=None,
        chunk_key_encoding={"name": "default", "separator": "."},
        dimension_names=tuple(map(str, frame.dims)),
        attributes={
            **_attributes_without_float_scale(frame),
            **_non_axis_coordinates_attribute(frame),
        },
    )


def _append_frame_to_chunks(
    folder: Path, array: "zarr.Array[Any]", index: int, samples: np.ndarray
) -> None:
    """Append a frame to its chunk files; zarr needs 2 ms a chunk and holds all of it."""
    frames, chirps = array.chunks[:2]
    is_full = (index + 1) % frames == 0 or index + 1 == array.shape[0]
    for start in range(0, len(samples), chirps):
        chunk_index = (index // frames, start // chirps, *(0 for _ in array.shape[2:]))
        block = np.ascontiguousarray(samples[start : start + chirps])
        with (folder / array.metadata.encode_chunk_key(chunk_index)).open("ab") as file:
            file.write(block.astype(block.dtype.newbyteorder("<"), copy=False).data)
            if is_full:  # the last chunk has full length, too
                file.truncate(math.prod(array.chunks) * array.dtype.itemsize)


def _attributes_without_float_scale(frame: xr.DataArray) -> dict[str, Any]:
    """Return the attributes of the samples; only codes have `scale`, which readers multiply."""
    excluded = () if frame.dtype == np.int16 else ("scale",)
    return {str(name): attribute for name, attribute in frame.attrs.items() if name not in excluded}


def _non_axis_coordinates_attribute(frame: xr.DataArray) -> dict[str, str]:
    """List the non-axis coordinates, so that xarray reads them as coordinates."""
    names = [name for name in NON_AXIS_COORDINATES if name in frame.coords]
    return {"coordinates": " ".join(names)} if names else {}


def _add_array(store: "zarr.Group", name: str, array: xr.DataArray) -> None:
    store.create_array(
        name,
        data=array.values,
        dimension_names=tuple(map(str, array.dims)),
        attributes=dict(array.attrs),
    )


def _add_dataset_group(store: Path, name: str, dataset: xr.Dataset) -> None:
    # Variable-length texts: Zarr has no stable specification of fixed-length ones.
    texts = {key: v.astype(object) for key, v in dataset.variables.items() if v.dtype.kind == "U"}
    coordinate_texts = {key: texts.pop(key) for key in list(texts) if key in dataset.coords}
    for key in dataset.indexes.keys() & coordinate_texts.keys():
        text = coordinate_texts[key]
        # From arrays, xarray would import pint, 0.1 s of CPU time.
        coordinate_texts[key] = xr.IndexVariable(  # type: ignore[no-untyped-call]
            key, pd.Index(text.values, dtype=object), text.attrs
        )
    unencoded = dataset.drop_encoding()  # of a source file
    unencoded.assign(texts).assign_coords(coordinate_texts).to_zarr(
        store, group=name, mode="a", zarr_format=3, consolidated=False
    )

"""Items of a data set: the samples of a trial as integers with a scale, detections and truth."""

import io
from collections.abc import Mapping
from dataclasses import dataclass
from math import prod
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.detection_columns import TABLE, UNITS
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import to_decibels
from dechirp.evaluation.trial import TrialContext, TrialResult
from dechirp.scene.aliasing import RangeVelocity, alias_range_velocity, range_doppler_map_position
from dechirp.scene.rcs import target_cross_sections_m2
from dechirp.scene.scene import Scene
from dechirp.simulation.adc_codes import extract_adc_codes, has_adc_codes

MAX_CODE = 2**15 - 1
STEP_DB = 0.01
"""Step of maps: 16 bits span 655 dB."""

TRUTH_COLUMNS: Mapping[str, tuple[str, str]] = {
    "range": (
        "m",
        "from the origin of the array, at mid-frame",
    ),
    "velocity": ("m/s", "rate of change of range, receding positive"),
    "azimuth": ("rad", "to the left of boresight"),
    "elevation": ("rad", "above the horizontal"),
    "rcs": ("m^2", "mean radar cross section, of all scatterers"),
    "snr": ("1", "mean ratio after integration, against the noise that is added"),
    "map_range": ("m", "range of the peak on the map: coupled to velocity, aliased"),
    "map_velocity": ("m/s", "velocity of the peak on the map: aliased"),
}
"""Units and descriptions of the truth of each target in each frame."""

DETECTION_COLUMNS: Mapping[str, tuple[str, str]] = {
    **{column.name: (column.unit, column.long_name) for column in TABLE},
    "target": ("1", "index of the target that the detection belongs to; -1 without one"),
}
"""Units and descriptions of the columns of detections."""


@dataclass(frozen=True)
class ItemShapes:
    """Shapes of the items of a study, equal at all of its points."""

    targets: tuple[str, ...]
    n_frames: int
    cube: tuple[int, ...]
    """(frame, chirp, rx, sample), and iq for complex samples; empty if not kept."""
    power: tuple[int, ...]
    """(frame, velocity, range); empty if not kept."""

    @property
    def uncompressed_item_bytes(self) -> int:
        """Size of samples and maps of one item, before compression."""
        return sum(2 * prod(shape) for shape in (self.cube, self.power) if shape)


def kept_item_shapes(context: TrialContext, keep: tuple[str, ...]) -> ItemShapes:
    """Return the shapes of the items of a trial context.

    Raises
    ------
    InvalidSetting
        If maps of triangular frames are requested: these have two a frame.
    """
    radar, n_frames = context.radar, len(context.times_s)
    frame, chirp = radar.frame, radar.frame.chirp
    if "maps" in keep and frame.has_falling_ramps:
        raise InvalidSetting(
            "keep",
            value="maps, of ramps that rise and fall",
            expected="cubes or detections: such frames have two maps each",
            fix="keep cubes",
        )
    iq = (2,) if chirp.sampling == "complex" else ()
    cube = (n_frames, frame.n_chirps_total, radar.array.n_rx, chirp.n_samples, *iq)
    axes = item_axis_coordinates(context)
    shape = (n_frames, axes["velocity_bins"].shape[1], len(axes["range_bins"]))
    return ItemShapes(
        targets=context.target_names,
        n_frames=n_frames,
        cube=cube if "cubes" in keep else (),
        power=shape if "maps" in keep else (),
    )


def item_axis_coordinates(context: TrialContext) -> dict[str, np.ndarray]:
    """Return the coordinates of samples and maps: times in s, velocities in m/s, ranges in m."""
    frame, chirp = context.radar.frame, context.radar.frame.chirp
    noise = context.chain.map_noise_statistics(context.radar)
    frames = [frame.for_frame(number) for number in range(len(context.times_s))]
    bins = noise.doppler_transform.n_bins
    return {
        "frame_time": np.array(context.times_s, dtype=float),
        "chirp_time": np.array([frame_at.chirp_starts_s for frame_at in frames], dtype=float),
        "sample_time": chirp.adc_start_s + np.arange(chirp.n_samples) / chirp.sample_rate_hz,
        "velocity_bins": np.array([frame_at.velocity_bins_m_per_s(bins) for frame_at in frames]),
        "range_bins": chirp.range_bins_m(noise.range_transform.n_bins),
    }


class Item(NamedTuple):
    """Data kept of one trial."""

    cube: np.ndarray | None
    """int16, see `ItemShapes.cube`."""
    scale: float
    """Factor from its integers to samples, sqrt(W); NaN if not kept."""
    power: np.ndarray | None
    """int16, see `ItemShapes.power`: `STEP_DB` over 1 W."""
    detections: Mapping[str, np.ndarray]
    """See `DETECTION_COLUMNS`; empty if not kept."""


def make_item_of_trial(
    shapes: ItemShapes, keep: tuple[str, ...], cube: xr.DataArray | None, result: TrialResult
) -> Item:
    """Build the item of a trial; raise `InvalidSetting` if its shapes differ."""
    codes, scale, power_codes = None, np.nan, None
    if shapes.cube:
        assert cube is not None
        codes, scale = quantise_samples_to_int16(cube)
        _check_item_shape(codes.shape, shapes.cube, "samples")
    if shapes.power:
        assert result.maps is not None
        power_codes = np.stack([quantise_power_to_int16_db(power) for power in result.maps])
        _check_item_shape(power_codes.shape, shapes.power, "maps")
    rows: dict[str, np.ndarray] = {}
    if "detections" in keep:
        rows = {name: np.asarray(result.detections[name]) for name in UNITS}
        rows["target"] = result.association.target
    return Item(codes, scale, power_codes, rows)


def quantise_samples_to_int16(cube: xr.DataArray) -> tuple[np.ndarray, float]:
    """Quantise samples to int16, (frame, chirp, rx, sample[, iq]), and return the step size.

    ADC codes are kept where they exist; else the largest part of any sample is full scale.
    """
    if has_adc_codes(cube):
        return extract_adc_codes(cube).values, float(cube.attrs["scale"])
    samples = np.ascontiguousarray(cube.values)
    if np.iscomplexobj(samples):
        samples = samples.view(samples.real.dtype).reshape(*samples.shape, 2)
    peak = float(np.abs(samples).max(initial=0))
    scale = peak / MAX_CODE if peak else 1.0
    return np.rint(samples / samples.dtype.type(scale)).astype(np.int16), scale


def quantise_power_to_int16_db(power: np.ndarray) -> np.ndarray:
    """Quantise powers to int16 in steps of `STEP_DB` over 1 W; zero power gives the minimum."""
    with np.errstate(divide="ignore"):
        steps = to_decibels(power) / STEP_DB
    return np.clip(np.rint(steps), -MAX_CODE - 1, MAX_CODE).astype(np.int16)


def truth_per_frame_and_target(context: TrialContext) -> dict[str, np.ndarray]:
    """Return the truth of all targets in a trial, see `TRUTH_COLUMNS`, each (frame, target)."""
    truth = context.truth.transpose("frame", "target")
    labels = {
        name: np.asarray(truth[name].values, dtype=float)
        if name in truth
        else np.full((truth.sizes["frame"], truth.sizes["target"]), np.nan)
        for name in TRUTH_COLUMNS
    }
    chirp = context.radar.frame.chirp
    labels["rcs"] = target_cross_sections_m2(context.scene, context.times_s, chirp.wavelength_m)
    for frame in range(len(context.times_s)):
        radar = context.radar.for_frame(frame)
        place = RangeVelocity(labels["range"][frame], labels["velocity"][frame])
        positions = range_doppler_map_position(alias_range_velocity(place, radar), radar)
        labels["map_range"][frame], labels["map_velocity"][frame] = positions
    return labels


def class_name_per_target(scene: Scene) -> list[str]:
    """Return the class of each target: the kind of its body, or `point`."""
    return ["point" if target.body is None else target.body.kind() for target in scene.targets]


def arrays_to_compressed_bytes(arrays: Mapping[str, np.ndarray]) -> bytes:
    """Compress small arrays to bytes, identical for identical arrays."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **dict(arrays))
    return buffer.getvalue()


def arrays_from_compressed_bytes(content: bytes) -> dict[str, np.ndarray]:
    """Restore the arrays of `arrays_to_compressed_bytes`."""
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def _check_item_shape(shape: tuple[int, ...], expected: tuple[int, ...], array_name: str) -> None:
    if shape != expected:
        raise InvalidSetting(
            "keep",
            value=f"{array_name} of shape {shape}",
            expected=f"{expected}, as at the first point: a data set has items of one shape",
            fix="vary settings that leave it as it is; make a data set of each shape",
        )

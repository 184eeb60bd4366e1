"""What of a trial becomes an item of a data set: whole numbers with a scale, rows and labels."""

import io
from collections.abc import Mapping
from dataclasses import dataclass
from math import prod
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.errors import InvalidSetting
from dechirp.core.units import decibels
from dechirp.echoes.codes import codes, is_coded
from dechirp.evaluate.look import Case, Look
from dechirp.process.detect import UNITS
from dechirp.scene.folding import Place, folded, on_map
from dechirp.scene.rcs import target_cross_sections_m2
from dechirp.scene.scene import Scene

LARGEST = 2**15 - 1
STEP_DB = 0.01
"""Of maps: 16 bits span 655 dB."""

TRUTH: Mapping[str, tuple[str, str]] = {
    "range": (
        "m",
        "from the origin of the array, at mid-frame",
    ),
    "velocity": ("m/s", "rate of change of range, receding positive"),
    "azimuth": ("rad", "to the left of boresight"),
    "elevation": ("rad", "above the horizontal"),
    "rcs": ("m^2", "mean radar cross section, of all scatterers"),
    "snr": ("1", "mean ratio after integration, against the noise that is added"),
    "map_range": ("m", "where the peak lies on the map: coupled to velocity, folded"),
    "map_velocity": ("m/s", "where the peak lies on the map: folded"),
}
"""Units and words of what is known of each target in each frame."""

_DETECTED = {
    "frame": "number of the frame in the item",
    "time": "instant that the estimates refer to",
    "range": "from the origin of the array",
    "velocity": "rate of change of range; of the fold about zero where fold is not told",
    "azimuth": "to the left of boresight",
    "elevation": "above the horizontal",
    "snr": "ratio after integration over samples, chirps and channels",
    "fold": "spans of unambiguous velocity that were added",
    "fold_confidence": "probability of that fold",
    "target": "place of the target that the detection is of; -1 where it is of none",
}
DETECTED: Mapping[str, tuple[str, str]] = {
    name: (units, _DETECTED.get(name, f"standard error of {name.removesuffix('_std')}"))
    for name, units in {**UNITS, "target": "1"}.items()
}
"""Units and words of the columns of detections."""


@dataclass(frozen=True)
class Form:
    """Shapes of the items of a study, the same at all of its points."""

    targets: tuple[str, ...]
    n_frames: int
    cube: tuple[int, ...]
    """(frame, chirp, rx, sample), and iq where samples are complex; empty where none is kept."""
    power: tuple[int, ...]
    """(frame, velocity, range); empty where none is kept."""

    @property
    def item_bytes(self) -> int:
        """Samples and maps of one item, before they are packed."""
        return sum(2 * prod(shape) for shape in (self.cube, self.power) if shape)


def form_of(case: Case, keep: tuple[str, ...]) -> Form:
    """Shapes of the items of a case.

    Raises
    ------
    InvalidSetting
        If maps of triangles are asked for: they have two a frame.
    """
    radar, n_frames = case.radar, len(case.times_s)
    frame, chirp = radar.frame, radar.frame.chirp
    if "maps" in keep and frame.falls:
        raise InvalidSetting(
            "keep",
            got="maps, of ramps that rise and fall",
            need="cubes or detections: such frames have two maps each",
            fix="Keep cubes.",
        )
    iq = (2,) if chirp.sampling == "complex" else ()
    cube = (n_frames, frame.n_sent, radar.array.n_rx, chirp.n_samples, *iq)
    axes = axes_of(case)
    shape = (n_frames, axes["velocity_bins"].shape[1], len(axes["range_bins"]))
    return Form(
        targets=case.names,
        n_frames=n_frames,
        cube=cube if "cubes" in keep else (),
        power=shape if "maps" in keep else (),
    )


def axes_of(case: Case) -> dict[str, np.ndarray]:
    """Coordinates of samples and maps: times in s, velocities in m/s, ranges in m."""
    frame, chirp = case.radar.frame, case.radar.frame.chirp
    noise = case.chain.noise(case.radar)
    frames = [frame.at(number) for number in range(len(case.times_s))]
    bins = noise.over_velocity.n_bins
    return {
        "frame_time": np.array(case.times_s, dtype=float),
        "chirp_time": np.array([one.chirps_s for one in frames], dtype=float),
        "sample_time": chirp.adc_start_s + np.arange(chirp.n_samples) / chirp.sample_rate_hz,
        "velocity_bins": np.array([one.velocity_bins_m_per_s(bins) for one in frames]),
        "range_bins": chirp.range_bins_m(noise.over_range.n_bins),
    }


class Item(NamedTuple):
    """What is kept of one trial."""

    cube: np.ndarray | None
    """int16, see `Form.cube`."""
    scale: float
    """Times which its numbers are samples, sqrt(W); NaN where none are kept."""
    power: np.ndarray | None
    """int16, see `Form.power`: `STEP_DB` over 1 W."""
    detections: Mapping[str, np.ndarray]
    """See `DETECTED`; empty where none are kept."""


def item_of(form: Form, keep: tuple[str, ...], cube: xr.DataArray | None, look: Look) -> Item:
    """What is kept of a trial; raises `InvalidSetting` if it has another form."""
    numbers, scale, levels = None, np.nan, None
    if form.cube:
        assert cube is not None
        numbers, scale = whole_numbers(cube)
        _must_have_shape(numbers.shape, form.cube, "samples")
    if form.power:
        assert look.maps is not None
        levels = np.stack([whole_decibels(power) for power in look.maps])
        _must_have_shape(levels.shape, form.power, "maps")
    rows: dict[str, np.ndarray] = {}
    if "detections" in keep:
        rows = {name: np.asarray(look.detections[name]) for name in UNITS}
        rows["target"] = look.match.target
    return Item(numbers, scale, levels, rows)


def whole_numbers(cube: xr.DataArray) -> tuple[np.ndarray, float]:
    """Samples as int16, (frame, chirp, rx, sample[, iq]), and the step that they count.

    The codes of the converter where there is one; else up to the largest part of any sample.
    """
    if is_coded(cube):
        return codes(cube).values, float(cube.attrs["scale"])
    samples = np.ascontiguousarray(cube.values)
    if np.iscomplexobj(samples):
        samples = samples.view(samples.real.dtype).reshape(*samples.shape, 2)
    peak = float(np.abs(samples).max(initial=0))
    scale = peak / LARGEST if peak else 1.0
    return np.rint(samples / samples.dtype.type(scale)).astype(np.int16), scale


def whole_decibels(power: np.ndarray) -> np.ndarray:
    """Powers in steps of `STEP_DB` over 1 W, int16; the lowest number where there is none."""
    with np.errstate(divide="ignore"):
        steps = decibels(power) / STEP_DB
    return np.clip(np.rint(steps), -LARGEST - 1, LARGEST).astype(np.int16)


def labels_of(case: Case) -> dict[str, np.ndarray]:
    """What is known of the targets of a case, see `TRUTH`, each (frame, target)."""
    known = case.truth.transpose("frame", "target")
    made = {
        name: np.asarray(known[name].values, dtype=float)
        if name in known
        else np.full((known.sizes["frame"], known.sizes["target"]), np.nan)
        for name in TRUTH
    }
    chirp = case.radar.frame.chirp
    made["rcs"] = target_cross_sections_m2(case.scene, case.times_s, chirp.wavelength_m)
    for frame in range(len(case.times_s)):
        radar = case.radar.at(frame)
        place = Place(made["range"][frame], made["velocity"][frame])
        at = on_map(folded(place, radar), radar)
        made["map_range"][frame], made["map_velocity"][frame] = at
    return made


def classes_of(scene: Scene) -> list[str]:
    """What each target is: the kind of its body, or `point`."""
    return ["point" if one.body is None else one.body.kind() for one in scene.targets]


def packed(arrays: Mapping[str, np.ndarray]) -> bytes:
    """Small arrays as bytes, the same for the same arrays."""
    made = io.BytesIO()
    np.savez_compressed(made, allow_pickle=False, **dict(arrays))
    return made.getvalue()


def unpacked(content: bytes) -> dict[str, np.ndarray]:
    """What `packed` was given."""
    with np.load(io.BytesIO(content), allow_pickle=False) as kept:
        return {name: kept[name] for name in kept.files}


def _must_have_shape(got: tuple[int, ...], need: tuple[int, ...], what: str) -> None:
    if got != need:
        raise InvalidSetting(
            "keep",
            got=f"{what} of shape {got}",
            need=f"{need}, as at the first point: a data set has items of one shape",
            fix="Vary settings that leave it as it is; make a data set of each shape.",
        )

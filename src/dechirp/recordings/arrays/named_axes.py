"""Arrays with named axes as frames of a cube, for all readers of generic arrays."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.radar.array import Array
from dechirp.radar.radar import Radar
from dechirp.recordings.arrays.encodings import LIMITS, scale_to_full_scale
from dechirp.recordings.arrays.lazy_array import LazyArray, complex_field_names, format_shape
from dechirp.recordings.arrays.lazy_files import CACHE_BYTES
from dechirp.recordings.arrays.named_array import AXES, NamedArray
from dechirp.recordings.arrays.phase_rotated_channels import (
    add_phase_factors_to_calibration,
    find_channel_phase_factors,
    rotate_to_real_samples,
)
from dechirp.recordings.readers.base import Contents, RecordingHints
from dechirp.recordings.settings.antenna_positions import fit_array_to_receiver_count
from dechirp.recordings.settings.base import RecordingSettings
from dechirp.recordings.settings.radar_example import RadarExample
from dechirp.recordings.settings.read import list_settings_files
from dechirp.recordings.settings_lookup import (
    assumed_single_receiver_findings,
    find_optional_settings,
    find_recording_settings,
)

_EXAMPLES = {1: "sample", 2: "chirp,sample", 3: "chirp,rx,sample", 4: "frame,chirp,rx,sample"}
_LONGEST_EXAMPLE = "frame,chirp,rx,sample,iq"
# Rows of two axes: as many are rather receivers than chirps.
_MANY_RECEIVERS = 16
# Codes of 16 bits: those of weak signals in offset binary, as `Tsw1400` recognises them.
_MIDDLE, _MOST = (16384, 49152), 0.9
# More than any radar has; it is another axis, and each would get an assumed position.
_MAX_CHANNELS = 4096


def interpret_array_as_recording(
    path: Path,
    array: LazyArray,
    hints: RecordingHints,
    *,
    file_bytes: int,
    findings: Sequence[Finding] = (),
) -> Contents:
    """Check an array against the radar's settings, and return it as the contents of a recording.

    Parameters
    ----------
    path : Path
        The recording, for messages and for the settings beside it.
    array : LazyArray
        Its array, not empty.
    hints : RecordingHints
        Names of the axes, in the order of the array; encoding, order of I and Q, settings.
    file_bytes : int
        Size of the recording on disk.
    findings : sequence of Finding
        Findings of the reader.

    Raises
    ------
    RecordingError
        If axes or encoding are missing, or sizes or encoding do not fit the radar.
    """
    sizes = _sizes_by_axis_name(path, array, hints)
    example = replace(_radar_example(sizes, array.dtype), inner_name=hints.inner_name)
    settings = find_recording_settings(path, hints, example)
    radar, receiver_findings = _check_sizes_and_fit_receivers(path, sizes, settings.radar)
    cube = NamedArray(
        path=path,
        array=array,
        sizes=sizes,
        tx_order=radar.frame.tdm_order or (),
        is_complex=_determine_complex_sampling(path, array, sizes, radar),
        iq=hints.iq,
    )
    cube.check_frame_memory(file_bytes)
    encoding, encoding_findings = (
        (hints.encoding, ()) if hints.encoding else _infer_encoding(path, array.dtype, cube)
    )
    is_full_scale_assumed = hints.encoding is None and encoding == "full-scale"
    gaps = cube.unwritten_chirp_mask(radar.frame.n_chirps_total)
    phase_factors: np.ndarray | None = None
    phase_findings: tuple[Finding, ...] = ()
    if radar.frame.chirp.sampling == "real":
        phase_factors = find_channel_phase_factors(cube, encoding, radar.frame.n_slots)
    if phase_factors is not None:
        radar, phase_findings = add_phase_factors_to_calibration(radar, phase_factors)

    def decode(index: int, out: np.ndarray) -> None:
        is_lost = np.zeros(len(out), bool) if gaps is None else gaps[index]
        for first, numbers in cube.iter_chirp_blocks(index, is_lost):
            rows = out[first : first + len(numbers)]
            if not (numbers.dtype.kind in "iu" or np.isfinite(numbers).all()):
                raise cube.non_finite_samples_error(index, is_lost)
            if is_full_scale_assumed:
                _check_within_full_scale(path, index, numbers)
            _convert_chirps_to_full_scale(
                path, index, numbers, encoding, rows, phase_factors=phase_factors, first_chirp=first
            )
            rows[is_lost[first : first + len(rows)]] = 0

    return Contents(
        radar=radar,
        n_frames=sizes.get("frame", 1),
        decode=decode,
        gaps=gaps,
        findings=(
            *settings.findings,
            *receiver_findings,
            *encoding_findings,
            *phase_findings,
            *findings,
            *_repeated_decompression_note(cube),
            *_unwritten_chunks_warning(gaps),
        ),
    )


def infer_shape_and_findings(
    path: Path,
    axes: tuple[str, ...] | None,
    settings: RecordingSettings,
    n_numbers: int,
    *,
    description: str,
    has_iq_columns: bool = False,
) -> tuple[tuple[int, ...], tuple[Finding, ...]]:
    """Infer the shape of consecutive numbers, with findings in case of doubt.

    All sizes follow from the radar except the number of frames, and the number of receivers if the
    radar does not give it and there is one frame.

    Raises
    ------
    RecordingError
        If axes are not named, or the numbers are not a whole number of frames.
    """
    if axes is None:
        example = "frame,chirp,sample,iq" if has_iq_columns else _EXAMPLES[2]
        raise _missing_axis_names_error(path, f"{description} without axis names", example)
    _check_axis_names(path, axes, description)
    radar = settings.radar
    sizes = _axis_sizes_of_one_frame(radar, axes, radar.array.n_rx)
    numbers_per_frame = math.prod(sizes[name] for name in axes)
    channel_axis = next((name for name in ("rx", "element") if name in axes), None)
    if "frame" not in axes and channel_axis and radar.array == Array():
        sizes[channel_axis] = max(1, n_numbers * sizes[channel_axis] // numbers_per_frame)
        numbers_per_frame = math.prod(sizes[name] for name in axes)
    receiver_findings = (
        assumed_single_receiver_findings(settings) if "frame" in axes and channel_axis else ()
    )
    n_frames, rest = divmod(n_numbers, numbers_per_frame)
    if n_frames < 1 or (n_frames > 1 and "frame" not in axes) or (rest and axes[0] != "frame"):
        frame_text = " x ".join(f"{sizes[name]} {name}" for name in axes if name != "frame")
        raise RecordingError(
            path,
            value=description,
            expected=f"{'a multiple of ' if 'frame' in axes else ''}{numbers_per_frame} numbers:"
            f" {frame_text}, from the radar's settings",
            fix="name the axes in their order, with frame if there are several; or correct the"
            " settings",
        )
    shape = tuple(n_frames if name == "frame" else sizes[name] for name in axes)
    if not rest:
        return shape, receiver_findings
    cut_warning = Finding(
        level="warning",
        setting="recording",
        value=f"{description}, cut short: {n_frames} complete frames and {rest} numbers left out",
        expected=f"complete frames of {numbers_per_frame} numbers",
        fix="if more than the end is missing, the settings are not those of this recording",
    )
    return shape, (*receiver_findings, cut_warning)


def check_even_byte_count(path: Path, n_bytes: int) -> None:
    """Raise `RecordingError` if a size is not a whole number of 16-bit words."""
    if n_bytes % 2:
        raise RecordingError(
            path,
            value=f"{n_bytes} bytes",
            expected="an even number of bytes, 2 per number",
            fix="copy the whole file again from its source, or name another format",
        )


def _sizes_by_axis_name(path: Path, array: LazyArray, hints: RecordingHints) -> dict[str, int]:
    """Return the sizes by axis name, in the order of the file."""
    shape = format_shape(array.shape)
    if hints.axes is None:
        description = f"an array of {array.dtype} of shape {shape} without axis names"
        named = path if hints.inner_name is None else path / hints.inner_name
        settings, _ = find_optional_settings(path, hints)
        is_complex = array.dtype.kind == "c" or complex_field_names(array.dtype) is not None
        fitting = settings and _find_fitting_axes(array.shape, settings.radar, is_complex)
        raise _missing_axis_names_error(
            named,
            description,
            fitting or _usual_axes(array.shape),
            needs_radar=not hints.settings and not list_settings_files(path),
        )
    description = f"an array of shape {shape}"
    _check_axis_names(path, hints.axes, description, n_axes=len(array.shape))
    return dict(zip(hints.axes, array.shape, strict=True))


def _axis_sizes_of_one_frame(radar: Radar, axes: Sequence[str], n_rx: int) -> dict[str, int]:
    """Return the sizes that axes have in one frame of a radar."""
    frame = radar.frame
    has_tx_axis = "tx" in axes or "element" in axes
    return {
        "frame": 1,
        "chirp": frame.n_chirps if has_tx_axis else frame.n_chirps_total,
        "tx": frame.n_slots,
        "rx": n_rx,
        "element": frame.n_slots * n_rx,
        "sample": frame.chirp.n_samples,
        "iq": 2,
    }


def _find_fitting_axes(shape: tuple[int, ...], radar: Radar, has_complex_numbers: bool) -> str:
    """Return the first axis names whose sizes are those of the radar, empty if none fit."""
    frame, n_slots = radar.frame, radar.frame.n_slots
    has_pairs = frame.chirp.sampling == "complex" and not has_complex_numbers
    can_have_tx_axis = n_slots > 1 and frame.tdm_order is not None
    for axes in itertools.permutations(AXES, len(shape)) if len(shape) <= len(AXES) else ():
        has_element_axis, has_tx_axis = "element" in axes, "tx" in axes
        if (
            ("iq" in axes) != has_pairs
            or ((has_element_axis or has_tx_axis) and not can_have_tx_axis)
            or (has_element_axis and (has_tx_axis or "rx" in axes))
        ):
            continue
        sizes = dict(zip(axes, shape, strict=True))
        n_rx = radar.array.n_rx
        if radar.array == Array():  # any number of receivers
            n_rx = min(sizes.get("rx", sizes.get("element", n_slots) // n_slots), _MANY_RECEIVERS)
        expected_sizes = _axis_sizes_of_one_frame(radar, axes, n_rx)
        expected_sizes["frame"] = sizes.get("frame", 1)
        n_numbers = frame.n_chirps_total * n_rx * frame.chirp.n_samples * (1 + has_pairs)
        is_complete = math.prod(shape) == expected_sizes["frame"] * n_numbers
        if is_complete and all(sizes[name] == expected_sizes[name] for name in axes):
            return ",".join(axes)
    return ""


def _usual_axes(shape: tuple[int, ...]) -> str:
    """Return axis names in the usual order, as an example."""
    if len(shape) == 2 and min(shape) <= _MANY_RECEIVERS:
        return "rx,sample" if shape[0] <= _MANY_RECEIVERS else "sample,rx"
    return _EXAMPLES.get(len(shape), _LONGEST_EXAMPLE)


def _missing_axis_names_error(
    path: Path, description: str, axes: str, *, needs_radar: bool = False
) -> RecordingError:
    """Return the error of an array without axis names, and without settings if it needs them.

    Once the axes are given, the message about the settings contains an example with its sizes.
    """
    fix = f"give names, such as --axes {axes} (axes=[...] in Python)"
    if needs_radar:
        fix += ", and the radar, as --radar FILE: without it, an example is printed"
    return RecordingError(
        path,
        value=description,
        expected=f"one name for each axis, out of {', '.join(AXES)}",
        fix=fix,
    )


def _radar_example(sizes: dict[str, int], dtype: np.dtype) -> RadarExample:
    """Return the example of a radar that fits an array with named axes."""
    is_complex = "iq" in sizes or dtype.kind == "c" or complex_field_names(dtype) is not None
    example = RadarExample()
    return replace(
        example,
        n_samples=sizes.get("sample", example.n_samples),
        n_chirps=sizes.get("chirp", 1),
        sampling="complex" if is_complex else "real",
        options=f" --axes {','.join(sizes)}",
        known=("n_samples", "n_chirps"),
    )


def _check_axis_names(
    path: Path, axes: tuple[str, ...], description: str, *, n_axes: int | None = None
) -> None:
    """Raise `RecordingError` unless the axis names are valid and as many as needed."""
    has_error = set(axes) - set(AXES) or "sample" not in axes or len(set(axes)) < len(axes)
    has_error = has_error or ("element" in axes and {"tx", "rx"} & set(axes))
    if has_error or (n_axes is not None and len(axes) != n_axes):
        raise RecordingError(
            path,
            value=f"{description} with axes {','.join(axes)}",
            expected=f"{n_axes or 'only'} different names out of {', '.join(AXES)}, with sample,"
            " and element only without tx and rx",
            fix="name the axes in the order of the shape",
        )


def _check_sizes_and_fit_receivers(
    path: Path, sizes: dict[str, int], radar: Radar
) -> tuple[Radar, tuple[Finding, ...]]:
    """Check the sizes, and return the radar with as many receivers as the array holds."""
    frame = radar.frame
    has_tx_axis = "tx" in sizes or "element" in sizes
    if has_tx_axis and frame.tdm_order is None:
        raise RecordingError(
            path,
            value=f"an array with axes {','.join(sizes)}",
            expected="no axes tx and element: several transmitters send in each chirp"
            " (radar.frame.multiplexing)",
            fix="give the samples in the order sent, with axes chirp and rx",
        )
    expected_sizes = {
        "chirp": frame.n_chirps if has_tx_axis else frame.n_chirps_total,
        "tx": frame.n_slots,
        "sample": frame.chirp.n_samples,
    }
    if "chirp" not in sizes and expected_sizes["chirp"] > 1:
        has_pairs = (
            frame.tdm_order is not None
            and frame.n_chirps == 1
            and sizes.get("rx") == frame.n_slots * radar.array.n_rx
        )
        raise RecordingError(
            path,
            value=f"an array of shape {format_shape(tuple(sizes.values()))} with axes"
            f" {','.join(sizes)}",
            expected=f"an axis chirp of {expected_sizes['chirp']}, from the radar's settings",
            fix="name the axis of all pairs of a transmitter and a receiver element instead of rx"
            if has_pairs
            else "name the axis chirp, or correct radar.frame.n_chirps",
        )
    wrong_axes = [
        name
        for name, expected_size in expected_sizes.items()
        if sizes.get(name, expected_size) != expected_size
    ]
    if wrong_axes:
        raise RecordingError(
            path,
            value=" and ".join(f"{sizes[name]} along {name}" for name in wrong_axes),
            expected=" and ".join(f"{expected_sizes[name]} along {name}" for name in wrong_axes)
            + ", from the radar's settings",
            fix="correct the order of the axes, or radar.frame.n_chirps,"
            " radar.frame.multiplexing and radar.frame.chirp.n_samples",
        )
    n_elements = sizes.get("element", sizes.get("rx", 1) * frame.n_slots)
    n_rx, rest = divmod(n_elements, frame.n_slots)
    if rest or n_elements > _MAX_CHANNELS:
        raise RecordingError(
            path,
            value=f"{n_elements} pairs of a transmitter and a receiver",
            expected=f"a multiple of {frame.n_slots}, the transmitters that take turns, and at most"
            f" {_MAX_CHANNELS}",
            fix="correct the order of the axes, or radar.frame.multiplexing",
        )
    return fit_array_to_receiver_count(radar, n_rx, file=path)


def _determine_complex_sampling(
    path: Path, array: LazyArray, sizes: dict[str, int], radar: Radar
) -> bool:
    """Return whether the samples are complex; raise `RecordingError` if the radar contradicts."""
    has_complex_numbers = array.dtype.kind == "c" or complex_field_names(array.dtype) is not None
    if "iq" in sizes and (sizes["iq"] != 2 or has_complex_numbers):
        raise RecordingError(
            path,
            value=f"an array of {array.dtype} with an axis iq of {sizes['iq']}",
            expected="real numbers with an axis iq of 2, or complex numbers without it",
            fix="correct the names of the axes",
        )
    is_complex = "iq" in sizes or has_complex_numbers
    if radar.frame.chirp.sampling == "complex" and not is_complex:
        raise RecordingError(
            path,
            value=f"an array of real numbers ({array.dtype})",
            expected="complex numbers or an axis iq of 2 (radar.frame.chirp.sampling: complex)",
            fix="name the axis iq, or set sampling: real",
        )
    return is_complex


def _infer_encoding(
    path: Path, dtype: np.dtype, cube: NamedArray
) -> tuple[str, tuple[Finding, ...]]:
    """Return the encoding, with a note where the numbers of the first frame decide."""
    number_type = dtype if dtype.names is None else dtype[0]
    if number_type.kind == "i" and number_type.itemsize == 2:
        return "int16", ()
    if number_type.kind in "fc" and all(
        _are_within_full_scale(numbers) for _, numbers in cube.iter_chirp_blocks(0)
    ):
        return "full-scale", ()
    extremes, n_middle, n_numbers = [], 0, 0
    for _, numbers in cube.iter_chirp_blocks(0):
        extremes += [float(np.min(numbers)), float(np.max(numbers))]
        n_middle += int(np.count_nonzero((numbers >= _MIDDLE[0]) & (numbers < _MIDDLE[1])))
        n_numbers += numbers.size
    low, high, middle = min(extremes), max(extremes), n_middle / n_numbers
    encoding = _encoding_of_numbers(low, high, middle)
    if encoding is None:
        description = f"{dtype} with numbers from {low:.6g} to {high:.6g} in frame 0"
        raise _missing_encoding_error(path, description)
    note = Finding(
        level="note",
        setting="encoding",
        value=f"chosen --encoding {encoding} because the first frame has whole numbers from"
        f" {low:.6g} to {high:.6g}, {middle:.0%} of them from {_MIDDLE[0]} to {_MIDDLE[1]}",
        expected="int16 with negative numbers; uint16-wrapped, of which few lie in the middle half;"
        " offset-binary, of which most lie there",
        fix="give another --encoding if the map looks wrong; full-scale keeps the numbers as they"
        " are",
    )
    return encoding, (note,)


def _encoding_of_numbers(low: float, high: float, middle_fraction: float) -> str | None:
    """Return the 16-bit encoding that numbers between two extremes have; None if it is ambiguous.

    Of signed numbers that wrapped round, those of weak signals lie at both ends of the codes.
    """
    if low < 0:
        return "int16" if low >= -(2**15) and high < 2**15 else None
    if high >= 2**16:
        return None
    if middle_fraction > _MOST:
        return "offset-binary"
    if middle_fraction < 1 - _MOST and low < _MIDDLE[0] and high >= _MIDDLE[1]:
        return "uint16-wrapped"
    return None


def _are_within_full_scale(numbers: np.ndarray) -> bool:
    """Return False if floats may be ADC codes: whole numbers beyond full scale 1.

    Numbers with fractions are kept as they are.
    """
    # NaN passes here: reading the samples raises its own error.
    return not (_largest_magnitude(numbers) > 1 and np.all(numbers == np.round(numbers)))


def _largest_magnitude(numbers: np.ndarray) -> float:
    return max(float(np.max(numbers)), -float(np.min(numbers)))


def _check_within_full_scale(path: Path, frame_index: int, numbers: np.ndarray) -> None:
    """Raise `RecordingError` if the floats of a frame may be ADC codes.

    A first frame of small numbers, or of zeros, does not predict the others.
    """
    if not _are_within_full_scale(numbers):
        largest = _largest_magnitude(numbers)
        description = f"{numbers.dtype} with numbers up to {largest:.6g} in frame {frame_index}"
        raise _missing_encoding_error(path, description)


def _missing_encoding_error(path: Path, description: str) -> RecordingError:
    """Return the error of an array whose encoding is ambiguous."""
    return RecordingError(
        path,
        value=f"an array of {description} without an encoding",
        expected=f"an encoding out of {', '.join(LIMITS)}",
        fix="give one, such as --encoding int16 (encoding=... in Python); full-scale keeps the"
        " numbers unchanged",
    )


def _convert_chirps_to_full_scale(
    path: Path,
    frame_index: int,
    numbers: np.ndarray,
    encoding: str,
    out: np.ndarray,
    *,
    phase_factors: np.ndarray | None,
    first_chirp: int,
) -> None:
    """Fill (chirp, rx, sample) with numbers at full scale 1, after checking each."""
    # I and Q side by side, in the file and in the result, are converted 5 times as fast as apart.
    target = out.view(np.float32).reshape(*out.shape, 2) if np.iscomplexobj(out) else None
    try:
        scaled = scale_to_full_scale(numbers, encoding, target)
    except ValueError as error:
        raise RecordingError(
            path,
            value=f"{error} in frame {frame_index}, read as {encoding}",
            expected=f"numbers that {encoding} can hold",
            fix=f"choose another encoding: {', '.join(LIMITS)}",
        ) from None
    if np.iscomplexobj(out):
        return
    is_complex = scaled.ndim > out.ndim
    try:
        if phase_factors is not None:
            out[:] = rotate_to_real_samples(scaled, phase_factors, first_chirp)
            return
        if is_complex and scaled[..., 1].any():
            raise ValueError("complex samples, with a non-zero imaginary part")
    except ValueError as error:
        raise RecordingError(
            path,
            value=f"{error} in frame {frame_index}",
            expected="real samples (radar.frame.chirp.sampling: real), or real ones times one"
            " phase factor in each channel",
            fix="set sampling: complex",
        ) from None
    out[:] = scaled[..., 0] if is_complex else scaled


def _repeated_decompression_note(cube: NamedArray) -> tuple[Finding, ...]:
    """Return a note if the whole array is decompressed for each frame."""
    n_frames, n_bytes = cube.sizes.get("frame", 1), cube.bytes_to_decompress_per_frame
    if cube.is_sequential_by_frame or n_frames == 1 or n_bytes <= CACHE_BYTES:
        return ()
    return (
        Finding(
            level="note",
            setting="recording",
            value=f"a compressed array of {n_bytes} bytes, decompressed again for each of"
            f" {n_frames} frames (slow)",
            expected="frames along the slowest axis, or no compression",
            fix="save it with its frames along the first axis, in MATLAB the last",
        ),
    )


def _unwritten_chunks_warning(gaps: np.ndarray | None) -> tuple[Finding, ...]:
    """Warn about chunks that were never written."""
    if gaps is None:
        return ()
    return (
        Finding(
            level="warning",
            setting="recording",
            value=f"chunks that were never written: {gaps.sum()} of {gaps.size} chirps have gaps,"
            f" the first in frame {int(np.flatnonzero(gaps.any(axis=1))[0])}",
            expected="all chunks of the array",
            fix="copy the recording again if it was complete; those chirps are zero, and the"
            " cube's coordinate `gap` marks them",
        ),
    )

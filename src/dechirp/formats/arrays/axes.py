"""Arrays whose axes the user names, as frames of a cube: what the generic readers share."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.formats.arrays.encodings import LIMITS, to_full_scale
from dechirp.formats.arrays.named_array import AXES, NamedArray, is_finite
from dechirp.formats.arrays.on_disk import KEPT_BYTES
from dechirp.formats.arrays.stored import Stored, pair, written
from dechirp.formats.base import Contents, Told
from dechirp.formats.settings.base import Settings
from dechirp.formats.settings.receivers import with_receivers
from dechirp.formats.settings_for import settings_for, untold_receivers
from dechirp.radar.array import Array
from dechirp.radar.radar import Radar

_EXAMPLES = {1: "sample", 2: "chirp,sample", 3: "chirp,rx,sample", 4: "frame,chirp,rx,sample"}
# More than any radar has: it is another axis, and positions would be made up for each.
_MOST_CHANNELS = 4096


def contents(
    path: Path, stored: Stored, told: Told, *, file_bytes: int, findings: Sequence[Finding] = ()
) -> Contents:
    """What an array of samples holds, after it was checked against the radar's settings.

    Parameters
    ----------
    path : Path
        The recording, for messages and for the settings beside it.
    stored : Stored
        Its array, not empty.
    told : Told
        Names of the axes, in the order of the array; encoding, order of I and Q, settings.
    file_bytes : int
        Size of the recording on disk.
    findings : sequence of Finding
        What the reader has to say already.

    Raises
    ------
    RecordingError
        If axes, sizes or encoding are not told or do not fit the radar.
    """
    sizes = _sizes(path, stored, told.axes)
    settings = settings_for(path, told)
    radar, added = _fitted(path, sizes, settings.radar)
    cube = NamedArray(
        path=path,
        stored=stored,
        sizes=sizes,
        turns=radar.frame.turns or (),
        is_complex=_check_iq(path, stored, sizes, radar),
        iq=told.iq,
    )
    cube.must_be_bounded(file_bytes)
    encoding = told.encoding or _encoding(path, stored.dtype, cube)
    must_stay_below_1 = told.encoding is None and encoding == "full-scale"
    gaps = cube.gaps(radar.frame.n_sent)

    def decode(index: int, out: np.ndarray) -> None:
        lost = np.zeros(len(out), bool) if gaps is None else gaps[index]
        for first, parts in cube.pieces(index, lost):
            rows = out[first : first + len(parts[0])]
            if not all(is_finite(part).all() for part in parts):
                raise cube.not_finite(index, lost)
            if must_stay_below_1:
                _must_stay_below_1(path, index, parts)
            _fill(path, index, parts, encoding, rows)
            rows[lost[first : first + len(rows)]] = 0

    return Contents(
        radar=radar,
        n_frames=sizes.get("frame", 1),
        decode=decode,
        gaps=gaps,
        findings=(*settings.findings, *added, *findings, *_slow(cube), *_never_written(gaps)),
    )


def shape_in(
    path: Path, axes: tuple[str, ...] | None, settings: Settings, n_numbers: int, *, what: str
) -> tuple[tuple[int, ...], tuple[Finding, ...]]:
    """Shape of numbers that lie one after the other, and findings where it is in doubt.

    All sizes follow from the radar but the number of frames, and that of receivers if the
    radar does not tell it and there is one frame.

    Raises
    ------
    RecordingError
        If axes are not named, or no whole number of frames lies in so many numbers.
    """
    if axes is None:
        raise _without_axes(path, f"{what} whose axes nobody named")
    _check_names(path, axes, what)
    radar = settings.radar
    n_slots, n_rx = radar.frame.n_slots, radar.array.n_rx
    turns = "tx" in axes or "element" in axes
    sizes = {
        "frame": 1,
        "chirp": radar.frame.n_chirps if turns else radar.frame.n_sent,
        "tx": n_slots,
        "rx": n_rx,
        "element": n_slots * n_rx,
        "sample": radar.frame.chirp.n_samples,
        "iq": 2,
    }
    per_frame = math.prod(sizes[name] for name in axes)
    channels = next((name for name in ("rx", "element") if name in axes), None)
    if "frame" not in axes and channels and radar.array == Array():
        sizes[channels] = max(1, n_numbers * sizes[channels] // per_frame)
        per_frame = math.prod(sizes[name] for name in axes)
    untold = untold_receivers(settings) if "frame" in axes and channels else ()
    n_frames, rest = divmod(n_numbers, per_frame)
    if n_frames < 1 or (n_frames > 1 and "frame" not in axes) or (rest and axes[0] != "frame"):
        one = " x ".join(f"{sizes[name]} {name}" for name in axes if name != "frame")
        raise RecordingError(
            path,
            got=what,
            need=f"{'a multiple of ' if 'frame' in axes else ''}{per_frame} numbers:"
            f" {one}, as the radar's settings say",
            fix="Name the axes in their order, with frame where there are several; or correct"
            " the settings.",
        )
    shape = tuple(n_frames if name == "frame" else sizes[name] for name in axes)
    if not rest:
        return shape, untold
    cut = Finding(
        level="warning",
        setting="recording",
        got=f"{what}, cut short: {n_frames} whole frames and {rest} numbers that are left out",
        need=f"whole frames of {per_frame} numbers",
        fix="If more than the end is missing, the settings are not those of this recording.",
    )
    return shape, (*untold, cut)


def must_be_words(path: Path, n_bytes: int) -> None:
    """Raise `RecordingError` if so many bytes are no whole number of words of 16 bits."""
    if n_bytes % 2:
        raise RecordingError(
            path,
            got=f"of {n_bytes} bytes",
            need="of an even number of bytes, 2 for each number",
            fix="Copy the whole file again from its source, or name another format.",
        )


def _sizes(path: Path, stored: Stored, axes: tuple[str, ...] | None) -> dict[str, int]:
    """Sizes by name of axis, in the order of the file."""
    shape = written(stored.shape)
    if axes is None:
        what = f"an array of {stored.dtype} of shape {shape} whose axes nobody named"
        raise _without_axes(path, what, len(stored.shape))
    what = f"an array of shape {shape}"
    _check_names(path, axes, what, n_axes=len(stored.shape))
    return dict(zip(axes, stored.shape, strict=True))


def _without_axes(path: Path, what: str, n_axes: int = 2) -> RecordingError:
    return RecordingError(
        path,
        got=what,
        need=f"one name for each axis, out of {', '.join(AXES)}",
        fix=f"For example --axes {_EXAMPLES.get(n_axes, 'frame,chirp,rx,sample,iq')}"
        " (axes=[...] in Python).",
    )


def _check_names(
    path: Path, axes: tuple[str, ...], what: str, *, n_axes: int | None = None
) -> None:
    wrong = set(axes) - set(AXES) or "sample" not in axes or len(set(axes)) < len(axes)
    wrong = wrong or ("element" in axes and {"tx", "rx"} & set(axes))
    if wrong or (n_axes is not None and len(axes) != n_axes):
        raise RecordingError(
            path,
            got=f"{what} with axes {','.join(axes)}",
            need=f"{n_axes or 'with'} different names out of {', '.join(AXES)}, with sample,"
            " and element only without tx and rx",
            fix="Name the axes in the order of the shape.",
        )


def _fitted(path: Path, sizes: dict[str, int], radar: Radar) -> tuple[Radar, tuple[Finding, ...]]:
    """Radar with as many receivers as the array holds, where it did not tell them."""
    frame = radar.frame
    turns = "tx" in sizes or "element" in sizes
    if turns and frame.turns is None:
        raise RecordingError(
            path,
            got=f"an array with axes {','.join(sizes)}",
            need="one without tx and element: several transmitters send in a chirp, as"
            " radar.frame.multiplexing says, so that its samples are of no single one",
            fix="Give the samples as they were taken, with axes chirp and rx.",
        )
    needs = {
        "chirp": frame.n_chirps if turns else frame.n_sent,
        "tx": frame.n_slots,
        "sample": frame.chirp.n_samples,
    }
    if "chirp" not in sizes and needs["chirp"] > 1:
        raise RecordingError(
            path,
            got=f"an array of shape {written(tuple(sizes.values()))} with axes {','.join(sizes)}",
            need=f"one with an axis chirp, of {needs['chirp']} as the radar's settings say",
            fix="Name the axis chirp, or correct radar.frame.n_chirps.",
        )
    wrong = [name for name, need in needs.items() if sizes.get(name, need) != need]
    if wrong:
        raise RecordingError(
            path,
            got="of " + " and ".join(f"{sizes[name]} along {name}" for name in wrong),
            need=" and ".join(f"of {needs[name]} along {name}" for name in wrong)
            + ", as the radar's settings say",
            fix="Correct the order of the axes, or radar.frame.n_chirps,"
            " radar.frame.multiplexing and radar.frame.chirp.n_samples.",
        )
    n_elements = sizes.get("element", sizes.get("rx", 1) * frame.n_slots)
    n_rx, rest = divmod(n_elements, frame.n_slots)
    if rest or n_elements > _MOST_CHANNELS:
        raise RecordingError(
            path,
            got=f"of {n_elements} pairs of a transmitter and a receiver",
            need=f"of a multiple of {frame.n_slots}, as many transmitters take turns, and at"
            f" most {_MOST_CHANNELS}",
            fix="Correct the order of the axes, or radar.frame.multiplexing.",
        )
    return with_receivers(radar, n_rx, file=path)


def _check_iq(path: Path, stored: Stored, sizes: dict[str, int], radar: Radar) -> bool:
    """Whether the samples are complex, which must agree with the radar."""
    in_one = stored.dtype.kind == "c" or pair(stored.dtype) is not None
    if "iq" in sizes and (sizes["iq"] != 2 or in_one):
        raise RecordingError(
            path,
            got=f"an array of {stored.dtype} with an axis iq of {sizes['iq']}",
            need="real numbers with an axis iq of 2, or complex numbers without it",
            fix="Correct the names of the axes.",
        )
    is_complex = "iq" in sizes or in_one
    if radar.frame.chirp.sampling == "complex" and not is_complex:
        raise RecordingError(
            path,
            got=f"an array of real numbers ({stored.dtype})",
            need="complex numbers or an axis iq of 2, as radar.frame.chirp.sampling is complex",
            fix="Name the axis iq, or set sampling: real.",
        )
    return is_complex


def _encoding(path: Path, dtype: np.dtype, cube: NamedArray) -> str:
    """Choose the encoding, where the numbers leave no doubt."""
    numbers = dtype if dtype.names is None else dtype[0]
    if numbers.kind == "i" and numbers.itemsize == 2:
        return "int16"
    if numbers.kind not in "fc":
        raise _without_encoding(path, str(dtype))
    for _, parts in cube.pieces(0):
        _must_stay_below_1(path, 0, parts)
    return "full-scale"


def _must_stay_below_1(path: Path, index: int, parts: list[np.ndarray]) -> None:
    """Raise `RecordingError` if floats are no samples at full scale 1, whatever else they are.

    A first frame of small numbers, or of zeros, does not tell what the others are.
    """
    # NaN goes through: its own error comes with the samples.
    largest = max(float(np.max(np.abs(part))) for part in parts)
    if largest > 1:
        seen = f"{parts[0].dtype} with numbers up to {largest:.6g} in frame {index}"
        raise _without_encoding(path, seen)


def _without_encoding(path: Path, seen: str) -> RecordingError:
    return RecordingError(
        path,
        got=f"an array of {seen}, whose encoding nobody named",
        need=f"one of {', '.join(LIMITS)}",
        fix="For example --encoding int16 (encoding=... in Python); full-scale takes the"
        " numbers as they are.",
    )


def _fill(path: Path, index: int, parts: list[np.ndarray], encoding: str, out: np.ndarray) -> None:
    """Fill (chirp, rx, sample) with parts at full scale 1, after checking every number."""
    try:
        scaled = [to_full_scale(part, encoding) for part in parts]
    except ValueError as error:
        raise RecordingError(
            path,
            got=f"{error} in frame {index}, read as {encoding}",
            need=f"numbers that {encoding} can hold",
            fix=f"Choose another encoding: {', '.join(LIMITS)}.",
        ) from None
    if np.iscomplexobj(out):
        out.real, out.imag = scaled
        return
    if len(scaled) == 2 and scaled[1].any():
        raise RecordingError(
            path,
            got=f"complex, with an imaginary part that is not zero in frame {index}",
            need="real, as radar.frame.chirp.sampling says",
            fix="Set sampling: complex.",
        )
    out[:] = scaled[0]


def _slow(cube: NamedArray) -> tuple[Finding, ...]:
    n_frames, n_bytes = cube.sizes.get("frame", 1), cube.unpacked_for_a_frame
    if cube.goes_on_by_frame or n_frames == 1 or n_bytes <= KEPT_BYTES:
        return ()
    return (
        Finding(
            level="note",
            setting="recording",
            got=f"a compressed array of {n_bytes} bytes, which is unpacked anew for each of"
            f" {n_frames} frames: slow",
            need="frames along the axis that runs slowest, or no compression",
            fix="Save it with its frames along the first axis, in MATLAB the last.",
        ),
    )


def _never_written(gaps: np.ndarray | None) -> tuple[Finding, ...]:
    if gaps is None:
        return ()
    return (
        Finding(
            level="warning",
            setting="recording",
            got=f"parts of its array were never written: {gaps.sum()} of {gaps.size} chirps have"
            f" gaps, the first in frame {int(np.flatnonzero(gaps.any(axis=1))[0])}",
            need="every part of the array",
            fix="Those chirps are zero, and the cube's coordinate `gap` marks them; copy the"
            " recording again if it was whole.",
        ),
    )

"""NumPy arrays (`.npy`): samples whose axes and encoding the user names."""

import math
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.conventions import CUBE_AXES
from dechirp.core.errors import RecordingError
from dechirp.core.values import value
from dechirp.formats.base import Contents, Fit, Format, Told
from dechirp.formats.encodings import LIMITS, to_full_scale
from dechirp.formats.settings.base import Iq
from dechirp.formats.settings.read import find_settings, read_settings
from dechirp.formats.settings.receivers import with_receivers
from dechirp.radar.radar import Radar

MAGIC = b"\x93NUMPY"
AXES = (*CUBE_AXES, "iq")


@value
class Npy(Format):
    """One array in a file.

    Axes may come in any order; `frame` and `rx` may be left out where there is one. Real
    numbers with an axis `iq` of two are complex samples.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".npy",)
    options: ClassVar[tuple[str, ...]] = ("axes", "encoding", "iq")

    def recognise(self, path: Path) -> Fit:
        """Tell by the first bytes."""
        if not path.is_file():
            return Fit.NO
        with path.open("rb") as file:
            return Fit.CONTAINER if file.read(len(MAGIC)) == MAGIC else Fit.NO

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        array = mapped(path)
        sizes = _sizes(path, array, told.axes)
        settings = told.settings or read_settings(find_settings(path))
        _check_sizes(path, sizes, settings.radar)
        is_complex = _check_iq(path, array, sizes, settings.radar)
        radar, findings = with_receivers(settings.radar, sizes.get("rx", 1), file=path)
        blocks = _in_order(array, list(sizes))
        encoding = told.encoding or _encoding(path, array, blocks[0])

        def frame(index: int) -> np.ndarray:
            parts = _parts(blocks[index], is_complex, told.iq)
            return _joined(path, index, parts, encoding, radar)

        return Contents(
            radar=radar, n_frames=len(blocks), frame=frame, findings=settings.findings + findings
        )


def mapped(path: Path) -> np.ndarray:
    """Array of an .npy file, mapped: nothing is read or allocated before it is used.

    Raises
    ------
    RecordingError
        If the header is damaged, the numbers are not plain numbers, or the size of the
        file is not what the header says.
    """
    dtype, shape, fortran, start = _header(path)
    if dtype.kind not in "iufc":
        raise RecordingError(
            path,
            got=f"an array of {'Python objects' if dtype.hasobject else dtype}",
            need="an array of integers, floats or complex numbers",
            fix="Save the samples themselves, as an array; pickled objects are never opened.",
        )
    # Python integers: an absurd shape cannot overflow, and nothing is allocated for it.
    needed, got = start + math.prod(shape) * dtype.itemsize, path.stat().st_size
    if not shape or min(shape) < 1 or needed != got:
        raise RecordingError(
            path,
            got=f"a file of {got} bytes",
            need=f"of {needed} bytes, for {dtype} of shape {_written(shape)} as its header says",
            fix="Copy the whole file again from its source."
            if needed > got
            else "Save one array that is not empty.",
        )
    return np.memmap(
        path, dtype=dtype, mode="r", offset=start, shape=shape, order="F" if fortran else "C"
    )


def _header(path: Path) -> tuple[np.dtype, tuple[int, ...], bool, int]:
    with path.open("rb") as file:
        try:
            version = np.lib.format.read_magic(file)
            reader = {
                (1, 0): np.lib.format.read_array_header_1_0,
                (2, 0): np.lib.format.read_array_header_2_0,
            }[version]
            shape, fortran, dtype = reader(file)
        except Exception as error:  # the header is foreign text: its parser may raise anything
            raise RecordingError(
                path,
                got=f"a file whose header is damaged ({type(error).__name__})",
                need="a NumPy array (.npy)",
                fix="Copy the file again from its source, or save it again with numpy.save.",
            ) from None
        return dtype, shape, fortran, file.tell()


def _sizes(path: Path, array: np.ndarray, axes: tuple[str, ...] | None) -> dict[str, int]:
    """Sizes by name of axis, in the order of the file."""
    shape = _written(array.shape)
    if axes is None:
        examples = {1: "sample", 2: "chirp,sample", 3: "chirp,rx,sample", 4: ",".join(CUBE_AXES)}
        raise RecordingError(
            path,
            got=f"an array of {array.dtype} of shape {shape} whose axes nobody named",
            need=f"one name for each axis, out of {', '.join(AXES)}",
            fix=f"For example --axes {examples.get(array.ndim, ','.join(AXES))}"
            " (axes=[...] in Python).",
        )
    wrong = sorted(set(axes) - set(AXES))
    lacking = [name for name in ("chirp", "sample") if name not in axes]
    if wrong or lacking or len(set(axes)) < len(axes) or len(axes) != array.ndim:
        raise RecordingError(
            path,
            got=f"an array of shape {shape} with axes {','.join(axes)}",
            need=f"{array.ndim} different names out of {', '.join(AXES)}, with chirp and sample",
            fix="Name the axes in the order of the shape.",
        )
    return dict(zip(axes, array.shape, strict=True))


def _check_iq(path: Path, array: np.ndarray, sizes: dict[str, int], radar: Radar) -> bool:
    """Whether the samples are complex, which must agree with the radar."""
    if "iq" in sizes and (sizes["iq"] != 2 or array.dtype.kind == "c"):
        raise RecordingError(
            path,
            got=f"an array of {array.dtype} with an axis iq of {sizes['iq']}",
            need="real numbers with an axis iq of 2, or complex numbers without it",
            fix="Correct the names of the axes.",
        )
    is_complex = "iq" in sizes or array.dtype.kind == "c"
    if radar.frame.chirp.sampling == "complex" and not is_complex:
        raise RecordingError(
            path,
            got=f"an array of real numbers ({array.dtype})",
            need="complex numbers or an axis iq of 2, as radar.frame.chirp.sampling is complex",
            fix="Name the axis iq, or set sampling: real.",
        )
    return is_complex


def _check_sizes(path: Path, sizes: dict[str, int], radar: Radar) -> None:
    needs = {"chirp": radar.frame.n_chirps, "sample": radar.frame.chirp.n_samples}
    wrong = [name for name, need in needs.items() if sizes[name] != need]
    if wrong:
        raise RecordingError(
            path,
            got="of " + " and ".join(f"{sizes[name]} along {name}" for name in wrong),
            need=" and ".join(f"of {needs[name]} along {name}" for name in wrong)
            + ", as the radar's settings say",
            fix="Correct the order of the axes, or radar.frame.n_chirps and"
            " radar.frame.chirp.n_samples.",
        )


def _encoding(path: Path, array: np.ndarray, first_frame: np.ndarray) -> str:
    """Choose the encoding, where the numbers leave no doubt."""
    if array.dtype == np.int16:
        return "int16"
    if array.dtype.kind in "fc":
        largest = max(abs(first_frame.real).max(), abs(first_frame.imag).max())
        if not largest > 1:  # NaN, too: its own error comes with the samples
            return "full-scale"
        seen = f"{array.dtype} with numbers up to {largest:.6g}"
    else:
        seen = str(array.dtype)
    raise RecordingError(
        path,
        got=f"an array of {seen}, whose encoding nobody named",
        need=f"one of {', '.join(LIMITS)}",
        fix="For example --encoding int16 (encoding=... in Python); full-scale takes the"
        " numbers as they are.",
    )


def _in_order(array: np.ndarray, names: list[str]) -> np.ndarray:
    """View of the array, (frame, chirp, rx, sample) and perhaps iq."""
    view = np.transpose(array, [names.index(name) for name in AXES if name in names])
    absent = [position for position, name in enumerate(CUBE_AXES) if name not in names]
    return np.expand_dims(view, absent)


def _parts(block: np.ndarray, is_complex: bool, iq: Iq | None) -> list[np.ndarray]:
    """In-phase and quadrature part of one frame, or its real samples alone."""
    if not is_complex:
        return [block]
    parts = [block.real, block.imag] if block.dtype.kind == "c" else [block[..., 0], block[..., 1]]
    return parts[::-1] if iq == "qi" else parts


def _joined(
    path: Path, index: int, parts: list[np.ndarray], encoding: str, radar: Radar
) -> np.ndarray:
    """Make samples of one frame at full scale 1, after checking every number."""
    finite = np.logical_and.reduce([np.isfinite(part) for part in parts])
    if not finite.all():
        chirp, rx, sample = np.argwhere(~finite)[0]
        raise RecordingError(
            path,
            got=f"a recording with {np.count_nonzero(~finite)} of {finite.size} samples of frame"
            f" {index} not finite, the first at chirp {chirp}, rx {rx}, sample {sample}",
            need="finite numbers (no NaN, no infinity)",
            fix="Record it again, or replace those samples before saving.",
        )
    try:
        scaled = [to_full_scale(part, encoding) for part in parts]
    except ValueError as error:
        raise RecordingError(
            path,
            got=f"{error} in frame {index}, read as {encoding}",
            need=f"numbers that {encoding} can hold",
            fix=f"Choose another encoding: {', '.join(LIMITS)}.",
        ) from None
    if len(scaled) == 1:
        return scaled[0]
    if radar.frame.chirp.sampling == "complex":
        return scaled[0] + np.complex64(1j) * scaled[1]
    if scaled[1].any():
        raise RecordingError(
            path,
            got=f"complex, with an imaginary part that is not zero in frame {index}",
            need="real, as radar.frame.chirp.sampling says",
            fix="Set sampling: complex.",
        )
    return scaled[0]


def _written(shape: tuple[int, ...]) -> str:
    return " x ".join(str(size) for size in shape) or "()"

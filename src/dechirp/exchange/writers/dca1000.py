"""TI DCA1000 captures: bare words (`x.bin`), and beside them what says how to read them.

`x.cfg` and, as mmWave Studio keeps them, `x.mmwave.json` and `x.setup.json` are for TI's tools and
all that read those; `x.dechirp.json` is ours. A `.cfg` is written where the demo of a board could
be told to be that radar, a `.setup.json` where the antennas are those of a board.

TI application report SWRA581, Mmwave Radar Device ADC Raw Data Capture.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.errors import DechirpError, Mistake
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.exchange.coded import if_codes, numbers
from dechirp.exchange.said import must_be_of, said_of
from dechirp.exchange.ti_chip import (
    CFG_BITS,
    TiChip,
    cfg_of,
    chip_of,
    must_be_one_chip,
    told_frames,
    told_radar,
)
from dechirp.exchange.writers.base import Progress, Writer
from dechirp.formats.arrays.json_columns import TYPES
from dechirp.formats.kept_beside import MOST_BYTES, Layout, beside, is_kept, kept_text
from dechirp.formats.recording import Recording
from dechirp.formats.settings.ti_frame import BITS
from dechirp.formats.settings.write_mmwave_json import mmwave_json_text, mmwave_setup_text
from dechirp.store.whole import whole_files

_LEAST = -90  # power of two, so that float32 holds its inverse: silence needs no better


@value
class Dca1000(Writer):
    """Captures of a TI radar chip, with the settings that TI's tools write beside them.

    Codes of a converter are kept as they are; other samples are rounded to 16 bits, and a finding
    says how.
    """

    endings: ClassVar[tuple[str, ...]] = (".bin",)
    keeps: ClassVar[str] = (
        "int16 samples as a DCA1000 writes them, settings of TI's tools; the rest in a file of ours"
        " beside them"
    )

    def check(self, recording: Recording) -> None:
        """See `Writer.check`."""
        recording.must_hold_samples()
        must_be_one_chip(recording.radar)
        _must_be_text(recording)

    def files(self, recording: Recording, out: Path) -> tuple[Path, ...]:
        """See `Writer.files`."""
        return _names(out)

    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        """See `Writer.write`."""
        names, chip = _names(out), chip_of(recording)

        def written(scale: float | None) -> None:
            step, rounded = _step(recording) if scale is None else (scale, None)
            texts = _texts(recording, chip, names, step, rounded)
            with whole_files(*names) as made:
                with made[0].open("wb") as file:
                    for done, frame in enumerate(numbers(recording, scale), start=1):
                        codes = frame if scale is not None else _rounded(frame, step)
                        file.write(chip.words(codes))
                        if progress is not None:
                            progress(done, recording.n_frames)
                for name, text in zip(made[1:], texts, strict=True):
                    if text is not None:
                        name.write_text(text, encoding="utf-8")

        if_codes(recording, written)
        return tuple(name for name in names if name.exists())


def _must_be_text(recording: Recording) -> None:
    """Raise `DechirpError` unless the tables can be kept as JSON, in a file of some size."""
    must_be_of(TYPES, recording.tables)
    n_bytes = len(_kept(recording, chip_of(recording), 1.0, ()))
    if n_bytes > MOST_BYTES:
        raise _refused(
            "tables",
            got=f"of {n_bytes} bytes, as JSON",
            need=f"at most {MOST_BYTES}",
            fix="Write fewer frames, or a format that holds tables, as .h5.",
        )


def _texts(
    recording: Recording,
    chip: TiChip,
    names: tuple[Path, ...],
    step: float,
    rounded: Finding | None,
) -> tuple[str | None, ...]:
    """What lies beside the samples, in the order of its names."""
    samples, _, used, _, _ = names
    bits = _bits(recording, step) if rounded is None else CFG_BITS
    cfg, why_not = cfg_of(recording, chip, bits)
    studio = mmwave_json_text(
        told_radar(recording),
        tx=chip.tx,
        rx=chip.rx,
        lanes=chip.lanes,
        n_frames=told_frames(recording),
        iq=chip.iq,
        bits=bits,
    )
    setup = mmwave_setup_text(chip.of, used=used, captured=samples) if chip.is_board else None
    findings = [] if rounded is None else [rounded]
    if cfg is None:
        findings.append(_no_cfg(chip, why_not))
    return cfg, studio, setup, _kept(recording, chip, step, findings)


def _kept(recording: Recording, chip: TiChip, step: float, findings: Sequence[Finding]) -> str:
    """What is ours of a recording."""
    is_complex = recording.radar.frame.chirp.sampling == "complex"
    layout = Layout(
        device=chip.of.kind(),
        lanes=chip.lanes,
        receivers=chip.rx,
        iq=chip.iq if is_complex else None,
        n_frames=recording.n_frames,
    )
    description, columns = said_of(recording, step)
    return kept_text(description, columns, layout, recording.contents.gaps, findings)


def _bits(recording: Recording, step: float) -> int:
    """Bits of a converter whose full scale is 1; 16 of any other."""
    steps = {2.0 ** (1 - bits): bits for bits in BITS.values()}
    return steps.get(step, CFG_BITS) if recording.contents.units == "full scale" else CFG_BITS


def _names(out: Path) -> tuple[Path, ...]:
    """The files of a capture, which are all ours, or not there yet."""
    if out.suffix.lower() != ".bin":
        raise _refused("path", got=str(out), need="a name that ends in .bin", fix="Change it.")
    endings = (".cfg", ".mmwave.json", ".setup.json")
    names = (out, *(out.with_suffix(ending) for ending in endings), beside(out))
    there = [name for name in names[1:] if name.exists()]
    folders = [name for name in names if name.is_dir()]
    if folders or (there and not is_kept(out)):
        raise _refused(
            "path",
            got=f"{out}, beside {(folders or there)[0].name}, which dechirp did not write",
            need="a new name, or a capture that dechirp wrote, to be replaced as a whole",
            fix="Give another name, or move that file away.",
        )
    return names


def _step(recording: Recording) -> tuple[float, Finding]:
    """Size of a step for samples that are no codes, and what is said of it.

    The smallest power of two with which no sample is larger than a code can be: codes times it
    are exact in float32, and it costs less than 6 dB.
    """
    largest = max(_least_step(frame) for frame in numbers(recording, None))
    step = 2.0 ** max(math.ceil(math.log2(largest)), _LEAST) if largest > 0 else 2.0**-15
    units = recording.contents.units
    return step, Finding(
        level="note",
        setting="scale",
        got=f"samples that were no codes of a converter, rounded to steps of {step:.6g} {units}",
        need="whole numbers of steps, of 16 bits",
        fix="Nothing is to be done; it adds noise of a twelfth of a step squared to each part.",
    )


def _least_step(frame: np.ndarray) -> float:
    """The smallest step with which all parts of the samples of a frame are codes of 16 bits."""
    parts = _parts(frame)
    return float(max(parts.max() / (2**15 - 1), -parts.min() / 2**15))


def _rounded(frame: np.ndarray, step: float) -> np.ndarray:
    return np.rint(_parts(frame) * np.float32(1 / step)).astype(np.int16)


def _parts(frame: np.ndarray) -> np.ndarray:
    """Samples (chirp, rx, sample); both parts of complex ones, (chirp, rx, sample, 2)."""
    if not np.iscomplexobj(frame):
        return frame
    return np.ascontiguousarray(frame).view(np.float32).reshape(*frame.shape, 2)


def _no_cfg(chip: TiChip, why: str) -> Finding:
    return Finding(
        level="note",
        setting="cfg",
        got=f"not written: {why}",
        need=f"a radar that the demo of {chip.of.kind()} can be told to be",
        fix="Use the .mmwave.json, which says the same of the samples.",
    )


def _refused(setting: str, *, got: str, need: str, fix: str) -> DechirpError:
    return DechirpError(Mistake(setting=setting, got=got, need=need, fix=fix))

"""TI DCA1000 captures: raw words (`x.bin`), with settings files that describe them.

`x.cfg` and, as in mmWave Studio, `x.mmwave.json` and `x.setup.json` are for TI's tools and
compatible ones; `x.dechirp.json` is the sidecar. A `.cfg` is written if the demo of a board can be
configured as that radar, a `.setup.json` if the antennas are those of a board.

TI application report SWRA581, Mmwave Radar Device ADC Raw Data Capture.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.atomic_files import atomic_files
from dechirp.core.errors import DechirpError, Mistake
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.json_columns import TYPES
from dechirp.recordings.recording import Recording
from dechirp.recordings.settings.ti_chip import (
    CFG_BITS,
    TiChip,
    check_fits_single_chip,
    choose_chip,
    format_cfg_or_reason,
    frame_count_or_zero_above_limit,
    radar_with_frame_period,
)
from dechirp.recordings.settings.ti_frame import BITS
from dechirp.recordings.settings.write_mmwave_json import format_mmwave_json, format_mmwave_setup
from dechirp.recordings.sidecar import (
    MAX_SIDECAR_BYTES,
    WordLayout,
    format_sidecar_json,
    has_sidecar,
    sidecar_path,
)
from dechirp.recordings.writers.adc_samples import (
    iter_code_or_float_arrays,
    write_as_codes_else_floats,
)
from dechirp.recordings.writers.base import Progress, Writer
from dechirp.recordings.writers.description_text import (
    check_column_types,
    recording_description_and_columns,
)

_MIN_STEP_EXPONENT = -90  # float32 holds the inverse of this power of two


@frozen_dataclass
class Dca1000(Writer):
    """Captures of a TI radar chip, with the settings files of TI's tools.

    Converter codes are stored unchanged; other samples are rounded to 16 bits, and a finding
    reports the step.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".bin",)
    summary: ClassVar[str] = (
        "int16 samples of a DCA1000, settings of TI's tools; the rest in a sidecar file"
    )

    def check_recording(self, recording: Recording) -> None:
        recording.check_has_samples()
        check_fits_single_chip(recording.radar)
        _check_sidecar_size(recording)

    def output_files(self, recording: Recording, out: Path) -> tuple[Path, ...]:
        return _checked_capture_paths(out)

    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        names, chip = _checked_capture_paths(out), choose_chip(recording)

        def write_capture(scale: float | None) -> None:
            step, rounded = _choose_quantisation_step(recording) if scale is None else (scale, None)
            texts = _format_settings_files(recording, chip, names, step, rounded)
            with atomic_files(*names) as temporaries:
                with temporaries[0].open("wb") as file:
                    for n_done, frame in enumerate(
                        iter_code_or_float_arrays(recording, scale), start=1
                    ):
                        codes = frame if scale is not None else _round_to_codes(frame, step)
                        file.write(chip.codes_to_bytes(codes))
                        if progress is not None:
                            progress(n_done, recording.n_frames)
                for name, text in zip(temporaries[1:], texts, strict=True):
                    if text is not None:
                        name.write_text(text, encoding="utf-8")

        write_as_codes_else_floats(recording, write_capture)
        return tuple(name for name in names if name.exists())


def _check_sidecar_size(recording: Recording) -> None:
    """Raise `DechirpError` unless the tables fit into a sidecar as JSON."""
    check_column_types(TYPES, recording.tables)
    n_bytes = len(_format_sidecar(recording, choose_chip(recording), 1.0, ()))
    if n_bytes > MAX_SIDECAR_BYTES:
        raise _setting_error(
            "tables",
            value=f"{n_bytes} bytes as JSON",
            expected=f"at most {MAX_SIDECAR_BYTES}",
            fix="write fewer frames, or a format with larger tables, such as .h5",
        )


def _format_settings_files(
    recording: Recording,
    chip: TiChip,
    capture_paths: tuple[Path, ...],
    quantisation_step: float,
    rounding_finding: Finding | None,
) -> tuple[str | None, ...]:
    """Return the texts of the settings files, in the order of their names."""
    samples, _, used, _, _ = capture_paths
    bits = _converter_bits(recording, quantisation_step) if rounding_finding is None else CFG_BITS
    cfg, missing_reason = format_cfg_or_reason(recording, chip, bits)
    studio_json = format_mmwave_json(
        radar_with_frame_period(recording),
        tx=chip.tx,
        rx=chip.rx,
        lanes=chip.lanes,
        n_frames=frame_count_or_zero_above_limit(recording),
        iq=chip.iq,
        bits=bits,
    )
    setup = (
        format_mmwave_setup(chip.device, settings_file=used, capture_file=samples)
        if chip.is_board
        else None
    )
    findings = [] if rounding_finding is None else [rounding_finding]
    if cfg is None:
        findings.append(_missing_cfg_note(chip, missing_reason))
    return cfg, studio_json, setup, _format_sidecar(recording, chip, quantisation_step, findings)


def _format_sidecar(
    recording: Recording, chip: TiChip, quantisation_step: float, findings: Sequence[Finding]
) -> str:
    """Return the text of the sidecar."""
    is_complex = recording.radar.frame.chirp.sampling == "complex"
    layout = WordLayout(
        device=chip.device.kind(),
        lanes=chip.lanes,
        receivers=chip.rx,
        iq=chip.iq if is_complex else None,
        n_frames=recording.n_frames,
    )
    description, columns = recording_description_and_columns(recording, quantisation_step)
    return format_sidecar_json(description, columns, layout, recording.contents.gaps, findings)


def _converter_bits(recording: Recording, quantisation_step: float) -> int:
    """Return the bits of a converter with full scale 1; 16 for any other."""
    steps = {2.0 ** (1 - bits): bits for bits in BITS.values()}
    return steps.get(quantisation_step, CFG_BITS) if recording.contents.units == "1" else CFG_BITS


def _checked_capture_paths(out: Path) -> tuple[Path, ...]:
    """Return the paths of a capture; raise `DechirpError` if another program wrote one."""
    if out.suffix.lower() != ".bin":
        raise _setting_error(
            "path", value=str(out), expected="a name that ends in .bin", fix="change it"
        )
    suffixes = (".cfg", ".mmwave.json", ".setup.json")
    names = (out, *(out.with_suffix(ending) for ending in suffixes), sidecar_path(out))
    existing = [name for name in names[1:] if name.exists()]
    folders = [name for name in names if name.is_dir()]
    if folders or (existing and not has_sidecar(out)):
        raise _setting_error(
            "path",
            value=f"{out}, next to {(folders or existing)[0].name}, which dechirp did not write",
            expected="a new name, or a capture of dechirp, which is replaced completely",
            fix="give another name, or move that file away",
        )
    return names


def _choose_quantisation_step(recording: Recording) -> tuple[float, Finding]:
    """Return the step for samples that are not codes, and a finding about it.

    The step is the smallest power of two for which all samples fit into 16 bits: codes times the
    step are exact in float32, and less than 6 dB of range is unused.
    """
    largest = max(
        _smallest_quantisation_step(frame) for frame in iter_code_or_float_arrays(recording, None)
    )
    step = (
        2.0 ** max(math.ceil(math.log2(largest)), _MIN_STEP_EXPONENT) if largest > 0 else 2.0**-15
    )
    units = recording.contents.units
    return step, Finding(
        level="note",
        setting="scale",
        value=f"samples that are not converter codes, rounded to steps of {step:.6g} {units}",
        expected="integer codes of 16 bits",
        fix="nothing; rounding adds noise of step^2 / 12 to each part",
    )


def _smallest_quantisation_step(frame: np.ndarray) -> float:
    """Return the smallest step with which all samples of a frame fit into 16 bits."""
    parts = _iq_as_last_axis(frame)
    return float(max(parts.max() / (2**15 - 1), -parts.min() / 2**15))


def _round_to_codes(frame: np.ndarray, quantisation_step: float) -> np.ndarray:
    return np.rint(_iq_as_last_axis(frame) * np.float32(1 / quantisation_step)).astype(np.int16)


def _iq_as_last_axis(frame: np.ndarray) -> np.ndarray:
    """Return samples (chirp, rx, sample), with both parts of complex ones in a last axis."""
    if not np.iscomplexobj(frame):
        return frame
    return np.ascontiguousarray(frame).view(np.float32).reshape(*frame.shape, 2)


def _missing_cfg_note(chip: TiChip, reason: str) -> Finding:
    return Finding(
        level="note",
        setting="cfg",
        value=f"not written: {reason}",
        expected=f"a radar that the demo of {chip.device.kind()} supports",
        fix="use the .mmwave.json, which has the same settings",
    )


def _setting_error(setting: str, *, value: str, expected: str, fix: str) -> DechirpError:
    return DechirpError(Mistake(setting=setting, value=value, expected=expected, fix=fix))

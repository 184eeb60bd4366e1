"""`dechirp calibrate`: a reflector at known angles in, corrections for each element out."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from dechirp.cli.options import NOTHING_TOLD, Json, Quiet, Told

if TYPE_CHECKING:
    from dechirp.core.findings import Finding
    from dechirp.formats.recording import Recording
    from dechirp.process.calibration.calibrate import Calibrated
    from dechirp.radar.radar import Radar

_Texts = Annotated[list[str] | None, Parameter(allow_leading_hyphen=True)]  # -10 deg is one, too


def calibrate(
    *recordings: Path,
    azimuth: _Texts = None,
    elevation: _Texts = None,
    range: _Texts = None,
    out: Path = Path("calibration.json"),
    as_json: Json = False,
    quiet: Quiet = False,
    told: Told = NOTHING_TOLD,
) -> int:
    """Measure gains and places of an array's elements with a reflector at known angles.

    The reflector stands still. Several recordings of it at different angles, each with its own
    --azimuth in the same order, also tell where the elements are.

    Parameters
    ----------
    recordings
        Recordings of the reflector: files or folders, of the same radar.
    azimuth
        Where it stands, as "30 deg", left positive; once for each recording.
    elevation
        Its elevation, up positive; 0 without it. Once, or once for each recording.
    range
        How far it stands, as 2.05m: says which echo it is, and measures the range offset. Once, or
        once for each recording; without it, the strongest echo at rest.
    out
        File for the calibration (JSON), as --calibration reads it. An earlier one is replaced.
    """
    from dechirp.cli.wrong import under_option
    from dechirp.core.errors import DechirpError
    from dechirp.formats.recording import open as open_recording
    from dechirp.formats.settings.calibration import calibration_text
    from dechirp.process.calibration.calibrate import calibrate as calibrate_array
    from dechirp.store.tables import json_text
    from dechirp.store.whole import write_whole

    azimuths, elevations = _angles("--azimuth", azimuth), _angles("--elevation", elevation)
    ranges = _numbers("--range", range, "m")
    _must_be_given(recordings, azimuths)
    _must_be_ours(out)
    opened = [open_recording(one, **told.given()) for one in recordings]
    own = _radar_of_all(opened)
    try:
        found = calibrate_array(
            [one.frames() for one in opened],
            own,
            azimuth_rad=azimuths,
            elevation_rad=_one_or_all(elevations) or 0.0,
            range_m=_one_or_all(ranges),
        )
    except DechirpError as error:
        raise under_option(error, _options(len(recordings))) from None
    write_whole(out, calibration_text(found.calibration))
    doubts = [*_assumed(opened), *_of_options(found)]
    document = json_text(_document(found, out, doubts))
    if as_json:
        print(document, end="")
    elif not quiet:
        _show(found, recordings, out, doubts)
    return 0


def _angles(option: str, texts: Sequence[str] | None) -> list[float]:
    return _numbers(option, texts, "rad")


def _numbers(option: str, texts: Sequence[str] | None, unit: str) -> list[float]:
    from dechirp.config.quantities import quantity

    return [quantity(text, unit, setting=option) for text in texts or ()]


def _one_or_all(numbers: list[float]) -> list[float] | float | None:
    return numbers if len(numbers) > 1 else numbers[0] if numbers else None


_NAMES = {
    "azimuth_rad": "--azimuth",
    "elevation_rad": "--elevation",
    "range_m": "--range",
    "cube": "the recording",
}
"""What the settings of `process.calibration.calibrate` are called here."""


def _options(n_recordings: int) -> dict[str, str]:
    numbered = {
        f"{name}.{n}": option for name, option in _NAMES.items() for n in range(n_recordings)
    }
    return {**_NAMES, **numbered}


def _of_options(found: "Calibrated") -> "list[Finding]":
    """The findings, about options in place of settings."""
    return [replace(one, setting=_NAMES[one.setting]) for one in found.findings]


def _assumed(opened: "list[Recording]") -> "list[Finding]":
    """What was assumed of the array, which a calibration takes as true."""
    said = {one: None for recording in opened for one in recording.findings}  # once each, in order
    return [
        replace(
            one,
            level="warning",
            need="their true positions: phases and gains are measured against them",
            fix="Name the chip or board with --device, or give --radar with its array.",
        )
        for one in said
        if one.setting.startswith("radar.array")
    ]


def _must_be_given(recordings: Sequence[Path], azimuths: list[float]) -> None:
    from dechirp.core.errors import InvalidFile, Mistake

    mistakes = []
    if not recordings:
        mistakes.append(
            Mistake(
                setting="RECORDING",
                got="absent",
                need="a recording of a reflector",
                fix='Write dechirp calibrate RECORDING --azimuth "30 deg".',
            )
        )
    elif len(set(recordings)) < len(recordings):
        twice = next(one for one in recordings if recordings.count(one) > 1)
        mistakes.append(
            Mistake(
                setting="RECORDING",
                got=f"{twice}, given twice",
                need="recordings that differ: the same one tells nothing new",
                fix="Give it once, or another recording.",
            )
        )
    elif len(azimuths) != len(recordings):
        mistakes.append(
            Mistake(
                setting="--azimuth",
                got="absent" if not azimuths else f"given {len(azimuths)} times",
                need=f"given once for each of the {len(recordings)} recordings, in their order"
                if len(recordings) > 1
                else "given once: where the reflector stands, left positive",
                fix='Write --azimuth "30 deg"; 0 straight ahead.',
            )
        )
    if mistakes:
        raise InvalidFile(*mistakes)


def _must_be_ours(out: Path) -> None:
    """Refuse to replace what is no calibration; asked before the work."""
    from dechirp.core.errors import DechirpError, InvalidFile, Mistake
    from dechirp.formats.settings.calibration import read_calibration

    if not out.exists():
        return
    try:
        read_calibration(out)
    except DechirpError:
        raise InvalidFile(
            Mistake(
                setting="--out",
                got=f"{out}, which is there and no calibration",
                need="a new name, or a calibration to be replaced",
                fix="Name another file.",
            )
        ) from None


def _radar_of_all(opened: "list[Recording]") -> "Radar":
    from dechirp.core.errors import RecordingError

    for one in opened:
        one.must_hold_samples()
        if one.radar != opened[0].radar:
            raise RecordingError(
                one.path,
                got=f"of another radar or waveform than {opened[0].path}",
                need="taken with the same settings",
                fix="Calibrate from recordings of one waveform; gains hold for the others, too.",
            )
    return opened[0].radar


def _rows(found: "Calibrated") -> list[dict[str, Any]]:
    """What was measured of each element, in the units of tables."""
    import numpy as np

    from dechirp.core.units import decibels

    calibration = found.calibration
    gain = np.array(calibration.gain) @ np.array([1, 1j])
    rows = []
    for index, (tx, rx) in enumerate(calibration.elements):
        row: dict[str, Any] = {
            "tx": tx,
            "rx": rx,
            "gain_db": float(decibels(abs(gain[index]) ** 2)),
            "gain_std_db": float(20 / np.log(10) * found.gain_std[index]),
            "phase_deg": float(np.degrees(np.angle(gain[index]))),
            "phase_std_deg": float(np.degrees(found.gain_std[index])),
            "snr_db": float(decibels(found.snr[index])),
        }
        if calibration.position_error_m is not None:
            row["position_error_m"] = calibration.position_error_m[index]
            row["position_std_m"] = found.position_std_m[index]
        rows.append(row)
    return rows


def _document(found: "Calibrated", out: Path, doubts: "list[Finding]") -> dict[str, Any]:
    from dechirp.config.texts import plain

    return {
        "calibration": plain(found.calibration),
        "elements": _rows(found),
        "range_m": found.range_m,
        "findings": [plain(finding) for finding in doubts],
        "files": {"calibration": str(out)},
    }


def _show(
    found: "Calibrated",
    recordings: Sequence[Path],
    out: Path,
    doubts: "list[Finding]",
) -> None:
    from dechirp.cli.show import console, findings, table

    screen = console()
    calibration = found.calibration
    moved = calibration.position_error_m is not None
    columns = ["tx", "rx", "gain, dB", "phase, deg", "SNR, dB"] + ["y, mm", "z, mm"] * moved
    made = table(f"{len(calibration.elements)} elements", right=columns)
    for row in _rows(found):
        cells = [
            str(row["tx"]),
            str(row["rx"]),
            f"{row['gain_db']:.2f} ± {row['gain_std_db']:.2f}",
            f"{row['phase_deg']:.1f} ± {row['phase_std_deg']:.1f}",
            f"{row['snr_db']:.1f}",
        ]
        if moved:
            both = zip(row["position_error_m"], row["position_std_m"], strict=True)
            cells += [f"{1e3 * at:.3f} ± {1e3 * std:.3f}" for at, std in list(both)[1:]]
        made.add_row(*cells)
    screen.print(made)
    for path, range_m in zip(recordings, found.range_m, strict=True):
        screen.print(f"{path}: reflector seen at {range_m:.4g} m", soft_wrap=True)
    if calibration.range_offset_m:
        screen.print(f"Range offset: {calibration.range_offset_m * 1e3:.1f} mm")
    screen.print(f"Residual: {calibration.residual:.2g} of the echo")
    for paragraph in findings(doubts):
        screen.print(paragraph)
    screen.print(f"Calibration: {out}", soft_wrap=True)

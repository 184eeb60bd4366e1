"""`dechirp calibrate`: element corrections from a reflector at known angles."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from dechirp.cli.options import NO_OPTIONS, Json, Quiet, RecordingOptions

if TYPE_CHECKING:
    from dechirp.core.findings import Finding
    from dechirp.processing.calibration.calibrate import CalibrationResult
    from dechirp.radar.radar import Radar
    from dechirp.recordings.recording import Recording

_Texts = Annotated[list[str] | None, Parameter(allow_leading_hyphen=True)]  # -10 deg is one, too


def calibrate(
    *recordings: Path,
    azimuth: _Texts = None,
    elevation: _Texts = None,
    range: _Texts = None,
    out: Path = Path("calibration.json"),
    as_json: Json = False,
    quiet: Quiet = False,
    options: RecordingOptions = NO_OPTIONS,
) -> int:
    """Measure gains and positions of the array elements with a reflector at known angles.

    The reflector must stand still. Several recordings of it at different angles, each with its own
    --azimuth in the same order, also give the positions of the elements.

    Parameters
    ----------
    recordings
        Recordings of the reflector: files or folders, of the same radar.
    azimuth
        Azimuth of the reflector, such as "30 deg", positive to the left; once for each recording.
    elevation
        Elevation of the reflector, positive upwards; 0 by default. Once, or once for each
        recording.
    range
        Range of the reflector, such as 2.05m: selects its echo and gives the range offset. Once, or
        once for each recording; by default the strongest static echo is used.
    out
        File for the calibration (JSON) for --calibration. An existing calibration is replaced.
    """
    from dechirp.cli.errors import replace_settings_by_options
    from dechirp.core.atomic_files import write_text_atomically
    from dechirp.core.errors import DechirpError
    from dechirp.processing.calibration.calibrate import calibrate as calibrate_array
    from dechirp.recordings.recording import open as open_recording
    from dechirp.recordings.settings.calibration import format_calibration_json
    from dechirp.results.text_files import to_json_text

    azimuths, elevations = (
        _parse_angles("--azimuth", azimuth),
        _parse_angles("--elevation", elevation),
    )
    ranges = _parse_quantities("--range", range, "m")
    _check_one_azimuth_per_recording(recordings, azimuths)
    _check_out_new_or_calibration(out)
    opened_recordings = [
        open_recording(recording, **options.open_keyword_arguments()) for recording in recordings
    ]
    radar = _get_common_radar_or_raise(opened_recordings)
    try:
        result = calibrate_array(
            [recording.frames() for recording in opened_recordings],
            radar,
            azimuth_rad=azimuths,
            elevation_rad=_none_single_or_list(elevations) or 0.0,
            range_m=_none_single_or_list(ranges),
        )
    except DechirpError as error:
        raise replace_settings_by_options(
            error, _option_names_by_setting(len(recordings))
        ) from None
    write_text_atomically(out, format_calibration_json(result.calibration))
    all_findings = [
        *_assumed_array_findings(opened_recordings),
        *_findings_with_option_names(result),
    ]
    document = to_json_text(_calibration_json_document(result, out, all_findings))
    if as_json:
        print(document, end="")
    elif not quiet:
        _print_calibration(result, recordings, out, all_findings)
    return 0


def _parse_angles(option: str, texts: Sequence[str] | None) -> list[float]:
    from dechirp.core.errors import InvalidFile, Mistake

    for text in texts or ():
        if _is_bare_number(text):
            raise InvalidFile(
                Mistake(
                    setting=option,
                    value=f"{text}, without a unit",
                    expected="an angle with its unit",
                    fix=f'write {option} "{text} deg"',
                )
            )
    return _parse_quantities(option, texts, "rad")


def _is_bare_number(text: str) -> bool:
    try:
        return float(text) != 0  # which is 0 in all units
    except ValueError:
        return False


def _parse_quantities(option: str, texts: Sequence[str] | None, unit: str) -> list[float]:
    from dechirp.config.quantities import parse_quantity

    return [parse_quantity(text, unit, setting=option) for text in texts or ()]


def _none_single_or_list(numbers: list[float]) -> list[float] | float | None:
    return numbers if len(numbers) > 1 else numbers[0] if numbers else None


_OPTION_BY_SETTING = {
    "azimuth_rad": "--azimuth",
    "elevation_rad": "--elevation",
    "range_m": "--range",
    "cube": "the recording",
}
"""Options by the names of the arguments of `processing.calibration.calibrate`."""


def _option_names_by_setting(n_recordings: int) -> dict[str, str]:
    indexed_options = {
        f"{name}.{n}": option
        for name, option in _OPTION_BY_SETTING.items()
        for n in range(n_recordings)
    }
    return {**_OPTION_BY_SETTING, **indexed_options}


def _findings_with_option_names(result: "CalibrationResult") -> "list[Finding]":
    """Return the findings of a calibration, with option names in place of setting names."""
    return [
        replace(finding, setting=_OPTION_BY_SETTING[finding.setting]) for finding in result.findings
    ]


def _assumed_array_findings(recordings: "list[Recording]") -> "list[Finding]":
    """Return the findings on an assumed array, which the calibration takes as true."""
    # Once each, in order.
    findings = {finding: None for recording in recordings for finding in recording.findings}
    return [
        replace(
            finding,
            level="warning",
            expected="the true positions: phases and gains are measured relative to them",
            fix="name the chip or board with --device, or give the array with --radar",
        )
        for finding in findings
        if finding.setting.startswith("radar.array")
    ]


def _check_one_azimuth_per_recording(recordings: Sequence[Path], azimuths: list[float]) -> None:
    from dechirp.core.display import format_count_with_noun
    from dechirp.core.errors import InvalidFile, Mistake

    mistakes = []
    if not recordings:
        mistakes.append(
            Mistake(
                setting="RECORDING",
                value="missing",
                expected="a recording of a reflector",
                fix='write dechirp calibrate RECORDING --azimuth "30 deg"',
            )
        )
    elif len(set(recordings)) < len(recordings):
        duplicate = next(path for path in recordings if recordings.count(path) > 1)
        mistakes.append(
            Mistake(
                setting="RECORDING",
                value=f"{duplicate}, given twice",
                expected="different recordings: the same one adds no information",
                fix="give it once, or give another recording",
            )
        )
    elif len(azimuths) != len(recordings):
        mistakes.append(
            Mistake(
                setting="--azimuth",
                value=format_count_with_noun(len(azimuths), "value") if azimuths else "missing",
                expected=f"one azimuth for each of the {len(recordings)} recordings, in their order"
                if len(recordings) > 1
                else "one azimuth of the reflector, positive to the left",
                fix='write --azimuth "30 deg"; 0 is straight ahead',
            )
        )
    if mistakes:
        raise InvalidFile(*mistakes)


def _check_out_new_or_calibration(out: Path) -> None:
    """Raise `InvalidFile` if OUT exists and is not a calibration; called before the work."""
    from dechirp.core.errors import DechirpError, InvalidFile, Mistake
    from dechirp.recordings.settings.calibration import read_calibration

    if not out.exists():
        return
    try:
        read_calibration(out)
    except DechirpError:
        raise InvalidFile(
            Mistake(
                setting="--out",
                value=f"{out}, an existing file that is not a calibration",
                expected="a new name, or a calibration to replace",
                fix="name another file",
            )
        ) from None


def _get_common_radar_or_raise(recordings: "list[Recording]") -> "Radar":
    from dechirp.core.errors import RecordingError

    for recording in recordings:
        recording.check_has_samples()
        if recording.radar != recordings[0].radar:
            raise RecordingError(
                recording.path,
                value=f"radar or waveform different from {recordings[0].path}",
                expected="recordings with the same settings",
                fix="calibrate from recordings of one waveform; gains hold for the others, too",
            )
    return recordings[0].radar


def _element_measurement_rows(result: "CalibrationResult") -> list[dict[str, Any]]:
    """Return the measurements of each element, in the units of tables."""
    import numpy as np

    from dechirp.core.units import to_decibels

    calibration = result.calibration
    gain = np.array(calibration.gain) @ np.array([1, 1j])
    rows = []
    for index, (tx, rx) in enumerate(calibration.elements):
        row: dict[str, Any] = {
            "tx": tx,
            "rx": rx,
            "gain_db": float(to_decibels(abs(gain[index]) ** 2)),
            "gain_std_db": float(20 / np.log(10) * result.gain_std[index]),
            "phase_deg": float(np.degrees(np.angle(gain[index]))),
            "phase_std_deg": float(np.degrees(result.gain_std[index])),
            "snr_db": float(to_decibels(result.snr[index])),
        }
        if calibration.position_error_m is not None:
            row["position_error_m"] = calibration.position_error_m[index]
            row["position_std_m"] = result.position_std_m[index]
        rows.append(row)
    return rows


def _calibration_json_document(
    result: "CalibrationResult", out: Path, findings: "list[Finding]"
) -> dict[str, Any]:
    from dechirp.config.dumping import to_json_data

    return {
        "calibration": to_json_data(result.calibration),
        "elements": _element_measurement_rows(result),
        "range_m": result.range_m,
        "findings": [to_json_data(finding) for finding in findings],
        "files": {"calibration": str(out)},
    }


def _print_calibration(
    result: "CalibrationResult",
    recordings: Sequence[Path],
    out: Path,
    shown_findings: "list[Finding]",
) -> None:
    from dechirp.cli.console import finding_paragraphs, new_table, open_stdout_console

    screen = open_stdout_console()
    calibration = result.calibration
    has_positions = calibration.position_error_m is not None
    columns = ["tx", "rx", "Gain (dB)", "Phase (deg)", "SNR (dB)"] + [
        "y (mm)",
        "z (mm)",
    ] * has_positions
    rows = new_table(f"{len(calibration.elements)} elements", number_columns=columns)
    for row in _element_measurement_rows(result):
        cells = [
            str(row["tx"]),
            str(row["rx"]),
            f"{row['gain_db']:.2f} ± {row['gain_std_db']:.2f}",
            f"{row['phase_deg']:.1f} ± {row['phase_std_deg']:.1f}",
            f"{row['snr_db']:.1f}",
        ]
        if has_positions:
            coordinates = zip(row["position_error_m"], row["position_std_m"], strict=True)
            cells += [
                f"{1e3 * error_m:.3f} ± {1e3 * std:.3f}" for error_m, std in list(coordinates)[1:]
            ]
        rows.add_row(*cells)
    screen.print(rows)
    for path, range_m in zip(recordings, result.range_m, strict=True):
        screen.print(f"{path}: reflector seen at {range_m:.4g} m")
    if calibration.range_offset_m:
        screen.print(f"Range offset: {calibration.range_offset_m * 1e3:.1f} mm")
    screen.print(f"Residual: {calibration.residual:.2g} of the echo")
    for paragraph in finding_paragraphs(shown_findings):
        screen.print(paragraph)
    screen.print(f"Calibration: {out}")

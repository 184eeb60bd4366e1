"""`dechirp diagnose`: well-known mistakes in arrays that another program made."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from dechirp.cli.options import IntegerText, Json, Quiet, parse_integer_option

if TYPE_CHECKING:
    from dechirp.processing.diagnosis.diagnosis import Diagnosis

_Text = Annotated[str | None, Parameter(allow_leading_hyphen=True)]


def diagnose(
    file: Path,
    /,
    *,
    radar: Path | None = None,
    scale: Literal["power", "amplitude", "decibels"] = "power",
    summed: IntegerText = None,
    target_range: _Text = None,
    target_velocity: _Text = None,
    training: str | None = None,
    guard: str | None = None,
    pfa: str | None = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Find well-known mistakes in samples, range profiles and maps of other programs.

    The exit status is 1 if there is a mistake; 3 if there is none, but some could not be told; 0 if
    there is none. A file with range_m contains a profile, with velocity_m_per_s too a map
    (velocity, range), otherwise samples (chirp, sample). For recordings and their faults, see
    dechirp inspect.

    Parameters
    ----------
    file
        File of arrays: .npy, .npz or .mat, also of version 7.3.
    radar
        Settings of the radar: YAML, or a vendor's file. Required for samples.
    scale
        Scale of a profile or map: power, amplitude, or decibels of power.
    summed
        Number of powers averaged in each cell, such as those of receivers.
    target_range
        Range of a known target, such as "20 m".
    target_velocity
        Its velocity, such as "-3 m/s"; receding is positive.
    training
        Training cells on each side of the array threshold: VELOCITY,RANGE or RANGE.
    guard
        Guard cells in the same way.
    pfa
        False-alarm probability of the array threshold.
    """
    from dechirp.config.quantities import parse_quantity
    from dechirp.experiments.array_diagnosis import diagnose_file
    from dechirp.recordings.settings.read import read_radar
    from dechirp.results.text_files import to_json_text

    diagnosis = diagnose_file(
        file,
        radar=None if radar is None else read_radar(radar),
        scale=scale,
        n_summed=None if summed is None else parse_integer_option("--summed", summed, 1, 10**6),
        target_range_m=None
        if target_range is None
        else parse_quantity(target_range, "m", setting="--target-range"),
        target_velocity_m_per_s=None
        if target_velocity is None
        else parse_quantity(target_velocity, "m_per_s", setting="--target-velocity"),
        n_training=_parse_cells("--training", training),
        n_guard=_parse_cells("--guard", guard),
        pfa=None if pfa is None else parse_quantity(pfa, None, setting="--pfa"),
    )
    if as_json:
        print(to_json_text(_diagnosis_json_document(file, diagnosis)), end="")
    elif not quiet:
        _print_diagnosis(file, diagnosis)
    if diagnosis.findings:
        return 1
    return 3 if diagnosis.undetermined else 0


def _parse_cells(option: str, text: str | None) -> int | tuple[int, int] | None:
    """Parse a number of cells, or a pair for velocity and range."""
    from dechirp.core.errors import InvalidSetting

    if text is None:
        return None
    cells = [parse_integer_option(option, part.strip(), 0, 10**6) for part in text.split(",")]
    if len(cells) > 2:
        raise InvalidSetting(
            option,
            value=text,
            expected="one number, or two for velocity and range",
            fix="write 2,8 for two cells over velocity and eight over range",
        )
    return cells[0] if len(cells) == 1 else (cells[0], cells[1])


def _diagnosis_json_document(file: Path, diagnosis: "Diagnosis") -> dict[str, object]:
    from dechirp.config.dumping import to_json_data

    return {
        "source": str(file),
        "findings": [to_json_data(finding) for finding in diagnosis.findings],
        "undetermined": [to_json_data(note) for note in diagnosis.undetermined],
    }


def _print_diagnosis(file: Path, diagnosis: "Diagnosis") -> None:
    from dechirp.cli.console import finding_paragraphs, open_stdout_console

    screen = open_stdout_console()
    screen.print(str(file))
    for paragraph in finding_paragraphs((*diagnosis.findings, *diagnosis.undetermined)):
        screen.print(paragraph)
    if not diagnosis.findings:
        untold = len(diagnosis.undetermined)
        screen.print(
            "No known mistake was found" + (f", but {untold} could not be told." if untold else ".")
        )

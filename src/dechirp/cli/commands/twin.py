"""`dechirp twin`: simulation of a recording, compared with it."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dechirp.cli.options import (
    NO_OPTIONS,
    IntegerText,
    Json,
    Pdf,
    Quiet,
    RecordingOptions,
    parse_integer_option,
)

if TYPE_CHECKING:
    from dechirp.experiments.twin.twin import TwinTolerance

_TWIN_FILES = ("twin.json", "twin.yaml", "report.html")


def twin(
    source: Path,
    /,
    *,
    power_tolerance: str = "1 dB",
    bin_tolerance: str = "0.2",
    out: Path = Path("dechirp-twin"),
    pdf: Pdf = False,
    as_json: Json = False,
    quiet: Quiet = False,
    seed: IntegerText = None,
    options: RecordingOptions = NO_OPTIONS,
) -> int:
    """Simulate the radar, the noise and the peaks of a recording, and compare both.

    The exit status is 1 if the noise level, or a peak well above the noise, differs by more than
    the tolerances.

    Parameters
    ----------
    source
        Recording: a file or a folder. The first frame is simulated; --frames 3:4 selects frame 3.
    power_tolerance
        Largest difference of the noise level and of the power of a peak.
    bin_tolerance
        Largest distance of a peak from the recorded one, in bins along each axis.
    out
        Folder for report.html, twin.yaml (the simulation, for `dechirp run`) and twin.json.
        Existing ones are replaced.
    seed
        Seed of the noise of the simulation.
    """
    import dechirp
    from dechirp.cli.console import progress_bar
    from dechirp.config.dumping import dump_yaml
    from dechirp.experiments.twin.document import twin_comparison_as_dict
    from dechirp.experiments.twin.twin import twin as fit_twin
    from dechirp.recordings.recording import open as open_recording
    from dechirp.report.pdf import check_pdf_available, html_to_pdf
    from dechirp.report.twin import render_twin_page
    from dechirp.results.text_files import (
        check_folder_replaceable,
        to_json_text,
        write_files_into_folder,
    )

    limits = _parse_tolerances(power_tolerance, bin_tolerance)
    number = 0 if seed is None else parse_integer_option("--seed", seed, 0, 2**63 - 1)
    check_folder_replaceable(out, (*_TWIN_FILES, "report.pdf"))
    if pdf:
        check_pdf_available()
    names = (*_TWIN_FILES, "report.pdf") if pdf else _TWIN_FILES
    recording = open_recording(source, **options.open_keyword_arguments())
    with progress_bar("rounds", quiet=quiet) as report:
        result = fit_twin(recording, seed=number, progress=report)
    yaml = dump_yaml(result.scenario)
    json_document = {
        "version": dechirp.__version__,
        "source": str(source),
        **twin_comparison_as_dict(result, limits),
        "scenario": str(out / "twin.yaml"),
        "files": {name: str(out / name) for name in names},
    }
    texts = (to_json_text(json_document), yaml, render_twin_page(result, json_document, yaml=yaml))
    contents = [text.encode() for text in texts] + ([html_to_pdf(texts[-1])] if pdf else [])
    write_files_into_folder(out, dict(zip(names, contents, strict=True)))
    if as_json:
        print(texts[0], end="")
    elif not quiet:
        _print_twin_comparison(json_document, out)
    return 0 if json_document["passed"] else 1


def _parse_tolerances(power_tolerance: str, bin_tolerance: str) -> "TwinTolerance":
    from dechirp.config.quantities import parse_quantity
    from dechirp.core.errors import InvalidSetting
    from dechirp.experiments.twin.twin import TwinTolerance

    power = parse_quantity(power_tolerance, None, setting="--power-tolerance")
    if power <= 1:
        raise InvalidSetting(
            "--power-tolerance",
            value=power_tolerance,
            expected="a ratio above 1 (0 dB)",
            fix="write 1 dB",
        )
    try:
        cells = float(bin_tolerance)
    except ValueError:
        cells = 0.0
    if not 0 < cells < 1.5:
        raise InvalidSetting(
            "--bin-tolerance",
            value=bin_tolerance,
            expected="a number of bins above 0 and below 1.5: beyond, it is another peak",
            fix="write 0.2",
        )
    return TwinTolerance(power=power, cells=cells)


def _print_twin_comparison(document: Mapping[str, Any], out: Path) -> None:
    from dechirp.cli.console import finding_paragraphs, new_table, open_stdout_console
    from dechirp.core.findings import Finding
    from dechirp.core.text import format_fixed
    from dechirp.report.twin import describe_judged_peaks, format_headline

    screen = open_stdout_console()
    right = [
        "Range (m)",
        "Velocity (m/s)",
        "SNR (dB)",
        "Power (dB)",
        "Range (bins)",
        "Vel. (bins)",
    ]
    rows = new_table(format_headline(document), number_columns=right, text_columns=[])
    differences = [difference for difference in document["differences"] if difference["judged"]]
    for difference in differences[:_MAX_ROWS]:
        rows.add_row(
            format_fixed(difference["range_m"], 3),
            format_fixed(difference["velocity_m_per_s"], 3),
            format_fixed(difference["snr_db"], 1),
            format_fixed(difference["power_difference_db"], 2, sign=True),
            format_fixed(difference["range_difference_bins"], 3, sign=True),
            format_fixed(difference["velocity_difference_bins"], 3, sign=True),
        )
    screen.print(rows)
    if len(differences) > _MAX_ROWS:
        screen.print(f"{len(differences) - _MAX_ROWS} more are in the report.")
    screen.print(describe_judged_peaks(document))
    for paragraph in finding_paragraphs(
        Finding(**difference) for difference in document["findings"]
    ):
        screen.print(paragraph)
    screen.print(f"Report: {out / 'report.html'}")


_MAX_ROWS = 20

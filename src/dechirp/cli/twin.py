"""`dechirp twin`: a recording, and a simulation of it beside it."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dechirp.cli.options import NOTHING_TOLD, Json, Pdf, Quiet, Told, Whole, whole_number

if TYPE_CHECKING:
    from dechirp.experiment.twin.twin import TwinBar

_FILES = ("twin.json", "twin.yaml", "report.html")


def twin(
    source: Path,
    /,
    *,
    within: str = "1 dB",
    bins: str = "0.2",
    out: Path = Path("dechirp-twin"),
    pdf: Pdf = False,
    as_json: Json = False,
    quiet: Quiet = False,
    seed: Whole = None,
    told: Told = NOTHING_TOLD,
) -> int:
    """Simulate a recording: its radar, its noise, a point for each peak; and show both.

    Ends with status 1 if the noise, or a peak that noise lets judge, differs by more than is said.

    Parameters
    ----------
    source
        Recording: a file or a folder. Of its frames the first is simulated; --frames 3:4 chooses
        number 3.
    within
        Largest difference of the noise, and of the power of a peak.
    bins
        Largest distance of a peak from the recorded one, in cells of the map, along each axis.
    out
        Folder for report.html, twin.yaml (the simulation, for `dechirp run`) and twin.json.
        Earlier ones in it are replaced.
    seed
        Seed of the noise of the simulation.
    """
    import dechirp
    from dechirp.cli.show import progress
    from dechirp.config.texts import dump
    from dechirp.experiment.twin.document import document
    from dechirp.experiment.twin.twin import twin as twin_of
    from dechirp.formats.recording import open as open_recording
    from dechirp.report.pdf import check_pdf, pdf_of
    from dechirp.report.twin import render
    from dechirp.store.tables import json_text
    from dechirp.store.texts import check_out, write_files

    bar = _bar(within, bins)
    number = 0 if seed is None else whole_number("--seed", seed, 0, 2**63 - 1)
    check_out(out, (*_FILES, "report.pdf"))
    if pdf:
        check_pdf()
    names = (*_FILES, "report.pdf") if pdf else _FILES
    recording = open_recording(source, **told.given())
    with progress("rounds", quiet=quiet) as report:
        made = twin_of(recording, seed=number, progress=report)
    yaml = dump(made.scenario)
    found = {
        "version": dechirp.__version__,
        "source": str(source),
        **document(made, bar),
        "scenario": str(out / "twin.yaml"),
        "files": {name: str(out / name) for name in names},
    }
    texts = (json_text(found), yaml, render(made, found, yaml=yaml))
    contents = [text.encode() for text in texts] + ([pdf_of(texts[-1])] if pdf else [])
    write_files(out, dict(zip(names, contents, strict=True)))
    if as_json:
        print(texts[0], end="")
    elif not quiet:
        _show(found, out)
    return 0 if found["passed"] else 1


def _bar(within: str, bins: str) -> "TwinBar":
    from dechirp.config.quantities import quantity
    from dechirp.core.errors import InvalidSetting
    from dechirp.experiment.twin.twin import TwinBar

    power = quantity(within, None, setting="--within")
    if power <= 1:
        raise InvalidSetting(
            "--within", got=within, need="a ratio above 1 (0 dB)", fix="Write 1 dB."
        )
    try:
        cells = float(bins)
    except ValueError:
        cells = 0.0
    if not 0 < cells < 1.5:
        raise InvalidSetting(
            "--bins",
            got=bins,
            need="a number of cells above 0 and below 1.5: beyond, it is another peak",
            fix="Write 0.2.",
        )
    return TwinBar(power=power, cells=cells)


def _show(found: Mapping[str, Any], out: Path) -> None:
    from dechirp.cli.show import console, findings, table
    from dechirp.core.findings import Finding
    from dechirp.core.words import fixed
    from dechirp.report.twin import headline, verdict

    screen = console()
    right = [
        "range, m",
        "velocity, m/s",
        "over noise, dB",
        "power, dB",
        "range, bins",
        "vel., bins",
    ]
    shown = table(headline(found), right=right, left=[])
    judged = [one for one in found["differences"] if one["judged"]]
    for one in judged[:_MOST_ROWS]:
        shown.add_row(
            fixed(one["range_m"], 3),
            fixed(one["velocity_m_per_s"], 3),
            fixed(one["snr_db"], 1),
            fixed(one["power_difference_db"], 2, sign=True),
            fixed(one["range_difference_bins"], 3, sign=True),
            fixed(one["velocity_difference_bins"], 3, sign=True),
        )
    screen.print(shown)
    if len(judged) > _MOST_ROWS:
        screen.print(f"{len(judged) - _MOST_ROWS} more are in the report.")
    screen.print(verdict(found))
    for paragraph in findings(Finding(**one) for one in found["findings"]):
        screen.print(paragraph)
    screen.print(f"Report: {out / 'report.html'}", soft_wrap=True)


_MOST_ROWS = 20

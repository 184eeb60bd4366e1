"""`dechirp run`: a scenario or a recording in, detections and a report out."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from dechirp.cli.options import NOTHING_TOLD, Json, Pdf, Quiet, Told

if TYPE_CHECKING:
    from dechirp.experiment.run import Result


def run(
    source: Path | None = None,
    /,
    *,
    out: Path = Path("dechirp-run"),
    objects: list[Path] | None = None,
    follow: Annotated[bool, Parameter(show_default=False)] = False,
    idle: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    pdf: Pdf = False,
    as_json: Json = False,
    quiet: Quiet = False,
    seed: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    changes: Annotated[list[str] | None, Parameter(name="--set")] = None,
    told: Told = NOTHING_TOLD,
) -> int:
    """Simulate a scenario or read a recording, detect, and write a report.

    Parameters
    ----------
    source
        Scenario (YAML), recording (file or folder), or UDP address to which a DCA1000 sends, as
        udp://127.0.0.1:4098; the reference scenario without it.
    out
        Folder for the results. Earlier results in it are replaced as a whole.
    objects
        File for the object list, tracks if there are any, else clusters or detections: .blf, .asc,
        .log (CAN FD), .osi, .pcd, .ply, .csv or .parquet; may be repeated.
    follow
        Go on with the frames that come while the recording, a DCA1000 .bin, is written: until
        Ctrl-C or SIGTERM, or nothing came for --idle.
    idle
        Time without anything new after which a file or address is done, as 5s; 10 s without it.
    seed
        Seed of the noise, in place of the scenario's.
    changes
        PATH=VALUE changes a setting, as radar.frame.n_chirps=64; may be repeated.
    """
    from dechirp.cli.followed import followed, is_stream
    from dechirp.cli.show import progress
    from dechirp.cli.sources import scenario_of
    from dechirp.core.errors import DechirpError
    from dechirp.experiment.run import run as run_scenario
    from dechirp.report.pdf import check_pdf
    from dechirp.store.results import check_out

    check_out(out)
    if pdf:
        check_pdf()
    _check_objects(objects or ())
    scenario = scenario_of(
        source,
        changes=changes or [],
        radar=told.radar,
        frames=told.frames,
        seed=seed,
        told=told.of_file(),
    )
    if is_stream(scenario, follow=follow, idle=idle):
        result = followed(scenario, idle=idle, quiet=quiet)
    else:
        with progress("steps", quiet=quiet) as report:
            result = run_scenario(scenario, progress=report)
    if objects:
        try:
            result = _tell_others(result, objects)
        except DechirpError:  # a disk that is full: the run is not lost
            write(result, source=source, out=out, objects=(), with_pdf=pdf)
            raise
    document = write(result, source=source, out=out, objects=objects or (), with_pdf=pdf)
    if as_json:
        print(document, end="")
    elif not quiet:
        show(result, out, objects or ())
    return 0


def _check_objects(files: Sequence[Path]) -> None:
    """Raise `DechirpError` if an object list cannot be written to one of them."""
    from dechirp.cli.wrong import under_option
    from dechirp.core.errors import DechirpError
    from dechirp.objects.files import check_path

    for file in files:
        try:
            check_path(file)
        except DechirpError as error:
            raise under_option(error, dict.fromkeys(("path", "objects"), "--objects")) from None


def _tell_others(result: "Result", files: Sequence[Path]) -> "Result":
    """Write the object list to each file; the result with what was said of it."""
    from dechirp.core.findings import heard
    from dechirp.experiment.run import object_list_of
    from dechirp.objects.files import write_objects

    with heard() as said:
        made = object_list_of(result)
        for file in files:
            write_objects(made, file)
    return replace(result, findings=(*result.findings, *said))


def write(
    result: "Result",
    *,
    source: Path | None,
    out: Path,
    objects: Sequence[Path],
    with_pdf: bool = False,
) -> str:
    """Write the results, and give the JSON document that is one of them."""
    from dechirp.cli.document import document
    from dechirp.config.texts import dump
    from dechirp.formats.recording import Recording
    from dechirp.report.page import render
    from dechirp.report.pdf import pdf_of
    from dechirp.store.results import files_in, write_results
    from dechirp.store.tables import json_text

    started = perf_counter()
    simulated = result.scenario.scene is not None
    yaml = dump(result.scenario, without=() if simulated else ("n_frames", "impairments"))
    page = render(result, yaml=yaml)
    printed = pdf_of(page) if with_pdf else None
    timing_s = {**result.timing_s, "report": perf_counter() - started}
    others = {"ego": result.ego, "clusters": result.clusters, "tracks": result.tracks}
    there = {name: table for name, table in others.items() if table is not None}
    files = files_in(out, there, has_pdf=with_pdf) | {file.name: file for file in objects}
    made = document(result, source=source, files=files, timing_s=timing_s)
    texts = {"report.html": page, "scenario.yaml": yaml, "run.json": json_text(made)}
    made_by = result.source.contents if isinstance(result.source, Recording) else None
    write_results(
        out,
        texts,
        frames=result.frames(),
        n_frames=result.n_kept,
        radar=result.radar,
        detections=result.detections,
        truth=result.truth,
        others=there,
        pdf=printed,
        device=made_by.device if made_by else None,
        iq=made_by.iq if made_by else None,
    )
    return texts["run.json"]


def show(result: "Result", out: Path, objects: Sequence[Path]) -> None:
    """Show the results on standard output, and where they are."""
    from dechirp.cli.detected import detected, followed, missed
    from dechirp.cli.show import console, findings

    screen = console()
    screen.print(detected(result, at_most=20, width=screen.width))
    for part in followed(result, at_most=20, width=screen.width):
        screen.print(part)
    for line in missed(result):
        screen.print(line)
    for paragraph in findings(result.findings):
        screen.print(paragraph)
    for file in objects:
        screen.print(f"Object list: {file}", soft_wrap=True)
    screen.print(f"Report: {out / 'report.html'}", soft_wrap=True)

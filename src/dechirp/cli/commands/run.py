"""`dechirp run`: detections and a report from a scenario, a recording or a traffic file."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from dechirp.cli.options import NO_OPTIONS, IntegerText, Json, Pdf, Quiet, RecordingOptions

if TYPE_CHECKING:
    import xarray as xr

    from dechirp.core.findings import Finding
    from dechirp.experiments.run import Result
    from dechirp.experiments.run_radars import Kind
    from dechirp.experiments.scenario import Scenario


def run(
    source: Path | None = None,
    /,
    *,
    out: Path = Path("dechirp-run"),
    objects: list[Path] | None = None,
    dbc: Path | None = None,
    mapping: str | None = None,
    follow: Annotated[bool, Parameter(show_default=False)] = False,
    idle: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    vital_signs: Annotated[bool, Parameter(show_default=False)] = False,
    pdf: Pdf = False,
    as_json: Json = False,
    quiet: Quiet = False,
    ego: IntegerText = None,
    mount: list[str] | None = None,
    statistical: Annotated[bool, Parameter(show_default=False)] = False,
    seed: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    changes: Annotated[list[str] | None, Parameter(name="--set")] = None,
    options: RecordingOptions = NO_OPTIONS,
) -> int:
    """Simulate a scenario or traffic, or read a recording; detect, and write a report.

    Parameters
    ----------
    source
        Scenario (YAML), recording (file or folder), traffic file (ASAM OSI, CommonRoad, CSV of
        trajectories), or UDP address that receives the packets of a DCA1000, such as
        udp://127.0.0.1:4098; the reference scenario by default.
    out
        Folder for the results. Existing results in it are replaced as a whole.
    objects
        File for the object list (tracks if available, else clusters or detections; of several
        radars, fused tracks in the axes of the vehicle): .blf, .asc, .log (CAN FD), .osi, .pcd,
        .ply, .csv or .parquet; may be repeated.
    dbc
        DBC that codes the objects in CAN logs; the one of the package by default.
    mapping
        Signals of a vendor's DBC: toyota-adas, delphi-esr or a YAML file.
    follow
        Continue with new frames while the recording, a DCA1000 .bin, is being written, until
        Ctrl-C, SIGTERM or the time --idle without data.
    idle
        Time without new data after which a file or address ends, such as 5s; 10 s by default.
    vital_signs
        Measure breathing and heart rate from the phase of the range cells up to 3 m. Also takes
        a slow-time file without chirps (CSV, HDF5 of Acconeer), and then prints the rates only.
    ego
        Vehicle of a traffic file that carries the radar, by its id; the host of the file by
        default.
    mount
        Place of the radar on that vehicle: front, front-left, left, rear-left, rear, rear-right,
        right or front-right; front by default. May be repeated: then each place has a radar.
    statistical
        In traffic, draw detections from their distribution instead of simulating samples.
    seed
        Seed of the noise; replaces the seed of the scenario.
    changes
        PATH=VALUE changes a setting, such as radar.frame.n_chirps=64; may be repeated.
    """
    from dechirp.cli.xarray_import import import_xarray_without_dask

    import_xarray_without_dask()
    from dechirp.cli.console import progress_bar
    from dechirp.cli.object_files import check_object_files_writable
    from dechirp.cli.run_document import write_run_results
    from dechirp.cli.scenario_source import build_scenario
    from dechirp.cli.several_radars import refuse_options_of_single_radars, run_several_radars
    from dechirp.cli.stream import is_live_source, process_live_frames
    from dechirp.core.compiled_kernels import plain_twins_for_small_work
    from dechirp.core.errors import DechirpError, RecordingError
    from dechirp.experiments.run import run as run_scenario

    if vital_signs and source is not None and (trace := _read_slow_time(source, is_requested=True)):
        return _print_vital_signs_of_trace(*trace, as_json=as_json, quiet=quiet)
    _check_results_writable(out, pdf=pdf)
    coding = {"dbc": dbc, "mapping": mapping}
    check_object_files_writable(objects or (), coding)
    scenario = build_scenario(
        source,
        changes=changes or [],
        radar=options.radar,
        frames=options.frames,
        seed=seed,
        metadata=options.given_metadata(),
        traffic={} if ego is None else {"ego": ego},
        mounts=mount or (),
    )
    kind = _choose_kind(scenario, is_statistical=statistical)
    if scenario.radars:
        given = {
            "--vital-signs": vital_signs,
            "--follow": follow,
            "--idle": idle,
            "--pdf": pdf,
        }
        refuse_options_of_single_radars([name for name, value in given.items() if value])
        return run_several_radars(
            scenario,
            kind,
            source=source,
            out=out,
            objects=objects or (),
            coding=coding,
            as_json=as_json,
            quiet=quiet,
        )
    with plain_twins_for_small_work(scenario.n_simulated_samples):
        is_live = is_live_source(scenario, follow=follow, idle=idle)
        _check_samples_are_kept(is_live=is_live, vital_signs=vital_signs)
        if is_live:
            result = process_live_frames(scenario, idle=idle, quiet=quiet)
        else:
            try:
                with progress_bar("steps", quiet=quiet) as report:
                    result = run_scenario(scenario, kind=kind, progress=report)
            except RecordingError:
                if source is None or vital_signs or (trace := _read_slow_time(source)) is None:
                    raise
                values, file, findings = trace
                findings = [_chosen_vital_signs_note(file, source), *findings]
                return _print_vital_signs_of_trace(
                    values, file, findings, as_json=as_json, quiet=quiet
                )
        if vital_signs:
            result = _add_vital_signs(result)
        if objects:
            try:
                result = _write_object_lists_and_add_findings(result, objects, coding)
            except DechirpError:  # a full disk: keep the results of the run
                write_run_results(result, source=source, out=out, objects=(), with_pdf=pdf)
                raise
        document = write_run_results(
            result, source=source, out=out, objects=objects or (), with_pdf=pdf
        )
    if as_json:
        print(document, end="")
    elif not quiet:
        print_run_results(result, out, objects or ())
    return 0


def _choose_kind(scenario: "Scenario", *, is_statistical: bool) -> "Kind":
    """Return the kind of detections; raise `InvalidSetting` for --statistical without traffic."""
    from dechirp.core.errors import InvalidSetting

    if is_statistical and scenario.traffic is None:
        raise InvalidSetting(
            "--statistical",
            value="given without traffic",
            expected="a traffic file, or a scenario with traffic",
            fix="leave it out",
        )
    return "statistical" if is_statistical else "samples"


def _check_samples_are_kept(*, is_live: bool, vital_signs: bool) -> None:
    """Raise `InvalidSetting` for vital signs of a stream."""
    from dechirp.core.errors import InvalidSetting

    if is_live and vital_signs:
        raise InvalidSetting(
            "--vital-signs",
            value="given for a stream, whose samples are not kept",
            expected="a recording or a scenario",
            fix="record the stream, then run the file with --vital-signs",
        )


def _read_slow_time(
    source: Path, *, is_requested: bool = False
) -> "tuple[xr.DataArray, Path, list[Finding]] | None":
    """Return the trace of a file without chirps, the file and findings; None of another file.

    Of a folder, the first such file. If the rates are requested, raise the error of a CSV file:
    it is no recording with chirps.
    """
    from dechirp.core.errors import RecordingError
    from dechirp.core.findings import capture_warned_findings
    from dechirp.recordings.slow_time_files import read_slow_time

    for file in _slow_time_files(source):
        try:
            with capture_warned_findings() as findings:
                trace = read_slow_time(file)
            return trace, file, findings
        except RecordingError:
            if is_requested and file == source and file.suffix.lower() == ".csv":
                raise
    return None


def _slow_time_files(source: Path) -> list[Path]:
    """Return the files of a folder, or the file itself, that may contain values over time."""
    try:
        files = sorted(source.iterdir()) if source.is_dir() else [source]
        return [
            file
            for file in files
            if file.is_file() and file.suffix.lower() in {".csv", ".h5", ".hdf5"}
        ]
    except OSError:  # such as a name that is too long: opening as a recording reports it
        return []


def _chosen_vital_signs_note(file: Path, source: Path) -> "Finding":
    from dechirp.core.findings import Finding
    from dechirp.core.text import join_names

    others = [other.name for other in _slow_time_files(source) if other != file]
    return Finding(
        level="note",
        setting="--vital-signs",
        value=f"chosen because {file.name} contains I/Q values of range cells over time, without"
        " chirps",
        expected="chirps, for ranges and velocities",
        fix="no action needed for breathing and heart rate"
        + (f"; give the path of another file to read that: {join_names(others)}" if others else ""),
    )


def _print_vital_signs_of_trace(
    trace: "xr.DataArray",
    source: Path,
    findings: "list[Finding]",
    *,
    as_json: bool,
    quiet: bool,
) -> int:
    from dechirp.cli.console import finding_paragraphs, open_stdout_console
    from dechirp.cli.run_document import vital_sign_records
    from dechirp.cli.run_output import vital_signs_table
    from dechirp.processing.vital_signs import measure_vital_signs
    from dechirp.results.text_files import to_json_text

    times_s = trace.coords["time"]  # some sensors count from their start
    vital = measure_vital_signs(trace.assign_coords(time=times_s - times_s[0]))
    if as_json:
        document = {"source": str(source), "vital_signs": vital_sign_records(vital)}
        print(to_json_text(document), end="")
    elif not quiet:
        screen = open_stdout_console()
        screen.print(vital_signs_table(vital))
        for paragraph in finding_paragraphs(findings):
            screen.print(paragraph)
    return 0


def _add_vital_signs(result: "Result") -> "Result":
    """Return the result with breathing and heart rate."""
    from dechirp.cli.errors import replace_settings_by_options
    from dechirp.core.errors import DechirpError
    from dechirp.experiments.vital_signs import add_vital_signs

    try:
        return add_vital_signs(result)
    except DechirpError as error:
        raise replace_settings_by_options(
            error, dict.fromkeys(("trace", "range_m", "VitalSigns.range_m"), "--vital-signs")
        ) from None


def _check_results_writable(folder: Path, *, pdf: bool) -> None:
    """Raise `DechirpError` if results cannot be written into a folder, or no PDF file can."""
    from dechirp.report.pdf import check_pdf_available
    from dechirp.results.results import check_results_folder_replaceable

    check_results_folder_replaceable(folder)
    if pdf:
        check_pdf_available()


def _write_object_lists_and_add_findings(
    result: "Result", files: Sequence[Path], coding: Mapping[str, str | Path | None]
) -> "Result":
    """Write the object list to each file; return the result with the findings on it."""
    from dechirp.cli.object_files import write_object_files
    from dechirp.experiments.run import build_result_object_list

    findings = write_object_files(lambda: build_result_object_list(result), files, coding)
    return replace(result, findings=(*result.findings, *findings))


def print_run_results(result: "Result", out: Path, objects: Sequence[Path]) -> None:
    """Print the results on standard output, with the paths of the files."""
    from dechirp.cli.console import open_stdout_console, short_finding_paragraphs
    from dechirp.cli.run_output import (
        missed_target_lines,
        strongest_detections_table,
        track_table_and_object_sentences,
        vital_signs_table,
    )
    from dechirp.report.traffic_section import describe_traffic_scores

    screen = open_stdout_console()
    screen.print(strongest_detections_table(result, at_most=20, width=screen.width))
    for part in track_table_and_object_sentences(result, at_most=20, width=screen.width):
        screen.print(part)
    if result.vital_signs is not None:
        screen.print(vital_signs_table(result.vital_signs))
    for line in (*describe_traffic_scores(result), *missed_target_lines(result)):
        screen.print(line)
    for paragraph in short_finding_paragraphs(result.findings, report=out / "report.html"):
        screen.print(paragraph)
    for file in objects:
        screen.print(f"Object list: {file}")
    screen.print(f"Report: {out / 'report.html'}")

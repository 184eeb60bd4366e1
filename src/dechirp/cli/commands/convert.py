"""`dechirp convert`: export of a recording, a run or a simulated scene to another format."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from dechirp.cli.options import NO_OPTIONS, Json, Quiet, RecordingOptions

if TYPE_CHECKING:
    from dechirp.core.findings import Finding
    from dechirp.experiments.scenario import Scenario
    from dechirp.recordings.recording import Recording
    from dechirp.recordings.writers.base import Writer

_TABLES = ("detections", "truth", "ego", "clusters", "tracks")
_OPTION_BY_SETTING = {"--out": "OUT", "path": "OUT"}


def convert(
    source: Annotated[Path, Parameter(name="IN")],
    out: Annotated[Path, Parameter(name="OUT")],
    /,
    *,
    to: str | None = None,
    replace: Annotated[bool, Parameter(show_default=False)] = False,
    as_json: Json = False,
    quiet: Quiet = False,
    options: RecordingOptions = NO_OPTIONS,
) -> int:
    """Write a recording, a run or a simulated scene in the format of another tool.

    Parameters
    ----------
    source
        Recording (file or folder), result folder of dechirp run, or scenario (YAML), which is
        simulated and written with its truth; for .mcap and .ros2 it is also processed.
    out
        File or folder to write; its suffix selects the format: .h5, .hdf5, .nc, .nc4, .mat, .npz,
        .sigmf-meta, .sigmf-data, .zarr, .bin (DCA1000), .mcap, .ros2 or .csv (maps).
    to
        Kind of the format, if the suffix of OUT does not determine it.
    replace
        Replace an existing OUT.
    """
    from dechirp.cli.console import progress_bar
    from dechirp.cli.errors import replace_settings_by_options
    from dechirp.core.errors import DechirpError
    from dechirp.recordings.convert import find_writer, write
    from dechirp.recordings.frame_subset import renumber_frames_from_zero
    from dechirp.recordings.recording import open as open_recording

    try:
        writer = find_writer(out, to)
        _check_separate_paths(source, out)
        recording, findings = _open_or_simulate_source(source, options, writer, quiet=quiet)
        _check_files_not_existing(
            writer.output_files(renumber_frames_from_zero(recording), out), may_replace=replace
        )
        with progress_bar("frames", quiet=quiet) as report:
            paths = write(recording, out, format=to, progress=report)
    except DechirpError as error:
        raise replace_settings_by_options(error, _OPTION_BY_SETTING) from None
    if writer.is_readable:
        # The written file may have findings of its own, such as rounding.
        findings = (
            *findings,
            *(finding for finding in open_recording(paths[0]).findings if finding not in findings),
        )
    _print_written_files(paths, writer, recording, findings, as_json=as_json, quiet=quiet)
    return 0


def _check_separate_paths(source: Path, out: Path) -> None:
    """Raise `InvalidFile` if writing OUT would change IN."""
    from dechirp.core.errors import InvalidFile, Mistake

    source_path, out_path = source.resolve(), out.resolve()
    if (
        source_path == out_path
        or source_path in out_path.parents
        or out_path in source_path.parents
    ):
        relation = (
            "IN itself"
            if source_path == out_path
            else "in IN"
            if source_path in out_path.parents
            else "around IN"
        )
        raise InvalidFile(
            Mistake(
                setting="OUT",
                value=f"{out}, {relation}",
                expected="a path outside IN, which must not change",
                fix="choose another path",
            )
        )


def _check_files_not_existing(files: Sequence[Path], *, may_replace: bool) -> None:
    from dechirp.core.errors import InvalidFile, Mistake

    existing = [file for file in files if file.exists() or file.is_symlink()]
    if existing and not may_replace:
        more = f" and {len(existing) - 1} more" if len(existing) > 1 else ""
        raise InvalidFile(
            Mistake(
                setting="OUT",
                value=f"{existing[0]}{more}, which already exist{'' if more else 's'}",
                expected="a new name",
                fix="choose another name, or add --replace",
            )
        )


def _open_or_simulate_source(
    source: Path, options: RecordingOptions, writer: "Writer", *, quiet: bool
) -> "tuple[Recording, Sequence[Finding]]":
    """Open the recording or simulate the scene; return the recording and its findings."""
    from dechirp.cli.scenario_source import build_scenario
    from dechirp.experiments.recording_stage import open_scenario_recording
    from dechirp.recordings.recording import open as open_recording

    if source.suffix.lower() not in (".yaml", ".yml"):
        recording = open_recording(source, **options.open_keyword_arguments())
        return recording, recording.findings
    scenario = build_scenario(
        source,
        changes=[],
        radar=options.radar,
        frames=options.frames,
        seed=None,
        metadata=options.given_metadata(),
    )
    if scenario.recording is not None:
        recording = open_scenario_recording(scenario)
        return recording, recording.findings
    return _simulate_recording(scenario, writer, quiet=quiet)


def _simulate_recording(
    scenario: "Scenario", writer: "Writer", *, quiet: bool
) -> "tuple[Recording, Sequence[Finding]]":
    """Simulate a scene with its truth, and process it if the format stores detections."""
    from dechirp.cli.console import progress_bar
    from dechirp.experiments.run import run, simulate_cube_truth_and_findings
    from dechirp.recordings.in_memory import recording_from_cube

    assert scenario.radar is not None
    if writer.holds_detections:
        with progress_bar("steps", quiet=quiet) as report:
            result = run(scenario, progress=report)
        cube, findings = result.cube, result.findings
        results = {name: getattr(result, name) for name in _TABLES}
        tables = {name: table for name, table in results.items() if table is not None}
    else:
        with progress_bar("frames simulated", quiet=quiet) as report:
            cube, truth, findings = simulate_cube_truth_and_findings(scenario, progress=report)
        tables = {"truth": truth}
    return recording_from_cube(cube, scenario.radar, tables=tables, name=scenario.name), findings


def _print_written_files(
    paths: Sequence[Path],
    writer: "Writer",
    recording: "Recording",
    shown_findings: "Sequence[Finding]",
    *,
    as_json: bool,
    quiet: bool,
) -> None:
    from dechirp.cli.console import finding_paragraphs, open_stdout_console
    from dechirp.config.dumping import to_json_data
    from dechirp.results.text_files import to_json_text

    if as_json:
        document = {
            "written": [str(path) for path in paths],
            "format": writer.kind(),
            "frames": recording.n_frames,
            "findings": [to_json_data(finding) for finding in shown_findings],
        }
        print(to_json_text(document), end="")
        return
    if quiet:
        return
    screen = open_stdout_console()
    for paragraph in finding_paragraphs(shown_findings):
        screen.print(paragraph)
    more = f" and {len(paths) - 1} more" if len(paths) > 6 else ""
    for path in paths[:1] if more else paths:
        screen.print(f"Written: {path}{more}")
    n_frames = recording.n_frames
    screen.print(f"{n_frames} frame{'s' if n_frames > 1 else ''}; kept: {writer.summary}")

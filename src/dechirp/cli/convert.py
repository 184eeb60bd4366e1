"""`dechirp convert`: a recording, a run or a simulated scene, in the format of another tool."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from dechirp.cli.options import NOTHING_TOLD, Json, Quiet, Told

if TYPE_CHECKING:
    from dechirp.core.findings import Finding
    from dechirp.exchange.writers.base import Writer
    from dechirp.experiment.scenario import Scenario
    from dechirp.formats.recording import Recording

_TABLES = ("detections", "truth", "ego", "clusters", "tracks")
_OPTIONS = {"--out": "OUT", "path": "OUT"}


def convert(
    source: Annotated[Path, Parameter(name="IN")],
    out: Annotated[Path, Parameter(name="OUT")],
    /,
    *,
    to: str | None = None,
    replace: Annotated[bool, Parameter(show_default=False)] = False,
    as_json: Json = False,
    quiet: Quiet = False,
    told: Told = NOTHING_TOLD,
) -> int:
    """Write a recording, a run or a simulated scene in the format of another tool.

    Parameters
    ----------
    source
        Recording (file or folder), folder of dechirp run with its tables, or scenario (YAML),
        whose scene is simulated and written with its truth; for .mcap and .ros2 run, too.
    out
        What is to be written; its ending says the format: .h5, .hdf5, .nc, .nc4, .mat, .npz,
        .sigmf-meta, .sigmf-data, .zarr, .bin (DCA1000), .mcap, .ros2, .png or .csv (maps).
    to
        Kind of the format, where the ending of OUT does not say it.
    replace
        Replace an OUT that is there.
    """
    from dechirp.cli.show import progress
    from dechirp.cli.wrong import under_option
    from dechirp.core.errors import DechirpError
    from dechirp.exchange.convert import write, writer_of
    from dechirp.exchange.part import counted_from_0
    from dechirp.formats.recording import open as open_recording

    try:
        writer = writer_of(out, to)
        _must_be_apart(source, out)
        recording, said = _opened(source, told, writer, quiet=quiet)
        _must_be_free(writer.files(counted_from_0(recording), out), may_replace=replace)
        with progress("frames", quiet=quiet) as report:
            written = write(recording, out, format=to, progress=report)
    except DechirpError as error:
        raise under_option(error, _OPTIONS) from None
    if writer.is_read:  # what it says of itself, as what was rounded
        said = (*said, *(one for one in open_recording(written[0]).findings if one not in said))
    _tell(written, writer, recording, said, as_json=as_json, quiet=quiet)
    return 0


def _must_be_apart(source: Path, out: Path) -> None:
    """Raise `InvalidFile` where writing OUT would change IN."""
    from dechirp.core.errors import InvalidFile, Mistake

    here, there = source.resolve(), out.resolve()
    if here == there or here in there.parents or there in here.parents:
        what = "IN itself" if here == there else "in IN" if here in there.parents else "around IN"
        raise InvalidFile(
            Mistake(
                setting="OUT",
                got=f"{out}, {what}",
                need="apart from IN, which is not changed",
                fix="Name another place.",
            )
        )


def _must_be_free(files: Sequence[Path], *, may_replace: bool) -> None:
    from dechirp.core.errors import InvalidFile, Mistake

    there = [file for file in files if file.exists() or file.is_symlink()]
    if there and not may_replace:
        more = f" and {len(there) - 1} more" if len(there) > 1 else ""
        raise InvalidFile(
            Mistake(
                setting="OUT",
                got=f"{there[0]}{more}, already there",
                need="a new name",
                fix="Give another one, or say --replace.",
            )
        )


def _opened(
    source: Path, told: Told, writer: "Writer", *, quiet: bool
) -> "tuple[Recording, Sequence[Finding]]":
    """Recording that is meant, or that is made of a scene, and what is to be said of it."""
    from dechirp.cli.sources import scenario_of
    from dechirp.experiment.run import opened_recording
    from dechirp.formats.recording import open as open_recording

    if source.suffix.lower() not in (".yaml", ".yml"):
        recording = open_recording(source, **told.given())
        return recording, recording.findings
    scenario = scenario_of(
        source,
        changes=[],
        radar=told.radar,
        frames=told.frames,
        seed=None,
        told=told.of_file(),
    )
    if scenario.recording is not None:
        recording = opened_recording(scenario)
        return recording, recording.findings
    return _simulated(scenario, writer, quiet=quiet)


def _simulated(
    scenario: "Scenario", writer: "Writer", *, quiet: bool
) -> "tuple[Recording, Sequence[Finding]]":
    """Samples of a scene with its truth; with all that `run` finds where that is written."""
    from dechirp.cli.show import progress
    from dechirp.exchange.in_memory import recording_of
    from dechirp.experiment.run import run, simulated

    assert scenario.radar is not None
    if writer.of_detections:
        with progress("steps", quiet=quiet) as report:
            result = run(scenario, progress=report)
        cube, said = result.cube, result.findings
        every = {name: getattr(result, name) for name in _TABLES}
        tables = {name: table for name, table in every.items() if table is not None}
    else:
        with progress("frames simulated", quiet=quiet) as report:
            cube, truth, said = simulated(scenario, progress=report)
        tables = {"truth": truth}
    return recording_of(cube, scenario.radar, tables=tables, name=scenario.name), said


def _tell(
    written: Sequence[Path],
    writer: "Writer",
    recording: "Recording",
    said: "Sequence[Finding]",
    *,
    as_json: bool,
    quiet: bool,
) -> None:
    from dechirp.cli.show import console, findings
    from dechirp.config.texts import plain
    from dechirp.store.tables import json_text

    if as_json:
        document = {
            "written": [str(path) for path in written],
            "format": writer.kind(),
            "frames": recording.n_frames,
            "findings": [plain(finding) for finding in said],
        }
        print(json_text(document), end="")
        return
    if quiet:
        return
    screen = console()
    for paragraph in findings(said):
        screen.print(paragraph)
    more = f" and {len(written) - 1} more" if len(written) > 6 else ""
    for path in written[:1] if more else written:
        screen.print(f"Written: {path}{more}", soft_wrap=True)
    n_frames = recording.n_frames
    screen.print(f"{n_frames} frame{'s' if n_frames > 1 else ''}; kept: {writer.keeps}")

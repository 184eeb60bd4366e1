"""`dechirp inspect`: what a recording is, and what is wrong with it."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from dechirp.cli.options import NOTHING_TOLD, Json, Quiet, Told

if TYPE_CHECKING:
    from dechirp.experiment.inspection import Inspection


def inspect(
    source: Path,
    /,
    *,
    out: Path = Path("dechirp-inspect"),
    as_json: Json = False,
    quiet: Quiet = False,
    told: Told = NOTHING_TOLD,
) -> int:
    """Say what a recording is, what its radar can see, and what is wrong with it.

    Ends with status 0 if the file is known, also where something is missing to read it.

    Parameters
    ----------
    source
        Recording: a file or a folder.
    out
        Folder for map.png and inspect.json. Earlier ones in it are replaced.
    """
    from dechirp.cli.show import progress
    from dechirp.experiment.inspection import inspect as inspect_recording
    from dechirp.store.tables import json_text
    from dechirp.store.texts import check_out, write_files

    names = ("inspect.json", "map.png")
    check_out(out, names)
    with progress("frames", quiet=quiet) as report:
        seen = inspect_recording(source, progress=report, **told.given())
    picture = _picture(seen)
    written = names if picture is not None else names[:1]
    document = json_text(_document(seen, {name: out / name for name in written}))
    contents = {"inspect.json": document.encode()}
    if picture is not None:
        contents["map.png"] = picture
    write_files(out, contents)
    if as_json:
        print(document, end="")
    elif not quiet:
        _show(seen, out / names[1] if picture is not None else None)
    return 0


def _picture(seen: "Inspection") -> bytes | None:
    from dechirp.report.figures.recorded import first_map, points_from_above
    from dechirp.report.figures.style import TALL_IN, png

    recording = seen.recording
    if recording is None:
        return None
    name = recording.path.name
    power, points, units = seen.power, recording.points, recording.contents.units
    if power is not None:
        return png(
            lambda figure: first_map(figure.subplots(), power, units=units),
            title=f"{name}, frame {recording.frame_numbers.start}",
            height_in=TALL_IN,
        )
    if points is None or not points.sizes["detection"]:
        return None
    return png(
        lambda figure: points_from_above(figure.subplots(), points),
        title=f"{name}, {recording.n_frames} frames, seen from above",
        height_in=4.2,
    )


def _document(seen: "Inspection", files: dict[str, Path]) -> dict[str, Any]:
    from dechirp.cli.document import radar_document
    from dechirp.config.texts import plain

    recording = seen.recording
    known = None if recording is None else recording.contents.radar
    return {
        "source": str(seen.path),
        "format": seen.formats[0] if len(seen.formats) == 1 else None,
        "possible_formats": list(seen.formats),
        "dims": None if recording is None else _sizes(seen),
        "radar": None if known is None else radar_document(known),
        "findings": [plain(finding) for finding in seen.findings],
        "files": {name: str(path) for name, path in files.items()},
    }


def _sizes(seen: "Inspection") -> dict[str, int]:
    """Of the cube, else numbers of frames and of detections."""
    recording = seen.recording
    assert recording is not None
    if recording.sizes or recording.points is None:
        return recording.sizes
    return {"frame": recording.n_frames, "detection": recording.points.sizes["detection"]}


def _show(seen: "Inspection", picture: Path | None) -> None:
    from dechirp.cli.show import console, findings, table
    from dechirp.report.summary import waveform_and_limits

    screen = console()
    screen.print(str(seen.path), soft_wrap=True)
    made = table("", left=["", ""])
    made.show_header, made.title = False, None
    made.add_row("format", " or ".join(seen.formats))
    if seen.recording is not None:
        sizes = _sizes(seen)
        made.add_row(" x ".join(sizes), " x ".join(str(size) for size in sizes.values()))
        if seen.recording.contents.radar is not None:
            for name, text in waveform_and_limits(seen.recording.radar):
                made.add_row(name, text)
    screen.print(made)
    for paragraph in findings(seen.findings):
        screen.print(paragraph)
    if not seen.findings:
        screen.print("Nothing wrong was found.")
    if picture is not None:
        screen.print(f"Picture: {picture}", soft_wrap=True)

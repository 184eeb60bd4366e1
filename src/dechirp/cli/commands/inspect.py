"""`dechirp inspect`: contents, settings and faults of a recording."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dechirp.cli.options import NO_OPTIONS, Json, Quiet, RecordingOptions

if TYPE_CHECKING:
    from dechirp.experiments.inspection import Inspection


def inspect(
    source: Path,
    /,
    *,
    out: Path = Path("dechirp-inspect"),
    as_json: Json = False,
    quiet: Quiet = False,
    options: RecordingOptions = NO_OPTIONS,
) -> int:
    """Describe a recording, the limits of its radar and its faults.

    The exit status is 0 if its samples or points can be read, with warnings too; 1 if its format is
    known but it cannot be read as given, because it is damaged or settings are missing; 2 if it is
    no recording. For mistakes of a program that made samples, a profile or a map, see dechirp
    diagnose.

    Parameters
    ----------
    source
        Recording: a file or a folder.
    out
        Folder for map.png and inspect.json. Existing ones are replaced.
    """
    from dechirp.cli.console import progress_bar
    from dechirp.experiments.inspection import inspect as inspect_recording
    from dechirp.results.text_files import (
        check_folder_replaceable,
        to_json_text,
        write_files_into_folder,
    )

    names = ("inspect.json", "map.png")
    check_folder_replaceable(out, names)
    with progress_bar("frames", quiet=quiet) as on_progress:
        inspection = inspect_recording(
            source, progress=on_progress, **options.open_keyword_arguments()
        )
    picture = _render_map_or_points_png(inspection)
    file_names = names if picture is not None else names[:1]
    document = to_json_text(
        _inspection_json_document(inspection, {name: out / name for name in file_names})
    )
    contents = {"inspect.json": document.encode()}
    if picture is not None:
        contents["map.png"] = picture
    write_files_into_folder(out, contents)
    if as_json:
        print(document, end="")
    elif not quiet:
        _print_inspection(inspection, out / names[1] if picture is not None else None)
    is_unreadable = inspection.recording is None
    if is_unreadable and quiet:
        for finding in inspection.findings:
            print(f"error: {finding}", file=sys.stderr)
    return int(is_unreadable)


def _render_map_or_points_png(inspection: "Inspection") -> bytes | None:
    from dechirp.report.figures.recording import draw_map_or_range_profile, draw_points_from_above
    from dechirp.report.figures.style import TALL_IN, render_png

    recording = inspection.recording
    if recording is None:
        return None
    name = recording.path.name
    power, points, units = inspection.power, recording.points, recording.contents.units
    if power is not None:
        return render_png(
            lambda figure: draw_map_or_range_profile(figure.subplots(), power, units=units),
            title=f"{name}, frame {recording.frame_numbers.start}",
            height_in=TALL_IN,
        )
    if points is None or not points.sizes["detection"]:
        return None
    return render_png(
        lambda figure: draw_points_from_above(figure.subplots(), points),
        title=f"{name}, {recording.n_frames} frames, top view",
        height_in=4.2,
    )


def _inspection_json_document(inspection: "Inspection", files: dict[str, Path]) -> dict[str, Any]:
    from dechirp.cli.run_document import radar_json_document
    from dechirp.config.dumping import to_json_data

    recording = inspection.recording
    radar = None if recording is None else recording.contents.radar
    return {
        "source": str(inspection.path),
        "format": inspection.formats[0] if len(inspection.formats) == 1 else None,
        "possible_formats": list(inspection.formats),
        "dims": None if recording is None else _cube_or_point_cloud_sizes(inspection),
        "radar": None if radar is None else radar_json_document(radar),
        "findings": [to_json_data(finding) for finding in inspection.findings],
        "files": {name: str(path) for name, path in files.items()},
    }


def _cube_or_point_cloud_sizes(inspection: "Inspection") -> dict[str, int]:
    """Return the dimensions of the cube, or the numbers of frames and detections without one."""
    recording = inspection.recording
    assert recording is not None
    if recording.sizes or recording.points is None:
        return recording.sizes
    return {"frame": recording.n_frames, "detection": recording.points.sizes["detection"]}


def _print_inspection(inspection: "Inspection", picture: Path | None) -> None:
    from dechirp.cli.console import finding_paragraphs, new_table, open_stdout_console
    from dechirp.report.settings_summary import format_waveform_and_limits

    screen = open_stdout_console()
    screen.print(str(inspection.path))
    rows = new_table("", text_columns=["", ""])
    rows.show_header, rows.title = False, None
    rows.add_row("format", " or ".join(inspection.formats))
    if inspection.recording is not None:
        sizes = _cube_or_point_cloud_sizes(inspection)
        if "detection" in sizes:  # of all frames together: no axes of one array
            rows.add_row("frames", f"{sizes['frame']:,}")
            rows.add_row("detections in all frames", f"{sizes['detection']:,}")
        else:
            rows.add_row(" x ".join(sizes), " x ".join(str(size) for size in sizes.values()))
        if inspection.recording.contents.radar is not None:
            for name, text in format_waveform_and_limits(inspection.recording.radar):
                rows.add_row(name, text)
    screen.print(rows)
    for paragraph in finding_paragraphs(inspection.findings):
        screen.print(paragraph)
    if not inspection.findings:
        screen.print("No faults were found.")
    if picture is not None:
        screen.print(f"Picture: {picture}")

"""Files of a run and its JSON document."""

import math
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import xarray as xr

import dechirp
from dechirp.config.dumping import to_json_data
from dechirp.core.table_columns import dataset_to_records
from dechirp.radar.radar import Radar

if TYPE_CHECKING:
    from dechirp.experiments.run import Result
    from dechirp.experiments.run_radars import RadarsResult


def run_json_document(
    result: "Result", *, source: Path | None, files: dict[str, Path], timing_s: dict[str, float]
) -> dict[str, Any]:
    """Return the results of a run without its samples, in plain values; None if not estimated."""
    from dechirp.cli.scenario_source import format_source_as_typed  # 0.3 s of imports

    return {
        "version": dechirp.__version__,
        "seed": result.scenario.seed,
        "source": "reference" if source is None else format_source_as_typed(source),
        "radar": radar_json_document(result.radar),
        "frames": result.n_frames,
        "detections": dataset_to_records(result.detections),
        **{
            name: None if table is None else dataset_to_records(table)
            for name, table in (
                ("clusters", result.clusters),
                ("tracks", result.tracks),
                ("truth", result.truth),
                *((("traffic", result.traffic),) if result.traffic is not None else ()),
            )
        },
        **(
            {}
            if result.vital_signs is None
            else {"vital_signs": vital_sign_records(result.vital_signs)}
        ),
        "findings": [to_json_data(finding) for finding in result.findings],
        "timing_s": timing_s,
        "files": {name: str(path) for name, path in files.items()},
    }


def radars_json_document(
    result: "RadarsResult", *, source: Path | None, files: dict[str, Path]
) -> dict[str, Any]:
    """Return the results of several radars together; those of each are in its own document."""
    from dechirp.cli.scenario_source import format_source_as_typed  # 0.3 s of imports

    return {
        "version": dechirp.__version__,
        "seed": result.scenario.seed,
        "source": "reference" if source is None else format_source_as_typed(source),
        "radars": {
            name: {
                "mounting": to_json_data(result.mountings[name]),
                "frames": radar.n_frames,
                "detections": radar.detections.sizes["detection"],
                "run": str(files["run.json"].parent / name / "run.json"),
            }
            for name, radar in result.radars.items()
        },
        **{
            name: None if table is None else dataset_to_records(table)
            for name, table in (("tracks", result.tracks), ("traffic", result.objects))
        },
        "findings": [to_json_data(finding) for finding in result.findings],
        "timing_s": result.timing_s,
        "files": {name: str(path) for name, path in files.items()},
    }


def vital_sign_records(vital: xr.Dataset) -> list[dict[str, float | None]]:
    """Return a mapping from quantity, with its unit, to value for each window."""
    units = {"s": "_s", "m": "_m", "Hz": "_hz", "1": ""}
    columns = {
        f"{name}{units[column.attrs['units']]}": column.values.tolist()
        for name, column in vital.variables.items()
    }
    return [
        {
            name: value if math.isfinite(value) else None
            for name, value in zip(columns, row, strict=True)
        }
        for row in zip(*columns.values(), strict=True)
    ]


def radar_json_document(radar: Radar) -> dict[str, Any]:
    """Return settings and derived values of a radar; velocities are None for a single chirp."""
    frame, chirp = radar.frame.for_frame(0), radar.frame.chirp
    has_velocity = frame.n_chirps > 1
    derived = {
        "sampled_bandwidth_hz": chirp.sampled_bandwidth_hz,
        "wavelength_m": chirp.wavelength_m,
        "range_resolution_m": chirp.range_resolution_m,
        "max_range_m": chirp.max_range_m,
        "velocity_resolution_m_per_s": frame.velocity_resolution_m_per_s if has_velocity else None,
        "max_velocity_m_per_s": frame.max_velocity_m_per_s if has_velocity else None,
        "frame_duration_s": frame.duration_s,
        "integration_gain": radar.integration_gain,
    }
    return {**to_json_data(radar), "derived": derived}


def write_run_results(
    result: "Result",
    *,
    source: Path | None,
    out: Path,
    objects: Sequence[Path],
    with_pdf: bool = False,
    shown_out: Path | None = None,
) -> str:
    """Write the results of a run and return the JSON document.

    `shown_out` is the folder in the document, if it is not yet the one that is written.
    """
    from dechirp.config.dumping import dump_yaml
    from dechirp.recordings.recording import Recording
    from dechirp.report.page import render_report
    from dechirp.report.pdf import html_to_pdf
    from dechirp.results.results import result_paths_by_name, write_results
    from dechirp.results.text_files import to_json_text

    started = perf_counter()
    omitted: tuple[str, ...] = ()
    if result.scenario.recording is not None:
        omitted = ("n_frames", "impairments")
    elif result.scenario.traffic is not None:
        omitted = ("n_frames",)
    yaml = dump_yaml(result.scenario, omitted_settings=omitted)
    page = render_report(result, yaml=yaml)
    pdf_bytes = html_to_pdf(page) if with_pdf else None
    timing_s = {**result.timing_s, "report": perf_counter() - started}
    object_tables = {
        "ego": result.ego,
        "clusters": result.clusters,
        "tracks": result.tracks,
        "traffic": result.traffic,
    }
    tables = {name: table for name, table in object_tables.items() if table is not None}
    files = result_paths_by_name(shown_out or out, tables, has_pdf=with_pdf) | {
        file.name: file for file in objects
    }
    document_values = run_json_document(result, source=source, files=files, timing_s=timing_s)
    texts = {"report.html": page, "scenario.yaml": yaml, "run.json": to_json_text(document_values)}
    contents = result.source.contents if isinstance(result.source, Recording) else None
    write_results(
        out,
        texts,
        frames=result.frames(),
        n_frames=result.n_frames_with_kept_samples,
        radar=result.radar,
        detections=result.detections,
        truth=result.truth,
        other_tables=tables,
        pdf=pdf_bytes,
        device=contents.device if contents else None,
        iq=contents.iq if contents else None,
    )
    return texts["run.json"]

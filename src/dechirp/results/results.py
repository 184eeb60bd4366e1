"""Results folder of `--out`: all files of a run, written together."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType

import xarray as xr

from dechirp.core.atomic_files import (
    atomic_folder,
    check_output_folder_replaceable,
    encode_utf8_with_escapes,
)
from dechirp.core.table_columns import dataset_to_records
from dechirp.radar.radar import Radar
from dechirp.recordings.cube_store import write_cube_store
from dechirp.results.text_files import dataset_to_csv, to_json_text

_TEXTS = ("report.html", "scenario.yaml", "run.json")
_MARK = "run.json"
FILES = (*_TEXTS, "detections.csv", "detections.json", "cube.zarr")
_OPTIONAL_FILES = ("ego.csv", "clusters.csv", "tracks.csv", "traffic.csv", "report.pdf")


def check_results_folder_replaceable(out: Path) -> None:
    """Raise `DechirpError` if a folder cannot take results; call this before a long run.

    The folder must be absent, empty or hold only earlier results, and be writable. Those of several
    radars have a folder for each.
    """
    try:
        of_radars = [mark.parent.name for mark in out.glob(f"*/{_MARK}")]
    except OSError:  # such as a name that is too long: the check below reports it
        of_radars = []
    own_names = (*FILES, *_OPTIONAL_FILES, *of_radars)
    check_output_folder_replaceable(out, marker_file=_MARK, own_names=own_names)


def write_results(
    out: Path,
    texts: Mapping[str, str],
    *,
    frames: Iterable[xr.DataArray],
    n_frames: int,
    radar: Radar,
    detections: xr.Dataset,
    truth: xr.Dataset | None,
    other_tables: Mapping[str, xr.Dataset] = MappingProxyType({}),
    pdf: bytes | None = None,
    device: str | None = None,
    iq: str | None = None,
) -> dict[str, Path]:
    """Write results into a folder, atomically, and replace earlier ones.

    Parameters
    ----------
    out : Path
        The folder.
    texts : mapping
        Content of `report.html`, `scenario.yaml` and `run.json`.
    frames : iterable of DataArray (frame, chirp, rx, sample)
        The cube in n_frames pieces of one frame each; one is held at a time.
    radar, detections, truth
        Stored with the cube; the detections also as CSV and JSON.
    other_tables : mapping
        The tables `ego`, `clusters` and `tracks`, if any: stored with the cube and as CSV.
    pdf : bytes, optional
        Content of `report.pdf`.
    device, iq : str, optional
        Metadata of a recording, see `write_cube_store`.

    Returns
    -------
    dict
        Path of each file by its name.

    Raises
    ------
    DechirpError
        If the folder holds other files or cannot be written. It is then unchanged.
    """
    check_results_folder_replaceable(out)
    with atomic_folder(out) as made:
        for name in _TEXTS:
            (made / name).write_bytes(encode_utf8_with_escapes(texts[name]))
        if pdf is not None:
            (made / "report.pdf").write_bytes(pdf)
        (made / "detections.csv").write_bytes(encode_utf8_with_escapes(dataset_to_csv(detections)))
        (made / "detections.json").write_bytes(
            encode_utf8_with_escapes(to_json_text(dataset_to_records(detections)))
        )
        write_cube_store(
            made / "cube.zarr",
            frames,
            n_frames=n_frames,
            radar=radar,
            groups={"detections": detections, "truth": truth, **other_tables},
            device=device,
            iq=iq,
        )
        for name, table in other_tables.items():
            (made / f"{name}.csv").write_bytes(encode_utf8_with_escapes(dataset_to_csv(table)))
    return result_paths_by_name(out, other_tables, has_pdf=pdf is not None)


def result_paths_by_name(
    out: Path, others: Iterable[str] = (), *, has_pdf: bool = False
) -> dict[str, Path]:
    """Return the path of each results file by its name; see `write_results`."""
    pages = ("report.pdf",) if has_pdf else ()
    names = (*FILES, *(f"{other}.csv" for other in others), *pages)
    return {name: out / name for name in names}

"""The folder that `--out` names: everything about one run, written together."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType

import xarray as xr

from dechirp.core.columns import records
from dechirp.radar.radar import Radar
from dechirp.store.cube import write_cube
from dechirp.store.tables import csv_text, json_text
from dechirp.store.whole import in_utf8, must_be_replaceable, whole_folder

_TEXTS = ("report.html", "scenario.yaml", "run.json")
_MARK = "run.json"
FILES = (*_TEXTS, "detections.csv", "detections.json", "cube.zarr")
_IF_ASKED = ("ego.csv", "clusters.csv", "tracks.csv", "report.pdf")


def check_out(out: Path) -> None:
    """Raise `DechirpError` if a folder cannot take results; to be asked before a long run.

    It must be absent, empty or hold nothing but earlier results, and its place be writable.
    """
    must_be_replaceable(out, mark=_MARK, ours=(*FILES, *_IF_ASKED))


def write_results(
    out: Path,
    texts: Mapping[str, str],
    *,
    frames: Iterable[xr.DataArray],
    n_frames: int,
    radar: Radar,
    detections: xr.Dataset,
    truth: xr.Dataset | None,
    others: Mapping[str, xr.Dataset] = MappingProxyType({}),
    pdf: bytes | None = None,
    device: str | None = None,
    iq: str | None = None,
) -> dict[str, Path]:
    """Write results into a folder, in place of earlier ones; all of them or none.

    Parameters
    ----------
    out : Path
        The folder.
    texts : mapping
        Content of `report.html`, `scenario.yaml` and `run.json`.
    frames : iterable of DataArray (frame, chirp, rx, sample)
        The cube, n_frames pieces of one frame each; one is held at a time.
    radar, detections, truth
        Kept with the cube; the detections also as CSV and JSON.
    others : mapping
        What else there is of `ego`, `clusters` and `tracks`: kept with the cube, and as CSV.
    pdf : bytes, optional
        Content of `report.pdf`, where there is to be one.
    device, iq : str, optional
        Of a recording, see `write_cube`.

    Returns
    -------
    dict
        Path of each file by its name.

    Raises
    ------
    DechirpError
        If the folder is somebody else's or cannot be written. It is left as it was then.
    """
    check_out(out)
    with whole_folder(out) as made:
        for name in _TEXTS:
            (made / name).write_bytes(in_utf8(texts[name]))
        if pdf is not None:
            (made / "report.pdf").write_bytes(pdf)
        (made / "detections.csv").write_bytes(in_utf8(csv_text(detections)))
        (made / "detections.json").write_bytes(in_utf8(json_text(records(detections))))
        write_cube(
            made / "cube.zarr",
            frames,
            n_frames=n_frames,
            radar=radar,
            groups={"detections": detections, "truth": truth, **others},
            device=device,
            iq=iq,
        )
        for name, table in others.items():
            (made / f"{name}.csv").write_bytes(in_utf8(csv_text(table)))
    return files_in(out, others, has_pdf=pdf is not None)


def files_in(out: Path, others: Iterable[str] = (), *, has_pdf: bool = False) -> dict[str, Path]:
    """Path of each file of the results in a folder, by its name; see `write_results`."""
    pages = ("report.pdf",) if has_pdf else ()
    names = (*FILES, *(f"{other}.csv" for other in others), *pages)
    return {name: out / name for name in names}

"""SigMF recordings: `x.sigmf-data`, and `x.sigmf-meta` with the extension `radar`.

All chirps that were sampled, one after the other, the receivers in turn at each instant: cf32_le
or rf32_le, or ci16_le or ri16_le for codes of a converter. docs/sigmf-radar.md says what the
extension holds.

SigMF, Signal Metadata Format specification, version 1.2.6.
"""

import hashlib
import json
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dechirp.core.errors import DechirpError, Mistake
from dechirp.core.values import value
from dechirp.exchange.coded import if_codes, numbers
from dechirp.exchange.said import must_be_of, said_of
from dechirp.exchange.writers.base import Progress, Writer
from dechirp.formats.arrays.json_columns import TYPES, listed
from dechirp.formats.arrays.sigmf_meta import (
    DATA,
    EXTENSION,
    LONGEST,
    META,
    VERSION,
    pair_of,
)
from dechirp.formats.recording import Recording
from dechirp.radar.radar import Radar
from dechirp.store.whole import whole_files

_SIGMF_VERSION = "1.2.6"


@value
class Sigmf(Writer):
    """SigMF: samples, and radar, lost chirps and tables in the extension `radar`."""

    endings: ClassVar[tuple[str, ...]] = (META, DATA)
    keeps: ClassVar[str] = "samples, radar, gaps, tables of up to 16 MB"

    def check(self, recording: Recording) -> None:
        """See `Writer.check`."""
        recording.must_hold_samples()
        said_of(recording, None)
        must_be_of(TYPES, recording.tables)
        n_bytes = len(_text(recording, recording.contents.scale, "0" * 128))
        if n_bytes > LONGEST:
            raise _refused(
                f"with a radar, frames and tables that take {n_bytes} bytes as JSON",
                f"at most {LONGEST}",
                "Write an .h5 file, or fewer frames.",
            )

    def files(self, recording: Recording, out: Path) -> tuple[Path, ...]:
        """See `Writer.files`."""
        return pair_of(out)

    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        """See `Writer.write`."""
        meta, data = pair_of(out)

        def write_with(scale: float | None) -> None:
            with whole_files(meta, data) as (made_meta, made_data):
                sha512 = _write_data(made_data, recording, scale, progress)
                made_meta.write_text(_text(recording, scale, sha512), encoding="utf-8")

        if_codes(recording, write_with)
        return meta, data


def _write_data(
    data: Path, recording: Recording, scale: float | None, progress: Progress | None
) -> str:
    """Write the samples; give the sum of their bytes."""
    made = hashlib.sha512()
    with data.open("wb") as file:
        for done, frame in enumerate(numbers(recording, scale), start=1):
            little = frame.dtype.newbyteorder("<")
            in_turn = np.ascontiguousarray(frame.swapaxes(1, 2), little)
            block = in_turn.reshape(-1).view(np.uint8).data
            made.update(block)
            file.write(block)
            if progress is not None:
                progress(done, recording.n_frames)
    return made.hexdigest()


def _text(recording: Recording, scale: float | None, sha512: str) -> str:
    """The metadata, as JSON."""
    radar, held = recording.radar, recording.contents
    frame, chirp = radar.frame, radar.frame.chirp
    description = json.loads(said_of(recording, scale)[0].text)
    kind = ("c" if chirp.sampling == "complex" else "r") + ("f32_le" if scale is None else "i16_le")
    said = {
        "core:datatype": kind,
        "core:version": _SIGMF_VERSION,
        "core:sample_rate": chirp.sample_rate_hz,
        "core:num_channels": radar.array.n_rx,
        "core:sha512": sha512,
        "core:recorder": "dechirp",
        "core:extensions": [{"name": EXTENSION, "version": VERSION, "optional": True}],
        f"{EXTENSION}:radar": description["radar"],
        f"{EXTENSION}:units": held.units,
        **({} if scale is None else {f"{EXTENSION}:scale": scale}),
        **{
            f"{EXTENSION}:{name}": description[name]
            for name in ("device", "iq")
            if description[name] is not None
        },
        f"{EXTENSION}:n_frames": recording.n_frames,
        f"{EXTENSION}:n_chirps": frame.n_sent,
        f"{EXTENSION}:n_samples": chirp.n_samples,
        f"{EXTENSION}:tables": {
            name: _table(table, description["tables"][name])
            for name, table in recording.tables.items()
        },
    }
    if frame.n_intervals == 1:
        said[f"{EXTENSION}:chirp_starts"] = frame.chirps_s.tolist()
    captures = [_capture(radar, number) for number in range(recording.n_frames)]
    tree = {"global": said, "captures": captures, "annotations": _lost(held.gaps, chirp.n_samples)}
    try:
        return json.dumps(tree, allow_nan=False)
    except ValueError as error:
        raise _refused(
            f"with an attribute that JSON does not take ({error})", "finite ones", "Leave it out."
        ) from None


def _capture(radar: Radar, number: int) -> dict[str, Any]:
    """A frame: its first sample, when it starts, and its chirps where frames differ in that."""
    frame, chirp = radar.frame, radar.frame.chirp
    made = {
        "core:sample_start": number * frame.n_sent * chirp.n_samples,
        "core:frequency": chirp.mid_window_frequency_hz,
        f"{EXTENSION}:start": frame.start_s(number),
    }
    if frame.n_intervals > 1:
        made[f"{EXTENSION}:chirp_starts"] = frame.at(number).chirps_s.tolist()
    return made


def _table(table: Any, said: dict[str, Any]) -> dict[str, Any]:
    """A table with its columns."""
    variables = {
        name: {
            "dims": of["dims"],
            "attrs": of["attrs"],
            "is_coordinate": of["is_coordinate"],
            **listed(np.asarray(table.variables[name].values)),
        }
        for name, of in said["variables"].items()
    }
    return {"attrs": said["attrs"], "variables": variables}


def _lost(gaps: np.ndarray | None, n_samples: int) -> list[dict[str, Any]]:
    """An annotation for each run of chirps that were lost."""
    if gaps is None:
        return []
    steps = np.diff(gaps.reshape(-1).astype(np.int8), prepend=0, append=0)
    runs = zip(np.flatnonzero(steps > 0), np.flatnonzero(steps < 0), strict=True)
    return [
        {
            "core:sample_start": int(first) * n_samples,
            "core:sample_count": int(end - first) * n_samples,
            "core:label": "lost",
            f"{EXTENSION}:lost": True,
        }
        for first, end in runs
    ]


def _refused(got: str, need: str, fix: str) -> DechirpError:
    return DechirpError(Mistake(setting="recording", got=got, need=need, fix=fix))

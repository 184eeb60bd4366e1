"""The JSON document of a run, in plain values."""

from pathlib import Path
from typing import Any

import dechirp
from dechirp.cli.sources import spelled
from dechirp.config.texts import plain
from dechirp.core.columns import records
from dechirp.experiment.run import Result
from dechirp.radar.radar import Radar


def document(
    result: Result, *, source: Path | None, files: dict[str, Path], timing_s: dict[str, float]
) -> dict[str, Any]:
    """Everything about a run but the samples; None for what is not estimated."""
    return {
        "version": dechirp.__version__,
        "seed": result.scenario.seed,
        "source": "reference" if source is None else spelled(source),
        "radar": radar_document(result.radar),
        "frames": result.n_frames,
        "detections": records(result.detections),
        **{
            name: None if table is None else records(table)
            for name, table in (
                ("clusters", result.clusters),
                ("tracks", result.tracks),
                ("truth", result.truth),
            )
        },
        "findings": [plain(finding) for finding in result.findings],
        "timing_s": timing_s,
        "files": {name: str(path) for name, path in files.items()},
    }


def radar_document(radar: Radar) -> dict[str, Any]:
    """Settings of a radar, and what follows from them; None for what one chirp cannot tell."""
    frame, chirp = radar.frame.at(0), radar.frame.chirp
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
    return {**plain(radar), "derived": derived}

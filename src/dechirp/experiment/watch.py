"""A stream from start to end: frames are processed as they come, and their samples let go."""

from array import array
from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from time import perf_counter

import numpy as np
import xarray as xr

from dechirp.core.errors import DechirpError, InvalidSetting, RecordingError
from dechirp.core.findings import Finding, heard
from dechirp.core.values import value
from dechirp.experiment.run import Found, Result, concluded
from dechirp.experiment.scenario import Scenario, Source, called, check_chain, check_following
from dechirp.live.follow import follow
from dechirp.live.stream import Stream
from dechirp.live.udp import is_address, listen
from dechirp.process.detect import UNITS, detected_columns, labelled_detections
from dechirp.process.mitigation.cleaned import Removed
from dechirp.tracking.live import LiveTracker


@value
class Seen:
    """What was found in a frame that just came."""

    number: int
    """Of the frame."""
    detections: xr.Dataset
    n_gaps: int
    """Chirps of which samples were lost."""


def stream_of(scenario: Scenario, *, idle_s: float) -> Stream:
    """Listen to the UDP address, or follow the file, that a scenario has for its recording.

    It ends when nothing came for `idle_s`; see `listen` and `follow`.

    Raises
    ------
    DechirpError
        If that cannot be, or does not go with the scenario's settings.
    """
    told = _recording(scenario)
    opened = listen if is_address(told.path) else follow
    stream: Stream = opened(
        told.path,
        radar=scenario.radar,
        settings=told.settings_path,
        device=told.device,
        iq=told.iq,
        calibration=told.calibration,
        idle_s=idle_s,
    )
    try:
        check_chain(scenario.chain, stream.radar)
        check_following(scenario, stream.radar, None)
        if scenario.tracker is not None:
            with called("tracker", instead_of="Tracker"):
                LiveTracker(scenario.tracker)  # that it is not installed is said before
    except DechirpError:
        stream.close()
        raise
    return stream


def watch(
    scenario: Scenario, stream: Stream, *, tell: Callable[[Seen], None] | None = None
) -> Result:
    """Process every frame of a stream when it comes, until it ends.

    Of the samples those of the first frame are kept; folds are told frame by frame.

    Parameters
    ----------
    scenario : Scenario
        How to process; of `recording`, `frames` are counted from the first one that comes.
    stream : Stream
        As `stream_of` gives it; closed at the end.
    tell : callable, optional
        Called with what was found in each frame.

    Raises
    ------
    RecordingError
        If no frame came, or none of those that are asked for.
    DechirpError
        If a frame cannot be processed.
    """
    told, radar = _recording(scenario), stream.radar
    first: xr.DataArray | None = None
    numbers = range(0)
    columns = {name: array("d") for name in UNITS}
    took_out: list[tuple[Removed, ...]] = []
    n_crowded, processing_s, started = 0, 0.0, perf_counter()
    with stream:
        for cube in islice(stream, *(told.frames or (0, None))):
            came, number = perf_counter(), stream.number
            if first is None:
                first, numbers = cube, range(number, number)
            with heard() as crowded:
                found = detected_columns(
                    [cube], radar, scenario.chain, first=number, took_out=took_out.append
                )
            numbers = range(numbers.start, number + 1)
            n_crowded += len(crowded)
            for name, column in columns.items():
                column.extend(found[name])
            if tell is not None:
                n_gaps = int(cube.gap.sum()) if "gap" in cube.coords else 0
                detections = labelled_detections(found)
                tell(Seen(number=number, detections=detections, n_gaps=n_gaps))
            processing_s += perf_counter() - came
    if first is None:
        raise RecordingError(
            told.path,
            got="a stream that ended before the frames that are asked for",
            need="frames of those numbers, counted from the first one that came",
            fix="Ask for earlier ones (--frames), or wait longer (--idle).",
        )
    every = {name: np.array(column) for name, column in columns.items()}
    every["frame"] = every["frame"].astype(int)
    made = concluded(
        scenario,
        radar,
        first,
        Found(
            first_frame=numbers.start,
            detections=labelled_detections(every),
            times_s=tuple(
                radar.frame.start_s(one) + radar.frame.at(one).mid_frame_s for one in numbers
            ),
            took_out=tuple(took_out),
            n_crowded=n_crowded,
        ),
    )
    waiting_s = perf_counter() - started - processing_s - made.timing_s["process"]
    return replace(
        made,
        findings=(*stream.findings, _kept(), *_folds(radar.frame.n_intervals), *made.findings),
        timing_s={"wait": waiting_s, "process": processing_s + made.timing_s["process"]},
    )


def _recording(scenario: Scenario) -> Source:
    """What is to be followed; an error if that is none, or not what a DCA1000 sends."""
    told = scenario.recording
    if told is None:
        raise InvalidSetting(
            "--follow",
            got="given for a scene that is simulated",
            need="left out: it is for recordings",
            fix="Leave it out, or name the recording.",
        )
    for name, usual in (("format", "dca1000"), ("axes", None), ("encoding", None)):
        given = getattr(told, name)
        if given not in (None, usual):
            raise InvalidSetting(
                f"--{name}",
                got=f"{given}, of a stream",
                need="left out: only the bare samples of a DCA1000 are followed",
                fix="Leave it out, or read the file when it is whole, without --follow.",
            )
    return told


def _kept() -> Finding:
    return Finding(
        level="note",
        setting="recording",
        got="the samples of the first frame alone are kept, as those of a stream have no end",
        need="a recorder, where all of them are wanted",
        fix="Nothing is to be done.",
    )


def _folds(n_intervals: int) -> tuple[Finding, ...]:
    if n_intervals == 1:
        return ()
    return (
        Finding(
            level="note",
            setting="radar.frame.interval",
            got="folds told by each frame alone",
            need="frames of several intervals together, to tell folds by them",
            fix="Record the frames, and run the recording.",
        ),
    )

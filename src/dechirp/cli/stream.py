"""Live processing by `dechirp run`: a line per frame, and a clean end on a signal."""

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from dechirp.config.quantities import parse_quantity
from dechirp.core.errors import InvalidSetting
from dechirp.core.text import format_fixed, ratio_db
from dechirp.experiments.run import Result
from dechirp.experiments.scenario import Scenario
from dechirp.experiments.streaming import FrameReport, open_stream, process_stream
from dechirp.recordings.live.stream import Stream
from dechirp.recordings.live.udp import is_udp_address

_DEFAULT_IDLE = "10 s"


def is_live_source(scenario: Scenario, *, follow: bool, idle: str | None) -> bool:
    """Return True for a UDP address, or for a file with `--follow`.

    Raises
    ------
    InvalidSetting
        If `--idle` is given for any other source.
    """
    source = scenario.recording
    if follow or (source is not None and is_udp_address(source.path)):
        return True
    if idle is not None:
        raise InvalidSetting(
            "--idle",
            value="given without --follow",
            expected="--follow or a UDP address: other sources have no waiting time",
            fix="add --follow, or remove --idle",
        )
    return False


def process_live_frames(scenario: Scenario, *, idle: str | None, quiet: bool) -> Result:
    """Process frames until the idle time, Ctrl-C or SIGTERM; print a line for each frame."""
    idle_s = parse_quantity(_DEFAULT_IDLE if idle is None else idle, "s", setting="--idle")
    stream = open_stream(scenario, idle_s=idle_s)
    with _stop_on_signals(stream):
        return process_stream(scenario, stream, on_frame=None if quiet else _print_frame_report)


@contextmanager
def _stop_on_signals(stream: Stream) -> Iterator[None]:
    """End the stream on Ctrl-C or SIGTERM, so that its results are written.

    A second signal, or one after the end of the stream, ends the process.
    """

    def end(number: int, _frame: FrameType | None) -> None:
        restore()
        if stream.has_ended:
            signal.raise_signal(number)
        else:
            stream.stop()

    def restore() -> None:
        for number_of_signal, handler in handlers.items():
            signal.signal(number_of_signal, handler)

    handlers = {
        number_of_signal: signal.signal(number_of_signal, end)
        for number_of_signal in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield
    finally:
        restore()


def _print_frame_report(report: FrameReport) -> None:
    n = report.detections.sizes["detection"]
    line = f"frame {report.number}: {n} detection{'' if n == 1 else 's'}"
    if n:
        strongest = report.detections.isel(detection=int(report.detections.snr.values.argmax()))
        line += (
            f", the strongest at {format_fixed(float(strongest.range), 2)} m,"
            f" {format_fixed(float(strongest.velocity), 2)} m/s,"
            f" {format_fixed(ratio_db(float(strongest.snr)), 1)} dB"
        )
    if report.n_gaps:
        line += f"; {report.n_gaps} chirps with gaps"
    print(line, file=sys.stderr, flush=True)

"""`dechirp run` on what is still arriving: a line for each frame, and a signal ends it well."""

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from dechirp.config.quantities import quantity
from dechirp.core.errors import InvalidSetting
from dechirp.core.words import fixed, ratio_db
from dechirp.experiment.run import Result
from dechirp.experiment.scenario import Scenario
from dechirp.experiment.watch import Seen, stream_of, watch
from dechirp.live.stream import Stream
from dechirp.live.udp import is_address

_IDLE = "10 s"


def is_stream(scenario: Scenario, *, follow: bool, idle: str | None) -> bool:
    """Whether a source is to be followed: it was asked for, or is an address.

    Raises
    ------
    InvalidSetting
        If a time to wait is given for another.
    """
    source = scenario.recording
    if follow or (source is not None and is_address(source.path)):
        return True
    if idle is not None:
        raise InvalidSetting(
            "--idle",
            got="given without --follow",
            need="left out: nothing is waited for",
            fix="Give --follow too, or leave it out.",
        )
    return False


def followed(scenario: Scenario, *, idle: str | None, quiet: bool) -> Result:
    """Follow until nothing comes, Ctrl-C or SIGTERM; a line on standard error for each frame."""
    idle_s = quantity(_IDLE if idle is None else idle, "s", setting="--idle")
    stream = stream_of(scenario, idle_s=idle_s)
    with _ended_by_signals(stream):
        return watch(scenario, stream, tell=None if quiet else _tell)


@contextmanager
def _ended_by_signals(stream: Stream) -> Iterator[None]:
    """Let Ctrl-C or SIGTERM end the stream, so that its results are written.

    A second one, or one that comes when the stream has ended, ends all.
    """

    def end(number: int, _frame: FrameType | None) -> None:
        restore()
        if stream.has_ended:
            signal.raise_signal(number)
        else:
            stream.stop()

    def restore() -> None:
        for one, handler in before.items():
            signal.signal(one, handler)

    before = {one: signal.signal(one, end) for one in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        restore()


def _tell(seen: Seen) -> None:
    n = seen.detections.sizes["detection"]
    said = f"frame {seen.number}: {n} detection{'' if n == 1 else 's'}"
    if n:
        best = seen.detections.isel(detection=int(seen.detections.snr.values.argmax()))
        said += (
            f", the strongest at {fixed(float(best.range), 2)} m,"
            f" {fixed(float(best.velocity), 2)} m/s, {fixed(ratio_db(float(best.snr)), 1)} dB"
        )
    if seen.n_gaps:
        said += f"; {seen.n_gaps} chirps with gaps"
    print(said, file=sys.stderr, flush=True)

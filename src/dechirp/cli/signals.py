"""Signals that end a command, SIGINT and SIGTERM, also where a library swallows their exception."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

from dechirp.core.lost_interrupts import repeat_lost_interrupts


@contextmanager
def interrupted_by_signals() -> Iterator[list[int]]:
    """Raise KeyboardInterrupt in the block on SIGINT and SIGTERM; yield the numbers received.

    If a callback of a compiled library loses the exception, the signal is sent again; the library
    may also raise an error of its own, to be treated as the interrupt.
    A signal that is ignored on entry (`nohup`, background jobs) stays ignored.
    """
    received: list[int] = []

    def interrupt(number: int, _frame: FrameType | None) -> NoReturn:
        received.append(number)
        raise KeyboardInterrupt

    def send_again() -> None:
        os.kill(os.getpid(), received[0] if received else signal.SIGINT)

    earlier = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    for number, handler in earlier.items():
        if handler != signal.SIG_IGN:
            signal.signal(number, interrupt)
    try:
        with repeat_lost_interrupts(KeyboardInterrupt, send_again):
            yield received
    finally:
        for number, handler in earlier.items():
            signal.signal(number, handler)

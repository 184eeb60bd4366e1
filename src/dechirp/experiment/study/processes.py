"""Processes of this machine that run blocks of trials, and end when they are told to."""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from functools import partial
from types import FrameType
from typing import Any

from loky import ProcessPoolExecutor

ONE_THREAD = {f"{pool}_NUM_THREADS": "1" for pool in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
"""What a worker is told: as many workers as cores leave none for threads of their own."""

_ENDS_WITHIN_S = 5.0  # a worker that does not is in one long call
_PAUSE_S = 10e-3


class Stopped(BaseException):
    """Of a block whose worker was told to stop; no error of a trial, which are kept and counted."""


class Processes(Executor):
    """A pool of processes that can be started again: a pool that lost one takes no more work."""

    def __init__(self, n_workers: int) -> None:
        self.n_workers = n_workers
        self._start()

    def _start(self) -> None:
        self._pool = ProcessPoolExecutor(
            max_workers=self.n_workers,
            env=ONE_THREAD,
            initializer=_stay_with_parent,
            initargs=(os.getpid(),),
        )
        self._is_fresh = True
        self._given: set[Future[Any]] = set()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """See `Executor.submit`."""
        # A pool that is shut down trips over futures that were cancelled, so nobody has them.
        # It has all but a few blocks under way at once: there is little to cancel.
        outer: Future[Any] = Future()
        if self._is_fresh:
            with _interrupts_ignored():  # this starts the processes
                inner = self._pool.submit(_stoppable, fn, *args, **kwargs)
            self._is_fresh = False
        else:
            inner = self._pool.submit(_stoppable, fn, *args, **kwargs)
        self._given = {one for one in self._given if not one.done()} | {inner}
        inner.add_done_callback(partial(_pass_on, outer))
        return outer

    def renew(self) -> None:
        """Start other processes in place of those that are there."""
        self.shutdown()
        self._start()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Stop what is still under way, which is of a study that was stopped, and end."""
        # A worker that ends by itself leaves none of the semaphores of libraries behind; one that
        # does not is killed. It is told again and again, as it may only just have started.
        give_up_s = time.monotonic() + _ENDS_WITHIN_S
        try:
            while self._is_busy() and time.monotonic() < give_up_s:
                self._stop()
                time.sleep(_PAUSE_S)
        finally:
            self._pool.shutdown(wait=wait, kill_workers=self._is_busy())

    def _is_busy(self) -> bool:
        return any(not one.done() for one in self._given)

    def _stop(self) -> None:
        for worker in list(self._pool._processes):
            with suppress(OSError):  # it has ended
                os.kill(worker, signal.SIGTERM)


def _pass_on(outer: Future[Any], inner: Future[Any]) -> None:
    """Give a result or an error to the future that somebody has, unless it was cancelled."""
    if not outer.set_running_or_notify_cancel():
        return
    error = inner.exception()
    if error is None:
        outer.set_result(inner.result())
    else:
        outer.set_exception(error)


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Start processes that ignore Ctrl-C from their first moment on, as they inherit that."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _stay_with_parent(parent: int) -> None:
    """Leave Ctrl-C to the parent, and end when it has: a killed one cannot say so."""
    import psutil

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _stop_work)

    def watch() -> None:
        while os.getppid() == parent and psutil.pid_exists(parent):
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


class _This:
    """What this process does, if it is a worker."""

    is_working = False
    is_stopped = False


def _stoppable(fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Any:
    """Do some work on a worker; SIGTERM ends it and all after it, and not the worker."""
    try:
        _This.is_working = True
        if _This.is_stopped:
            raise Stopped("told to stop by SIGTERM")
        return fn(*args, **kwargs)
    finally:
        _This.is_working = False


def _stop_work(_number: int, _frame: FrameType | None) -> None:
    is_first, _This.is_stopped = not _This.is_stopped, True
    if is_first and _This.is_working:  # what is half written is cleared away undisturbed
        raise Stopped("told to stop by SIGTERM")

"""Process pool of this machine whose workers stop when they receive SIGTERM."""

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

from dechirp.core.lost_interrupts import repeat_lost_interrupts

ONE_THREAD = {f"{pool}_NUM_THREADS": "1" for pool in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
"""Environment of a worker: with one worker a core, no core is left for threads of libraries."""
# loky replaces a worker that needs 300 MB more than after its first block, and warns of a leak.
# Blocks of larger frames need more, and starting a worker takes 2 s.
_NO_MEMORY_LIMIT = {"LOKY_MAX_MEMORY_LEAK_SIZE": "1e15"}

_SHUTDOWN_TIMEOUT_S = 5.0  # later ones are in one long call
_POLL_S = 10e-3


class WorkerStopped(BaseException):
    """Raised inside a block whose worker received SIGTERM; not an error of a trial."""


class RestartablePool(Executor):
    """Process pool that can be restarted: a loky pool that lost a worker accepts no more work."""

    def __init__(self, n_workers: int) -> None:
        self.n_workers = n_workers
        self._start_pool()

    def _start_pool(self) -> None:
        self._pool = ProcessPoolExecutor(
            max_workers=self.n_workers,
            env=ONE_THREAD | _NO_MEMORY_LIMIT,
            initializer=_initialise_worker,
            initargs=(os.getpid(),),
        )
        self._is_fresh = True
        self._submitted: set[Future[Any]] = set()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        # loky fails on shutdown if its futures were cancelled, so callers get outer futures.
        # Nearly all of its blocks run at once: there is little to cancel.
        outer: Future[Any] = Future()
        if self._is_fresh:
            with _ignore_ctrl_c_in_block():  # starts the processes
                inner = self._pool.submit(_call_stoppable_by_sigterm, fn, *args, **kwargs)
            self._is_fresh = False
        else:
            inner = self._pool.submit(_call_stoppable_by_sigterm, fn, *args, **kwargs)
        self._submitted = {future for future in self._submitted if not future.done()} | {inner}
        inner.add_done_callback(partial(_copy_future_result, outer))
        return outer

    def replace_all_processes(self) -> None:
        """Replace all processes by new ones."""
        self.shutdown()
        self._start_pool()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Stop the blocks that are still running, and end the processes."""
        # A worker that exits regularly releases the semaphores of libraries; others are killed.
        # The signal is repeated, as a worker may have started only just now.
        give_up_s = time.monotonic() + _SHUTDOWN_TIMEOUT_S
        try:
            while self._has_unfinished_calls() and time.monotonic() < give_up_s:
                self._send_sigterm_to_workers()
                time.sleep(_POLL_S)
        finally:
            self._pool.shutdown(wait=wait, kill_workers=self._has_unfinished_calls())

    def _has_unfinished_calls(self) -> bool:
        return any(not future.done() for future in self._submitted)

    def _send_sigterm_to_workers(self) -> None:
        for worker in list(self._pool._processes):
            with suppress(OSError):  # already exited
                os.kill(worker, signal.SIGTERM)


def _copy_future_result(outer: Future[Any], inner: Future[Any]) -> None:
    """Copy a result or an error to the outer future, unless that was cancelled."""
    if not outer.set_running_or_notify_cancel():
        return
    error = inner.exception()
    if error is None:
        outer.set_result(inner.result())
    else:
        outer.set_exception(error)


@contextmanager
def _ignore_ctrl_c_in_block() -> Iterator[None]:
    """Start processes that ignore Ctrl-C from the beginning, as they inherit the signal handler."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous_handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous_handler)


def _initialise_worker(parent_pid: int) -> None:
    """Ignore Ctrl-C, and exit after the parent: a killed parent cannot send a signal."""
    import psutil

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _handle_sigterm)

    def watch_parent() -> None:
        while os.getppid() == parent_pid and psutil.pid_exists(parent_pid):
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch_parent, daemon=True).start()


class _WorkerState:
    """State of this process if it is a worker."""

    is_working = False
    is_stopped = False
    is_interrupted = False


def _call_stoppable_by_sigterm(fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Any:
    """Run a function on a worker; SIGTERM ends it and all later calls, but not the worker."""
    with repeat_lost_interrupts(WorkerStopped, _repeat_sigterm):
        try:
            _WorkerState.is_working = True
            _raise_if_stopped()
            result = fn(*args, **kwargs)
        except Exception:
            _raise_if_stopped()  # a library may raise an error of its own for a lost interrupt
            raise
        finally:
            _WorkerState.is_working = False
    _raise_if_stopped()
    return result


def _raise_if_stopped() -> None:
    if _WorkerState.is_stopped:
        raise WorkerStopped("stopped by SIGTERM")


def _handle_sigterm(_number: int, _frame: FrameType | None) -> None:
    _WorkerState.is_stopped = True
    if _WorkerState.is_working and not _WorkerState.is_interrupted:
        _WorkerState.is_interrupted = True  # a second signal must not interrupt the clean-up
        raise WorkerStopped("stopped by SIGTERM")


def _repeat_sigterm() -> None:
    _WorkerState.is_interrupted = False
    os.kill(os.getpid(), signal.SIGTERM)

"""Kernels: loops that Numba compiles, each with a plain twin for small work and without Numba.

Compiling the kernels of a first frame takes 35 s of CPU time, once for each installation, and
loading them again takes a second in every process. The plain twins of NumPy and SciPy take 0.08 s
for a frame of the reference scenario, the compiled kernels 0.01 s. Therefore

* a run of few samples, and the inspection of a small recording, use the twins, see
  `plain_twins_for_small_work`;
* functions that a program calls with samples, such as `dechirp.detect`, use the twins in the first
  calls of a process, and then the compiled kernels, see `plain_twins_in_first_calls`;
* larger runs, studies and live pages use the compiled kernels;
* without Numba, or with its setting NUMBA_DISABLE_JIT=1, everything uses the twins. That of two
  kernels of echoes, nufft and low-rank, is the direct kernel, with which they agree within the
  tolerance of the engine.

The choice depends on the size of the work alone, not on time or caches, so that equal runs and
equal scripts return equal bits. Numba is imported when a compiled kernel is called for the first
time.
"""

import functools
import importlib.util
import inspect
import logging
import math
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache, cached_property
from pathlib import Path
from types import CodeType, ModuleType, SimpleNamespace
from typing import Any, Final, Protocol, TypeVar, cast

from dechirp.core.errors import DechirpError, InvalidSetting

_LOGGER = logging.getLogger(__name__)

F = TypeVar("F", bound=Callable[..., Any])

AS_WRITTEN: Final = "as written"
"""Plain twin of a kernel whose own body is fast enough: short loops, or calls of other kernels."""

IN_CALLER: Final = "in caller"
"""Plain twin of a kernel whose callers compute without it where `can_compile` is false."""

MAX_PLAIN_SAMPLES = 2**21
"""Samples, times echoes in a simulation, up to which the plain twins cost less than loading the
compiled kernels: 0.3 us each, 0.2 of them to simulate one echo."""


_COMPILING = (
    "compiling loops for this processor, which are kept for later runs: up to a minute of"
    " processor time"
)


class CompilationListener(Protocol):
    """Object that is told about each compilation; one may be part of another."""

    def start_compilation(self) -> None:
        """Note the start; an error stops the compilation."""

    def end_compilation(self) -> None:
        """Note the end."""


compilation_listeners: list[CompilationListener] = []
"""Listeners to the compilations of this process; loading from disk is none."""

SAMPLES_PER_AMPLITUDE = 1000
"""Samples that cost plain code as much as the amplitude of one element of which a direction is
estimated: 0.3 us against 40 (music) to 700 us (maximum-likelihood)."""

SAMPLES_PER_DETECTION = 100_000
"""Samples that cost plain code as much as refining a detection beside others: 0.03 to 0.1 s."""

_uses_plain_twins: ContextVar[bool | None] = ContextVar("_uses_plain_twins", default=None)

_calls = SimpleNamespace(n_samples=0.0)
"""Samples in the calls of this process, see `plain_twins_in_first_calls`."""


class Kernel:
    """Function with a compiled and a plain form; calls use the one that suits the work."""

    def __init__(
        self, function: Callable[..., Any], plain: Callable[..., Any] | str | None, options: Any
    ) -> None:
        functools.update_wrapper(self, function)
        self.function = function
        self.has_plain_caller = plain == IN_CALLER
        self.plain = function if plain == AS_WRITTEN else None if isinstance(plain, str) else plain
        """The twin; None if the kernel needs Numba."""
        self.options = options

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Call the plain twin in small work and without Numba, else the compiled function."""
        try:
            if named:
                arguments = inspect.signature(self.function).bind(*arguments, **named).args
            return self._call_form(*arguments)
        except DechirpError:
            raise
        except Exception as error:
            self._explain_error(error, arguments, named)
            raise

    def _explain_error(
        self, error: Exception, arguments: tuple[Any, ...], named: dict[str, Any]
    ) -> None:
        """Raise `InvalidSetting` if the error is one of the arguments, and name it."""
        from dechirp.core.annotations import check_annotations
        from dechirp.core.argument_types import check_argument_names

        signature = inspect.signature(self.function)
        check_argument_names(signature, self.function.__name__, arguments, named)
        values = signature.bind(*arguments).arguments if arguments else named
        check_annotations(self.function, values, setting="{}", error=error)

    def _call_form(self, *arguments: Any) -> Any:
        if uses_compiled_kernels():
            return self.dispatcher(*arguments)
        if self.plain is not None:
            import numpy as np  # here, as the command line imports this module

            with np.errstate(all="ignore"):  # as in compiled code
                return self.plain(*arguments)
        if not can_compile():
            raise InvalidSetting(
                self.__qualname__,
                value=f"a compiled loop of {self.__module__}, without Numba",
                expected="Numba, and NUMBA_DISABLE_JIT unset: this loop has no plain form",
                fix="run pip install numba, or unset NUMBA_DISABLE_JIT",
            )
        return self.dispatcher(*arguments)

    @cached_property
    def dispatcher(self) -> Any:
        """The function as Numba's dispatcher, compiled for each signature when called with it."""
        dispatcher = _import_numba().njit(**self.options)(self.function)
        # Numba keeps compiled code while the function's own file is unchanged. But it contains that
        # of called kernels and intrinsics, and values of constants, which other files define.
        cache_file = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
        if cache_file is not None:
            cache_file._source_stamp = (cache_file._source_stamp, self._read_stamp())
        return dispatcher

    def _read_stamp(self) -> tuple[Any, ...]:
        """Return times and sizes of the files that the kernel uses, and values of its constants.

        Those of the kernels that it calls, at any depth, are included. The stamp is equal in all
        processes, and in a copy of the folder with its cache. Files of other packages are left out,
        since they differ between environments that share a cache. Constants read from a module as
        its attributes are not covered, nor what the files that an intrinsic uses import themselves.
        """
        paths, constants = set[str](), dict[tuple[str, str], Any]()
        kernels, remaining = {self}, [self]
        while remaining:
            function = remaining.pop().function
            module = function.__module__
            paths.add(function.__code__.co_filename)
            for name in _list_names(function.__code__) & function.__globals__.keys():
                value = function.__globals__[name]
                if isinstance(value, Kernel):
                    if value not in kernels:
                        kernels.add(value)
                        remaining.append(value)
                elif (constant := _encode_constant(value)) is not None:
                    constants[module, name] = constant
                else:
                    paths |= _find_files(value, module.partition(".")[0])
        return (*map(_read_file_stamp, sorted(paths)), *sorted(constants.items()))

    @property
    def used_dispatcher(self) -> Any:
        """The dispatcher if the compiled form has been used, else None."""
        return self.__dict__.get("dispatcher")

    def __getattr__(self, name: str) -> Any:
        # Numba reads these of a function that another one calls, to inline it.
        if name in ("targetoptions", "py_func"):
            return getattr(self.dispatcher, name)
        raise AttributeError(name)


def _list_names(code: CodeType) -> set[str]:
    """Return the names of globals and attributes in a function and the functions inside it."""
    inner = (_list_names(part) for part in code.co_consts if isinstance(part, CodeType))
    return set(code.co_names).union(*inner)


def _encode_constant(value: Any) -> Any:
    """Return a number, text, array or tuple of these exactly, in built-in types; else None."""
    import numpy as np  # here, as the command line imports this module

    if isinstance(value, tuple):
        return tuple(map(_encode_constant, value))
    if isinstance(value, np.ndarray | np.generic):
        return value.dtype.str, value.shape, value.tobytes()
    return repr(value) if isinstance(value, int | float | complex | str) else None


def _find_files(value: Any, package: str) -> set[str]:
    """Return the files of a function or class of a package, and of the functions that those use.

    Nothing for other values. An intrinsic is made of functions of other files.
    """
    module = _find_module(value, package)
    modules = {module, *(_find_module(used, package) for used in vars(module or object).values())}
    return {file for used in modules if (file := getattr(used, "__file__", None)) is not None}


def _find_module(value: Any, package: str) -> ModuleType | None:
    name = str(getattr(value, "__module__", ""))
    return sys.modules.get(name) if name.partition(".")[0] == package else None


def _read_file_stamp(path: str) -> tuple[float, int] | None:
    """Return the modification time and size of a file; None if it is unreadable."""
    try:
        stat = Path(path).stat()
    except OSError:
        return None
    return stat.st_mtime, stat.st_size


def kernel(
    *,
    plain: Callable[..., Any] | str | None = None,
    cache: bool = True,
    nogil: bool = True,
    error_model: str = "numpy",
    **options: Any,
) -> Callable[[F], F]:
    """Return a decorator that makes a kernel of a function, with options of `numba.njit`.

    `plain` is a function of the same arguments and results in NumPy and SciPy, AS_WRITTEN or
    IN_CALLER. Kernels that only other compiled kernels call need none.
    """
    options |= {"cache": cache, "nogil": nogil, "error_model": error_model}

    def make_kernel(function: F) -> F:
        return cast(F, Kernel(function, plain, options))

    return make_kernel


@cache
def can_compile() -> bool:
    """Return True if Numba is installed and not switched off by NUMBA_DISABLE_JIT."""
    is_off = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")
    return not is_off and importlib.util.find_spec("numba") is not None


def uses_compiled_kernels() -> bool:
    """Return True if kernels that have a plain twin are called in their compiled form."""
    return not _uses_plain_twins.get() and can_compile()


def is_small_work() -> bool:
    """Return True within work so small that loading compiled code would take longer than it."""
    return bool(_uses_plain_twins.get())


@contextmanager
def plain_twins_for_small_work(n_samples: float) -> Iterator[None]:
    """Use plain twins inside the block if it processes few samples, see MAX_PLAIN_SAMPLES.

    An enclosing block for more samples decides for those within it.
    """
    is_within_large_work = _uses_plain_twins.get() is False
    token = _uses_plain_twins.set(not is_within_large_work and n_samples <= MAX_PLAIN_SAMPLES)
    try:
        yield
    finally:
        _uses_plain_twins.reset(token)


@contextmanager
def plain_twins_in_first_calls(n_samples: float) -> Iterator[None]:
    """Use plain twins inside the block until the calls of the process have processed many samples.

    A script of few calls thus ends before the compiled kernels are loaded, and a program of many
    calls loses 0.6 s at most: MAX_PLAIN_SAMPLES counts the samples of all calls together. An
    enclosing block decides for the calls within it.
    """
    if _uses_plain_twins.get() is not None:
        yield
        return
    _calls.n_samples += n_samples
    with plain_twins_for_small_work(_calls.n_samples):
        yield


def count_called_samples(n_samples: float) -> None:
    """Add work that a call turned out to take, so that crowded frames use few plain twins."""
    _calls.n_samples += n_samples


def use_compiled_kernels() -> None:
    """Use compiled kernels from the first call on: in trials, which must not depend on others."""
    _calls.n_samples = math.inf


@contextmanager
def compiled_kernels_for_large_work(n_samples: float) -> Iterator[None]:
    """Use compiled kernels inside the block if it processes many samples; else change nothing."""
    token = _uses_plain_twins.set(
        False if n_samples > MAX_PLAIN_SAMPLES else _uses_plain_twins.get()
    )
    try:
        yield
    finally:
        _uses_plain_twins.reset(token)


@cache
def _log_first_compilation() -> None:
    """Report once for each process why a call takes long: hundreds of loops follow each other.

    In an interactive session or at a terminal, without a log and without a listener, on standard
    error: a command and the studio have a listener, and programs read their own output.
    """
    _LOGGER.info(_COMPILING)
    is_watched = hasattr(sys, "ps1") or (sys.stderr is not None and sys.stderr.isatty())
    if is_watched and not compilation_listeners and not _LOGGER.isEnabledFor(logging.INFO):
        print(f"dechirp: {_COMPILING}", file=sys.stderr)


@cache
def _import_numba() -> Any:
    import numba
    from numba.core import event
    from numba.extending import typeof_impl

    class Forwarder(event.Listener):
        def on_start(self, event: object) -> None:
            _log_first_compilation()
            for listener in compilation_listeners:
                listener.start_compilation()

        def on_end(self, event: object) -> None:
            for listener in compilation_listeners:
                listener.end_compilation()

    event.register("numba:compile", Forwarder())  # type: ignore[no-untyped-call]

    @typeof_impl.register(Kernel)
    def type_of_kernel(kernel: Kernel, context: Any) -> Any:  # in the code of other kernels
        return typeof_impl(kernel.dispatcher, context)

    return numba

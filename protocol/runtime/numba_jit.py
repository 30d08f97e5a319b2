"""How kernels are compiled: ahead of the loop, and where their machine code is kept.

A kernel is a function of numbers and contiguous arrays in a module named ``*_kernels.py``. It is
compiled for one signature, that of its annotations, when its module is imported, or loaded from
the cache if it was compiled before; every call refuses a wrong type.

numba notices a change of a kernel's own file, not of the helpers that it calls. The cache
directory is therefore named by a hash of everything that flows into machine code: all kernel
sources, this file, and the versions and the processor that compile them. What a kernel takes from
elsewhere in these packages must stand in a file that matches ``SOURCES``; other people's kernels
may use these decorators if their helpers stand in the same file.

Machine code is loaded unchecked, so its directory belongs to one user alone (mode 0700):
``$HOAP3_CACHE_DIR``, else ``$XDG_CACHE_HOME/hoap3``, else ``~/.cache/hoap3``. Where that cannot be
had, a fresh temporary directory serves until the process ends.
"""

from __future__ import annotations

import atexit
import hashlib
import importlib
import os
import pickle
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, TypeAlias, TypeVar, cast, get_args, get_origin, get_type_hints

import llvmlite.binding  # type: ignore[import-untyped]
import numba
import numpy as np
from numba.core import sigutils
from numba.core.caching import UserProvidedCacheLocator
from numpy.typing import NDArray

from hoap3.protocol.runtime.private_directory import is_private

HOUSE = Path(__file__).resolve().parents[2]
ROOMS = ("protocol", "remote_controller", "robot_emulator", "tools")
SOURCES = ("*_kernels.py", "status.py")

_config: Any = numba.config
_types: Any = numba.types
_parse: Any = sigutils.normalize_signature

Function = TypeVar("Function", bound=Callable[..., Any])

Vector: TypeAlias = Annotated[NDArray[np.float64], "f8[::1]"]
Matrix: TypeAlias = Annotated[NDArray[np.float64], "f8[:,::1]"]
Cube: TypeAlias = Annotated[NDArray[np.float64], "f8[:,:,::1]"]
Indices: TypeAlias = Annotated[NDArray[np.int64], "i8[::1]"]
NUMBERS = {int: "i8", float: "f8", bool: "b1", type(None): "void"}


def signature_of(function: Callable[..., Any]) -> Any:
    """The signature that a function's annotations say, as numba has it.

    A ``NamedTuple`` hands over what belongs together under one name, one annotation a field; it
    costs a call between kernels nothing.

    Raises:
        TypeError: an annotation is neither a number's type, nor a tuple of these, nor one of the
            arrays above, nor another ``Annotated`` with numba's word for it, nor a ``NamedTuple``
            of such fields.
    """

    def typed(annotation: Any) -> Any:
        if get_origin(annotation) is tuple:
            return _types.Tuple([typed(each) for each in get_args(annotation)])
        if isinstance(annotation, type) and hasattr(annotation, "_fields"):
            fields = get_type_hints(annotation, include_extras=True).values()
            return _types.BaseTuple.from_types([typed(f) for f in fields], annotation)
        word = NUMBERS.get(annotation) or getattr(annotation, "__metadata__", [None])[0]
        if word is None:
            raise TypeError(f"{function.__name__}: a kernel's annotation cannot be {annotation}")
        (found,), _ = _parse(f"({word},)")
        return found

    hints = get_type_hints(function, include_extras=True)
    returned = typed(hints.pop("return"))
    return returned(*(typed(each) for each in hints.values()))


def kernel(
    signature: str | None = None,
    *,
    superwords: bool = False,
    allocates: bool = False,
    **options: Any,
) -> Callable[[Function], Function]:
    """Compile a function for one signature, now, or load it from the cache.

    The bits of its result depend on nothing but its arguments: no ``fastmath``, no ``parallel``.
    Division by zero follows IEEE 754. With ``NUMBA_DISABLE_JIT=1`` the function stays plain Python
    and gives the same bits, but there a float divided by zero raises: kernels avoid it.

    Args:
        signature: numba's notation, such as ``"f8(f8[::1], f8)"``; that of the annotations by
            default.
        superwords: whether equal operations that stand beside each other become one vector
            instruction, as loops do in any case. The bits are the same.
        allocates: whether the function, or a helper of it, makes arrays, as copying one slice to
            another does. Where it does not, nobody counts references to those it is given, which
            the caller holds anyway: a fifth of a call of 1 us.
        options: further options of ``numba.njit``, such as ``nogil=True``.

    Raises:
        TypeError: an option would make the bits depend on more than the arguments; or the function
            returns arrays and does not say that it makes any.
        numba.core.errors.NumbaError: numba cannot compile the function; with a note where it may be
            that it makes arrays and does not say so.
    """
    unfit = options.keys() & {"fastmath", "parallel"}
    if unfit:
        raise TypeError(f"a kernel takes no {', '.join(sorted(unfit))}: its bits must not vary")

    def compiled(function: Function) -> Function:
        def build(cache: bool) -> Any:
            settings = {"error_model": "numpy", "_nrt": allocates, **options}
            words = signature_of(function) if signature is None else signature
            compile_now = numba.njit(words, cache=cache, **settings)
            with _configured(SLP_VECTORIZE=int(superwords)):
                try:
                    built = compile_now(function)
                except numba.core.errors.NumbaError as error:
                    if not allocates:
                        error.add_note(
                            "A kernel that makes arrays, or copies slices, needs allocates=True."
                        )
                    raise
            if not allocates:
                _refuse_arrays(built)
            return built

        if CACHE_DIRECTORY is None:
            return cast(Function, build(cache=False))
        try:
            with _configured(CACHE_DIR=str(CACHE_DIRECTORY), CACHE_LOCATOR_CLASSES=LOCATOR):
                return cast(Function, build(cache=True))
        except (OSError, EOFError, pickle.UnpicklingError):  # disk full, or a file cut off by it
            return cast(Function, build(cache=False))

    return compiled


class KernelLocator(UserProvidedCacheLocator):
    """Place of a kernel in the cache directory, by its place in the package.

    numba's own locator uses the path of the source file, so that each installation would compile
    the same kernels. The hash of the source, by which numba checks an entry, stays.
    """

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """Folder of the kernels of a file; of other people's files by their path."""
        folder = Path(py_file).resolve().parent
        if any(folder.is_relative_to(HOUSE / room) for room in ROOMS):
            return "_".join(folder.relative_to(HOUSE).parts)
        elsewhere = super().get_suitable_cache_subpath(py_file)  # type: ignore[no-untyped-call]
        return str(elsewhere)


LOCATOR = f"{__name__}.{KernelLocator.__name__}"


def _refuse_arrays(built: Any) -> None:
    """Without counted references an array that is handed back would be the one it is a part of."""
    for signature in getattr(built, "nopython_signatures", ()):
        if "rray(" in str(signature.return_type):
            raise TypeError(f"a kernel that returns {signature.return_type} needs allocates=True")


def inlined(function: Function) -> Function:
    """Mark a helper that kernels call: it becomes a part of each of them.

    It is compiled with the first kernel that calls it and never on its own, so loading a cached
    kernel costs it nothing. From Python call a kernel instead.
    """
    return cast(Function, numba.njit(error_model="numpy", forceinline=True)(function))


def warm_up(modules: Iterable[str], report: Callable[[str], None] | None = None) -> None:
    """Import kernel modules one by one, which compiles them or loads them from the cache.

    Args:
        modules: full names, such as ``"hoap3.remote_controller.solvers.qp12.qp12_kernels"``.
        report: is told each name before its module is imported; a first compilation takes
            seconds.
    """
    for name in modules:
        if report is not None:
            report(name)
        importlib.import_module(name)


def fingerprint() -> str:
    """Hash of everything that flows into machine code, 16 hexadecimal digits."""
    digest = hashlib.sha256(Path(__file__).read_bytes())
    for room in ROOMS:
        for path in sorted(path for kind in SOURCES for path in (HOUSE / room).rglob(kind)):
            digest.update(str(path.relative_to(HOUSE)).encode() + b"\0" + path.read_bytes())
    processor = _config.CPU_NAME or llvmlite.binding.get_host_cpu_name()
    digest.update(f"{numba.__version__} {sys.version} {processor}".encode())
    return digest.hexdigest()[:16]


def cache_directory() -> Path | None:
    """Where machine code is kept; None where not even a temporary directory can be made."""
    kept = _base() / f"kernels-{fingerprint()}"
    if kept.is_absolute() and is_private(kept):
        return kept
    try:
        fresh = tempfile.mkdtemp(prefix="hoap3-kernels-")
    except OSError:
        return None
    atexit.register(_remove, fresh, os.getpid())
    return Path(fresh)


def _base() -> Path:
    own = os.environ.get("HOAP3_CACHE_DIR")
    if own:
        return Path(own).absolute()
    shared = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if not shared.is_absolute():  # the XDG specification has relative paths ignored
        shared = Path(os.path.expanduser("~/.cache"))  # stays "~/.cache" for a user without home
    return shared / "hoap3"


def _remove(path: str, process: int) -> None:
    """Remove a temporary directory, but not at the end of a fork of the process that made it."""
    if os.getpid() == process:
        shutil.rmtree(path, ignore_errors=True)


@contextmanager
def _configured(**values: Any) -> Iterator[None]:
    """Have numba compile with these settings here, and other people's code with theirs."""
    before = {name: getattr(_config, name) for name in values}
    vars(_config).update(values)
    try:
        yield
    finally:
        vars(_config).update(before)


CACHE_DIRECTORY = cache_directory()

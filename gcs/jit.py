"""How kernels are compiled, how to write them so that it takes seconds, and how to have them ready in time.

numba compiles a kernel at its first call and keeps the result in a cache on disk; the first start after an
installation waits for it. What costs time is not the loops. It is

- functions: each is typed and lowered by itself, once for every combination of argument types (a literal `0`
  or `False` is a type of its own). numba would also optimise each and turn it into machine code, by itself
  and once more within all that call it, and these within their callers. Here a part is optimised in kernels
  alone, and a kernel that another kernel calls is linked as it is: a quarter less to compile. What is called
  in one place is best inlined; and each array that a call hands on is seven arguments: a record of a dozen
  takes a tenth of a microsecond, so what is called for each object is `spliced` into its callers;
- numpy: `sort`, `argsort`, `diff`, `searchsorted`, `max`, array expressions and fancy indexing are compiled
  from numba's Python sources for each element type, in a tenth of a second to a second. An array assigned to
  a slice takes 1.7 s: it may fail, and its message is put together by compiled string functions. A loop takes
  milliseconds; `empty`, `zeros` and a scalar assigned to a slice are cheap;
- arrays handed about: slices, tuples of arrays, records with many fields.

What costs time when a kernel runs is, besides its work, counting who refers to which array. numba counts at
every assignment of an array or of a record of arrays, also where a function is inlined, and each time is an
atomic operation: in a loop over small things these took three quarters of the time. So a kernel makes its
arrays, room to work in among them, and leaves its loops to a `leaf`, which counts nothing. Nor does a leaf
ask at every access whether an index is negative and counts from the end of the array: that was a sixth of
its time. An index below zero is out of bounds in a leaf, and as little noticed as one beyond the end; tests
run with NUMBA_BOUNDSCHECK=1 and an empty NUMBA_CACHE_DIR notice both.

A later start reads kernels from the cache. numba would first prepare to compile all the same, a tenth of a
second; `_Cache` leaves that to the kernel that is not there.

numba's cache does not see other files change. Whoever edits a kernel that kernels of another file call must
remove the `__pycache__` of that file.

A room that has kernels lists one call of each in `warm_up_calls`, with types as in flight; and those that
only other kernels call, the parts of these, in `warm_up_parts`. Where the cache is cold, parts are compiled
first, and a second process goes through all the rooms that are wanted from the last call to the first: each
of the two finds in the cache on disk what the other has put there, and they meet somewhere in the middle.
numba replaces the cache's files atomically, so what both compile at once is written twice, no more; and if
the helper fails, it is only missed.
"""

from __future__ import annotations

import contextlib
import copy
import functools
import gc
import importlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeAlias, cast

import numba
import numpy as np
from numba import _dynfunc
from numba.core import types
from numba.core.caching import FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.runtime import rtsys
from numba.extending import intrinsic

Call: TypeAlias = tuple[Any, ...]
"""A kernel and its arguments."""

ZERO = cast(int, np.int64(0))
"""Where a count begins that is handed on: a literal 0 has a type of its own, for which all that takes it, and
all that this calls, would be compiled once more."""

_COLLECT_AFTER = 100_000
"""Objects allocated between garbage collections while compiling: with the usual 700 these cost an eighth."""

_OPTIONS = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}

_FROM_KERNELS = {"no_cpython_wrapper": True, **_OPTIONS}
"""What Python never calls need not take Python's arguments apart: an eighth of compiling."""


class _Cache(FunctionCache):  # type: ignore[misc]
    """numba's cache, without preparing to compile before it is known that there is something to compile."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what is kept for a signature, or None: then it is compiled."""
        rtsys.initialize(target_context)  # what compiled code calls; all the rest is for the compiler
        try:
            with self._guard_against_spurious_io_errors():
                found = self._load_overload(sig, target_context)
                if found is not None:
                    found.library.is_kernel = True
                return found
        except (AttributeError, ImportError):
            # Another version of this package left it, in which something that it names was elsewhere.
            self.flush()
            return None


class _PartLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Code that kernels take over: it is optimised, and turned into machine code, in them alone."""

    def get_pointer_to_function(self, name: str) -> int:  # noqa: ARG002  numba's signature
        """Return 0: nothing in it can be called by its address."""
        self._ensure_finalized()
        return 0

    def _optimize_final_module(self) -> None:
        """Leave it to the kernels."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _KernelLibrary(JITCodeLibrary):  # type: ignore[misc]
    """A kernel's code: parts are optimised with it; other kernels that it calls are optimised already."""

    is_kernel = True
    _linking_libraries: list[Any]
    _kernels: Sequence[Any] = ()

    def finalize(self) -> None:
        """Link parts, optimise, link other kernels, and turn all into machine code."""
        libraries = dict.fromkeys(self._linking_libraries)
        self._kernels = [one for one in libraries if getattr(one, "is_kernel", False)]
        self._linking_libraries = [one for one in libraries if one not in self._kernels]
        super().finalize()

    def _optimize_final_module(self) -> None:
        super()._optimize_final_module()
        for library in self._kernels:
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)


class _Codegen:
    """numba's code generator, making libraries of another kind."""

    def __init__(self, codegen: Any, kind: Any) -> None:
        self._codegen, self._kind = codegen, kind

    def create_library(self, name: str, **options: Any) -> Any:
        """Return an empty library."""
        return self._kind(self._codegen, name, **options)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)


class _Kernel(Compiler):  # type: ignore[misc]
    """Compiles what is called from Python."""

    library_kind = _KernelLibrary

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        target = copy.copy(self.state.targetctx)
        target.cached_internal_func = {}
        target._internal_codegen = _Codegen(target._internal_codegen, self.library_kind)
        self.state.targetctx = target


class _Part(_Kernel):
    """Compiles what only kernels call."""

    library_kind = _PartLibrary

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.state.targetctx.get_executable = _nothing_to_execute


class _PlainIndices(_Part):
    """Compiles parts in which no index counts from the end."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        _distinguish_plain_indices()
        self.state.targetctx.plain_indices = True


def _nothing_to_execute(library: Any, fndesc: Any, env: Any) -> Any:
    """Return what numba keeps for a compiled function, without an address."""
    library.get_pointer_to_function(fndesc.llvm_cpython_wrapper_name)
    return _dynfunc.make_function(fndesc.lookup_module(), fndesc.qualname, "", 0, env, (library,))


@functools.cache
def _distinguish_plain_indices() -> None:
    """Have numba take indices as they are, in what `_PlainIndices` compiles and nowhere else."""
    from numba.np import arrayobj

    from_either_end = getattr(arrayobj, "fix_integer_index", None)
    if from_either_end is None:
        return  # another numba: leaves are only slower

    def fix(context: Any, builder: Any, kind: Any, index: Any, size: Any) -> Any:
        if kind.signed and getattr(context, "plain_indices", False):
            return context.cast(builder, index, kind, types.intp)
        return from_either_end(context, builder, kind, index, size)

    arrayobj.fix_integer_index = fix


def kernel(function: Any) -> Any:
    """Compile what is called from Python; it is kept in the cache with all that it calls."""
    compiled = numba.njit(pipeline_class=_Kernel, **_OPTIONS)(function)
    compiled._cache = _Cache(function)
    return compiled


called = numba.njit(pipeline_class=_Part, **_FROM_KERNELS)
"""Called from kernels alone, in more than one place."""

leaf = numba.njit(_nrt=False, pipeline_class=_PlainIndices, **_FROM_KERNELS)
"""Called from kernels alone, makes no arrays: nothing in it counts references, or indices from the end."""

spliced = numba.njit(_nrt=False, pipeline_class=_PlainIndices, forceinline=True, **_FROM_KERNELS)
"""A leaf that is called for each object: compiled once, and then put into what calls it."""

inlined = numba.njit(inline="always", **_OPTIONS)
"""Becomes part of the function that calls it, at every call."""


@intrinsic  # type: ignore[untyped-decorator]
def prefetch_row(typing: Any, array: Any, row: Any) -> Any:  # noqa: ARG001  numba's signature
    """Have the processor load a row of a matrix that is needed some hundred instructions from now."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        from llvmlite import ir
        from numba.core.cgutils import unpack_tuple
        from numba.np.arrayobj import make_array

        matrix = make_array(signature.args[0])(context, builder, args[0])
        stride = unpack_tuple(builder, matrix.strides)[0]
        byte, flag = ir.IntType(8).as_pointer(), ir.IntType(32)
        at = builder.gep(builder.bitcast(matrix.data, byte), [builder.mul(stride, args[1])])
        kind = ir.FunctionType(ir.VoidType(), [byte, flag, flag, flag])
        fetch = builder.module.declare_intrinsic("llvm.prefetch", [byte], kind)
        builder.call(fetch, [at, flag(0), flag(3), flag(1)])
        return context.get_dummy_value()

    return types.void(array, row), code


def warm_up(*rooms: str, on_compiled: Callable[[str, int, int], None] | None = None) -> None:
    """Load the kernels of rooms (names of modules) from the cache or, with a helper process, compile them.

    `on_compiled` is called with a room and "n of m" when its kernels are not in the cache: first after the
    first one, which is a short one, was compiled.
    """
    with contextlib.ExitStack() as stack:
        has_helper = False
        for number, room in enumerate(rooms):
            calls = _calls(room)
            probe = calls[0][0]
            before = _misses(probe)
            _make(calls[:1])
            if _misses(probe) == before:
                _make(calls[1:])
                continue
            if not has_helper:
                stack.enter_context(_helper(rooms[number:]))
                has_helper = True
            told = None if on_compiled is None else functools.partial(on_compiled, room)
            _make([*_parts(room), *calls[1:]], told)


@contextlib.contextmanager
def _helper(rooms: Sequence[str]) -> Iterator[None]:
    """Compile from the other end in a process of its own, with the same packages, until the block ends."""
    helper = None
    with contextlib.suppress(OSError):
        helper = subprocess.Popen(  # noqa: S603  ourselves
            [sys.executable, "-P", "-m", "gcs.jit", *rooms],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
    try:
        yield
    finally:
        if helper is not None:
            helper.terminate()
            helper.wait()


def _calls(room: str) -> Sequence[Call]:
    return cast(Sequence[Call], importlib.import_module(room).warm_up_calls())


def _parts(room: str) -> Sequence[Call]:
    return cast(Sequence[Call], getattr(importlib.import_module(room), "warm_up_parts", list)())


def _misses(probe: Any) -> int:
    return sum(probe.stats.cache_misses.values())


def _make(calls: Sequence[Call], on_made: Callable[[int, int], None] | None = None) -> None:
    thresholds = gc.get_threshold()
    gc.set_threshold(max(_COLLECT_AFTER, thresholds[0]), *thresholds[1:])
    try:
        for number, (compiled, *arguments) in enumerate(calls, 1):
            if on_made is not None:
                on_made(number, len(calls) + 1)
            compiled(*arguments)
    finally:
        gc.set_threshold(*thresholds)


if __name__ == "__main__":
    for last in sys.argv[:0:-1]:
        _make(_parts(last)[::-1])
        _make(_calls(last)[::-1])

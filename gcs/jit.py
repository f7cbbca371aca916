"""Compilation of kernels with numba: decorators, cache and warm-up.

numba compiles a kernel at its first call and caches it on disk. Five decorators say how a function is used:

- `kernel`: called from Python, cached with all that it calls.
- `called`: called from kernels only, in more than one place.
- `leaf`: called from kernels only, makes no arrays. It counts no references.
- `spliced`: a leaf that is called for each object; LLVM inlines it.
- `inlined`: becomes part of its caller before compilation.

Rules that keep compilation short:

- Each function is typed and lowered once for every combination of argument types. A literal `0` or `False`
  is a type of its own: pass `ZERO`. Inline what is called in one place.
- An array argument is seven machine arguments: do not pass records of many arrays to small functions.
- numpy's `sort`, `argsort`, `searchsorted`, array expressions and fancy indexing are compiled from Python
  for each type, in 0.1 s to 1 s. Assigning an array to a slice takes 1.7 s. Loops take milliseconds;
  `empty`, `zeros` and scalar assignment to a slice are cheap.

Rules that keep kernels fast: numba counts references at every assignment of an array or record, also in
inlined functions. So a kernel allocates its arrays and leaves loops to a leaf. Run the tests with
NUMBA_BOUNDSCHECK=1 and an empty NUMBA_CACHE_DIR to find an index out of bounds.

numba does not notice changes of other files. After an edit of a function that kernels of another file call,
remove the `__pycache__` of that file.

A module with kernels lists one call of each in `warm_up_calls`, with the types in use, and the kernels that
these call in `warm_up_parts`. On a cold cache parts are compiled first, and a helper process compiles all
modules from the other end. Both share the cache on disk, whose files numba replaces atomically. Why
internals of numba are used: decision 28.
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
from typing import Any, TypeAlias, TypeVar, cast

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

FunctionT = TypeVar("FunctionT", bound=Callable[..., Any])

int64 = cast(Callable[[Any], int], np.int64)
"""numpy's int64, as what it is in kernels: a conversion to an integer."""

ZERO = int64(0)
"""Start of a counter that is passed on: a literal 0 would compile its callees once more."""

_COLLECT_AFTER = 100_000
"""Objects allocated between garbage collections while compiling; the usual 700 cost an eighth."""

_KERNEL_OPTIONS = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}

_PART_OPTIONS = {"no_cpython_wrapper": True, **_KERNEL_OPTIONS}
"""Without the wrapper that unpacks arguments from Python: an eighth of compilation."""


class _KernelCache(FunctionCache):  # type: ignore[misc]
    """numba's cache, which loads a kernel before it initialises the compiler (0.1 s a start)."""

    def has_code(self) -> bool:
        """Return True if there is code of this version of the function; it may be of another processor."""
        try:
            return bool(self._cache_file._load_index())
        except (AttributeError, ImportError):  # as below
            return False

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the cached code for a signature, or None."""
        rtsys.initialize(target_context)  # the runtime of compiled code, without the compiler
        try:
            with self._guard_against_spurious_io_errors():
                found = self._load_overload(sig, target_context)
                if found is not None:
                    found.library.is_kernel = True
                return found
        except (AttributeError, ImportError):
            # An older version of this package wrote it, with names that have moved since.
            self.flush()
            return None


class _PartLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Code of a part: optimised and turned into machine code in kernels alone."""

    def get_pointer_to_function(self, name: str) -> int:  # noqa: ARG002  numba's signature
        """Return 0: a part has no address."""
        self._ensure_finalized()
        return 0

    def _optimize_final_module(self) -> None:
        """Do nothing: kernels optimise it."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _KernelLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Code of a kernel: parts are optimised with it; other kernels are optimised already."""

    is_kernel = True
    _linking_libraries: list[Any]
    _kernels: Sequence[Any] = ()

    def finalize(self) -> None:
        """Link parts, optimise, link other kernels, and generate machine code."""
        libraries = dict.fromkeys(self._linking_libraries)
        self._kernels = [one for one in libraries if getattr(one, "is_kernel", False)]
        self._linking_libraries = [one for one in libraries if one not in self._kernels]
        super().finalize()

    def _optimize_final_module(self) -> None:
        super()._optimize_final_module()
        for library in self._kernels:
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)


class _Codegen:
    """numba's code generator with another class of libraries."""

    def __init__(self, codegen: Any, kind: Any) -> None:
        self._codegen = codegen
        self._kind = kind

    def create_library(self, name: str, **options: Any) -> Any:
        """Return an empty library."""
        return self._kind(self._codegen, name, **options)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)


class _KernelCompiler(Compiler):  # type: ignore[misc]
    """Compiler of functions that Python calls."""

    library_kind = _KernelLibrary

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        target = copy.copy(self.state.targetctx)
        target.cached_internal_func = {}
        target._internal_codegen = _Codegen(target._internal_codegen, self.library_kind)
        self.state.targetctx = target


class _PartCompiler(_KernelCompiler):
    """Compiler of functions that only kernels call."""

    library_kind = _PartLibrary

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.state.targetctx.get_executable = _unexecutable


def _unexecutable(library: Any, fndesc: Any, env: Any) -> Any:
    """Return numba's function object without an address."""
    library.get_pointer_to_function(fndesc.llvm_cpython_wrapper_name)
    return _dynfunc.make_function(fndesc.lookup_module(), fndesc.qualname, "", 0, env, (library,))


def kernel(function: FunctionT) -> FunctionT:
    """Compile a function that Python calls, and cache it with all that it calls."""
    compiled = numba.njit(pipeline_class=_KernelCompiler, **_KERNEL_OPTIONS)(function)
    compiled._cache = _KernelCache(function)
    return cast(FunctionT, compiled)


def called(function: FunctionT) -> FunctionT:
    """Compile a function that only kernels call, in more than one place."""
    return cast(FunctionT, numba.njit(pipeline_class=_PartCompiler, **_PART_OPTIONS)(function))


def leaf(function: FunctionT) -> FunctionT:
    """Compile a function that only kernels call and that makes no arrays: it counts no references."""
    return cast(FunctionT, numba.njit(_nrt=False, pipeline_class=_PartCompiler, **_PART_OPTIONS)(function))


def spliced(function: FunctionT) -> FunctionT:
    """Compile a leaf that is called for each object: LLVM inlines it."""
    options = {"_nrt": False, "forceinline": True, **_PART_OPTIONS}
    return cast(FunctionT, numba.njit(pipeline_class=_PartCompiler, **options)(function))


def inlined(function: FunctionT) -> FunctionT:
    """Make a function part of each function that calls it, before compilation."""
    return cast(FunctionT, numba.njit(inline="always", **_KERNEL_OPTIONS)(function))


@intrinsic  # type: ignore[untyped-decorator]
def prefetch_row(typing: Any, array: Any, row: Any) -> Any:  # noqa: ARG001  numba's signature
    """Prefetch a row of a matrix that is needed some hundred instructions later."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        from llvmlite import ir
        from numba.core.cgutils import unpack_tuple
        from numba.np.arrayobj import make_array

        matrix = make_array(signature.args[0])(context, builder, args[0])
        stride = unpack_tuple(builder, matrix.strides)[0]
        byte = ir.IntType(8).as_pointer()
        flag = ir.IntType(32)
        at = builder.gep(builder.bitcast(matrix.data, byte), [builder.mul(stride, args[1])])
        kind = ir.FunctionType(ir.VoidType(), [byte, flag, flag, flag])
        fetch = builder.module.declare_intrinsic("llvm.prefetch", [byte], kind)
        builder.call(fetch, [at, flag(0), flag(3), flag(1)])
        return context.get_dummy_value()

    return types.void(array, row), code


@intrinsic  # type: ignore[untyped-decorator]
def call_c(typing: Any, address: Any, to: Any, row: Any, source: Any, at: Any, count: Any) -> Any:  # noqa: ARG001  numba's signature
    """Call a C function with pointers to a row of a matrix and to an element of an array, and a number.

    A function with fewer parameters ignores the last.
    """

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        from llvmlite import ir
        from numba.core.cgutils import unpack_tuple
        from numba.np.arrayobj import make_array

        byte = ir.IntType(8).as_pointer()
        matrix, array = (make_array(signature.args[k])(context, builder, args[k]) for k in (1, 3))
        pointers = []
        for buffer, index in ((matrix, args[2]), (array, args[4])):
            stride = unpack_tuple(builder, buffer.strides)[0]
            first = builder.bitcast(buffer.data, byte)
            pointers.append(builder.gep(first, [builder.mul(stride, index)]))
        kind = ir.FunctionType(ir.VoidType(), [byte, byte, args[5].type]).as_pointer()
        builder.call(builder.inttoptr(args[0], kind), [*pointers, args[5]])
        return context.get_dummy_value()

    return types.void(address, to, row, source, at, count), code


def warm_up(*modules: str, on_compiled: Callable[[str, int, int], None] | None = None) -> None:
    """Load the kernels of modules (names) from the cache, or compile them with a helper process.

    Unless all kernels of a module are in the cache, `on_compiled` is called with it and "n of m" before each.
    """
    with contextlib.ExitStack() as stack:
        has_helper = False
        for number, module in enumerate(modules):
            calls = _warm_up_calls(module)
            if is_cached(module):
                _call_all(calls[1:])
                continue
            if not has_helper:
                stack.enter_context(_helper_process(modules[number:]))
                has_helper = True
            report = None if on_compiled is None else functools.partial(on_compiled, module)
            _call_all([*_warm_up_parts(module), *calls], report)


def is_cached(module: str) -> bool:
    """Return True if the kernels of a module are in the cache.

    The first, a short one, is loaded: it is compiled if the cache is of another processor.
    """
    first, *others = _warm_up_calls(module)
    if not all(compiled._cache.has_code() for compiled, *_ in (first, *others)):
        return False
    before = _misses(first[0])
    _call_all([first])
    return _misses(first[0]) == before


@contextlib.contextmanager
def _helper_process(modules: Sequence[str]) -> Iterator[None]:
    """Compile from the other end in another process, until the block ends."""
    helper = None
    with contextlib.suppress(OSError):
        helper = subprocess.Popen(  # noqa: S603  ourselves
            [sys.executable, "-P", "-m", "gcs.jit", *modules],
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


def _warm_up_calls(module: str) -> Sequence[Call]:
    return cast(Sequence[Call], importlib.import_module(module).warm_up_calls())


def _warm_up_parts(module: str) -> Sequence[Call]:
    return cast(Sequence[Call], getattr(importlib.import_module(module), "warm_up_parts", list)())


def _misses(probe: Any) -> int:
    return sum(probe.stats.cache_misses.values())


def _call_all(calls: Sequence[Call], on_call: Callable[[int, int], None] | None = None) -> None:
    thresholds = gc.get_threshold()
    gc.set_threshold(max(_COLLECT_AFTER, thresholds[0]), *thresholds[1:])
    try:
        for number, (compiled, *arguments) in enumerate(calls, 1):
            if on_call is not None:
                on_call(number, len(calls))
            compiled(*arguments)
    finally:
        gc.set_threshold(*thresholds)


if __name__ == "__main__":
    for name in sys.argv[:0:-1]:
        _call_all(_warm_up_parts(name)[::-1])
        _call_all(_warm_up_calls(name)[::-1])

"""How the kernels of the stages are compiled, and how to write them so that this takes seconds.

numba compiles at the first call on a machine and keeps the result in a cache on disk; the first start after
an installation waits for it. What costs time there is not the loops, it is

- functions: each one is a library of its own, typed, lowered, optimised and linked, and optimised again in
  all that call it. A function called once is cheaper inlined; one called more than once is compiled once per
  combination of argument types, and a literal (`0`, `False`) is a type of its own;
- numpy: `sort`, `argsort`, `diff`, `searchsorted`, `max`, array expressions, fancy indexing are compiled from
  numba's own Python sources, for every element type, in a tenth of a second to one second each. An assignment
  of an array to a slice takes 1.7 s: it can fail, and its message is put together by compiled string
  functions. A loop takes milliseconds. `empty` and `zeros` are cheap, a scalar into a slice also;
- wrappers, by which Python or C may call a function: only kernels need the one, none the other.

numba's cache does not see other files change. Whoever edits a kernel that kernels of another file call must
remove the `__pycache__` of that file.
"""

from __future__ import annotations

import numba

_OPTIONS = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}

kernel = numba.njit(cache=True, **_OPTIONS)
"""Called from Python, and kept in the cache with all that it calls."""

called = numba.njit(no_cpython_wrapper=True, **_OPTIONS)
"""Called from kernels alone."""

inlined = numba.njit(inline="always", **_OPTIONS)
"""Becomes part of the function that calls it, at every call."""

"""How kernels are compiled: once, cached on disk, without the GIL, with IEEE arithmetic (no fast-math)."""

from __future__ import annotations

from typing import Any

import numba

# error_model: a division by zero gives IEEE's infinity instead of a Python exception.
_options: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}
kernel: Any = numba.njit(**_options)

# Called by kernels only. Without its two wrappers, which Python would call it by, it compiles faster.
_options |= {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
part: Any = numba.njit(**_options)

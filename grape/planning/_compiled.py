"""How the kernels of planning are compiled; imported only where they are used.

Numba counts the references to an array wherever a function takes one, each time with a locked instruction. Among so
many small functions that took a third of the time of an edge. Who calls a kernel holds its arrays: none are counted.
"""

from __future__ import annotations

from typing import Any

from numba import njit

_UNCOUNTED: dict[str, Any] = {"cache": True, "error_model": "numpy", "_nrt": False}  # they allocate nothing

uncounted = njit(**_UNCOUNTED)
inlined = njit(**_UNCOUNTED, forceinline=True)

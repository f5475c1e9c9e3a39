"""How the kernels of planning are compiled; imported only where they are used.

Numba counts references to an array wherever a function takes one, each time with a locked instruction. Among so many
small functions that took a third of the time of an edge. Whoever calls them holds the arrays, so nobody need count.
"""

from __future__ import annotations

from numba import njit

uncounted = njit(cache=True, error_model="numpy", _nrt=False)
inlined = njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)

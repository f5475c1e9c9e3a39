"""A binary heap for compiled searches: keys and what they stand for in two arrays, the least key first."""

from __future__ import annotations

from numba import njit

from grape.messages import Array


@njit(cache=True)
def push(keys: Array, items: Array, size: int, key: float, item: int) -> None:
    """Put an item into a heap of `size` entries; the arrays must have room for one more."""
    at = size
    while at > 0:
        above = (at - 1) // 2
        if keys[above] <= key:
            break
        keys[at], items[at] = keys[above], items[above]
        at = above
    keys[at], items[at] = key, item


@njit(cache=True)
def pop(keys: Array, items: Array, size: int) -> None:
    """Take the first of `size` entries away; look at it before."""
    key, item, at = keys[size - 1], items[size - 1], 0
    while True:
        child = 2 * at + 1
        if child >= size - 1:
            break
        if child + 1 < size - 1 and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[at], items[at] = keys[child], items[child]
        at = child
    keys[at], items[at] = key, item

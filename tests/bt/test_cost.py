"""What a tick costs: the beat is 10 ms, and the tree may take only a small part of it."""

from __future__ import annotations

import time
from types import SimpleNamespace


def test_a_tick_of_a_hundred_leaves_costs_less_than_a_twentieth_of_a_beat(bench: SimpleNamespace) -> None:
    body = f"<Sequence>{'<Sequence><AlwaysSuccess/></Sequence>' * 100}<Wait/></Sequence>"
    running = bench.executor(bench.root(body), [bench.scripted("Wait", "R" * 1_000 + "S")])
    running.tick()
    durations = []
    for _ in range(300):
        start = time.perf_counter()
        running.tick()
        durations.append(time.perf_counter() - start)
    assert sorted(durations)[150] < 0.0005

"""Messages of another thread reach the beat whole, in order and with their age."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import pytest

from grape.drivers import Mailbox
from grape.errors import StaleData
from grape.messages import Message


def mailbox(now: float = 0.0) -> tuple[Mailbox[Message], SimpleNamespace]:
    wall = SimpleNamespace(time=now)
    clock = SimpleNamespace(now=lambda: wall.time)
    return Mailbox("wheels", clock), wall


def test_an_empty_mailbox_has_nothing_to_tell() -> None:
    box, _ = mailbox()
    assert box.since(-1.0) == ()
    with pytest.raises(StaleData, match="wheels: nothing measured yet"):
        box.latest()


def test_the_newest_message_is_refused_when_it_is_too_old() -> None:
    box, wall = mailbox()
    box.put(Message(stamp=1.0))
    wall.time = 1.3
    assert box.latest(max_age_s=0.4).stamp == 1.0
    with pytest.raises(StaleData, match=r"0\.300 s old, at most 0\.200 s"):
        box.latest(max_age_s=0.2)


def test_messages_are_told_in_order_and_forgotten_after_two_seconds() -> None:
    box, _ = mailbox()
    for stamp in (0.0, 1.0, 2.0, 2.5):
        box.put(Message(stamp=stamp))
    assert [message.stamp for message in box.since(-1.0)] == [1.0, 2.0, 2.5]
    assert [message.stamp for message in box.since(2.0)] == [2.5]


def test_a_thread_may_put_while_the_beat_reads() -> None:
    box, _ = mailbox()
    thread = threading.Thread(target=lambda: [box.put(Message(stamp=k * 1e-3)) for k in range(20_000)])
    thread.start()
    seen = 0.0
    while thread.is_alive():
        stamps = [message.stamp for message in box.since(seen)]
        assert stamps == sorted(stamps)
        seen = max([seen, *stamps])
    thread.join()
    assert box.latest().stamp == pytest.approx(19.999)

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
    box, wall = mailbox(now=1.0)
    box.put(Message(stamp=1.0))
    wall.time = 1.3
    assert box.latest(max_age_s=0.4).stamp == 1.0
    with pytest.raises(StaleData, match=r"0\.300 s old, at most 0\.200 s"):
        box.latest(max_age_s=0.2)


def test_messages_are_told_in_order_and_forgotten_after_two_seconds() -> None:
    box, _ = mailbox(now=2.5)
    for stamp in (0.0, 1.0, 2.0, 2.5):
        box.put(Message(stamp=stamp))
    assert [message.stamp for message in box.since(-1.0)] == [1.0, 2.0, 2.5]
    assert [message.stamp for message in box.since(2.0)] == [2.5]


def test_a_message_that_is_stamped_ahead_of_the_clock_is_refused_and_the_next_one_is_taken() -> None:
    box, wall = mailbox(now=1.0)
    box.put(Message(stamp=1.0))
    box.put(Message(stamp=100.0))
    assert box.latest(max_age_s=0.2).stamp == 1.0, "what came before has its age"
    wall.time = 1.3
    with pytest.raises(StaleData, match=r"0\.300 s old.*stamped 99\.000 s ahead: stamps are clock\.now\(\)"):
        box.latest(max_age_s=0.2)
    box.put(Message(stamp=1.34))
    assert box.latest(max_age_s=0.2).stamp == 1.34, "two clocks of one machine may differ a little"
    assert [message.stamp for message in box.since(-1.0)] == [1.0, 1.34]


def test_stamps_of_another_clock_are_told_as_such() -> None:
    box, _ = mailbox(now=3.0)
    box.put(Message(stamp=1.7e9))
    with pytest.raises(StaleData, match=r"nothing measured yet; what comes is stamped 1699999997\.000 s ahead"):
        box.latest()


def test_stamps_never_decrease() -> None:
    box, _ = mailbox(now=2.0)
    for stamp in (1.0, 1.5, 1.2, 1.5, 1.8):
        box.put(Message(stamp=stamp))
    assert [message.stamp for message in box.since(-1.0)] == [1.0, 1.5, 1.5, 1.8]


def test_a_thread_may_put_while_the_beat_reads() -> None:
    box, _ = mailbox(now=20.0)
    thread = threading.Thread(target=lambda: [box.put(Message(stamp=k * 1e-3)) for k in range(20_000)])
    thread.start()
    seen = 0.0
    while thread.is_alive():
        stamps = [message.stamp for message in box.since(seen)]
        assert stamps == sorted(stamps)
        seen = max([seen, *stamps])
    thread.join()
    assert box.latest().stamp == pytest.approx(19.999)

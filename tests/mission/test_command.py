"""What `grape run` and `grape resume` do beside the mission: they listen to the user."""

from __future__ import annotations

import signal

import pytest

from grape.mission.command import Cancellation


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_asks_once_and_the_second_one_ends(number: signal.Signals) -> None:
    cancelled = Cancellation()
    with cancelled.listening():
        signal.raise_signal(number)
        assert cancelled()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)


def test_a_terminal_that_closes_does_not_stop_what_nohup_has_started() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    cancelled = Cancellation()
    try:
        with cancelled.listening():
            signal.raise_signal(signal.SIGHUP)
        assert not cancelled() and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)

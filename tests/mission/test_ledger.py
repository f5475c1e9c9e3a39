"""The ledger: the account always balances, and nothing is lost when the process is killed."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from grape.actions.core import Outcome, PlantTask, Step
from grape.errors import InvalidInput
from grape.mission.ledger import SqliteLedger

PLANTS = [("r0v1", "plant"), ("r0n0", "nail")]


@pytest.fixture
def ledger(tmp_path: Path) -> SqliteLedger:
    return SqliteLedger.create(tmp_path / "ledger.sqlite", PLANTS, 8)


def test_a_new_ledger_knows_the_plants_in_order_and_a_full_feeder(ledger: SqliteLedger) -> None:
    assert ledger.plants() == (PlantTask(plant="r0v1", mode="plant"), PlantTask(plant="r0n0", mode="nail"))
    assert ledger.account() == {"loaded": 8, "deployed": 0, "left": 8, "lost": 0, "on_hand": 0}


def test_attempts_and_outcomes_are_kept(ledger: SqliteLedger) -> None:
    assert [ledger.attempt("r0n0"), ledger.attempt("r0n0"), ledger.attempt("r0v1")] == [1, 2, 1]
    ledger.finish("r0n0", Outcome.SKIPPED, "unreachable")
    expected = PlantTask(plant="r0n0", mode="nail", outcome=Outcome.SKIPPED, reason="unreachable", attempts=2)
    assert ledger.plants()[1] == expected


def test_the_account_balances_after_every_move(ledger: SqliteLedger) -> None:
    for source, target in [("feeder", "hand"), ("hand", "r0v1"), ("feeder", "hand"), ("hand", "lost")]:
        ledger.move_dispenser(source, target)
        account = ledger.account()
        assert account["loaded"] == 8 == sum(account[key] for key in ("deployed", "left", "lost", "on_hand"))
    assert ledger.account() == {"loaded": 8, "deployed": 1, "left": 6, "lost": 1, "on_hand": 0}


@pytest.mark.parametrize(
    ("source", "target", "message"),
    [
        ("hand", "r0v1", "no dispenser at hand"),
        ("feeder", "r0v2", "did you mean 'r0v1'"),
        ("feedr", "hand", "did you mean 'feeder'"),
        ("feeder", "feeder", "cannot move"),
    ],
)
def test_impossible_moves_are_refused(ledger: SqliteLedger, source: str, target: str, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        ledger.move_dispenser(source, target)
    assert ledger.account()["left"] == 8


def test_unknown_plants_and_outcomes_are_refused(ledger: SqliteLedger) -> None:
    with pytest.raises(InvalidInput, match="did you mean 'r0v1'"):
        ledger.attempt("r0v")
    with pytest.raises(InvalidInput, match="not in this mission"):
        ledger.finish("x", Outcome.FAILED)
    with pytest.raises(ValueError, match="hung"):
        ledger.finish("r0v1", "hung")  # type: ignore[arg-type]


@pytest.mark.parametrize("plants", [[("a", "nail"), ("a", "plant")], [("hand", "nail")], [("dropped", "nail")]])
def test_ids_must_be_unique_and_no_reserved_names(tmp_path: Path, plants: list[tuple[str, str]]) -> None:
    with pytest.raises(InvalidInput, match="ids of their own"):
        SqliteLedger.create(tmp_path / "x.sqlite", plants, 8)
    assert not (tmp_path / "x.sqlite").exists()


def test_a_ledger_is_never_overwritten(ledger: SqliteLedger, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="never overwritten"):
        SqliteLedger.create(tmp_path / "ledger.sqlite", PLANTS, 8)


@pytest.mark.parametrize("content", [None, b"no database at all, but long enough to look at" * 30, b""])
def test_files_that_are_no_ledger_are_refused(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "other.sqlite"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InvalidInput):
        SqliteLedger.open(path)


def test_a_ledger_without_one_of_its_tables_is_refused(ledger: SqliteLedger, tmp_path: Path) -> None:
    ledger.close()
    path = tmp_path / "ledger.sqlite"
    with sqlite3.connect(path) as db:
        db.execute("DROP TABLE facts")
    with pytest.raises(InvalidInput, match=r"ledger\.sqlite is damaged: without facts"):
        SqliteLedger.open(path)


def test_a_damaged_ledger_is_refused(ledger: SqliteLedger, tmp_path: Path) -> None:
    ledger.close()
    path = tmp_path / "ledger.sqlite"
    content = bytearray(path.read_bytes())
    content[4096:] = bytes(len(content) - 4096)
    path.write_bytes(content)
    with pytest.raises(InvalidInput, match=r"ledger\.sqlite is damaged"):
        SqliteLedger.open(path)


def test_a_killed_process_loses_nothing(tmp_path: Path) -> None:
    program = (
        "import os, signal, sys; from pathlib import Path; from grape.mission.ledger import SqliteLedger\n"
        "from grape.actions.core import Outcome\n"
        "ledger = SqliteLedger.create(Path(sys.argv[1]), [('a', 'nail'), ('b', 'plant')], 8)\n"
        "ledger.attempt('a'); ledger.move_dispenser('feeder', 'hand'); ledger.move_dispenser('hand', 'a')\n"
        "ledger.finish('a', Outcome.DEPLOYED); ledger.move_dispenser('feeder', 'hand')\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    path = tmp_path / "ledger.sqlite"
    process = subprocess.run([sys.executable, "-c", program, str(path)], env=dict(os.environ), check=False)
    assert process.returncode == -signal.SIGKILL
    ledger = SqliteLedger.open(path)
    assert ledger.plants()[0].outcome is Outcome.DEPLOYED
    assert ledger.account() == {"loaded": 8, "deployed": 1, "left": 6, "lost": 0, "on_hand": 1}


def test_closing_folds_the_journal_into_one_file(ledger: SqliteLedger, tmp_path: Path) -> None:
    ledger.move_dispenser("feeder", "hand")
    ledger.close()
    assert [path.name for path in tmp_path.iterdir()] == ["ledger.sqlite"]
    assert SqliteLedger.open(tmp_path / "ledger.sqlite").account()["on_hand"] == 1


def test_a_step_is_written_before_and_its_outcome_after(ledger: SqliteLedger) -> None:
    assert ledger.last_step() is None
    with ledger.step("release", "r0n0", target=[1, 2]):
        begun = ledger.last_step()
    assert begun == Step(name="release", plant="r0n0", details={"target": [1, 2]})
    done = ledger.last_step()
    assert done is not None and done.outcome == "done"
    with pytest.raises(ValueError, match="oops"), ledger.step("grasp"):
        raise ValueError("oops")
    failed = ledger.last_step()
    assert failed is not None and (failed.name, failed.outcome) == ("grasp", "failed")


def test_a_step_that_is_halted_stays_open(ledger: SqliteLedger) -> None:
    def action() -> Iterator[None]:
        with ledger.step("place", "r0v1"):
            yield

    running = action()
    next(running)
    running.close()  # type: ignore[attr-defined]
    assert ledger.last_step() == Step(name="place", plant="r0v1")


def test_what_was_remembered_lasts_until_the_base_moves(ledger: SqliteLedger, tmp_path: Path) -> None:
    ledger.remember("cloud", b"\x00\x01")
    ledger.remember("parked", ["r0v1", "fore"])
    with ledger.step("grasp"):
        pass
    ledger.close()
    again = SqliteLedger.open(tmp_path / "ledger.sqlite")
    assert (again.recall("cloud"), again.recall("parked")) == (b"\x00\x01", ["r0v1", "fore"])
    with again.step("drive", moves_base=True):
        pass
    assert again.recall("cloud") is None and again.recall("parked") is None


def test_plants_skipped_for_a_reason_can_be_reopened(ledger: SqliteLedger) -> None:
    ledger.finish("r0v1", Outcome.SKIPPED, "aborted")
    ledger.finish("r0n0", Outcome.SKIPPED, "unreachable")
    ledger.reopen("aborted")
    assert [task.outcome for task in ledger.plants()] == [None, Outcome.SKIPPED]


@pytest.fixture
def stocked(tmp_path: Path) -> SqliteLedger:
    return SqliteLedger.create(tmp_path / "stocked.sqlite", PLANTS, 1, stock=5)


def test_a_refill_comes_from_the_stock_and_counts_as_loaded(stocked: SqliteLedger) -> None:
    assert stocked.account()["loaded"] == 1 and stocked.dispensers()["stock"] == 5 and stocked.refills() == 0
    assert stocked.refill(1, 3)
    assert stocked.account() == {"loaded": 4, "deployed": 0, "left": 4, "lost": 0, "on_hand": 0}
    assert stocked.dispensers()["stock"] == 2 and stocked.refills() == 1


def test_a_refill_that_is_told_twice_counts_once(stocked: SqliteLedger, tmp_path: Path) -> None:
    stocked.refill(1, 2)
    again = SqliteLedger.open(tmp_path / "stocked.sqlite")
    assert not again.refill(1, 2) and again.account()["left"] == 3
    assert again.refill(2, 1) and again.account()["left"] == 4


def test_more_than_the_stock_is_welcome_and_none_ends_it(stocked: SqliteLedger) -> None:
    stocked.refill(1, 7)
    assert stocked.account()["left"] == 8 and stocked.dispensers()["stock"] == 0
    other = SqliteLedger.create(Path(stocked._db.execute("PRAGMA database_list").fetchone()[2] + "2"), PLANTS, 0, {}, 4)
    assert other.refill(1, 0) and other.dispensers()["stock"] == 0 and other.account()["loaded"] == 0


def test_the_first_look_after_a_refill_may_find_more_than_were_told(stocked: SqliteLedger) -> None:
    stocked.count_refill(8)
    assert stocked.account()["left"] == 1, "there was no refill"
    stocked.refill(1, 2)
    stocked.count_refill(4)
    assert stocked.account() == {"loaded": 4, "deployed": 0, "left": 4, "lost": 0, "on_hand": 0}
    stocked.count_refill(8)
    assert stocked.account()["left"] == 4, "it was counted before"
    stocked.refill(2, 1)
    stocked.count_refill(2)
    assert stocked.account()["left"] == 5, "what is missing, the look at the feeder writes off"


@pytest.mark.parametrize(("number", "added"), [(0, 1), (1, -1)])
def test_impossible_refills_are_refused(stocked: SqliteLedger, number: int, added: int) -> None:
    with pytest.raises(InvalidInput, match="a refill has a number from 1"):
        stocked.refill(number, added)


def test_a_kill_in_the_middle_of_a_refill_neither_loses_nor_doubles_it(tmp_path: Path) -> None:
    """The process tells one refill after the other until it is killed; every one is in the ledger whole or not."""
    program = (
        "import sys; from pathlib import Path; from grape.mission.ledger import SqliteLedger\n"
        "ledger = SqliteLedger.create(Path(sys.argv[1]), [('a', 'nail')], 0, stock=10**6)\n"
        "print('ready', flush=True)\n"
        "for number in range(1, 10**6):\n    ledger.refill(number, 2)\n"
    )
    path = tmp_path / "killed.sqlite"
    with subprocess.Popen([sys.executable, "-c", program, str(path)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "ready\n"
        deadline = time.monotonic() + 20
        while time.monotonic() < deadline:
            reader = SqliteLedger.open(path)
            if reader.refills() >= 5:
                break
        os.kill(process.pid, signal.SIGKILL)
    ledger = SqliteLedger.open(path)
    number = ledger.refills()
    assert number >= 5 and ledger.account()["left"] == 2 * number
    assert ledger.dispensers()["stock"] == 10**6 - 2 * number
    assert not ledger.refill(number, 2) and ledger.account()["left"] == 2 * number

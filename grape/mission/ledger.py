"""The mission's ledger in SQLite: what was done to which plant and where each dispenser is, whatever happens to us."""

from __future__ import annotations

import json
import re
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from grape.actions.core import Outcome, PlantTask, Step
from grape.errors import InvalidInput, with_suggestion
from grape.site_features import FEEDER, HAND, LOST, PLACES, STOCK

SCHEMA_VERSION = 3
_TABLES = """
CREATE TABLE plants (
    position INTEGER PRIMARY KEY, plant TEXT NOT NULL UNIQUE, mode TEXT NOT NULL,
    outcome TEXT, reason TEXT NOT NULL DEFAULT '', attempts INTEGER NOT NULL DEFAULT 0);
CREATE TABLE dispensers (place TEXT PRIMARY KEY, number INTEGER NOT NULL CHECK (number >= 0));
CREATE TABLE moves (number INTEGER PRIMARY KEY AUTOINCREMENT, source TEXT NOT NULL, target TEXT NOT NULL);
CREATE TABLE refills (number INTEGER PRIMARY KEY, added INTEGER NOT NULL CHECK (added >= 0), seen INTEGER);
CREATE TABLE steps (
    number INTEGER PRIMARY KEY AUTOINCREMENT, name TEXT NOT NULL, plant TEXT NOT NULL, details TEXT NOT NULL,
    outcome TEXT);
CREATE TABLE stop (key TEXT PRIMARY KEY, value NOT NULL);
CREATE TABLE facts (key TEXT PRIMARY KEY, value TEXT NOT NULL);
"""


class SqliteLedger:
    """The `Ledger` of a run folder. Every call is one transaction on disk, so a kill between two calls loses nothing.

    Use `create` for a new mission and `open` to read one, also one that was killed.
    """

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._db = connection
        self._db.execute("PRAGMA journal_mode = WAL")
        self._db.execute("PRAGMA synchronous = FULL")

    @classmethod
    def create(
        cls,
        path: Path,
        plants: Iterable[tuple[str, str]],
        loaded: int,
        facts: Mapping[str, str] | None = None,
        stock: int = 0,
    ) -> SqliteLedger:
        """A new ledger; its file appears whole or not at all.

        Args:
            plants: (id, mode) in the order of service.
            loaded: dispensers in the feeder at the start.
            facts: what else to write down about the mission.
            stock: dispensers that are ready for refills.

        Raises:
            InvalidInput: the file exists, a plant is named twice, or `loaded` or `stock` is negative.
        """
        rows = [(k, plant, mode) for k, (plant, mode) in enumerate(plants)]
        names = [plant for _, plant, _ in rows]
        twice = sorted({name for name in names if names.count(name) > 1} | (set(PLACES) & set(names)))
        if twice:
            raise InvalidInput(f"plants must have ids of their own, got {', '.join(twice)} twice or as a reserved name")
        if min(loaded, stock) < 0:
            raise InvalidInput(f"loaded and stock must be at least 0, got {loaded} and {stock}")
        if path.exists():
            raise InvalidInput(f"{path} exists: a ledger is never overwritten")
        part = path.with_name(path.name + ".part")
        for left in (part, part.with_name(part.name + "-wal"), part.with_name(part.name + "-shm")):
            left.unlink(missing_ok=True)
        ledger = cls(sqlite3.connect(part, isolation_level=None))
        db = ledger._db
        db.executescript(f"BEGIN; {_TABLES} PRAGMA user_version = {SCHEMA_VERSION}; COMMIT;")
        with db:
            db.execute("BEGIN")
            db.executemany("INSERT INTO plants (position, plant, mode) VALUES (?, ?, ?)", rows)
            places = [(FEEDER, loaded), (HAND, 0), (LOST, 0), (STOCK, stock), *((name, 0) for name in names)]
            db.executemany("INSERT INTO dispensers (place, number) VALUES (?, ?)", places)
            db.executemany("INSERT INTO facts (key, value) VALUES (?, ?)", (facts or {}).items())
        ledger.close()
        part.replace(path)
        return cls(sqlite3.connect(path, isolation_level=None))

    @classmethod
    def open(cls, path: Path) -> SqliteLedger:
        """The ledger of an earlier run.

        Raises:
            InvalidInput: there is none, it is damaged, or another version of grape wrote it.
        """
        if not path.is_file():
            raise InvalidInput(f"{path}: no such ledger")
        try:
            ledger = cls(sqlite3.connect(path, isolation_level=None))
            (version,) = ledger._db.execute("PRAGMA user_version").fetchone()
            (state,) = ledger._db.execute("PRAGMA quick_check(1)").fetchone()
            tables = {name for (name,) in ledger._db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        except sqlite3.DatabaseError as error:
            raise InvalidInput(f"{path} is no ledger: {error}") from error
        if version != SCHEMA_VERSION:
            raise InvalidInput(f"{path}: ledger version {version}, this grape reads version {SCHEMA_VERSION}")
        if state != "ok":
            raise InvalidInput(f"{path} is damaged: {state}")
        if missing := [name for name in re.findall(r"CREATE TABLE (\w+)", _TABLES) if name not in tables]:
            raise InvalidInput(f"{path} is damaged: without {', '.join(missing)}")
        return ledger

    def plants(self) -> tuple[PlantTask, ...]:
        """Every plant of the mission, in the order of service."""
        rows = self._db.execute("SELECT plant, mode, outcome, reason, attempts FROM plants ORDER BY position")
        return tuple(
            PlantTask(plant=p, mode=m, outcome=Outcome(o) if o else None, reason=r, attempts=a)
            for p, m, o, r, a in rows
        )

    def attempt(self, plant: str) -> int:
        """Count one more deployment attempt on a plant; returns how many there were."""
        self._known(plant)
        query = "UPDATE plants SET attempts = attempts + 1 WHERE plant = ? RETURNING attempts"
        (attempts,) = self._db.execute(query, (plant,)).fetchall()[0]
        return int(attempts)

    def finish(self, plant: str, outcome: Outcome, reason: str = "") -> None:
        """Write down what became of a plant."""
        self._known(plant)
        values = (str(Outcome(outcome)), str(reason), plant)
        self._db.execute("UPDATE plants SET outcome = ?, reason = ? WHERE plant = ?", values)

    def reopen(self, reason: str) -> None:
        """Plants that were skipped for a reason are open again."""
        self._db.execute(
            "UPDATE plants SET outcome = NULL, reason = '' WHERE outcome = ? AND reason = ?",
            (str(Outcome.SKIPPED), reason),
        )

    @contextmanager
    def step(self, name: str, plant: str = "", *, moves_base: bool = False, **details: Any) -> Iterator[None]:
        """Around a step that changes the world: it is written down before, its outcome after.

        An error makes the outcome "failed"; a kill, or a halt of the tree, leaves the step without one.

        Args:
            name, plant: what is done, and for which plant.
            moves_base: what was remembered of this stop is forgotten.
            details: where and how, JSON-able.
        """
        with self._db:
            self._db.execute("BEGIN IMMEDIATE")
            if moves_base:
                self._db.execute("DELETE FROM stop")
            query = "INSERT INTO steps (name, plant, details) VALUES (?, ?, ?)"
            number = self._db.execute(query, (name, plant, json.dumps(details))).lastrowid
        outcome = "done"
        try:
            yield
        except Exception:
            outcome = "failed"
            raise
        except BaseException:
            outcome = ""
            raise
        finally:
            if outcome:
                self._db.execute("UPDATE steps SET outcome = ? WHERE number = ?", (outcome, number))

    def last_step(self) -> Step | None:
        """The step that was begun last."""
        query = "SELECT name, plant, details, outcome FROM steps ORDER BY number DESC LIMIT 1"
        row = self._db.execute(query).fetchone()
        return None if row is None else Step(name=row[0], plant=row[1], details=json.loads(row[2]), outcome=row[3])

    def remember(self, key: str, value: Any) -> None:
        """Keep something for as long as the base stands where it is: JSON-able, or bytes."""
        kept = value if isinstance(value, bytes) else json.dumps(value)
        self._db.execute("INSERT OR REPLACE INTO stop (key, value) VALUES (?, ?)", (key, kept))

    def recall(self, key: str) -> Any:
        """What was remembered since the base moved last; None when nothing was."""
        row = self._db.execute("SELECT value FROM stop WHERE key = ?", (key,)).fetchone()
        return None if row is None else row[0] if isinstance(row[0], bytes) else json.loads(row[0])

    def note(self, key: str, value: str) -> None:
        """Write down a fact about the mission as a whole."""
        self._db.execute("INSERT OR REPLACE INTO facts (key, value) VALUES (?, ?)", (key, value))

    def facts(self) -> dict[str, str]:
        """What was written down about the mission as a whole."""
        return dict(self._db.execute("SELECT key, value FROM facts"))

    def move_dispenser(self, source: str, target: str) -> None:
        """One dispenser went from a place to another: feeder, hand, lost, stock or a plant's id.

        Raises:
            InvalidInput: an unknown place, twice the same place, or nothing at `source`.
        """
        places = self.dispensers()
        for place in (source, target):
            if place not in places:
                sentence = f"no place {place!r} for a dispenser; allowed: {', '.join(places)}"
                raise InvalidInput(with_suggestion(sentence, place, places))
        if source == target:
            raise InvalidInput(f"a dispenser cannot move from {source} to {target}")
        if places[source] == 0:
            raise InvalidInput(f"no dispenser at {source} by the account: {places}")
        with self._db:
            self._db.execute("BEGIN IMMEDIATE")
            self._db.execute("UPDATE dispensers SET number = number - 1 WHERE place = ?", (source,))
            self._db.execute("UPDATE dispensers SET number = number + 1 WHERE place = ?", (target,))
            self._db.execute("INSERT INTO moves (source, target) VALUES (?, ?)", (source, target))

    def refill(self, number: int, added: int) -> bool:
        """Somebody has put dispensers into the feeder; written down once, however often it is told.

        A refill of none means that there are no more.

        Args:
            number: of his refill, 1 is the first.
            added: dispensers that he says he put in; more than the stock are as welcome.

        Returns:
            Whether it was new.

        Raises:
            InvalidInput: the number is below 1 or `added` negative.
        """
        if number < 1 or added < 0:
            raise InvalidInput(f"a refill has a number from 1 and adds none or more, got {number} and {added}")
        with self._db:
            self._db.execute("BEGIN IMMEDIATE")
            if number <= self.refills():
                return False
            self._db.execute("INSERT INTO refills (number, added) VALUES (?, ?)", (number, added))
            self._load(added)
            if added == 0:
                self._db.execute("UPDATE dispensers SET number = 0 WHERE place = ?", (STOCK,))
        return True

    def refills(self) -> int:
        """Number of the last refill that was written down; 0 before the first."""
        (number,) = self._db.execute("SELECT COALESCE(MAX(number), 0) FROM refills").fetchone()
        return int(number)

    def count_refill(self, seen: int) -> None:
        """The first look after a refill shows so many in the feeder: more than were told count as loaded."""
        with self._db:
            self._db.execute("BEGIN IMMEDIATE")
            if not self._db.execute("UPDATE refills SET seen = ? WHERE seen IS NULL", (seen,)).rowcount:
                return
            self._load(max(0, seen - self.dispensers()[FEEDER]))

    def _load(self, added: int) -> None:
        """From the stock, and beyond it from anywhere, into the feeder; inside a transaction."""
        self._db.execute("UPDATE dispensers SET number = MAX(0, number - ?) WHERE place = ?", (added, STOCK))
        self._db.execute("UPDATE dispensers SET number = number + ? WHERE place = ?", (added, FEEDER))
        self._db.executemany("INSERT INTO moves (source, target) VALUES (?, ?)", [(STOCK, FEEDER)] * added)

    def dispensers(self) -> Mapping[str, int]:
        """How many dispensers are at each place: feeder, hand, lost, plants' ids, and stock, ready for a refill."""
        return dict(self._db.execute("SELECT place, number FROM dispensers ORDER BY rowid"))

    def account(self) -> dict[str, int]:
        """The robot's own account: loaded, refills included, = deployed + left + lost + on_hand, always."""
        places = dict(self.dispensers())
        left, hand, lost = places.pop(FEEDER), places.pop(HAND), places.pop(LOST)
        places.pop(STOCK)
        deployed = sum(places.values())
        return {
            "loaded": deployed + left + lost + hand,
            "deployed": deployed,
            "left": left,
            "lost": lost,
            "on_hand": hand,
        }

    def close(self) -> None:
        """Fold the journal into the file and close it."""
        self._db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        self._db.close()

    def _known(self, plant: str) -> None:
        names = [row[0] for row in self._db.execute("SELECT plant FROM plants ORDER BY position")]
        if plant not in names:
            sentence = f"plant {plant!r} is not in this mission; it has {', '.join(names)}"
            raise InvalidInput(with_suggestion(sentence, plant, names))

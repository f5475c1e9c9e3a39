"""The simulated world in a folder, beat by beat: it goes on existing when the process that shows it is killed.

This is the world and not the robot's memory: no part of a robot may read it.
"""

from __future__ import annotations

import json
import mmap
import struct
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from grape.errors import InvalidInput
from grape.messages import Array
from grape.sim.physics import STEPS_PER_SECOND, Physics
from grape.sim.stock import wake_placed

_HEADER = struct.Struct("<QIIQ")  # sequence number, length, checksum, layout
_PHYSICS = int(mujoco.mjtState.mjSTATE_FULLPHYSICS | mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_WARMSTART)
STATE_FILE, JOURNAL_FILE = "state.bin", "journal.jsonl"


class TwoSlots:
    """A file of two slots that are written in turn, so that one of them is whole whenever the writer is killed.

    The file is mapped into memory: what was written is there for the next process, though not after a power cut.

    Args:
        path: of the file; made when it is not there.
        size: bytes of a payload.
        layout: a number that tells what the payload means; slots of another layout are not read.
    """

    def __init__(self, path: Path, size: int, layout: int) -> None:
        self._size, self._layout = size, layout
        self._stride = _HEADER.size + size
        path.touch()
        if path.stat().st_size != 2 * self._stride:
            with path.open("r+b") as file:
                file.truncate(2 * self._stride)
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), 2 * self._stride)
        self._sequence = max((sequence for sequence, _ in _whole_slots(self._map, self._stride)), default=0)

    def write(self, payload: memoryview) -> None:
        """Keep `payload`; the one before it stays in the other slot."""
        self._sequence += 1
        begin = (self._sequence % 2) * self._stride
        check = zlib.crc32(payload, self._sequence & 0xFFFFFFFF)
        self._map[begin + _HEADER.size : begin + self._stride] = payload
        self._map[begin : begin + _HEADER.size] = _HEADER.pack(self._sequence, self._size, check, self._layout)

    def close(self) -> None:
        """Unmap the file."""
        self._map.close()


def newest(path: Path) -> tuple[int, bytes] | None:
    """Layout and payload that were written last and whole; None when there is none."""
    if not path.is_file():
        return None
    content = path.read_bytes()
    slots = _whole_slots(content, len(content) // 2)
    if not slots:
        return None
    _, begin = max(slots)
    _, length, _, layout = _HEADER.unpack_from(content, begin)
    return layout, content[begin + _HEADER.size : begin + _HEADER.size + length]


def kept_time(folder: Path) -> float | None:
    """Simulated seconds (s) that the world in a folder has reached; None when there is none."""
    found = newest(folder / STATE_FILE)
    return None if found is None else struct.unpack_from("<d", found[1])[0] / STEPS_PER_SECOND


def _whole_slots(content: Any, stride: int) -> list[tuple[int, int]]:
    """Sequence number and offset of each slot whose checksum fits."""
    found = []
    for begin in (0, stride):
        if stride < _HEADER.size:
            continue
        sequence, length, check, _ = _HEADER.unpack_from(content, begin)
        payload = content[begin + _HEADER.size : begin + _HEADER.size + length]
        whole = sequence and len(payload) == length == stride - _HEADER.size
        if whole and zlib.crc32(payload, sequence & 0xFFFFFFFF) == check:
            found.append((sequence, begin))
    return found


class Checkpoint:
    """Keeps the state of a scene in a folder: numbers in two slots, what grows in a journal of JSON lines.

    Args:
        folder: made when it is not there.
        physics: the scene's model, state and clock.
        parts: objects whose attributes named in `STATE` (numbers, tuples and arrays of them, of constant size) belong
            to the state.
    """

    def __init__(self, folder: Path, physics: Physics, parts: Sequence[Any]) -> None:
        self._physics = physics
        self._fields: list[tuple[Any, str, slice]] = []
        size = 1 + mujoco.mj_stateSize(physics.model, _PHYSICS)
        self._physics_slice = slice(1, size)
        for part in parts:
            for name in part.STATE:
                count = np.size(getattr(part, name))
                self._fields.append((part, name, slice(size, size + count)))
                size += count
        self._vector = np.zeros(size)
        self._state = self._vector[self._physics_slice]
        self._payload = memoryview(self._vector.data).cast("B")
        self._layout = _layout(physics.model, self._fields)
        folder.mkdir(exist_ok=True)
        self._folder = folder
        self._found = newest(folder / STATE_FILE)
        if self._found is not None and self._found[0] != self._layout:
            raise InvalidInput(f"{folder}: another world or another version of grape was kept there")
        self._slots = TwoSlots(folder / STATE_FILE, self._vector.nbytes, self._layout)
        self._journal = (folder / JOURNAL_FILE).open("a", encoding="utf-8", buffering=1)

    def save(self, news: Sequence[dict[str, Any]] = ()) -> None:
        """Keep the present state, and `news` in the journal."""
        vector = self._vector
        for entry in news:
            self._journal.write(json.dumps(entry) + "\n")
        vector[0] = self._physics.clock.step
        mujoco.mj_getState(self._physics.model, self._physics.data, self._state, _PHYSICS)
        for part, name, place in self._fields:
            vector[place] = getattr(part, name)
        self._slots.write(self._payload)

    def kept_step(self) -> int | None:
        """Physics step of the state that was found in the folder, None when there was none."""
        return None if self._found is None else int(np.frombuffer(self._found[1])[0])

    def journal(self) -> list[dict[str, Any]]:
        """The journal up to the state that was found; what is newer, or cut off, is taken out of the file."""
        last = self.kept_step()
        path = self._folder / JOURNAL_FILE
        lines = [line for line in path.read_text(encoding="utf-8").splitlines(keepends=True) if line.endswith("\n")]
        entries = [(line, json.loads(line)) for line in lines]
        kept = [(line, entry) for line, entry in entries if last is not None and entry["step"] <= last]
        self._journal.close()
        part = path.with_name(path.name + ".part")
        part.write_text("".join(line for line, _ in kept), encoding="utf-8")
        part.replace(path)
        self._journal = path.open("a", encoding="utf-8", buffering=1)
        return [entry for _, entry in kept]

    def restore(self) -> None:
        """Bring back the state that was found in the folder.

        Raises:
            InvalidInput: there was none.
        """
        if self._found is None:
            raise InvalidInput(f"{self._folder}: no world was kept there")
        physics, vector = self._physics, np.frombuffer(self._found[1])
        physics.clock.step = int(vector[0])
        state = np.ascontiguousarray(vector[self._physics_slice])
        mujoco.mj_setState(physics.model, physics.data, state, _PHYSICS)
        physics.rearranged()
        wake_placed(physics.model, physics.data)
        mujoco.mj_forward(physics.model, physics.data)  # poses and contacts, for who looks before the next step
        mujoco.mj_setState(physics.model, physics.data, state, _PHYSICS)  # the line above has moved the warm start
        for part, name, place in self._fields:
            setattr(part, name, _like(getattr(part, name), vector[place]))

    def close(self) -> None:
        """Close the files."""
        self._slots.close()
        self._journal.close()


def _like(example: Any, values: Array) -> Any:
    """Numbers in the form of an example: array, tuple, int, float or bool."""
    if isinstance(example, np.ndarray):
        return values.reshape(example.shape).astype(example.dtype)
    if isinstance(example, tuple):
        return tuple(float(value) for value in values)
    return type(example)(values[0])


def _layout(model: mujoco.MjModel, fields: Sequence[tuple[Any, str, slice]]) -> int:
    """A number that differs when the model, or what is kept of it, differs."""
    names = "".join(f"{type(part).__name__}.{name}{place};" for part, name, place in fields)
    arrays = (model.geom_size, model.geom_pos, model.body_pos, model.body_mass, model.jnt_type, model.actuator_gainprm)
    check = zlib.crc32(f"{mujoco.__version__};{names}".encode())
    for array in arrays:
        check = zlib.crc32(np.ascontiguousarray(array).tobytes(), check)
    return check

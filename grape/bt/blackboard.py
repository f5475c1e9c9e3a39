"""The blackboard of one tree: named entries, and the scopes through which each SubTree sees them.

Names are resolved when the tree is loaded: a scope turns a key of a SubTree into the one entry that it means, so a
running tree only reads and writes a flat table.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from grape.bt.ports import parse_literal, without_none
from grape.errors import GrapeError, InvalidInput

_REFERENCE = re.compile(r"\{\s*(@?[A-Za-z_][\w.]*|=)\s*\}")


class MissingEntry(GrapeError):
    """A port reads an entry that no leaf has written yet."""


def reference(text: str, port: str) -> str | None:
    """The key of a `{key}` value, None for a literal; `{=}` means a key with the port's own name.

    Raises:
        InvalidInput: braces around something that is no key.
    """
    text = text.strip()
    if not (text.startswith("{") and text.endswith("}")):
        return None
    match = _REFERENCE.fullmatch(text)
    if match is None:
        raise InvalidInput(f"{text!r} is no blackboard key; letters, digits, '_' and '.' are allowed")
    return port if match[1] == "=" else match[1]


@dataclass(kw_only=True)
class Scope:
    """How one SubTree names entries.

    Attributes:
        path: prefix of the entries that belong to this scope alone.
        parent: scope of the tree that holds the SubTree, None for the main tree.
        remapped: key here -> key in the parent, as written in the SubTree's attributes.
        autoremap: every other key means the parent's key of that name, but for private `_key`s.
        own: keys that a SubTree attribute sets to text; they never mean the parent's.
        used: every key that was asked for.
    """

    path: str = ""
    parent: Scope | None = None
    remapped: Mapping[str, str] = field(default_factory=dict)
    autoremap: bool = False
    own: set[str] = field(default_factory=set)
    used: set[str] = field(default_factory=set)

    def entry(self, key: str) -> str:
        """The entry that `key` means in this scope; `@key` means the main tree's."""
        if key.startswith("@"):
            return self._main().entry(key[1:])
        self.used.add(key)
        if self.parent is not None and key not in self.own:
            if key in self.remapped:
                return self.parent.entry(self.remapped[key])
            if self.autoremap and not key.startswith("_"):
                return self.parent.entry(key)
        return f"{self.path}/{key}" if self.path else key

    def _main(self) -> Scope:
        scope = self
        while scope.parent is not None:
            scope = scope.parent
        return scope


class Blackboard:
    """The entries of one running tree.

    Args:
        entries: what is there before the first tick; text is read as the type of the port that reads it.
    """

    def __init__(self, entries: Mapping[str, Any] | None = None) -> None:
        self._entries: dict[str, Any] = dict(entries or {})

    def write(self, entry: str, value: Any) -> None:
        """Set an entry."""
        self._entries[entry] = value

    def read(self, entry: str, kind: Any = Any) -> Any:
        """The value of an entry; text that a SetBlackboard or SubTree attribute wrote is parsed as `kind`.

        Raises:
            MissingEntry: nothing has written it.
            InvalidInput: its text does not fit `kind`.
        """
        if entry not in self._entries:
            raise MissingEntry(f"nothing has written the blackboard entry {entry!r} yet")
        value = self._entries[entry]
        if type(value) is str and kind is not Any and str not in without_none(kind):
            return parse_literal(value, kind)
        return value

    def __contains__(self, entry: str) -> bool:
        return entry in self._entries

    def entries(self) -> dict[str, Any]:
        """A copy of every entry, for reports and tests."""
        return dict(self._entries)

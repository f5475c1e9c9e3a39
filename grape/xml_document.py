"""Reads an XML file into elements that know where they stand; hostile files are refused before they cost anything."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from grape.errors import FileError, Problem

MAX_BYTES = 1_000_000
MAX_DEPTH = 100
MAX_ELEMENTS = 20_000


@dataclass(kw_only=True)
class Element:
    """One XML element with its place in the file; line and column count from 1."""

    tag: str
    attributes: dict[str, str]
    file: str
    line: int
    column: int
    places: dict[str, tuple[int, int]] = field(default_factory=dict)
    children: list[Element] = field(default_factory=list)
    text: str = ""

    def problem(self, got: str, allowed: str = "", suggestion: str = "", attribute: str = "") -> Problem:
        """A problem at this element, or at one of its attributes."""
        line, column = self.places.get(attribute, (self.line, self.column))
        return Problem(
            file=self.file, line=line, column=column, path=self.tag, got=got, allowed=allowed, suggestion=suggestion
        )


class _Refused(Exception):
    """Raised inside parser callbacks."""


class _Builder:
    def __init__(self, file: str, source: bytes) -> None:
        self.file = file
        self.source = source
        self.root: Element | None = None
        self.open: list[Element] = []
        self.count = 0
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self.start
        self.parser.EndElementHandler = self.end
        self.parser.CharacterDataHandler = self.data
        self.parser.StartDoctypeDeclHandler = self.doctype

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self.count += 1
        if len(self.open) >= MAX_DEPTH or self.count > MAX_ELEMENTS:
            raise _Refused(f"the file is deeper than {MAX_DEPTH} levels or has more than {MAX_ELEMENTS} elements")
        line, column = self.parser.CurrentLineNumber, self.parser.CurrentColumnNumber + 1
        places = attribute_places(self.source, self.parser.CurrentByteIndex, line, column) if attributes else {}
        element = Element(tag=tag, attributes=attributes, file=self.file, line=line, column=column, places=places)
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.root = element
        self.open.append(element)

    def end(self, tag: str) -> None:
        self.open.pop()

    def data(self, text: str) -> None:
        if self.open:
            self.open[-1].text += text

    def doctype(self, *declaration: object) -> None:
        raise _Refused("a document type declaration (entities) is not accepted")


_ATTRIBUTE = re.compile(rb"""\s+([^\s=/>]+)\s*=\s*("[^"]*"|'[^']*')""")


def attribute_places(source: bytes, start: int, line: int, column: int) -> dict[str, tuple[int, int]]:
    """Line and column of every attribute of the start tag that begins at byte `start` of UTF-8 text."""
    places: dict[str, tuple[int, int]] = {}
    name_end = re.compile(rb"<[^\s/>]+").match(source, start)
    position, passed = name_end.end() if name_end else start, start
    while match := _ATTRIBUTE.match(source, position):
        before = source[passed : match.start(1)].decode("utf-8", "replace")
        newlines = before.count("\n")
        line += newlines
        column = len(before) - before.rfind("\n") if newlines else column + len(before)
        places[match[1].decode("utf-8", "replace")] = (line, column)
        position, passed = match.end(), match.start(1)
    return places


def read_document(path: Path, max_bytes: int = MAX_BYTES) -> Element:
    """The root element of an XML file.

    Raises:
        FileError: unreadable, too large, too deep, not well-formed, or with a document type declaration.
    """

    def refuse(got: str, allowed: str = "", line: int = 0, column: int = 0) -> FileError:
        return FileError([Problem(file=str(path), line=line, column=column, got=got, allowed=allowed)])

    try:
        with path.open("rb") as stream:
            source = stream.read(max_bytes + 1)
    except OSError as error:
        raise refuse(f"cannot be read: {error.strerror or error}", "a readable XML file") from error
    if len(source) > max_bytes:
        raise refuse("the file is too large", f"at most {max_bytes} bytes")
    return parse_document(source, str(path))


def parse_document(source: bytes, file: str) -> Element:
    """The root element of XML text; `file` is the name that problems carry.

    Raises:
        FileError: as `read_document`.
    """
    builder = _Builder(file, source)
    try:
        builder.parser.Parse(source, True)
    except expat.ExpatError as error:
        problem = Problem(file=file, line=error.lineno, column=error.offset + 1, got=f"not well-formed XML: {error}")
        raise FileError([problem]) from error
    except _Refused as error:
        line, column = builder.parser.CurrentLineNumber, builder.parser.CurrentColumnNumber + 1
        raise FileError([Problem(file=file, line=line, column=column, got=str(error))]) from error
    except (ValueError, LookupError) as error:
        raise FileError([Problem(file=file, got=f"cannot be decoded: {error}", allowed="UTF-8")]) from error
    if builder.root is None:
        raise FileError([Problem(file=file, got="the file holds no element")])
    return builder.root

"""XML elements that know where they stand; document types and entities are refused."""

from __future__ import annotations

import html
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any
from xml.parsers import expat

from qsframework.errors import InputError, Problem

_DEEPEST, _MOST = 200, 50_000
"""Elements inside each other, and elements, of one file."""


def quoted(value: str) -> str:
    """The value of an attribute, in quotes. The standard library's `quoteattr` loads all of `urllib` with it."""
    escaped = html.escape(value)
    for blank in "\t\n\r":
        escaped = escaped.replace(blank, f"&#{ord(blank)};")
    return f'"{escaped}"'


@dataclass(frozen=True)
class XmlPlace:
    """File and line of an element."""

    file: str
    line: int | None

    def problem(self, message: str, **more: Any) -> Problem:
        """A problem that stands here."""
        return Problem(message, file=self.file, line=self.line, **more)

    def __str__(self) -> str:
        return f"line {self.line}" if self.line else self.file


@dataclass
class Node:
    """An element: tag, attributes, children and place. Text is not kept, URDF has none."""

    tag: str
    attributes: dict[str, str]
    place: XmlPlace
    children: list[Node] = field(default_factory=list["Node"])

    def all(self, tag: str) -> Iterator[Node]:
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> Node | None:
        return next(self.all(tag), None)

    def get(self, name: str, default: str = "") -> str:
        return self.attributes.get(name, default)


Start = tuple[str, int, int, dict[str, str]]
"""A start tag in the text: name, byte offset, line, attributes."""


def parse(text: str, file: str) -> Node:
    """The tree of an XML text. InputError with the line if it is not well formed."""
    root, _ = _read(text, file)
    return root


def starts(text: str, file: str) -> list[Start]:
    """All start tags of an XML text, in order."""
    return _read(text, file)[1]


def _read(text: str, file: str) -> tuple[Node, list[Start]]:
    parser = expat.ParserCreate("utf-8")
    top = Node("", {}, XmlPlace(file, 1))
    stack: list[Node] = [top]
    found: list[Start] = []

    def refuse(*_: Any) -> None:
        message = "a document type (DOCTYPE) or entity is not allowed in a robot file"
        raise InputError(XmlPlace(file, parser.CurrentLineNumber).problem(message, hint="Remove it."))

    def start(tag: str, attributes: dict[str, str]) -> None:
        node = Node(tag, attributes, XmlPlace(file, parser.CurrentLineNumber))
        if len(stack) > _DEEPEST or len(found) >= _MOST:
            words = "elements are nested too deeply" if len(stack) > _DEEPEST else f"holds more than {_MOST} elements"
            raise InputError(node.place.problem(words))
        found.append((tag, parser.CurrentByteIndex, parser.CurrentLineNumber, attributes))
        stack[-1].children.append(node)
        stack.append(node)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: stack.pop()
    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    try:
        parser.Parse(text.encode("utf-8"), True)
    except expat.ExpatError as error:
        reason = expat.errors.messages.get(error.code, str(error))
        hint = "The file looks cut off." if len(stack) > 1 and reason == "no element found" else None
        raise InputError(
            XmlPlace(file, error.lineno).problem(f"is not well-formed XML: {reason}", hint=hint)
        ) from error
    return top.children[0], found

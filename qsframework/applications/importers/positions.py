"""Taught positions as controllers write them in their programmes: FANUC's P[1], KUKA's E6AXIS; angles in degrees."""

from __future__ import annotations

import re
from collections.abc import Iterator

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_FANUC = re.compile(r"\bP\[\s*\d+\s*(?::\s*\"([^\"]*)\")?\s*\]\s*\{([^{}]*)\}")
_FANUC_AXIS = re.compile(rf"\bJ(\d)\s*=\s*({_NUMBER})\s*deg")
_KUKA = re.compile(r"\b(?:E6AXIS\s+)?(\w+)\s*=\s*\{([^{}]*)\}")
_KUKA_AXIS = re.compile(rf"\bA(\d)\s+({_NUMBER})")


def positions(text: str) -> tuple[tuple[str, ...], list[tuple[int, tuple[str, ...]]]] | None:
    """Header and rows, each with its line, of the positions in joint angles that a text holds; None if it holds none.

    A FANUC position has the name that stands in it, if any; a KUKA one that of its variable, without the X in front.
    """
    for letter, found in (("J", list(_fanuc(text))), ("A", list(_kuka(text)))):
        axes = min((len(angles) for _, _, angles in found), default=0)
        if axes:
            header = ("name", *(f"{letter}{k + 1} [deg]" for k in range(axes)))
            return header, [(line, (name, *angles[:axes])) for line, name, angles in found]
    return None


def _fanuc(text: str) -> Iterator[tuple[int, str, list[str]]]:
    for found in _FANUC.finditer(text):
        angles = _axes(_FANUC_AXIS.findall(found[2]))
        if angles:
            yield text.count("\n", 0, found.start()) + 1, found[1] or "", angles


def _kuka(text: str) -> Iterator[tuple[int, str, list[str]]]:
    for found in _KUKA.finditer(text):
        angles = _axes(_KUKA_AXIS.findall(found[2]))
        if angles:
            yield text.count("\n", 0, found.start()) + 1, re.sub(r"^X(?=\w)", "", found[1]), angles


def _axes(pairs: list[tuple[str, str]]) -> list[str]:
    """The angles of axes 1, 2, ... as far as they follow each other."""
    own = dict(pairs)
    out: list[str] = []
    while str(len(out) + 1) in own:
        out.append(own[str(len(out) + 1)])
    return out

"""Variables that a programme gives to routines, and which of these routines may change them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from qsframework.applications.programmes.source import SourceStatement, Token


@dataclass(frozen=True, kw_only=True)
class Given:
    """A variable that a routine is given: in which statement and routine, as which of the arguments (by its number
    from 0, or by its name); caller: the routine's name as the programme writes it, as variable is."""

    statement: SourceStatement
    within: str
    caller: Token
    place: int | str
    variable: str

    @property
    def routine(self) -> str:
        """Its folded name."""
        return self.caller.text.upper()


def changing(
    given: Sequence[Given],
    routines: Mapping[str, Mapping[int | str, str]],
    assigned: Iterable[tuple[str, str]],
    reads: re.Pattern[str],
) -> list[Given]:
    """Those whose routine may change the variable: it does so itself, hands it on to one that may, or is not known.

    Args:
        given: all of the programme.
        routines: its routines; by the places of their arguments the folded names, "" of an argument that is a copy.
        assigned: routines, and folded names of variables that they assign.
        reads: names of routines of the language that only read.
    """
    places = {
        (r, name): [p for p, n in own.items() if n == name] for r, own in routines.items() for name in own.values()
    }
    written = {(r, place) for r, name in assigned if name for place in places.get((r, name), ())}
    found, count = list[Given](), -1
    while count != len(written):
        count = len(written)
        found = [
            g
            for g in given
            if ((g.routine, g.place) in written if g.routine in routines else not reads.fullmatch(g.routine))
        ]
        for g in found:
            name = next((n for n in routines.get(g.within, {}).values() if n and n == _whole(g.variable)), "")
            written |= {(g.within, place) for place in places.get((g.within, name), ())} if name else set()
    return found


def _whole(variable: str) -> str:
    """The folded name of a variable without its element."""
    return variable.partition("[")[0].partition("{")[0].strip().upper()

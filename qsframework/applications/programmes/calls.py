"""Variables that a programme gives to routines, and which of these routines may change them."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
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
    changed, count, found = set(assigned), -1, list[Given]()
    while count != len(changed):
        count = len(changed)
        found = [g for g in given if _may_change(g, routines, changed, reads)]
        changed |= {(g.within, g.variable.partition("[")[0].partition("{")[0].upper()) for g in found}
    return found


def _may_change(
    given: Given,
    routines: Mapping[str, Mapping[int | str, str]],
    changed: Collection[tuple[str, str]],
    reads: re.Pattern[str],
) -> bool:
    if given.routine not in routines:
        return reads.fullmatch(given.routine) is None
    name = routines[given.routine].get(given.place)
    return name is None or (given.routine, name) in changed

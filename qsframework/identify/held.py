"""What a fit holds at nominal values, and what an error there does to its estimates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from qsframework.elastostatics import Model
from qsframework.estimation import Solution, propagated
from qsframework.experiment import ObservationModel
from qsframework.files import FileRecord, Lists, null
from qsframework.plugin import Array


@dataclass(frozen=True, eq=False)
class Held(FileRecord):
    """A parameter held at nominal: its stated sd, NaN where nobody states one, and by how much each estimate (p,) is
    wrong for one unit by which the parameter is."""

    name: str
    sd: Annotated[float, null(math.nan)]
    moved: Annotated[Array, Lists(1)]


def held_at_nominal(
    seen: ObservationModel, x: Array, solution: Solution, estimated: Sequence[str], aside: Sequence[str]
) -> tuple[Held, ...]:
    """What was not estimated of a model at values x (p,): where its sd is stated, or where it was asked for.

    A spring that was held rigid is not: nobody states how well that is known.
    """
    model = seen.model
    names = _held_names(model, x, estimated, aside)
    if not names:
        return ()
    rates = seen.rows.rates(model, x, seen.frames, names, seen.linear)[1][..., -len(names) :]
    moved = propagated(solution, seen.rows.noise.whiten(seen.rows.flat(rates)))
    sds = {p.name: math.nan if p.sd is None else p.sd for p in model.parameters}
    return tuple(Held(name, sds[name], column) for name, column in zip(names, moved.T, strict=True))


def _held_names(model: Model, x: Array, estimated: Sequence[str], aside: Sequence[str]) -> list[str]:
    parameters = zip(model.parameters, x.tolist(), strict=True)
    known = [p.name for p, value in parameters if p.name in aside or (p.sd is not None and value == p.nominal)]
    return [name for name in known if name not in estimated]

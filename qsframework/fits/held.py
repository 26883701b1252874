"""What a fit holds at nominal values, and what an error there does to its estimates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import starmap
from typing import Annotated

import numpy as np

from qsframework.elastostatics import Model
from qsframework.estimation import Solution, moments_held, propagated
from qsframework.experiment import ObservationModel
from qsframework.experiment.prior import Priors
from qsframework.files import FileRecord, Lists, null
from qsframework.plugin import Array


@dataclass(frozen=True, eq=False)
class Held(FileRecord):
    """A parameter held at nominal: the sd of that, NaN where nothing is known, by how much each estimate (p,) is wrong
    for one unit by which the parameter is, and E[d_i d] (h,) of its error and those of all h that were held, in the
    light of the residuals; 0 where nothing is known."""

    name: str
    sd: Annotated[float, null(math.nan)]
    moved: Annotated[Array, Lists(1)]
    moment: Annotated[Array, Lists(1)]


def held_at_nominal(
    seen: ObservationModel, x: Array, solution: Solution, estimated: Sequence[str], aside: Sequence[str]
) -> tuple[Held, ...]:
    """What was not estimated of a model at values x (p,), by name, as in a file: where something is known of it, or
    where it was asked for.

    A spring that was held rigid is not: nobody states how well that is known.
    """
    model = seen.model
    sds = dict(zip(model.names, _sds(model, seen.priors, x), strict=True))
    names = sorted(name for name, sd in sds.items() if (name in aside or np.isfinite(sd)) and name not in estimated)
    if not names:
        return ()
    rates = seen.rows.rates(model, x, seen.frames, names, seen.linear)[1][..., -len(names) :]
    columns, known = seen.rows.noise.whiten(seen.rows.flat(rates)), np.array([sds[name] for name in names])
    moments = moments_held(solution, columns, np.nan_to_num(known), seen.rows.stated)
    return tuple(starmap(Held, zip(names, known.tolist(), propagated(solution, columns).T, moments, strict=True)))


def _sds(model: Model, priors: Priors, x: Array) -> list[float]:
    """sds (q,) of values at nominal, NaN where nothing is known: of springs that are not fitted, and of what is fitted
    only by its own name, such as a balancer's pivots, too. A compliance of which nobody states an sd is known to its
    size."""
    springs, every = model.compliance_rows, enumerate(model.parameters)
    declared = np.array([p.sd or p.nominal_sd or abs(p.nominal) * (i in springs) or math.nan for i, p in every])
    known = np.where(np.isfinite(priors.sd), priors.sd, declared)
    return np.where(x == model.nominal, known, math.nan).tolist()

"""The smallest plan with which the tool stands where it is wanted to so much, or what limits it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Any

import numpy as np

from qsframework.elastostatics import Site
from qsframework.errors import NotIdentifiable
from qsframework.experiment import Experiment, Plan
from qsframework.information.sensitivities import covariance_after, plan_columns
from qsframework.plans.candidates import Candidates
from qsframework.plans.design import design
from qsframework.plans.options import DesignOptions
from qsframework.plans.tip import tip_rows, unstated
from qsframework.plugin import Array, Poses
from qsframework.work import HERE, Work

COVERAGE = 2.0
"""Expanded uncertainty: times the root of the summed variances of the three coordinates."""
_FIRST, _NEVER = 8, 10**9
_STARTS = 5
"""Of each plan on the way there: the next few poses more are worth more than the best of many starts."""
_TRIES = 12
"""Plans that are made until the smallest is found."""
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False, kw_only=True)
class Needed:
    """plan: of the fewest poses that were found to reach the accuracy (m, k = 2) at all J points, or one that does not;
    reached (J,): what it gives at each

    least: no plan over the candidates of fewer poses reaches it, by its certificate; repeatability: what the arm's own
    adds to `reached`, m, k = 2; shares: of the variance at the worst point, by parameter, the largest first; poses: how
    many would reach it; sigma: by what factor smaller the noise would have to be for the most poses that are allowed
    """

    plan: Plan
    accuracy: float
    reached: Array
    least: int
    repeatability: float
    shares: tuple[tuple[str, float], ...]
    poses: float
    sigma: float

    @property
    def enough(self) -> bool:
        return bool(self.reached.max() <= self.accuracy)

    def as_json(self) -> dict[str, Any]:
        """Millimetres, as the names say."""
        return {
            "accuracy_mm": 1e3 * self.accuracy,
            "reached_mm": (1e3 * self.reached).tolist(),
            "enough": self.enough,
            "poses": len(self.plan.pose),
            "certified_least": self.least,
            "repeatability_mm": 1e3 * self.repeatability,
            "shares": dict(self.shares),
        }

    @property
    def worst(self) -> int:
        """The point with the largest error to be expected."""
        return int(np.argmax(self.reached))


def plan_for(
    experiment: Experiment,
    points: Poses,
    site: Site,
    accuracy: float,
    candidates: Candidates | Array,
    *,
    most: int = 200,
    seed: int = 0,
    options: DesignOptions | None = None,
    progress: Progress | None = None,
    work: Work = HERE,
) -> Needed:
    """The smallest plan after whose fit the point `site` is known to `accuracy`, m, k = 2, at every one of J poses.

    The position is meant after the best frame and tool, where the readings give them, else in the base frame.
    NotIdentifiable where not even `most` poses tell the parameters.
    """
    options = replace(
        options or DesignOptions(), criterion="I"
    )  # the mean over the points, whose bound holds for the largest too
    options = replace(options, starts=min(options.starts, _STARTS))
    repeatability = COVERAGE * np.sqrt(3.0) * (experiment.noise.repeatability or 0.0)
    wanted = (accuracy**2 - repeatability**2) / COVERAGE**2
    made: dict[int, Plan] = {}
    at = candidates.pendant if isinstance(candidates, Candidates) else candidates

    def value(count: int) -> float:
        """The largest variance (m^2) at the points after a plan of so many poses; inf where these tell too little."""
        if count not in made:
            try:
                made[count] = design(
                    experiment,
                    count,
                    candidates=candidates,
                    seed=seed,
                    options=options,
                    test_poses=points,
                    tip=site,
                    progress=progress,
                    work=work,
                )
            except NotIdentifiable:
                if count >= most:
                    raise
                return np.inf
        return float(tip_variances(experiment, made[count], points, site, at, options.free)[0].max())

    fewest, most = _allowed(experiment, most)
    first = max(_FIRST, fewest, ceil(2 * len(experiment.fit_names()) / (3 * len(experiment.markers))))
    count, least = _searched(value, made, wanted, min(first, most), fewest, most)
    plan = made[count]
    variances, shares = tip_variances(experiment, plan, points, site, at, options.free)
    short = max(value(count) / wanted, 1.0) if wanted > 0.0 else np.inf
    return Needed(
        plan=plan,
        accuracy=accuracy,
        reached=np.sqrt(COVERAGE**2 * variances + repeatability**2),
        least=least,
        repeatability=float(repeatability),
        shares=shares,
        poses=count * short,
        sigma=float(np.sqrt(count * short / most)),
    )


def _allowed(experiment: Experiment, most: int) -> tuple[int, int]:
    """The fewest and the most poses of a plan: what its loads ask for, and two for several parameters, which a fit of
    one pose alone refuses."""
    cases = experiment.cases
    asked = sum(case.poses or case.poses_min or 0 for case in cases)
    if cases and all(case.poses is not None for case in cases):
        return asked, asked
    fewest = max(asked, min(len(experiment.fit_names()), 2))
    return fewest, max(most, fewest)


def _searched(
    value: Callable[[int], float], made: dict[int, Plan], wanted: float, trial: int, fewest: int, most: int
) -> tuple[int, int]:
    """The fewest poses found with a value of at most `wanted`, or the last that were tried; and a bound on them.

    The value falls about as one over the number of poses.
    """
    bad, good, least, last = fewest - 1, 0, fewest, trial
    for _ in range(_TRIES):
        found = value(trial)
        if np.isfinite(found):
            last, least = trial, max(least, _fewest(made[trial], wanted))
        if found <= wanted:
            good = trial
        else:
            bad = trial
        if good - bad == 1 or bad >= most or least > most:
            break
        scaled = ceil(trial * found / wanted) if np.isfinite(found) else 2 * trial
        trial = min(max(scaled, bad + 1), good - 1 if good else most)
    return (good, min(least, good)) if good else (last, least)


def _fewest(plan: Plan, wanted: float) -> int:
    """How many poses any plan over the candidates needs, by the bound of a plan's certificate on the mean variance."""
    c = plan.certificate
    assert c is not None
    if wanted <= 0.0:
        return _NEVER
    return max(1, ceil(c.relaxed_efficiency * c.relaxed_value * c.poses / wanted - 1e-9))


def tip_variances(
    experiment: Experiment, plan: Plan, points: Poses, site: Site, candidates: Array, free: bool
) -> tuple[Array, tuple[tuple[str, float], ...]]:
    """Variances (J,) m^2 of the tip at the points after a plan, and which parameters make up the largest."""
    assert plan.certificate is not None
    names: Sequence[str] = plan.certificate.parameters
    beside = () if free else unstated(experiment, names)
    own, half = covariance_after(experiment.model(), plan_columns(experiment, plan, names), names, free)
    S = tip_rows(experiment, points, candidates, names, site, beside)[:, :, own]
    each = np.einsum("jcp,pq,jcq->jp", S, half @ half.T, S)
    worst = each[int(np.argmax(each.sum(axis=1)))]
    order = np.argsort(-worst)[:5]
    total = float(worst.sum())
    return each.sum(axis=1), tuple((names[own[int(i)]], float(worst[i]) / total) for i in order)

"""Whether all springs are off their nominal values by one common factor: a load or readings in another unit.

No residual shows it: in displacements a load of half the size is a spring of twice the compliance. What shows it is
what the robot's files state of the springs. With the identified compliances c_i and their nominal values n_i,

    log(c_i / n_i) = log f + e_i,   e ~ N(0, S + diag(tau_i^2) + s_load^2)

where S is the covariance of the log c by the delta method and s_load the stated relative sd of the load, common to
all. tau_i comes from the relative sd r that the files state of n_i: a normal value has in the logarithm, to second
order, the variance r^2 (1 + 2.5 r^2); where none is stated tau_i is 1, its natural size. log f is the mean, each spring
weighted by its own variance (weights of the whole covariance extrapolate where springs are correlated), and its sd that
of this mean under the whole covariance; f = 1 is tested on both sides. Where springs scatter about f more than that,
the sd grows with them (Birge): one soft joint among right ones is no common factor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from qsframework.estimation import scales
from qsframework.estimation.tails import chi2_sf, normal_isf
from qsframework.hypotheses.hypothesis import Hypothesis
from qsframework.hypotheses.linearized import Linearized
from qsframework.plugin import Array, Spring
from qsframework.robot.spec import PROPOSED
from qsframework.screening.conventions import compared
from qsframework.screening.mistake import Mistake

LEVEL = 2e-4
"""Of the test of f = 1. A normal prior has a longer lower tail than its logarithm's sd says: of arms drawn from stated
sds of 10 to 60 %, with 2 to 7 springs, at most .6 % are stopped at it (six springs: .3 %). Of six springs of 30 % that
are all doubled 80 % are found, of halved ones 92 %; of 50 % only units. The arm of examples/r2000ic, whose nominal
values are another maker's, has p = 1e-3 (f = 2.3)."""
_LEAST = float(np.log(np.sqrt(2.0)))
"""Of |log f|: nearer to 1 than to 2 or 1/2, which is the nearest factor that a unit or a count makes. Loads of another
day, a load cell's scale and gears that harden make some percent, beyond the sds of springs that were identified."""
_SCATTER = 0.05
"""Level from which the springs scatter more than their sds say."""
_CLEAR = 1.0
"""Relative sd up to which a compliance takes part: beyond it the delta method says nothing of its logarithm."""
_LIMIT = 1.96
_FACTORS = {
    9.80665: "the load is in kg (kgf, or daN) where the file says N",
    4.4482216: "the load is in lbf where the file says N",
    2.0: "half of the load stands in the file, as where two weights pull or a pulley doubles it",
    0.5: "the load is counted twice",
    1e3: "the load is in kN where the file says N, or the displacements in um where it says mm",
    1e-3: "the displacements are in m where the file says mm, or the load in N where it says kN",
    1.0 / 25.4: "the displacements are in inches where the file says mm",
    25.4: "the displacements are in mm where the file says inches",
    1.0 / 9.80665: "the load was multiplied by g once more, or is in N where the file says kg",
    0.1: "the displacements are in cm where the file says mm",
    1.0 / 4.4482216: "the load is in N where the file says lbf",
}
"""Factor of the compliances as fitted, which is (true load) / (load of the file), and what it stands for."""
_ANY = "the load or the readings are in another unit, or the load is counted wrong"
_GUESSED = "No source is stated of the nominal values, so that they may be what is wrong"


@dataclass(frozen=True)
class CommonFactor:
    """The factor of all compliances, and the sd of its logarithm."""

    value: float
    sd: float

    @property
    def off(self) -> bool:
        """Whether it is not 1."""
        return abs(float(np.log(self.value))) > max(float(normal_isf(0.5 * LEVEL)) * self.sd, _LEAST)

    @property
    def interval(self) -> tuple[float, float]:
        """95 %."""
        spread = float(np.exp(_LIMIT * self.sd))
        return self.value / spread, self.value * spread


def wrong_scale(linear: Linearized) -> tuple[Mistake, ...]:
    """A common factor of all springs. It stops what follows where files state where the nominal values are from, and is
    a note where `qsf new` proposed them or nobody says.

    Springs take part that are identified and have a nominal value; where they are fewer than those that are held, they
    give for these, and nothing is asked.
    """
    experiment, model, names = linear.experiment, linear.experiment.model(), linear.experiment.fit_names()
    fitted, springs = [model.parameters[i] for i in model.index(names)], model.names_of(Spring)
    size, nominal = scales(fitted), np.array([p.nominal for p in fitted])
    x, C = linear.estimates.x * size, linear.estimates.covariance * np.outer(size, size)
    clear = [k for k, sd in enumerate(np.sqrt(np.diag(C))) if fitted[k].name in springs and 0.0 < sd <= _CLEAR * x[k]]
    identified = [k for k in clear if nominal[k] > 0.0]
    sourced = [k for k in identified if fitted[k].source and not fitted[k].source.startswith(PROPOSED)]
    spread = np.array([log_sd(p.sd and p.sd / p.scale) for p in fitted])
    fewest = sum(p.name in springs and p.nominal > 0.0 and p.name not in names for p in model.parameters)
    for k, stops in ((sourced, True), (identified, False)):
        if len(k) >= max(2, fewest):
            scale = experiment.load_uncertainty.scale
            factor = common_factor(x[k], C[np.ix_(k, k)], nominal[k], spread[k], scale)
            if factor.off:
                return (_mistake(linear, factor, stops),)
    return ()


def common_factor(c: Array, C: Array, nominal: Array, spread: Array, load: float = 0.0) -> CommonFactor:
    """The factor of compliances c (k,), with covariance C (k, k), to nominal values (k,) of which the logarithm has the
    sd `spread` (k,); load: relative sd of all loads together."""
    ratio = np.log(c / nominal)
    V = C / np.outer(c, c) + np.diag(np.square(spread)) + load**2
    weight = 1.0 / np.diag(V)
    weight /= weight.sum()
    log = float(weight @ ratio)
    scatter, dof = float((ratio - log) @ np.linalg.solve(V, ratio - log)), len(c) - 1
    wider = scatter / dof if chi2_sf(scatter, dof) < _SCATTER else 1.0
    return CommonFactor(float(np.exp(log)), float(np.sqrt(wider * (weight @ V @ weight))))


def log_sd(relative: float | None) -> float:
    """sd of the logarithm of a value whose relative sd is stated, None where none is."""
    return 1.0 if relative is None else relative * float(np.sqrt(1.0 + 2.5 * relative**2))


def _mistake(linear: Linearized, factor: CommonFactor, stops: bool) -> Mistake:
    """The finding: with the first known factor in the interval applied to the loads, else with the one identified."""
    low, high = factor.interval
    known = {size: words for size, words in _FACTORS.items() if low < size < high}
    size = next(iter(known), factor.value)
    could_be = f"{', or '.join(known.values())} (a factor of {size:.4g})" if known else _ANY
    words = (
        f"all compliances come out about {factor.value:.3g} times their nominal values ({low:.3g} to {high:.3g}, "
        f"95 %): perhaps {could_be}; the fit absorbs it, so it cannot be proved from these readings"
    )
    poses = replace(linear.readings.poses, wrench=linear.readings.poses.wrench * size)
    readings = linear.readings.with_poses(poses)
    words = words if stops else f"{words}. {_GUESSED}"
    change = Hypothesis("load_unit", size, words, linear.experiment, readings=readings)
    return replace(compared(change, linear, linear, 0.0), stops=stops)

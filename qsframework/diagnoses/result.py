"""The result of a diagnosis: named causes with their evidence, their alternatives and what they gain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from enum import Enum
from typing import TYPE_CHECKING, Literal

import numpy as np

from qsframework.diagnoses.options import seen_below
from qsframework.hypotheses.catalogue.law import Law, LikelyPlace
from qsframework.plugin import Array, Indices, Parameter
from qsframework.viewed import Viewed

if TYPE_CHECKING:
    from qsframework.diagnoses.residuals.lack_of_fit import LackOfFit
    from qsframework.diagnoses.residuals.noise_components import NoiseAudit
    from qsframework.experiment import Experiment, Readings
    from qsframework.experiment.account import Account
    from qsframework.hypotheses.catalogue.causes import Cause
    from qsframework.hypotheses.columns import Case
    from qsframework.hypotheses.exact_refit import SettledFit
    from qsframework.hypotheses.search.cross_validation import HeldOut
    from qsframework.hypotheses.search.places import Competition
    from qsframework.screening import Mistake

_PLAIN = 9e-4
"""p-value of a name above which it explains nothing yet; 1,000 draws that none reaches say 1/1001, and no less."""
_CLEAR = 1.0
"""Standard errors by which the held-out gain of a learned law, and of a name that is barely seen, must be positive."""
_FEW, _CLEAR_OF_FEW = 20, 2.0
"""Poses below which the gain of a learned law, its laws averaged anew in each fold, must be clearer: of laws that were
written with less, four of six did harm at fresh poses."""
Verdict = Literal["none", "explained", "partly_explained", "unexplained"]
"""none: nothing acts; explained: names that leave nothing; partly_explained: names that leave something, or that could
as well be many others; unexplained: something is left, and nothing is named."""


class Status(Enum):
    """What the readings say of a cause, in the order of a table."""

    NAMED = "named"
    TIED = "cannot be separated"
    EXCLUDED = "excluded above"
    INVISIBLE = "invisible here"
    UNTESTED = "not tested"


@dataclass(frozen=True)
class Value:
    """An estimated parameter of a cause, SI: its change from `initial` is what the cause adds."""

    name: str
    unit: str
    value: float
    sd: float
    initial: float


@dataclass(frozen=True)
class AlternativeCause:
    """A cause that these readings cannot tell from the named one; angle (rad) between what the two can do."""

    name: str
    angle: float


@dataclass(frozen=True)
class Leftover:
    """A law that nobody has written and that the readings hold.

    p_value: family-wise; evidence: nats, beside all names, or beyond the name in whose place it stands (p then NaN)
    """

    law: Law
    p_value: float
    evidence: float


@dataclass(frozen=True, kw_only=True)
class NamedCause:
    """A named cause with its evidence.

    s: visible size in units of noise; p_value: family-wise; ebic_gain: by how much the extended BIC falls with it;
    heldout_gain: 1 - held-out RMS with all named causes / with all but this one, NaN for a convention; heldout_clear:
    by how many of its standard errors over the poses that lies above nothing; hangs_on: poses
    without any one or two of which the name changes; physics, check: what its effect says of itself, and what to look
    at on the real robot; both empty for a convention; instead: a law that nobody has written, which explains the
    readings as well in its place; further: kinds of causes that do something else to the readings, which do
    not exclude them either
    """

    name: str
    values: tuple[Value, ...]
    s: float
    p_value: float
    ebic_gain: float
    alternatives: tuple[AlternativeCause, ...]
    hangs_on: tuple[tuple[str, ...], ...]
    physics: str = ""
    check: str = ""
    heldout_gain: float = float("nan")
    heldout_clear: float = float("nan")
    instead: Leftover | None = None
    further: int = 0

    @property
    def doubtful(self) -> bool:
        """Whether the held-out error is not clearly smaller with it, in the noise that was found: not at all,
        or, for a name that is barely seen, by no more than chance may do."""
        return self.heldout_gain <= 0.0 or (self.faint and self.heldout_clear < _CLEAR)

    @property
    def open_alternative(self) -> bool:
        """Whether something else may be it: causes that these readings cannot tell from it, a law that explains them as
        well in its place, or chance."""
        return bool(self.alternatives or self.further) or self.instead is not None or self.faint

    @property
    def faint(self) -> bool:
        """Whether it is barely seen, and explains nothing yet: effects that nobody thought of look like that too."""
        return bool(self.p_value > _PLAIN)


def left_open(findings: Sequence[NamedCause], leftovers: Sequence[Leftover]) -> bool:
    """Whether an effect is present that the readings do not name."""
    return bool(leftovers) or any(f.doubtful or f.open_alternative for f in findings)


@dataclass(frozen=True)
class Alike:
    """A cause of the library that a learned law looks like.

    share: of the square of what the law does to the readings, which the cause can do as well; left: s of the rest;
    here: whether it acts at the law's place; turned: whether only with a sign that it cannot have
    """

    name: str
    share: float
    left: float
    here: bool
    turned: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class LearnedLaw:
    """The average of the likeliest laws where no known effect explains the readings.

    causes: effects and weights of the laws, the plainest first, and their shares; leftover: the evidence of the
    plainest; s: visible size in units of noise; alone: the exact fit with the plainest, beside the certain names; fit:
    the average; before, heldout: RMS per axis, m, at held-out poses without and with it; gain: 1 - the one / the other,
    in the noise; clear: by how many of its standard errors over the poses that lies above nothing; anew: the same where
    each fold averages its laws anew; poses: how many; physical: whether all values of the fit with the plainest lie
    within their bounds; alike: causes of the library that it looks like, the likest first
    """

    causes: tuple[Cause, ...]
    shares: tuple[float, ...]
    leftover: Leftover
    s: float
    alone: SettledFit
    fit: SettledFit
    before: float
    heldout: float
    gain: float
    clear: float
    anew: float
    poses: int
    physical: bool
    alike: tuple[Alike, ...] = ()

    @property
    def cause(self) -> Cause:
        """The plainest."""
        return self.causes[0]

    @property
    def name(self) -> str:
        return self.cause.name

    @property
    def holds(self) -> bool:
        """Whether held-out poses are clearly predicted better with it, all values being possible: else it is not
        written."""
        needed = _CLEAR_OF_FEW if self.poses < _FEW else _CLEAR
        return self.clear >= _CLEAR and self.anew >= needed and self.physical and self.s > 0.0


@dataclass(frozen=True, kw_only=True)
class Line:
    """One row of the table of all causes.

    s: what the baseline's residuals show of it; limits: of a cause that is not named, each parameter with the size (SI)
    above which it is excluded (95 %), None where the named causes do the same; reach: of an invisible cause, its units
    of noise at its typical size; needs: columns without which it is not tested; nearest and angle (rad): the cause
    hardest to tell from it
    """

    name: str
    status: Status
    s: float = float("nan")
    p_value: float = float("nan")
    values: tuple[Value, ...] = ()
    limits: tuple[tuple[Parameter, float], ...] | None = ()
    reach: float = 0.0
    needs: tuple[str, ...] = ()
    nearest: str = ""
    angle: float = float("nan")


@dataclass(frozen=True, kw_only=True)
class Errors:
    """RMS per axis, m: of the nominal, the identified and the extended model, on the readings and held out; `noise` is
    what the noise alone leaves. axes: how many were measured of a reading, in the mean."""

    nominal: float
    identified: float
    extended: float
    heldout_identified: float
    heldout_extended: float
    noise: float
    axes: float = 3.0

    def in_space(self, per_axis: float) -> float:
        """The 3D RMS, m, of which an RMS per axis over the same readings is a part."""
        return float(np.sqrt(self.axes)) * per_axis

    @property
    def space(self) -> Errors:
        """The same as 3D RMS."""
        return Errors(**{f.name: self.in_space(getattr(self, f.name)) for f in fields(self)[:-1]}, axes=1.0)

    @property
    def heldout_gain(self) -> float:
        return 1.0 - self.heldout_extended / self.heldout_identified


@dataclass(frozen=True)
class Method:
    """How a diagnosis came about.

    far: whether a named cause is so large that it is far from linear: the noise was audited again at its size, and the
    folds took the causes as given; unidentifiable: parameters held at nominal; one_pose: whether all are of one;
    lone: whether every visit has one marker, so that its own error and the visit's cannot be told apart
    """

    held: HeldOut
    far: bool
    unidentifiable: tuple[str, ...]
    one_pose: bool
    lone: bool


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Diagnosis(Viewed):
    """What the model gets wrong.

    baseline and extended: the exact fits without and with the named causes, certain: with those that are not doubtful,
    over the rows `kept` of `readings`; learned: a law that was learned of what the names leave; places: where that may
    be, or what acts in the place of an open name, or, where nothing is certain, which lead, those that hold 95 % of the
    evidence together; outliers: rows that belong to nothing; case: linearised at the baseline; before, after: their
    lack of fit; account: of the baseline, with the causes that are open: named and not doubtful; known: where something
    is open, the names that are certain; settled: the exact fit with these; competition: of all places and the other
    causes beside them
    """

    account: Account
    experiment: Experiment
    readings: Readings
    verdict: Verdict
    findings: tuple[NamedCause, ...]
    table: tuple[Line, ...]
    conventions: tuple[Mistake, ...]
    audit: NoiseAudit
    leftovers: tuple[Leftover, ...]
    places: tuple[LikelyPlace, ...]
    before: LackOfFit
    after: LackOfFit
    rms: Errors
    kept: Indices
    outliers: Indices
    baseline: SettledFit
    extended: SettledFit
    certain: SettledFit
    learned: LearnedLaw | None
    case: Case
    known: tuple[Cause, ...]
    settled: SettledFit
    competition: Competition
    method: Method
    level: float
    seed: int

    def values(self) -> Mapping[str, float]:
        """All parameters of the extended model by name, SI."""
        return dict(zip(self.extended.model.names, (float(v) for v in self.extended.x), strict=True))

    @property
    def open(self) -> bool:
        """Whether an effect is present that these readings do not name."""
        return left_open(self.findings, self.leftovers)

    @property
    def hinted(self) -> bool:
        """Whether some place leads though nothing is certain."""
        return bool(self.places) and not self.open

    @property
    def sure(self) -> tuple[NamedCause, ...]:
        """The named causes that are not doubtful."""
        return tuple(f for f in self.findings if not f.doubtful)

    @property
    def doubtful(self) -> tuple[NamedCause, ...]:
        """The named causes without which held-out poses are predicted as well."""
        return tuple(f for f in self.findings if f.doubtful)

    @property
    def plain_alone(self) -> tuple[Line, ...]:
        """Causes that are plain by themselves and are not named: what they show, the named ones do too."""
        return tuple(x for x in self.table if x.status is Status.EXCLUDED and x.p_value <= seen_below(self.level))

    def residuals(self) -> tuple[Array, Array]:
        """Of the kept rows (R, 3) m, before and after the extension."""
        return self.baseline.residuals, self.extended.residuals

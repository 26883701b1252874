"""What a plan would show, before anything is measured: the result of `forecast`."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from qsframework.diagnoses.unknown import UnknownOutlook
from qsframework.hypotheses.catalogue.causes import Cause, Untested
from qsframework.hypotheses.columns import Case
from qsframework.plugin import Array, Parameter


class Outlook(Enum):
    """What a plan would tell of a cause of realistic size."""

    NAMED = "can be named"
    DETECTED = "can be detected"
    INVISIBLE = "invisible here"


class Why(Enum):
    """Why a plan does not tell more of a cause."""

    NO_READING = "no reading of this plan depends on it"
    LITTLE_LOAD = "no reading loads it enough"
    ABSORBED = "confounded with the fitted parameters"
    SMALL = "only far above its typical size is it detected"
    ALIASES = "does the same to these readings as others"
    RIVAL = "only far above its typical size is it separated from its nearest alternative"


@dataclass(frozen=True)
class DetectableSize:
    """What one parameter of a cause must be, alone, to be seen.

    s: visible size at the typical size; detect, name: smallest deviation (SI) that is detected and that is named,
    inf where no realistic one is
    """

    parameter: Parameter
    s: float
    detect: float
    name: float


@dataclass(frozen=True, kw_only=True)
class Prospect:
    """What the plan would tell about one cause.

    nearest, angle (rad): the cause hardest to tell from it, its aliases apart; aliases: causes that do the same to
    these readings; why: it is invisible or cannot be named, None where it can; typical: what the readings show of it at
    its typical size, left: of that beside the fitted parameters, both in units of noise
    """

    cause: Cause
    status: Outlook
    sizes: tuple[DetectableSize, ...] = ()
    nearest: str = ""
    angle: float = float("nan")
    aliases: tuple[str, ...] = ()
    why: Why | None = None
    typical: float = float("nan")
    left: float = float("nan")

    @property
    def name(self) -> str:
        return self.cause.name


@dataclass(frozen=True)
class Pair:
    """Two causes at a small angle (rad), and the s from which one is not mistaken for the other."""

    first: str
    second: str
    angle: float
    s: float


@dataclass(frozen=True)
class PowerCurve:
    """Detection rate against s of causes with so many directions, which can only grow where they are one-sided."""

    dof: int
    one_sided: bool
    s: Array
    rate: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Foresight:
    """What a plan would detect, name and leave open.

    level: family-wise chance of an alarm where nothing acts; power: rate of detection at the sizes `detect`; share:
    rate of right names at the sizes `name`; angles (G, G) rad by the order of the prospects; groups: sets of causes
    that the plan cannot separate; pairs: the same, two by two; sigma m; unknown: of effects that no library holds,
    None where poses are no plan
    """

    prospects: tuple[Prospect, ...]
    untested: tuple[Untested, ...]
    pairs: tuple[Pair, ...]
    groups: tuple[tuple[str, ...], ...]
    angles: Array
    curves: tuple[PowerCurve, ...]
    case: Case
    poses: int
    sigma: float
    level: float
    power: float
    share: float
    seed: int
    unknown: UnknownOutlook | None = None

    def of(self, name: str) -> Prospect:
        """The prospect of a cause."""
        return next(p for p in self.prospects if p.name == name)

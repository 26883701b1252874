"""What a plan would show, before anything is measured: the result of `foresee`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from qsframework.diagnose.case import Case
from qsframework.diagnose.causes import Cause, Untested
from qsframework.diagnose.words import people_size
from qsframework.plugin import Array, Parameter

CAN_NAME = "can be named"
CAN_DETECT = "can be detected"
CANNOT_SEE = "invisible here"
NEEDS = "not tested"


@dataclass(frozen=True)
class Size:
    """What one parameter of a cause must be, alone, to be seen.

    s: visible size at the typical size; detect, name: smallest deviation (SI) that is detected and that is named,
    inf where no realistic one is
    """

    parameter: Parameter
    s: float
    detect: float
    name: float

    def words(self, size: float) -> str:
        """A size with its unit, and the parameter's own name where the cause has several."""
        own = self.parameter.name.rpartition("]")[2].partition(".")[2]
        said = people_size(self.parameter, size) if np.isfinite(size) else "never"
        return f"{own} {said}".strip()


@dataclass(frozen=True)
class Prospect:
    """What the plan would tell about one cause.

    nearest, angle (rad): the cause hardest to tell from it, its aliases apart; aliases: causes that do the same to
    these readings; reason: why it is invisible, or why it cannot be named
    """

    cause: Cause
    status: str
    sizes: tuple[Size, ...]
    nearest: str
    angle: float
    aliases: tuple[str, ...]
    reason: str

    @property
    def name(self) -> str:
        return self.cause.name

    def words(self, which: str) -> str:
        """The smallest sizes, `detect` or `name`, of all parameters."""
        if not self.sizes:
            return "-"
        return ", ".join(x.words(getattr(x, which)) for x in self.sizes)

    def as_json(self) -> dict[str, Any]:
        return {
            "id": self.name,
            "status": self.status,
            "sizes": [
                {"parameter": x.parameter.name, "unit": x.parameter.unit, "s_typical": x.s, "detect": _number(x.detect),
                 "name": _number(x.name), "detect_words": x.words(x.detect), "name_words": x.words(x.name)}
                for x in self.sizes
            ],
            "nearest": self.nearest,
            "angle_deg": _number(float(np.rad2deg(self.angle))),
            "aliases": list(self.aliases),
            "reason": self.reason,
        }  # fmt: skip


@dataclass(frozen=True)
class Pair:
    """Two causes at a small angle (rad), and the s from which one is not mistaken for the other."""

    first: str
    second: str
    angle: float
    s: float


@dataclass(frozen=True)
class Curve:
    """Detection rate against s of causes with so many directions."""

    label: str
    s: Array
    rate: Array


@dataclass(frozen=True, eq=False)
class Foresight:
    """What a plan would detect, name and leave open.

    level: family-wise chance of an alarm where nothing acts; power: rate of detection at the sizes `detect`; share:
    rate of right names at the sizes `name`; angles (G, G) rad by the order of the prospects; groups: sets of causes
    that the plan cannot separate; pairs: the same, two by two; sigma m
    """

    prospects: tuple[Prospect, ...]
    untested: tuple[Untested, ...]
    pairs: tuple[Pair, ...]
    groups: tuple[tuple[str, ...], ...]
    angles: Array
    curves: tuple[Curve, ...]
    case: Case
    poses: int
    sigma: float
    level: float
    power: float
    share: float
    seed: int

    def of(self, name: str) -> Prospect:
        """The prospect of a cause."""
        return next(p for p in self.prospects if p.name == name)

    def words(self) -> tuple[str, ...]:
        """What the plan can and cannot tell, in sentences."""
        seen = [p for p in self.prospects if p.status != CANNOT_SEE]
        named = [p for p in seen if p.status == CAN_NAME]
        said = [
            f"Of {len(self.prospects)} causes, {self.poses} poses at a noise of {1e3 * self.sigma:.3g} mm would detect "
            f"{len(seen)} and name {len(named)}, of realistic size ({100 * self.power:.0f} % detected, "
            f"{100 * self.share:.0f} % named right, {100 * self.level:.2g} % false alarms)."
        ]
        if self.groups:
            said.append("Cannot be separated: " + "; ".join(" / ".join(g) for g in self.groups) + ".")
        hidden: dict[str, list[str]] = {}
        for p in self.prospects:
            if p.status == CANNOT_SEE:
                hidden.setdefault(p.reason.partition(":")[0], []).append(p.name)
        said += [f"Invisible here, {why}: {', '.join(names)}." for why, names in hidden.items()]
        said += [f"{u.name} needs the column {' and '.join(u.needs)}." for u in self.untested]
        return tuple(said)

    def as_json(self) -> dict[str, Any]:
        """What `qsf diagnose --plan --json` holds; sizes in SI."""
        return {
            "poses": self.poses,
            "sigma_mm": 1e3 * self.sigma,
            "level": self.level,
            "power": self.power,
            "share": self.share,
            "seed": self.seed,
            "words": list(self.words()),
            "causes": [p.as_json() for p in self.prospects],
            "not_tested": [{"id": u.name, "needs": list(u.needs)} for u in self.untested],
            "pairs": [
                {"first": p.first, "second": p.second, "angle_deg": float(np.rad2deg(p.angle)), "s": _number(p.s)}
                for p in self.pairs
            ],
            "groups": [list(g) for g in self.groups],
        }


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None

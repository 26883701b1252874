"""What a physical law leaves open: a named number with a unit, bounds and a source."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import KW_ONLY, dataclass, replace

from qsframework.errors import PluginError


@dataclass(frozen=True)
class Parameter:
    """A scalar parameter of one effect at one place, in SI.

    name     `effect[where]`, or `effect[where].parameter` where the effect has more than one
    unit     SI unit as text, readable by pint: "rad/(N m)", "m", ""
    nominal  value before any reading
    typical  a realistic non-zero size: scales the parameter and sizes a hidden effect
    sd       standard deviation of the nominal value that files state, None if none does
    nominal_sd  the same of an arm as delivered, whose files state none: a maker's +- limit is two of it; None where
             nothing is known
    null     value at which the effect vanishes, None if this parameter alone cannot switch it off
    pull     sd about `null` by which every fit holds it, however many the readings: of laws that bend more freely than
             readings tell; None: the readings alone say it
    domain   what can exist, such as lengths above 0: no fit leaves it; `lower` and `upper` are kept only where asked
    earlier  where `nominal` was identified: the values that stood there before, the oldest first, each with the hashes
             of the readings that were used after it; None: a diagnosis of these readings added the effect
    by_name  estimated only where `fit` names the parameter itself: an effect's name stands for its others
    """

    name: str
    unit: str
    _: KW_ONLY
    nominal: float = 0.0
    typical: float = 1.0
    sd: float | None = None
    nominal_sd: float | None = None
    lower: float = -math.inf
    upper: float = math.inf
    null: float | None = 0.0
    source: str = ""
    by_name: bool = False
    pull: float | None = None
    domain: tuple[float, float] = (-math.inf, math.inf)
    earlier: tuple[tuple[float | None, tuple[str, ...]], ...] = ()

    def __post_init__(self) -> None:
        if not self.lower <= self.nominal <= self.upper:
            raise PluginError(
                f"{self.name}: nominal {self.nominal:g} is outside its bounds "
                f"[{self.lower:g}, {self.upper:g}] {self.unit}"
            )
        if not (math.isfinite(self.typical) and self.typical > 0):
            raise PluginError(f"{self.name}: typical must be a positive number, found {self.typical}")
        for key, sd in (("sd", self.sd), ("nominal_sd", self.nominal_sd)):
            if sd is not None and not (math.isfinite(sd) and sd > 0):
                raise PluginError(f"{self.name}: {key} must be positive or None, found {sd}")
        if self.pull is not None and (self.null is None or not (math.isfinite(self.pull) and self.pull > 0)):
            raise PluginError(f"{self.name}: pull must be positive, towards a null, found {self.pull}")

    def before(self, readings: Collection[str]) -> float:
        """The value before any of some readings (their hashes) was used: never one that was fitted to them."""
        found = next((value for value, used in self.earlier if not set(readings).isdisjoint(used)), self.nominal)
        return (self.null or 0.0) if found is None else found

    def identified_by(self, readings: Collection[str], added: bool = False) -> Parameter:
        """The parameter once a value identified from these readings stands in the place of its own, which it had
        unless a diagnosis of them added it."""
        if not readings or any(set(readings) <= set(used) for _, used in self.earlier):
            return self
        return replace(self, earlier=(*self.earlier, (None if added else self.nominal, tuple(readings))))

    @property
    def added(self) -> bool:
        """Whether a diagnosis of readings added the effect."""
        return bool(self.earlier) and self.earlier[0][0] is None

    @property
    def modifies(self) -> bool:
        """Whether it only says how the others of its effect act, so that no reading shows it without them, and
        something is known of it."""
        return self.null is None and self.nominal_sd is not None and not self.by_name

    @property
    def scale(self) -> float:
        """Size by which to scale this parameter in rank decisions and designs (> 0)."""
        if self.nominal != 0.0:
            return abs(self.nominal)
        return self.sd if self.sd is not None else self.typical

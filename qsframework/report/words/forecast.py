"""What a plan would show, before anything is measured, in words."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from qsframework.diagnoses.foresight import DetectableSize, Foresight, Outlook, PowerCurve, Prospect, Why
from qsframework.diagnoses.unknown import SIZE, PlaceOutlook, UnknownOutlook
from qsframework.errors import listed
from qsframework.hypotheses.catalogue.causes import REACH
from qsframework.report.blocks import Mark, Verdict
from qsframework.report.words.follow_up import mounts_words
from qsframework.report.words.law import place_words
from qsframework.report.words.sizes import grouped, people_size

_WORST = 3
"""Places that are told least of which it is said."""


def foresight_words(found: Foresight, hidden: bool = True) -> tuple[str, ...]:
    """What the plan can and cannot tell, in sentences; hidden: with all that it cannot show."""
    seen, named = _counts(found)
    said = [
        f"Of {len(found.prospects)} causes, {found.poses} poses at a noise of {1e3 * found.sigma:.3g} mm would detect "
        f"{seen} and name {named}, of realistic size ({100 * found.power:.0f} % detected, "
        f"{100 * found.share:.0f} % named right, {100 * found.level:.2g} % false alarms)."
    ]
    if found.groups:
        said.append("Cannot be separated: " + "; ".join(" / ".join(g) for g in found.groups) + ".")
    said += _hidden_words(found) if hidden else ()
    said += unknown_words(found.unknown) if found.unknown is not None else ()
    needs = grouped((u.needs, u.name) for u in found.untested)
    said += [f"Only with the column {' and '.join(own)}: {', '.join(names)}." for own, names in needs.items()]
    return tuple(said)


def _counts(found: Foresight) -> tuple[int, int]:
    """How many causes the plan would detect, and name."""
    outlooks = [p.status for p in found.prospects]
    return len(outlooks) - outlooks.count(Outlook.INVISIBLE), outlooks.count(Outlook.NAMED)


def _hidden_words(found: Foresight) -> Iterator[str]:
    """What the plan cannot show, and why."""
    hidden = grouped((p.why, p.name) for p in found.prospects if p.status is Outlook.INVISIBLE)
    yield from (f"Invisible here, {kind_words(why)}: {', '.join(names)}." for why, names in hidden.items())


def unknown_words(found: UnknownOutlook) -> Iterator[str]:
    """Where the plan would place what no library holds."""
    yield (
        f"Of effects of s = {SIZE:g} that no library holds, the right place would be ranked first in "
        f"{100 * found.chance:.0f} %, on average over the places."
    )
    worst = sorted((p for p in found.places if p.shown), key=lambda p: p.chance)[:_WORST]
    hard = [f"{place_words(p.place)} ({100 * p.chance:.0f} %{_else(p)})" for p in worst]
    if hard:
        yield f"Hardest to place: {listed(hard)}."
    yield from mounts_words(found.mounts, found.chance, "in the same plan")
    hidden = [place_words(p.place) for p in found.places if not p.shown]
    if hidden:
        yield f"No reading of this plan shows an extra motion of {listed(hidden)}."


def _else(p: PlaceOutlook) -> str:
    return "" if p.instead is None else f", else {place_words(p.instead)}"


def kind_words(why: Why | None) -> str:
    """Why a plan does not tell more, without numbers."""
    if why is Why.SMALL:
        return f"only above {REACH:g} times its typical size is it detected"
    return "" if why is None else why.value


def why_words(p: Prospect) -> str:
    """Why the plan does not tell more of a cause."""
    if p.why is Why.LITTLE_LOAD:
        return f"{kind_words(p.why)}: {p.typical:.2g} units of noise at its typical size"
    if p.why is Why.ABSORBED:
        rest = f"{p.left:.2g} are left" if p.left >= 1e-3 else "nothing is left"
        return f"{kind_words(p.why)}: of {p.typical:.2g} units of noise at its typical size {rest}"
    if p.why is Why.ALIASES:
        return f"does the same to these readings as {', '.join(p.aliases)}"
    if p.why is Why.RIVAL:
        return f"only above {REACH:g} times its typical size is it separated from {p.nearest or 'noise'}"
    return kind_words(p.why)


def smallest_words(p: Prospect, named: bool = False) -> str:
    """The smallest sizes of all parameters that are detected, or that are named."""
    return ", ".join(size_words(x, x.name if named else x.detect) for x in p.sizes) or "-"


def size_words(x: DetectableSize, size: float) -> str:
    """A size with its unit, and the parameter's own name where the cause has several."""
    own = x.parameter.name.rpartition("]")[2].partition(".")[2]
    said = people_size(x.parameter, size) if np.isfinite(size) else "never"
    return f"{own} {said}".strip()


def curve_words(curve: PowerCurve) -> str:
    """Of which causes the rate is."""
    if curve.one_sided:
        return "1 direction that can only grow"
    return f"{curve.dof} direction{'s' if curve.dof > 1 else ''}"


def foresight_verdict(found: Foresight) -> Verdict:
    """How many causes the plan would detect and name."""
    seen, named = _counts(found)
    plain = named == len(found.prospects)
    return Verdict(
        Mark.GOOD if plain else Mark.LOOK,
        "Every cause would be named" if plain else "Not every cause would be named",
        foresight_words(found)[0],
        (
            (f"{named} of {len(found.prospects)}", "causes named"),
            (f"{seen} of {len(found.prospects)}", "causes detected"),
            (f"{len(found.groups)}", "groups of effects that cannot be separated"),
            (f"{found.poses}", "poses"),
        ),
    )

"""The visits of a second day, and what could be mounted for it, in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from qsframework.diagnoses.explanations import Suspect
from qsframework.diagnoses.mounts import GAUGE, Mount
from qsframework.diagnoses.second_day import FollowUp
from qsframework.experiment.setup import WORLD
from qsframework.hypotheses.catalogue.causes import Cause
from qsframework.report.words.law import place_words, variable_words

WORTH = 0.03
"""By how much further visits, or what is mounted, must raise the chance of the right place to be told."""
_MOUNTS = 3


def follow_up_words(found: FollowUp) -> Iterator[str]:
    """What the visits of a second day would settle, and what would settle more."""
    count = len(found.plan.pose)
    yield (
        f"{count} visits bring the chance of naming the right place from {percent(found.before)} to "
        f"{percent(found.after)}, with its variable from {percent(found.variable_before)} to "
        f"{percent(found.variable_after)}, if one of the remaining explanations is true."
    )
    yield from mounts_words(found.mounts, found.after, "at these visits")


def mounts_words(mounts: Sequence[Mount], chance: float, when: str) -> Iterator[str]:
    """What would raise the chance of the right place, if mounted."""
    better = [m for m in mounts if m.chance > chance + WORTH]
    for m in better[:_MOUNTS]:
        yield f"With {mount_words(m)} {when}: {percent(m.chance)}."
    if mounts and not better:
        yield "No further reflector or gauge would help much."


def mount_words(mount: Mount) -> str:
    """A reflector that is to be mounted, or a gauge."""
    where = ", ".join(f"{1e3 * v:.0f}" for v in mount.marker.xyz)
    on = "the floor (link: world)" if mount.marker.link == WORLD else mount.marker.link
    what = f"a dial gauge ({1e6 * GAUGE:.0f} um) along {mount.along}" if mount.along else "a reflector"
    return f"{what} on {on} at [{where}] mm"


def suspect_words(suspect: Suspect) -> str:
    """An remaining explanation."""
    if isinstance(suspect.law, Cause):
        return suspect.law.name
    law = suspect.law.law
    return f"{place_words(law)}, by {variable_words(law)}"


def percent(rate: float) -> str:
    """A chance, in percent."""
    if rate < 1e-4:
        return "less than 0.01 %"
    return f"{100 * rate:.0f} %" if rate >= 0.01 else f"{100 * rate:.2g} %"

"""Poses and other readings that tell two causes apart, and the visits of a second day, in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from qsframework.diagnose.linearization.candidates import Cause
from qsframework.discriminate.alternatives import Offer
from qsframework.discriminate.explanations import Suspect
from qsframework.discriminate.follow_up import FollowUp
from qsframework.discriminate.mounts import GAUGE, Mount
from qsframework.discriminate.pair import CLOSE, ENOUGH, SEEN, Discrimination, mistaken
from qsframework.discriminate.separations import NotSeparated
from qsframework.experiment import LoadCase, Marker
from qsframework.experiment.setup import WORLD
from qsframework.report.words.law import place_words, variable_words
from qsframework.report.words.sizes import people_size

_WORTH = 0.03
"""By how much what is mounted must raise the chance of the right place to be told."""
_MOUNTS = 3


def discrimination_words(pair: Discrimination) -> tuple[str, ...]:
    """What the poses reach, and what else would."""
    return (*_poses(pair), *_offers(pair))


def _poses(pair: Discrimination) -> Iterator[str]:
    count, first = len(pair.plan.pose), f"{pair.first} ({size_words(pair)}) against {pair.second}"
    if not pair.useful:
        apart = f", however many: the angle stays below {degrees(max(pair.limit, np.deg2rad(1.0)))} deg"
        rest = apart if pair.limit < CLOSE else ", s stays near 0"
        yield f"{first}: no more poses like these separate them{rest}."
        return
    most = f"at most {pair.bound:.1f} by any {count} of {pair.candidates} candidates"
    yield (
        f"{first}: {count} more poses bring s from {pair.s_before:.1f} to {pair.s_after:.1f} ({most}) and the angle "
        f"from {degrees(pair.angle_before)} to {degrees(pair.angle_after)} deg; the wrong one then fits better in "
        f"{_percent(mistaken(pair.s_after))} of measurements instead of {_percent(mistaken(pair.s_before))}."
    )
    if not pair.helps:
        yield f"That is too little at this size; from {size_words(pair, ENOUGH / pair.s_after)} on it is enough."


def _offers(pair: Discrimination) -> Iterator[str]:
    if not pair.offers:
        return
    some = [o for o in pair.offers if o.s >= SEEN]
    yield "Measure something different:" if some else "Nothing that was tried separates them: they stay a set."
    for o in some:
        from_size = f", enough from {size_words(pair, ENOUGH / o.s)} on" if o.s < ENOUGH else ""
        yield f"- {offer_words(o)}: s = {o.s:.1f}, angle {degrees(o.angle)} deg{from_size}"
    rest = [o.name for o in pair.offers if o.s < SEEN]
    if some and rest:
        yield f"No help: {', '.join(rest)}."


def size_words(pair: Discrimination, share: float = 1.0) -> str:
    """The first cause's size, or a multiple of it, as people say it."""
    values = zip(pair.parameters, pair.values.tolist(), strict=True)
    return ", ".join(people_size(p, share * v) for p, v in values if v)


def outlook_words(pair: Discrimination) -> str:
    """In a few words, what would tell the two."""
    best = max((o for o in pair.offers if o.s >= SEEN), key=lambda o: o.s, default=None)
    offer = "" if best is None else f"{offer_words(best)} would{_from(pair, best.s)}"
    if pair.useful:
        poses = f"{len(pair.plan.pose)} more poses would separate it from {pair.second}{_from(pair, pair.s_after)}"
        return f"{poses}, {offer}" if best is not None and best.s > pair.s_after else poses
    if offer:
        return f"no more poses like these separate it from {pair.second}, {offer}"
    return f"nothing that was tried separates it from {pair.second}"


def _from(pair: Discrimination, s: float) -> str:
    return "" if s >= ENOUGH else f" from {size_words(pair, ENOUGH / s)} on"


def offer_words(offer: Offer) -> str:
    """What to measure instead of more poses."""
    if isinstance(offer.other, LoadCase):
        return f"the load {offer.other.name}"
    if isinstance(offer.other, Marker):
        where = ", ".join(f"{1e3 * v:.0f}" for v in offer.other.xyz)
        return f"a marker on {offer.other.link} at [{where}] mm beside the others"
    return "absolute positions, unloaded and loaded, with the geometry fitted"


def not_separated_words(missing: Sequence[NotSeparated]) -> tuple[str, ...]:
    """Pairs that nothing was computed of, and why."""
    return tuple(f"What would separate {x.first} from {x.second} was not computed: {x.error}" for x in missing)


def follow_up_words(found: FollowUp) -> Iterator[str]:
    """What the visits of a second day would settle, and what would settle more."""
    count = len(found.plan.pose)
    yield (
        f"{count} visits bring the chance of naming the right place from {_percent(found.before)} to "
        f"{_percent(found.after)}, with its variable from {_percent(found.variable_before)} to "
        f"{_percent(found.variable_after)}, if one of the explanations that are open is true."
    )
    yield from mounts_words(found.mounts, found.after, "at these visits")


def mounts_words(mounts: Sequence[Mount], chance: float, when: str) -> Iterator[str]:
    """What would raise the chance of the right place, if mounted."""
    better = [m for m in mounts if m.chance > chance + _WORTH]
    for m in better[:_MOUNTS]:
        yield f"With {mount_words(m)} {when}: {_percent(m.chance)}."
    if mounts and not better:
        yield "No further reflector or gauge would help much."


def mount_words(mount: Mount) -> str:
    """A reflector that is to be mounted, or a gauge."""
    where = ", ".join(f"{1e3 * v:.0f}" for v in mount.marker.xyz)
    on = "the floor (link: world)" if mount.marker.link == WORLD else mount.marker.link
    what = f"a dial gauge ({1e6 * GAUGE:.0f} um) along {mount.along}" if mount.along else "a reflector"
    return f"{what} on {on} at [{where}] mm"


def suspect_words(suspect: Suspect) -> str:
    """An explanation that is open."""
    if isinstance(suspect.law, Cause):
        return suspect.law.name
    law = suspect.law.law
    return f"{place_words(law)}, by {variable_words(law)}"


def degrees(angle: float) -> str:
    """An angle in whole degrees, "-" where there is none."""
    return f"{np.rad2deg(angle):.0f}" if np.isfinite(angle) else "-"


def _percent(rate: float) -> str:
    if rate < 1e-4:
        return "less than 0.01 %"
    return f"{100 * rate:.0f} %" if rate >= 0.01 else f"{100 * rate:.2g} %"

"""Gross readings: those that do not belong under the fitted model, nor under a richer one.

A model that is too small leaves large errors at good readings: folded arms, large sag. A row is gross only where the
robot's whole geometry, its springs and its sag, each held to its natural size, do not explain it either.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qsframework.errors import InputError, QsfError
from qsframework.estimation import LinearFit
from qsframework.estimation.linear_fit import Agreed
from qsframework.estimation.projection import Flags, least_squares
from qsframework.experiment import Experiment, ObservationModel, ReadingRows, Readings, observation_model
from qsframework.experiment.observations import make_rows
from qsframework.hypotheses.catalogue.rows import WrongRows, lines, wrong_rows
from qsframework.hypotheses.linearized import agreed, visits_of
from qsframework.plugin import Array, Effect, Indices
from qsframework.plugin.build import build_effects
from qsframework.plugin.registry import with_role
from qsframework.plugin.settings import place_fields, plural

GROSS = 7.0
"""A reading is gross beyond so many robust standard deviations of one coordinate."""
SHARE = 0.05
"""Of the readings: more than these are not masked unless somebody asks for it, for then something else is wrong."""
_WHOLE = ("marker offset", "joint zero", "joint placement", "sag", "gear")
"""Roles of the effects of the richer model, where the robot has room for them."""
_REACH = 5.0
"""Natural sizes by which the richer model's own parameters are held to their nominal values."""
_MEDIANS = {1: 0.6745, 2: 1.1774, 3: 1.5382}
"""Median of the norm of so many unit normals."""
_FEW = 8
"""Rows of one series and carrier below which their noise is that of all rows."""
_SEVERAL = 5
"""Gross rows below which nothing is said of the joint angles."""
_FLOOR = 1e-3
_EVIDENCE = 10.0
"""Log of how much likelier errors of the angles must be than errors in all directions."""
_PART = 5_000
"""Rows of a long table that are judged together."""
_MARKERS = 500
"""The offsets of more markers than these are not fitted: such a tool is judged by its rigidity alone."""
_BLOCK = 0.6
"""Share of the rows of a series, marker or stretch that are gross, from which they are told as one block."""


@dataclass(frozen=True, eq=False)
class Outliers:
    """gross (R,): rows of a fit that belong under neither model; missed (R,): those that only the fitted one misses."""

    gross: Flags
    missed: Flags
    size: Array
    angles: float | None = None
    """sd, rad, of errors of the joint angles that would make the gross rows as they are; None: they are otherwise"""

    @property
    def share(self) -> float:
        """Of the rows, that are gross."""
        return float(self.gross.mean())


def find_outliers(experiment: Experiment, readings: Readings, names: Sequence[str] | None = None) -> Outliers | None:
    """Rows in use that are gross, from linear fits about the nominal arm; None where no fit can be made.

    Long tables are judged in parts, each of every so many-th visit: a richer model is known well enough from either.
    """
    experiment = experiment if names is None else experiment.with_(fit=tuple(names))
    if len(experiment.markers) > _MARKERS:
        return None
    try:
        rows = make_rows(readings)
        parts = _parts(rows)
        found = [_in_part(experiment, readings.of_rows(part)) for part in parts]
    except (QsfError, np.linalg.LinAlgError):
        return None
    order = np.argsort(np.concatenate(parts))
    gross, missed, size = (
        np.concatenate([getattr(f, name) for f in found])[order] for name in ("gross", "missed", "size")
    )
    angles = [f.angles for f in found if f.angles is not None]
    return Outliers(gross, missed, size, float(np.median(angles)) if 2 * len(angles) > len(found) else None)


def _parts(rows: ReadingRows) -> list[Indices]:
    """Places of rows in the readings, in parts of about `_PART` rows of whole visits."""
    count = -(-len(rows.keep) // _PART)
    visit = visits_of(rows).of % count
    return [rows.keep[visit == k] for k in range(count)]


def _in_part(experiment: Experiment, readings: Readings) -> Outliers:
    wide = widened(experiment, readings)
    agreed = _agreed(wide)
    size = _in_sds(wide, agreed.misfit, agreed.wrong)
    gross = size > GROSS
    fitted = set(experiment.fit_names())
    own = np.array([True] * wide.motions + [n in fitted for n in wide.names])
    rows = wide.rows
    small = agreed.columns.take(own).fit(~gross[rows.row])[0]
    missed = _in_sds(wide, small.misfits(rows.row, len(gross)), gross) > GROSS
    return Outliers(gross, missed & ~gross, size, _angle_errors(wide, gross))


def _angle_errors(seen: ObservationModel, gross: Flags) -> float | None:
    """sd (rad) of joint angles that were logged wrongly, where the gross rows err as such angles would make them.

    Errors of the angles move a marker along the columns of its Jacobian, others in all directions alike: the two
    normal distributions of the errors, each of its likeliest size, are compared.
    """
    rows = seen.rows
    bad = np.flatnonzero(gross & (rows.minus < 0) & rows.mask.all(axis=1) & (_links(seen) > 0))
    turning = {p.name for p in seen.model.parameters if p.unit == "rad"}
    offsets = [n for n in seen.model.of_role("joint zero") if n in seen.names and n in turning]
    if len(bad) < _SEVERAL or not offsets:
        return None
    good = rows.take(~gross)
    frames = good.start(seen.model, seen.x)
    predicted, J = rows.rates(seen.model, seen.x, frames, seen.names, linear=True)
    kept = np.flatnonzero(~gross)
    A = rows.take(kept).flat(J[kept])
    x = least_squares(A, rows.take(kept).flat((rows.measured - predicted)[kept]), 1e-8)
    error: Array = rows.measured[bad] - predicted[bad] - J[bad] @ x
    columns = J[bad][:, :, [seen.motions + seen.names.index(n) for n in offsets]]
    S = columns @ columns.transpose(0, 2, 1)
    S = S + _FLOOR * np.trace(S, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    weighed = np.asarray(np.linalg.solve(S, error[..., None]), dtype=np.float64)[..., 0]
    square = np.einsum("ri,ri->r", error, weighed)
    count = error.size
    angular = -0.5 * float(np.linalg.slogdet(S)[1].sum()) - 0.5 * count * float(np.log(square.sum() / count))
    plain = -0.5 * count * float(np.log((error**2).sum() / count))
    return float(np.sqrt(square.sum() / count)) if angular - plain > _EVIDENCE else None


def _links(seen: ObservationModel) -> Indices:
    """The link (R,) that carries the marker of each row; 0: the base."""
    return np.array([site.link for site in seen.model.markers])[seen.rows.marker]


def widened(experiment: Experiment, readings: Readings) -> ObservationModel:
    """The bridge of the model with geometry, springs and sag added, where the robot has room for them."""
    robot = experiment.robot
    more: list[Effect] = []
    for kind in (kind for role in _WHOLE for kind in with_role(role)):
        everywhere = {plural(place): "all" for place in place_fields(kind)}
        try:
            more += build_effects(everywhere, robot.facts, tuple(m.name for m in experiment.markers), kind)
        except InputError:
            continue
    wide = experiment.with_effects(more)
    model = wide.model()
    names = {*model.of_role(*_WHOLE), *experiment.fit_names()}
    return observation_model(wide, readings, [n for n in model.names if n in names], linear=True)


def held_naturally(seen: ObservationModel, scale: Array) -> Array:
    """How firmly (p,) parameters in these scales are held by natural sizes, those of frames not at all."""
    natural = np.array([p.scale for p in seen.parameters])
    free = np.arange(len(scale)) < seen.motions
    return np.where(free, 0.0, scale / (_REACH * natural))


def _agreed(seen: ObservationModel) -> Agreed:
    """The fit about the nominal arm to the rows that agree, what is not of the frames held by natural sizes."""
    rows = seen.rows
    scale = np.array([p.scale for p in seen.parameters])
    held = held_naturally(seen, scale)

    def beyond(misfit: Array, wrong: Flags, _: LinearFit | None) -> Flags:
        return _in_sds(seen, misfit, wrong) > GROSS

    return agreed(seen, np.arange(len(rows.keep)), beyond, rows.noise, scale, held)[0]


def _in_sds(seen: ObservationModel, misfit: Array, wrong: Flags) -> Array:
    """Sizes (R,) of the errors of rows, from their squares in sigmas, in what is usual for their like."""
    error = np.sqrt(misfit)
    axes = np.bincount(seen.rows.row, minlength=len(error))
    usual = _typical(seen, error / np.array([_MEDIANS[int(c)] for c in axes]), wrong)
    return error / np.maximum(usual, 1e-300)


def _typical(seen: ObservationModel, error: Array, wrong: Flags) -> Array:
    """The usual error (R,) among the rows of a series that the same link carries, m in sigmas.

    Rows are pooled by what they share: a marker on the still base says nothing of the noise at the tool.
    """
    rows, link = seen.rows, _links(seen)
    kind = rows.frame + (len(rows.readings.frames) + 1) * (rows.minus < 0)
    label = link + (int(np.ptp(link)) + 1) * (kind - kind.min(initial=0))
    out = np.full(len(error), float(np.median(error[~wrong])) if (~wrong).any() else 0.0)
    for group in (label == kind for kind in np.unique(label)):
        if (group & ~wrong).sum() >= _FEW:
            out[group] = np.median(error[group & ~wrong])
    return np.maximum(out, 1e-6 * float(error.max(initial=0.0)))


def told_outliers(readings: Readings, keep: Indices, found: Outliers) -> list[WrongRows]:
    """The outliers as findings: blocks that belong together, single rows, and what only a larger model explains."""
    out: list[WrongRows] = []
    gross, missed = keep[found.gross], keep[found.missed]
    if found.share > SHARE:
        out.append(_many(readings, keep, found))
    if found.angles is not None:
        words = (
            f"{lines(readings, gross)}: they err as if joint angles were wrong by {np.rad2deg(found.angles):.2g} deg: "
            "look at how the angles were logged before the readings"
        )
        out.append(wrong_rows("angles", readings, gross, words, mask=False))
    for i, size in zip(gross.tolist(), found.size[found.gross].tolist(), strict=True):
        words = f"{lines(readings, np.array([i]))}: {size:.0f} sds off what the other readings say"
        out.append(wrong_rows("gross", readings, np.array([i]), words))
    if len(missed):
        words = (
            f"{lines(readings, missed)}: the fitted model misses them by far, geometry, springs and sag would not: the "
            "model is too small here, the readings are kept"
        )
        out.append(wrong_rows("small model", readings, missed, words, mask=False))
    return out


def _many(readings: Readings, keep: Indices, found: Outliers) -> WrongRows:
    """More gross rows than a mistake here and there makes: what they have in common."""
    rows = keep[found.gross]
    block = common_block(readings, keep, found.gross)
    where = f": {block}" if block else ", in no series, marker or stretch alone"
    why = "That is no handful of slips: a setting, a frame or the model is wrong"
    if len({readings.pose[i] for i in map(int, rows)}) == 1:
        why = "All are of one pose: look for a slip in its rows"
    words = f"{len(rows)} of {len(keep)} readings ({100 * found.share:.0f} %) do not fit{where}. {why}"
    return wrong_rows("block", readings, rows, words, mask=False)


def common_block(readings: Readings, keep: Indices, wrong: Flags) -> str:
    """What most of the wrong rows have in common and few of the others: a series, a marker, or a stretch."""
    states = readings.states
    groups = [(f"series {name!r}", readings.frame[keep] == f) for f, name in enumerate(readings.frames)]
    series = [states.series[int(s)] for s in readings.plus[keep]]
    groups += [(f"series {name!r}", np.array([s == name for s in series])) for name in sorted(set(series)) if name]
    groups += [(f"marker {k + 1}", readings.marker[keep] == k) for k in range(int(readings.marker.max(initial=0)) + 1)]
    at = np.flatnonzero(wrong)
    if len(at):
        inside = np.zeros(len(keep), dtype=bool)
        inside[at[0] : at[-1] + 1] = True
        groups.append((f"lines {readings.line[keep[at[0]]]} to {readings.line[keep[at[-1]]]}", inside))
    parts = ((name, members) for name, members in groups if members.any() and not members.all())
    shares = {name: min(float(wrong[members].mean()), float(members[wrong].mean())) for name, members in parts}
    best = max(shares, key=lambda name: shares[name], default="")
    return best if shares.get(best, 0.0) > _BLOCK else ""

"""The verb: what is wrong with a table of readings, mistake after mistake, each with what was probably meant.

What needs no model comes first: rows that nobody read, markers whose distances are another's. Then the readings are
asked under every other convention, then row by row; what is beyond doubt is applied before the next is looked for, in
memory only. At last rows are named that belong under no model.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from qsframework.arguments import checked
from qsframework.errors import InputError, NotConverged, NotIdentifiable
from qsframework.experiment import Experiment, Readings, make_rows
from qsframework.hypotheses.catalogue.rigidity import marker_rigidity, tool_misfit
from qsframework.hypotheses.catalogue.rounded import rounded_angles
from qsframework.hypotheses.catalogue.rows import LEVEL, WrongRows, copies, doubled, lines, masked, unread, wrong_rows
from qsframework.hypotheses.linearized import Linearized, at_solution, linearized
from qsframework.hypotheses.outliers import find_outliers, told_outliers
from qsframework.hypotheses.standing_out import Standing, stand_out
from qsframework.plugin import Indices
from qsframework.robot.findings import robot_findings
from qsframework.screening.common_scale import wrong_scale
from qsframework.screening.conventions import overloads, single_rows, whole_table
from qsframework.screening.mistake import FILES, Mistake

_MOST = 6
"""Mistakes of one file that are looked for."""
_HIDES = 2.0
"""Noise that the visits show, in sds as stated, from which an effect is present at all of them."""
_LONG = 5_000
"""Rows from which a model with geometry costs too much here."""
_TESTED = 4
"""Kinds that share the level."""
_MANY = 20
"""Gross displacements that are taken out one after the other."""
_UNIDENTIFIABLE = (InputError, NotIdentifiable, NotConverged, np.linalg.LinAlgError)
"""Where the readings tell no fit, they prove nothing; `identify` says what they lack."""


@checked
def find_mistakes(
    experiment: Experiment, readings: Readings, gross: bool = True, level: float = LEVEL
) -> tuple[Mistake, ...]:
    """What is wrong with the readings, or with how their file is read; nothing is the rule, and nothing is deleted.

    Args:
        experiment: the campaign, with the parameters to fit.
        readings: R rows of it.
        gross: whether rows that belong under no model are named too; a diagnosis judges them beside its causes.
        level: of all tests of single rows together: clean readings give any false finding in at most so many cases.

    Returns:
        Mistakes beyond doubt first, in the order in which they were applied: each holds the readings with it and with
        all before it. Then what merely fits better (where nothing is beyond doubt), suspicions, impossible values of
        the robot's files, and gross rows. Beside the first one that is beyond doubt the next best goes along and is not
        compelling: axes that are nearly those of the right sign fit better, too.

    Raises:
        InputError: where the readings do not identify the parameters at all.
    """
    found: list[Mistake] = []
    for one in [*unread(readings), *doubled(readings), *_rigid(experiment, readings, level)]:
        if one.name != "tool":
            readings = one.applied(readings)
            found.append(_told(one, experiment, readings, True))
    try:
        given = linearized(experiment, readings)
    except _UNIDENTIFIABLE:
        return (*found, *_of_files(experiment, readings))
    proved, rest, given = _proved(given)
    others = [replace(c, compelling=False) for c in rest]
    more = _gross(given.experiment, given.readings, level) if gross else []
    files = _of_files(given.experiment, given.readings)
    told = [_told(one, given.experiment, given.readings, False) for one in more]
    return (*found, *proved, *others, *wrong_scale(given), *overloads(given), *files, *told)


def find_slips(experiment: Experiment, readings: Readings) -> tuple[Mistake, ...]:
    """Mistakes in single rows and poses alone, each applied after those before it: what stands out from an experiment
    that holds what acts at all poses."""
    out: list[Mistake] = []
    with suppress(*_UNIDENTIFIABLE):
        while len(out) < _MOST:
            found = _of_rows(linearized(experiment, readings), stand_out(experiment, readings))
            if not found:
                break
            out += found
            readings = found[-1].readings
    return tuple(out)


def _of_files(experiment: Experiment, readings: Readings) -> list[Mistake]:
    """Values of the robot's files that cannot be and that no fit of the campaign replaces."""
    model, names = experiment.model(), {*experiment.fit_names()}
    own = zip(model.effects, model.slices, strict=True)
    replaced = names | {effect.name for effect, part in own if names & {*model.names[part]}}
    return [
        Mistake(check.name, 1.0, check.words, experiment, readings=readings, file=FILES)
        for check in robot_findings(experiment.robot)
        if check.name not in replaced
    ]


def _proved(given: Linearized) -> tuple[list[Mistake], list[Mistake], Linearized]:
    """What is beyond doubt, each with all before it applied; what merely fits better; and the fit with the former."""
    rounded = _rounded(given)
    if rounded is not None:  # what every visit is off by, nothing else can be told from
        return [rounded], [], given
    proved: list[Mistake] = []
    rest: list[Mistake] = []
    while len(proved) < _MOST:
        standing = stand_out(given.experiment, given.readings)
        found = whole_table(given, standing)
        found = found if not found or not found[0].compelling or _holds(found[0], given) else found[1:]
        if not proved:
            rest = found if not found or not found[0].compelling else found[1:2]
        if not found or not found[0].compelling:
            found = _of_rows(given, standing)
            if not found:
                break
            rest = []
        else:
            found = found[:1]
        proved += found
        try:
            given = linearized(found[-1].experiment, found[-1].readings)
        except _UNIDENTIFIABLE:
            break
    return proved, rest, given


def _of_rows(given: Linearized, standing: Standing) -> list[Mistake]:
    """Mistakes in single rows and poses. Where geometry that is not fitted may hide them, which moves every pose, whole
    poses are asked of a model that has it first."""
    hidden = given.readings.is_position[given.keep].any() and (not given.stated or standing.unit > _HIDES)
    if hidden and len(given.keep) <= _LONG:
        with suppress(*_UNIDENTIFIABLE):
            found = single_rows(given, stand_out(given.experiment, given.readings, wide=True))
            if found:
                return found
    return single_rows(given, standing)


def _rounded(given: Linearized) -> Mistake | None:
    found = rounded_angles(given.experiment, given.readings)
    if found is None:
        return None
    rounded, evidence = found
    rms = given.estimates.rms
    return Mistake(**vars(rounded), rms=rms, rms_given=rms, evidence=evidence, compelling=True)


def _holds(change: Mistake, given: Linearized) -> bool:
    """Whether the readings fit better with a change at the solution too, and not only by one step from the guess."""
    try:
        after = at_solution(change.experiment, change.readings)
    except _UNIDENTIFIABLE:
        return False
    try:
        return after < at_solution(given.experiment, given.readings)
    except _UNIDENTIFIABLE:
        return True


def _rigid(experiment: Experiment, readings: Readings, level: float) -> list[WrongRows]:
    return marker_rigidity(experiment, masked(readings, [one.mask for one in unread(readings)]), level)


def _told(one: WrongRows, experiment: Experiment, readings: Readings, compelling: bool) -> Mistake:
    """What was found without comparing two fits."""
    return Mistake(
        one.name,
        1.0,
        one.words,
        experiment,
        readings=readings,
        rows=one.rows,
        file=one.file,
        mask=one.mask,
        compelling=compelling,
    )


def _gross(experiment: Experiment, readings: Readings, level: float) -> list[WrongRows]:
    """Rows that belong under neither the fitted nor a richer model, and visits whose markers did not move as one body;
    of displacements also by data snooping: the row whose coordinates fit worst is taken out while it is beyond its
    level."""
    out = copies(readings)
    out += [o for o in _rigid(experiment, masked(readings, [o.mask for o in out]), level) if o.name == "tool"]
    clean = masked(readings, [one.mask for one in out])
    try:
        rows = make_rows(clean)
    except InputError:
        return out
    outliers = find_outliers(experiment, clean)
    out += [] if outliers is None else told_outliers(clean, rows.keep, outliers)
    if not clean.is_position[rows.keep].any():
        out += _snooped(experiment, readings, out, level / _TESTED)
    fit = _fit(experiment, masked(readings, [one.mask for one in out]))
    return out if fit is None else out + tool_misfit(fit, level / _TESTED)


def _snooped(experiment: Experiment, readings: Readings, found: Sequence[WrongRows], level: float) -> list[WrongRows]:
    out: list[WrongRows] = []
    spoken = {r for one in found for r in one.rows}
    for _ in range(min(_MANY, max(1, len(readings) // 5))):
        fit = _fit(experiment, masked(readings, [one.mask for one in (*found, *out)]))
        if fit is None:
            break
        alone = fit.fit.held_out(fit.row)
        p = np.ones(len(fit.keep))
        p[alone.label] = fit.fit.p_values(alone.chi2_drop, alone.size)
        worst = int(np.argmin(p))
        if p[worst] * len(p) >= level:
            break
        i = fit.keep[worst]
        off = fit.rows.spread(fit.fit.residuals)[worst]
        size = float(np.linalg.norm(off[np.isfinite(off)]) * 1e3)
        at: Indices = np.array([i])
        words = f"{lines(readings, at)}: {size:.3f} mm off what the other readings say (p = {p[worst]:.1g})"
        if int(readings.line[i]) not in spoken:
            out.append(wrong_rows("gross", readings, at, words))
    return out


def _fit(experiment: Experiment, readings: Readings) -> Linearized | None:
    try:
        return linearized(experiment, readings)
    except _UNIDENTIFIABLE:
        return None

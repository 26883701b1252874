"""Conventions that may be wrong: controller angles, axes, signs, units, order of rows. Each is applied and refitted.

A deterministic check before any physics is suspected: a wrong convention is not small, and no spring mends it.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from qsframework.elastostatics.structure import CHUNK
from qsframework.errors import InputError, NotIdentifiable
from qsframework.estimation import LinearFit, rms, scales
from qsframework.estimation.projection import Flags
from qsframework.experiment import Experiment, Frame, Readings, make_rows, observation_model
from qsframework.experiment.observations import start_values
from qsframework.hypotheses.catalogue.blocks import FRAME, in_frame
from qsframework.hypotheses.catalogue.conventions import (
    aligned,
    angle_units,
    couplings,
    displacement_axes,
    exchanged_states,
    force_axes,
    force_units,
    joint_columns,
    joint_signs,
    position_axes,
    structures,
    tracker_axes,
    value_units,
)
from qsframework.hypotheses.catalogue.late_angles import late_angles
from qsframework.hypotheses.catalogue.markers import exchanged_markers, marker_constant
from qsframework.hypotheses.catalogue.rows import lines
from qsframework.hypotheses.catalogue.runs import MOST_OF_IT, NEAR_NOISE, run_of_rows
from qsframework.hypotheses.hypothesis import Hypothesis
from qsframework.hypotheses.linearized import Estimates, Linearized, linearized, of_observations, other_readings
from qsframework.hypotheses.standing_out import Standing, agreement, stand_out
from qsframework.screening.edit_words import mistake_words
from qsframework.screening.mistake import Mistake, Moved
from qsframework.screening.table_mistakes import Mend, table_mistakes

LEVEL = 1e-4
"""The likelihood ratio, all conventions counted, beyond which one may be compelling."""
RATIO = 0.8
"""How far the sum of squares must fall at least; a hidden effect makes smaller differences."""
LOCAL = 0.25
"""The same for the rows that a change touches: physics at some poses is not undone by exchanging their readings."""
_MANY = 0.08
"""Of the visits: where more stand out, it may be a change of all rows that they are too many to be set aside from."""
_AS_STATED = 0.5
"""Of the stated variance: below it the noise is not as stated, and says nothing of what is left to gain."""
_UNIT = 0.25
"""What another unit of a column leaves of the sum of squares at most: it is no small change."""
_NOISE = 4.0
"""Times the stated variance that a column of forces in another unit leaves at most."""
_OVERLOAD = 1.5
"""Times the payload of the robot's files from which a force is told."""
_LIGHTER = (
    (0.1, "perhaps the decimal is shifted"),
    (1e-3, "perhaps N where the file says kN"),
    (1.0 / 4.4482216, "perhaps N where the file says lbf"),
    (1.0 / 9.80665, "perhaps N where the file says kgf or daN"),
)
_GROSS = 5e-3
"""m a coordinate, which no arm misses by: beyond it several joints may count the other way together."""
_SHOWN = 3
"""Parameters that are told with a mistake."""
_NO_FURTHER = 2.0
"""How much larger the residuals of a linear fit may be where exact fits may turn out the other way."""
_FAR = 3.0
"""How many times further from the nominal arm than as given positions are beyond any fit: derivatives cost more."""


def whole_table(given: Linearized, standing: Standing) -> list[Mistake]:
    """Changes of all rows under which the readings fit better, compelling ones first.

    Visits that stand out are set aside first unless they are many; a change must make most visits agree better, and not
    only those that stand out.
    """
    experiment, readings = given.experiment, given.readings
    aside = np.zeros(len(readings), dtype=bool)
    aside[standing.rows.keep] = standing.wrong[standing.visits.of]
    many = float(standing.wrong.mean()) > _MANY
    others = given
    if aside.any() and not many:
        with suppress(NotIdentifiable):  # what is left may identify too little
            others = linearized(experiment, readings.masked(aside))
    changes = [] if _as_stated(others) else [c for make in _CHANGES for c in make(experiment, others.readings)]
    changes = [replace(c, tried=len(changes)) for c in changes]
    judged = _judged(changes, others)
    if changes and others.estimates.rms > _GROSS and not any(c.compelling and c.rms < _GROSS for c in judged if c):
        signs = list(joint_signs(experiment, others.readings, (2, 3)))
        judged += _judged([replace(c, tried=len(changes) + len(signs)) for c in signs], others)
    back = aside & readings.use
    whole = [replace(c, readings=replace(c.readings, use=c.readings.use | back)) for c in judged if c is not None]
    local = [_judge(change, given, _trials([change], given)[0]) for change in _of_some_rows(given)]
    whole += [c for c in local if c is not None]
    whole.sort(key=lambda c: (not c.compelling, -c.evidence))
    if not (whole and whole[0].compelling):
        whole = [*_run(given), *whole]
    while aside.any() and whole and whole[0].compelling and not _agrees(standing, whole[0]):
        whole = [*(c for c in whole[1:] if c.compelling), *(c for c in whole[1:] if not c.compelling)]
    if whole and whole[0].compelling and whole[0].name == "tracker_axes":
        whole[0] = replace(whole[0], readings=aligned(experiment, whole[0].readings, readings))
    return whole


def _judged(changes: Sequence[Hypothesis], given: Linearized) -> list[Mistake | None]:
    """What the readings say of changes of all rows."""
    return [_judge(c, given, trial) for c, trial in zip(changes, _trials(changes, given), strict=True)]


def _as_stated(fit: Linearized) -> bool:
    """Whether the noise is as stated, so that no change of all rows can take off what makes one compelling."""
    return fit.stated and _AS_STATED < fit.estimates.chi2 / fit.estimates.dof < 1.0 / RATIO


def _agrees(standing: Standing, change: Mistake) -> bool:
    """Whether most visits fit better with a change."""
    try:
        return agreement(stand_out(change.experiment, change.readings)) < agreement(standing)
    except (InputError, NotIdentifiable):
        return False


_CHANGES = (
    couplings,
    joint_signs,
    joint_columns,
    angle_units,
    displacement_axes,
    force_axes,
    value_units,
    force_units,
    position_axes,
    exchanged_states,
    tracker_axes,
)


def single_rows(given: Linearized, standing: Standing) -> list[Mistake]:
    """Mistakes in single rows and poses, each applied after those before it."""
    out: list[Mistake] = []
    experiment, readings = given.experiment, given.readings
    for mistake in table_mistakes(standing):
        words, first = mistake_words(readings, mistake), mistake.edits[0]
        rows = np.concatenate([e.rows if e.touched is None else e.touched for e in mistake.edits])
        for edit in mistake.edits:
            framed = edit.kind == "block" and edit.slip == FRAME
            readings = in_frame(readings, edit) if framed else edit.apply(experiment, readings)
        try:
            fit = linearized(experiment, readings)
        except (InputError, NotIdentifiable):
            continue
        change = Hypothesis(
            _name(readings, mistake),
            1.0,
            f"{words}: {_gain_words(fit.estimates.rms, given.estimates.rms)}",
            experiment,
            readings=readings,
            kinds=tuple(dict.fromkeys([first.kind, *(o.kind for o in mistake.others)])),
            column=first.column,
            found=first.found,
            meant=first.meant,
            tried=mistake.tried,
        )
        evidence = 0.5 * mistake.gain - float(np.log(mistake.tried))
        out.append(compared(change.at(rows), given, fit, evidence, compelling=True))
        given = fit
    return out


def _name(readings: Readings, mistake: Mend) -> str:
    """`angle[p08/q5]`: kind, pose, the state where it is one of two, and the column of a single number."""
    states, first = readings.states, mistake.edits[0]
    poses = list(dict.fromkeys(states.pose[int(s)] for e in mistake.edits for s in e.states))
    where = poses if len(poses) < 3 else [poses[0], poses[-1]]
    loaded = states.loaded[readings.plus[first.rows]]
    if readings.is_position[first.rows].all() and first.kind != "force" and loaded.all() | (~loaded).all():
        where.append("loaded" if loaded.all() else "unloaded")
    if np.isfinite(first.found) and first.kind != "block" and first.column != "force":
        where.append(first.column)
    return f"{first.kind}[{'/'.join(where)}]"


def overloads(given: Linearized) -> list[Mistake]:
    """Forces far beyond what the robot's files say that it carries."""
    readings, robot = given.readings, given.experiment.robot
    if robot.payload is None:
        return []
    most = robot.payload * float(np.linalg.norm(robot.gravity))
    force = np.linalg.norm(readings.poses.wrench[:, :3], axis=1)
    rows = np.flatnonzero((force > _OVERLOAD * most)[readings.plus] & readings.use)
    if not len(rows):
        return []
    largest = float(force[readings.plus[rows]].max())
    meant = next((f"; {said}" for factor, said in _LIGHTER if 0.1 * most <= largest * factor <= most), "")
    words = (
        f"{lines(readings, rows)}: the force is {largest:.0f} N, {largest / most:.1f} times what the robot carries "
        f"({robot.payload:g} kg, {most:.0f} N){meant}"
    )
    change = Hypothesis(
        "load_payload",
        largest / most,
        words,
        given.experiment,
        readings=readings,
        column="force",
        found=largest,
        meant=most,
    )
    return [compared(replace(change.at(rows), mask=None), given, given, 0.0)]


def compared(
    change: Hypothesis, given: Linearized, fit: Linearized, evidence: float, *, compelling: bool = False
) -> Mistake:
    """A hypothesis with what the fits as given and with it say of it."""
    return Mistake(
        **vars(change),
        rms=fit.estimates.rms,
        rms_given=given.estimates.rms,
        evidence=evidence,
        below=fit.estimates.below,
        compelling=compelling,
        moved=() if fit is given else _changed(given, fit),
    )


def _changed(given: Linearized, fit: Linearized) -> tuple[Moved, ...]:
    """The parameters that move most, in sds."""
    model, names = fit.experiment.model(), fit.experiment.fit_names()
    if names != given.experiment.fit_names():
        return ()
    size = scales([model.parameters[i] for i in model.index(names)])
    before, after, sd = given.estimates.x, fit.estimates.x, fit.estimates.sd
    far = np.abs(after - before) / np.where(sd > 0.0, sd, np.inf)
    out: list[Moved] = []
    for i in map(int, np.argsort(-far)[:_SHOWN]):
        if far[i] > 1.0:
            unit = model.parameters[int(model.index([names[i]])[0])].unit
            out.append(Moved(names[i], unit, float(before[i] * size[i]), float(after[i] * size[i])))
    return tuple(out)


def check_structures(experiment: Experiment, readings: Readings) -> tuple[Hypothesis, ...]:
    """The structures of the arm that may fit the readings better than that of its file: no further from them by a
    linear fit, and with no compliance below its bound that is not so in the file's own. Exact fits compare them."""
    given = linearized(experiment, readings)
    return tuple(change for change in structures(experiment, readings) if _may_fit(change, given))


def _may_fit(change: Hypothesis, given: Linearized) -> bool:
    trial = _one(change, given)
    if trial is None:
        return False
    fit, own = trial.estimates, given.estimates
    return fit.rms < _NO_FURTHER * own.rms and fit.below <= own.below


def _judge(change: Hypothesis, given: Linearized, trial: Linearized | None) -> Mistake | None:
    """Compare a change that is applied. None where nothing speaks for it, and where it cannot be applied."""
    if trial is None or _speaks_for(change, given.estimates, trial.fit)[0] <= 0.0:
        return None
    before, fit = given.estimates, trial.estimates
    evidence, drop = _speaks_for(change, before, fit)
    near = not trial.stated or _near_noise(trial, given)
    if evidence <= 0.0 or not (near or change.mask is None):
        return None
    enough = drop > -np.log(RATIO) and (change.mask is None or _local(given, trial, change.mask) < LOCAL)
    enough = enough and (change.name != "column_unit" or _right_unit(change, given, trial))
    compelling = evidence > -np.log(LEVEL) and enough and near and fit.below <= before.below
    told = replace(change, words=fits_better(change, fit.rms, before.rms))
    return compared(told, given, trial, evidence, compelling=bool(compelling))


def _speaks_for(change: Hypothesis, given: Estimates, fit: Estimates | LinearFit) -> tuple[float, float]:
    """Evidence for a change, nats, and by how much the logarithm of what a measurement leaves falls."""
    drop = float(np.log(max(given.chi2, 1e-300)) - np.log(max(fit.chi2, 1e-300)))
    drop -= float(np.log(given.dof / fit.dof))  # late angles leave a measurement out
    evidence = 0.5 * min(fit.dof, given.dof) * drop - float(np.log(change.tried))
    return evidence - 0.5 * change.free * float(np.log(fit.dof)) + change.shrunk * fit.dof, drop


def fits_better(change: Hypothesis, rms: float, given: float) -> str:
    """What a change is, and what the fits leave with it and as given, m."""
    return f"{change.words}: {_gain_words(rms, given)}"


def _gain_words(rms: float, given: float) -> str:
    return f"the readings then fit to {rms * 1e3:.3f} mm a coordinate, as given to {given * 1e3:.3f} mm"


def _right_unit(change: Hypothesis, given: Linearized, fit: Linearized) -> bool:
    """Whether a column fits in another unit, and not only better: of forces to the stated noise, for springs follow."""
    forces = change.column.startswith("f")
    chi2, most = fit.estimates.chi2, _NOISE * fit.estimates.dof
    return chi2 < _UNIT * given.estimates.chi2 and not (forces and fit.stated and chi2 > most)


def _near_noise(fit: Linearized, given: Linearized) -> bool:
    """Whether a fit is near the stated noise, or leaves hardly anything of what was left as given."""
    chi2 = fit.estimates.chi2
    return chi2 < NEAR_NOISE * fit.estimates.dof or chi2 < MOST_OF_IT * given.estimates.chi2


def _local(given: Linearized, fit: Linearized, mask: Flags) -> float:
    """What a change leaves of the sum of squares of the rows (R,) that it touches."""
    both = np.intersect1d(given.keep[mask[given.keep]], fit.keep)

    def square(f: Linearized) -> float:
        return float(np.sum(f.estimates.white[np.isin(f.keep[f.row], both)] ** 2))

    return square(fit) / max(square(given), 1e-300)


def _trials(changes: Sequence[Hypothesis], given: Linearized) -> list[Linearized | None]:
    """What `_first` has of the readings as given, for each change; where rows stay and the model is asked anew, it is
    asked for many changes at once. None where a change cannot be applied: angles beyond the arm's, readings that then
    hold no frame, or lie so far from the nominal arm that no fit makes up for it."""
    before = given.readings
    alike: tuple[list[int], list[int], list[int]] = ([], [], [])  # the same states, the same angles, neither
    out: list[Linearized | None] = [None] * len(changes)
    for i, change in enumerate(changes):
        readings, rows = change.readings, replace(given.rows, readings=change.readings)
        if not _kept(change, given) or not np.array_equal(np.isfinite(rows.measured), given.rows.mask):
            out[i] = _one(change, given)
        elif readings.states is not before.states:
            alike[1 if np.array_equal(readings.poses.q, before.poses.q) else 2].append(i)
        elif _moved(given, readings):
            alike[0].append(i)
        else:  # values in frames that are known
            out[i] = replace(given, rows=rows, errors=given.errors + rows.scalars - given.rows.scalars)
    step = max(1, CHUNK // len(before.states))
    for some in (places[k : k + step] for places in alike for k in range(0, len(places), step)):
        for i, trial in zip(some, _together([changes[i].readings for i in some], given), strict=True):
            out[i] = trial
    return out


def _together(many: Sequence[Readings], given: Linearized) -> list[Linearized | None]:
    """The same of readings at other poses; where some cannot be had, they are found by halves."""
    try:
        return other_readings(given, many, _FAR)
    except (InputError, NotIdentifiable):
        if len(many) == 1:
            return [None]
        half = len(many) // 2
        return [*_together(many[:half], given), *_together(many[half:], given)]


def _kept(change: Hypothesis, given: Linearized) -> bool:
    """Whether the same rows are used of the same experiment, in the same frames."""
    before, after = given.readings, change.readings
    return change.experiment is given.experiment and after.use is before.use and after.frame is before.frame


def _one(change: Hypothesis, given: Linearized) -> Linearized | None:
    """The same of one change of other rows, or of the arm."""
    names = change.experiment.fit_names()
    try:
        rows = make_rows(change.readings)
        frames: tuple[Frame, ...] = ()
        if rows.estimated:
            model = change.experiment.model()
            positions = rows.positions(model, start_values(change.experiment, names), linear=True)
            frames = rows.nearest(positions)
            if rms(rows.scalars - rows.flat(rows.seen(positions, frames))) > _FAR * rms(given.errors):
                return None
        seen = observation_model(change.experiment, change.readings, names, linear=True, frames=frames, rows=rows)
        fit = of_observations(change.experiment, seen)
        return fit if fit.fit.dof > 0 else None
    except (InputError, NotIdentifiable):
        return None


def _moved(given: Linearized, readings: Readings) -> bool:
    """Whether readings in a frame that is to be found are others than before: then the frame is, too."""
    changed = np.any(given.rows.measured != readings.value[given.keep], axis=1, where=given.rows.mask)
    return bool(np.isin(given.rows.frame[changed], given.rows.estimated).any())


def _run(given: Linearized) -> list[Mistake]:
    """A run of rows that hold other values, where that is beyond doubt."""
    change = run_of_rows(given)
    judged = None if change is None else _judge(change, given, _one(change, given))
    return [judged] if judged is not None and judged.compelling else []


def _of_some_rows(given: Linearized) -> list[Hypothesis]:
    """Exchanged markers, a marker's constant and late angles."""
    trial = replace(given, stated=False)  # a hidden effect must not look like a mistake
    found = (exchanged_markers(trial, LEVEL), marker_constant(trial), late_angles(trial, LEVEL))
    return [change for change in found if change is not None]

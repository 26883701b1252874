"""A fit in words: how readings were taken, whether residuals fit the noise, how trackers stand."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from qsframework.errors import some_of
from qsframework.experiment.readings import Alignment
from qsframework.fits import EstimateState, Fit
from qsframework.fits.record import SIGNIFICANT
from qsframework.information import what_would_help
from qsframework.plugin import Poses
from qsframework.report.blocks import Mark, Verdict
from qsframework.report.words.sizes import mm

_NAMED = 3
STATES = {
    EstimateState.FIXED: "held at its value",
    EstimateState.UPPER_LIMIT: "within its sd of zero",
    EstimateState.AT_BOUND: "errs to one side only, so no sd is quoted",
    EstimateState.NOT_IDENTIFIABLE: "uncertainty exceeds the plausible range",
    EstimateState.BEYOND_BOUND: "outside what is possible; by more than 2 sd the model or a convention is wrong",
    EstimateState.OUTSIDE_PRIOR: "more than 5 sigma of its prior from nominal",
    EstimateState.IMPLAUSIBLE: "more than 100 typical sizes from nominal",
}
"""What the states of estimates mean, but for that which is well."""
_KNOWN = (EstimateState.FINE, EstimateState.OUTSIDE_PRIOR)
"""Of parameters that the readings identify, also where the value surprises."""


def first_words(fit: Fit) -> tuple[str, ...]:
    """What is said before anything else: what is wrong with readings and files and what to do, how readings were taken,
    and that they were made by another model."""
    out = [f"Look at {finding.sentence}" for finding in fit.account.findings]
    if fit.made is not None:
        own = "linear" if fit.linear else "equilibrium"
        if fit.made.model != own:
            names = {"linear": "the linear model", "equilibrium": "the full equilibrium"}
            out.append(
                f"These readings were simulated by {names[fit.made.model]} and are fitted by {names[own]}: what "
                "differs between the two is not noise."
            )
    if fit.alignments:
        out.append("Loaded and unloaded records are used as differences, loaded minus unloaded.")
    elif fit.position.any():
        out.append("Loaded and unloaded records are used as absolute positions.")
    return tuple(out)


def verdict_words(fit: Fit) -> str:
    """Whether the residuals fit the noise, and what to do if they do not."""
    p = fit.p_value
    if wrong := impossible(fit):
        agree = "" if p is None or p < SIGNIFICANT else ", though the residuals agree with the stated noise"
        return (
            f"Physically impossible: {listed_names(wrong)}{agree}. A sign, a unit or a convention of the "
            "readings or of the robot is wrong. A fit within bounds only hides it: look for the cause, `qsf diagnose`."
        )
    if p is None:
        return "Noise was estimated from the residuals: no goodness-of-fit test is possible."
    ratio = float(np.sqrt(fit.chi2 / fit.dof))
    said = f"chi-square {fit.chi2:.1f} on {fit.dof} degrees of freedom, p = {p:.2g}"
    if p > 1.0 - SIGNIFICANT:
        return (
            f"The residuals are only {ratio:.2g} of the stated noise ({said}): the noise is less than stated, rows "
            "were copied, or the displacements are in a larger unit than their columns say."
        )
    if p >= SIGNIFICANT:
        return f"The residuals agree with the stated noise ({said})."
    order = np.argsort(-np.nan_to_num(np.abs(fit.studentised)).max(axis=1))[:3]
    file = [f", {Path(source).name}" for source in fit.sources] if len(fit.sources) > 1 else [""]
    rows = ", ".join(f"{fit.lines[i]} (pose {fit.poses[i]}{file[fit.file[i]]})" for i in order)
    return (
        f"The residuals are {ratio:.1f} times the stated noise ({said}): the model or a reading is wrong, and the "
        f"standard deviations are too small by that factor. Largest residuals: rows {rows}. Check the unit of the "
        "load, the load point, the markers' names and places, and the noise."
    )


def impossible(fit: Fit) -> list[str]:
    """The estimates that no arm can have: beyond a declared bound by more than twice their sd."""
    return [e.name for e in fit.estimates if e.beyond > 2.0 * np.nan_to_num(e.sd)]


def alignment_words(alignments: Sequence[Alignment]) -> tuple[str, ...]:
    """How series of states lie to the base, and what their unloaded markers then miss."""
    out: list[str] = []
    for a in alignments:
        name = f"series {a.series!r}" if a.series else "the tracker"
        if not a.count:
            out.append(
                f"Whether {name} has the axes of the base cannot be seen from its unloaded markers; it is taken "
                "to have them. State its frame under frames: otherwise."
            )
            continue
        angle = f"{np.rad2deg(a.angle):.2f} deg"
        turned = f"has the axes of the base ({angle})"
        if a.turned:
            turned = f"is turned {angle} to the base, and its displacements with it"
        out.append(
            f"By {a.count} unloaded markers {name} {turned}; they then miss by {1e3 * a.rms:.3f} mm RMS, "
            f"{1e3 * a.largest:.3f} mm at most."
        )
    return tuple(out)


def fit_verdict(fit: Fit, poses: Poses | None = None) -> Verdict:
    """What the fit is worth at poses that it has not seen, and which parameters the readings tell; poses: those of the
    readings, which say what would tell the others; left out, nothing says it."""
    before, after, largest = fit.held_out_nominal, fit.held_out_error, fit.held_out_largest
    asked = [e for e in fit.estimates if e.state is not EstimateState.FIXED]
    alone = [e for e in asked if e.share is None or e.state is EstimateState.NOT_IDENTIFIABLE]
    told, before_them = fit.directions
    vague = sum(e.share is not None for e in alone)
    count = sum(e.state in _KNOWN for e in alone) + told
    far = [e.name for e in asked if e.state is EstimateState.OUTSIDE_PRIOR]
    unknown = [*(e.name for e in alone if e.state not in _KNOWN), *(entry.name for entry in fit.not_estimated)]
    total = len(alone) - vague + before_them + len(fit.not_estimated)
    p = fit.p_value
    kept = next(of.get("held_out_without_masked") for of in fit.errors.values())
    masked = "" if kept is None else f", all rows; {mm(kept)} without masked rows"
    size = f"{mm(before)} \u2192 {mm(after)} mm (3D RMS at held-out poses{masked})"
    if not np.isfinite(after):
        size = "no pose can be held out: the held-out error is unknown"
    every = "its one parameter is" if total == 1 else f"all {total} parameters are"
    things = "directions" if before_them else "parameters"
    outcome = f"{every} identified" if count == total else f"{count} of {total} {things} identified"
    mark, word = Mark.GOOD, "Identified"
    if unknown:
        mark, word = Mark.LOOK, "Partially identified"
        outcome += f". Not identified: {listed_names(unknown)}"
        advised = next((n for n in unknown if n in fit.model.names), "")
        if advised and poses is not None and len(unknown) <= _NAMED:
            outcome += f". {advised}: {what_would_help(fit.model, advised, poses)}"
    if far:
        mark = Mark.LOOK
        outcome += f"{'' if outcome.endswith('.') else '.'} Outside its prior: {listed_names(far)}"
    if not np.isfinite(after) or (p is not None and p > 1.0 - SIGNIFICANT):
        mark = Mark.LOOK
    if p is not None and p < SIGNIFICANT:
        mark, word = Mark.BAD, "Residuals exceed the stated noise"
    if impossible(fit):
        mark, word = Mark.BAD, "Not possible"
    if after >= before and (p is None or p < SIGNIFICANT):
        mark, word = Mark.BAD, "No better than the nominal model"
    elif after >= before and mark is not Mark.BAD:
        mark, word = Mark.LOOK, "The nominal values do as well"
    said = f"{size}; {outcome}."
    if found := fit.account.stopping:
        mark, word = Mark.BAD, "Not to be used before it is looked at"
        said = f"{some_of([one.title for one in found], _NAMED)} (below). {said}"
    return Verdict(
        mark,
        word,
        said,
        (
            (f"{mm(after)} mm", "held-out error, 3D RMS"),
            (f"{mm(before)} mm", "the same by the nominal model"),
            (f"{mm(largest)} mm", "largest distance at held-out poses"),
            (f"{count} of {total}", f"{things} identified"),
        ),
    )


def listed_names(names: Sequence[str]) -> str:
    """The first names, and how many more."""
    return some_of(names, _NAMED)

"""A certificate in words."""

from __future__ import annotations

from qsframework.errors import some_of
from qsframework.fits.record import COVERAGE
from qsframework.report.words.noise import SOURCE
from qsframework.report.words.sizes import mm
from qsframework.uses.certificate import Certificate, Conformity

SOURCES = {
    "parameters": ("parameter uncertainty", "fit, covariance of the parameters"),
    "held": ("values held at nominal", "their stated sds, and what these do to the fit"),
    "load": ("load's amount and direction", "as stated in the experiment"),
    "repeatability": ("arm comes back elsewhere", "as stated in the experiment"),
    "instrument": ("instrument, one reading", "as stated: its certificate, or the noise of a reading"),
    "model": (
        "what the model does not describe",
        "excess of the held-out error over the other sources and chance",
    ),
}
RULES = {
    "guarded": "Decision rule: error + U at most the tolerance proves, error - U above it disproves (ISO 14253-1).",
    "simple": "Decision rule: the error alone decides (simple acceptance).",
}
RESULTS = {
    "conforms": "Conforms",
    "fails": "Does not conform",
    "undecided": "Conformity is not decided",
    "open": "Calibrated, without a tolerance",
}


def held_out_words(found: Certificate) -> str:
    """Which readings the accuracy is of."""
    if found.validation.halves:
        return (
            f"There are no held-out readings, so {found.validation.halves} random halves of the poses "
            "were fitted and the other half judged each time: the whole fit is no worse than that."
        )
    return f"At {found.readings} readings of {found.poses} held-out poses."


def conformity_words(c: Conformity | None) -> str:
    """The statement of conformity in one sentence."""
    if c is None:
        return "No tolerance stated: conformity not assessed."
    known = "U not stated"
    if c.expanded >= 0.0:
        known = f"U = {mm(c.expanded)} mm of the instrument along the error, k = {COVERAGE:.0f}"
    size = f"95 % of the readings held out are within {mm(c.error)} mm ({known}), "
    size += f"the tolerance is {mm(c.tolerance)} mm"
    if c.holds is None:
        return f"Conformity can be neither stated nor denied: {size}."
    return f"The calibrated robot {'conforms' if c.holds else 'does NOT conform'}: {size}."


def assumed_words(found: Certificate) -> list[str]:
    """What was taken as known."""
    out = [f"The model is {'the linear one' if found.fit.linear else 'the full equilibrium of arm, springs and load'}."]
    out.append(f"The noise of one coordinate, {mm(found.fit.sigma, 4)} mm, is {SOURCE[found.fit.sigma_source]}.")
    if found.kept:
        out.append(f"Kept at their nominal values, without an uncertainty of their own: {some_of(found.kept)}.")
    if found.fit.total_covariance is None:
        out.append("The load is taken as exactly known: no uncertainty of it is stated.")
    if found.fit.masked_rows:
        out.append(f"{len(found.fit.masked_rows)} readings were not used by the fit: they are outliers.")
    if "instrument" not in {s.source for s in found.budget}:
        out.append("Instrument uncertainty not stated: it is contained in the model error.")
    out += [f"{note}." for note in found.validation.notes]
    out.append("The robot is calibrated as it stood: a changed part or a crash invalidates this certificate.")
    return out

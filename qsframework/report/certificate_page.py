"""A certificate: a page that is signed, with the result and what it is valid for, and an annex of the evidence."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from qsframework.files import sha256
from qsframework.fits.columns import SUITED
from qsframework.report.blocks import Block, Lines, Mark, ReportTable, Section, Text, Verdict
from qsframework.report.error_maps import placed_maps
from qsframework.report.fit_plots import distribution_figure
from qsframework.report.page import write_report
from qsframework.report.plots import GREY
from qsframework.report.provenance import robot_files
from qsframework.report.words.certificate import (
    RESULTS,
    RULES,
    SOURCES,
    assumed_words,
    conformity_words,
    held_out_words,
)
from qsframework.report.words.sizes import mm, shown
from qsframework.uses.certificate import Certificate, DeviceSpec, PartySpec, Quantity

_KELVIN = 273.15
_BAR = 12
"""Blocks of a bar that is the whole variance."""
_BLOCK = "\N{FULL BLOCK}"
_MARKS = {True: Mark.GOOD, False: Mark.BAD, None: Mark.LOOK}


def write_certificate(path: str | Path, found: Certificate) -> Path:
    """Write the certificate, all or nothing, and return its path."""
    title = f"Calibration certificate: {found.experiment.robot.title}"
    return write_report(path, title, _sections(found), _result(found))


def _result(found: Certificate) -> Verdict:
    """The box on top: whether the robot conforms, its error, and the uncertainty of what is corrected by the fit."""
    c = found.conformity
    before, after = found.validation.whole.summary(before=True)[0], found.validation.whole.summary()[0]
    numbers = [
        (f"{mm(after)} mm", "held-out error, 3D RMS"),
        (f"{mm(before)} mm", "the same before calibration"),
        (
            f"{mm(found.fit.coverage * found.corrected)} mm",
            f"U of a corrected {found.fit.account.quantity}, k = {found.fit.coverage:.3g}",
        ),
    ]
    if c is None:
        return Verdict(Mark.LOOK, RESULTS["open"], conformity_words(c), tuple(numbers))
    word = {True: "conforms", False: "fails", None: "undecided"}[c.holds]
    numbers.append((f"{mm(c.tolerance)} mm", "tolerance"))
    return Verdict(_MARKS[c.holds], RESULTS[word], f"{conformity_words(c)} {RULES[c.rule]}", tuple(numbers))


def _sections(found: Certificate) -> list[Section]:
    """The page that is signed: scope, errors, uncertainty, validity, signatures; and the annex: errors, parameters, and
    the files, of whose list the page holds the hash."""
    quantity = found.fit.account.quantity
    scope = tuple(Text(said) for said in found.fit.account.scope())
    remarks = " ".join(filter(None, (found.meta.remarks, *(f"{note}." for note in found.notes))))
    valid = Lines((*(("", said) for said in assumed_words(found)), *((("Remarks:", remarks),) if remarks else ())))
    files = dict.fromkeys([*found.files, *robot_files(found.experiment.robot)])
    hashes = tuple((p.name, sha256(p)) for p in files)
    listed = hashlib.sha256("".join(f"{digest}  {name}\n" for name, digest in hashes).encode()).hexdigest()
    software = f"Computed by qsframework {version('qsframework')}. The same files give the same certificate."
    signed = ReportTable(
        ("date", "operator", "approved by"),
        (("", "", ""),),
        f"SHA-256 of the files in the annex, as sha256sum lists them: {listed}",
    )
    return [
        Section("What was measured", (*scope, Lines(tuple(_conditions(found))))),
        Section(f"Error of the {quantity} before and after calibration", (_errors(found),)),
        Section(f"Uncertainty of a corrected {quantity}", (_budget(found),)),
        Section("What was assumed, and when it is void", (valid,)),
        Section("Signatures", (signed,)),
        Section("Annex: the parameters", (_parameters(found),), new_page=True),
        Section("Annex: the errors", _evidence(found)),
        Section("Annex: the files", (ReportTable(("file", "SHA-256"), hashes, software),)),
    ]


def _conditions(found: Certificate) -> list[tuple[str, str]]:
    """What is stated of the calibration, the robot and the instrument, and in one line what is not."""
    parts = heads(found)
    out = [(f"{title}:", "; ".join(f"{name}: {value}" for name, value in part if value)) for title, part in parts]
    left = [(title.lower(), [name for name, value in part if not value]) for title, part in parts]
    missing = [f"{title}: {', '.join(names)}" for title, names in left if names]
    if not found.arrivals:
        missing.append("AP and RP by ISO 9283, for no position was measured twice at one pose and load")
    return [*(row for row in out if row[1]), *([("Not stated:", "; ".join(missing))] if missing else [])]


def _errors(found: Certificate) -> ReportTable:
    """The 3D error before and after."""
    quantity, whole = found.fit.account.quantity, found.validation.whole
    names = ("RMS", "mean", "95 % of the readings within", "maximum")
    rows = tuple(zip(names, *(map(mm, whole.summary(before)) for before in (True, False)), strict=True))
    said = (
        f"{held_out_words(found)} The error is the distance in space between the measured and the predicted "
        f"{quantity}; before: of the arm with the values that it had before these readings, {SUITED}."
    )
    return ReportTable(("3D error, mm", "before", "after"), rows, said)


def _evidence(found: Certificate) -> tuple[Block, ...]:
    """The errors as a distribution and over the workspace; accuracy by ISO 9283 where it was measured."""
    whole, validation = found.validation.whole, found.validation
    picture = distribution_figure({"before": whole.distances(before=True), "after": whole.distances()})
    if found.conformity is not None:
        tolerance = 1e3 * found.conformity.tolerance
        picture.figure.add_vline(tolerance, line={"color": GREY}, annotation_text="tolerance")
    maps = placed_maps(validation.places, validation.poses, {"before": whole.before, "after": whole.errors})
    again = arrivals(found)
    iso = "By ISO 9283, which asks for 30 arrivals at each pose; the numbers are of as many as were measured."
    table = (ReportTable(("poses that were reached again", ""), tuple(again), iso),) if again else ()
    return (picture, *maps, *table)


def _parameters(found: Certificate) -> ReportTable:
    """Each parameter with its expanded uncertainty, and the stiffness where there is one."""
    rows = [parameter_row(q) for q in found.quantities]
    k = f"k = {found.fit.coverage:.3g}"
    header = ["parameter", f"value ± U ({k})", f"stiffness ± U ({k})", "remark"]
    kept = [k for k in range(4) if k != 2 or any(row[2] for row in rows)]
    return ReportTable(tuple(header[k] for k in kept), tuple(tuple(row[k] for k in kept) for row in rows))


def _budget(found: Certificate) -> ReportTable:
    """Source, how it is known, standard uncertainty mm, share of the variance as a number and as a bar; and what they
    come to."""
    whole = sum(s.standard**2 for s in found.budget) or 1.0
    shares = [s.standard**2 / whole for s in found.budget]
    rows = tuple(
        (*SOURCES[s.source], mm(s.standard, 4), f"{_BLOCK * round(_BAR * share)} {100 * share:.0f} %".strip())
        for s, share in zip(found.budget, shares, strict=True)
    )
    said = (
        f"A corrected {found.fit.account.quantity}, without the instrument that checks it: "
        f"U = {mm(found.fit.coverage * found.corrected)} mm in space, k = {found.fit.coverage:.3g} (about 95 %)."
    )
    return ReportTable(("source", "known from", "standard, mm", "share"), rows, said)


def heads(found: Certificate) -> list[tuple[str, list[tuple[str, str]]]]:
    """Titles and rows of what the certificate is of; "" for what is not stated."""
    meta, i = found.meta, found.meta.instrument
    temperature, load = meta.temperature, meta.load
    if not temperature and found.temperature is not None:
        low, high = (f"{kelvin - _KELVIN:.1f}" for kelvin in found.temperature)
        temperature = f"{low} to {high} °C, as recorded"
    if not load and found.experiment.loads:
        load = f"up to {max(np.linalg.norm(case.wrench[:3]) for case in found.experiment.loads):.0f} N"
    calibration = _stated(meta.calibration, "customer", "date", "place", "operator", "approved_by")
    robot = _stated(meta.robot, "maker", "type", "serial_number", "controller")
    instrument = [
        *_stated(i, "maker", "type", "serial_number"),
        ("its certificate", i.certificate),
        ("valid until", i.valid_until),
        ("U of a point, k = 2", "" if i.uncertainty is None else f"{mm(i.uncertainty)} mm"),
        ("temperature", temperature),
    ]
    return [
        ("Calibration", [("certificate", meta.calibration.number), *calibration]),
        ("Robot", [("model in the files", found.experiment.robot.title), *robot, ("load", load)]),
        ("Instrument and conditions", instrument),
    ]


def _stated(record: PartySpec | DeviceSpec, *names: str) -> list[tuple[str, str]]:
    return [(name.replace("_", " "), getattr(record, name)) for name in names]


def arrivals(found: Certificate) -> list[tuple[str, str]]:
    """Accuracy and repeatability by ISO 9283, of the poses where readings repeat."""
    every = found.arrivals
    if not every:
        return []
    counts = [a.count for a in every]

    def summary(values: Sequence[float]) -> str:
        return f"{mm(float(np.mean(values)))} mm mean, {mm(max(values))} mm maximum"

    return [
        ("poses and markers that were reached again", f"{len(every)}, {min(counts)} to {max(counts)} times each"),
        ("AP, pose accuracy, before", summary([a.before for a in every])),
        ("AP, pose accuracy, after", summary([a.after for a in every])),
        ("RP, pose repeatability", summary([a.repeatability for a in every])),
    ]


def parameter_row(q: Quantity) -> tuple[str, str, str, str]:
    """Name, value with U, the stiffness of a compliance, and what is to be said of it."""
    factor, unit = shown(1.0, q.unit)
    value = pair(q.value * factor, q.expanded * factor, unit)
    stiffness = ""
    if q.stiffness is not None:
        name = "MN m/rad" if q.unit.startswith("rad") else "N/um"
        stiffness = pair(1e-6 * q.stiffness[0], 1e-6 * q.stiffness[1], name)
    return q.name, value, stiffness, q.status


def pair(value: float, expanded: float, unit: str) -> str:
    """`0.301 ± 0.012 unit`: U with two digits, the value with as many decimals."""
    if not np.isfinite(expanded) or expanded <= 0.0:
        return f"{value:.4g} {unit}, U not quoted"
    decimals = max(0, 1 - int(np.floor(np.log10(expanded))))
    return f"{value:.{decimals}f} ± {expanded:.{decimals}f} {unit}"

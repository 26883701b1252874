"""A certificate as one HTML file that prints on a few A4 pages."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from qsframework.applications.certificate import COVERAGE, Certificate, Quantity
from qsframework.files import sha256
from qsframework.report.printed import write_page
from qsframework.report.provenance import robot_files
from qsframework.report.words.certificate import (
    RULES,
    SOURCES,
    assumed_words,
    conformity_words,
    held_out_words,
)
from qsframework.report.words.sizes import shown

MISSING = "not stated"
_WIDTH, _HEIGHT, _LEFT, _BELOW = 640, 190, 44, 34
_KELVIN = 273.15


def write_certificate(path: str | Path, found: Certificate) -> Path:
    """Write the certificate, all or nothing, and return its path."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("qsframework.report"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    page = environment.get_template("certificate.html.j2").render(
        title=f"Calibration certificate: {found.experiment.robot.title}",
        missing=MISSING,
        heads=heads(found),
        verdict=conformity_words(found.conformity),
        decision="" if found.conformity is None else RULES[found.conformity.rule],
        held_out=held_out_words(found),
        quantity=found.fit.account.quantity,
        scope=found.fit.account.scope(),
        accuracy=accuracy(found),
        picture=_distribution(found),
        arrivals=arrivals(found),
        parameters=[parameter_row(q) for q in found.quantities],
        budget=budget(found),
        corrected=f"{1e3 * COVERAGE * found.corrected:.3f}",
        assumed=assumed_words(found),
        remarks=" ".join(filter(None, (found.meta.remarks, *(f"{note}." for note in found.notes)))),
        hashes=[(p.name, sha256(p)) for p in dict.fromkeys([*found.files, *robot_files(found.experiment.robot)])],
        software=f"qsframework {version('qsframework')}",
    )
    return write_page(path, page)


def heads(found: Certificate) -> list[tuple[str, list[tuple[str, str]]]]:
    """Titles and rows of what the certificate is of; what is not stated says so."""
    meta, robot = found.meta, found.meta.robot
    c, i = meta.calibration, meta.instrument
    recorded = found.temperature
    temperature = meta.temperature
    if not temperature and recorded is not None:
        temperature = f"{recorded[0] - _KELVIN:.1f} to {recorded[1] - _KELVIN:.1f} °C, as recorded"
    rows: list[tuple[str, list[tuple[str, str]]]] = [
        (
            "Calibration",
            [
                ("certificate", c.number),
                ("customer", c.customer),
                ("date", c.date),
                ("place", c.place),
                ("operator", c.operator),
                ("approved by", c.approved_by),
            ],
        ),
        (
            "Robot",
            [
                ("model in the files", found.experiment.robot.title),
                ("maker", robot.maker),
                ("type", robot.type),
                ("serial number", robot.serial_number),
                ("controller", robot.controller),
                ("load", meta.load or _load(found)),
            ],
        ),
        (
            "Instrument and conditions",
            [
                ("maker", i.maker),
                ("type", i.type),
                ("serial number", i.serial_number),
                ("its certificate", i.certificate),
                ("valid until", i.valid_until),
                ("U of a point, k = 2", "" if i.uncertainty is None else f"{1e3 * i.uncertainty:.3f} mm"),
                ("temperature", temperature),
            ],
        ),
    ]
    return [(title, [(name, value or MISSING) for name, value in part]) for title, part in rows]


def _load(found: Certificate) -> str:
    """The heaviest load of the experiment, by its force."""
    forces = [float(np.linalg.norm(case.wrench[:3])) for case in found.experiment.loads]
    return f"up to {max(forces):.0f} N" if forces else ""


def accuracy(found: Certificate) -> list[tuple[str, str, str]]:
    """Mean, 95 % and maximum of the 3D error before and after, mm."""
    pairs = zip(found.validation.whole.summary(before=True), found.validation.whole.summary(), strict=True)
    names = ("mean", "95 % of the readings within", "maximum")
    return [(name, f"{1e3 * b:.3f}", f"{1e3 * a:.3f}") for name, (b, a) in zip(names, pairs, strict=True)]


def arrivals(found: Certificate) -> list[tuple[str, str]]:
    """Accuracy and repeatability by ISO 9283, of the poses where readings repeat."""
    every = found.arrivals
    if not every:
        return []
    counts = [a.count for a in every]

    def told(values: Sequence[float]) -> str:
        return f"{1e3 * float(np.mean(values)):.3f} mm mean, {1e3 * max(values):.3f} mm maximum"

    return [
        ("poses and markers that were reached again", f"{len(every)}, {min(counts)} to {max(counts)} times each"),
        ("AP, pose accuracy, before", told([a.before for a in every])),
        ("AP, pose accuracy, after", told([a.after for a in every])),
        ("RP, pose repeatability", told([a.repeatability for a in every])),
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


def budget(found: Certificate) -> list[tuple[str, str, str, str]]:
    """Source, how it is known, standard uncertainty mm, share of the variance."""
    whole = sum(s.standard**2 for s in found.budget) or 1.0
    return [
        (*SOURCES[s.source], f"{1e3 * s.standard:.4f}", f"{100 * s.standard**2 / whole:.0f} %") for s in found.budget
    ]


def _distribution(found: Certificate) -> str:
    """SVG: which share of the readings held out is below an error, before (dashed) and after."""
    whole = found.validation.whole
    curves = [(np.sort(whole.distances(before)) * 1e3, before) for before in (True, False)]
    largest = max(float(c[-1]) for c, _ in curves) or 1.0
    wide, high = _WIDTH - _LEFT - 10, _HEIGHT - _BELOW - 8

    def at(x: float, share: float) -> str:
        return f"{_LEFT + wide * x / largest:.1f},{8 + high * (1.0 - share):.1f}"

    out = [f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="share of readings below an error">']
    for share in (0.0, 0.5, 0.95):
        y = 8 + high * (1.0 - share)
        out.append(f'<line x1="{_LEFT}" x2="{_LEFT + wide}" y1="{y:.1f}" y2="{y:.1f}" class="grid"/>')
        out.append(f'<text x="{_LEFT - 6}" y="{y + 4:.1f}" class="left">{100 * share:.0f} %</text>')
    for x in np.linspace(0.0, largest, 5).tolist():
        out.append(f'<text x="{_LEFT + wide * x / largest:.1f}" y="{_HEIGHT - 18}" class="mid">{x:.2g}</text>')
    out.append(f'<text x="{_LEFT + wide / 2:.0f}" y="{_HEIGHT - 3}" class="mid">3D error, mm</text>')
    for sizes, before in curves:
        steps = " ".join(at(float(s), (k + 1) / len(sizes)) for k, s in enumerate(sizes))
        out.append(f'<polyline points="{at(0.0, 0.0)} {steps}" class="{"before" if before else "after"}"/>')
    if found.conformity is not None and 1e3 * found.conformity.tolerance < largest:
        x = _LEFT + wide * 1e3 * found.conformity.tolerance / largest
        out.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="8" y2="{8 + high}" class="tolerance"/>')
        out.append(f'<text x="{x + 4:.1f}" y="{high:.0f}">tolerance</text>')
    return "".join([*out, "</svg>"])

"""The stiffness of an arm at one pose: tables and words."""

from __future__ import annotations

import numpy as np

from qsframework.report.blocks import Mark, ReportTable, Verdict
from qsframework.report.words.sizes import mm, stiffness_words, three
from qsframework.uses import Stiffness

_LINEAR = 0.01
"""Error of the linear model below which it stands for the full equilibrium: a hundredth of what moves."""
_AXES = ("x", "y", "z", "rx", "ry", "rz")


def stiffness_tables(result: Stiffness) -> list[ReportTable]:
    """Each spring with its stiffness and its share, and the Cartesian stiffness with and without the load."""
    rows = [
        (p.name, stiffness_words(p.unit, p.nominal) or "rigid", *(f"{v * 1e3:z.4f}" for v in own), share)
        for p, own, share in zip(result.springs, result.shares, _shares(result), strict=True)
    ]
    rows += [
        (name, "", *(f"{v * 1e3:z.4f}" for v in vector), "")
        for name, vector in (("linear model", result.linear), ("full equilibrium", result.full))
    ]
    tables = [ReportTable(("spring", "stiffness", "dx mm", "dy mm", "dz mm", "share"), tuple(rows))]
    for words, with_load in (("K_C", True), ("K_C without load and gravity in H", False)):
        K = result.stiffness(with_load)
        if K is not None:
            rows = tuple((axis, *(f"{v:.4g}" for v in row)) for axis, row in zip(_AXES, K, strict=True))
            tables.append(ReportTable((words, *_AXES), rows, "N/m, N/rad, N m/m and N m/rad, base frame."))
    return tables


def _shares(result: Stiffness) -> list[str]:
    """Of what the load point moves, along that way; a dash where it does not."""
    square = float(result.linear @ result.linear)
    return [f"{100 * own @ result.linear / square:.1f} %" if square else "-" for own in result.shares]


def stiffness_verdict(result: Stiffness) -> Verdict:
    """How far the load point moves, which spring gives most, and how stiff the tip is where it is softest."""
    moved = f"{mm(float(np.linalg.norm(result.full)))} mm"
    most = int(np.argmax(result.shares @ result.linear))
    largest = float(np.linalg.eigvalsh(result.compliance[:3, :3])[-1])
    softest = f"{three(1e-6 / largest)} N/um" if largest > 0.0 else "rigid"
    mark = Mark.GOOD if result.linear_error < _LINEAR else Mark.LOOK
    numbers = (
        (moved, "the load point moves"),
        (_shares(result)[most], result.names[most]),
        (softest, "softest direction"),
    )
    return Verdict(mark, "At this pose, under this load", deflection_words(result), numbers)


def deflection_words(result: Stiffness) -> str:
    """How far the load point moves, and the linearisation error; without a load, what K_C is."""
    loaded = np.any(result.full) or np.any(result.rotation) or not np.any(result.compliance)  # a rigid arm stands still
    text = (
        "No load: K_C is that of the arm under its own weight."
        if not loaded
        else f"The load point moves by {np.linalg.norm(result.full) * 1e3:.4f} mm and turns by "
        f"{np.linalg.norm(result.rotation) * 1e3:.4f} mrad. Linearisation error: "
        f"{100 * result.linear_error:.3f} %."
    )
    if result.stiffness() is None:
        text += " In one direction the tip is rigid, so there is no finite K_C."
    return text

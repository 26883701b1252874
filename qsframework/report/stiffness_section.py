"""The stiffness of an arm at one pose: tables and words."""

from __future__ import annotations

import numpy as np

from qsframework.report.blocks import ReportTable
from qsframework.uses import Stiffness

_AXES = ("x", "y", "z", "rx", "ry", "rz")


def stiffness_tables(result: Stiffness) -> list[ReportTable]:
    """The share of each spring, and the Cartesian stiffness with and without the load."""
    square = float(result.linear @ result.linear)
    shares = [
        (name, *(f"{v * 1e3:z.4f}" for v in share), f"{100 * share @ result.linear / square:.1f} %" if square else "-")
        for name, share in zip(result.names, result.shares, strict=True)
    ]
    sums = [
        (name, *(f"{v * 1e3:z.4f}" for v in vector), "")
        for name, vector in (("linear model", result.linear), ("full equilibrium", result.full))
    ]
    tables = [ReportTable(("spring", "dx mm", "dy mm", "dz mm", "share"), tuple([*shares, *sums]))]
    for words, with_load in (("K_C", True), ("K_C without load and gravity in H", False)):
        K = result.stiffness(with_load)
        if K is not None:
            rows = tuple((axis, *(f"{v:.4g}" for v in row)) for axis, row in zip(_AXES, K, strict=True))
            tables.append(ReportTable((words, *_AXES), rows, "N/m, N/rad, N m/m and N m/rad, base frame."))
    return tables


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

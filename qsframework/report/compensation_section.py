"""Corrected targets in a report: what was off, what is left to be expected, and where it is worst."""

from __future__ import annotations

import numpy as np

from qsframework.applications.compensate import Compensation
from qsframework.report.blocks import Figure, Section, Table, Text


def target_table(result: Compensation) -> Table:
    """One row per target: its error uncorrected, the error to be expected after it, the correction."""
    correction = np.rad2deg(result.pendant - result.targets.pendant)
    n = correction.shape[1]
    rows = tuple(
        (
            name,
            f"{result.size[i] * 1e3:.3f}",
            f"{result.sd[i] * 1e3:.4f}",
            f"{result.turn_sd[i] * 1e3:.4f}",
            *(f"{c:+.4f}" for c in correction[i]),
        )
        for i, name in enumerate(result.targets.name)
    )
    header = ("target", "uncorrected mm", "expected after mm", "expected after mrad")
    return Table(
        (*header, *(f"dJ{k + 1} deg" for k in range(n))),
        rows,
        "Distance of the load point from its wanted place without the correction; the root mean square of the distance "
        "that is to be expected with it, from the covariance of the fit and the stated uncertainty of the load; and "
        "what was added to each angle.",
    )


def _of_noise(result: Compensation) -> str:
    """What part is the noise's, where an uncertainty of the load was stated."""
    whole, noise = (float((sd**2).sum()) for sd in (result.sd, result.noise_sd))
    if not whole > noise:
        return ""
    return (
        f"The readings' noise makes {100.0 * noise / whole:.0f} % of its mean square, the stated uncertainty of the "
        "measuring campaign's load the rest, which more readings do not lessen. "
    )


def compensation_section(result: Compensation) -> Section:
    """Words, notes, the figure and the table."""
    import plotly.graph_objects as go

    figure = go.Figure()
    names = list(result.targets.name)
    figure.add_bar(x=names, y=(result.size * 1e3).tolist(), name="uncorrected")
    figure.add_bar(x=names, y=(result.sd * 1e3).tolist(), name="expected after the correction")
    figure.update_layout(
        yaxis={"type": "log", "title": "distance from the wanted place, mm"}, barmode="group", height=380
    )
    caption = (
        "Each pair of bars is a target, on a logarithmic scale. Look for targets whose second bar is not much lower "
        "than the first: there the fit knows too little, and more readings near that pose would help."
    )
    worst = result.worst
    text = (
        "Each target was moved so that the loaded arm, by the full equilibrium of the identified model, stands where "
        "it is wanted. What then remains is the error of the identified parameters, S cov S' with S the derivative of "
        f"the tip at the corrected angles. It is largest at target {names[worst]}: {result.sd[worst] * 1e3:.4f} mm. "
        f"{_of_noise(result)}Effects that the model does not hold, and the robot's repeatability, come on top."
    )
    notes = tuple(Text(f"Note: {note}.") for note in result.notes)
    return Section("Corrected targets", (Text(text), *notes, Figure(figure, caption), target_table(result)))

"""What is known of the parameters of a campaign before its readings, one row a family."""

from __future__ import annotations

from collections import Counter

import numpy as np

from qsframework.experiment import Experiment, Readings
from qsframework.experiment.prior import families, priors_of
from qsframework.report.blocks import ReportTable
from qsframework.report.words.sizes import people_size


def prior_table(experiment: Experiment, readings: Readings | None = None) -> ReportTable:
    """The families that are to be estimated with these readings: how many there are, the sd of each (1 sigma) and where
    it is from."""
    model, names = experiment.model(), experiment.fit_names()
    known, kinds = priors_of(model, readings), families(model, names)
    rows = Counter[tuple[str, str, str]]()
    for name, i in zip(names, model.index(names), strict=True):
        told = np.isfinite(known.sd[i])
        sd = people_size(model.parameters[i], float(known.sd[i]), stiffness=False) if told else "-"
        rows[kinds[name][0], sd, known.source[i]] += 1
    return ReportTable(
        ("known before", "parameters", "sd", "from"),
        tuple((effect, str(count), sd, source) for (effect, sd, source), count in rows.items()),
        "One standard deviation of the values in the files; a maker's +- limit is two of it.",
    )

"""What a plan tells of the fitted parameters, before anything is measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from qsframework.experiment import Experiment, Plan
from qsframework.information.advice import what_would_help
from qsframework.information.sensitivities import predicted_sd


@dataclass(frozen=True)
class PredictedUncertainty:
    """One fitted parameter, SI: the sd that a plan predicts, inf where the plan cannot tell it.

    help: what to measure, "" where the sd is below the parameter's own size
    """

    name: str
    unit: str
    nominal: float
    sd: float
    help: str

    def as_json(self) -> dict[str, Any]:
        """What `qsf diagnose` writes of a plan; sd is null where the plan cannot tell the parameter."""
        sd = self.sd if np.isfinite(self.sd) else None
        return {"name": self.name, "unit": self.unit, "nominal": self.nominal, "sd": sd, "help": self.help}


def predicted_uncertainties(experiment: Experiment, plan: Plan) -> tuple[PredictedUncertainty, ...]:
    """What the plan tells of each parameter that is to be fitted. InputError where the noise is not stated."""
    model, names = experiment.model(), experiment.fit_names()
    out: list[PredictedUncertainty] = []
    for i, sd in zip(model.index(names), predicted_sd(experiment, plan, names), strict=True):
        p = model.parameters[i]
        size = abs(p.nominal) or p.typical
        advice = what_would_help(model, p.name, plan.poses) if sd > size else ""
        out.append(PredictedUncertainty(p.name, p.unit, p.nominal, float(sd), advice))
    return tuple(out)

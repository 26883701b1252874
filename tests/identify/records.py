"""Records of fits that no readings were needed for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace

import numpy as np

from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment
from qsframework.experiment.account import Account
from qsframework.experiment.description import description
from qsframework.fits import Estimate, FitRecord
from qsframework.plugin import Array


def estimate(name: str, value: float, sd: float) -> Estimate:
    """An estimate without bounds."""
    return Estimate(name=name, unit="", value=value, sd=sd, initial=value, lower=-np.inf, upper=np.inf)


def record(
    experiment: Experiment, x: Array, sds: Mapping[str, float], other: Mapping[str, float] | None = None
) -> FitRecord:
    """A fit that found x, all parameters of the experiment's model, with independent sds of those that it estimates.

    other: values of estimates that are not the model's, such as a frame's
    """
    model = experiment.model()
    values = dict(zip(model.names, x.tolist(), strict=True))
    found = {**values, **(other or {})}
    return FitRecord(
        robot=experiment.robot.name,
        account=Account(
            kinds=("displacement",),
            files=(),
            marks=(),
            visits=0,
            reads=0,
            frames=(),
            force=1e6,
            moment=1e6,
            angles=((-7.0, 7.0),) * experiment.robot.controller.axes,
            flange=((-9.0, 9.0),) * 3,
            rigid=experiment.rigid,
            simulated=True,
            description=description(experiment.robot, experiment),
        ),
        method="exact",
        options=FitOptions(),
        estimates=tuple(estimate(name, found[name], sd) for name, sd in sds.items()),
        covariance=np.diag([sd**2 for sd in sds.values()]),
        model_values=values,
        sigma=3e-5,
        sigma_source="stated",
        chi2=0.0,
        dof=0,
        path="fit.json",
    )


def assert_same(one: FitRecord, other: FitRecord) -> None:
    """Every field of the two is the same, bit for bit; where they were read aside."""
    for f in fields(FitRecord):
        if f.name != "path":
            assert _bits(getattr(one, f.name)) == _bits(getattr(other, f.name)), f.name


def _bits(value: object) -> object:
    if isinstance(value, tuple):
        return [_bits(v) for v in value]
    if is_dataclass(value):
        return [_bits(getattr(value, f.name)) for f in fields(value)]
    if isinstance(value, np.ndarray):
        return value.shape, value.tobytes()
    return repr(value) if isinstance(value, float) else value


def with_values(fit: FitRecord, values: Mapping[str, float]) -> FitRecord:
    """The fit with other values of its parameters."""
    estimates = tuple(replace(e, value=values.get(e.name, e.value)) for e in fit.estimates)
    return replace(fit, estimates=estimates, model_values={**fit.model_values, **values})

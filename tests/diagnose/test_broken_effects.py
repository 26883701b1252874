"""An effect of a third party that fails while a diagnosis asks it: the answer names it, its law and its file."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from qsframework.diagnoses import diagnose
from qsframework.errors import PluginError
from qsframework.experiment import example, load_experiment, read_readings
from qsframework.plugin import Array, Context, Geometry, Parameter, RobotFacts, place, registry


@dataclass(frozen=True)
class Fragile(Geometry):
    """Joint errors that go wrong in one way."""

    joint: str = place()
    fault = ""

    @classmethod
    def places(cls, robot: RobotFacts, markers: tuple[str, ...] = ()) -> tuple[Fragile, ...]:
        if cls.fault == "places":
            raise IndexError("no such joint")
        return tuple(cls(joint=joint) for joint in robot.joints)

    def parameters(self, robot: RobotFacts) -> tuple[Parameter, ...]:
        if self.fault == "parameters":
            raise KeyError("size")
        return (Parameter(self.name, "rad", typical=1e-3),)

    def errors(self, x: Array, context: Context) -> Any:
        angles = np.full(context.poses.q.shape, x[0])
        if self.fault == "raises":
            raise ZeroDivisionError("division by zero")
        if self.fault == "text":
            return "0.1"
        return {"nan": angles * np.nan, "shape": angles[:, :2]}.get(self.fault, angles)


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("raises", r"fragile\[joint_1\]: errors\(\) in .*test_broken_effects.py.* fails: ZeroDivisionError"),
        ("nan", r"fragile\[joint_1\]: errors\(\) in .*, gives NaN or infinity of angles"),
        ("shape", r"fragile\[joint_1\]: errors\(\) in .*, gives the shape \(60, 2\) of angles, must be \(60, 6\)"),
        ("text", r"fragile\[joint_1\]: errors\(\) in .*, gives "),
        ("places", r"fragile: places\(\) in .* fails: IndexError: no such joint"),
        ("parameters", r"fragile\[joint_1\]: parameters\(\) in .* fails: KeyError: 'size'"),
    ],
)
def test_a_diagnosis_names_the_effect_that_fails(fault: str, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Fragile, "fault", fault)
    every = MappingProxyType({**registry(), "fragile": Fragile})
    asked = sys.modules["qsframework.hypotheses.catalogue.causes"]
    monkeypatch.setattr(asked, "registry", lambda: every)
    experiment = load_experiment(example("hidden_effect") / "experiment.yaml")
    assert experiment.data is not None
    with pytest.raises(PluginError, match=said) as error:
        diagnose(experiment, read_readings(experiment.data, experiment), repeats=1)
    if "fails" in said:
        assert "uninstall the package that brings it" in str(error.value)

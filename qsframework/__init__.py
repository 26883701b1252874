"""qsframework: elastostatic calibration of heavy, quasi-serial industrial robots.

    import qsframework as qsf

    experiment = qsf.load_experiment("experiment.yaml")
    fit = qsf.identify(experiment, qsf.read_readings(experiment.data, experiment))

Every name here is loaded when it is asked for.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from qsframework import units as units
    from qsframework.applications.compare import compare as compare
    from qsframework.applications.compensate import compensate as compensate
    from qsframework.applications.export import export as export
    from qsframework.applications.importers import import_readings as import_readings
    from qsframework.applications.programme import make_programme as make_programme
    from qsframework.applications.protocol import make_protocol as protocol
    from qsframework.applications.stiffness import stiffness_at as stiffness
    from qsframework.applications.targets import joint_targets as joint_targets, read_targets as read_targets
    from qsframework.design import design as design
    from qsframework.diagnose import diagnose as diagnose
    from qsframework.discriminate.follow_up import second_day as second_day
    from qsframework.errors import (
        InputError as InputError,
        NotCertified as NotCertified,
        NotConverged as NotConverged,
        NotIdentifiable as NotIdentifiable,
        QsfError as QsfError,
    )
    from qsframework.experiment import (
        Experiment as Experiment,
        Plan as Plan,
        Readings as Readings,
        load_experiment as load_experiment,
        read_plan as read_plan,
        read_readings as read_readings,
        simulate as simulate,
        write_plan as write_plan,
        write_readings as write_readings,
    )
    from qsframework.forecast.power import foresee as forecast
    from qsframework.identify import (
        Fit as Fit,
        FitOptions as FitOptions,
        identify as identify,
        read_fit as read_fit,
        validate as validate,
        write_fit as write_fit,
    )
    from qsframework.plugin import check_effect as check_effect
    from qsframework.report.extended import write_extended as extend
    from qsframework.report.results import report as report
    from qsframework.report.words.diagnosis import diagnosis_words as diagnosis_words
    from qsframework.robot import Robot as Robot, load_robot as load_robot
    from qsframework.robot.new import new as new
    from qsframework.screening import screen as screen
    from qsframework.viz.show_scene import show_scene as show

    __version__: str

_HOME = {
    "diagnosis_words": "report.words.diagnosis",
    "compare": "applications.compare",
    "compensate": "applications.compensate",
    "export": "applications.export",
    "import_readings": "applications.importers",
    "joint_targets": "applications.targets",
    "make_programme": "applications.programme",
    "new": "robot.new",
    "protocol": "applications.protocol:make_protocol",
    "read_targets": "applications.targets",
    "design": "design",
    "diagnose": "diagnose",
    "extend": "report.extended:write_extended",
    "report": "report.results",
    "show": "viz.show_scene:show_scene",
    "stiffness": "applications.stiffness:stiffness_at",
    "forecast": "forecast:foresee",
    "second_day": "discriminate",
    "InputError": "errors",
    "NotCertified": "errors",
    "NotConverged": "errors",
    "NotIdentifiable": "errors",
    "QsfError": "errors",
    "Experiment": "experiment",
    "Plan": "experiment",
    "Readings": "experiment",
    "load_experiment": "experiment",
    "read_plan": "experiment",
    "read_readings": "experiment",
    "simulate": "experiment",
    "write_plan": "experiment",
    "write_readings": "experiment",
    "Fit": "identify",
    "FitOptions": "identify",
    "identify": "identify",
    "read_fit": "identify",
    "validate": "identify",
    "write_fit": "identify",
    "check_effect": "plugin",
    "Robot": "robot",
    "load_robot": "robot",
    "screen": "screening",
}
"""Where each name of the front door lives, and after a colon what it is called there."""
__all__ = [
    "Experiment",
    "Fit",
    "FitOptions",
    "InputError",
    "NotCertified",
    "NotConverged",
    "NotIdentifiable",
    "Plan",
    "QsfError",
    "Readings",
    "Robot",
    "__version__",
    "check_effect",
    "compare",
    "compensate",
    "design",
    "diagnose",
    "diagnosis_words",
    "export",
    "extend",
    "forecast",
    "identify",
    "import_readings",
    "joint_targets",
    "load_experiment",
    "load_robot",
    "make_programme",
    "new",
    "protocol",
    "read_fit",
    "read_plan",
    "read_readings",
    "read_targets",
    "report",
    "screen",
    "second_day",
    "show",
    "simulate",
    "stiffness",
    "units",
    "validate",
    "write_fit",
    "write_plan",
    "write_readings",
]


def __getattr__(name: str) -> Any:
    """A name of the front door, or the version, which stands in the package's metadata alone."""
    if name == "__version__":
        from importlib.metadata import version

        return version("qsframework")
    if name == "units":
        return import_module("qsframework.units")
    if name not in _HOME:
        raise AttributeError(f"module 'qsframework' has no attribute {name!r}")
    home, _, own = _HOME[name].partition(":")
    return getattr(import_module(f"qsframework.{home}"), own or name)


def __dir__() -> list[str]:
    return __all__


class _Door(ModuleType):
    """Five verbs have the names of their packages: `qsframework.design` is the verb, whatever has been imported."""


def _verb(name: str) -> property:
    return property(lambda _: __getattr__(name), lambda _, __: None)


for _name in ("design", "identify", "diagnose", "forecast", "report"):
    setattr(_Door, _name, _verb(_name))

sys.modules[__name__].__class__ = _Door

"""qsframework: elastostatic calibration of heavy, quasi-serial industrial robots.

    import qsframework as qsf

    experiment = qsf.load_experiment("experiment.yaml")
    fit = qsf.identify(experiment, qsf.read_readings(experiment.data, experiment))

Every name here is loaded when it is asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from qsframework.lazily import lazily

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
    from qsframework.discriminate import second_day as second_day
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
    from qsframework.forecast import foresee as forecast
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


_home = lazily(
    __name__,
    {
        "report.words.diagnosis": "diagnosis_words",
        "applications.compare": "compare",
        "applications.compensate": "compensate",
        "applications.export": "export",
        "applications.importers": "import_readings",
        "applications.targets": "joint_targets read_targets",
        "applications.programme": "make_programme",
        "robot.new": "new",
        "applications.protocol": "protocol=make_protocol",
        "design": "design",
        "diagnose": "diagnose",
        "report.extended": "extend=write_extended",
        "report.results": "report",
        "viz.show_scene": "show=show_scene",
        "applications.stiffness": "stiffness=stiffness_at",
        "forecast": "forecast=foresee",
        "discriminate": "second_day",
        "errors": "InputError NotCertified NotConverged NotIdentifiable QsfError",
        "experiment": (
            "Experiment Plan Readings load_experiment read_plan read_readings simulate write_plan write_readings"
        ),
        "identify": "Fit FitOptions identify read_fit validate write_fit",
        "plugin": "check_effect",
        "robot": "Robot load_robot",
        "screening": "screen",
    },
)
"""Verbs that have the names of their packages, as `design` and `identify`, stay verbs."""


def __getattr__(name: str) -> Any:
    """A name of the front door, or the version, which stands in the package's metadata alone."""
    if name == "__version__":
        from importlib.metadata import version

        return version("qsframework")
    if name == "units":
        return import_module("qsframework.units")
    return _home(name)


def __dir__() -> list[str]:
    return __all__

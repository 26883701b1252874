"""qsframework: elastostatic calibration of heavy, quasi-serial industrial robots.

    import qsframework as qsf

    experiment = qsf.load_experiment("experiment.yaml")
    fit = qsf.identify(experiment, qsf.read_readings(experiment.data, experiment))

Every name here is loaded when it is asked for.
"""

from __future__ import annotations

from lazy_loader import attach_stub

from qsframework.viewed import MAKERS, View

_SHORT = {"extend": "write_extended", "show": "show_scene", "stiffness": "stiffness_at"}
"""Verbs that have a longer name in their modules."""

_named, _, __all__ = attach_stub(__name__, __file__)
_names = sorted({*__all__, *_SHORT, "__version__"} - {*_SHORT.values()})
__all__[:] = filter(str.islower, _names)
"""The verbs, which `help(qsframework)` shows; records and errors have a page of help each."""


def _view(result: object) -> View:
    from qsframework.report.views import view_of

    return view_of(result)


MAKERS[:] = [_view]
"""Whatever module is imported, this one is before it: results have their looks, and know nothing of where from."""


def __getattr__(name: str) -> object:
    """A name of the front door, or the version, which stands in the package's metadata alone."""
    if name == "__version__":
        from importlib.metadata import version

        return version("qsframework")
    return _named(_SHORT.get(name, name))


def __dir__() -> list[str]:
    return _names

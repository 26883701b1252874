"""Write docs/public_api.txt, every public Python name with its signature: python docs/make_public_api.py"""

from __future__ import annotations

import ast
import importlib
import inspect
import re
from collections.abc import Iterator, Mapping
from functools import cache, cached_property
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

import qsframework

LIST = Path(__file__).parent / "public_api.txt"
PACKAGES: dict[str, tuple[str, ...]] = {
    "qsframework": tuple(dir(qsframework)),
    "qsframework.errors": (),
    "qsframework.plugin": (),
    "qsframework.robot": (),
    "qsframework.elastostatics": (
        "Equilibrium",
        "Model",
        "Site",
        "actuator_torques",
        "cartesian_compliance",
        "cartesian_stiffness",
        "equilibrium",
        "flip_margin",
        "make_model",
        "spring_stiffness",
    ),
    "qsframework.estimation": ("FitOptions", "Interval", "RankTest", "rank_test"),
    "qsframework.experiment": (),
    "qsframework.information": (
        "NotEstimated",
        "PredictedUncertainty",
        "information_rows",
        "predicted_beyond",
        "predicted_sd",
        "predicted_uncertainties",
        "what_would_help",
    ),
    "qsframework.hypotheses": (),
    "qsframework.screening": ("Mistake", "adopted", "find_mistakes", "masked"),
    "qsframework.plans": (),
    "qsframework.fits": (),
    "qsframework.diagnoses": (),
    "qsframework.uses": (),
    "qsframework.cli": (),
    "qsframework.option": ("Option", "Options", "Seed"),
    "qsframework.work": (),
    "qsframework.viz": ("Scene", "residual_scene", "show_scene"),
    "qsf_trackers": (),
    "qsf_controllers": (),
    "qsf_day": ("Protocol", "ProtocolOptions", "VisitOptions", "make_protocol"),
    "qsf_onboarding": (),
}
"""What a user may import: of each package the names given here, or all of its `__all__`. All else may change."""
HEAD = """# Every public Python name of qsframework with its signature; docs/api.md says what a release may change.
# Made by `python docs/make_public_api.py`; a change of this list is told in CHANGELOG.md.
"""


def listing() -> str:
    """The list, one section per package."""
    return HEAD + "".join(f"\n[{package}]\n" + "".join(f"{line}\n" for line in _lines(package)) for package in PACKAGES)


def public(package: str) -> list[str]:
    """The public names of a package."""
    return sorted(PACKAGES[package] or importlib.import_module(package).__all__)


def _lines(package: str) -> Iterator[str]:
    module = importlib.import_module(package)
    for name in public(package):
        thing = getattr(module, name)
        if inspect.isclass(thing) and not get_args(thing):
            yield from _class(name, thing)
        elif inspect.isfunction(thing):
            yield f"def {name}{_signature(thing)}"
        elif get_args(thing):
            yield f"{name}: a type"
        else:
            yield f"{name}: {type(thing).__name__}"


def _class(name: str, cls: type) -> Iterator[str]:
    """The class with its constructor, and what it adds to its bases that are public themselves."""
    bases = ", ".join(b.__name__ for b in cls.__bases__ if b is not object)
    head = f"class {name}({bases})" if bases else f"class {name}"
    yield f"{head}: {_signature(cls.__init__)}" if inspect.isfunction(cls.__init__) else head
    fields = set(getattr(cls, "__dataclass_fields__", ()))
    for member in sorted(_members(cls) - fields):
        value = inspect.getattr_static(cls, member, None)
        plain = value.__func__ if isinstance(value, staticmethod | classmethod) else value
        if isinstance(plain, property | cached_property):
            function = plain.fget if isinstance(plain, property) else plain.func
            yield f"  {member} -> {function.__annotations__.get('return', '?')}"
        elif inspect.isfunction(plain):
            yield f"  def {member}{_signature(plain)}"
        else:
            yield f"  {member}: {_annotation(cls, member)}"


def _members(cls: type) -> set[str]:
    """Names without an underscore that the class has, less those of its public bases."""
    out: set[str] = set()
    for part in cls.__mro__:
        if part.__module__.startswith(("qsframework", "qsf_")) and (
            part is cls or part.__name__ not in _public_classes()
        ):
            out |= {k for k in (*vars(part), *inspect.get_annotations(part)) if not k.startswith("_")}
    return out


@cache
def _public_classes() -> frozenset[str]:
    modules = [importlib.import_module(package) for package in PACKAGES]
    return frozenset(n for m in modules for n in public(m.__name__) if inspect.isclass(getattr(m, n)))


def _unmarked(annotation: Any, names: Mapping[str, Any]) -> Any:
    """A stated type without the marks that say how its file holds it, or what its option is: X of `Annotated[X, ...]`,
    which may have a name."""
    if isinstance(annotation, str) and get_origin(names.get(annotation)) is Annotated:
        return inspect.formatannotation(get_args(names[annotation])[0])

    class Unmark(ast.NodeTransformer):
        def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
            marked = isinstance(node.slice, ast.Tuple) and ast.unparse(node.value) == "Annotated"
            return node.slice.elts[0] if marked else node

    if not isinstance(annotation, str) or "Annotated[" not in annotation:
        return annotation
    return ast.unparse(Unmark().visit(ast.parse(annotation)))


def _signature(function: Any) -> str:
    """As it is written; addresses of functions that stand as defaults are left out."""
    try:
        stated, names = inspect.signature(function), getattr(inspect.unwrap(function), "__globals__", {})
        parameters = [p.replace(annotation=_unmarked(p.annotation, names)) for p in stated.parameters.values()]
        text = re.sub(r" at 0x[0-9a-f]+", "", str(stated.replace(parameters=parameters)))
    except ValueError:
        return "(...)"
    return re.sub(r"(: |-> )(['\"])(.*?)\2", r"\1\3", text)


def _annotation(cls: type, name: str) -> str:
    for part in cls.__mro__:
        if name in (stated := inspect.get_annotations(part)):
            return str(stated[name])
    return type(getattr(cls, name, None)).__name__


if __name__ == "__main__":
    LIST.write_text(listing())

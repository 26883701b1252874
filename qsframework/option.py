"""What an option is. Each is declared once, at the field of an options record or the argument of a function:

    loss: Annotated[str, Option("Weight of large residuals.", choices=("linear", "huber"))] = "linear"

The record checks itself by it, `help()` shows it, and a command line reads its options there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from functools import cache
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from qsframework.arguments import check_options
from qsframework.errors import InputError, Problem, nearest


@dataclass(frozen=True)
class Option:
    """What a user can choose, in one line of help.

    name: where it is not the field's; short: one letter; group: a title, which holds for the options that follow;
    form: how a value is written; choices: allowed values; gone: former ones, each with what serves instead; least,
    most: of a number; unit: "mm" for a length that is typed in mm and held in m; shown: whether help shows the default;
    switch: the value that a bare switch stands for
    """

    help: str
    _: KW_ONLY
    name: str = ""
    short: str = ""
    group: str = ""
    form: str = ""
    choices: tuple[str, ...] = ()
    gone: tuple[tuple[str, str], ...] = ()
    least: float | None = None
    most: float | None = None
    unit: str = ""
    shown: bool = True
    switch: str = ""

    def named(self, field: str) -> str:
        """Its name, of a field."""
        return self.name or field.replace("_", "-")

    def problem(self, field: str, value: object) -> Problem | None:
        """What is wrong with a value; None where nothing is, or where none is given."""
        name = self.named(field)
        argument, words = (name, ""), name.replace("-", " ")
        if self.choices and isinstance(value, str) and value not in self.choices:
            allowed, hint = (
                ", ".join(filter(None, self.choices)),
                dict(self.gone).get(value, nearest(value, self.choices)),
            )
            return Problem(f"unknown {words} {value!r}", allowed=allowed, hint=hint, argument=argument)
        if isinstance(value, int | float) and not self._allows(value):
            found = f"{value:g} {self.unit and 'm'}".strip()
            return Problem(words, found=found, allowed=self._bounds(), argument=argument)
        return None

    def _allows(self, value: float) -> bool:
        low, high = (None if v is None else v * self.scale for v in (self.least, self.most))
        if low is None and high is None:
            return True
        return value == value and (low is None or value >= low) and (high is None or value <= high)

    def _bounds(self) -> str:
        low, high = ("" if v is None else f"{v * self.scale:g}" for v in (self.least, self.most))
        return f"{low} to {high}{self.unit and ' m'}" if low and high else f"{low} or more" if low else f"up to {high}"

    @property
    def scale(self) -> float:
        """SI of one typed unit."""
        return 1e-3 if self.unit == "mm" else 1.0


Seed = Annotated[int, Option("Random seed.", least=0)]


def option_of(annotation: Any) -> Option | None:
    """The option that an annotation declares; None where it declares none."""
    marks = get_args(annotation)[1:] if get_origin(annotation) is Annotated else ()
    return next((mark for mark in marks if isinstance(mark, Option)), None)


@cache
def hints_of(declared: Any) -> Mapping[str, Any]:
    """The annotations of a record or a function, in order; an array is typed as a text, whose reader knows it."""
    return get_type_hints(declared, localns={"Array": str}, include_extras=True)


def check_choice(field: str, declared: Any, value: Any) -> None:
    """InputError for a value that the option of an annotation does not allow."""
    option = option_of(declared)
    if option is not None and (problem := option.problem(field, value)) is not None:
        raise InputError(problem)


class Options:
    """Base of the options of a verb: a frozen dataclass that knows the help of its fields and checks their values."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        told = ((name, option_of(hint)) for name, hint in hints_of(cls).items())
        lines = [f"    {name}: {own.help}{own.unit and ' Here in m.'}" for name, own in told if own is not None]
        cls.__doc__ = "\n".join([f"{cls.__doc__}\n\nArgs:", *lines])

    def __post_init__(self) -> None:
        """InputError with every problem."""
        check_options(self)
        if problems := self._problems():
            raise InputError(problems)

    def _problems(self) -> list[Problem]:
        """What is wrong with the values."""
        own = ((name, option_of(hint)) for name, hint in hints_of(type(self)).items())
        found = (option.problem(name, getattr(self, name)) for name, option in own if option is not None)
        return [problem for problem in found if problem is not None]

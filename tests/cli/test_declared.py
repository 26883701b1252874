"""Options are declared once: what a record says of its fields is what a command has, checks and shows."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import pytest
import typer
from typer.testing import CliRunner

from qsf_controllers.options import ExportOptions
from qsf_day.options import ProtocolOptions
from qsf_onboarding.options import Arm
from qsf_trackers.options import ImportOptions
from qsframework.cli.app import every_command
from qsframework.cli.declared import Values, expanded
from qsframework.cli.help import Command
from qsframework.diagnoses.options import DiagnoseOptions
from qsframework.errors import InputError
from qsframework.estimation.options import FitOptions
from qsframework.option import Option, Options, Seed, hints_of, option_of
from qsframework.plans.options import DesignOptions
from qsframework.uses.options import ProgrammeOptions

RECORDS = {
    "design": DesignOptions,
    "identify": FitOptions,
    "diagnose": DiagnoseOptions,
    "compensate": ProgrammeOptions,
    "export": ExportOptions,
    "protocol": ProtocolOptions,
    "import": ImportOptions,
    "new": Arm,
}


@dataclass(frozen=True, kw_only=True)
class Brewing(Options):
    """How tea is made."""

    leaf: Annotated[str, Option("Which leaf.", choices=("black", "green"))] = "black"
    minutes: Annotated[float, Option("How long.", least=0.5, most=10.0)] = 3.0
    depth: Annotated[float, Option("Of the water, mm.", name="depth-mm", least=1.0, most=200.0, unit="mm")] = 0.1
    lid: Annotated[bool, Option("With the lid on.")] = True
    stir: Annotated[bool, Option("Stir.")] = False
    milk: Annotated[str, Option("Add milk.", choices=("", "cold"), switch="cold")] = ""
    guests: Annotated[tuple[str, ...], Option("A guest.")] = ()
    pairs: Annotated[tuple[tuple[str, ...], ...], Option("Who sit together.", form="NAME,NAME")] = ()
    cups: Annotated[Mapping[str, Path], Option("A cup.", name="cup", form="NAME=FILE")] = field(
        default_factory=dict[str, Path]
    )
    seed: Seed = 0
    patience: int = 5


def brewed(*words: str) -> Brewing:
    """What a command is given for a record."""
    made: list[Brewing] = []

    def brew(options: Brewing) -> None:
        """Make tea."""
        made.append(options)

    own = typer.Typer()
    own.command(cls=Command)(expanded(brew))
    result = CliRunner().invoke(own, list(words))
    if isinstance(result.exception, InputError):
        raise result.exception
    assert result.exit_code == 0, result.output
    return made[0]


def test_a_command_without_options_has_the_defaults_of_the_record() -> None:
    assert brewed() == Brewing()


def test_every_kind_of_field_is_read_from_the_command_line() -> None:
    words = "--leaf green --minutes 4 --depth-mm 80 --no-lid --stir --milk --guests Ada --guests Alan --seed 7"
    given = brewed(*words.split(), "--pairs", "Ada, Alan", "--cup", "Ada=blue.txt,Alan=red.txt")
    assert given == Brewing(
        leaf="green",
        minutes=4.0,
        depth=0.08,
        lid=False,
        stir=True,
        milk="cold",
        guests=("Ada", "Alan"),
        pairs=(("Ada", "Alan"),),
        cups={"Ada": Path("blue.txt"), "Alan": Path("red.txt")},
        seed=7,
    )


@pytest.mark.parametrize(
    ("wrong", "words", "option"),
    [
        ({"leaf": "blak"}, "unknown leaf 'blak'; allowed: black, green. Did you mean 'black'?", "leaf"),
        ({"minutes": 0.1}, "minutes; found 0.1; allowed: 0.5 to 10", "minutes"),
        ({"minutes": float("nan")}, "minutes; found nan; allowed: 0.5 to 10", "minutes"),
        ({"depth": 3.0}, "depth mm; found 3 m; allowed: 0.001 to 0.2 m", "depth-mm"),
        ({"milk": "hot"}, "unknown milk 'hot'; allowed: cold", "milk"),
        ({"seed": -1}, "seed; found -1; allowed: 0 or more", "seed"),
    ],
)
def test_a_record_refuses_what_no_option_allows(wrong: dict[str, Any], words: str, option: str) -> None:
    with pytest.raises(InputError) as refused:
        Brewing(**wrong)
    (problem,) = refused.value.problems
    assert str(problem) == words
    assert problem.argument == (option, "")


def test_all_that_is_wrong_is_said_at_once() -> None:
    with pytest.raises(InputError) as refused:
        Brewing(leaf="red", minutes=99.0)
    assert [p.argument for p in refused.value.problems] == [("leaf", ""), ("minutes", "")]


def test_pairs_that_are_none_name_their_option() -> None:
    with pytest.raises(InputError, match="--cup: not understood; found 'blue'; allowed: NAME=FILE"):
        brewed("--cup", "blue")


def test_help_of_python_and_of_the_command_line_is_the_same() -> None:
    assert inspect.getdoc(Brewing) is not None
    text = inspect.getdoc(Brewing) or ""
    for name, hint in hints_of(Brewing).items():
        option = option_of(hint)
        assert option is None or f"    {name}: {option.help}" in text
    assert text.startswith("How tea is made.\n\nArgs:\n")
    assert "patience" not in text


def test_what_a_robot_reads_is_handed_over_as_it_was_typed() -> None:
    made: list[Values] = []

    def correct(typed: Annotated[Values, ProgrammeOptions]) -> None:
        made.append(typed)

    own = typer.Typer()
    own.command()(expanded(correct))
    assert CliRunner().invoke(own, ["--tool", "1=0,0,0,0,0,0", "--keep", "P1"]).exit_code == 0
    assert made == [{"loads": (), "keep": ("P1",), "tools": ("1=0,0,0,0,0,0",), "frames": (), "start": None}]


@pytest.mark.parametrize("verb", RECORDS)
def test_a_verb_has_every_option_of_its_record(verb: str) -> None:
    """With its help and its default: nothing of them stands anywhere else."""
    typed = {p.name: p for p in every_command()[verb].params}
    for name, hint in hints_of(RECORDS[verb]).items():
        option = option_of(hint)
        if option is not None:
            assert f"--{option.named(name)}" in "".join(typed[name].opts)
            assert typed[name].help.startswith(option.help.removesuffix("."))
            assert f"{name}: {option.help}" in (RECORDS[verb].__doc__ or "")

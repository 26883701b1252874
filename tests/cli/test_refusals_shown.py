"""What is refused, in a terminal: one spelling, equal problems once, colours only where they are wanted."""

from __future__ import annotations

import io
import sys

import pytest

from qsframework.cli.app import main
from qsframework.cli.refusals import told
from qsframework.errors import InputError, Problem
from qsframework.report.blocks import Mark, Verdict
from qsframework.terminal import coloured


class Terminal(io.StringIO):
    """What is written to a terminal."""

    def isatty(self) -> bool:
        return True


def of_lines(*lines: int, found: str = "'abc'") -> list[Problem]:
    return [Problem("is no number", "a.csv", k, "dx_mm", found=found, allowed="a number") for k in lines]


def test_equal_problems_of_many_lines_are_one_in_the_order_of_the_first() -> None:
    other = Problem("unknown column", "a.csv", 3, hint="Did you mean dy_mm?", argument=("anyway", ""))
    lines = told(InputError([*of_lines(4, 5, 6, 9), other, *of_lines(20)]))
    assert lines == [
        "a.csv, lines 4 to 6, 9, 20, column dx_mm: is no number; found 'abc'; allowed: a number",
        "a.csv, line 3: unknown column. Did you mean dy_mm? (--anyway)",
    ]


def test_what_was_found_is_told_of_the_first_and_how_many_others() -> None:
    (line,) = told(InputError([*of_lines(4), *of_lines(5, found="'x'"), *of_lines(6, found="'y'")]))
    assert line.startswith("a.csv, lines 4 to 6, column dx_mm: is no number; found 'abc' and 2 others;")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["identify", "--nope"], "error: No such option: --nope"),
        (["nope"], "error: No such command 'nope'."),
        (["design"], "error: Missing argument 'experiment'."),
        (["check", "no_such_robot"], "error: "),
    ],
)
def test_every_refusal_is_spelled_alike(
    words: list[str], said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["qsf", *words])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    out, err = capsys.readouterr()
    assert any(line.startswith(said) for line in err.splitlines()), err
    assert "Error:" not in err + out


@pytest.mark.parametrize(("words", "code"), [(["--version"], 0), (["identify", "--help"], 0), ([], 2)])
def test_the_exit_code_of_help_and_version(words: list[str], code: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["qsf", *words])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert (stopped.value.code or 0) == code


def test_colours_only_on_a_terminal_that_nobody_wants_plain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert coloured("error:", "red", io.StringIO()) == "error:"
    assert coloured("error:", "red", Terminal()) == "\x1b[1;31merror:\x1b[0m"
    monkeypatch.setenv("NO_COLOR", "1")
    assert coloured("error:", "red", Terminal()) == "error:"
    monkeypatch.delenv("NO_COLOR")
    monkeypatch.setenv("TERM", "dumb")
    assert coloured("error:", "red", Terminal()) == "error:"


def test_the_verdict_is_coloured_by_its_mark(monkeypatch: pytest.MonkeyPatch) -> None:
    from qsframework.cli.printing import print_verdict

    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    terminal = Terminal()
    monkeypatch.setattr(sys, "stdout", terminal)
    print_verdict(Verdict(Mark.BAD, "Cause not known", "look there", ()))
    assert terminal.getvalue() == "\x1b[1;31mCause not known\x1b[0m: look there\n\n"

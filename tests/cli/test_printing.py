"""Tables and sentences at every width: nothing is wider than the terminal, nothing breaks inside a word or a number."""

from __future__ import annotations

import re

import pytest

from qsframework.cli.printing import print_folded, print_table, print_verdict
from qsframework.report.blocks import Mark, Verdict
from qsframework.terminal import PIPE, folded, table_lines, width

HEADER = ("parameter", "value ± sd", "unit", "sd, % of initial", "initial", "status")
ROWS = (
    (
        "joint_compliance[joint_1]",
        "1.161 ± 0.041",
        "urad/(N m)",
        "15.8 %",
        "0.26",
        "7 prior sds from its initial value",
    ),
    ("joint_compliance[joint_2]", "0.368 ± 0.06", "urad/(N m)", "39.8 %", "0.15", "ok"),
    (
        "base_compliance",
        "4.865 ± 2.3",
        "urad/(N m)",
        "111.1 %",
        "2.1",
        "not identifiable from these readings: sd 111 %",
    ),
)
WIDE = (("target", *(f"dJ{k} deg" for k in range(1, 13))), (("hole_1", *(f"{k:+.4f}" for k in range(12))),))


@pytest.mark.parametrize("room", [60, 80, 100, 160])
@pytest.mark.parametrize(("header", "rows"), [(HEADER, ROWS), WIDE])
def test_a_table_keeps_its_words_whole_and_to_the_width(
    header: tuple[str, ...], rows: tuple[tuple[str, ...], ...], room: int
) -> None:
    lines = "\n".join(table_lines(header, rows, room)).splitlines()
    assert max(map(len, lines)) <= room
    text = " ".join(lines)
    for word in " ".join((*header, *(cell for row in rows for cell in row))).split():
        assert {word, f"{word}:"} & set(text.split()) or word == "ok", word
    for cell in (cell for row in rows for cell in row if len(cell) < 20):  # a value and its sd stand together
        assert cell in text or cell == "ok", cell


def test_words_that_do_not_fit_stand_below_their_row() -> None:
    narrow = "\n".join(table_lines(HEADER, ROWS, 80))
    assert "\n    status: 7 prior sds from its initial value\njoint_compliance[joint_2]" in narrow
    assert "status: ok" not in narrow
    wide = table_lines(HEADER, ROWS, 160)
    assert wide[0].split() == " ".join(HEADER).split()
    assert len(wide) == 2 + len(ROWS)


def test_numbers_end_and_words_begin_in_one_column() -> None:
    lines = table_lines(HEADER, ROWS, 160)
    ends = {line.index("%", 60) for line in lines[2:]}
    assert len(ends) == 1
    begins = {re.search(r"(7 prior|ok|not ident)", line).start() for line in lines[2:]}  # type: ignore[union-attr]
    assert begins == {lines[0].index("status")}


def test_a_pipe_is_a_hundred_wide(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.delenv("COLUMNS")
    monkeypatch.setattr("sys.__stdout__", None)  # no terminal
    assert width() == PIPE == 100
    said = "- the way was not checked against joint_compliance[joint_1] " * 6
    print_verdict(Verdict(Mark.GOOD, "Identified", said, ()))
    assert "\ufffd" not in capsys.readouterr().out
    print_folded(said)
    print_table(HEADER, ROWS, "Title")
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 100
    assert lines[1].startswith("  ")
    assert " ".join(" ".join(lines[:4]).split()).startswith(said.strip()[:300])


@pytest.mark.parametrize("room", [80, 100])
def test_an_estimate_is_never_broken(room: int) -> None:
    """With its sd and its unit it is one quantity, and stands below its row where the columns are too many for it."""
    header = ("cause", "estimate ± sd", "s", "adjusted p", "delta EBIC", "held-out gain", "nearest, angle", "status")
    long, short = "-0.1945 ± 0.0093 urad/(kN m)^3", "1.5 ± 0.2 %"
    rest = ("20.9", "< 1e-16", "310.1", "27 %", "load_point_offset, 60 deg", "named")
    lines = table_lines(header, [("joint_hardening[joint_3]", long, *rest), ("load_scale", short, *rest)], room)
    assert max(map(len, lines)) <= room
    assert sum(long in line for line in lines) == 1
    assert sum(short in line for line in lines) == 1
    alone = table_lines(header, [("load_scale", short, *rest)], room)
    assert any(line.startswith("load_scale  ") and short in line for line in alone)


def test_a_sentence_keeps_a_quantity_on_one_line() -> None:
    said = "A further compliance beyond a knee torque (-0.1945 ± 0.0093 urad/(kN m)^3; s = 20.9)."
    for room in range(45, 80):
        assert any("-0.1945 ± 0.0093 urad/(kN m)^3" in line for line in folded(said, room, "").splitlines())

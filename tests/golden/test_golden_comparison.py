"""The comparison of the net: each kind of change is told as what it is, with its place."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import golden
import pytest
from golden_record import Record, Tolerance, differences, read_record, record, stored_numbers, stored_words

RESULT = {
    "robot": "arm",
    "estimates": {"k[joint_1]": {"value": 1.25e-7, "sd": 1e-9, "state": "fine", "status": "far from 0.3 mm"}},
    "residuals": [[0.5, 1e-17], [0.25, -2.0]],
    "count": 12,
    "limit": None,
}
TEXT = "Identified: 0.142 → 0.030 mm; all 6 are known.\n\nname      value\n───────────────\nk[joint_1]  1.5\n"
TABLE = "# robot: arm, 3 markers\npose,q1_deg,load\np01,1.50,weight\np02,-2.25,pull\n"


def left(folder: Path, text: str = TEXT, table: str = TABLE, code: int = 0, **result: Any) -> Record:
    """What a command left that printed a text, and wrote a JSON and a table."""
    folder.mkdir(exist_ok=True)
    (folder / "fit.json").write_text(json.dumps(RESULT | result))
    (folder / "plan.csv").write_text(table)
    return record(code, {"stdout": text}, {n: folder / n for n in ("fit.json", "plan.csv")}, {str(folder): "<folder>"})


@pytest.fixture
def kept(tmp_path: Path) -> Record:
    """A record, read from its two files."""
    one = left(tmp_path)
    return read_record(stored_numbers(one, "identify"), stored_words(one, "identify"))


def test_the_same_is_the_same(kept: Record, tmp_path: Path) -> None:
    assert differences("a/b", kept, left(tmp_path)) == {}
    other = "Identified:  0.142 → 0.030  mm; all 6 are known.\n\nname    value\n─────────────\nk[joint_1]   1.5\n"
    assert differences("a/b", kept, left(tmp_path, text=other)) == {}, "the width of a table follows its numbers"


@pytest.mark.parametrize(
    ("changed", "place"),
    [
        ({"count": 13}, "fit.json /count: 12 -> 13"),
        ({"limit": 0.5}, "fit.json /limit: null -> 0.5"),
        ({"residuals": [[0.5, 1e-17], [0.251, -2.0]]}, "fit.json /residuals/1/0: 0.25 -> 0.251"),
        (
            {"residuals": [[0.5, 1e-17], [0.25]]},
            "fit.json /residuals/*/*: 4 numbers -> 3, from the 4. on: -2.0 -> none",
        ),
        (
            {"estimates": {"k[joint_1]": RESULT["estimates"]["k[joint_1]"] | {"value": 1.25001e-7}}},
            "fit.json /estimates/k[joint_1]/value: 1.25e-07 -> 1.25001e-07",
        ),
        (
            {"estimates": {"k[joint_1]": RESULT["estimates"]["k[joint_1]"] | {"status": "far from 0.7 mm"}}},
            "fit.json /estimates/k[joint_1]/status, number 1 of: far from # mm: 0.3 -> 0.7",
        ),
        ({"text": TEXT.replace("0.030", "0.034")}, "stdout line 1, number 2 of: Identified: # → # mm; all # are"),
        ({"text": TEXT.replace("6 are", "5 are")}, "stdout line 1, number 3 of"),
        ({"table": TABLE.replace("1.50", "1.53")}, "plan.csv row 1, column q1_deg: 1.50 -> 1.53"),
        ({"table": TABLE + "p03,4.50,weight\n"}, "plan.csv q1_deg: 2 numbers -> 3, from the 3. on: none -> 4.50"),
    ],
)
def test_a_number_is_told_with_its_place(kept: Record, tmp_path: Path, changed: dict[str, Any], place: str) -> None:
    found = differences("a/b", kept, left(tmp_path, **changed))
    assert set(found) - {"names"} == {"numbers"}, "rows of a table have names too"
    assert len(found["numbers"]) == 1
    assert place in found["numbers"][0]
    assert place.split(":")[0] in golden.said("a/b", "identify", found)
    assert "words" not in golden.said("a/b", "identify", found).splitlines()[0]


@pytest.mark.parametrize(
    ("changed", "kind", "place"),
    [
        ({"text": TEXT.replace("are known", "identified")}, "words", "stdout line 1: 'Identified: # → # mm; all # are"),
        ({"table": TABLE.replace(" markers", " reflectors")}, "words", "plan.csv line 1"),
        (
            {"estimates": {"k[joint_1]": RESULT["estimates"]["k[joint_1]"] | {"status": "off by 0.3 mm"}}},
            "words",
            "fit.json line 1: '/estimates/k[joint_1]/status far from # mm' -> '/estimates/k[joint_1]/status off by #",
        ),
        ({"robot": "leg"}, "names", "fit.json /robot, 1.: arm -> leg"),
        ({"table": TABLE.replace("pull", "push")}, "names", "plan.csv load, 2.: pull -> push"),
        ({"table": TABLE.replace("load", "wrench")}, "names", "plan.csv header, 3.: load -> wrench"),
        ({"code": 2}, "exit code", "0 -> 2"),
    ],
)
def test_a_word_and_a_name_are_told_apart_from_numbers(
    kept: Record, tmp_path: Path, changed: dict[str, Any], kind: str, place: str
) -> None:
    found = differences("a/b", kept, left(tmp_path, **changed))
    assert set(found) == {kind}
    assert found[kind][0].startswith(place)


def test_files_that_are_missing_or_new_are_named(tmp_path: Path) -> None:
    full = left(tmp_path)
    less = record(0, {"stdout": TEXT}, {"fit.json": tmp_path / "fit.json"}, {str(tmp_path): "<folder>"})
    assert differences("a/b", full, less) == {"files": ["plan.csv: no longer written"]}
    assert differences("a/b", less, full) == {"files": ["plan.csv: new"]}
    assert differences("a/b", full, record(0, {}, {}, {}))["files"][-1] == "stdout: no longer written"


def test_rounding_is_no_change(kept: Record, tmp_path: Path) -> None:
    near = {"residuals": [[0.5 + 1e-10, -3e-17], [0.25, -2.0]]}
    assert differences("a/b", kept, left(tmp_path, **near, text=TEXT.replace("0.030", "0.031"))) == {}


def test_a_tolerance_is_of_its_place_alone(kept: Record, tmp_path: Path) -> None:
    wide = Tolerance(reason="a draw", line="a/.*", file="fit.json", place="/count", relative=0.2)
    assert differences("a/b", kept, left(tmp_path, count=13), [wide]) == {}
    assert differences("c/b", kept, left(tmp_path, count=13), [wide])
    assert differences("a/b", kept, left(tmp_path, count=16), [wide])
    endless = Tolerance(reason="one over nothing", place="/limit", infinite=1e9)
    assert differences("a/b", kept, left(tmp_path, limit=3e15), [endless]) == {}
    assert differences("a/b", kept, left(tmp_path, limit=3.0), [endless])
    tie = Tolerance(reason="alike", file="fit.json", place="/robot", ties=True)
    assert differences("a/b", kept, left(tmp_path, robot="leg"), [tie]) == {}


def test_what_differs_from_run_to_run_is_not_recorded(tmp_path: Path) -> None:
    text = f"{tmp_path}/fit.json on 2026-11-25 20:24:01 by qsframework 0.1.0, {64 * 'a'}, 3.5 mm\n"
    found = record(0, {"stdout": text}, {}, {str(tmp_path): "<folder>"})
    assert found.words == {"stdout": ["<folder>/fit.json on <date> by qsframework <version>, <hash>, # mm"]}
    assert found.numbers == {("stdout", "text"): ["3.5"]}
    far = record(0, {"stdout": "data: ../../../a/b/r.csv, ../../b/robots/c/d.yaml\n"}, {}, {"/a/b": "<repository>"})
    assert far.words == {"stdout": ["data: <repository>/r.csv, <repository>/robots/c/d.yaml"]}


def test_a_chain_without_a_record_and_a_changed_one_fail(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the list to the message, with a command line of its own."""
    monkeypatch.setattr(golden, "EXPECTED", tmp_path / "expected")
    chain = golden.Chain("own", {"robots": "robots --json robots.json", "bad": "check fanuc_m9000"}, 2)

    def held(name: str) -> list[str]:
        (tmp_path / name).mkdir()
        return [said for _, said in golden.hold(chain, tmp_path / name, [])]

    assert all("nothing is recorded; golden.py --write own/" in said for said in held("a"))
    (tmp_path / "b").mkdir()
    for name, line, found in golden.run_chain(chain, tmp_path / "b"):
        golden.write(name, line, found)
    assert held("c") == ["", ""]
    path = tmp_path / "expected" / "own" / "bad.numbers"
    path.write_text(path.read_text().replace("exit 2", "exit 0"))
    one, two = held("d")
    assert one == ""
    assert two == "own/bad: exit code changed: qsf check fanuc_m9000\n  exit code: 0 -> 2"

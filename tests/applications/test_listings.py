"""Programmes in the structure of public listings: every motion is corrected, kept or refused, and all else stays."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from count_motions import count_motions, without_numbers

from qsframework.errors import InputError
from qsframework.experiment import Experiment, load_experiment
from qsframework.plugin.language import endings, languages
from qsframework.plugin.poses import matrix, numbers_of
from qsframework.uses.compensate import compensate
from qsframework.uses.programme_targets import (
    ProgrammeOptions,
    ProgrammeTargets,
    corrected_texts,
    read_programme,
)
from tests.applications.test_compensate import exact_fit, known

FOLDER = Path(__file__).parent / "listings"
COUNTS = {row["programme"]: row for row in csv.DictReader((FOLDER / "counts.csv").read_text().splitlines())}
ROBOTS = {"fanuc": "fanuc_m900ib", "kuka": "kuka_kr270", "abb": "abb_irb6640_185_280", "ur": "ur10"}
STARTS = {
    "fanuc": (25.0, 28.0, -12.0, 3.0, 62.0, 4.0),
    "kuka": (10.0, -85.0, 105.0, 8.0, 35.0, 5.0),
    "abb": (10.0, 10.0, 5.0, 8.0, 40.0, 5.0),
    "ur": (10.0, -80.0, 95.0, -100.0, -85.0, 5.0),
}
TOOL = np.array([50.0, -30.0, 250.0, 10.0, -20.0, 30.0])
FRAME = np.array([900.0, -400.0, 120.0, 5.0, 3.0, -40.0])
PULL = np.array([0.0, 20.0, -60.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Experiment]:
    @cache
    def make(maker: str) -> Experiment:
        path = tmp_path_factory.mktemp(maker) / "experiment.yaml"
        lines = [f"robot: {ROBOTS[maker]}", "load: {point_mm: [20, 30, 200]}", "markers: {m1: {xyz_mm: [0, 0, 200]}}"]
        path.write_text("\n".join([*lines, "noise: {sigma_mm: 0.03}"]) + "\n")
        return load_experiment(path)

    return make


def options(maker: str, keep: tuple[str, ...]) -> ProgrammeOptions:
    """What is stated of every programme of a maker."""
    tool, frame = (np.array([0.0, 0.0, 0.15, 0.0, 0.0, 0.3]), np.zeros(6)) if maker == "ur" else (TOOL, FRAME)
    names = {"fanuc": ("3", "2"), "kuka": ("3", "2"), "abb": ("tGun", "wobj0"), "ur": ("tcp", "base")}[maker]
    start = np.deg2rad(STARTS[maker])
    return ProgrammeOptions(
        loads={"": PULL}, keep=keep, tools={names[0]: tool}, frames={names[1]: frame, "wPart": FRAME}, start=start
    )


def counted(error: InputError) -> dict[str, int]:
    """Motions, and those corrected, kept and refused, as the first problem says them."""
    words = error.problems[0].message.replace(",", "").replace(":", "").split()
    return dict(zip(("motions", "corrected", "kept", "refused"), map(int, filter(str.isdigit, words)), strict=True))


def followed(path: Path, experiment: Experiment, maker: str) -> tuple[ProgrammeTargets | None, dict[str, int]]:
    """The programme once the advice of each refusal was followed, and the counts of the first answer.

    A tool or a frame that nobody knows is no use: its point is kept. None: nothing is left to correct.
    """
    keep, first = tuple[str, ...](), dict[str, int]()
    for _ in range(6):
        try:
            made = read_programme(path, experiment, options(maker, keep))
        except InputError as error:
            problems = error.problems
        else:
            return made, first or {"motions": len(made.source.motions), **made.counts}
        if "nothing is left to correct" in problems[0].message:
            return None, first
        first = first or counted(InputError(problems))
        for problem in problems[1:]:
            assert problem.file, problem.line
            assert problem.argument is not None, "each refusal says what to do"
            what, value = problem.argument
            point = problem.message.split(" is a pose")[0]
            keep = (*keep, value.strip("'") if what == "keep" else point)
    raise AssertionError("the advice does not lead to an end")


LISTINGS = sorted(p.name for p in FOLDER.iterdir() if p.suffix in (".ls", ".src", ".mod", ".script"))


def decoded(content: bytes) -> str:
    try:
        return content.decode()
    except UnicodeDecodeError:
        return content.decode("latin-1")


def test_there_are_sixty_programmes_of_four_languages() -> None:
    assert len(LISTINGS) >= 60
    assert min(Counter(Path(name).suffix for name in LISTINGS).values()) >= 15
    assert sorted(COUNTS) == LISTINGS


def test_the_record_has_the_sums() -> None:
    docs = FOLDER.parents[2] / "docs"
    told = list(csv.reader((docs / "records" / "robustness-programmes-by-language.csv").read_text().splitlines()))[1:]
    for row, ending in zip(told, (".ls", ".src", ".mod", ".script", ""), strict=True):
        own = [row for name, row in COUNTS.items() if name.endswith(ending)]
        sums = [sum(int(row[k]) for row in own) for k in ("motions", "corrected", "kept", "refused")]
        assert row[1:] == [str(len(own)), *map(str, sums), "0"]
    _, number, _, corrected, kept, refused, _ = told[-1]
    page = " ".join((docs / "results.md").read_text().split())
    assert f"Of {number} programmes in the structure of these" in page
    assert f"{corrected} motions are corrected, {kept} kept, {refused} refused" in page


@pytest.mark.parametrize("name", LISTINGS)
def test_every_motion_is_accounted_for(name: str, cell: Callable[[str], Experiment]) -> None:
    path, maker = FOLDER / name, endings()[Path(name).suffix]
    experiment, own = cell(maker), count_motions(path.suffix, decoded(path.read_bytes()))
    made, first = followed(path, experiment, maker)
    assert first == {k: int(v) for k, v in COUNTS[name].items() if k != "programme"}
    assert first["motions"] == first["corrected"] + first["kept"] + first["refused"] == own
    if made is None:
        assert first["corrected"] == 0
        return
    assert sum(made.counts.values()) == own
    assert made.counts["refused"] == 0
    result = compensate(experiment, known(exact_fit(experiment)), made.targets)
    for file, text in corrected_texts(made, result, experiment).items():
        before, after = file.read_bytes(), text.encode(made.source.encodings[file])
        assert without_numbers(decoded(after)) == without_numbers(decoded(before))
        both = zip(before.split(b"\n"), after.split(b"\n"), strict=True)
        changed = {k for k, (a, b) in enumerate(both, start=1) if a != b}
        starts = [c.start for p in made.points if p.path == file for name, c in p.cells.items() if name[0] != "E"]
        assert changed == {decoded(before).count("\n", 0, k) + 1 for k in starts}, "the lines of corrected points alone"


@pytest.mark.parametrize(
    "name", ["folds.src", "weld_seam.ls", "inline.mod", "poses.mod", "polyscope.script", "tools.script"]
)
def test_corrected_poses_are_read_back_as_the_places_that_were_meant(
    name: str, cell: Callable[[str], Experiment], tmp_path: Path
) -> None:
    maker = endings()[Path(name).suffix]
    experiment = cell(maker)
    made, _ = followed(FOLDER / name, experiment, maker)
    assert made is not None
    result = compensate(experiment, known(exact_fit(experiment)), made.targets)
    for file, text in corrected_texts(made, result, experiment).items():
        (tmp_path / file.name).write_bytes(text.encode(made.source.encodings[file]))
    back, _ = followed(tmp_path / name, experiment, maker)
    assert back is not None
    assert np.abs(back.targets.wanted.position - result.command.position).max() < 2e-6
    assert np.abs(back.targets.wanted.rotation - result.command.rotation).max() < 2e-6
    assert np.linalg.norm(result.deflection[:, :3], axis=1).min() > 1e-6, "there is something to correct"


@pytest.mark.parametrize(
    ("listing", "ending"), [("compact.mod", ".modx"), ("compact.mod", ".sysx"), ("polyscope.script", ".urscript")]
)
def test_other_endings_of_a_language(
    listing: str, ending: str, cell: Callable[[str], Experiment], tmp_path: Path
) -> None:
    path = (tmp_path / listing).with_suffix(ending)
    path.write_bytes((FOLDER / listing).read_bytes())
    maker = endings()[Path(listing).suffix]
    _, counts = followed(path, cell(maker), maker)
    assert counts == {k: int(v) for k, v in COUNTS[listing].items() if k != "programme"}


@pytest.mark.parametrize("name", ["pHol", "pJ", "arcL", "way_C2", "moveL"])
def test_a_name_that_ends_as_an_instruction_is_no_motion(
    name: str, cell: Callable[[str], Experiment], tmp_path: Path
) -> None:
    """Of an array that is gone through, and of one point."""
    unused = "[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]"
    path = tmp_path / "path.mod"
    path.write_text(
        "MODULE M\nPERS tooldata tA:=[TRUE,[[0,0,150],[1,0,0,0]],[5,[0,0,80],[1,0,0,0],0,0,0]];\n"
        f"CONST robtarget {name}s{{1}}:=[[[1500,0,1300],[0.5,0,0.866025,0],{unused}]];\n"
        f"CONST robtarget {name}{{2}}:=[[[1500,0,1300],[0.5,0,0.866025,0],{unused}],"
        f"[[1450,90,1300],[0.5,0,0.866025,0],{unused}]];\n"
        "PROC main()\nMoveAbsJ [[10,20,-10,5,60,20],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,tA;\nFOR i FROM 1 TO 2 DO\n"
        f"MoveL {name}{{i}},v100,fine,tA\\WObj:=wobj0;\nENDFOR\nMoveL {name}s{{1}},v100,fine,tA;\nENDPROC\nENDMODULE\n"
    )
    made = read_programme(path, cell("abb"), options("abb", ()))
    assert len(made.source.motions) == sum(made.counts.values()) == 3


def test_rotations_are_those_of_each_controller() -> None:
    """Quaternions, scalar first, and rotation vectors, written again here; the angles come back on their own turn."""
    w, x, y, z = np.array([0.5, -0.1, 0.7, 0.3]) / np.sqrt(0.84)
    by_hand = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    place = matrix(languages()["abb"].pose, np.array([100.0, 200.0, 300.0, w, x, y, z]))
    assert np.allclose(place[:3, :3], by_hand, atol=1e-12)
    assert np.allclose(place[:3, 3], [0.1, 0.2, 0.3])
    angle = 2.0 * np.arccos(w)
    vector = angle * np.array([x, y, z]) / np.sin(angle / 2.0)
    assert np.allclose(matrix(languages()["ur"].pose, np.array([0.1, 0.2, 0.3, *vector])), place, atol=1e-12)
    other = vector * (1.0 - 2.0 * np.pi / angle)
    for own in (vector, other):
        shown = numbers_of(
            languages()["ur"].pose, place, dict(zip(languages()["ur"].pose.axes, [0.1, 0.2, 0.3, *own], strict=True))
        )
        assert np.allclose(list(shown.values()), [0.1, 0.2, 0.3, *own], atol=1e-9)
    for sign in (1.0, -1.0):
        own = dict(zip(languages()["abb"].pose.axes, [0.0, 0.0, 0.0, *(sign * np.array([w, x, y, z]))], strict=True))
        shown = numbers_of(languages()["abb"].pose, place, own)
        assert np.allclose(list(shown.values()), [100.0, 200.0, 300.0, *(sign * np.array([w, x, y, z]))], atol=1e-9)

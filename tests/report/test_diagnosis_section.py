"""The report of a diagnosis is whole, says what to look for, escapes what users wrote, and its numbers are right."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from remembered import diagnose

from qsf_plugins.joint_hardening import JointHardening
from qsframework.diagnoses import Diagnosis
from qsframework.diagnoses.error_budget import error_budget, linear_errors
from qsframework.diagnoses.result import Leftover, Status
from qsframework.elastostatics import make_model
from qsframework.hypotheses.catalogue.law import Law, LikelyPlace
from qsframework.report import Figure, ReportTable, SceneView, Section, write_report
from qsframework.report.diagnosis_plots import main_direction
from qsframework.report.diagnosis_section import diagnosis_sections
from qsframework.report.diagnosis_tables import cause_table, excluded_table, outlier_table, unseen_table
from qsframework.report.words.diagnosis import diagnosis_words, limit_words
from qsframework.viz import residual_scene
from tests.diagnose.cases import SIGMA, campaign, measured
from tests.report.test_report import EVIL, Page, parse


@cache
def found() -> Diagnosis:
    """A diagnosis of a gear that hardens, with one wrong row."""
    hidden = JointHardening("joint_3")
    truth = {p.name: 0.4 * p.typical for p in hidden.parameters(campaign().robot.facts)}
    readings = measured((hidden,), truth, seed=5, count=30)
    wrong = np.array(readings.value)
    wrong[7, 1] += 40 * SIGMA
    return diagnose(campaign(), readings.with_values(wrong), seed=1)


@cache
def nothing() -> Diagnosis:
    return diagnose(campaign(), measured(seed=3, count=30), seed=1)


@cache
def sections(which: str) -> tuple[Section, ...]:
    return diagnosis_sections(found() if which == "found" else nothing(), [campaign().path])


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "r.html"
    return write_report(path, "Diagnosis", sections("found"))


def test_the_case_is_what_the_tests_need() -> None:
    assert [f.name for f in found().findings] == ["joint_hardening[joint_3]"], diagnosis_words(found())
    assert 7 in found().outliers
    assert nothing().verdict == "none", diagnosis_words(nothing())


def test_the_report_is_whole_and_offline(page: Path) -> None:
    text, tags = page.read_text(), parse(page)
    assert tags.loads == []
    assert all(a.startswith("#") and a[1:] in tags.ids for a in tags.anchors)
    assert tags.tags.count("iframe") == 1
    assert len(re.findall("plotly-graph-div", text)) >= 6
    for words in (
        "joint_hardening[joint_3]",
        "held-out gain",
        "delta EBIC",
        "nearest alternative",
        "SHA-256",
        "adjusted p",
        "urad/(kN m)^3",
        "were not tested",
        "effects are not observable with these data",
    ):
        assert words in text, words
    inner = Page()
    inner.feed(tags.frames[0])
    assert inner.loads == []


@pytest.mark.parametrize("which", ["found", "nothing"])
def test_every_figure_and_table_says_what_to_look_for(which: str) -> None:
    names = [s.title for s in sections(which)]
    assert names[0] == "Verdict"
    assert names[-1] == "How this was computed"
    for section in sections(which)[:-1]:
        assert section.blocks
        for block in section.blocks:
            if isinstance(block, Figure | ReportTable | SceneView):
                assert len(block.caption) > 60, block
                assert block.caption.rstrip().endswith("."), block.caption


def test_nothing_found_is_told_as_bounds() -> None:
    text = " ".join(row[0] + " " + row[1] for row in excluded_table(nothing()).rows)
    assert "arcmin" in text
    assert re.search(r"joint_backlash .*joint_2 [\d.]+ arcmin", text)
    everything = " ".join(str(b) for s in sections("nothing") for b in s.blocks if not isinstance(b, SceneView))
    assert "no fault" not in everything.lower()
    rows = cause_table(nothing()).rows
    assert len(rows) == 3, "the strongest of what is excluded"
    assert all(row[-1].startswith(Status.EXCLUDED.value) for row in rows)


def test_every_cause_is_somewhere() -> None:
    diagnosis = found()
    hidden = [x.name for x in diagnosis.table if x.status is Status.INVISIBLE]
    told = {(kind, place) for kind, places, why in unseen_table(diagnosis).rows for place in places.split(", ") if why}
    for name in hidden:
        kind, _, where = name.partition("[")
        assert (kind, where.removesuffix("]") or "-") in told
    bounds = {x.name: limit_words(x) for x in diagnosis.table if x.status is Status.EXCLUDED}
    assert all(bounds.values())
    assert all(not re.search(r"e-\d\d (um|urad|mm|arcmin)", b) for b in bounds.values()), "a bound that is rounding"


def test_the_wrong_row_is_listed_by_its_line() -> None:
    rows = outlier_table(found()).rows
    assert str(int(found().readings.line[7])) in [row[0] for row in rows]
    assert len(rows) == len(found().outliers)


def test_the_budget_is_the_leave_one_out_formula() -> None:
    """Closed form per pose, (I - H_pp)^-1 r_p, against the fits without each pose."""
    diagnosis, case = found(), found().case
    i = next(i for i, c in enumerate(case.causes) if c.name == "joint_hardening[joint_3]")
    A = np.concatenate([case.A, case.B[i]], axis=1)
    H = A @ np.linalg.inv(A.T @ A) @ A.T
    r = case.residuals - H @ case.residuals
    out = np.empty_like(r)
    for pose in np.unique(case.pose):
        at = np.flatnonzero(case.pose == pose)
        out[at] = np.linalg.solve(np.eye(len(at)) - H[np.ix_(at, at)], r[at])
    tamed = diagnosis.baseline.residuals.ravel() - case.noise.colour(case.residuals)
    on, held, _ = linear_errors(case, [i], diagnosis.baseline.residuals)
    assert on == pytest.approx(float(np.sqrt(np.mean((case.noise.colour(r) + tamed) ** 2))), rel=1e-6)
    assert held == pytest.approx(float(np.sqrt(np.mean((case.noise.colour(out) + tamed) ** 2))), rel=1e-6)
    assert held == pytest.approx(diagnosis.rms.heldout_extended, rel=0.02)


def test_the_budget_goes_from_the_nominal_model_to_the_noise() -> None:
    steps, e = error_budget(found()), found().rms
    assert [s.label for s in steps] == ["nominal", "identified", "+ joint_hardening[joint_3]", "noise"]
    assert [s.heldout for s in steps] == [e.nominal, e.heldout_identified, e.heldout_extended, e.noise]
    assert steps[1].heldout > 1.2 * steps[2].heldout


def test_the_main_direction_holds_most_of_the_residuals() -> None:
    direction, along, _ = main_direction(found())
    before = found().residuals()[0]
    assert np.linalg.norm(direction) == pytest.approx(1.0)
    rng = np.random.default_rng(0)
    for other in rng.normal(size=(50, 3)):
        assert np.square(before @ (other / np.linalg.norm(other))).sum() <= np.square(along).sum() * (1 + 1e-12)


def test_arrows_start_at_the_markers_and_are_the_residuals() -> None:
    diagnosis = found()
    before, after = diagnosis.residuals()
    scene, factor = residual_scene(diagnosis.experiment, diagnosis.readings, diagnosis.kept, before, after)
    transforms = scene.placed
    model = diagnosis.experiment.model()
    markers = list(zip(model.marker_names, model.markers, strict=True))
    loops = [e for e in model.effects if e.stage == 1]
    rigid = make_model(model.facts, loops, [], model.tip, markers, model.gravity)
    positions = rigid.positions(diagnosis.readings.poses)
    longest = 0.0
    shown = [path for path in transforms if path.endswith("/before/head")]
    names = [label.partition(":")[0] for _, label in scene.steps]
    rows = [diagnosis.readings.pose[m] in names for m in diagnosis.kept]
    assert len(shown) == sum(rows)
    assert len(names) == 24
    for path in shown:
        row = int(path.split("row_")[1].split("/")[0])
        at = diagnosis.kept[row]
        start = positions[diagnosis.readings.plus[at], diagnosis.readings.marker[at]]
        for name, residuals in (("before", before), ("after", after)):
            head = transforms[path.replace("before", name)][:3, 3]
            assert np.allclose(head, start + factor * residuals[row], atol=1e-9)
        longest = max(longest, factor * float(np.linalg.norm(before[row])))
    assert longest == pytest.approx(0.4)
    assert scene.first == 1
    worst = diagnosis.kept[int(np.argmax(np.linalg.norm(before, axis=1)))]
    assert scene.steps[0][1].startswith(diagnosis.readings.pose[worst] + ":")


def test_names_of_users_are_escaped(page: Path, tmp_path: Path) -> None:
    diagnosis = found()
    markers = tuple(replace(m, name=EVIL) for m in diagnosis.experiment.markers)
    states = diagnosis.readings.states
    states = replace(states, pose=tuple(EVIL for _ in states.pose))
    evil = replace(
        diagnosis,
        leftovers=(Leftover(Law("link", EVIL, ("order",)), 1e-9, 20.0),),
        places=tuple(LikelyPlace(Law("link", EVIL, ("order",)), 0.5) for _ in range(2)),
        method=replace(diagnosis.method, unidentifiable=(EVIL,)),
        experiment=replace(diagnosis.experiment, markers=markers),
        readings=replace(diagnosis.readings, states=states),
        findings=tuple(replace(f, check=EVIL, physics=EVIL) for f in diagnosis.findings),
    )
    spoilt = write_report(tmp_path / "b.html", "Diagnosis", diagnosis_sections(evil, [campaign().path]))
    assert parse(spoilt).tags.count("script") == parse(page).tags.count("script")
    assert "&lt;script&gt;alert" in spoilt.read_text()
    (frame,) = parse(spoilt).frames
    assert EVIL not in frame

"""No verb obeys a fit that another verb calls wrong, and each says why."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.cli.show import Shown, make_scene
from qsframework.errors import InputError
from qsframework.experiment import Experiment, Readings
from qsframework.experiment.description import robot_hash
from qsframework.experiment.readings_file import read_readings
from qsframework.experiment.readings_table import write_readings
from qsframework.fits import FitRecord, identify, read_fit, validate, write_fit
from qsframework.fits.estimate import EstimateState
from qsframework.fits.soundness import check_fit
from qsframework.report.words.fit import fit_verdict, verdict_words
from qsframework.uses.compensate import compensate
from qsframework.uses.robot_from_fit import with_fit
from qsframework.uses.targets import read_targets
from tests.identify.records import assert_same, with_values

TARGETS = "target,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,fx_N,fy_N,fz_N\na,10,20,-10,5,60,0,0,0,-1500\n"
ALTHOUGH = "the fit is used although "
TURNED = ["dx_mm", "dy_mm", "dz_mm"]


@pytest.fixture(scope="module")
def fit_file(r2000ic: Experiment, real: Readings, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_fit(identify(r2000ic, real), tmp_path_factory.mktemp("sound") / "fit.json")


@pytest.fixture(scope="module")
def fit(fit_file: Path) -> FitRecord:
    return read_fit(fit_file)


def of(r2000ic: Experiment, fit: FitRecord) -> tuple[str, ...]:
    """Why a fit is not to be used; none where it may be."""
    notes = check_fit(fit, r2000ic.robot, r2000ic, anyway=True)
    return tuple(note.removeprefix(ALTHOUGH) for note in notes if note.startswith(ALTHOUGH))


def unread(fit: FitRecord) -> FitRecord:
    """The same without its readings: only its own numbers are held against one another."""
    return replace(fit, account=replace(fit.account, files=(), simulated=True))


def test_a_fit_is_the_same_from_its_file(r2000ic: Experiment, real: Readings, fit: FitRecord) -> None:
    own = identify(r2000ic, real)
    assert_same(own, fit)
    assert not of(r2000ic, fit)
    assert check_fit(fit, r2000ic.robot, r2000ic) == ()


def negative(f: FitRecord) -> FitRecord:
    return with_values(f, {e.name: -e.value for e in f.estimates})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (negative, "rad/(N m), and no arm has it below 0"),
        (lambda f: replace(f, covariance=-f.covariance), "its covariance is none"),
        (lambda f: replace(f, total_covariance=-f.covariance), "its covariance with the load's is none"),
        (lambda f: replace(f, model_values={**f.model_values, f.names[1]: 1e-9}), "estimates and 1e-09 in the model"),
        (lambda f: replace(f, held_out_nominal=1e-4, held_out_error=1e-4), "is not below that of the values before"),
        (lambda f: replace(f, account=replace(f.account, description=dict.fromkeys(f.account.description, ""))),
         "the geometry and masses are described otherwise now"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_refused_and_said_where_it_is_used_anyway(
    r2000ic: Experiment, fit: FitRecord, change: Callable[[FitRecord], FitRecord], words: str, tmp_path: Path
) -> None:
    bad = change(fit)
    found = of(r2000ic, bad)
    assert any(words in one for one in found)
    (tmp_path / "t.csv").write_text(TARGETS)
    targets = read_targets(tmp_path / "t.csv", r2000ic)
    with pytest.raises(InputError) as error:
        compensate(r2000ic, bad, targets)
    assert len(error.value.problems) == len(found)
    assert error.value.problems[-1].argument == ("anyway", "")
    assert words in str(error.value)
    if "none" not in words:
        result = compensate(r2000ic, bad, targets, anyway=True)
        assert any(words in note and note.startswith("the fit is used although") for note in result.notes)


def test_one_small_entry_of_a_covariance_is_seen(r2000ic: Experiment, fit: FitRecord) -> None:
    """Parameters are of many sizes: a negative variance of a stiff joint beside one of a millimetre."""
    sizes = np.diag([1e-18, *np.ones(len(fit.names) - 1)])
    sizes[0, 0] = -1e-18
    assert any("a variance would be below zero" in one for one in of(r2000ic, replace(fit, covariance=sizes)))
    impossible = np.outer(np.diag(fit.covariance), np.diag(fit.covariance)) ** 0.5 * 1.5
    np.fill_diagonal(impossible, np.diag(fit.covariance))
    assert any("a variance would be below zero" in one for one in of(r2000ic, replace(fit, covariance=impossible)))


def test_a_compliance_below_zero_by_its_sd_is_not_refused(r2000ic: Experiment, fit: FitRecord) -> None:
    """The readings do not tell it from zero; nobody calls such a fit wrong."""
    near = with_values(unread(fit), {fit.names[0]: -fit.estimates[0].sd})
    assert not of(r2000ic, near)
    with pytest.raises(InputError, match="beyond its bounds"):
        with_fit(r2000ic.robot, near, anyway=True)


def test_nominal_values_that_were_right_already_make_no_fit_wrong(r2000ic: Experiment, fit: FitRecord) -> None:
    """Readings at their noise with either; only where the noise is not known is the fit worth nothing."""
    right = replace(unread(fit), held_out_nominal=1e-4, held_out_error=1.01e-4)
    equal = replace(right, sigma_source="stated", chi2=float(fit.dof))
    assert equal.agrees
    assert not of(r2000ic, equal)
    assert of(r2000ic, replace(equal, chi2=4.0 * fit.dof))
    assert of(r2000ic, replace(equal, sigma_source="estimated"))


def test_a_fit_says_of_which_arm_it_is(r2000ic: Experiment, fit_file: Path, tmp_path: Path) -> None:
    content = json.loads(fit_file.read_text())
    assert content["account"]["description"]["geometry and masses"] == robot_hash(r2000ic.robot.facts)
    del content["account"]
    content["held_out_error_m"] = "small"
    (tmp_path / "old.json").write_text(json.dumps(content, indent=2))
    with pytest.raises(InputError, match="key 'account' is missing") as caught:
        read_fit(tmp_path / "old.json")
    assert any("held_out_error_m must be a finite number" in str(p) for p in caught.value.problems)


def test_the_hash_is_of_what_a_fit_rests_on(r2000ic: Experiment) -> None:
    facts = r2000ic.robot.facts
    assert robot_hash(replace(facts, limits=None, payload=1.0)) == robot_hash(facts)
    for changed in (
        replace(facts, masses=facts.masses + 1e-3),
        replace(facts, placements=facts.placements + 1e-6),
        replace(facts, gravity=-facts.gravity),
    ):
        assert robot_hash(changed) != robot_hash(facts)


def test_lack_of_fit_widens_what_is_promised(r2000ic: Experiment, fit: FitRecord, tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(TARGETS)
    targets = read_targets(tmp_path / "t.csv", r2000ic)
    dof = fit.dof
    clean = replace(unread(fit), sigma_source="stated", chi2=float(dof), total_covariance=2.0 * fit.covariance)
    lacking = replace(clean, chi2=4.0 * dof)
    assert (clean.widening, lacking.widening) == (1.0, 4.0)
    assert replace(lacking, sigma_source="estimated").widening == 1.0
    one, other = (compensate(r2000ic, f, targets) for f in (clean, lacking))
    np.testing.assert_allclose(other.noise_covariance, 4.0 * one.noise_covariance)
    load = one.covariance - one.noise_covariance
    lack = np.zeros((6, 6))
    lack[:3, :3] = lacking.lack**2 / 3.0 * np.eye(3)
    assert lacking.lack == pytest.approx(np.sqrt(0.75) * fit.held_out_error)
    np.testing.assert_allclose(other.covariance, 4.0 * one.noise_covariance + load + lack, rtol=1e-9)
    assert any("widened by that factor" in note for note in other.notes)


def run(arguments: Sequence[object]) -> tuple[int, str]:
    done = CliRunner().invoke(app, [str(a) for a in arguments])
    return done.exit_code, done.output + str(done.exception or "")


@pytest.fixture(scope="module")
def turned_fit(r2000ic: Experiment, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fit of the real readings with their sign turned, all files in its folder."""
    folder = tmp_path_factory.mktemp("turned")
    lines = [line for line in r2000ic.data[0].read_text().splitlines() if not line.startswith("#")]
    at = [lines[0].split(",").index(name) for name in TURNED]
    rows = [line.split(",") for line in lines[1:]]
    rows = [[str(-float(c)) if i in at else c for i, c in enumerate(row)] for row in rows]
    (folder / "readings.csv").write_text("\n".join([lines[0], *(",".join(row) for row in rows)]) + "\n")
    (folder / "targets.csv").write_text(TARGETS)
    code, said = run(["identify", r2000ic.path, folder / "readings.csv", "--json", folder / "fit.json"])
    assert code == 0, said
    assert "Physically impossible: " in said
    return folder


def test_commands_refuse_and_show_labels(r2000ic: Experiment, turned_fit: Path) -> None:
    fit, out = turned_fit / "fit.json", turned_fit / "out"
    identifies = ["identify", r2000ic.path, turned_fit / "readings.csv", "--json", turned_fit / "again.json"]
    for asked in (
        ["compensate", r2000ic.path, fit, turned_fit / "targets.csv", "-o", out],
        ["kinematics", r2000ic.path, fit, "--urdf", out],
        ["certificate", r2000ic.path, fit, "-o", out],
        [*identifies, "--nominal", out],
    ):
        code, said = run(asked)
        assert code != 0, asked
        assert "and no arm has it below 0" in said, asked
        assert not out.exists(), asked
    assert (turned_fit / "again.json").is_file(), "the fit itself is written"
    code, said = run(["compensate", r2000ic.path, fit, turned_fit / "targets.csv", "-o", out, "--anyway"])
    assert code == 0, said
    assert "note: the fit is used although joint_compliance[joint_" in said
    with pytest.raises(InputError, match="and no arm has it below 0"):
        make_scene(Shown(subject=str(r2000ic.path), fit=fit))
    scene = make_scene(Shown(subject=str(r2000ic.path), fit=fit, anyway=True))
    assert any(note.startswith(ALTHOUGH) for note in scene.notes)


def test_identify_says_what_is_impossible_before_that_it_agrees(r2000ic: Experiment, real: Readings) -> None:
    wide = replace(real, stated=real.stated, value=-real.value)
    fit = replace(identify(r2000ic, wide), sigma_source="stated", chi2=1.0, dof=1)
    words = verdict_words(fit)
    assert words.startswith("Physically impossible: joint_compliance[joint_")
    assert "though the residuals agree with the stated noise" in words
    assert fit_verdict(fit, real.poses).said.startswith("displacement sign (below)")


def first(f: FitRecord, **change: object) -> FitRecord:
    """With something else said of the first estimate."""
    return replace(f, estimates=(replace(f.estimates[0], **change), *f.estimates[1:]))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda f: first(f, sd=0.1 * f.estimates[0].sd), "in it, and its readings give"),
        (lambda f: first(f, state=EstimateState.BEYOND_BOUND), "is said to be 'beyond bound' in it"),
        (lambda f: replace(f, account=replace(f.account, kinds=("position",))), "says kinds: position"),
        (lambda f: replace(f, account=replace(f.account, frames=("day",))), "says frames: day"),
    ],
)
def test_what_a_fit_says_of_itself_is_what_its_readings_say(
    r2000ic: Experiment, real: Readings, fit: FitRecord, change: Callable[[FitRecord], FitRecord], words: str
) -> None:
    """Its sds, what each estimate is, and of which readings it speaks."""
    assert not list(check_fit(fit, r2000ic.robot, r2000ic, real))
    with pytest.raises(InputError, match="not to be trusted") as error:
        check_fit(change(fit), r2000ic.robot, r2000ic, real)
    assert words in str(error.value)


def altered(source: Path, folder: Path) -> dict[str, Path]:
    """The readings of a file in others: without comments, half of them, under other names, doubled with new ones."""
    lines = [line for line in source.read_text().splitlines() if not line.startswith("#")]
    head, rows = lines[0], lines[1:]
    new = [
        ",".join([f"new{i}", *row.split(",")[1:-1], f"{float(row.split(',')[-1]) + 0.05:.3f}"])
        for i, row in enumerate(rows)
    ]
    texts = {
        "bare": rows,
        "half": rows[::2],
        "renamed": [f"x{row}" for row in rows],
        "mixed": [*rows, *new],
        "new": new,
    }
    out: dict[str, Path] = {}
    for name, body in texts.items():
        out[name] = folder / f"{name}.csv"
        out[name].write_text("\n".join([head, *body]) + "\n")
    return out


def test_readings_of_the_fit_are_not_held_out_in_whatever_file(
    r2000ic: Experiment, real: Readings, fit: FitRecord, tmp_path: Path
) -> None:
    assert real.source is not None
    seen = {
        name: validate(r2000ic, read_readings(path, r2000ic), fit).seen
        for name, path in altered(real.source, tmp_path).items()
    }
    assert seen == {"bare": True, "half": True, "renamed": True, "mixed": True, "new": False}


def test_readings_that_were_simulated_are_known_again_in_a_file(
    r2000ic: Experiment, real: Readings, tmp_path: Path
) -> None:
    """A fit made in memory names no file; what it was made of is known by itself."""
    blind = replace(real, sources=())
    made = identify(r2000ic, blind)
    assert made.account.simulated
    write_readings(tmp_path / "r.csv", real, r2000ic)
    written = read_readings(tmp_path / "r.csv", r2000ic)
    assert validate(r2000ic, written, made).seen
    assert not validate(r2000ic, real.with_values(real.value + 5e-5), made).seen
    with pytest.raises(InputError, match="its readings give"):
        check_fit(first(made, sd=1e-12), r2000ic.robot, r2000ic, written)

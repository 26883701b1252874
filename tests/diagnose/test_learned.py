"""Laws that nobody has written are learned, from readings that another code has made, and written as an effect."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.diagnoses import Diagnosis, diagnose, follow_up
from qsframework.diagnoses.learn import curve, dots
from qsframework.elastostatics import beyond, range_notes
from qsframework.errors import InputError
from qsframework.estimation import FitOptions
from qsframework.experiment import Readings, example, load_experiment, make_rows, read_readings
from qsframework.fits import identify
from qsframework.hypotheses.catalogue.law import Law
from qsframework.plugin import Array, Context, Effect, build_effects, check_effect, find
from qsframework.plugin.entry import effect_entry
from qsframework.report.diagnosis_section import diagnosis_sections
from qsframework.report.extended import write_extended
from qsframework.report.page import write_report
from qsframework.report.result_json import diagnosis_json
from qsframework.report.words.diagnosis import diagnosis_words
from tests.diagnose.cases import campaign, poses

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from independent import Campaign, Setting, noisy, write_campaign
from independent_arm import HEAVY, Hidden, Rest

FORTY = Campaign(Setting(HEAVY, poses=40))


def tanh(torque: Array) -> Array:
    return np.asarray(4.5e-4 * np.tanh(torque / 1500.0), dtype=np.float64)


def saturating(still: Rest) -> Array:
    """The third gear gives 0.45 mrad more, but hardly more beyond 1500 N m."""
    return np.eye(6)[2] * tanh(still.torque[:, [2]])


def by_another_angle(still: Rest) -> Array:
    """The fifth gear gives more at some angles of the fourth joint."""
    return np.eye(6)[4] * 2.5e-7 * still.torque[:, [4]] * np.cos(2.0 * still.angles[:, [3]] + 0.4)


TURNED = {"angle_from": -1.0, "angle_to": 1.5}
LAWS = {"j3/torque": saturating, "j5/j4": by_another_angle}


@pytest.fixture(scope="module", params=LAWS)
def found(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Diagnosis, str]:
    folder = tmp_path_factory.mktemp("learned")
    hidden = Hidden(gears=(LAWS[request.param],))
    experiment = load_experiment(write_campaign(FORTY, noisy(FORTY, FORTY.clean(hidden)), folder))
    return diagnose(experiment, read_readings(experiment.data, experiment), repeats=1), request.param


def test_an_unknown_law_is_learned_with_its_place_and_variable(found: tuple[Diagnosis, str]) -> None:
    d, name = found
    assert d.learned is not None, diagnosis_words(d)
    assert d.learned.name == f"learned[{name}]"
    assert d.learned.holds
    assert d.learned.heldout < (2.0 if "torque" in name else 1.3) * 3e-5, "a corner is rounded off"
    assert d.learned.heldout < 0.8 * d.rms.heldout_extended
    assert f"As learned[{name}] its law was learned" in diagnosis_words(d)
    told = diagnosis_json(d)["learned"]
    assert (told["id"], told["written"]) == (f"learned[{name}]", True)
    assert d.verdict in ("unexplained", "partly_explained"), "a law that predicts names no cause"


def knee(size: float) -> Hidden:
    """The third gear gives more beyond 1000 N m on one side: a backlash with a sign that none has."""

    def law(still: Rest) -> Array:
        return np.eye(6)[2] * size * 1e-7 * np.maximum(still.torque[:, [2]] - 1000.0, 0.0)

    return Hidden(gears=(law,))


def test_a_law_that_looks_like_one_of_the_library_says_which(tmp_path: Path) -> None:
    path = write_campaign(FORTY, noisy(FORTY, FORTY.clean(knee(FORTY.sized(knee, 20.0, 0.01, 20.0)))), tmp_path)
    d = diagnose(load_experiment(path), read_readings(load_experiment(path).data, load_experiment(path)), repeats=1)
    assert d.learned is not None
    first = d.learned.alike[0]
    assert (first.name, first.here, first.turned) == ("joint_backlash[j3]", True, True)
    assert first.share > 0.85
    assert "looks most like joint_backlash[j3]: with a sign that it cannot have" in diagnosis_words(d)
    assert diagnosis_json(d)["learned"]["looks_like"][0]["id"] == "joint_backlash[j3]"


def test_a_law_that_is_like_none_at_its_place_says_so(found: tuple[Diagnosis, str]) -> None:
    other, name = found
    assert other.learned is not None
    assert not [a for a in other.learned.alike if a.share > 0.9], name
    nearest = (
        "It looks most like joint_hardening[j3]" if "torque" in name else "No known effect explains even half of it"
    )
    assert nearest in diagnosis_words(other)


def test_the_extended_robot_predicts_poses_that_nobody_has_measured(
    found: tuple[Diagnosis, str], tmp_path: Path
) -> None:
    """At 60 fresh poses without noise, by the other code: most of what the hidden law does is gone."""
    d, name = found
    write_extended(d, tmp_path / "out")
    extended = load_experiment(tmp_path / "out" / "experiment.yaml")
    assert f"learned[{name}]" in {e.name for e in extended.model().effects}
    fresh = Campaign(Setting(HEAVY, poses=60))
    path = write_campaign(fresh, fresh.clean(Hidden(gears=(LAWS[name],)), FORTY.built), tmp_path / "fresh")
    truth = read_readings(load_experiment(path).data, load_experiment(path))

    def error(model, x) -> float:
        poses = truth.poses.take(truth.plus)
        said = model.predict(poses, x)[np.arange(len(truth)), truth.marker]
        return float(np.sqrt(np.mean(np.square(said - truth.value))))

    before, after = error(d.baseline.model, d.baseline.x), error(extended.model(), extended.model().nominal)
    assert after < 0.5 * before


def test_the_curve_and_the_report_show_the_law(found: tuple[Diagnosis, str], tmp_path: Path) -> None:
    d, name = found
    assert d.learned is not None
    seen = curve(d.learned, d.experiment.robot.facts)
    assert seen is not None
    assert np.all(seen.sd > 0.0)
    if "torque" not in name:
        rest = seen.motion[:, 0] - 2.5e-7 * seen.torque * np.cos(2.0 * seen.x + 0.4)
        assert np.abs(rest - rest.mean()).max() < 0.2 * 5e-7 * seen.torque, "the spring takes what is constant"
    assert not d.findings, "a name that the law is far ahead of does not stand"
    page = write_report(tmp_path / "r.html", "Diagnosis", diagnosis_sections(d, [])).read_text()
    assert f"Learned: {d.learned.name}".replace("/", "\\u002f") in page or f"Learned: {d.learned.name}" in page


def test_nothing_is_learned_where_nothing_acts(tmp_path: Path) -> None:
    """Nor named: tests/proof/test_independent.py."""
    for seed in range(2):
        campaign = Campaign(Setting(HEAVY, poses=16, seed=seed))
        path = write_campaign(campaign, noisy(campaign, campaign.clean(Hidden())), tmp_path / str(seed))
        experiment = load_experiment(path)
        assert diagnose(experiment, read_readings(experiment.data, experiment), repeats=1).learned is None


def test_the_curve_of_the_example_is_what_was_hidden() -> None:
    """The law that `benchmarks/make_unknown_example.py` hides, from the readings that it wrote."""
    from make_unknown_example import PHASE

    experiment = load_experiment(example("unknown_effect") / "experiment.yaml")
    d = diagnose(experiment, read_readings(experiment.data, experiment))
    assert not d.findings
    assert d.learned is not None
    assert (d.learned.name, d.learned.holds) == ("learned[j5/j4]", True)
    seen = curve(d.learned, experiment.robot.facts)
    assert seen is not None
    hidden = np.cos(2.0 * seen.x + PHASE)
    hidden -= hidden.mean()
    height = float(hidden @ seen.motion[:, 0] / (hidden @ hidden)) / seen.torque
    assert abs(height - 0.267e-6) < 0.05e-6
    assert np.all(np.abs(seen.motion[:, 0] - seen.torque * 0.267e-6 * hidden) < 3.5 * seen.sd)
    rows = make_rows(d.readings)
    angle, said = dots(d.learned, rows.take(np.isin(rows.keep, d.kept)), seen)
    truth = seen.torque * 0.267e-6 * (np.cos(2.0 * angle + PHASE) - np.cos(2.0 * seen.x + PHASE).mean())
    told = np.isfinite(said)
    assert told.mean() > 0.5
    assert np.nanmedian(np.abs(said - truth)) < 0.3 * np.nanstd(truth[told])
    assert np.corrcoef(said[told], truth[told])[0, 1] > 0.9


def test_the_shipped_second_day_settles_place_and_variable() -> None:
    """Eight poses leave open what the fifth drive follows; the visits that were asked for tell it."""
    folder = example("unknown_effect")
    experiment = load_experiment(folder / "experiment.yaml")
    first = diagnose(experiment, read_readings([folder / "first_day.csv"], experiment))
    asked = follow_up(first, 8)
    assert asked.variable_before < 0.5 < 0.9 < asked.variable_after
    second = read_readings([folder / "second_day.csv"], experiment)
    wanted = np.round(np.rad2deg(np.unique(asked.plan.poses.pendant, axis=0)), 3)
    measured = np.round(np.rad2deg(np.unique(second.poses.pendant, axis=0)), 3)
    assert wanted == pytest.approx(measured, abs=6e-3), "these visits were measured, to hundredths of a degree"
    both = diagnose(experiment, read_readings([folder / "first_day.csv", folder / "second_day.csv"], experiment))
    assert (both.places[0].law.part, both.places[0].law.place, both.places[0].law.by) == ("drive", "j5", ("j4",))
    assert both.places[0].share > 0.9
    assert both.learned is not None
    assert (both.learned.name, both.learned.holds) == ("learned[j5/j4]", True)


@pytest.mark.parametrize(
    "settings",
    [
        {"at": "joint_3", "by": "torque", "scale": 900.0, "lowest": -500.0, "highest": 900.0},
        {"at": "joint_3", "by": "joint_2+joint_3", "signs": "+-", "scale": 900.0, "angle_from": -1.0, "angle_to": 1.5},
        {"at": "joint_3", "by": "order", "scale": 900.0, "first": 0.0, "last": 1.0},
        {"at": "joint_3", "by": "loaded*order", "scale": 900.0, "first": 0.0, "last": 1.0},
        {"at": "joint_3", "by": "torque*joint_3", "scale": 900.0, "lowest": -500.0, "highest": 900.0, **TURNED},
        {"at": "joint_3", "by": "joint_3*joint_4", "scale": 900.0, "other_from": -1.0, "other_to": 1.5, **TURNED},
        {"at": "joint_3", "by": "others", "scale": 900.0},
        {"at": "joint_3", "by": "torque*others", "scale": 900.0, "lowest": -500.0, "highest": 900.0},
        {"at": "joint_3", "by": "came", "scale": 900.0},
        {"at": "base_link", "by": "loaded*came", "part": "link", "scale": 900.0},
        {"at": "joint_3", "by": "loaded*joint_3", "waves": 3, "scale": 900.0, **TURNED},
        {"at": "link_3", "by": "torque*others", "part": "link", "moves": "ry", "scale": 900.0},
        {"at": "link_3", "by": "others", "part": "link", "moves": "rx", "scale": 900.0},
        {"at": "link_3", "by": "others", "part": "link", "scale": 900.0},
        {"at": "link_3", "by": "attitude", "part": "link", "scale": 900.0},
    ],
)
def test_a_learned_law_is_an_effect_like_others(settings: dict[str, object]) -> None:
    kept(find("learned")(**settings))


def kept(effect: Effect) -> None:
    """It keeps the protocol, and a file that it is written to reads it back."""
    facts = campaign().robot.facts
    check_effect(effect, facts)
    assert build_effects(effect_entry(effect), facts, campaign().model().marker_names) == (effect,)


@pytest.mark.parametrize(
    ("kind", "settings"),
    [
        ("learned_bearing", {"at": "joint_4", "by": "torque", "scale": 900.0, "lowest": -500.0, "highest": 900.0}),
        ("learned_bearing", {"at": "joint_4", "by": "attitude", "scale": 900.0}),
        ("learned_shift", {"at": "base_link", "by": "moment", "scale": 900.0}),
        ("learned_shift", {"at": "base_link", "by": "moment", "moves": "z", "scale": 900.0}),
        ("learned_bearing", {"at": "joint_4", "by": "order", "moves": "rz", "scale": 900.0, "first": 0.0, "last": 1.0}),
        ("learned_offset", {"at": "m1", "by": "loaded*attitude"}),
        ("learned_offset", {"at": "m1", "by": "force", "scale": 900.0}),
        ("learned_offset", {"at": "all", "by": "always*joint_2", **TURNED}),
        ("learned_load", {"at": "tool", "by": "force", "scale": 900.0, "lowest": 100.0, "highest": 900.0}),
        ("learned_load", {"at": "tool", "by": "direction", "scale": 900.0}),
        ("learned_load_point", {"at": "tool", "by": "attitude"}),
        ("learned_load_point", {"at": "tool", "by": "order", "first": 0.0, "last": 1.0}),
        ("learned_shift", {"at": "link_2", "by": "torque", "scale": 900.0, "lowest": -500.0, "highest": 900.0}),
        ("learned_shift", {"at": "link_2", "by": "moment", "moves": "z", "scale": 900.0}),
        ("learned_bearing", {"at": "joint_4", "by": "came", "scale": 900.0}),
        ("learned_offset", {"at": "m1", "by": "loaded*joint_2", **TURNED}),
    ],
)
def test_laws_of_bearings_ends_readings_and_loads_are_effects_too(kind: str, settings: dict[str, object]) -> None:
    kept(find(kind)(**settings))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"at": "elbow"}, "elbow"),
        ({"by": "wind"}, "wind"),
        ({"lowest": 5.0, "highest": 5.0}, "lowest must lie below highest"),
        ({"by": "joint_2", "angle_from": 1.0, "angle_to": 0.5}, "angle_from must lie below angle_to"),
        ({"by": "order"}, "first must lie below last"),
        ({"by": "time"}, "first must lie below last"),
        ({"scale": 0.0}, "scale must be above 0"),
        ({"part": "tool"}, "unknown part"),
        ({"knots": [-1.0, 0.0, -0.5, 1.0]}, "knots out of order; found 0, then -0.5"),
        ({"knots": [-1.0, 1.0]}, "too few knots; found 2; allowed: 3 or more"),
        ({"knots": "many"}, "knots must be numbers"),
        ({"knots": [-1.0, float("nan"), 1.0]}, "knots must be numbers"),
        ({"prior": -1.0}, "prior must not be negative"),
        ({"by": "joint_2+joint_3", "signs": "+", "angle_from": 0.0, "angle_to": 1.0}, "wrong signs"),
        ({"by": "joint_2*joint_3*joint_4"}, "too many angles; found 3"),
        ({"by": "joint_2*joint_3", "angle_to": 1.0}, "other_from must lie below other_to"),
        ({"by": "moment"}, "no such factor of a drive; found moment; allowed: others"),
        ({"moves": "rx"}, "no such motion of this place; found 'rx'; allowed: none"),
        ({"by": "joint_3", "angle_to": 1.0, "waves": 9}, "waves; found 9; allowed: 1 to 6"),
    ],
)
def test_what_a_file_of_a_learned_law_gets_wrong_is_said(wrong: dict[str, object], said: str) -> None:
    right = {"at": "joint_3", "by": "torque", "scale": 900.0, "lowest": -500.0, "highest": 900.0}
    with pytest.raises(InputError, match=said):
        find("learned")(**(right | wrong)).validate(campaign().robot.facts)


def test_values_of_another_law_are_refused(found: tuple[Diagnosis, str], tmp_path: Path) -> None:
    """A file with a weight too many, or too few, and an effect at a joint that this robot lacks."""
    d, name = found
    write_extended(d, tmp_path / "out")
    robot, nominal = (tmp_path / "out" / "robot" / f for f in ("robot.yaml", "nominal.yaml"))
    effect = f"learned[{name}]"
    text = nominal.read_text()
    last = max(int(line.partition(".w")[2].rstrip(":")) for line in text.splitlines() if line.startswith(effect))
    nominal.write_text(f"{text}{effect}.w{last + 1}:\n  value_rad: 1.0e-5\n")
    with pytest.raises(InputError, match=f"no effect has the parameter '{re.escape(effect)}.w{last + 1}'"):
        load_experiment(tmp_path / "out" / "experiment.yaml")
    entries = re.split(r"^(?=\S)", text, flags=re.MULTILINE)
    nominal.write_text("".join(e for e in entries if not e.startswith(f"{effect}.w{last}:")))
    with pytest.raises(InputError, match=f"a value is missing for {re.escape(effect)}.w{last}"):
        load_experiment(tmp_path / "out" / "experiment.yaml")
    nominal.write_text(text)
    robot.write_text(robot.read_text().replace(f"at: {name[:2]}", "at: j9"))
    with pytest.raises(InputError, match="has no joint 'j9'"):
        load_experiment(tmp_path / "out" / "experiment.yaml")


def test_a_new_fit_pulls_the_weights_by_the_prior_of_their_effect(found: tuple[Diagnosis, str], tmp_path: Path) -> None:
    """The extended campaign, identified again from the same readings, is the fit of the diagnosis; without readings
    that say more, weights stay where the prior holds them."""
    d, name = found
    assert d.learned is not None
    write_extended(d, tmp_path / "out")
    extended = load_experiment(tmp_path / "out" / "experiment.yaml")
    weights = [p for p in extended.model().parameters if p.name.startswith(f"learned[{name}]")]
    prior = np.sqrt(d.learned.shares[0]) * (d.learned.cause.prior or 0.0)
    assert [p.pull for p in weights] == pytest.approx([prior] * len(weights)), "several laws share the variance"
    assert {p.name for p in weights} <= set(extended.fit_names())
    fit = identify(extended, read_readings(extended.data, extended), options=FitOptions(bounds=False))
    assert {p.name for p in weights} <= set(fit.names)
    sd = {e.name: e.sd for e in fit.estimates}
    assert all(sd[p.name] < 1.01 * prior for p in weights), "no weight is freer than its prior"
    said = d.learned.fit.model.predict(d.readings.poses.take(d.readings.plus), d.learned.fit.x)
    again = fit.model.predict(d.readings.poses.take(d.readings.plus), fit.x)
    assert np.sqrt(np.mean(np.square(again - said))) < 0.5 * 3e-5, "the noise that was found was larger"
    few = identify(extended, some(read_readings(extended.data, extended), 5), options=FitOptions(bounds=False))
    assert all(e.sd < 1.01 * prior for e in few.estimates if e.name in {p.name for p in weights})
    advice = [note.partition(":")[0] for note in few.notes if note.startswith("learned")]
    assert advice, "so few poses hardly tell the weights"
    assert set(advice) <= {cause.name for cause in d.learned.causes}, "a law is told once, not weight by weight"
    assert len(advice) == len(set(advice))


def some(readings: Readings, poses: int) -> Readings:
    """The readings of the first few poses alone."""
    return replace(readings, use=readings.use & np.isin(readings.pose, readings.pose[: 3 * poses]))


def test_every_verb_says_where_a_law_is_asked_beyond_what_it_was_learned_from(
    found: tuple[Diagnosis, str], tmp_path: Path
) -> None:
    d, name = found
    write_extended(d, tmp_path / "out")
    experiment = load_experiment(tmp_path / "out" / "experiment.yaml")
    model, readings = experiment.model(), read_readings(experiment.data, experiment)
    assert not beyond(model, readings.poses), "nothing lies beyond the readings themselves"
    poses = readings.poses.take(readings.plus[:3])
    far = replace(poses, wrench=3.0 * poses.wrench, q=poses.q + 6.0 * np.eye(6)[3])
    outside = beyond(model, far)
    assert [b.effect for b in outside] == [f"learned[{name}]"]
    said = range_notes(model, far, ["one", "two", "three"])[0]
    assert f"learned[{name}] was learned between" in said
    assert "is held constant beyond" in said
    angles = readings.poses.pendant[0]
    pose = ",".join(f"{a:.3f}" for a in np.rad2deg(angles))
    made = CliRunner().invoke(
        app,
        ["stiffness", str(tmp_path / "out" / "robot"), f"--pose={pose}", "--load=0,0,-88000", "--point=0,0,500"],
    )
    assert ("was learned between" in made.output) == (name == "j3/torque"), made.output


def test_beyond_what_was_seen_it_stays_constant() -> None:
    effect = find("learned")(at="joint_3", by="torque", scale=900.0, lowest=-500.0, highest=900.0)
    facts = campaign().robot.facts
    x = np.linspace(1.0, 2.0, len(effect.parameters(facts)))
    context = Context(facts, poses(1, 4))
    ends = effect.extra(np.array([[900.0], [5000.0], [-500.0], [-9000.0]]), x, context).value[:, 0]
    assert ends[0] == ends[1]
    assert ends[2] == ends[3]
    assert replace(effect, highest=5000.0).extra(np.array([[5000.0]]), x, context).value[0, 0] != ends[1]
    assert Law("drive", "joint_3", ("torque",)).name == "joint_3/torque"
    assert Law("bearing", "joint_3", ("torque", "joint_2+joint_3")).name == "bearing joint_3/torque*joint_2+joint_3"

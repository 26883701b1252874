"""The extended robot as files: it loads, it predicts what the extended model predicts, nothing else is touched."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import yaml

from qsframework.diagnoses import Diagnosis
from qsframework.diagnoses.extend import Extension, of_arm, write_extension
from qsframework.errors import InputError
from qsframework.experiment import Experiment, load_experiment, make_rows, read_plan, read_readings, simulate
from qsframework.files import read_yaml
from qsframework.hypotheses.catalogue.causes import Cause, proposed, widened
from qsframework.plugin import Conditions, Effect, Poses, registry
from qsframework.report.extended import extension_of
from tests.diagnose.cases import quiet, reversed_sign

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
ROBOTS = {"m900ib": EXAMPLES / "m900ib" / "experiment.yaml", "r2000ic": EXAMPLES / "r2000ic" / "experiment.yaml"}


def poses_of(experiment: Experiment, count: int = 7) -> Poses:
    """Poses inside the limits, with loads and all conditions that an effect may ask for."""
    rng = np.random.default_rng(3)
    facts = experiment.robot.facts
    q = rng.uniform(-0.4, 0.4, (count, facts.n))
    if facts.n > 2:
        q[:, 2] = q[:, 1] * 0.2 - 0.6
    wrench = rng.normal(size=(count, 6)) * np.array([800.0, 800.0, 3000.0, 300.0, 300.0, 300.0])
    ramp = np.linspace(0.0, 3600.0, count)
    loaded = Conditions(time=ramp, temperature=293.0 + ramp / 600.0, approach=np.sign(rng.normal(size=count)))
    unloaded = Conditions(time=ramp - 60.0, temperature=292.0 + ramp / 900.0, approach=loaded.approach)
    return Poses(q, q, wrench, loaded, unloaded)


def cases() -> list[tuple[str, str]]:
    """Every robot with every kind of effect that the registry offers for it."""
    return [(robot, kind) for robot in ROBOTS for kind in dict.fromkeys(e.effect_name() for e in offered(robot))]


@cache
def loaded(robot: str) -> Experiment:
    return load_experiment(ROBOTS[robot])


def offered(robot: str) -> list[Effect]:
    model = loaded(robot).model()
    have = {e.name for e in model.effects}
    return [e for e in proposed(model) if e.name not in have]


def extension_with(robot: str, kind: str) -> Extension:
    """The model with one kind of effect at all its places, its parameters and those of the springs at odd values."""
    experiment = loaded(robot)
    model = experiment.model()
    causes = [Cause(e.name, (e,), e.parameters(model.facts), False) for e in offered(robot) if e.effect_name() == kind]
    wide = widened(model, causes)
    rng = np.random.default_rng(1)
    values = dict(zip(wide.names, wide.nominal.tolist(), strict=True))
    for p in (p for c in causes for p in c.parameters):
        values[p.name] += p.typical * float(rng.uniform(0.3, 0.7))
    for key in model.names:
        if key.startswith("joint_compliance"):
            values[key] *= float(rng.uniform(0.9, 1.1))
    fitted = tuple(dict.fromkeys([*experiment.fit_names(), *(n for c in causes for n in c.names)]))
    sds = {n: abs(values[n]) * 0.0123456789 for n in fitted}
    return Extension(
        experiment=experiment,
        model=wide,
        values=values,
        sds=sds,
        evidence={n: f"found: {n}" for n in fitted},
        fit=fitted,
    )


@pytest.mark.parametrize(("robot", "kind"), cases())
def test_every_effect_at_every_place_survives_its_files(robot: str, kind: str, tmp_path: Path) -> None:
    extension = extension_with(robot, kind)
    model = extension.model
    written = write_extension(extension, tmp_path / "out")
    assert all(path.is_file() for path in written)
    again = load_experiment(tmp_path / "out" / "experiment.yaml")
    x = np.array([extension.values[n] for n in model.names])
    poses = poses_of(extension.experiment)
    expected = model.predict(poses, x)
    assert np.abs(again.model().predict(poses) - expected).max() <= 1e-12 * np.abs(expected).max()
    assert np.abs(expected - model.predict(poses)).max() > 0.0, "the values changed nothing"
    assert set(again.fit_names()) == set(extension.fit)
    found = {p.name: p for p in again.model().parameters}
    for n in extension.fit:
        assert found[n].sd == pytest.approx(extension.sds[n], rel=1e-12)
        assert found[n].source == f"found: {n}"
    arm = {e.name for e in again.robot.effects}
    assert {e.name for e in model.effects if of_arm(e)} == arm


@pytest.mark.parametrize("robot", list(ROBOTS))
def test_every_effect_of_the_registry_is_tried(robot: str) -> None:
    tried = {kind for r, kind in cases() if r == robot}
    model = loaded(robot).model()
    have = {e.effect_name() for e in model.effects}
    placed = {k for k, kind in registry().items() if kind.places(model.facts, model.marker_names)}
    assert placed - have <= tried
    assert len(tried) >= 15


def test_the_load_and_the_instrument_are_of_the_campaign_and_masses_of_the_arm() -> None:
    model = loaded("m900ib").model()
    kinds = {e.effect_name(): of_arm(e) for e in proposed(model)}
    for name in (
        "load_scale",
        "load_direction",
        "load_point_offset",
        "tracker_scale",
        "tracker_frame",
        "marker_offset",
    ):
        assert not kinds[name], name
    for name in ("joint_backlash", "base_compliance", "link_mass", "joint_offset", "controller_coupling"):
        assert kinds[name], name


@pytest.fixture
def extension() -> Extension:
    return extension_with("r2000ic", "joint_hardening")


def test_the_rest_of_the_campaign_stays_and_the_readings_are_found(extension: Extension, tmp_path: Path) -> None:
    data = EXAMPLES / "r2000ic" / "readings.csv"
    write_extension(replace(extension, data=data), tmp_path / "a" / "out")
    again, first = load_experiment(tmp_path / "a" / "out" / "experiment.yaml"), extension.experiment
    assert [path.resolve() for path in again.data] == [data]
    assert len(read_readings(again.data, again).use) == len(read_readings(data, first).use)
    assert np.array_equal(again.load_point, first.load_point)
    assert [m.name for m in again.markers] == [m.name for m in first.markers]
    assert again.noise == first.noise
    assert again.robot.title == f"{first.robot.title}, extended"
    assert np.array_equal(again.robot.controller.matrix, first.robot.controller.matrix)


def test_the_extended_experiment_simulates(tmp_path: Path) -> None:
    extension = extension_with("m900ib", "load_scale")
    write_extension(extension, tmp_path / "out")
    again = load_experiment(tmp_path / "out" / "experiment.yaml")
    plan = tmp_path / "plan.csv"
    plan.write_text(
        "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,load,fx_N,fy_N,fz_N\n"
        "P1,0,10,-20,0,40,0,weight,0,0,-4000\nP2,30,-10,-40,20,-30,10,weight,0,0,-4000\n"
    )
    made = simulate(again, read_plan(plan, again), seed=4)
    x = np.array([extension.values[n] for n in extension.model.names])
    expected = make_rows(made.readings).predict(extension.model, x)
    assert np.abs(made.readings.value - expected).max() < 6 * 0.03e-3
    assert made.truth_by_name()["load_scale"] == extension.values["load_scale"] != 0.0


def test_values_of_present_effects_only_change(tmp_path: Path) -> None:
    experiment = loaded("m900ib")
    model = experiment.model()
    values = dict(zip(model.names, model.nominal.tolist(), strict=True))
    values["gravity_compensator[joint_2].stiffness"] = 123456.789
    extension = Extension(
        experiment=experiment,
        model=model,
        values=values,
        sds={},
        evidence={"gravity_compensator[joint_2].stiffness": "found"},
    )
    write_extension(extension, tmp_path / "out")
    again = load_experiment(tmp_path / "out" / "experiment.yaml")
    before = {p.name: p for p in model.parameters}
    for p in again.model().parameters:
        if p.name == "gravity_compensator[joint_2].stiffness":
            assert (p.nominal, p.source) == (123456.789, "found")
        else:
            assert (p.nominal, p.source) == (before[p.name].nominal, before[p.name].source)
            assert p.sd == (None if before[p.name].sd is None else pytest.approx(before[p.name].sd, rel=1e-12))
    assert again.fit is None
    entries = read_yaml(tmp_path / "out" / "robot" / "robot.yaml").data["effects"]
    assert entries == read_yaml(experiment.robot.folder / "robot.yaml").data["effects"]


AWKWARD = 'a: "b"\n# c\t& *d !e \u00e9 1e5 - {f} \u2028 end'


def test_any_text_survives(extension: Extension, tmp_path: Path) -> None:
    evidence: Mapping[str, str] = {
        n: t for n, t in zip(extension.fit, (AWKWARD, "1e5", "yes", "~", "010"), strict=False)
    }
    write_extension(replace(extension, evidence=evidence, notes=(AWKWARD, "---\n- x")), tmp_path / "out")
    found = {p.name: p for p in load_experiment(tmp_path / "out" / "experiment.yaml").model().parameters}
    assert {n: found[n].source for n in evidence} == evidence


def test_a_folder_with_other_files_is_refused_and_untouched(extension: Extension, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match=r"holds other files \(mine.txt\)"):
        write_extension(extension, tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]
    file = tmp_path / "mine.txt"
    with pytest.raises(InputError, match="is a file"):
        write_extension(extension, file)


def test_what_was_written_before_is_replaced_but_never_the_original(extension: Extension, tmp_path: Path) -> None:
    out = tmp_path / "out"
    write_extension(extension_with("r2000ic", "load_scale"), out)
    assert (out / "campaign.yaml").exists()
    write_extension(extension, out)
    assert not (out / "campaign.yaml").exists(), "a file of the earlier extension is left"
    second = replace(extension, experiment=load_experiment(out / "experiment.yaml"))
    with pytest.raises(InputError, match="holds the original"):
        write_extension(second, out)
    with pytest.raises(InputError, match="holds the original"):
        write_extension(second, tmp_path)
    (out / "notes.md").write_text("kept")
    with pytest.raises(InputError, match="holds other files"):
        write_extension(extension, out)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out"], "temporary folders are left"


def test_an_extension_can_be_extended_again(extension: Extension, tmp_path: Path) -> None:
    write_extension(extension, tmp_path / "one")
    second = load_experiment(tmp_path / "one" / "experiment.yaml")
    model = second.model()
    values = dict(zip(model.names, (1.01 * model.nominal).tolist(), strict=True))
    write_extension(Extension(experiment=second, model=model, values=values, sds={}, evidence={}), tmp_path / "two")
    third = load_experiment(tmp_path / "two" / "experiment.yaml")
    assert third.robot.title.count("extended") == 1
    assert np.allclose(third.model().nominal, 1.01 * model.nominal, rtol=1e-15)


def test_nothing_is_left_where_writing_fails(
    extension: Extension, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    write_extension(extension, out)
    before = {p: p.read_bytes() for p in out.rglob("*") if p.is_file()}

    def fails(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fails)
    with pytest.raises(InputError, match="No space left"):
        write_extension(extension, out)
    assert {p: p.read_bytes() for p in out.rglob("*") if p.is_file()} == before
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_value_beyond_its_bounds_is_refused_by_name(extension: Extension, tmp_path: Path) -> None:
    values = {**extension.values, "joint_compliance[joint_4]": -1e-7}
    with pytest.raises(InputError, match=r"joint_compliance\[joint_4\] = -1e-07 rad/\(N m\) beyond the bounds"):
        write_extension(replace(extension, values=values), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_an_experiment_that_is_not_that_of_its_file_is_refused(extension: Extension, tmp_path: Path) -> None:
    values = {**extension.values, "made_up": 1.0}
    with pytest.raises(InputError, match="would lose made_up"):
        write_extension(replace(extension, values=values), tmp_path / "out")
    moved = extension.experiment.with_(load_point=extension.experiment.load_point + 0.1)
    model = moved.model()
    values = dict(zip(model.names, model.nominal.tolist(), strict=True))
    with pytest.raises(InputError, match="would lose its markers, its load"):
        write_extension(
            Extension(experiment=moved, model=model, values=values, sds={}, evidence={}, poses=poses_of(moved)),
            tmp_path / "out",
        )
    assert not (tmp_path / "out").exists()


def test_what_the_robot_is_made_of_comes_along(tmp_path: Path) -> None:
    """Includes and meshes of the robot's folder are copied, other files are not."""
    source = loaded("r2000ic").robot.folder
    folder = tmp_path / "robots" / "split"
    (folder / "parts").mkdir(parents=True)
    for name in ("robot.yaml", "nominal.yaml", "r2000ic.urdf.xacro"):
        (folder / name).write_bytes((source / name).read_bytes())
    main = folder / "r2000ic.urdf.xacro"
    text = main.read_text()
    end = text.index("</robot>")
    (folder / "parts" / "more.xacro").write_text(
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="stand"><visual><geometry>'
        '<mesh filename="stand.stl"/></geometry></visual></link>'
        '<joint name="standing" type="fixed"><parent link="base_link"/><child link="stand"/></joint></robot>'
    )
    main.write_text(text[:end] + '<xacro:include filename="$(find parts)/more.xacro"/>' + text[end:])
    corners = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x} {y} {z}\n" for x, y, z in three)
        + "endloop\nendfacet\n"
        for three in combinations(corners, 3)
    )
    (folder / "stand.stl").write_text(f"solid stand\n{facets}endsolid stand\n")
    (folder / "LICENSE").write_text("free")
    (folder / "huge.bin").write_bytes(b"x")
    experiment_file = tmp_path / "experiment.yaml"
    spec = yaml.safe_load(ROBOTS["r2000ic"].read_text())
    spec.pop("data")
    experiment_file.write_text(yaml.safe_dump({**spec, "robot": "robots/split"}))
    experiment = load_experiment(experiment_file)
    model = experiment.model()
    values = dict(zip(model.names, model.nominal.tolist(), strict=True))
    write_extension(Extension(experiment=experiment, model=model, values=values, sds={}, evidence={}), tmp_path / "out")
    robot = tmp_path / "out" / "robot"
    assert (robot / "parts" / "more.xacro").is_file()
    assert (robot / "stand.stl").read_bytes() == (folder / "stand.stl").read_bytes()
    assert (robot / "LICENSE").is_file()
    assert not (robot / "huge.bin").exists()
    assert "stand" in load_experiment(tmp_path / "out" / "experiment.yaml").robot.frames


def test_readings_with_wrong_axes_are_not_named_as_data(tmp_path: Path) -> None:
    """What is wrong with the file has to be corrected there: the extended experiment says so."""
    source = EXAMPLES / "hidden_effect" / "readings.csv"

    def read_from_it(found: Diagnosis) -> Diagnosis:
        return replace(found, readings=replace(found.readings, sources=(source,)))

    found = read_from_it(reversed_sign())
    assert found.conventions[0].compelling
    assert found.conventions[0].name.startswith("displacement_")
    extension = extension_of(found)
    assert extension.data is None
    write_extension(extension, tmp_path / "out")
    head = (tmp_path / "out" / "experiment.yaml").read_text().partition("robot:")[0]
    assert "have to be corrected first" in head
    assert found.conventions[0].words in head
    assert load_experiment(tmp_path / "out" / "experiment.yaml").data == ()
    right = extension_of(read_from_it(quiet(0)))
    assert right.data == source


GROUND = '''"""A pedestal that gives."""

from dataclasses import dataclass

from qsframework.plugin import Parameter, Spring, VirtualJoint, place


@dataclass(frozen=True)
class CLASS(Spring):
    """The pedestal turns about one base axis under the moment there."""

    axis: str = place()

    def parameters(self, robot):
        return (Parameter(self.name, "rad/(N m)", typical=2e-8, lower=0.0),)

    def virtual_joints(self, robot):
        return (VirtualJoint(robot.base, self.axis, "rotation"),)
'''


@pytest.mark.parametrize("second", ["SoftFloor", "SoftGround"])
def test_two_different_effects_in_files_of_one_name_are_refused(second: str, tmp_path: Path) -> None:
    """Both would be copied to one place; the same file, named twice from two folders, is fine there."""
    document = yaml.safe_load(ROBOTS["m900ib"].read_text())
    document["effects"] = [{"file": "a/ground.py", "axis": "x"}, {"file": "b/ground.py", "axis": "y"}]
    (tmp_path / "experiment.yaml").write_text(yaml.safe_dump(document))
    for folder, name in (("a", "SoftGround"), ("b", second)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "ground.py").write_text(GROUND.replace("CLASS", name))
    experiment = load_experiment(tmp_path / "experiment.yaml", trust=True)
    model = experiment.model()
    values = dict(zip(model.names, model.nominal.tolist(), strict=True))
    extension = Extension(experiment=experiment, model=model, values=values, sds={}, evidence={})
    if second == "SoftFloor":
        with pytest.raises(InputError, match=r"two different effects are files of the name ground\.py"):
            write_extension(extension, tmp_path / "out")
        assert not (tmp_path / "out").exists()
    else:
        write_extension(extension, tmp_path / "out")
        assert load_experiment(tmp_path / "out" / "experiment.yaml", trust=True).model().names == model.names

"""`qsf new`: from a stranger's URDF to a robot that works; wrong files are refused and nothing is overwritten."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from qsf_onboarding.folder import new
from qsf_onboarding.proposal import propose
from qsframework.cli.app import app
from qsframework.cli.check import check_files
from qsframework.errors import InputError
from qsframework.experiment import load_experiment
from qsframework.plans import DesignOptions, design
from qsframework.robot import load_robot
from qsframework.robot.reference import reference_flange
from qsframework.uses.conformance import check_robot, small_campaign

JOINT = (
    '<joint name="{n}" type="{k}"><parent link="{p}"/><child link="{c}"/>'
    '<origin xyz="{x}"/><axis xyz="{a}"/>{more}</joint>'
)
LIMIT = '<limit lower="-2" upper="2" effort="0" velocity="0"/>'


BODY = '<inertial><mass value="40"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'


def joint(n: str, p: str, c: str, x: str = "0 0 0.5", a: str = "0 1 0", k: str = "revolute", more: str = LIMIT) -> str:
    return JOINT.format(n=n, p=p, c=c, x=x, a=a, k=k, more=more)


def urdf(where: Path, *joints: str) -> Path:
    names = dict.fromkeys(re.findall(r'link="(\w+)"', "".join(joints)))
    file = where / "stranger.urdf"
    links = "".join(f'<link name="{n}"/>' for n in names)
    file.write_text(f'<robot name="stranger">{links}{"".join(joints)}</robot>')
    return file


ARM = (
    joint("a", "base", "l1", a="0 0 1"),
    joint("b", "l1", "l2", "0.2 0 0"),
    joint("c", "l2", "l3", "0 0 1"),
    joint("d", "l3", "l4", "0 0 0.2", "1 0 0"),
    joint("e", "l4", "l5", "1 0 0"),
    joint("f", "l5", "l6", "0.2 0 0", "1 0 0", "continuous", ""),
)


def written(where: Path, file: Path, flange: str | None = None) -> Path:
    proposal = propose("arm", file, flange=flange)
    (where / "arm").mkdir()
    for name, text in proposal.files.items():
        (where / "arm" / name).write_text(text)
    return where / "arm"


def test_the_page_runs(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (root / "docs" / "add-a-robot.md").read_text()
    source = root / "robots" / "kuka_kr500_r2800_2" / "kuka_kr500_r2800_2.urdf.xacro"
    shutil.copy(source, tmp_path / "arm.urdf.xacro")
    commands = [line for block in re.findall(r"^```sh\n(.*?)^```", page, re.M | re.S) for line in block.splitlines()]
    assert any(c.startswith("qsf design") for c in commands)
    monkeypatch.chdir(tmp_path)
    for command in commands:
        program, *arguments = shlex.split(command)
        assert program == "qsf"
        done = CliRunner().invoke(app, arguments)
        assert done.exit_code == 0, f"{command}: {done.output} {done.exception}"
    assert (tmp_path / "plan.csv").is_file()
    first = load_experiment(tmp_path / "my_arm" / "experiment.yaml")
    assert first.loads[0].wrench[2] == pytest.approx(-0.8 * 500 * 9.81, rel=0.01)
    one, two = load_robot("kuka_kr500_r2800_2"), load_robot(tmp_path / "my_arm")
    q = np.random.default_rng(0).uniform(-2, 2, (20, 6))
    np.testing.assert_allclose(reference_flange(two, q), reference_flange(one, q), atol=1e-12)
    np.testing.assert_allclose(two.facts.masses, one.facts.masses)
    assert len(two.shapes) == len(one.shapes)
    proposed, shipped = (np.array([p.nominal for p in robot.parameters[:6]]) for robot in (two, one))
    assert (np.abs(np.log2(proposed / shipped)) < 1.0).all()


def test_an_arm_without_masses_works(tmp_path: Path) -> None:
    folder = written(tmp_path, urdf(tmp_path, *ARM))
    readme = (folder / "README.md").read_text()
    assert "masses: the URDF has none" in readme
    assert "without limits in the URDF" in readme
    robot = load_robot(folder)
    assert robot.facts.masses.sum() == pytest.approx(40 * (8.3 * 2.417**2.5) ** 0.25 * 2.417**2, rel=0.01)
    assert all("assumed" in p.source for p in robot.parameters)
    checks = check_robot(robot)
    assert all(c.good for c in checks), checks


def test_bars_that_follow_by_mimic_are_left_out_and_told(tmp_path: Path) -> None:
    bar = joint("bar", "l2", "rod", k="continuous", more='<mimic joint="c"/>')
    proposal = propose("arm", urdf(tmp_path, *ARM, bar))
    assert any("bar" in note and "omitted" in note for note in proposal.checklist)
    assert "rod" not in proposal.files["arm.urdf"]


def test_a_heavy_bar_that_follows_the_arm_is_kept_as_a_branch(tmp_path: Path) -> None:
    """A lever on axis 2 turns with the forearm, and the bar on it keeps the attitude of link 2."""
    lever = joint("lever", "l1", "crank", "0.2 0.3 0", k="continuous", more='<mimic joint="c" multiplier="1"/>')
    bar = joint("bar", "crank", "rod", "-0.4 0 0", more=LIMIT + '<mimic joint="lever" multiplier="-1" offset="0.1"/>')
    loose = joint("loose", "l2", "flap", k="continuous", more='<mimic joint="c"/>')
    file = urdf(tmp_path, *ARM, lever, bar, loose)
    text = file.read_text()
    for name in ("crank", "rod"):
        text = text.replace(f'<link name="{name}"/>', f'<link name="{name}">{BODY}</link>')
    file.write_text(text)
    folder = written(tmp_path, file)
    spec = (folder / "robot.yaml").read_text()
    assert "{effect: coupling, joint: lever, follows: {c: 1}}" in spec
    assert "{effect: coupling, joint: bar, follows: {lever: -1}, offset_deg: 5.729577951}" in spec
    robot = load_robot(folder)
    assert [(b.joint, b.parent, b.mass) for b in robot.facts.branches] == [
        ("lever", "l1", 40.0),
        ("bar", "crank", 40.0),
    ]
    told = (folder / "README.md").read_text()
    assert "lever follows c" in told
    assert "omitted, as they do not move the flange: loose" in told
    assert all(c.good for c in check_robot(robot))


HOLLOW = (
    *ARM[:4],
    joint("e", "l4", "l5", "0.07 0 0", "0.8 0 0.6"),
    joint("e2", "l5", "l5b", "0.1 0 0.07", "0.8 0 -0.6", more=LIMIT + '<mimic joint="e" multiplier="-1"/>'),
    joint("f", "l5b", "l6", "0.07 0 0", "1 0 0", "continuous", ""),
)


def test_a_mimic_in_the_arm_becomes_a_coupling(tmp_path: Path) -> None:
    """A hollow wrist, as of a painting robot: the second bend turns back what the first one turned."""
    folder = written(tmp_path, urdf(tmp_path, *HOLLOW))
    assert "{effect: coupling, joint: e2, follows: {e: -1}}" in (folder / "robot.yaml").read_text()
    assert "e2 follows e" in (folder / "README.md").read_text()
    robot = load_robot(folder)
    assert robot.facts.passive == ("e2",)
    assert robot.controller.axes == 6
    q = robot.controller.to_joints(np.random.default_rng(0).uniform(-1, 1, (5, 6)))
    np.testing.assert_allclose(q[:, 5], -q[:, 4])
    assert not any("e2" in p.name for p in robot.parameters)
    checks = check_robot(robot)
    assert all(c.good for c in checks), checks


def test_a_urdf_with_a_mimic_loads_where_robot_yaml_says_the_same(tmp_path: Path) -> None:
    folder = written(tmp_path, urdf(tmp_path, *HOLLOW))
    text, spec = (folder / "arm.urdf").read_text(), (folder / "robot.yaml").read_text()
    line = next(line for line in text.splitlines() if '<joint name="e2"' in line)
    mimic = '<mimic joint="e" multiplier="-1" offset="0"/></joint>'
    (folder / "arm.urdf").write_text(text.replace(line, line.replace("</joint>", mimic)))
    assert load_robot(folder).facts.passive == ("e2",)
    entry = "  - {effect: coupling, joint: e2, follows: {e: -1}}\n"
    changes = {
        "no effect in robot.yaml says so.*Add to effects: {effect: coupling, joint: e2, .*": spec.replace(entry, ""),
        "has no angle on the pendant.*Leave e2 out of controller": spec.replace(
            '  "f": {', '  "e2": {limits_deg: [-90, 90]}\n  "f": {'
        ),
        "mimic and the effects of robot.yaml say different things": spec.replace("{e: -1}", "{e: 1}"),
    }
    for words, changed in changes.items():
        assert changed != spec
        (folder / "robot.yaml").write_text(changed)
        with pytest.raises(InputError, match=words) as refused:
            load_robot(folder)
        assert str(refused.value.problems[0].file).endswith("arm.urdf")


def test_branches_are_asked_for(tmp_path: Path) -> None:
    file = urdf(tmp_path, *ARM, joint("g", "l1", "camera"))
    with pytest.raises(InputError, match=r"2 chains.*l6 \(6 joints\), camera \(2 joints\)"):
        propose("arm", file)
    assert '"l6"' in propose("arm", file, flange="l6").files["robot.yaml"]
    with pytest.raises(InputError, match="no link 'l9'"):
        propose("arm", file, flange="l9")
    with pytest.raises(InputError, match="does not hang on"):
        propose("arm", file, base="l5", flange="l1")


@pytest.mark.parametrize(
    ("joints", "words"),
    [
        ((joint("a", "base", "l1", k="fixed", more=""),), "no joint of an arm moves"),
        (
            (
                *ARM,
                joint("g", "base", "fan", k="continuous", more='<mimic joint="a"/>'),
                joint("w", "l6", "l7", more=LIMIT + '<mimic joint="g"/>'),
                joint("h", "l7", "l8"),
            ),
            "no part of the arm",
        ),
        ((joint("a", "base", "l1", k="planar"),), "no joint of an arm moves"),
        ((joint("a", "base", "l1", k="planar"), joint("b", "l1", "l2")), "planar joint .* base l1"),
        ((joint("a", "base", "l1", more=""),), "no limits"),
        ((joint("a", "base", "l1"), joint("b", "other", "l2")), "one root"),
    ],
)
def test_what_is_no_arm_is_refused(joints: tuple[str, ...], words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        new("arm", urdf(tmp_path, *joints), folder=tmp_path / "new")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("text", ["", "no xml", "<html/>", '<robot name="x"/>', "<robot><link"])
def test_what_is_no_urdf_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "x.urdf").write_text(text)
    with pytest.raises(InputError):
        new("arm", tmp_path / "x.urdf", folder=tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("keep")
    with pytest.raises(InputError, match="nothing is overwritten"):
        new("arm", urdf(tmp_path, *ARM), folder=tmp_path / "mine")
    assert [f.name for f in (tmp_path / "mine").iterdir()] == ["notes.txt"]
    with pytest.raises(InputError, match="no such file"):
        new("arm", tmp_path / "none.urdf", folder=tmp_path / "new")
    with pytest.raises(InputError, match="letters"):
        new("../arm", tmp_path / "stranger.urdf", folder=tmp_path / "new")


def test_an_arm_whose_urdf_states_no_mass_works_without_weight(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its geometry and springs are found; of what would sag by its own weight it is said that nothing can be."""
    folder = written(tmp_path, urdf(tmp_path, *ARM))
    text = re.sub(r"<inertial>.*?</inertial>", "", (folder / "arm.urdf").read_text())
    (folder / "arm.urdf").write_text(text)
    robot = load_robot(folder)
    assert not robot.facts.masses.any()
    checks = {c.name: c for c in check_robot(robot)}
    assert all(c.good for c in checks.values()), checks
    assert "gravity terms are unavailable" in checks["gravity"].words
    check_files([folder], None)
    assert "masses: the URDF states no mass" in capsys.readouterr().out
    spec = (folder / "robot.yaml").read_text()
    sag = "effects:\n  - {effect: gravity_sag, joints: [b, c]}"
    (folder / "robot.yaml").write_text(spec.replace("effects:", sag))
    plan = design(
        small_campaign(load_robot(folder), tmp_path),
        8,
        candidates=100,
        options=DesignOptions(criterion="D", polish=False),
    )
    assert len(plan.pose) == 8
    (folder / "arm.urdf").write_text(text.replace('<link name="l3">', f'<link name="l3">{BODY}'))
    with pytest.raises(InputError, match="'l1' moves but has no <inertial>"):
        load_robot(folder)


def test_an_arm_on_a_rail_weighs_and_gives_what_it_does_on_the_floor(tmp_path: Path) -> None:
    """The rail's carriage is no link of the arm; the flange is the controller's, tool0, where a maker names both."""
    tool = joint("t", "l6", "flange", "0.1 0 0", k="fixed", more="") + joint("u", "flange", "tool0", k="fixed", more="")
    (tmp_path / "rail").mkdir()
    rail = joint("rail", "floor", "base", "0 0 0", "1 0 0", "prismatic", LIMIT)
    floor = propose("arm", urdf(tmp_path, *ARM, tool), payload=100.0)
    sliding = propose("arm", urdf(tmp_path / "rail", rail, *ARM, tool), payload=100.0)
    for pattern in (r"joint_compliance\[b\]\":\n.*", r"joint_compliance\[f\]\":\n.*"):
        one, other = (re.search(pattern, p.files["nominal.yaml"]) for p in (floor, sliding))
        assert one is not None
        assert other is not None
        assert one[0] == other[0]
    assert 'flange: "tool0"' in floor.files["robot.yaml"]

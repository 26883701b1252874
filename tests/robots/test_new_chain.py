"""`qsf new` says what became of every joint, and what it advises works: files as makers write them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from strangers import Y, Z, elbow, joint, link, mimic, put, robot
from strangers_chain import run

from qsf_onboarding.folder import Arm, NewRobot, new
from qsf_onboarding.joints import ChainJoint, Fate
from qsframework.errors import InputError
from qsframework.robot import load_robot
from qsframework.robot.reference import reference_flange

MASSES = (60.0, 40.0, 25.0, 10.0, 6.0, 2.0)


def six(more: str = "", kinds: tuple[str, ...] = ("",) * 6, tool: str = "tool0") -> str:
    """An arm of six axes with masses and efforts, and what hangs on its flange."""
    parts = [link("base_link")]
    for k, (xyz, axis) in enumerate(elbow(0.5, 0.2, 0.9, 0.1, 0.6, 0.1)):
        parent = f"l{k}" if k else "base_link"
        parts += [link(f"l{k + 1}", MASSES[k]), joint(f"j{k + 1}", parent, f"l{k + 1}", xyz, axis, kind=kinds[k])]
    parts += [link(tool), joint("l6-tool", "l6", tool, rpy=(0.0, 1.5708, 0.0))]
    return robot("\n".join(parts) + more)


def made(folder: Path, text: str, **arm: str) -> NewRobot:
    return new("arm", put(folder, "given/arm.urdf", text), folder=folder / "arm", arm=Arm(**arm))


def limited(text: str, joint: str, low: float, high: float) -> str:
    """With other limits of a joint."""
    return re.sub(rf'(name="{joint}".*?)lower="[^"]*" upper="[^"]*"', rf'\1lower="{low}" upper="{high}"', text)


def by_name(found: NewRobot) -> dict[str, ChainJoint]:
    return {joint.name: joint for joint in found.chain}


HAND = "\n" + link("hand", 0.9) + joint("tool0-hand", "tool0", "hand")
FINGERS = HAND + "".join(
    link(f"{side}_knuckle", 0.03)
    + joint(
        f"{side}_knuckle_joint",
        "hand",
        f"{side}_knuckle",
        (0.0, y, 0.05),
        (1.0, 0.0, 0.0),
        (0.0, 0.8) if side == "left" else (-0.8, 0.0),
        more="" if side == "left" else mimic("left_knuckle_joint", -1.0),
    )
    for side, y in (("left", 0.03), ("right", -0.03))
)


@pytest.mark.parametrize("tool", ["tool0", "wrist_plate"])
def test_the_drive_of_fingers_ends_the_arm(tool: str, tmp_path: Path) -> None:
    """Whether a link says so by its name or not: what follows the last joint stands beside it."""
    found = made(tmp_path, six(FINGERS.replace("tool0", tool), tool=tool))
    rows = by_name(found)
    assert [rows[f"j{k}"].fate for k in range(1, 7)] == [Fate.KEPT] * 6
    assert (rows["left_knuckle_joint"].fate, rows["right_knuckle_joint"].fate) == (Fate.DROPPED, Fate.DROPPED)
    assert "drives fingers: right_knuckle_joint follows it" in rows["left_knuckle_joint"].why
    robot = load_robot(tmp_path / "arm")
    assert (robot.controller.axes, robot.facts.flange) == (6, "tool0" if tool == "tool0" else "l6")
    assert robot.facts.masses[-1] == pytest.approx(2.9)


def test_what_moves_beyond_a_flange_is_a_tools(tmp_path: Path) -> None:
    """Two fingers with motors of their own are no reason to ask where tool0 stands before them."""
    fingers = "".join(
        link(f"f{k}", 0.1) + joint(f"finger_{k}", "hand", f"f{k}", (0.0, 0.03 - 0.06 * k, 0.0), Y) for k in range(2)
    )
    found = by_name(made(tmp_path, six(HAND + fingers)))
    assert found["finger_0"].why == found["finger_1"].why == "beyond the flange tool0"
    with pytest.raises(InputError, match=r"2 chains hang on 'base_link'"):
        made(tmp_path / "two", six((HAND + fingers).replace("tool0", "plate").replace("finger", "claw"), tool="plate"))


@pytest.mark.parametrize(
    ("name", "flange"),
    [("tool0", "tool0"), ("left_flange", "left_flange"), ("lbr_link_ee", "lbr_link_ee"), ("camera", "l6")],
)
def test_a_flange_goes_by_its_name(name: str, flange: str, tmp_path: Path) -> None:
    made(tmp_path, six(tool=name))
    assert load_robot(tmp_path / "arm").facts.flange == flange


def test_limits_of_continuous_joints(tmp_path: Path) -> None:
    """Within a turn they are the maker's; wider, upside down or nil they say nothing."""
    kinds = ("continuous",) * 5 + ("revolute",)
    text = limited(limited(six(kinds=kinds), "j3", 0.0, 0.0), "j5", -9.0, 9.0)
    found = by_name(made(tmp_path, text))
    assert found["j1"].fate is Fate.OVERRULED
    assert found["j1"].used == found["j1"].stated == (-2.8, 2.8)
    assert found["j3"].used == found["j5"].used == (-2 * np.pi, 2 * np.pi)
    assert found["j6"].fate is Fate.KEPT
    controller = load_robot(tmp_path / "arm").controller
    np.testing.assert_allclose(np.rad2deg(controller.upper[[0, 2]]), [np.rad2deg(2.8), 360.0], atol=1e-3)
    readme = (tmp_path / "arm" / "README.md").read_text()
    assert "j1, j2, j4 are continuous in the URDF, and the limits stated there are kept" in readme


def test_the_chain_is_printed(tmp_path: Path) -> None:
    file = put(tmp_path, "arm.urdf", six(FINGERS, kinds=("continuous", *[""] * 5)))
    step = run(["new", "arm", "--urdf", str(file), "-o", str(tmp_path / "arm")])
    row = next(line for line in step.output.splitlines() if line.startswith("j1 "))
    assert re.search(r"j1\s+l1\s+overruled\s+-160\.4\.\.160\.4 deg", row)
    assert re.search(r"^right_knuckle_joint\s+right_knuckle\s+dropped", step.output, re.M)


def column(offset: float = 0.0) -> str:
    """A lift of two stages, each half of what a link without a body shows, and an arm on it."""
    follow = mimic("lift", 0.5, offset)
    return robot(
        "\n".join(
            [
                link("base", 200),
                link("shown"),
                link("stage1", 18),
                link("stage2", 15),
                joint("lift", "base", "shown", axis=Z, limits=(0.0, 1.2), kind="prismatic"),
                joint("lift_1", "base", "stage1", (0, 0, 0.9), Z, (0.0, 0.6), kind="prismatic", more=follow),
                joint("lift_2", "stage1", "stage2", (0, 0, 0.2), Z, (0.0, 0.6), kind="prismatic", more=follow),
                *(link(f"l{k}", 20 - 5 * k) for k in range(1, 4)),
                joint("a1", "stage2", "l1", (0, 0, 0.2), Z),
                joint("a2", "l1", "l2", (0, 0, 0.3), Y),
                joint("a3", "l2", "l3", (0, 0, 0.8), Y),
            ]
        )
    )


@pytest.mark.parametrize("offset", [0.0, 0.05])
def test_a_telescopic_column_is_one_travel(offset: float, tmp_path: Path) -> None:
    """The pendant shows the lift; both stages go half of it, from where the mimic has them at zero."""
    found = by_name(made(tmp_path, column(offset)))
    assert (found["lift"].fate, found["lift_1"].fate, found["lift_2"].fate) == ("dropped", "overruled", "overruled")
    assert found["lift_1"].used == (0.0, 1.2)
    robot = load_robot(tmp_path / "arm")
    assert robot.facts.passive == ("lift_2",)
    places = reference_flange(robot, robot.controller.to_joints(np.array([[0.0, 0, 0, 0], [1.2, 0, 0, 0]])))
    assert places[:, 2, 3] == pytest.approx([2.4 + 2 * offset, 3.6 + 2 * offset])


def test_a_column_is_measured_like_any_arm(tmp_path: Path) -> None:
    made(tmp_path, column())
    step = run(["check", str(tmp_path / "arm"), "--conformance"])
    assert step.refusal == ""
    assert "NO" not in step.output


def palletizer() -> str:
    parts = [link("base_link"), link("s", 300), link("l", 200), link("u", 150), link("b", 40), link("t", 15)]
    parts += [
        joint("S", "base_link", "s", (0, 0, 0.6), Z),
        joint("L", "s", "l", (0.3, 0, 0.2), Y, (-0.8, 1.5)),
        joint("U", "l", "u", (0, 0, 1.1), (0, -1, 0), (-1.2, 1.0)),
        joint("B", "u", "b", (1.2, 0, 0), Y, (-2.0, 2.0)),
        joint("T", "b", "t", (0.2, 0, -0.2), (0, 0, -1), (-6.0, 6.0)),
    ]
    return robot("\n".join(parts))


def test_a_palletizer_is_advised_on_two_loops(tmp_path: Path) -> None:
    """Following the advice, its head stays level wherever the arm goes, and the loop of the elbow is one."""
    found = made(tmp_path, palletizer())
    (loops,) = (note for note in found.checklist if note.startswith("loops:"))
    assert "no motor at B" in loops
    file = tmp_path / "arm" / "robot.yaml"
    text = file.read_text()
    assert "# - {effect: coupling, joint: B, follows: {L: -1, U: 1}}" in text
    taken = re.sub(r"  # - (\{effect: (?:coupling|parallelogram))", r"  - \1", text)
    file.write_text(re.sub(r'  "B": .*\n', "", taken))
    values = tmp_path / "arm" / "nominal.yaml"
    values.write_text(re.sub(r'"joint_compliance\[B\]":\n(?:  .*\n)+', "", values.read_text()))
    robot = load_robot(tmp_path / "arm")
    assert robot.controller.axes == 4
    pendant = np.deg2rad([[0.0, 0.0, 0.0, 0.0], [40.0, 25.0, 10.0, 0.0], [-80.0, 60.0, -40.0, 0.0]])
    placed = reference_flange(robot, robot.controller.to_joints(pendant))
    np.testing.assert_allclose(placed[:, 2, :3], np.tile([0.0, 0.0, 1.0], (3, 1)), atol=1e-9)


@pytest.mark.parametrize(("axis", "sign"), [(Y, "-"), ((0.0, -1.0, 0.0), "+")])
def test_which_of_the_two_expressions(axis: tuple[float, float, float], sign: str, tmp_path: Path) -> None:
    """What is advised keeps the forearm's attitude while J2 alone turns, whichever way the URDF's axis points."""
    text = six().replace(
        joint("j3", "l2", "l3", (0, 0, 0.9), Y, (-2.8, 2.8)), joint("j3", "l2", "l3", (0, 0, 0.9), axis, (-2.8, 2.8))
    )
    found = made(tmp_path, text)
    said = next(note for note in found.checklist if note.startswith("controller: turn J2 alone by 20 deg"))
    assert f"write equals: J3 {sign} J2 for j3" in said
    file = tmp_path / "arm" / "robot.yaml"
    file.write_text(re.sub(r'("j3": \{limits_deg: \[.*\])\}', rf"\1, equals: J3 {sign} J2}}", file.read_text()))
    robot = load_robot(tmp_path / "arm")
    turned = np.deg2rad([[0.0, 0, 10, 0, 20, 0], [0.0, 20, 10, 0, 20, 0]])
    first, second = reference_flange(robot, robot.controller.to_joints(turned))[:, :3, :3]
    np.testing.assert_allclose(first, second, atol=1e-9)


def test_pivots_that_the_urdf_draws_are_a_balancer(tmp_path: Path) -> None:
    """A housing that turns on link 1, a pivot fixed to link 2: their places, and that its values are still empty."""
    drawn = (
        "\n"
        + link("balancer_housing", 30)
        + joint("housing", "l1", "balancer_housing", (-0.6, 0.2, -0.1), Y)
        + link("bracket")
        + joint("bracket_joint", "l2", "bracket", (0.0, 0.0, 0.1))
        + link("balancer_rod_pivot")
        + joint("pivot", "bracket", "balancer_rod_pivot", (-0.2, 0.2, 0.05))
    )
    found = made(tmp_path, six(drawn))
    assert any("balancer_housing and balancer_rod_pivot are the pivots" in note for note in found.checklist)
    robot = load_robot(tmp_path / "arm")
    (spring,) = (e for e in robot.effects if hasattr(e, "tension"))
    ends = spring.outline(robot.facts)
    assert [(end.link, *np.round(end.xyz, 9)) for end in ends] == [("l1", -0.6, 0.2, -0.1), ("l2", -0.2, 0.2, 0.15)]
    step = run(["check", str(tmp_path / "arm")])
    assert "a balancer without values holds nothing: nominal.yaml lacks" in " ".join(step.output.split())
    values = tmp_path / "arm" / "nominal.yaml"
    name = f"{spring.name}.stiffness"
    values.write_text(values.read_text() + f'"{name}":\n  value_kN/m: 400\n  sd_percent: 20\n  source: "data sheet"\n')
    assert "without values" not in run(["check", str(tmp_path / "arm")]).output


def test_the_reach_is_that_of_the_arm(tmp_path: Path) -> None:
    """By hand: upright, link 2 and the forearm in one line; 0.2 m before axis 1."""
    found = made(tmp_path, six())
    (said,) = (note for note in found.checklist if note.startswith("size:"))
    reach = 0.2 + 0.9 + np.hypot(0.1, 0.6)
    wrist = float(re.search(r"origin of j5 ([\d.]+) m", said).group(1))  # type: ignore[union-attr]
    assert wrist == pytest.approx(reach, rel=0.005)


def test_bad_files_are_refused_in_words(tmp_path: Path) -> None:
    gripper = robot(
        link("palm", 1)
        + link("left", 0.1)
        + link("right", 0.1)
        + joint("drive", "palm", "left", (0, 0.03, 0), Y, (0.0, 0.8))
        + joint("follower", "palm", "right", (0, -0.03, 0), Y, (-0.8, 0.0), more=mimic("drive", -1.0))
    )
    with pytest.raises(
        InputError, match=r"line \d+: the joints that move are those of a gripper.*Give the URDF of the"
    ):
        made(tmp_path / "gripper", gripper.replace("<link", "\n<link"))
    with pytest.raises(InputError, match=r"no joint of an arm moves beyond 'a'"):
        made(tmp_path / "still", robot(link("a", 1) + link("b", 1) + joint("ab", "a", "b")))
    reversed_ = limited(six(), "j2", 1.3, -1.1)
    with pytest.raises(
        InputError, match=r"line \d+: joint 'j2': the lower limit must be below .*1\.3 \.\. -1\.1.*Exchange"
    ):
        made(tmp_path / "reversed", reversed_)


def test_a_package_is_sought_from_where_the_user_stands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (
        six()
        .replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ')
        .replace("0 0 0.9", "0 0 ${reach}")
    )
    lengths = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="reach" value="0.9"/></robot>'
    put(tmp_path, "elsewhere/parts/urdf/reach.xacro", lengths)
    head, _, rest = text.partition("\n")
    name, _, rest = rest.partition("\n")
    include = '<xacro:include filename="$(find parts)/urdf/reach.xacro"/>'
    file = put(tmp_path, "given/deep/arm.xacro", "\n".join([head, name, include, rest]))
    monkeypatch.chdir(tmp_path / "elsewhere")
    step = run(["new", "arm", "--urdf", str(file), "--package", "parts=parts", "-o", str(tmp_path / "arm")])
    assert step.refusal == ""
    assert load_robot(tmp_path / "arm").facts.placements[2][2, 3] == pytest.approx(0.9)


XACRO = """<?xml version="1.0"?>
<robot name="s" xmlns:xacro="http://ros.org/wiki/xacro">
  {property}
  <link name="b"/><link name="c"><inertial><mass value="5"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
  <link name="d"><inertial><mass value="5"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
  <joint name="j1" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0 0 {height}"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="10" velocity="1"/></joint>
  <joint name="j2" type="revolute"><parent link="c"/><child link="d"/><origin xyz="0.5 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="8" velocity="1"/></joint>
</robot>
"""


@pytest.mark.parametrize(
    ("value", "height"),
    [
        ("0 0 0.5", "${where.split(' ')[2]}"),
        ("${dict(z=0.5)}", "${where['z']}"),
        ("${xacro.load_yaml('twice.yaml')}", "${where['link1']['origin']['z']}"),
    ],
)
def test_a_makers_xacro_is_taken_as_xacro_takes_it(value: str, height: str, tmp_path: Path) -> None:
    put(tmp_path, "given/twice.yaml", "link1:\n  mass: 5\n  origin:\n  origin:\n    z: 0.5\n")
    text = XACRO.format(property=f'<xacro:property name="where" value="{value}"/>', height=height)
    found = new("arm", put(tmp_path, "given/arm.xacro", text), folder=tmp_path / "arm")
    assert load_robot(tmp_path / "arm").facts.placements[0][2, 3] == 0.5
    doubled = [
        note for note in found.checklist if "'origin' stands here twice; as in xacro the later one counts" in note
    ]
    assert len(doubled) == ("twice" in value)


def test_what_the_evaluator_refuses_has_a_way_out(tmp_path: Path) -> None:
    text = XACRO.format(property="", height="${[x for x in [0.5]][0]}")
    with pytest.raises(InputError, match=r"arm\.xacro, line 6: .*Expand it with xacro and give the URDF: xacro FILE"):
        new("arm", put(tmp_path, "given/arm.xacro", text), folder=tmp_path / "arm")

"""Kinds of robot files that public packages carry and `qsf new` once took wrongly or refused without need."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from strangers import STRANGERS, X, Y, Z, arm, elbow, joint, link, mimic, put, robot
from strangers_chain import new

from qsf_onboarding.proposal import Proposal, propose
from qsframework.errors import InputError
from qsframework.experiment import read_plan, write_plan
from qsframework.plans import design
from qsframework.robot import load_robot
from qsframework.robot.packages import Sources
from qsframework.uses.conformance import small_campaign

STEPS = elbow(0.2, 0.0, 0.5, 0.1, 0.5, 0.1)
ARM = arm(STEPS, [40, 20, 15, 10, 5, 3, 1])
FOUR = arm(STEPS[:3] + STEPS[4:5], [40, 20, 15, 10, 5])
XACRO = '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro">{}</robot>'


def kept(proposal: Proposal) -> list[str]:
    return [row.name for row in proposal.chain if row.fate == "kept"]


def refusal(file: Path, sources: Sources | None = None) -> str:
    with pytest.raises(InputError) as refused:
        propose("arm", file, sources=sources)
    return str(refused.value)


def test_meshes_beside_the_folder_urdf_are_read_though_no_package_xml_is_there(tmp_path: Path) -> None:
    box = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"
    put(tmp_path, "maker/meshes/base.obj", box)
    drawn = '<visual><geometry><mesh filename="{}"/></geometry></visual>'
    for name in ("../meshes/base.obj", "package://maker/meshes/base.obj"):
        file = put(tmp_path, "maker/urdf/a.urdf", robot(ARM + link("drawn", 0, drawn.format(name)) + fixed("drawn")))
        assert any(name.startswith("meshes/") for name in propose("arm", file).files)
    secret = put(tmp_path, "base.obj", box)
    text = robot(ARM + link("drawn", 0, drawn.format("../../base.obj")) + fixed("drawn"))
    assert "outside the robot's folder and packages" in refusal(put(tmp_path, "maker/urdf/a.urdf", text))
    named = Sources({"mine": secret.parent}, nearby=True)
    assert any(
        name.startswith("meshes/") for name in propose("arm", tmp_path / "maker/urdf/a.urdf", sources=named).files
    )


def fixed(child: str) -> str:
    return f'<joint name="to_{child}" type="fixed"><parent link="base_link"/><child link="{child}"/></joint>'


def test_a_package_beside_one_that_was_named_is_found(tmp_path: Path) -> None:
    put(tmp_path, "src/colours/c.xacro", XACRO.format('<xacro:property name="width" value="1"/>'))
    put(tmp_path, "src/kr/urdf/m.xacro", XACRO.format('<xacro:include filename="$(find colours)/c.xacro"/>' + ARM))
    file = put(tmp_path, "a.xacro", XACRO.format('<xacro:include filename="$(find kr_support)/urdf/m.xacro"/>'))
    assert "say where it is" in refusal(file)
    assert len(kept(propose("arm", file, sources=Sources({"kr_support": tmp_path / "src" / "kr"}, nearby=True)))) == 6


def test_an_unprefixed_property_of_the_first_xacro_is_named(tmp_path: Path) -> None:
    text = XACRO.format('\n<property name="deg" value="0.0175"/>\n' + ARM.replace("-3 ", "${-90*deg} ", 1))
    text = text.replace('lower="', 'lower="${-1*deg}" was="', 1)
    said = refusal(put(tmp_path, "a.xacro", text))
    assert "name 'deg' is not defined" in said
    assert "<property> of a.xacro, line 2, is none of xacro's: write it with xacro: before its name" in said
    assert len(kept(propose("arm", put(tmp_path, "b.xacro", text.replace("<property", "<xacro:property"))))) == 6


def test_macros_alone_hold_no_link(tmp_path: Path) -> None:
    file = put(tmp_path, "a.xacro", XACRO.format('<xacro:macro name="arm" params="p">' + ARM + "</xacro:macro>"))
    assert "holds no link. A xacro that only defines macros draws nothing: give the file that calls them" in refusal(
        file
    )


def test_a_vehicle_below_the_arm_is_refused_at_its_own_line(tmp_path: Path) -> None:
    below = link("floor") + joint("drive", "floor", "base_link", (0, 0, 0.4), X, (-1e6, 1e6), kind="prismatic")
    file = put(tmp_path, "a.urdf", robot(below + "\n" + ARM))
    said = refusal(file)
    assert str(file) in said
    assert "joint 'drive': no joint of an arm has these limits; found -1e+06 .. 1e+06 m; allowed: up to 100 m" in said
    assert "begin the arm beyond it: base base_link" in said
    assert len(kept(propose("arm", file, base="base_link"))) == 6


def test_limits_of_1e16_say_that_there_are_none(tmp_path: Path) -> None:
    text = robot(ARM).replace('lower="', 'lower="-1e16" upper="1e16" x="', 1).replace('upper="', 'y="', 2)
    text = text.replace('y="1e16"', 'upper="1e16"', 1).replace('type="revolute"', 'type="continuous"', 1)
    assert kept(propose("arm", put(tmp_path, "a.urdf", text))) is not None


def test_a_fixed_joint_follows_nothing(tmp_path: Path) -> None:
    """As where a gripper was locked, and its followers' leader is gone from the file."""
    locked = link("jaw", 0.1) + joint("jaw", "tool0", "jaw", kind="fixed", more=mimic("nowhere"))
    assert len(kept(propose("arm", put(tmp_path, "a.urdf", robot(ARM + locked))))) == 6


@pytest.mark.parametrize("axis", [X, Y, Z])
def test_a_motor_and_fingers_on_the_last_body_are_the_gripper_s(tmp_path: Path, axis: tuple[float, ...]) -> None:
    """As px100's spinner, across the last axis or along it, and fingers that slide along it."""
    hand = "".join(link(name, 0.05) for name in ("spinner", "left", "right"))
    hand += joint("motor", "tool0", "spinner", (0.01, 0, 0), axis, None)
    hand += joint("left_slide", "tool0", "left", (0.05, 0, 0), Y, (0.01, 0.03), kind="prismatic")
    follows = mimic("left_slide", -1)
    hand += joint("right_slide", "tool0", "right", (0.05, 0, 0), Y, (-0.03, -0.01), kind="prismatic", more=follows)
    assert len(kept(propose("arm", put(tmp_path, "a.urdf", robot(FOUR + hand))))) == 4


@pytest.mark.parametrize("name", ["gripper", "jointGripper", "gripper_joint", "moving_jaw"])
def test_a_single_jaw_is_the_gripper_s(tmp_path: Path, name: str) -> None:
    jaw = link("jaw_link", 0.05) + joint(name, "tool0", "jaw_link", (0.01, 0.02, 0), Y, (-0.2, 1.5))
    assert len(kept(propose("arm", put(tmp_path, "a.urdf", robot(ARM + jaw))))) == 6


def test_poses_that_the_polish_brings_together_are_one_that_is_repeated(tmp_path: Path) -> None:
    """Of an arm of three axes thirty poses come to the same corners, which no plan may list twice."""
    new(next(one for one in STRANGERS if one.name == "scara_fixed"), tmp_path)
    experiment = small_campaign(load_robot(tmp_path / "arm"), tmp_path)
    plan = design(experiment, 30)
    rows = np.column_stack([plan.pendant, plan.wrench])
    assert len(np.unique(rows, axis=0)) == len(rows) < 30
    assert sum(plan.repeats) == 30
    write_plan(tmp_path / "plan.csv", plan, experiment)
    assert read_plan(tmp_path / "plan.csv", experiment).repeats == plan.repeats


def test_half_a_limit_ends_at_zero(tmp_path: Path) -> None:
    """As in the gantry of a fabrication cell: <limit upper="37"/>, where the format says that the other end is 0."""
    rail = link("rail", 500) + joint("beam", "rail", "base_link", (0, 0, 2.5), X, (0.0, 37.0), kind="prismatic")
    text = robot(rail + "\n" + ARM).replace('<limit lower="0" ', "<limit ")
    proposal = propose("arm", put(tmp_path, "a.urdf", text))
    assert proposal.chain[0].used == (0.0, 37.0)


def test_a_hand_on_a_link_that_is_not_there_is_refused(tmp_path: Path) -> None:
    """It would be left out without a word."""
    hand = link("hand", 1) + joint("to_hand", "link_8", "hand", (0, 0, 0.1))
    said = refusal(put(tmp_path, "a.urdf", robot(ARM + hand)))
    assert "joint 'to_hand': unknown parent link 'link_8'" in said
    assert "Did you mean 'link_" in said

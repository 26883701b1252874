"""`qsf new` on what strangers' URDFs are like: grippers, mobile bases, torsos, packages, impossible inertias."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from qsf_onboarding.folder import Arm, new
from qsf_onboarding.proposal import _TWIST, Proposal, propose
from qsframework.cli.app import app
from qsframework.errors import InputError
from qsframework.robot import load_robot
from qsframework.robot.packages import Sources
from qsframework.robot.reference import reference_flange
from qsframework.uses.conformance import check_robot

BODY = (
    '<inertial><origin xyz="0 0 {z}"/><mass value="{m}"/>'
    '<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial>'
)
LIMIT = '<limit lower="-2.5" upper="2.5" effort="0" velocity="1"/>'


def link(name: str, mass: float = 0.0, inertia: float | None = None, z: float = 0.1) -> str:
    inside = BODY.format(m=mass, i=0.01 * mass if inertia is None else inertia, z=z) if mass else ""
    mesh = f'<visual><geometry><mesh filename="package://gone/{name}.stl"/></geometry></visual>'
    return f'<link name="{name}">{inside}{mesh}</link>'


def joint(parent: str, child: str, axis: str, xyz: str = "0 0 0.4", kind: str = "revolute", more: str = LIMIT) -> str:
    axis = "" if kind == "fixed" else f'<axis xyz="{axis}"/>'
    return (
        f'<joint name="to_{child}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/>{axis}{more if kind != "fixed" else ""}</joint>'
    )


ARM = (
    link("foot", 20)
    + link("turret", 30)
    + link("upper", 18)
    + link("fore", 9)
    + link("roll", 4)
    + link("bend", 2)
    + link("hand", 1)
    + joint("foot", "turret", "0 0 1")
    + joint("turret", "upper", "0 1 0", "0.2 0 0.2")
    + joint("upper", "fore", "0 1 0", "0 0 0.8")
    + joint("fore", "roll", "1 0 0", "0.3 0 0.1")
    + joint("roll", "bend", "0 1 0", "0.5 0 0")
    + joint("bend", "hand", "1 0 0", "0.1 0 0")
)
FINGERS = (
    link("palm", 0.8)
    + link("left", 0.1)
    + link("right", 0.1)
    + joint("hand", "palm", "", "0.05 0 0", "fixed")
    + joint("palm", "left", "0 1 0", "0.1 0.03 0", "prismatic")
    + joint("palm", "right", "0 -1 0", "0.1 -0.03 0", "prismatic", LIMIT + '<mimic joint="to_left"/>')
)


def file_of(folder: Path, text: str, name: str = "robot.urdf", more: str = "") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / name
    file.write_text(f'<?xml version="1.0"?>\n<robot name="stranger"{more}>{text}</robot>\n')
    return file


def written(folder: Path, proposal: Proposal) -> Path:
    """The folder of a proposal, with its marked values filled in."""
    (folder / "arm").mkdir(parents=True)
    for name, text in proposal.files.items():
        filled = text.replace("# payload_kg: 100", "payload_kg: 8").replace("sd_percent: 60", "sd_percent: 20")
        (folder / "arm" / name).write_text(filled)
    return folder / "arm"


def works(folder: Path, proposal: Proposal) -> Path:
    """The same folder, which passes the conformance test."""
    written(folder, proposal)
    checks = check_robot(folder / "arm")
    assert all(c.good for c in checks), [c for c in checks if not c.good]
    return folder / "arm"


def test_an_arm_with_a_gripper_ends_at_its_last_turning_joint(tmp_path: Path) -> None:
    proposal = propose("arm", file_of(tmp_path, ARM + FINGERS))
    told = next(note for note in proposal.checklist if note.startswith("omitted"))
    assert "to_left, to_right; what they carry, 0.2 kg" in told
    robot = load_robot(works(tmp_path, proposal))
    assert robot.facts.masses[-1] == pytest.approx(1.8)  # hand and palm
    with pytest.raises(
        InputError, match=r"prismatic joint cannot be part of the arm\. End the arm before it: flange palm"
    ):
        propose("arm", tmp_path / "robot.urdf", flange="right")


def test_a_propeller_on_the_last_axis_is_left_out(tmp_path: Path) -> None:
    spin = link("propeller", 0.1) + joint("hand", "propeller", "-1 0 0", "0.05 0 0", "continuous", "")
    file = file_of(tmp_path, ARM + spin)
    assert 'flange: "hand"' in propose("arm", file).files["robot.yaml"]
    assert any("to_propeller" in note for note in propose("arm", file).checklist)
    assert 'flange: "propeller"' in propose("arm", file, flange="propeller").files["robot.yaml"]
    file_of(tmp_path, ARM + spin.replace("0.05 0 0", "0.05 0 0.02"))
    assert 'flange: "propeller"' in propose("arm", file).files["robot.yaml"]


def test_a_hand_of_turning_fingers_asks_where_the_arm_ends(tmp_path: Path) -> None:
    fingers = "".join(
        link(f"f{k}", 0.1) + link(f"g{k}", 0.1) + joint("hand", f"f{k}", "0 1 0") + joint(f"f{k}", f"g{k}", "0 1 0")
        for k in range(3)
    )
    file = file_of(tmp_path, ARM + fingers + link("lamp", 1) + joint("foot", "lamp", "0 0 1"))
    with pytest.raises(
        InputError, match=r"4 chains hang on 'foot'.*allowed: hand \(6 joints, then 3 chains\), lamp \(1 joint\)\."
    ):
        propose("arm", file)
    assert "6 chains" not in propose("arm", file, flange="hand").files["robot.yaml"]


def test_an_arm_on_a_lift_of_a_mobile_base(tmp_path: Path) -> None:
    cart = (
        link("cart", 80)
        + link("wheel_left", 3)
        + link("wheel_right", 3)
        + link("lift", 12)
        + joint("cart", "wheel_left", "0 1 0", kind="continuous", more="")
        + joint("cart", "wheel_right", "0 1 0", kind="continuous", more="")
        + joint("cart", "lift", "0 0 1", kind="prismatic")
        + joint("lift", "foot", "", kind="fixed")
    )
    file = file_of(tmp_path, cart + ARM)
    with pytest.raises(InputError, match=r"3 chains.*allowed: hand \(6 joints\), wheel_left \(1 joint\), wheel_right"):
        propose("arm", file)
    assert '"to_lift": {limits_mm:' in propose("arm", file, flange="hand").files["robot.yaml"]
    works(tmp_path, propose("arm", file, base="lift", flange="hand"))


def test_inertias_of_no_body_do_not_stop_an_arm_at_rest(tmp_path: Path) -> None:
    """Dots and needles, as exporters write them, and an inertia without a mass on a sensor's frame."""
    text = ARM.replace(link("roll", 4), link("roll", 4, 0.0)).replace(
        link("bend", 2), link("bend", 2).replace('iyy="0.02"', 'iyy="0.9"')
    )
    sensor = '<link name="cell"><inertial><mass value="0"/><inertia ixx="1" iyy="1" izz="9"/></inertial></link>'
    proposal = propose("arm", file_of(tmp_path, text + sensor + joint("bend", "cell", "", kind="fixed")))
    assert any(note.startswith("inertias: no body has those of roll, bend ") for note in proposal.checklist)
    robot = load_robot(works(tmp_path, proposal))
    np.testing.assert_allclose(robot.facts.masses, [20, 30, 18, 9, 4, 2, 1])


def test_one_link_without_a_mass_keeps_the_others(tmp_path: Path) -> None:
    proposal = propose("arm", file_of(tmp_path, ARM.replace(link("roll", 4), link("roll"))))
    assert any("none for roll; there they are assumed" in note for note in proposal.checklist)
    assert "**assumed** for roll" in proposal.files["README.md"]
    robot = load_robot(works(tmp_path, proposal))
    np.testing.assert_allclose(robot.facts.masses, [20, 30, 18, 9, 4.5, 2, 1])


def test_a_continuous_joint_with_empty_limits(tmp_path: Path) -> None:
    last = joint("bend", "hand", "1 0 0", "0.1 0 0")
    empty = last.replace('type="revolute"', 'type="continuous"').replace(
        'lower="-2.5" upper="2.5"', 'lower="0" upper="0"'
    )
    proposal = propose("arm", file_of(tmp_path, ARM.replace(last, empty)))
    robot = load_robot(works(tmp_path, proposal))
    assert np.rad2deg(robot.controller.upper[-1]) == pytest.approx(360)


def test_an_arm_that_moves_in_a_horizontal_plane(tmp_path: Path) -> None:
    text = link("foot") + link("one", 5) + link("two", 3) + joint("foot", "one", "0 0 1")
    works(tmp_path, propose("arm", file_of(tmp_path, text + joint("one", "two", "0 0 1", "0.4 0 0"))))


XACRO = ' xmlns:xacro="http://www.ros.org/wiki/xacro"'


def workspace(tmp_path: Path) -> Path:
    """Two packages beside each other, as in a ROS workspace; the arm's length is an argument without a default."""
    for package in ("maker_resources", "maker_arm", "secret"):
        (tmp_path / "src" / package).mkdir(parents=True)
        (tmp_path / "src" / package / "package.xml").write_text(f"<package><name>{package}</name></package>")
    lengths = '<xacro:property name="reach" value="0.8"/>'
    file_of(tmp_path / "src" / "maker_resources" / "urdf", lengths, "lengths.xacro", XACRO)
    macro = ARM.replace("0 0 0.8", "0 0 ${reach}").replace("0.5 0 0", "$(arg forearm) 0 0")
    macro = f'<xacro:macro name="arm" params="prefix">{macro}</xacro:macro>'
    file_of(tmp_path / "src" / "maker_arm" / "urdf", macro, "arm_macro.xacro", XACRO)
    text = (
        '<xacro:arg name="forearm" default="0.5"/>'
        '<xacro:include filename="$(find maker_resources)/urdf/lengths.xacro"/>'
        '<xacro:include filename="$(find maker_arm)/urdf/arm_macro.xacro"/><xacro:arm prefix=""/>'
    )
    return file_of(tmp_path / "src" / "maker_arm" / "urdf", text, "arm.xacro", XACRO)


def test_packages_beside_each_other_are_found(tmp_path: Path) -> None:
    file = workspace(tmp_path)
    robot = load_robot(works(tmp_path, propose("arm", file)))
    assert reference_flange(robot, np.zeros((1, 6)))[0, :3, 3] == pytest.approx([1.1, 0, 1.5])


def test_a_package_elsewhere_and_an_argument_are_told(tmp_path: Path) -> None:
    file = workspace(tmp_path)
    (tmp_path / "src" / "maker_resources").rename(tmp_path / "elsewhere")
    with pytest.raises(
        InputError, match=r"arm.xacro: \$\(find maker_resources\): no folder or package .*say where it is"
    ):
        propose("arm", file)
    sources = Sources({"maker_resources": tmp_path / "elsewhere"}, {"forearm": "0.7"}, nearby=True)
    robot = load_robot(written(tmp_path, propose("arm", file, sources=sources)))
    assert reference_flange(robot, np.zeros((1, 6)))[0, 0, 3] == pytest.approx(1.3)
    for package, words in (("maker_resources", "not understood"), (f"maker_resources={tmp_path / 'none'}", "no such")):
        done = CliRunner().invoke(
            app, ["new", "arm", "--urdf", str(file), "-o", str(tmp_path / "new"), "--package", package]
        )
        assert words in str(done.exception)
    file.write_text(file.read_text().replace('<xacro:arg name="forearm" default="0.5"/>', ""))
    with pytest.raises(InputError, match=r"argument 'forearm' has no default; give it a value"):
        propose("arm", file, sources=Sources(sources.packages, nearby=True))


def test_a_package_opens_no_other_folder(tmp_path: Path) -> None:
    file = workspace(tmp_path)
    file_of(tmp_path / "src" / "secret", "", "secret.xacro", XACRO)
    text = file.read_text()
    for target in (
        "../../secret/secret.xacro",
        "$(find maker_arm)/../secret/secret.xacro",
        "$(find ../..)/secret/secret.xacro",
    ):
        file.write_text(text.replace("$(find maker_arm)/urdf/arm_macro.xacro", target))
        with pytest.raises(InputError, match="outside the robot's folder"):
            propose("arm", file)


def test_packages_are_sought_in_the_workspace_and_not_above(tmp_path: Path) -> None:
    """A package by its manifest's name in a folder of another; nothing above the packages, and no mere folder there."""
    file = workspace(tmp_path)
    (tmp_path / "src" / "maker_resources").rename(tmp_path / "src" / "checkout")
    load_robot(written(tmp_path, propose("arm", file)))
    manifest = tmp_path / "src" / "checkout" / "package.xml"
    text = manifest.read_text()
    manifest.unlink()
    (tmp_path / "src" / "checkout").rename(tmp_path / "src" / "maker_resources")
    with pytest.raises(InputError, match="no folder or package of this name"):
        propose("arm", file)  # a folder beside the package that is none itself
    (tmp_path / "src" / "maker_resources").rename(tmp_path / "maker_resources")
    (tmp_path / "maker_resources" / "package.xml").write_text(text)
    with pytest.raises(InputError, match="no folder or package of this name"):
        propose("arm", file)  # above the workspace
    (tmp_path / "maker_resources").rename(tmp_path / "src" / "maker_arm" / "maker_resources")
    propose("arm", file)


def test_the_page_says_what_compliances_are_assumed(root: Path) -> None:
    page = (root / "docs" / "add-a-robot.md").read_text()
    assert f"{1e3 * _TWIST:g} mrad" in page


def test_a_payload_from_the_manual_sizes_the_springs(tmp_path: Path) -> None:
    """Masses that no file states grow with its fourth root, and the springs with the masses."""
    file = file_of(tmp_path, re.sub(r"<inertial>.*?</inertial>", "", ARM))
    compliances = []
    for payload in (40.0, 640.0):
        proposal = propose("arm", file, payload=payload)
        assert f"payload_kg: {payload:g}\n" in proposal.files["robot.yaml"]
        note = "payload: add torque_limit_Nm per joint where the maker states them"
        assert note in proposal.checklist
        robot = load_robot(written(tmp_path / f"{payload:g}", proposal))
        assert robot.payload == payload
        compliances.append([p.nominal for p in robot.parameters])
    np.testing.assert_allclose(np.divide(*compliances), 2.0, rtol=1e-3)


def test_the_checklist_says_what_looks_odd(tmp_path: Path) -> None:
    notes = propose("arm", file_of(tmp_path, ARM)).checklist
    assert "masses: all that moves weighs 64 kg in the URDF; can that be, by the manual?" in notes
    assert any(n.startswith("size: within these limits the flange comes ") for n in notes)
    (solids,) = (n for n in notes if n.startswith("solids: "))
    assert "no box, cylinder, sphere or mesh of turret, upper, fore, roll, bend, hand in the URDF" in solids
    box = ARM.replace('<mesh filename="package://gone/fore.stl"/>', '<box size="0.3 0.1 0.1"/>')
    assert not any("fore" in n for n in propose("arm", file_of(tmp_path, box)).checklist if n.startswith("solids"))


def test_wrong_payloads(tmp_path: Path) -> None:
    file = file_of(tmp_path, ARM)
    for payload in (0.0, -3.0, float("nan"), 1e9):
        with pytest.raises(InputError, match="no payload of a robot"):
            new("arm", file, folder=tmp_path / "new", arm=Arm(payload=payload))
    assert not (tmp_path / "new").exists()


def test_only_an_arm_with_an_elbow_is_asked_for_what_such_arms_have(tmp_path: Path) -> None:
    """Not one of seven axes, nor one with three parallel axes, nor a SCARA; but a slanted axis is none."""
    notes = propose("arm", file_of(tmp_path, ARM)).checklist
    assert [note.split(":")[0] for note in notes[:3]] == ["controller", "loops", "springs"]
    seven = ARM + link("tip", 1) + joint("hand", "tip", "0 1 0", "0.1 0 0")
    three = ARM.replace(joint("fore", "roll", "1 0 0", "0.3 0 0.1"), joint("fore", "roll", "0 -1 0", "0.3 0 0.1"))
    scara = link("foot") + link("a", 5) + link("b", 3) + link("c", 1)
    scara += joint("foot", "a", "0 0 1") + joint("a", "b", "0 0 1", "0.4 0 0") + joint("b", "c", "0 0 -1", "0.3 0 0")
    for text in (seven, three, scara):
        proposal = propose("arm", file_of(tmp_path, text))
        assert not any(note.startswith(("controller", "loops", "springs")) for note in proposal.checklist)
        assert "parallelogram" not in proposal.files["robot.yaml"]


def test_a_slide_between_turning_joints_is_to_be_fixed(tmp_path: Path) -> None:
    """The arm of a SCARA beyond its slide would be one joint."""
    scara = link("foot") + link("a", 5) + link("b", 3) + link("quill", 1) + link("tip", 0.5)
    scara += joint("foot", "a", "0 0 1") + joint("a", "b", "0 0 1", "0.4 0 0")
    text = scara + joint("b", "quill", "0 0 1", "0.3 0 0", "floating") + joint("quill", "tip", "0 0 1", "0 0 -0.1")
    with pytest.raises(InputError, match=r'Make it type="fixed" where it stands in the campaign: 3 joints then turn'):
        propose("arm", file_of(tmp_path, text))
    fixed = propose("arm", file_of(tmp_path, text.replace('type="floating"', 'type="fixed"')))
    assert fixed.files["robot.yaml"].count("limits_deg") == 3


def stl(extents: tuple[float, float, float], kind: str = "stl") -> bytes:
    import trimesh

    made = trimesh.creation.box(extents=extents).export(file_type=kind)
    return made.encode() if isinstance(made, str) else made


@pytest.mark.parametrize("kind", ["stl", "stl_ascii", "obj", "dae"])
def test_meshes_of_a_package_become_solids(kind: str, tmp_path: Path) -> None:
    """Boxes in mm, in a package beside the file's: hulls for collisions, sight and floor, and meshes to draw."""
    suffix = kind.partition("_")[0]
    meshes = tmp_path / "src" / "maker_meshes" / "meshes"
    meshes.mkdir(parents=True)
    for package in ("maker_arm", "maker_meshes"):
        (tmp_path / "src" / package).mkdir(exist_ok=True)
        (tmp_path / "src" / package / "package.xml").write_text(f"<package><name>{package}</name></package>")
    (meshes / f"upper.{suffix}").write_bytes(stl((200, 100, 800), kind))
    mesh = f'<mesh filename="package://maker_meshes/meshes/upper.{suffix}" scale="0.001 0.001 0.001"/>'
    text = ARM.replace('<mesh filename="package://gone/upper.stl"/>', mesh)
    proposal = propose("arm", file_of(tmp_path / "src" / "maker_arm" / "urdf", text))
    assert [name for name in proposal.files if name.startswith("meshes/")] == [
        "meshes/2_upper_0.obj",
        "meshes/2_upper_solid_0.obj",
    ]
    told = next(note for note in proposal.checklist if note.startswith("meshes: not there"))
    assert "package://gone/foot.stl" in told
    folder = tmp_path / "arm"
    (folder / "meshes").mkdir(parents=True)
    for name, content in proposal.files.items():
        (folder / name).write_text(content)
    robot = load_robot(folder)
    ((shape,), (drawn,)) = robot.shapes, robot.meshes
    assert (shape.kind, shape.link, drawn.link) == ("hull", 2, 2)
    assert shape.hull is not None
    np.testing.assert_allclose(np.ptp(shape.hull.corners, axis=0), [0.2, 0.1, 0.8], atol=1e-6)
    assert drawn.path is not None


BAD = {
    "a path to elsewhere": ("../../../secret.stl", "outside the robot's folder and packages, and is not read"),
    "a link to elsewhere": ("linked.stl", "outside the robot's folder and packages, and is not read"),
    "a package with a way out": ("package://maker/../../secret.stl", "outside the robot's folder and packages"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_meshes_are_named_with_file_and_line(case: str, tmp_path: Path) -> None:
    name, words = BAD[case]
    folder = tmp_path / "src" / "maker" / "urdf"
    folder.mkdir(parents=True)
    (folder.parent / "package.xml").write_text("<package><name>maker</name></package>")
    for place in (tmp_path, tmp_path / "src"):
        (place / "secret.stl").write_bytes(stl((1, 1, 1)))
    (folder / "linked.stl").symlink_to(tmp_path / "secret.stl")
    file = file_of(folder, ARM.replace("package://gone/upper.stl", name).replace("<link", "\n<link"))
    line = next(k for k, text in enumerate(file.read_text().splitlines(), 1) if name in text)
    with pytest.raises(InputError, match=words) as refused:
        propose("arm", file)
    assert (refused.value.problems[0].file, refused.value.problems[0].line) == (str(file), line)
    (folder / "robot.yaml").write_text(propose("arm", file_of(tmp_path / "plain", ARM)).files["robot.yaml"])
    (folder / "nominal.yaml").write_text(propose("arm", tmp_path / "plain" / "robot.urdf").files["nominal.yaml"])
    file.rename(folder / "arm.urdf")
    with pytest.raises(InputError, match=words):
        load_robot(folder)


def test_a_broken_mesh_is_a_note(tmp_path: Path) -> None:
    """The arm is as good without it; what was not read, or is too large, is named with its place in the file."""
    (tmp_path / "broken.stl").write_bytes(b"this is no mesh")
    (tmp_path / "big.stl").touch()
    os.truncate(tmp_path / "big.stl", 100_000_000)
    (tmp_path / "good.stl").write_bytes(stl((0.2, 0.1, 0.8)))
    text = ARM.replace("package://gone/upper.stl", "broken.stl").replace("package://gone/fore.stl", "good.stl")
    text = text.replace("package://gone/hand.stl", "big.stl")
    proposal = propose("arm", file_of(tmp_path, text.replace("<link", "\n<link")))
    (told,) = (note for note in proposal.checklist if note.startswith("meshes: these cannot be read"))
    assert re.search(r"broken\.stl \(line \d+\), big\.stl \(line \d+\)$", told)
    assert [name for name in proposal.files if name.startswith("meshes/")] == [
        "meshes/3_fore_0.obj",
        "meshes/3_fore_solid_0.obj",
    ]


def test_an_elbow_is_one_whatever_carries_it(tmp_path: Path) -> None:
    """Turned on a wedge, and with a joint that follows in the wrist."""
    wedge = '<link name="wedge"/>' + joint("wedge", "foot", "", "0 0 1", "fixed").replace(
        "<origin ", '<origin rpy="0.3 0.2 0" '
    )
    follows = joint("bend", "hand", "1 0 0", "0.1 0 0", more=LIMIT + '<mimic joint="to_bend" multiplier="0.5"/>')
    text = ARM.replace(joint("bend", "hand", "1 0 0", "0.1 0 0"), follows)
    notes = propose("arm", file_of(tmp_path, wedge + text), flange="hand").checklist
    assert notes[0].startswith("controller: turn J2 alone by 20 deg")

"""Robot files as strangers bring them: the structures of public descriptions by many makers, written small.

Lengths, masses and names are made up; what is kept is how such files are built: macros and packages, tables in YAML,
joints that follow others, helper links without a size, odd axes, meshes, grippers. Used by the tests and by
benchmarks/strangers.py.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

XACRO = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
Vector = tuple[float, float, float]
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class Stranger:
    """A robot as somebody brings it.

    write: puts its files into a folder and names the main one; options: of `qsf new` beside the file; refused:
    what `qsf new` says instead, as a regular expression; axes: values on the pendant
    """

    name: str
    like: str
    write: Callable[[Path], Path]
    axes: int = 6
    options: Sequence[str] = ()
    refused: str = ""


def put(folder: Path, name: str, text: str | bytes) -> Path:
    """Write a file into a folder of the robot."""
    file = folder / name
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return file


def manifest(folder: Path, package: str) -> Path:
    """The folder of a package."""
    put(folder, f"{package}/package.xml", f'<package format="2"><name>{package}</name></package>\n')
    return folder / package


def robot(body: str, xacro: bool = False) -> str:
    return f'<?xml version="1.0"?>\n<robot name="stranger" {XACRO if xacro else ""}>\n{body}\n</robot>\n'


def row(values: Sequence[float]) -> str:
    return " ".join(f"{v:g}" for v in values)


def link(name: str, mass: float = 0.0, inside: str = "", at: Vector = (0.0, 0.0, 0.1)) -> str:
    i = f"{0.02 * mass:g}"
    body = (
        f'<inertial><origin xyz="{row(at)}" rpy="0 0 0"/><mass value="{mass:g}"/>'
        f'<inertia ixx="{i}" ixy="0" ixz="0" iyy="{i}" iyz="0" izz="{i}"/></inertial>'
    )
    return f'  <link name="{name}">{body if mass else ""}{inside}</link>'


def joint(
    name: str,
    parent: str,
    child: str,
    xyz: Sequence[float] = (0.0, 0.0, 0.0),
    axis: Sequence[float] = (),
    limits: tuple[float, float] | None = (-2.8, 2.8),
    rpy: Sequence[float] = (0.0, 0.0, 0.0),
    kind: str = "",
    more: str = "",
) -> str:
    kind = kind or ("fixed" if not axis else "revolute" if limits else "continuous")
    given = f'<axis xyz="{row(axis)}"/>' if axis else ""
    if limits and axis:
        given += f'<limit lower="{limits[0]:g}" upper="{limits[1]:g}" effort="0" velocity="3.14"/>'
    return (
        f'  <joint name="{name}" type="{kind}"><origin xyz="{row(xyz)}" rpy="{row(rpy)}"/><parent link="{parent}"/>'
        f'<child link="{child}"/>{given}{more}</joint>'
    )


def mimic(joint: str, multiplier: float = 1.0, offset: float = 0.0) -> str:
    return f'<mimic joint="{joint}" multiplier="{multiplier:g}" offset="{offset:g}"/>'


def arm(
    steps: Sequence[tuple[Vector, Vector]],
    masses: Sequence[float] = (),
    tool: Vector = (0.0, 0.0, 0.0),
    link_name: str = "link_{}",
    joint_name: str = "joint_{}",
    inside: Callable[[int], str] = lambda _: "",
    base: str = "base_link",
) -> str:
    """A chain of (origin, axis), masses from the base on, a flange frame tool0."""
    names = [base, *(link_name.format(k + 1) for k in range(len(steps)))]
    weights = masses or [0.0] * len(names)
    out = [link(name, m, inside(k)) for k, (name, m) in enumerate(zip(names, weights, strict=True))]
    for k, (xyz, axis) in enumerate(steps):
        out.append(joint(joint_name.format(k + 1), names[k], names[k + 1], xyz, axis, LIMITS[k]))
    out += [link("tool0"), joint(f"{names[-1]}-tool0", names[-1], "tool0", tool)]
    return "\n".join(out)


def elbow(d1: float, a1: float, a2: float, a3: float, d4: float, d6: float) -> list[tuple[Vector, Vector]]:
    """The six axes of a heavy arm, stretched upwards at zero: turn, lean, elbow, roll, bend, spin."""
    return [
        ((0.0, 0.0, d1), Z),
        ((a1, 0.0, 0.0), Y),
        ((0.0, 0.0, a2), Y),
        ((0.0, 0.0, a3), X),
        ((d4, 0.0, 0.0), Y),
        ((d6, 0.0, 0.0), X),
    ]


LIMITS = ((-2.8, 2.8), (-1.1, 1.3), (-1.5, 1.0), (-2.8, 2.8), (-1.9, 1.9), (-2.8, 2.8), (-2.8, 2.8))
HEAVY = (300.0, 250.0, 180.0, 90.0, 60.0, 30.0, 8.0)
LIGHT = (4.0, 3.7, 8.4, 2.3, 1.2, 1.2, 0.3)


def table_arm(folder: Path) -> Path:
    """As Universal Robots': YAML tables through arguments, a macro that reads them into its caller, a base inertia."""
    package = manifest(folder, "maker_description")
    lengths = ((0.0, 0.0, 0.18, 0.0), (0.0, 0.0, 0.0, np.pi / 2), (-0.61, 0.0, 0.0, 0.0), (-0.57, 0.0, 0.17, 0.0))
    lengths += ((0.0, -0.12, 0.0, np.pi / 2), (0.0, 0.12, 0.0, -np.pi / 2))
    names = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
    pans = ("shoulder_pan", "shoulder_lift", "elbow_joint", "wrist_1", "wrist_2", "wrist_3")
    kinematics = "".join(
        f"  {name}: {{x: {x}, y: {y}, z: {z}, roll: {roll!r}, pitch: 0, yaw: 0}}\n"
        for name, (x, y, z, roll) in zip(names, lengths, strict=True)
    )
    limits = "".join(
        f"  {name}:\n    max_effort: {330 - 50 * k}.0\n    min_position: !degrees -{[360, 180][k == 2]}.0\n"
        f"    max_position: !degrees  {[360, 180][k == 2]}.0\n"
        for k, name in enumerate(pans)
    )
    masses = "".join(f"    {name}: {m}\n" for name, m in zip(names, LIGHT[1:], strict=True))
    config = "config/e12"
    put(package, f"{config}/default_kinematics.yaml", f"kinematics:\n{kinematics}  hash: calib_1234\n")
    put(package, f"{config}/joint_limits.yaml", f"joint_limits:\n{limits}")
    put(package, f"{config}/physical_parameters.yaml", f"inertia_parameters:\n  masses:\n{masses}  radius: 0.06\n")
    common = """<xacro:macro name="read_model_data" params="limits_file kinematics_file physical_file">
    <xacro:property name="config_limits" value="${xacro.load_yaml(limits_file)}"/>
    <xacro:property name="sec_limits" value="${config_limits['joint_limits']}" scope="parent"/>
    <xacro:property name="kin" value="${xacro.load_yaml(kinematics_file)['kinematics']}" scope="parent"/>
    <xacro:property name="inertia" value="${load_yaml(physical_file).inertia_parameters}" scope="parent"/>
  </xacro:macro>
  <xacro:macro name="body" params="name mass radius *origin">
    <link name="${name}"><inertial><mass value="${mass}"/><xacro:insert_block name="origin"/>
      <inertia ixx="${0.4*mass*radius**2}" ixy="0" ixz="0" iyy="${0.4*mass*radius**2}" iyz="0"
        izz="${0.4*mass*radius**2}"/></inertial></link>
  </xacro:macro>
  <xacro:macro name="turn" params="name parent child frame lim">
    <joint name="${name}" type="revolute"><parent link="${parent}"/><child link="${child}"/>
      <origin xyz="${frame['x']} ${frame['y']} ${frame['z']}" rpy="${frame.roll} ${frame.pitch} ${frame.yaw}"/>
      <axis xyz="0 0 1"/><limit lower="${lim['min_position']}" upper="${lim['max_position']}"
        effort="${lim['max_effort']}" velocity="2"/></joint>
  </xacro:macro>"""
    put(package, "urdf/inc/common.xacro", robot(common, xacro=True))
    turns = "\n".join(
        f"""    <xacro:body name="${{tf_prefix}}{name}_link" mass="${{inertia['masses']['{name}']}}"
        radius="${{inertia['radius']}}"><origin xyz="0 0 0.05" rpy="0 0 0"/></xacro:body>
    <xacro:turn name="${{tf_prefix}}{pan}" parent="${{tf_prefix}}{before}_link" child="${{tf_prefix}}{name}_link"
        frame="${{kin['{name}']}}" lim="${{sec_limits['{pan}']}}"/>"""
        for before, name, pan in zip(("base_link_inertia", *names), names, pans, strict=False)
    ).replace("base_link_inertia_link", "base_link_inertia")
    macro = f"""<xacro:include filename="$(find maker_description)/urdf/inc/common.xacro"/>
  <xacro:macro name="e_robot" params="name tf_prefix parent *origin limits_file kinematics_file physical_file
      safety:=false force_abs_paths:=^|false">
    <xacro:read_model_data limits_file="${{limits_file}}" kinematics_file="${{kinematics_file}}"
      physical_file="${{physical_file}}"/>
    <joint name="${{tf_prefix}}base_joint" type="fixed"><xacro:insert_block name="origin"/>
      <parent link="${{parent}}"/><child link="${{tf_prefix}}base_link"/></joint>
    <link name="${{tf_prefix}}base_link"/><link name="${{tf_prefix}}base_link_inertia"/>
    <joint name="${{tf_prefix}}base_inertia" type="fixed"><origin xyz="0 0 0" rpy="0 0 ${{pi}}"/>
      <parent link="${{tf_prefix}}base_link"/><child link="${{tf_prefix}}base_link_inertia"/></joint>
{turns}
    <link name="${{tf_prefix}}flange"/><link name="${{tf_prefix}}tool0"/>
    <joint name="${{tf_prefix}}wrist_3-flange" type="fixed"><parent link="${{tf_prefix}}wrist_3_link"/>
      <child link="${{tf_prefix}}flange"/><origin xyz="0 0 0" rpy="0 ${{-pi/2}} ${{-pi/2}}"/></joint>
    <joint name="${{tf_prefix}}flange-tool0" type="fixed"><parent link="${{tf_prefix}}flange"/>
      <child link="${{tf_prefix}}tool0"/><origin xyz="0 0 0" rpy="${{pi/2}} 0 ${{pi/2}}"/></joint>
    <xacro:if value="${{safety}}"><link name="safety"/></xacro:if>
  </xacro:macro>"""
    put(package, "urdf/e_macro.xacro", robot(macro, xacro=True))
    where = "$(find maker_description)/config/$(arg type)"
    main = f"""<xacro:arg name="type" default="e12"/><xacro:arg name="tf_prefix" default=""/>
  <xacro:arg name="limits" default="{where}/joint_limits.yaml"/>
  <xacro:include filename="$(find maker_description)/urdf/e_macro.xacro"/>
  <link name="world"/>
  <xacro:e_robot name="e" tf_prefix="$(arg tf_prefix)" parent="world" limits_file="$(arg limits)"
    kinematics_file="{where}/default_kinematics.yaml" physical_file="{where}/physical_parameters.yaml">
    <origin xyz="0 0 0" rpy="0 0 0"/>
  </xacro:e_robot>"""
    return put(package, "urdf/e.urdf.xacro", robot(main, xacro=True))


def macro_arm(folder: Path) -> Path:
    """As Motoman's: a macro with a prefix, colours of a package beside it, joints by letters, lost meshes."""
    resources, package = manifest(folder, "maker_resources"), manifest(folder, "maker_es_support")
    put(
        resources, "urdf/common_materials.xacro", robot('<xacro:property name="blue" value="0 0.2 0.7 1"/>', xacro=True)
    )
    letters, steps = "slurbt", elbow(0.65, 0.285, 1.15, 0.25, 1.225, 0.215)
    parts = [link("${prefix}base_link", 300, _mesh("es", "base"))]
    for k, (letter, (xyz, axis)) in enumerate(zip(letters, steps, strict=True)):
        name = f"${{prefix}}link_{k + 1}_{letter}"
        parent = "${prefix}base_link" if k == 0 else f"${{prefix}}link_{k}_{letters[k - 1]}"
        parts.append(link(name, HEAVY[k + 1], _mesh("es", f"link_{k + 1}_{letter}")))
        turned = joint(f"${{prefix}}joint_{k + 1}_{letter}", parent, name, xyz, axis if k != 3 else (-1.0, 0.0, 0.0))
        parts.append(turned.replace('lower="-2.8"', 'lower="${radians(-150)}"'))
    parts += [link("${prefix}tool0"), joint("${prefix}joint_tool0", "${prefix}link_6_t", "${prefix}tool0", (0.1, 0, 0))]
    macro = '<xacro:include filename="$(find maker_resources)/urdf/common_materials.xacro"/>\n'
    macro += '<xacro:macro name="es165" params="prefix">\n' + "\n".join(parts) + "\n</xacro:macro>"
    put(package, "urdf/es165_macro.xacro", robot(macro, xacro=True))
    main = '<xacro:include filename="$(find maker_es_support)/urdf/es165_macro.xacro"/><xacro:es165 prefix=""/>'
    return put(package, "urdf/es165.xacro", robot(main, xacro=True))


def _mesh(package: str, name: str, suffix: str = "stl") -> str:
    """A visual and a collision, as ROS-Industrial has them."""
    where = f"package://maker_{package}_support/meshes/{{}}/{name}.{suffix}"
    return "".join(
        f'<{tag}><origin xyz="0 0 0"/><geometry><mesh filename="{where.format(tag)}"/></geometry></{tag}>'
        for tag in ("visual", "collision")
    )


def hollow_wrist(folder: Path) -> Path:
    """As a painting arm of ABB's: the second bend of the wrist turns back what the first turns, by mimic."""
    steps = [*elbow(0.85, 0.25, 1.2, 0.2, 1.4, 0.07)[:4], ((1.4, 0.0, 0.0), (0.8, 0.0, 0.6))]
    text = arm(steps, HEAVY[:6]).replace(link("tool0"), "").rsplit("\n", 1)[0]
    more = [
        link("link_6", 6),
        joint("joint_5b", "link_5", "link_6", (0.1, 0, 0.07), (0.8, 0, -0.6), more=mimic("joint_5", -1.0)),
        link("link_7", 3),
        joint("joint_6", "link_6", "link_7", (0.1, 0, 0), X, None),
        link("tool0"),
        joint("link_7-tool0", "link_7", "tool0", (0.05, 0, 0)),
    ]
    return put(folder, "painter.urdf", robot(text + "\n" + "\n".join(more)))


def plain_elbow(folder: Path) -> Path:
    """As ABB's IRB 6640: no mass, a frame `base` beside base_link, a flange before tool0."""
    text = arm(elbow(0.78, 0.32, 1.075, 0.2, 1.142, 0.2)).replace(
        joint("link_6-tool0", "link_6", "tool0"),
        joint("joint6-flange", "link_6", "flange")
        + "\n"
        + joint("link_6-tool0", "flange", "tool0", rpy=(0, 1.5708, 0)),
    )
    more = [link("flange"), link("base"), joint("base_link-base", "base_link", "base")]
    return put(folder, "irb.urdf", robot(text + "\n" + "\n".join(more)))


def with_gripper(folder: Path) -> Path:
    """As the KR210 of a course: a footprint, continuous joints, a gripper that slides, elements of gazebo's."""
    text = arm(elbow(0.75, 0.35, 1.25, -0.054, 1.5, 0.303), HEAVY).replace(
        joint("joint_6", "link_5", "link_6", (0.303, 0, 0), X),
        joint("joint_6", "link_5", "link_6", (0.303, 0, 0), X, None),
    )
    more = [
        link("base_footprint"),
        joint("footprint", "base_footprint", "base_link"),
        link("gripper_link", 1.5),
        joint("gripper", "link_6", "gripper_link", (0.11, 0, 0)),
        link("left_finger", 0.2),
        joint("left", "gripper_link", "left_finger", (0.1, 0.05, 0), Y, (-0.1, 0.0), kind="prismatic"),
        link("right_finger", 0.2),
        joint(
            "right",
            "gripper_link",
            "right_finger",
            (0.1, -0.05, 0),
            Y,
            (0.0, 0.1),
            kind="prismatic",
            more=mimic("left", -1),
        ),
        '<gazebo reference="link_1"><material>Gazebo/Orange</material></gazebo>',
        '<transmission name="t1"><type>simple</type><joint name="joint_1"/></transmission>',
    ]
    return put(folder, "kr.urdf", robot(text + "\n" + "\n".join(more)))


def _seven(half: float) -> list[tuple[Vector, Vector]]:
    """Seven axes, roll and bend in turn, stretched upwards."""
    return [((0.0, 0.0, half if k else 0.15), (Z, Y)[k % 2]) for k in range(7)]


def seven_axes(folder: Path) -> Path:
    """As KUKA's iiwa: seven joints, each frame turned into the next, the bends the other way round."""
    turned = [(0.0, 0.0, 0.0), (np.pi / 2, 0.0, np.pi), (np.pi / 2, 0.0, np.pi), (np.pi / 2, 0.0, 0.0)] * 2
    names = [f"lbr_link_{k}" for k in range(8)]
    out = [link(name, m) for name, m in zip(names, (5, 4, 4, 3, 2.7, 1.7, 1.8, 0.3), strict=True)]
    for k in range(7):
        origin = (0.0, 0.0, 0.1575) if k == 0 else (0.0, 0.2, 0.0) if k % 2 == 0 else (0.0, 0.0, 0.2)
        out.append(joint(f"lbr_A{k + 1}", names[k], names[k + 1], origin, Z, (-2.0, 2.0), turned[k]))
    out += [link("lbr_link_ee"), joint("lbr_joint_ee", names[-1], "lbr_link_ee", (0, 0, 0.045))]
    return put(folder, "iiwa.urdf", robot("\n".join(out)))


def with_hand(folder: Path) -> Path:
    """As Franka's: limits and inertias of YAML by attribute, if/unless for the hand, a block of more elements."""
    package = manifest(folder, "franka_like_description")
    limits = "".join(
        f"joint{k}:\n  limit: {{lower: {-2.5 + 0.1 * k}, upper: {2.5 - 0.1 * k}, effort: {87 if k < 5 else 12}.0}}\n"
        for k in range(1, 8)
    )
    put(package, "robots/fr/joint_limits.yaml", limits)
    masses = "".join(
        f"link{k}: {{mass: {m}, inertia: {{xx: 0.02, yy: 0.02, zz: 0.02}}}}\n"
        for k, m in enumerate((2.9, 4.9, 0.65, 3.2, 3.6, 1.2, 1.7, 0.7))
    )
    put(package, "robots/fr/inertials.yaml", masses)
    utils = """<xacro:macro name="inertial_of" params="name inertials:=^">
    <xacro:unless value="${name in inertials}"><unknown_link/></xacro:unless>
    <xacro:property name="body" value="${inertials[name]}" lazy_eval="false"/>
    <inertial><origin xyz="0 0 -0.05" rpy="0 0 0"/><mass value="${body.mass}"/>
      <xacro:property name="i" value="${body.inertia}"/>
      <inertia ixx="${i.xx}" ixy="0" ixz="0" iyy="${i.yy}" iyz="0" izz="${i.zz}"/></inertial>
  </xacro:macro>
  <xacro:macro name="with_link" params="name **more"><link name="${name}"><xacro:inertial_of name="${name}"/></link>
    <xacro:insert_block name="more"/></xacro:macro>"""
    put(package, "robots/common/utils.xacro", robot(utils, xacro=True))
    links = ['<xacro:with_link name="link0"><more/></xacro:with_link>']
    for k, (xyz, axis) in enumerate(_seven(0.19), 1):
        text = joint(f"joint{k}", f"link{k - 1}", f"link{k}", xyz, axis)
        for key, old in (("lower", "-2.8"), ("upper", "2.8"), ("effort", "0")):
            text = text.replace(f'{key}="{old}"', f'{key}="${{limits.joint{k}.limit.{key}}}"')
        links.append(f'<xacro:with_link name="link{k}"><more>{text}</more></xacro:with_link>')
    hand = [
        link("hand", 0.7),
        joint("hand_joint", "link7", "hand", (0, 0, 0.1)),
        link("leftfinger", 0.02),
        joint("finger1", "hand", "leftfinger", (0, 0, 0.06), Y, (0.0, 0.04), kind="prismatic"),
        link("rightfinger", 0.02),
        joint(
            "finger2",
            "hand",
            "rightfinger",
            (0, 0, 0.06),
            (0, -1, 0),
            (0.0, 0.04),
            kind="prismatic",
            more=mimic("finger1"),
        ),
    ]
    main = f"""<xacro:arg name="arm_id" default="fr"/><xacro:arg name="hand" default="true"/>
  <xacro:property name="here" value="$(find franka_like_description)/robots"/>
  <xacro:include filename="${{here}}/common/utils.xacro"/>
  <xacro:property name="inertials" value="${{xacro.load_yaml(here + '/fr/inertials.yaml')}}"/>
  <xacro:property name="limits" value="${{xacro.load_yaml('joint_limits.yaml')}}"/>
{chr(10).join(links)}
  <xacro:if value="$(arg hand)">{chr(10).join(hand)}</xacro:if>"""
    return put(package, "robots/fr/fr.urdf.xacro", robot(main, xacro=True))


def with_meshes(folder: Path) -> Path:
    """As FANUC's M-710iC: STL meshes of a package to draw and for collisions; axes with minus signs."""
    import trimesh

    package = manifest(folder, "maker_m7_support")
    sizes = (
        (0.5, 0.5, 0.5),
        (0.5, 0.4, 0.4),
        (0.25, 0.25, 0.9),
        (0.35, 0.3, 0.3),
        (0.8, 0.2, 0.2),
        (0.1, 0.1, 0.1),
        (0.05, 0.1, 0.1),
    )
    middles = ((0, 0, 0.25), (0, 0, 0), (0, 0.3, 0.43), (0, 0, 0.1), (0.5, 0, 0), (0.05, 0, 0), (0.02, 0, 0))
    for k, (size, middle) in enumerate(zip(sizes, middles, strict=True)):
        box = trimesh.creation.box(extents=size)
        box.apply_translation(middle)
        fine = box.subdivide().subdivide().subdivide()
        put(package, f"meshes/visual/link_{k}.stl", fine.export(file_type="stl"))
        put(package, f"meshes/collision/link_{k}.stl", box.export(file_type="stl_ascii"))
    steps = [
        (xyz, axis if k < 2 else tuple(-v for v in axis))
        for k, (xyz, axis) in enumerate(elbow(0.565, 0.15, 0.87, 0.17, 1.016, 0.175))
    ]
    text = arm(steps, HEAVY, (0.0, 0.0, 0.0), inside=lambda k: _mesh("m7", f"link_{k}"))
    return put(package, "urdf/m7.urdf", robot(text))


def with_dae(folder: Path) -> Path:
    """As Staubli's TX: COLLADA meshes by relative paths, a scale, an axis that is not normalised."""
    import trimesh

    for k in range(7):
        ball = trimesh.creation.icosphere(subdivisions=2, radius=80.0)
        put(folder, f"meshes/link_{k}.dae", ball.export(file_type="dae"))
    steps = elbow(0.55, 0.15, 0.825, 0.0, 0.625, 0.11)
    steps[1] = (steps[1][0], (0.0, 2.0, 0.0))
    geometry = '<visual><geometry><mesh filename="meshes/link_{}.dae" scale="0.001 0.001 0.001"/></geometry></visual>'
    return put(folder, "tx.urdf", robot(arm(steps, [0.5 * m for m in HEAVY], inside=geometry.format)))


def scara(folder: Path) -> Path:
    """Two turns, a quill that slides, a turn."""
    parts = [link("base_link", 12), link("inner", 8), link("outer", 6), link("quill", 1), link("shaft", 0.3)]
    parts += [
        joint("j1", "base_link", "inner", (0, 0, 0.4), Z),
        joint("j2", "inner", "outer", (0.35, 0, 0), Z),
        joint("j3", "outer", "quill", (0.3, 0, 0), Z, (-0.2, 0.0), kind="prismatic"),
        joint("j4", "quill", "shaft", (0, 0, -0.1), Z),
    ]
    return put(folder, "scara.urdf", robot("\n".join(parts)))


def scara_fixed(folder: Path) -> Path:
    """The same with its quill fixed, as `qsf new` says."""
    file = scara(folder)
    text = file.read_text().replace('type="prismatic"', 'type="fixed"')
    return put(folder, "scara.urdf", text)


def gantry(folder: Path) -> Path:
    """Three slides, and a wrist of two joints."""
    parts = [
        link("base_link", 400),
        link("bridge", 300),
        link("carriage", 120),
        link("ram", 80),
        link("c", 20),
        link("b", 10),
    ]
    parts += [
        joint("x", "base_link", "bridge", (0, 0, 2.5), X, (0.0, 4.0), kind="prismatic"),
        joint("y", "bridge", "carriage", (0, 0, 0), Y, (0.0, 2.0), kind="prismatic"),
        joint("z", "carriage", "ram", (0, 0, 0), Z, (-1.0, 0.0), kind="prismatic"),
        joint("c", "ram", "c", (0, 0, -0.5), Z),
        joint("b", "c", "b", (0, 0, -0.2), Y),
    ]
    return put(folder, "gantry.urdf", robot("\n".join(parts)))


def helper_links(folder: Path) -> Path:
    """As Dobot's Magician: a plate without a size that keeps level by two mimics, bars without mass beside the arm."""
    parts = [link("magician_root"), link("base", 2), link("turret", 1.2), link("rear", 0.4), link("fore", 0.3)]
    parts += [link("level"), link("plate"), link("tip", 0.1), link("bar")]
    parts += [
        joint("root", "magician_root", "base"),
        joint("joint_1", "base", "turret", (0, 0, 0.138), Z, (-2.2, 2.2)),
        joint("joint_2", "turret", "rear", (0, 0, 0), Y, (0.0, 1.48)),
        joint("mimic_1", "rear", "level", (0, 0, 0.135), Y, (-1.48, 0.0), more=mimic("joint_2", -1.0)),
        joint("joint_3", "level", "fore", (0, 0, 0), Y, (-0.17, 1.57)),
        joint("mimic_2", "fore", "plate", (0.147, 0, 0), Y, (-1.57, 0.17), more=mimic("joint_3", -1.0)),
        joint("joint_4", "plate", "tip", (0.06, 0, 0), Z, (-2.6, 2.6)),
        joint("bar_joint", "turret", "bar", (-0.03, 0, 0), Y, None, more=mimic("joint_2")),
    ]
    return put(folder, "magician.urdf", robot("\n".join(parts)))


def palletizer(folder: Path) -> Path:
    """Four motors; elbow and wrist level themselves by mimic, a heavy rod follows axis 2, an angle has an offset."""
    parts = [link("base_link", 400), link("turret", 300), link("lower", 200), link("knee", 30), link("upper", 120)]
    parts += [link("head", 30), link("flange", 20), link("rod", 60)]
    parts += [
        joint("axis_1", "base_link", "turret", (0, 0, 0.8), Z, (-3.1, 3.1)),
        joint("axis_2", "turret", "lower", (0.26, 0, 0), Y, (-0.7, 1.4)),
        joint("level_knee", "lower", "knee", (0, 0, 1.2), Y, (-1.5, 0.8), more=mimic("axis_2", -1.0, 0.1)),
        joint("axis_3", "knee", "upper", (0, 0, 0), Y, (-0.3, 1.9), rpy=(0, -0.1, 0)),
        joint("level_head", "upper", "head", (1.5, 0, 0), Y, (-1.9, 0.3), more=mimic("axis_3", -1.0)),
        joint("axis_6", "head", "flange", (0.25, 0, -0.2), (0, 0, -1), (-5.0, 5.0)),
        joint("rod_joint", "turret", "rod", (0.1, 0.2, 0.1), Y, None, more=mimic("axis_2", 1.0)),
    ]
    return put(folder, "palletizer.urdf", robot("\n".join(parts)))


def spaced_names(folder: Path) -> Path:
    """As Doosan's: efforts of every joint, masses with inertias of no body, names with dots and a space."""
    text = arm(elbow(0.1525, 0.03, 0.62, 0.03, 0.559, 0.121), LIGHT, joint_name="dsr.joint {}", link_name="dsr.link {}")
    text = text.replace('ixx="0.168"', 'ixx="9"')
    for k, effort in enumerate((411, 411, 225, 90, 90, 45)):
        text = text.replace('effort="0"', f'effort="{effort}."', 1) if k >= 0 else text
    return put(folder, "m10.urdf", robot(text))


def forwarded(folder: Path) -> Path:
    """As xArm's: parameters forwarded by ^ with defaults after |, limits on or off, a table of lists."""
    steps = elbow(0.267, 0.0, 0.289, 0.0, 0.342, 0.097)
    put(
        folder,
        "config/kin.yaml",
        "".join(f"joint{k + 1}: [{row(xyz).replace(' ', ', ')}]\n" for k, (xyz, _) in enumerate(steps)),
    )
    turns = "".join(
        f"""<xacro:joint_of k="{k + 1}" axis="{row(axis)}"/>\n    <link name="${{prefix}}link{k + 1}"><inertial>
      <mass value="{LIGHT[k + 1]}"/><inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial></link>"""
        for k, (_, axis) in enumerate(steps)
    )
    text = f"""<xacro:property name="prefix" value=""/><xacro:property name="limited" value="true"/>
  <xacro:property name="lower_limit" value="${{-2*pi + 3.5}}"/>
  <xacro:macro name="joint_of"
      params="k axis prefix:=^|arm_ kin:=^ limited:=^|false lower:=${{lower_limit}} upper:='2.7'">
    <joint name="${{prefix}}joint${{k}}" type="revolute"><parent link="${{prefix}}link${{k - 1}}"/>
      <child link="${{prefix}}link${{k}}"/><xacro:property name="at" value="${{kin['joint' + str(k)]}}"/>
      <origin xyz="${{at[0]}} ${{at[1]}} ${{at[2]}}" rpy="0 0 0"/><axis xyz="${{axis}}"/>
      <xacro:if value="${{limited}}"><limit lower="${{lower}}" upper="${{upper}}" effort="50" velocity="3"/></xacro:if>
      <xacro:unless value="${{limited}}"><limit lower="-6" upper="6" effort="50" velocity="3"/></xacro:unless></joint>
  </xacro:macro>
  <xacro:macro name="xarm" params="prefix:=^ limited:=^ kin_file:='config/kin.yaml'">
    <xacro:property name="kin" value="${{load_yaml(kin_file)}}"/><link name="${{prefix}}link0"/>
    {turns}
  </xacro:macro>
  <xacro:xarm/>"""
    return put(folder, "xarm.urdf.xacro", robot(text, xacro=True))


def minus_axes(folder: Path) -> Path:
    """As Kawasaki's: every second axis the other way round, simple solids for collisions in place of meshes."""
    steps = [
        (xyz, tuple(v * (-1) ** k for v in axis))
        for k, (xyz, axis) in enumerate(elbow(0.43, 0.1, 0.45, 0.1, 0.45, 0.09))
    ]
    solid = '<visual><geometry><mesh filename="package://gone/m{}.stl"/></geometry></visual><collision><geometry>'
    solid += '<cylinder radius="0.04" length="0.1"/></geometry></collision>'
    return put(folder, "rs.urdf", robot(arm(steps, [0.2 * m for m in HEAVY], inside=solid.format)))


def skewed(folder: Path) -> Path:
    """As a Comau with its base on a wedge: turned origins in degrees by arithmetic, axes askew, OBJ meshes."""
    import trimesh

    box = trimesh.creation.box(extents=(0.3, 0.2, 0.4)).export(file_type="obj")
    put(folder, "meshes/part.obj", box if isinstance(box, bytes) else box.encode())
    mesh = '<visual><geometry><mesh filename="file://meshes/part.obj"/></geometry></visual>'
    steps = elbow(0.9, 0.4, 1.15, 0.25, 1.5, 0.24)
    steps[3] = (steps[3][0], (0.96, 0.0, 0.28))
    text = arm(steps, HEAVY, inside=lambda k: mesh if k in (1, 2) else "")
    wedge = '<origin xyz="0 0 0.9" rpy="0 ${15*pi/180} ${-30*(pi/180)}"/>'
    text = text.replace('<origin xyz="0 0 0.9" rpy="0 0 0"/>', wedge)
    return put(folder, "smart.xacro", robot(text, xacro=True))


def switched(folder: Path) -> Path:
    """As Denso's: an argument without a default, a world joint by if and unless, an include in an include."""
    put(folder, "inc/lengths.xacro", robot('<xacro:property name="upper" value="${0.21 + 0.105*2}"/>', xacro=True))
    put(folder, "inc/all.xacro", robot('<xacro:include filename="lengths.xacro"/>', xacro=True))
    text = arm(elbow(0.475, 0.18, 0.4242, 0.1, 0.385, 0.09), LIGHT).replace("0 0 0.4242", "0 0 ${upper}")
    text = f"""<xacro:include filename="inc/all.xacro"/><xacro:property name="on_wall" value="$(arg wall)"/>
  <xacro:if value="${{on_wall}}"><link name="wall"/>{joint("w", "wall", "base_link", rpy=(0, 1.5708, 0))}</xacro:if>
  <xacro:unless value="${{on_wall}}"><link name="world"/>{joint("w", "world", "base_link")}</xacro:unless>
{text}"""
    return put(folder, "vs.urdf.xacro", robot(text, xacro=True))


def offset_wrist(folder: Path) -> Path:
    """As Techman's: three parallel axes, a camera on the wrist, inertias of zero, no efforts."""
    steps = [((0.0, 0.0, 0.145), Z), ((0.0, 0.15, 0.0), Y), ((0.0, 0.0, 0.43), Y), ((0.0, 0.0, 0.41), Y)]
    steps += [((0.0, 0.1, 0.1), Z), ((0.0, 0.1, 0.1), Y)]
    text = arm(steps, LIGHT).replace('ixx="0.006"', 'ixx="0"')
    more = [link("camera"), joint("eye", "link_6", "camera", (0, 0.05, 0.07), rpy=(0.3, 0, 0))]
    return put(folder, "tm.urdf", robot(text + "\n" + "\n".join(more)))


def two_arms(folder: Path) -> Path:
    """One macro, a left and a right arm on a column."""
    one = arm(
        elbow(0.2, 0.0, 0.3, 0.0, 0.3, 0.1),
        LIGHT,
        link_name="SIDE_link_{}",
        joint_name="SIDE_joint_{}",
        base="SIDE_base",
    )
    one = one.replace('"tool0"', '"SIDE_tool0"').replace("SIDE", "${side}")
    text = f"""<xacro:macro name="arm" params="side *place">{one}
    <joint name="${{side}}_mount" type="fixed"><xacro:insert_block name="place"/><parent link="column"/>
      <child link="${{side}}_base"/></joint></xacro:macro>
  <link name="column"/>
  <xacro:arm side="left"><origin xyz="0 0.3 1" rpy="${{-pi/2}} 0 0"/></xacro:arm>
  <xacro:arm side="right"><origin xyz="0 -0.3 1" rpy="${{pi/2}} 0 0"/></xacro:arm>"""
    return put(folder, "dual.xacro", robot(text, xacro=True))


def on_a_lift(folder: Path) -> Path:
    """A cart with wheels and a lift, the arm upon it."""
    cart = [
        link("cart", 80),
        link("lift", 12),
        joint("rise", "cart", "lift", (0, 0, 0.5), Z, (0.0, 0.4), kind="prismatic"),
    ]
    for k in range(2):
        cart += [link(f"wheel_{k}", 3), joint(f"roll_{k}", "cart", f"wheel_{k}", (0, k - 0.5, 0.1), Y, None)]
    text = arm(elbow(0.15, 0.0, 0.4, 0.0, 0.4, 0.1), LIGHT)
    return put(folder, "mobile.urdf", robot("\n".join(cart) + "\n" + text + "\n" + joint("m", "lift", "base_link")))


def denavit(folder: Path) -> Path:
    """A table of the manual, modified, in place of a URDF."""
    rows = "joint,a_mm,alpha_deg,d_mm,theta_deg,min_deg,max_deg\n"
    for k, (a, alpha, d, theta) in enumerate(
        ((0, 0, 660, 0), (300, -90, 0, -90), (1000, 0, 0, 0), (150, -90, 1100, 0), (0, 90, 0, 0), (0, -90, 200, 180)), 1
    ):
        rows += f"J{k},{a},{alpha},{d},{theta},-150,{150 - 10 * k}\n"
    return put(folder, "arm.csv", rows)


STRANGERS = (
    Stranger(name="ur_like", like="Universal Robots e-series: YAML tables by load_yaml", write=table_arm),
    Stranger(name="es_like", like="Motoman ES: macro, package beside it, lost meshes", write=macro_arm),
    Stranger(name="painter_like", like="ABB IRB 5400: mimic in a hollow wrist", write=hollow_wrist),
    Stranger(name="irb_like", like="ABB IRB 6640: frames base, flange, tool0, no masses", write=plain_elbow),
    Stranger(name="kr_like", like="KUKA KR210: continuous joint, sliding gripper", write=with_gripper),
    Stranger(name="iiwa_like", like="KUKA iiwa: seven axes, turned frames", write=seven_axes, axes=7),
    Stranger(name="fr_like", like="Franka: YAML by attribute, blocks, a hand", write=with_hand, axes=7),
    Stranger(name="m7_like", like="FANUC M-710iC: STL meshes, minus axes", write=with_meshes),
    Stranger(name="tx_like", like="Staubli TX: COLLADA, scale, an axis of length 2", write=with_dae),
    Stranger(
        name="scara",
        like="SCARA: a slide between turns",
        write=scara,
        axes=4,
    ),
    Stranger(name="scara_fixed", like="the same, its slide fixed", write=scara_fixed, axes=3),
    Stranger(
        name="gantry",
        like="gantry: three slides, two turns",
        write=gantry,
        axes=5,
    ),
    Stranger(name="magician_like", like="Dobot Magician: helper links without size, mimic", write=helper_links, axes=4),
    Stranger(name="palletizer", like="palletizer: mimic with offset, a heavy rod", write=palletizer, axes=4),
    Stranger(name="m10_like", like="Doosan: efforts, dots and spaces in names", write=spaced_names),
    Stranger(name="xarm_like", like="xArm: parameters forwarded by ^, with defaults", write=forwarded),
    Stranger(name="rs_like", like="Kawasaki: minus axes, solids for collisions", write=minus_axes),
    Stranger(name="smart_like", like="Comau: arithmetic in degrees, skew axis, OBJ", write=skewed),
    Stranger(name="vs_like", like="Denso: argument, if and unless", write=switched, options=("--arg", "wall=false")),
    Stranger(name="tm_like", like="Techman: three parallel axes, inertias of zero", write=offset_wrist),
    Stranger(name="dual", like="two arms of one macro", write=two_arms, refused=r"2 chains.*left_link_6 \(6 joints\)"),
    Stranger(name="dual_left", like="the same, one arm named", write=two_arms, options=("--flange", "left_tool0")),
    Stranger(
        name="mobile",
        like="arm on a cart with a lift",
        write=on_a_lift,
        options=("--base", "lift", "--flange", "tool0"),
    ),
    Stranger(name="table", like="a modified Denavit-Hartenberg table", write=denavit, options=("--modified",)),
)
"""The files, each with what it stands for."""

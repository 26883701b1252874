"""More robot files as strangers bring them: of makers, and of structures, that strangers.py does not have."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from strangers import HEAVY, LIGHT, Stranger, Vector, X, Y, Z, _seven, arm, elbow, joint, link, mimic, put, robot, row


def limb(to: Vector, radius: float = 0.08, tag: str = "visual", whole: float = 0.9) -> str:
    """A cylinder from a joint towards the next, which lies along an axis."""
    length = whole * float(np.linalg.norm(to)) or 2.0 * radius
    rpy = (0.0, np.pi / 2, 0.0) if abs(to[0]) > 0 else (np.pi / 2, 0.0, 0.0) if abs(to[1]) > 0 else (0.0, 0.0, 0.0)
    place = f'<origin xyz="{row([0.5 * v for v in to])}" rpy="{row(rpy)}"/>'
    return f'<{tag}>{place}<geometry><cylinder radius="{radius:g}" length="{length:g}"/></geometry></{tag}>'


def limbs(steps: Sequence[tuple[Vector, Vector]], radius: float = 0.08, tag: str = "visual") -> Callable[[int], str]:
    """Cylinders for all links of a chain, thinner towards the flange."""
    ends = [*(xyz for xyz, _ in steps), (0.0, 0.0, 0.0)]
    return lambda k: limb(ends[k], radius * 0.85**k, tag)


def fork(folder: Path, name: str, size: Vector, wall: float = 0.25) -> None:
    """A mesh of three plates, open to one side: its hull is far larger than itself."""
    import trimesh

    x, y, z = size
    plates = [
        ((x, wall * y, z), (0.0, 0.5 * (1 - wall) * y, 0.0)),
        ((x, wall * y, z), (0.0, -0.5 * (1 - wall) * y, 0.0)),
    ]
    plates.append(((wall * x, y, z), (-0.5 * (1 - wall) * x, 0.0, 0.0)))
    boxes = []
    for extents, middle in plates:
        box = trimesh.creation.box(extents=extents)
        box.apply_translation(middle)
        boxes.append(box)
    put(folder, name, trimesh.util.concatenate(boxes).export(file_type="stl"))


def continuous_wrist(folder: Path) -> Path:
    """As Mitsubishi's RV: joints 4 and 6 continuous with limits, no masses, cylinders to draw."""
    steps = elbow(0.35, 0.1, 0.34, 0.05, 0.37, 0.085)
    text = arm(steps, inside=limbs(steps, 0.07))
    for k in (4, 6):
        text = text.replace(f'name="joint_{k}" type="revolute"', f'name="joint_{k}" type="continuous"')
    return put(folder, "rv.urdf", robot(text))


def forked(folder: Path) -> Path:
    """As Nachi's MZ: STL meshes in mm that are not convex, places by text.split in a xacro."""
    steps = elbow(0.345, 0.05, 0.33, 0.045, 0.34, 0.073)
    for k in range(7):
        fork(folder, f"meshes/link_{k}.stl", (0.16 - 0.01 * k, 0.18 - 0.015 * k, 0.2 - 0.02 * k))
    mesh = '<collision><geometry><mesh filename="meshes/link_{}.stl"/></geometry></collision>'
    text = arm(steps, LIGHT, inside=mesh.format)
    text = text.replace('xyz="0 0 0.33"', "xyz=\"0 0 ${lengths.split(' ')[2]}\"")
    head = '<xacro:property name="lengths" value="0.345 0.05 0.33"/>\n'
    return put(folder, "mz.xacro", robot(head + text, xacro=True))


def drawn_balancer(folder: Path) -> Path:
    """As Hyundai's HS: a gas spring between two frames of the URDF, heavy links with boxes."""
    steps = elbow(0.65, 0.25, 1.05, 0.2, 1.3, 0.22)
    text = arm(steps, HEAVY, inside=limbs(steps, 0.18))
    more = [
        link("gas_spring_housing", 40),
        joint("housing", "link_1", "gas_spring_housing", (-0.55, 0.25, 0.1), Y),
        link("gas_spring_eye"),
        joint("eye", "link_2", "gas_spring_eye", (-0.2, 0.25, 0.1)),
    ]
    return put(folder, "hs.urdf", robot(text + "\n" + "\n".join(more)))


def boxed_scara(folder: Path) -> Path:
    """As Epson's G: a SCARA with boxes, its quill turning and sliding in one."""

    def box(size: Vector, at: Vector) -> str:
        geometry = f'<geometry><box size="{row(size)}"/></geometry>'
        return f'<visual><origin xyz="{row(at)}"/>{geometry}</visual>'

    parts = [
        link("base_link", 20, box((0.2, 0.2, 0.35), (-0.05, 0, 0.16))),
        link("arm_1", 9, box((0.35, 0.16, 0.1), (0.15, 0, 0.05))),
        link("arm_2", 7, box((0.35, 0.15, 0.14), (0.13, 0, 0.1))),
        link("spline", 1, box((0.04, 0.04, 0.3), (0, 0, -0.1))),
        link("flange", 0.3),
        joint("J1", "base_link", "arm_1", (0, 0, 0.36), Z, (-2.3, 2.3)),
        joint("J2", "arm_1", "arm_2", (0.325, 0, 0.11), Z, (-2.5, 2.5)),
        joint("J3", "arm_2", "spline", (0.275, 0, 0), Z, (-0.18, 0.0), kind="prismatic"),
        joint("J4", "spline", "flange", (0, 0, -0.25), Z, (-6.2, 6.2)),
    ]
    return put(folder, "g6.urdf", robot("\n".join(parts)))


def tabled(folder: Path) -> Path:
    """As Omron's Viper: a dict in a xacro, spheres and boxes for collisions."""
    steps = elbow(0.335, 0.075, 0.365, 0.09, 0.405, 0.08)
    solid = '<collision><origin xyz="0 0 0.05"/><geometry><sphere radius="0.05"/></geometry></collision>'
    text = arm(steps, LIGHT, inside=lambda k: solid)
    text = text.replace('xyz="0 0 0.365"', "xyz=\"0 0 ${sizes['upper']}\"")
    head = '<xacro:property name="sizes" value="${dict(upper=0.365, fore=0.405)}"/>\n'
    return put(folder, "viper.xacro", robot(head + text, xacro=True))


def robotiq(parent: str) -> str:
    """A gripper whose knuckle leads five joints by mimic."""
    parts = [link("gripper_base", 0.8), joint("gripper_mount", parent, "gripper_base", (0, 0, 0.06))]
    for k, name in enumerate(("left_knuckle", "right_knuckle", "left_inner", "right_inner")):
        more = "" if k == 0 else mimic("left_knuckle_joint", (-1.0) ** k)
        parts += [
            link(name, 0.04),
            joint(f"{name}_joint", "gripper_base", name, (0, 0.03 * (-1) ** k, 0.05), X, (-0.9, 0.9), more=more),
        ]
    tip = joint(
        "left_tip_joint", "left_knuckle", "left_tip", (0, 0, 0.04), X, (-0.9, 0.9), more=mimic("left_knuckle_joint")
    )
    return "\n".join([*parts, link("left_tip", 0.02), tip])


def endless(folder: Path) -> Path:
    """As Kinova's Gen3: seven axes, every other one without an end, and a gripper of many mimics."""
    steps = _seven(0.19)
    text = arm(steps, (1.7, 1.4, 1.2, 1.2, 0.9, 0.7, 0.7, 0.4), inside=limbs(steps, 0.05))
    for k in (1, 3, 5, 7):
        text = re.sub(rf'(name="joint_{k}") type="revolute"(.*?)<limit [^>]*/>', r'\1 type="continuous"\2', text)
    return put(folder, "gen3.urdf", robot(text + "\n" + robotiq("tool0")))


def with_head(folder: Path) -> Path:
    """As Rethink's Sawyer: seven axes sideways, a head with a screen that turns, a pedestal."""
    steps = [((0.0, 0.0, 0.08), Z), ((0.08, 0.0, 0.24), Y), ((0.0, 0.19, 0.0), X), ((0.26, 0.0, 0.0), Y)]
    steps += [((0.0, -0.17, 0.0), X), ((0.27, 0.0, 0.0), Y), ((0.0, 0.13, 0.0), X)]
    text = arm(steps, (10, 5.3, 4.5, 1.7, 2.5, 1.4, 1.6, 0.4), inside=limbs(steps, 0.06))
    more = [link("head", 1.5), joint("head_pan", "link_1", "head", (0, 0, 0.3), Z), link("screen", 0.4)]
    more += [joint("screen_fixed", "head", "screen", (0.03, 0, 0.1)), link("pedestal", 60)]
    return put(folder, "sawyer.urdf", robot(text + "\n" + "\n".join([*more, joint("stand", "pedestal", "base_link")])))


def forked_cobot(folder: Path) -> Path:
    """As Aubo's i10: three parallel axes, forks for collisions, an unreadable mesh to draw."""
    steps = [((0.0, 0.0, 0.16), Z), ((0.0, 0.2, 0.0), Y), ((0.65, 0.0, 0.0), Y), ((0.55, 0.0, 0.0), Y)]
    steps += [((0.0, 0.1, 0.0), Z), ((0.0, 0.0, 0.1), Y)]
    put(folder, "meshes/broken.stl", b"no mesh at all")
    for k in range(7):
        fork(folder, f"meshes/link_{k}.stl", (0.14, 0.14, 0.14))

    def inside(k: int) -> str:
        kinds = ["collision", *(["visual"] if k == 2 else [])]
        names = {"collision": f"link_{k}", "visual": "broken"}
        return "".join(f'<{t}><geometry><mesh filename="meshes/{names[t]}.stl"/></geometry></{t}>' for t in kinds)

    return put(folder, "i10.urdf", robot(arm(steps, LIGHT, inside=inside)))


def doubled_keys(folder: Path) -> Path:
    """As JAKA's Zu: a YAML of masses in which a key stands twice."""
    steps = elbow(0.12, 0.0, 0.43, 0.0, 0.37, 0.12)
    put(folder, "config/masses.yaml", "link_1: {mass: 4}\nlink_2:\n  mass: 1\n  mass: 8\n")
    text = arm(steps, LIGHT, inside=limbs(steps, 0.06)).replace(
        f'<mass value="{LIGHT[2]:g}"/>', "<mass value=\"${masses['link_2']['mass']}\"/>"
    )
    head = '<xacro:property name="masses" value="${xacro.load_yaml(\'config/masses.yaml\')}"/>\n'
    return put(folder, "zu.xacro", robot(head + text, xacro=True))


def dummy_base(folder: Path) -> Path:
    """As Elite's EC: a dummy before the base, box solids, a tool flange by another name."""
    steps = [((0.0, 0.0, 0.14), Z), ((0.0, 0.12, 0.0), Y), ((0.0, 0.0, 0.43), Y), ((0.0, 0.0, 0.38), Y)]
    steps += [((0.0, 0.1, 0.0), Z), ((0.0, 0.0, 0.09), Y)]
    text = arm(steps, LIGHT, inside=limbs(steps, 0.055)).replace("tool0", "ec_flange")
    return put(folder, "ec.urdf", robot(link("dummy") + joint("fix", "dummy", "base_link") + "\n" + text))


def printed_arm(folder: Path) -> Path:
    """As igus's ReBeL: efforts of all joints, cylinders for collisions, a gripper of two slides."""
    steps = elbow(0.25, 0.0, 0.24, 0.0, 0.3, 0.1)
    text = arm(steps, LIGHT, inside=limbs(steps, 0.055, "collision"))
    for effort in (80, 80, 60, 20, 20, 10):
        text = text.replace('effort="0"', f'effort="{effort}"', 1)
    more = [
        *(link(name, 0.1) for name in ("left", "right")),
        joint("l", "tool0", "left", (0, 0.02, 0.05), Y, (0.0, 0.02), kind="prismatic"),
        joint("r", "tool0", "right", (0, -0.02, 0.05), Y, (-0.02, 0.0), kind="prismatic", more=mimic("l", -1)),
    ]
    return put(folder, "rebel.urdf", robot(text + "\n" + "\n".join(more)))


def school_arm(folder: Path) -> Path:
    """As Niryo's Ned: a turning gripper motor with two gears that follow it, no link with a flange's name."""
    steps = elbow(0.1, 0.0, 0.22, 0.03, 0.22, 0.05)
    text = arm(steps, LIGHT, inside=limbs(steps, 0.04)).replace("tool0", "hand_link")
    more = [
        *(link(name, 0.05) for name in ("motor", "gear_left", "gear_right")),
        joint("motor_joint", "hand_link", "motor", (0.03, 0, 0), X, (-1.0, 1.0)),
        joint("gear_l", "hand_link", "gear_left", (0.03, 0.02, 0), X, (-1.0, 1.0), more=mimic("motor_joint")),
        joint("gear_r", "hand_link", "gear_right", (0.03, -0.02, 0), X, (-1.0, 1.0), more=mimic("motor_joint", -1)),
    ]
    return put(folder, "ned.urdf", robot(text + "\n" + "\n".join(more)))


def many_balls(folder: Path) -> Path:
    """As Flexiv's Rizon: seven axes, several spheres for collisions in each link, inertias by macro."""
    steps = _seven(0.2)

    def balls(k: int) -> str:
        shape = '<collision><origin xyz="0 0 {}"/><geometry><sphere radius="{}"/></geometry></collision>'
        return "".join(shape.format(f"{0.06 * i:g}", f"{0.065 - 0.005 * k:g}") for i in range(3))

    masses = (5, 3.6, 2.7, 2.6, 2.3, 2.2, 1.5, 0.7)
    return put(folder, "rizon.urdf", robot(arm(steps, masses, inside=balls, tool=(0, 0, 0.08))))


def mimicked_slides(folder: Path) -> Path:
    """As AgileX's Piper: two finger slides, one of them by mimic, on the last link; no tool frame."""
    steps = elbow(0.123, 0.0, 0.285, 0.0, 0.25, 0.09)
    text = arm(steps, LIGHT, inside=limbs(steps, 0.035)).replace("tool0", "gripper_base")
    more = [
        *(link(name, 0.02) for name in ("link7", "link8")),
        joint("joint7", "gripper_base", "link7", (0, 0, 0.13), Y, (0.0, 0.035), kind="prismatic"),
        joint(
            "joint8",
            "gripper_base",
            "link8",
            (0, 0, 0.13),
            Y,
            (-0.035, 0.0),
            kind="prismatic",
            more=mimic("joint7", -1),
        ),
    ]
    return put(folder, "piper.urdf", robot(text + "\n" + "\n".join(more)))


def propeller(folder: Path) -> Path:
    """As Trossen's wx250: a spinner on the last axis, fingers that slide, prefixes with slashes, ee_gripper frames."""
    steps = elbow(0.11, 0.0, 0.25, 0.05, 0.25, 0.07)
    text = arm(steps, [0.3 * m for m in LIGHT], inside=limbs(steps, 0.03), link_name="wx250/link_{}", base="wx250/base")
    text = text.replace("tool0", "wx250/ee_arm_link")
    more = [
        *(link(f"wx250/{name}", 0.03) for name in ("gripper_prop", "left_finger", "right_finger")),
        joint("gripper", "wx250/ee_arm_link", "wx250/gripper_prop", (0.01, 0, 0), X, None),
        joint("left_finger", "wx250/ee_arm_link", "wx250/left_finger", (0.05, 0, 0), Y, (0.01, 0.03), kind="prismatic"),
        joint(
            "right_finger",
            "wx250/ee_arm_link",
            "wx250/right_finger",
            (0.05, 0, 0),
            Y,
            (-0.03, -0.01),
            kind="prismatic",
            more=mimic("left_finger", -1),
        ),
    ]
    return put(folder, "wx250.urdf", robot(text + "\n" + "\n".join(more)))


def level_head(folder: Path) -> Path:
    """As Estun's palletizer: five axes of which three are parallel, with solids; the level head drawn as a motor."""
    steps = [
        ((0.0, 0.0, 0.6), Z),
        ((0.3, 0.0, 0.2), Y),
        ((0.0, 0.0, 1.1), Y),
        ((1.2, 0.0, 0.0), Y),
        ((0.2, 0.0, -0.2), Z),
    ]
    text = arm(steps, HEAVY[:6], inside=limbs(steps, 0.12))
    return put(folder, "er.urdf", robot(text))


def on_a_track(folder: Path) -> Path:
    """As Guedel's and Cloos's welding cells: an arm that hangs from a carriage on a track, solids throughout."""
    steps = elbow(0.3, 0.1, 0.55, 0.1, 0.6, 0.1)
    carriage = '<visual><geometry><box size="0.5 0.5 0.15"/></geometry></visual>'
    text = arm(steps, [0.3 * m for m in HEAVY], inside=limbs(steps, 0.08))
    rail = [
        link("rail", 500),
        link("carriage", 120, carriage),
        joint("track", "rail", "carriage", (0, 0, 2.5), X, (0.0, 4.0), kind="prismatic"),
        joint("hang", "carriage", "base_link", rpy=(np.pi, 0, 0)),
    ]
    return put(folder, "cell.urdf", robot("\n".join(rail) + "\n" + text))


def telescopic(folder: Path) -> Path:
    """As Rainbow's and Ewellix's columns: two stages that share a travel, and a cobot on top."""
    steps = elbow(0.17, 0.0, 0.45, 0.0, 0.4, 0.11)
    follow = mimic("lift", 0.5)
    lift = [
        *(link(name, 15.0) for name in ("foot", "stage_1", "stage_2")),
        link("shown"),
        joint("lift", "foot", "shown", axis=Z, limits=(0.0, 0.9), kind="prismatic"),
        joint("lift_1", "foot", "stage_1", (0, 0, 0.5), Z, (0.0, 0.45), kind="prismatic", more=follow),
        joint("lift_2", "stage_1", "stage_2", (0, 0, 0.1), Z, (0.0, 0.45), kind="prismatic", more=follow),
        joint("plate", "stage_2", "base_link", (0, 0, 0.2)),
    ]
    return put(folder, "column.urdf", robot("\n".join(lift) + "\n" + arm(steps, LIGHT, inside=limbs(steps, 0.055))))


def gripper_alone(folder: Path) -> Path:
    """As Robotiq's own file: no arm at all."""
    return put(folder, "2f85.urdf", robot(link("tool0") + "\n" + robotiq("tool0")))


MORE = (
    Stranger(name="rv_like", like="Mitsubishi RV: continuous joints with limits, no masses", write=continuous_wrist),
    Stranger(name="mz_like", like="Nachi MZ: meshes that are not convex, text.split in a xacro", write=forked),
    Stranger(name="hs_like", like="Hyundai HS: a gas spring between two frames", write=drawn_balancer),
    Stranger(name="g6_like", like="Epson G: a SCARA of boxes", write=boxed_scara, axes=4),
    Stranger(name="viper_like", like="Omron Viper: dict in a xacro, spheres for collisions", write=tabled),
    Stranger(name="gen3_like", like="Kinova Gen3: endless joints, a gripper of five mimics", write=endless, axes=7),
    Stranger(
        name="sawyer_like",
        like="Rethink Sawyer: a head beside the arm",
        write=with_head,
        axes=7,
        options=("--flange", "tool0"),
    ),
    Stranger(name="i10_like", like="Aubo i10: forks for collisions, an unreadable mesh", write=forked_cobot),
    Stranger(name="zu_like", like="JAKA Zu: a YAML key that stands twice", write=doubled_keys),
    Stranger(name="ec_like", like="Elite EC: a dummy base, a flange with a prefix", write=dummy_base),
    Stranger(name="rebel_like", like="igus ReBeL: efforts, cylinders for collisions, two slides", write=printed_arm),
    Stranger(name="ned_like", like="Niryo Ned: a motor whose gears follow it", write=school_arm),
    Stranger(name="rizon_like", like="Flexiv Rizon: seven axes of balls", write=many_balls, axes=7),
    Stranger(name="piper_like", like="AgileX Piper: slides by mimic, no tool frame", write=mimicked_slides),
    Stranger(name="wx_like", like="Trossen wx250: a spinner, names with slashes", write=propeller),
    Stranger(name="er_like", like="Estun palletizer: three parallel axes", write=level_head, axes=5),
    Stranger(name="cell_like", like="Guedel and Cloos: an arm that hangs from a track", write=on_a_track, axes=7),
    Stranger(name="column_like", like="Rainbow and Ewellix: a telescopic column", write=telescopic, axes=7),
    Stranger(
        name="gripper_alone",
        like="Robotiq 2F-85 without an arm",
        write=gripper_alone,
        refused="those of a gripper; there is no arm",
    ),
)
"""Of makers whose files the ones before do not stand for."""

"""URDFs of small arms that slide: a gantry with a wrist, a SCARA, and an arm on a track."""

from __future__ import annotations

from pathlib import Path

_LIMITS = {"prismatic": (-0.6, 1.4), "revolute": (-2.0, 2.2)}


def link(name: str, mass: float = 40.0, centre: str = "0.1 0.05 0.2") -> str:
    inertia = '<inertia ixx="2" iyy="2" izz="2" ixy="0.1" ixz="0.05" iyz="-0.08"/>'
    solid = '<visual><geometry><box size="0.08 0.08 0.08"/></geometry></visual>'
    inertial = f'<inertial><origin xyz="{centre}"/><mass value="{mass}"/>{inertia}</inertial>'
    return f'<link name="{name}">{inertial}{solid}</link>'


def joint(name: str, parent: str, child: str, kind: str, axis: str, xyz: str, rpy: str) -> str:
    lower, upper = _LIMITS[kind]
    limit = f'<limit lower="{lower}" upper="{upper}" effort="1000" velocity="1"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>{limit}</joint>'
    )


def urdf(name: str, joints: list[tuple[str, str, str]]) -> str:
    """joints: of a chain, each its kind, axis and place."""
    names = ["base", *(f"l{k}" for k in range(1, len(joints) + 1))]
    parts = [link(n, 200.0 / (k + 1)) for k, n in enumerate(names)]
    parts += [
        joint(f"j{k + 1}", names[k], names[k + 1], kind, axis, xyz, "0 0 0" if k % 2 else "0.1 -0.2 0.3")
        for k, (kind, axis, xyz) in enumerate(joints)
    ]
    return f'<robot name="{name}">{"".join(parts)}</robot>'


_WRIST = [("revolute", "0 0 1", "0.1 0 -0.4"), ("revolute", "0 1 0", "0 0 -0.2"), ("revolute", "1 0 0", "0.1 0 -0.1")]
ARMS = {
    "gantry": urdf(
        "gantry",
        [
            ("prismatic", "1 0 0", "0 0 2"),
            ("prismatic", "0 1 0", "0 0.2 0.3"),
            ("prismatic", "0.6 0 -0.8", "0.1 0 0"),
            *_WRIST,
        ],
    ),
    "scara": urdf(
        "scara",
        [
            ("revolute", "0 0 1", "0 0 0.4"),
            ("revolute", "0 0 1", "0.5 0 0"),
            ("prismatic", "0 0 -1", "0.4 0 0"),
            ("revolute", "0 0 1", "0 0 -0.1"),
        ],
    ),
    "tracked": urdf(
        "tracked",
        [
            ("prismatic", "0 1 0", "0 0 0.2"),
            ("revolute", "0 0 1", "0 0 0.5"),
            ("revolute", "0 1 0", "0.3 0 0.4"),
            ("revolute", "0 1 0", "0 0 0.9"),
            ("revolute", "1 0 0", "0.8 0 0.1"),
            ("revolute", "0 1 0", "0.2 0 0"),
            ("revolute", "1 0 0", "0.2 0 0"),
        ],
    ),
}


def robot_yaml(name: str, text: str, effects: str = "") -> str:
    rows: list[str] = []
    for part in text.split("<joint ")[1:]:
        own = part.split('"')[1]
        slides = "prismatic" in part
        rows.append(f"  {own}: {{limits_{'mm' if slides else 'deg'}: {[-600, 1400] if slides else [-110, 120]}}}")
    lines = "\n".join(rows)
    return (
        f"name: {name}\ntitle: {name}\nurdf: {name}.urdf\nbase: base\nflange: l{len(rows)}\npayload_kg: 60\n"
        f"controller:\n{lines}\neffects:\n  - {{effect: joint_compliance, joints: all}}\n{effects}"
        "nominal: nominal.yaml\n"
    )


def nominal_yaml(text: str) -> str:
    rows: list[str] = []
    for part in text.split("<joint ")[1:]:
        own, unit, value = part.split('"')[1], "urad/(N m)", 0.9
        if "prismatic" in part:
            unit, value = "um/N", 0.03
        rows.append(f"joint_compliance[{own}]: {{value_{unit}: {value}, sd_percent: 40, source: assumed}}")
    return "\n".join(rows) + "\n"


def write_arm(folder: Path, name: str, effects: str = "") -> Path:
    """A robot's folder of one of the ARMS."""
    own = folder / name
    own.mkdir(parents=True)
    (own / f"{name}.urdf").write_text(ARMS[name])
    (own / "robot.yaml").write_text(robot_yaml(name, ARMS[name], effects))
    (own / "nominal.yaml").write_text(nominal_yaml(ARMS[name]))
    return own

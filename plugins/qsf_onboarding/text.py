"""The words of a new robot's files."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

from qsf_onboarding.balancer import Balancer
from qsf_onboarding.chain import Build
from qsframework.robot.spec import PROPOSED, coupling_text, yaml_key
from qsframework.robot.urdf import Joint, Mimic

ControllerRow = tuple[str, str, float, float, str]
"""Of `controller:`: joint, unit, lowest and highest value, and further keys ("" for none)."""
NominalRow = tuple[str, bool, float, str]
"""Of nominal.yaml: joint, whether it slides, its assumed stiffness (N m/rad, N/m where it slides), and why that."""
_PARALLELOGRAM = """  # A parallelogram? Then the driven joint follows the driver; lever_m: axis 3 to the bar's pivot;
  # zero_deg: the angle from link 2 to the lever at zero joint angles, about the driver's axis:
  # - {{effect: parallelogram, driver: {second}, driven: {third}, lever_m: 0.5, zero_deg: -90, margin_deg: 15}}
"""
_BALANCER = """  # A balancer with its pivots across from the joint, or between any two points:
  # - {{effect: gravity_compensator, joint: {second}, lc_m: 0.25, l2_m: 1.0}}
  # - {{effect: point_spring, first: LINK, first_x_m: -0.7, first_y_m: 0, first_z_m: -0.1,
  #    second: LINK, second_x_m: -0.2, second_y_m: 0, second_z_m: 0}}
"""
_LEVEL = """  # A palletizer's head that bars keep level? Then {level} has no motor: leave it out of controller above
  # and its joint_compliance out of nominal.yaml, and take
  # - {{effect: coupling, joint: {level}, follows: {{{second}: {by_second:g}, {third}: {by_third:g}}}}}
"""


def loops_text(build: Build, senses: Sequence[float], moving: Sequence[Joint], balancer: Balancer | None) -> str:
    """The lines of `effects:` on loops and balancers: a balancer that the URDF draws, the others as comments."""
    out = "" if balancer is None else f"  - {_balancer_text(balancer)}\n"
    if build is Build.OTHER:
        return out
    second, third, *rest = (yaml_key(j.name) for j in [j for j in moving if j.kind != "prismatic"][1:])
    out += _PARALLELOGRAM.format(second=second, third=third)
    if build is Build.PALLETIZER:
        by_second, by_third = -senses[2] * senses[0], -senses[2] * senses[1]
        out += _LEVEL.format(level=rest[0], second=second, third=third, by_second=by_second, by_third=by_third)
    return out + (_BALANCER.format(second=second) if balancer is None else "")


def _balancer_text(balancer: Balancer) -> str:
    """The entry of `effects:` for a balancer that the URDF draws."""
    keys = [
        f"{end}_{axis}_m: {float(value):.6g}"
        for end, pivot in zip(("first", "second"), balancer.pivots, strict=True)
        for axis, value in zip("xyz", pivot, strict=True)
    ]
    links = f"first: {yaml_key(balancer.first)}, second: {yaml_key(balancer.second)}"
    return f"{{effect: point_spring, {links}, {', '.join(keys)}}}"


def robot_text(
    name: str,
    source: str,
    base: str,
    flange: str,
    controller: Sequence[ControllerRow],
    payload: float | None = None,
    following: Mapping[str, Mimic] | None = None,
    loops: str = "",
) -> str:
    """robot.yaml. following: the joints without an actuator; loops: lines on loops and balancers"""
    rows = "".join(
        f"  {json.dumps(j)}: {{limits_{unit}: [{lo:g}, {hi:g}]{more}}}\n" for j, unit, lo, hi, more in controller
    )
    return (
        f"name: {json.dumps(name)}\ntitle: {json.dumps(name)}\nurdf: {json.dumps(name + '.urdf')}\n"
        f"base: {json.dumps(base)}\nflange: {json.dumps(flange)}\n"
        f"controller:                       # limits of {source}; assumed: the pendant shows the URDF's angles\n{rows}"
        "effects:\n  - {effect: joint_compliance, joints: all}\n"
        + "".join(f"  - {coupling_text(joint, mimic)}\n" for joint, mimic in (following or {}).items())
        + loops
        + "nominal: nominal.yaml\n"
        + ("# payload_kg: 100\n" if payload is None else f"payload_kg: {payload:g}\n")
    )


def nominal_text(values: Sequence[NominalRow]) -> str:
    """nominal.yaml: compliances of joints."""
    out = "# All assumed, to plan with; none is measured.\n"
    for joint, slides, stiffness, why in values:
        key = json.dumps(f"joint_compliance[{joint}]")
        unit, per = ("um/N", "kN/mm") if slides else ("urad/(N m)", "MN m/rad")
        out += f"{key}:\n  value_{unit}: {1e6 / stiffness:.4g}   # K = {stiffness / 1e6:.3g} {per}\n"
        out += f'  sd_percent: 60\n  source: "{PROPOSED}: {why}"\n'
    return out


def readme_text(name: str, source: str, guessed: Sequence[str], why: str, checklist: Sequence[str]) -> str:
    """README.md with the table of sources to fill in, and the checklist. guessed: links with an assumed mass"""
    masses = f"{source}; **assumed** for {', '.join(guessed)}, see below" if guessed else source
    rows = (
        ("joint placements, axes, limits", source),
        ("pendant", "**assumed**: shows the URDF's angles"),
        ("link masses and centres", masses),
        ("joint compliances", f"**assumed** ({why}), sd 60 %"),
        ("loops and springs", "none: not known"),
    )
    table = "".join(f"| {a} | {b} |\n" for a, b in rows)
    todo = "".join(f"- [ ] {note}\n" for note in checklist)
    return f"# {name}\n\n| what | source |\n|---|---|\n{table}\n## To look up\n\n{todo}"

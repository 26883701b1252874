"""xacro files: places of their elements, and what an expression may do."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from qsframework.robot.xacro_math import evaluate

XACRO = """<robot name="small" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:include filename="parts/mass.xacro"/>
  <xacro:property name="reach" value="${0.5 + 0.3}"/>
  <xacro:macro name="turning" params="name parent child axis">
    <joint name="${name}" type="revolute">
      <parent link="${parent}"/>
      <child link="${child}"/>
      <axis xyz="${axis}"/>
      <limit lower="${-pi}" upper="${pi}" effort="0" velocity="0"/>
    </joint>
  </xacro:macro>
  <xacro:macro name="end" params="prefix">
    <link name="${prefix}tip"/>
    <joint name="${prefix}mount" type="fixed">
      <parent link="fore"/>
      <child link="${prefix}tip"/>
      <origin xyz="${reach} 0 0"/>
    </joint>
  </xacro:macro>
  <link name="base"/>
  <link name="upper"><xacro:heavy kg="10"/></link>
  <link name="fore">
    <xacro:heavy kg="5"/>
  </link>
  <xacro:turning name="shoulder" parent="base" child="upper" axis="0 1 0"/>
  <xacro:turning name="elbow" parent="upper" child="fore" axis="0 -1 0"/>
  <xacro:end prefix=""/>
</robot>
"""

MASS = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:macro name="heavy" params="kg">
    <inertial>
      <mass value="${kg}"/>
      <inertia ixx="${0.1*kg}" iyy="${0.1*kg}" izz="${0.1*kg}"/>
    </inertial>
  </xacro:macro>
</robot>
"""


@pytest.fixture
def arm(small):
    small.write("small.urdf.xacro", XACRO)
    small.write("parts/mass.xacro", MASS)
    small.edit("robot.yaml", ("small.urdf", "small.urdf.xacro"))
    return small


def test_expands(arm):
    robot = arm.load()
    assert robot.facts.masses.tolist() == [0, 10, 5]
    assert robot.flange.placement[0, 3] == pytest.approx(0.8)
    assert robot.model.upperPositionLimit.tolist() == pytest.approx([math.pi, math.pi])


def test_a_macros_number_is_placed_at_its_call(arm, told):
    arm.edit("small.urdf.xacro", ('kg="5"', 'kg="-5"'))
    problems = arm.problems()
    for problem in problems:
        told(problem, "small.urdf.xacro", arm.line("small.urdf.xacro", 'kg="-5"'), "'fore'")
    assert "positive mass" in problems[0].message


def test_a_macros_joint_is_placed_at_its_call(arm, told):
    arm.edit("small.urdf.xacro", ('axis="0 -1 0"', 'axis="0 0 0"'))
    told(arm.problem(), "small.urdf.xacro", arm.line("small.urdf.xacro", 'name="elbow"'), "'elbow'", "no direction")


def test_a_name_in_a_macros_body_is_placed_there(arm, told):
    arm.edit("small.urdf.xacro", ('<parent link="fore"', '<parent link="for"'))
    told(arm.problem(), "small.urdf.xacro", arm.line("small.urdf.xacro", "}mount"), "'mount'", "'for'")


def test_an_included_file_is_named(arm, told):
    arm.edit("parts/mass.xacro", ("</inertial>", "</inertia>"))
    told(arm.problem(), "mass.xacro", 6, "not well-formed XML")


REFUSED = {
    "bare lambda": ("${lambda: 1}", "only arithmetic"),
    "lambda": ("${(lambda: 1)()}", "not allowed"),
    "walk around the filter": ("${list(map(lambda x: x.__class__, [1]))}", "not allowed"),
    "dunder": ("${__import__('os')}", "not allowed"),
    "format": ("${'a'.format(1)}", "not allowed"),
    "comprehension": ("${[a for a in [1]]}", "only arithmetic"),
    "load_yaml": ("${xacro.load_yaml('/etc/hostname')}", "outside the robot's packages"),
    "text of a table": ("${str(xacro)}", "no number, text, list or table"),
    "text of tables": ("${str([math])}", "no number, text, list or table"),
    "table": ("${xacro}", "no number, text, list or table"),
    "function by key": ("${xacro['load_yaml']}", "is a function"),
    "length of a table": ("${len(python)}", "no number, text, list or table"),
    "unknown name": ("${reech}", "'reech' is not defined"),
    "division by zero": ("${1/0}", "division by zero"),
    "environment": ("$(env HOME)", "not allowed"),
    "eval": ("$(eval 1+1)", "not allowed"),
    "huge power": ("${9**9**9**9}", "too large"),
    "huge text": ("${'a'*999999999}", "two numbers"),
    "no end": ("${1", ""),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused_expressions(arm, name):
    expression, words = REFUSED[name]
    arm.edit("small.urdf.xacro", ('value="${0.5 + 0.3}"', f'value="{expression}"'))
    problem = arm.problem()
    assert words in str(problem).replace("Numerical result out of range", "too large"), str(problem)
    assert problem.file.endswith("small.urdf.xacro")


@pytest.mark.parametrize(
    "target", ["../outside.xacro", "/etc/hostname", "parts/../../outside.xacro", "$(find ..)/outside.xacro"]
)
def test_includes_stay_inside(arm, target):
    (arm.folder.parent / "outside.xacro").write_text(MASS)
    arm.edit("small.urdf.xacro", ("parts/mass.xacro", target))
    assert "outside the robot's folder" in str(arm.problem())


def test_a_link_out_of_the_folder_is_followed_and_refused(arm):
    outside = arm.folder.parent / "outside.xacro"
    outside.write_text(MASS)
    (arm.folder / "parts/mass.xacro").unlink()
    (arm.folder / "parts/mass.xacro").symlink_to(outside)
    assert "outside the robot's folder" in str(arm.problem())


def test_find_means_a_folder_of_the_robot(arm):
    arm.edit("small.urdf.xacro", ("parts/mass.xacro", "$(find parts)/mass.xacro"))
    assert arm.load().facts.masses[1] == 10


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("parts/mass.xacro", "parts/none.xacro"), "no such file"),
        (("parts/mass.xacro", "parts/*.xacro"), "not a pattern"),
        (("parts/mass.xacro", "small.urdf.xacro"), "nested too deeply"),
        (('<xacro:end prefix=""/>', "<xacro:ende/>"), "unknown macro"),
        (('<xacro:end prefix=""/>', "<xacro:end/>"), "Undefined parameters"),
        (('<link name="${prefix}tip"/>', '<xacro:end prefix=""/>'), "without end"),
        (('<link name="base"/>', "<!DOCTYPE a>"), "not well-formed"),
    ],
)
def test_broken_xacro(arm, change, words):
    arm.edit("small.urdf.xacro", change)
    assert words in str(arm.problem())


def test_nothing_is_printed(arm, capfd):
    arm.edit("small.urdf.xacro", ('<xacro:end prefix=""/>', "<xacro:ende/>"))
    arm.problem()
    assert capfd.readouterr() == ("", "")


def test_xacro_is_put_back(arm):
    import xacro

    before = xacro.safe_eval, xacro.parse, xacro.handle_macro_call
    arm.load()
    assert (xacro.safe_eval, xacro.parse, xacro.handle_macro_call) == before


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1 + 2*3", 7),
        ("-a/2", -1.5),
        ("2**3", 8.0),
        ("math.sin(0) + cos(0)", 1.0),
        ("radians(180)", math.pi),
        ("a if a > 2 else 0", 3),
        ("'x' + 'y'", "xy"),
        ("[1, 2][1]", 2),
        ("max(1, a)", 3),
        ("not (a == 3 and 1)", False),
        ("5 % 3 + 7 // 2", 5),
        ("d.k", 4),
        ("'0 0 0.5'.split(' ')[2]", "0.5"),
        ("'a_b'.replace('_', '-').upper()", "A-B"),
        ("dict(j1=0.5, j2=a)['j2']", 3),
        ("{'x': 1.5, 'y': [a]}.get('y')[0]", 3),
        ("d.get('none', 7)", 7),
        ("len((d.items() + [['k', 5]])[1:])", 1),
        ("'left_tool0'[5:]", "tool0"),
        ("d.get('none') is None and a is not None", True),
        ("sorted([2, 1])[0]", 1),
    ],
)
def test_arithmetic(text, value):
    found = evaluate(text, {"a": 3, "d": {"k": 4}})
    assert found == (value if isinstance(value, str) else pytest.approx(value))


@pytest.mark.parametrize(
    "text", ["~1", "1 if ~a else 2", "a @ 2", "a is 3", "1 << 9", "lambda: 1", "{1: 2}", "a(1)", "f'{a}'"]
)
def test_what_is_no_arithmetic_is_a_value_error_in_words(text):
    with pytest.raises(ValueError, match=r"robot file|function|not allowed"):
        evaluate(text, {"a": 3})


LIMITS = """joints:
  upper: {reach: 0.8, span: [!degrees -180, !radians 2*pi], names: {tool: tip}}
  off: !millimeters 250
"""
LOADED = """<xacro:property name="file" value="parts/limits.yaml"/>
  <xacro:property name="limits" value="${xacro.load_yaml(file)['joints']}"/>
  <xacro:property name="reach" value="${limits.upper['reach']}"/>"""
REACH = '<xacro:property name="reach" value="${0.5 + 0.3}"/>'


@pytest.fixture
def loading(arm):
    arm.write("parts/limits.yaml", LIMITS)
    arm.edit("small.urdf.xacro", (REACH, LOADED))
    return arm


def test_a_yaml_file_is_loaded(loading):
    assert loading.load().flange.placement[0, 3] == pytest.approx(0.8)
    for expression, value in {
        "load_yaml(file).joints.off": 0.25,
        "limits['upper']['span'][0] + 4": 4 - math.pi,
        "limits.upper.span[1]": 2 * math.pi,
        "0.3 if 'upper' in limits and limits.upper.names.tool == 'tip' else 0.1": 0.3,
    }.items():
        loading.edit(
            "small.urdf.xacro", (LOADED.splitlines()[-1], f'<xacro:property name="reach" value="${{{expression}}}"/>')
        )
        assert loading.load().flange.placement[0, 3] == pytest.approx(value), expression
        loading.write("small.urdf.xacro", XACRO)
        loading.edit("small.urdf.xacro", (REACH, LOADED))


@pytest.mark.parametrize(
    ("target", "words"),
    [
        ("/etc/hostname", "outside the robot's packages"),
        ("../secret.yaml", "outside the robot's packages"),
        ("file:///etc/hostname", "outside the robot's packages"),
        ("parts/none.yaml", "there is no file"),
    ],
)
def test_a_yaml_file_is_one_of_the_robots(loading, target, words):
    (loading.folder.parent / "secret.yaml").write_text("a: 1")
    loading.edit("small.urdf.xacro", ("parts/limits.yaml", target))
    problem = loading.problem()
    assert words in str(problem)
    assert (Path(problem.file).name, problem.line) == (
        "small.urdf.xacro",
        loading.line("small.urdf.xacro", "load_yaml"),
    )


@pytest.mark.parametrize(
    ("text", "words", "line"),
    [
        ("joints:\n  upper: {reach: !degrees x}", "'x' is not defined", 2),
        ("joints: &a {b: 1}", "anchors", 1),
        ("joints: !!python/object:os.system {}", "tags are not allowed", 1),
        ("joints: {", "is not YAML", None),
    ],
)
def test_a_wrong_yaml_file_is_named_with_its_line(loading, text, words, line):
    loading.write("parts/limits.yaml", text)
    problem = loading.problem()
    assert words in str(problem)
    assert problem.file.endswith("limits.yaml")
    assert line in (None, problem.line)


def test_a_missing_entry_says_what_is_there(loading):
    loading.edit("small.urdf.xacro", ("limits.upper['reach']", "limits.upper['rich']"))
    assert "there is no entry 'rich'; it has reach, span, names" in str(loading.problem())


def test_parameters_are_forwarded_and_blocks_inserted(arm):
    """`^` takes the caller's value and `|` what stands in for it; `*origin` is one element, `**more` what it holds."""
    arm.edit(
        "small.urdf.xacro",
        (
            '<xacro:end prefix=""/>',
            """<xacro:macro name="mount" params="prefix:=^|none length:=^|0.1 *origin **more">
    <xacro:property name="end" value="${prefix}tip" scope="parent"/>
    <link name="${prefix}tip"/>
    <joint name="${prefix}mount" type="fixed">
      <xacro:insert_block name="origin"/><xacro:insert_block name="more"/>
    </joint>
  </xacro:macro>
  <xacro:property name="prefix" value=""/>
  <xacro:unless value="${False}">
    <xacro:mount><origin xyz="${reach/2} 0 0"/><ends><parent link="fore"/><child link="tip"/></ends></xacro:mount>
  </xacro:unless>
  <xacro:if value="${end != 'tip'}"><link name="loose"/></xacro:if>""",
        ),
    )
    assert arm.load().flange.placement[0, 3] == pytest.approx(0.4)

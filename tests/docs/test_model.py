"""docs/model.md: every equation is there, the stages are the plugin layer's, and the printed formulas hold."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from qsframework.plugin import registry
from qsframework.plugin.kinds import Effect


@pytest.fixture(scope="module")
def text(root: Path) -> str:
    return (root / "docs" / "model.md").read_text()


def numbered(text: str, n: int) -> str:
    """The right side of an equation as the page prints it, as Python."""
    (block,) = (x for x in re.findall(r"```math\n(.*?)\n```", text, re.S) if x.endswith(rf"\tag{{{n}}}"))
    right = block.split("=", 1)[1].rsplit(r"\tag", 1)[0].strip()
    right = re.sub(r"\b([a-zK])_([a-z0-9])", r"\1\2", right)  # l_c is lc
    right = re.sub(r"\\(sin|cos)(?:\^(\d))? b", lambda f: f"{f[1]}(b)" + (f"**{f[2]}" if f[2] else ""), right)
    right = right.replace("^", "**").replace("\\", "")
    return re.sub(r"(?<=[\w)]) (?=[\w(])", " * ", right)


def test_every_equation_is_there(text: str) -> None:
    named: set[int] = set()
    for first, last in re.findall(r"\((\d+)\) to \((\d+)\)", text.split("## The pipeline")[1]):
        named |= set(range(int(first), int(last) + 1))
    named |= {int(n) for n in re.findall(r"\((\d+)\)", text.split("## The pipeline")[1])}
    named |= {int(n) for tag in re.findall(r"\\tag\{(.*?)\}", text) for n in tag.split(", ")}
    assert named >= set(range(1, 23))


def test_every_effect_has_a_row_with_its_stage(text: str) -> None:
    rows = {name: int(stage) for name, stage in re.findall(r"^\| `(\w+)` \| (\d) \|", text, re.M)}
    assert rows == {name: effect.stage for name, effect in registry().items()}


def test_the_stages_are_those_of_the_plugin_layer(text: str) -> None:
    rows = {name: int(stage) for stage, name in re.findall(r"^\| (\d) \| `(\w+)` \|", text, re.M)}
    kinds = [k for k in Effect.__subclasses__() if k.__module__ == "qsframework.plugin.kinds"]
    assert rows == {k.__name__: k.stage for k in kinds}


def test_the_printed_balancer_is_consistent(text: str) -> None:
    """Moment (9) is the slope of the spring's energy by (7) and (8), eta (11) that of (9)."""
    lc, l2, s0, K_c = 0.47, 0.86, 0.55, 2.0e5
    names = {"sin": np.sin, "cos": np.cos, "lc": lc, "l2": l2, "L": lc * l2, "s0": s0, "Kc": K_c}

    def value(n: int, b: float) -> float:
        s = float(np.sqrt(eval(numbered(text, 7), {}, {**names, "b": b})))
        return float(eval(numbered(text, n), {}, {**names, "b": b, "s": s}))

    def slope(n: int, b: float, h: float = 1e-5) -> float:
        return (value(n, b + h) - value(n, b - h)) / (2 * h)

    for b in (0.5, 1.2, 2.4):
        energy_slope = value(8, b) * slope(7, b) / (2 * np.sqrt(value(7, b)))
        assert np.isclose(value(9, b), energy_slope, rtol=1e-7)
        assert np.isclose(value(11, b), slope(9, b) / (K_c * lc * l2), rtol=1e-6)


def test_the_kernels_ratio_is_that_of_the_benchmark(root: Path, text: str) -> None:
    """To one digit: it differs a little from run to run."""
    table = (root / "docs" / "records" / "performance-kinematics-by-what.csv").read_text()
    (measured,) = re.findall(r"Pinocchio, pose by pose .*,([\d.]+) times faster$", table, re.M)
    (told,) = re.findall(r"The kernel is about (\d+) times\s+as fast", text)
    assert float(told) == float(f"{float(measured):.1g}")

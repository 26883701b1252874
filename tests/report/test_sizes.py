"""Sizes in the units that people read."""

import math

import pytest

from qsframework.plugin import Parameter
from qsframework.report.words.sizes import people_estimate, people_size, shown_unit, with_sd
from qsframework.units import conversion


@pytest.mark.parametrize(
    ("name", "unit", "value", "text"),
    [
        ("joint_backlash[joint_3]", "rad", 1.0 * math.pi / 180.0 / 60.0, "1.00 arcmin"),
        ("joint_offset[joint_3]", "rad", 0.05, "2.86 deg"),
        ("joint_backlash[joint_1]", "rad", 1.44e-5, "0.0495 arcmin"),
        ("encoder_eccentricity[joint_3].cos", "rad", 2e-6, "2.00 urad"),
        ("joint_compliance[joint_3]", "rad/(N m)", 4e-7, "0.400 urad/(N m) (2.50 MN m/rad)"),
        ("joint_hardening[joint_3]", "rad/(N m)", -4e-7, "-0.400 urad/(N m)"),
        ("joint_hardening[joint_3]", "rad/(N m)^3", 3e-16, "0.300 urad/(kN m)^3"),
        ("base_compliance[z]", "m/N", 1e-8, "10.0 um/kN (100 kN/mm)"),
        ("marker_offset[tool].x", "m", 0.002, "2.00 mm"),
        ("bar", "m", 2e-5, "20.0 um"),
        ("load_scale", "", 0.0123, "1.23 %"),
        ("tracker_drift.x", "m/s", 1e-8, "36.0 um/h"),
        ("thermal_expansion[link_2]", "1/K", 1.2e-5, "12.0 um/(m K)"),
        ("counterweight[joint_2]", "kg", 200.0, "200 kg"),
        ("nothing", "m", 0.0, "0 mm"),
        ("endless", "m", math.inf, "unknown"),
    ],
)
def test_a_size_is_read_in_the_usual_unit(name: str, unit: str, value: float, text: str) -> None:
    assert people_size(Parameter(name, unit), value) == text


def test_estimate_and_sd_share_one_unit() -> None:
    arcmin = math.pi / 180.0 / 60.0
    backlash = Parameter("joint_backlash[a]", "rad")
    assert people_estimate(backlash, 1.02 * arcmin, 0.031 * arcmin) == "1.020 ± 0.031 arcmin"
    text = people_estimate(Parameter("joint_compliance[a]", "rad/(N m)"), 5e-7, 1e-8)
    assert text == "0.500 ± 0.010 urad/(N m) (2.00 MN m/rad)"
    assert people_estimate(Parameter("joint_placement[a].x", "m"), 3e-8, 5e-3) == "0.0 ± 5.0 mm"


@pytest.mark.parametrize(
    ("value", "sd", "text"),
    [
        (2.3554, 0.4, "2.36 ± 0.40"),
        (0.16098, 0.000623, "0.16098 ± 0.00062"),
        (1234.5, 17.2, "1234 ± 17"),
        (123456.0, 1234.0, "123500 ± 1200"),
        (0.5, 0.0996, "0.50 ± 0.10"),
        (3e-14, 2e-15, "3.00e-14 ± 2.0e-15"),
        (1.0342e7, 2.9e6, "1.03e+07 ± 2.9e+06"),
        (-6.22e5, 6.7e5, "-6.2e+05 ± 6.7e+05"),
        (7.0, math.nan, "7"),
    ],
)
def test_value_and_sd_end_at_one_digit(value: float, sd: float, text: str) -> None:
    assert with_sd(value, sd) == text


SHOWN = {  # unit shown -> the same in pint's words
    "um/h": "um/hour",
    "mm/kN": "mm/kN",
    "%": "percent",
    "um/(m K)": "um/(m*K)",
    "urad/(kN m)^3": "urad/(kN*m)**3",
}


@pytest.mark.parametrize("unit", ["rad", "m", "rad/(N m)", "rad/(N m)^3", "m/N", "N/m", "m/s", "1/K", "", "kg", "kg m"])
@pytest.mark.parametrize("value", [1e-9, 1e-5, 0.03, 5e3, 2e6])
def test_shown_units_have_the_size_that_pint_says(unit: str, value: float) -> None:
    size, text = shown_unit(Parameter("x", unit), value)
    factor, _, dimension = conversion(SHOWN.get(text, text))
    assert factor == pytest.approx(size, rel=1e-9)
    assert dimension == conversion(unit.replace("^", "**"))[2] or unit == "1/K"

"""Documents made by hypothesis: the keys of the formats with values of every type, and texts of every kind."""

from __future__ import annotations

from typing import Any

import fuzzing
import mutate
import pytest
import yaml
from hypothesis import HealthCheck, given, settings, strategies as st

FEW = settings(max_examples=60, derandomize=True, deadline=None, database=None, suppress_health_check=list(HealthCheck))
leaf = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=12)
    | st.sampled_from(mutate.TEXTS)
    | st.sampled_from(mutate.NUMBERS)
    | st.dates().map(str)
)
value = st.recursive(
    leaf, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=3)
)


def check(good: fuzzing.Good, content: str) -> fuzzing.Outcome:
    found = fuzzing.try_file(good, content.encode("utf-8", "replace"))
    assert found.outcome is not fuzzing.Outcome.FAULT, f"{content[:400]!r}\n{found.words}"
    return found.outcome


def mapping(good: fuzzing.Good) -> dict[str, Any]:
    return yaml.safe_load(good.content)


@pytest.mark.parametrize(
    "kind", ["robot.yaml", "nominal.yaml", "experiment.yaml", "fit.json", "task.yaml", "plan.json"]
)
def test_any_value_under_any_known_key(corpus: dict[str, list[fuzzing.Good]], kind: str) -> None:
    good = next((g for g in corpus[kind] if g.label in ("small", "every")), corpus[kind][0])
    whole = mapping(good)

    @FEW
    @given(st.sampled_from(sorted(whole)), value, st.sampled_from(("", *mutate.SUFFIXES)))
    def run(key: str, new: Any, suffix: str) -> None:
        document = {k: v for k, v in whole.items() if k != key} | {key + suffix: new}
        check(good, yaml.dump(document, Dumper=mutate.Plain, allow_unicode=True))

    run()


@pytest.mark.parametrize("kind", ["robot.yaml", "experiment.yaml", "URDF", "plan.csv", "readings.csv", "fit.json"])
def test_any_text(corpus: dict[str, list[fuzzing.Good]], kind: str) -> None:
    good = corpus[kind][-1]
    outcomes = []

    @FEW
    @given(st.text(max_size=300) | st.lists(st.text(max_size=20), max_size=12).map(",".join))
    def run(text: str) -> None:
        outcomes.append(check(good, text))

    run()
    assert set(outcomes) == {fuzzing.Outcome.REFUSED}


@FEW
@given(cells=st.lists(st.lists(leaf.map(str), min_size=1, max_size=16), min_size=1, max_size=6))
def test_any_cells_under_a_good_header(corpus: dict[str, list[fuzzing.Good]], cells: list[list[str]]) -> None:
    good = corpus["readings.csv"][1]
    header = good.content.decode().splitlines()[0]
    check(good, "\n".join([header, *(",".join(row) for row in cells)]))


@FEW
@given(
    tag=st.sampled_from(
        ("link", "joint", "origin", "inertial", "mass", "inertia", "axis", "limit", "visual", "geometry")
    ),
    attribute=st.sampled_from(("name", "xyz", "rpy", "value", "lower", "upper", "type", "link", "ixx", "size")),
    text=leaf.map(str) | st.lists(st.floats(), max_size=4).map(lambda v: " ".join(map(str, v))),
)
def test_any_attribute_of_any_element(
    corpus: dict[str, list[fuzzing.Good]], tag: str, attribute: str, text: str
) -> None:
    from xml.sax.saxutils import quoteattr

    good = corpus["URDF"][-1]
    check(good, good.content.decode().replace(f"<{tag}", f"<{tag} {attribute}={quoteattr(text)}", 1))
    check(good, good.content.decode().replace("</robot>", f"<{tag} {attribute}={quoteattr(text)}/></robot>", 1))

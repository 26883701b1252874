"""What names of points say, and what they do not."""

from __future__ import annotations

import numpy as np
import pytest

from qsf_trackers.campaign import Campaign
from qsf_trackers.vocabulary import decode, plain, state_word, vocabulary

CAMPAIGN = Campaign(
    poses={f"p{i:02d}": np.zeros(6) for i in range(1, 13)}, loads={}, order=(), names={"p01": {"": "weight"}}
)
MARKERS = ("m1", "m2", "ball_a")


@pytest.mark.parametrize(
    ("name", "pose", "marker", "loaded", "repeat", "cycle"),
    [
        ("P07_m2_loaded", "p07", "m2", True, None, None),
        ("p7m2loaded", "p07", "m2", True, None, None),
        ("A::P07::m2 unloaded", "p07", "m2", False, None, None),
        ("m2-no load-P7", "p07", "m2", False, None, None),
        ("P12-ball a-free r2", "p12", "ball_a", False, 2, None),
        ("P01.m1.weight.c12", "p01", "m1", True, None, 12),
        ("P07_m2_rep100", "p07", "m2", None, 100, None),
        ("P07_m2_last", "p07", "m2", None, None, None),
        ("P07_m2_L", "p07", "m2", None, None, None),
        ("Point_7_m1", None, "m1", None, None, None),
    ],
)
def test_a_name(
    name: str, pose: str | None, marker: str, loaded: bool | None, repeat: int | None, cycle: int | None
) -> None:
    said = decode(name, vocabulary(CAMPAIGN, MARKERS, {}))
    assert (said.pose, said.marker, said.loaded) == (pose, marker, loaded)
    assert (said.repeat, said.cycle) == (repeat, cycle)


def test_a_stated_word() -> None:
    said = decode("P07_ball2_L", vocabulary(CAMPAIGN, MARKERS, {"L": "loaded", "ball2": "m2"}))
    assert (said.pose, said.marker, said.loaded, said.unknown) == ("p07", "m2", True, ())


def test_what_stands_in_a_name_twice() -> None:
    known = vocabulary(CAMPAIGN, ("1", "m2"), {})
    assert decode("P01_P02_m2", known).several == ("pose p01 or p02",)
    both = vocabulary(Campaign(poses={"1": np.zeros(6)}, loads={}, order=(), names={}), ("1",), {})
    assert decode("1_loaded", both).several == ("pose or marker 1",)


def test_plain_names() -> None:
    assert plain("P-007.a") == plain("p7A") == "p7a"
    assert plain("p10") != plain("p1")


@pytest.mark.parametrize(
    ("name", "proposed"),
    [
        ("P07 m2 ohne Last", "ohne Last=unloaded"),
        ("P07 m2 with load", "with load=loaded"),
        ("P07_ohne_m2_Last", "ohne=unloaded"),
        ("P07_m2_test", ""),
    ],
)
def test_words_of_a_load_are_proposed_as_words(name: str, proposed: str) -> None:
    known = vocabulary(CAMPAIGN, MARKERS, {})
    assert state_word(name, decode(name, known).unknown) == proposed
    if proposed:
        word, state = proposed.split("=")
        assert decode(name, vocabulary(CAMPAIGN, MARKERS, {word: state})).loaded is (state == "loaded")

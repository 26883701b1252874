"""What a diagnosis says, and how: findings B.10 and B.11 of the trials.

The verdict in one sentence, certain and doubtful apart, nothing "excluded" that is plain by itself, long lists folded,
a place to look and a next step for what is left; and positions of states in any tracker's axes.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from qsframework.cli.diagnose import print_diagnosis
from qsframework.diagnoses import Diagnosis, diagnose
from qsframework.diagnoses.result import Leftover, NamedCause, Status
from qsframework.experiment import differences
from qsframework.experiment.noise import NoiseModel
from qsframework.hypotheses.catalogue.law import Law, LikelyPlace
from qsframework.report.diagnosis_section import diagnosis_sections
from qsframework.report.diagnosis_tables import (
    FOLDED,
    alone_table,
    cause_table,
    doubtful_table,
    excluded_table,
    place_table,
    unseen_table,
    verdict_groups,
)
from qsframework.report.page import write_report
from qsframework.report.result_json import diagnosis_json
from qsframework.report.words.diagnosis import diagnosis_words, method_words
from qsframework.report.words.headline import diagnosis_verdict, headline
from qsframework.report.words.next_steps import next_steps
from tests.diagnose.cases import (
    HARDENING,
    as_built,
    campaign,
    candidates,
    day_of_positions,
    diagnosed,
    hardened,
    measured,
    quiet,
)


@pytest.fixture(scope="module")
def real() -> Diagnosis:
    """The R-2000iC: three causes, one with a rival, something left, one marker a visit."""
    return diagnosed("r2000ic")


def doubted(found: Diagnosis, *places: int) -> Diagnosis:
    """The diagnosis with some of its names without a gain."""
    names = [f.name for f in found.findings]
    findings = tuple(replace(f, heldout_gain=-0.01) if names.index(f.name) in places else f for f in found.findings)
    return replace(found, findings=findings, verdict="partly_explained")


def names_in(rows: tuple[tuple[str, ...], ...]) -> set[str]:
    return {row[0] for row in rows}


def test_the_verdict_is_one_sentence_with_all_that_matters(real: Diagnosis) -> None:
    said = headline(real)
    assert said.startswith("Partly explained by offaxis_compliance[joint_4/z], load_point_offset and tracker_frame: ")
    before, after = (1e3 * 3**0.5 * e for e in (real.rms.heldout_identified, real.rms.heldout_extended))
    assert f"{before:.3f} \u2192 {after:.3f} mm, {100 * real.rms.heldout_gain:.0f} % less (3D RMS" in said
    assert "an error at link_3 that depends on the torque there (or the drive of joint_1)" in said
    assert "; check first: play of the main bearing" in said
    assert re.findall(r"\.(?= |$)", said) == ["."], "one sentence"
    assert diagnosis_words(real).startswith(said)
    assert diagnosis_json(real)["headline"] == said
    assert diagnosis_verdict(real).said == said
    assert headline(hardened()).endswith("compare small and large loads at joint_3 alone.")
    assert headline(quiet(0)).startswith("Nothing to name: the model fits within the noise")


def test_a_doubtful_name_never_stands_beside_a_certain_one(real: Diagnosis) -> None:
    found = doubted(real, 1)
    sure, doubtful = [f.name for f in found.sure], found.findings[1].name
    assert names_in(cause_table(found).rows) >= set(sure)
    assert doubtful not in names_in(cause_table(found).rows)
    (row,) = doubtful_table(found).rows
    assert (row[0], row[-1]) == (doubtful, "doubtful")
    groups = {title: [about for about, _ in lines.rows] for title, lines in verdict_groups(found)}
    assert doubtful in groups["Doubtful"]
    assert doubtful not in [*groups.get("Certain", []), *groups["Likely, with alternatives"]]
    start = headline(found).partition(":")[0]
    assert doubtful not in start
    assert all(name in start for name in sure)
    assert f"shows whether {doubtful} is there at all" in [s.settles for s in next_steps(found)]


def test_where_all_names_are_doubtful_none_is_said_to_explain(real: Diagnosis) -> None:
    found = doubted(real, 0, 1, 2)
    assert headline(found).startswith("Partly explained at most: ")
    assert "is not clearly smaller with them" in headline(found)
    assert cause_table(found).rows == ()
    assert "Certain" not in dict(verdict_groups(found))


def test_what_is_plain_by_itself_is_not_called_excluded(real: Diagnosis) -> None:
    plain = {x.name for x in real.plain_alone}
    assert plain
    assert all(x.p_value < real.level for x in real.table if x.name in plain)
    assert names_in(alone_table(real).rows) == plain
    assert alone_table(real).header[0] == "explained by the named causes"
    bounded = {
        f"{kind}[{bound.split()[0]}]" for kind, bounds in excluded_table(real).rows for bound in bounds.split("; ")
    }
    assert bounded
    assert not bounded & plain
    left = [x for x in real.table if x.status is Status.EXCLUDED and x.name not in plain]
    assert left
    assert min(x.p_value for x in left) >= real.level


def test_long_lists_are_counted_and_folded(real: Diagnosis, tmp_path, capsys) -> None:
    for table in (excluded_table(real), unseen_table(real)):
        assert table.folded
    print_diagnosis(real, None)
    short = capsys.readouterr().out
    print_diagnosis(real, None, verbose=True)
    long = capsys.readouterr().out
    assert "effects: no " in short
    assert "effects are not observable with these data" in short
    hidden = [x.name for x in real.table if x.status is Status.INVISIBLE]
    assert len(hidden) > FOLDED
    assert "`--verbose` lists them all." in short
    assert "`--verbose`" not in long
    assert len(long.splitlines()) > len(short.splitlines()) + 10
    page = write_report(
        tmp_path / "r.html", "Diagnosis", diagnosis_sections(real, []), diagnosis_verdict(real)
    ).read_text()
    assert page.count('<details class="folded">') >= 2
    first = page.index("Partly explained by")
    assert first < page.index("<details")


def test_few_names_are_not_folded(real: Diagnosis) -> None:
    few = [x for x in real.table if x.status is Status.EXCLUDED][-FOLDED:]
    assert excluded_table(replace(real, table=tuple(few))).folded == ""


@pytest.mark.parametrize(
    ("law", "moves", "do"),
    [
        (
            Law("link", "link_2", ("torque",)),
            "an error at link_2 that depends on the torque there",
            "Measure some poses under half the load",
        ),
        (Law("drive", "joint_1", ("came",)), "that depends on the direction of approach of the joint", "Approach some"),
        (
            Law("drive", "joint_1", ("loaded", "came")),
            "depends on the direction of approach, once a load hangs",
            "Approach some",
        ),
        (
            Law("link", "link_2", ("order",), "ry"),
            "an error at link_2 about y that depends on the order",
            "Measure the first",
        ),
        (
            Law("shift", "base", ("order",), "z"),
            "an error at base along z that depends on the order",
            "Measure the first",
        ),
        (
            Law("readings", "", ("loaded", "joint_2")),
            "an error of all readings that depends on the angle of joint_2 (once a load hangs)",
            "Measure 6 more poses",
        ),
        (Law("shift", "base", ("order",)), "an error at base that depends on the order", "Measure the first"),
        (Law("drive", "joint_1", ("always",)), "that is constant", "Take some unloaded readings twice"),
        (
            Law("bearing", "joint_1", ("torque", "joint_1+joint_2")),
            "at the bearing of joint_1 that depends on the torque there and the angle of joint_1 and joint_2 together",
            "Measure 6 more poses",
        ),
        (Law("marker", "m1", ("loaded",)), "marker m1 that is constant once a load hangs", "Take some unloaded"),
        (Law("load", "tool", ("force",)), "an error of the load that depends on the force", "Measure some poses"),
        (Law("load", "tool", ("direction",)), "an error of the load that", "Pull in other directions"),
        (Law("shift", "tool", ("moment",)), "an error at tool that depends on the moments there", "Measure some poses"),
        (
            Law("point", "tool", ("attitude",)),
            "an error of the point where the load acts that depends on where gravity points",
            "Measure 6 more poses",
        ),
    ],
)
def test_what_nothing_explains_comes_with_a_place_and_a_step(real: Diagnosis, law: Law, moves: str, do: str) -> None:
    found = replace(real, verdict="unexplained", findings=(), leftovers=(Leftover(law, 1e-9, 20.0),))
    assert headline(found).startswith("Unexplained: ")
    assert moves in headline(found)
    assert any(step.do.startswith(do) for step in next_steps(found)), next_steps(found)
    assert all(step.settles for step in next_steps(found))


def test_all_places_are_told_where_it_may_be(real: Diagnosis) -> None:
    """One, two or three by name in the headline; all with their share of the evidence below."""
    law = Law("bearing", "joint_6", ("attitude",), "rx")
    other = [Law("link", "link_6", ("attitude",)), Law("drive", "joint_5", ("joint_2",))]
    other += [Law("marker", "m1", ("force",))]
    said = ["", " (or link_6)", " (or link_6 or the drive of joint_5)", " (or link_6, or one of 2 other places)"]
    for count, words in enumerate(said):
        places = tuple(LikelyPlace(x, 1.0 / (count + 1)) for x in (law, *other)[: count + 1])
        found = replace(real, leftovers=(Leftover(law, 1e-9, 20.0),), places=places)
        moves = f"an error at the bearing of joint_6 about x that depends on where gravity points{words}"
        assert moves in headline(found)
        told = "the bearing of joint_6 about x (50 %) from link_6 (50 %): in brackets the share of the evidence"
        assert (told in diagnosis_words(found)) == (count == 1)
        assert [x["share"] for x in diagnosis_json(found)["places"]] == [x.share for x in places]
        assert len(place_table(found).rows) == len(places)


def test_places_of_the_same_motion_are_told_and_what_differs_at_each_visit(real: Diagnosis) -> None:
    """What the markers do not tell apart, how far a place moves, and what tells why."""
    law = Law("drive", "joint_1", ())
    place = LikelyPlace(law, 1.0, 2.1e-5, (Law("link", "base", ()), Law("link", "link_1", ())))
    found = replace(real, findings=(), verdict="unexplained", leftovers=(Leftover(law, 1e-3, 6.0),), places=(place,))
    said = diagnosis_words(found)
    assert "an error at the drive of joint_1 that differs at each visit" in headline(found)
    assert "it moves by 21 urad (1 sigma), otherwise at each visit" in said
    assert "Equivalent places: base and link_1. A reflector or a gauge" in said
    assert "Repeat 6 poses, each twice" in said
    (told,) = diagnosis_json(found)["places"]
    assert (told["equivalent"], told["sd"]) == (["base", "link_1"], 2.1e-5)
    assert place_table(found).rows[0][-1] == "base, link_1"


def test_the_likeliest_place_is_told_where_it_is_not_that_of_the_likeliest_law(real: Diagnosis) -> None:
    """The laws of one place together may outweigh the likeliest single one elsewhere."""
    law, other = Law("shift", "link_6", ("torque",), "z"), Law("drive", "joint_5", ("joint_2",))
    own = Law("link", "link_6", ("order",))
    for places in ((other, own), (own, other), (other,)):
        found = replace(
            real,
            leftovers=(Leftover(law, 1e-9, 20.0),),
            places=tuple(LikelyPlace(x, 1.0 / len(places)) for x in places),
        )
        assert (
            "at link_6 along z that depends on the torque there (or the drive of joint_5) remains unexplained"
            in headline(found)
        )


def test_one_marker_a_visit_is_said_with_what_it_hides(real: Diagnosis) -> None:
    """Unless somebody states how well the arm comes back."""
    assert any("cannot be separated from a marker's own" in note for note in method_words(real))
    (step, *_) = next_steps(real)
    assert step.do.startswith("Repeat 6 poses, such as ")
    assert step.do.endswith(", or read more markers at each")
    stated = replace(real, experiment=real.experiment.with_(noise=NoiseModel(3e-5, repeatability=5e-5)))
    assert not any("marker's own" in note for note in method_words(stated))
    assert not any("marker's own" in step.settles for step in next_steps(stated))


def test_with_few_poses_it_is_said_which_repeats_would_tell() -> None:
    few = diagnose(campaign(), measured(*HARDENING, seed=5, count=14), repeats=1)
    assert few.findings
    (step, *_) = next_steps(few)
    assert step.do.startswith("Repeat 6 poses, such as ")
    named = step.do.removeprefix("Repeat 6 poses, such as ").split(", ")
    assert set(named) <= set(few.readings.states.pose)
    assert "repeatability" in step.settles


def test_many_rivals_are_said_in_the_sentence(real: Diagnosis) -> None:
    def crowded(f: NamedCause) -> NamedCause:
        return replace(f, alternatives=f.alternatives * 10, instead=None)

    found = replace(real, leftovers=(), findings=tuple(crowded(f) for f in real.findings[:1]))
    assert "but offaxis_compliance[joint_4/z] could be any of 10 other causes" in headline(found)


def test_states_in_a_trackers_own_axes_are_diagnosed_as_in_those_of_the_base() -> None:
    """Loaded minus unloaded positions of a tracker that stands anywhere: the same cause, the same size."""
    (hidden,), truth = HARDENING
    model, x = as_built((hidden,), truth, np.random.default_rng([5, 7]))
    states = day_of_positions(model, x, candidates()[40:60], 6, turned=(0.1, -0.2, 2.0), origin=(3.0, 1.0, -0.5))
    found = diagnose(campaign(), differences(states, campaign()), repeats=1)
    same = hardened()
    assert [f.name for f in found.findings] == [f.name for f in same.findings] == [hidden.name], diagnosis_words(found)
    for (value,) in (found.findings[0].values, same.findings[0].values):
        assert abs(value.value - truth[hidden.name]) < 4.0 * value.sd
        assert value.sd < 0.2 * abs(truth[hidden.name])
    said = diagnosis_words(found)
    assert re.search(r"the tracker is turned \d+\.\d\d deg to the base, and its displacements with it", said)
    assert "is turned" not in diagnosis_words(same)


def test_what_acts_in_the_place_of_an_open_name_is_said_with_its_shares(real: Diagnosis) -> None:
    law = Law("drive", "joint_4", ("torque",))
    named = replace(real.findings[0], alternatives=(), instead=Leftover(law, float("nan"), 2.0))
    places = (LikelyPlace(law, 0.7), LikelyPlace(Law("bearing", "joint_5", ()), 0.3, 2e-5))
    found = replace(real, verdict="partly_explained", findings=(named,), leftovers=(), places=places)
    moves = "an error at the drive of joint_4 that depends on the torque there"
    assert f"it may as well be {moves} (or the bearing of joint_5)" in headline(found)
    said = diagnosis_words(found)
    assert f"If it is no cause of the library, most likely {moves}." in said
    assert "from the bearing of joint_5 (30 %)" in said
    assert place_table(found).rows[0][:2] == ("the drive of joint_4", "70 %")

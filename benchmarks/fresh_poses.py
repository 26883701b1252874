"""What an answer is worth at poses that nobody has measured, for cases of the second generator.

The error of the model that `--extend` writes at fresh poses without noise, on a scale on which the springs alone stand
at 0 and an oracle at 1: the springs fitted to the same readings, had the effect been known and taken out of them. And
which place and which variable the answer speaks of, in the words of who hid the effect.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from independent import Campaign, noisy, write_campaign
from independent_arm import Array, Hidden

if TYPE_CHECKING:
    from qsframework.diagnoses import Diagnosis

_POSES, _SEED = 60, 1_000_003
_SAME: dict[str, set[str]] = {
    "load": {"torque", "force"},
    "moment": {"torque"},
    "force": {"torque"},
    "own torque": {"torque", "moment"},
    "own angle": {"angle"},
    "other angle": {"angle"},
    "torque x angle": {"angle"},
    "angle and torque": {"angle"},
    "own torque x attitude": {"torque", "attitude"},
    "torque x order": {"order"},
    "direction of the force": {"torque", "force", "direction"},
    "attitude": {"angle"},
    "side": {"approach"},
    "approach": {"came"},
    "direction": {"came"},
    "hysteresis": {"came", "before"},
    "other torque": {"others"},
    "drift": {"order"},
}
"""Other words for what a law depends on."""
_OF = {
    "joint_hardening": "torque",
    "joint_backlash": "torque",
    "gear_flank": "torque",
    "gear_waves": "angle",
    "encoder_eccentricity": "angle",
    "gear_friction": "came",
    "compensator_friction": "came",
    "thermal_expansion": "temperature",
    "tracker_drift": "order",
    "tracker_move": "order",
    "reading_drift": "order",
}
"""What the laws of the library depend on that are more than a spring or a shift."""
_ENDS = {
    "flange_compliance": "tool",
    "base_compliance": "base",
    "base_lift": "base",
    "load_scale": "load",
    "load_direction": "load",
    "load_point_offset": "load",
    "reading_drift": "readings",
    "tracker_drift": "readings",
    "tracker_move": "readings",
    "tracker_frame": "readings",
    "tracker_scale": "readings",
}
"""Places of causes whose names say only their axis, or none."""
_BEARINGS = ("offaxis_compliance",)
"""Causes at a joint's bearing."""


@dataclass(frozen=True)
class Fresh:
    """RMS errors m at fresh poses: of the springs alone, of the extended model, and of the oracle."""

    springs: float
    extended: float
    oracle: float

    @property
    def share(self) -> float:
        """Of the oracle's gain in mean squared error, as the first generator counts; below 0 where the extended model
        does harm."""
        possible = self.springs**2 - self.oracle**2
        return (self.springs**2 - self.extended**2) / possible if possible > 0.0 else float("nan")

    @property
    def share_of_rms(self) -> float:
        """The same in RMS error, which asks for more."""
        possible = self.springs - self.oracle
        return (self.springs - self.extended) / possible if possible > 0.0 else float("nan")

    @property
    def harm(self) -> float:
        """How many times larger the error is than that of the springs alone."""
        return self.extended / max(self.springs, 1e-12)


def fresh_errors(campaign: Campaign, hidden: Hidden, found: Diagnosis) -> Fresh:
    """The errors of a diagnosis at poses of the same arm under the same loads that nobody has measured."""
    setting = replace(campaign.setting, poses=_POSES, seed=campaign.setting.seed + _SEED, plan=None, noise="nominal")
    fresh = Campaign(setting)
    fit = found.learned.fit if found.learned is not None and found.learned.holds else found.certain
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        base, extended = (
            _error(fresh, hidden, campaign, m, place / str(i))
            for i, m in enumerate(((found.baseline.model, found.baseline.x), (fit.model, fit.x)))
        )
        oracle = _oracle(campaign, hidden, fresh, place)
    return Fresh(base, extended, oracle)


def _error(fresh: Campaign, hidden: Hidden, of: Campaign, model: tuple[Any, Array], folder: Path) -> float:
    """RMS error m of a model at fresh readings without noise."""
    from qsframework.experiment import load_experiment, make_rows, read_readings

    experiment = load_experiment(write_campaign(fresh, fresh.clean(hidden, of.built), folder))
    assert experiment.data is not None
    rows = make_rows(read_readings(experiment.data, experiment))
    arm, x = model
    predicted = rows.predict(arm, x, rows.start(arm, x))
    return float(np.sqrt(np.nanmean(np.square(rows.measured - predicted))))


def _oracle(campaign: Campaign, hidden: Hidden, fresh: Campaign, folder: Path) -> float:
    """The error of the springs where the effect is known: readings and fresh poses without it, the same noise."""
    from qsframework.experiment import load_experiment, read_readings
    from qsframework.fits import identify

    tables = noisy(campaign, campaign.clean(Hidden()))
    experiment = load_experiment(write_campaign(campaign, tables, folder / "oracle"))
    assert experiment.data is not None
    fit = identify(experiment, read_readings(experiment.data, experiment))
    return _error(fresh, Hidden(), campaign, (fit.model, fit.x), folder / "fresh")


def spoken(found: Diagnosis) -> list[tuple[set[str], set[str]]]:
    """Words for the places and the variables that the answer says: of the learned law, or of what is left, first; else
    the places of its names, and what their laws depend on."""
    laws = [found.leftovers[0].law] if found.leftovers else []
    laws += [found.learned.leftover.law] if found.learned is not None else []
    facts = found.experiment.robot.facts
    if laws:
        return [_words(laws[0], facts)]
    return [named_words(f.name, facts) for f in found.findings]


def among(found: Diagnosis) -> list[tuple[set[str], set[str]]]:
    """The same of all that the answer leaves open: each place where what is left may be, or what acts in the place of a
    name, by its likeliest law; and without a law the alternatives of names."""
    facts = found.experiment.robot.facts
    places = [_words(law, facts) for x in found.places for law in (x.law, *x.equivalent)]
    if found.leftovers or found.learned is not None:
        return [*spoken(found), *places]
    names = [named_words(r.name, facts) for f in found.findings for r in f.alternatives]
    return [*spoken(found), *places, *names]


def alike(found: Diagnosis) -> list[tuple[set[str], set[str]]]:
    """Words for the places that move the markers as the first one that the answer says does."""
    facts = found.experiment.robot.facts
    first = found.places[:1] if found.leftovers or found.learned is not None else ()
    return [_words(law, facts) for place in first for law in place.equivalent]


def named_words(name: str, facts: Any) -> tuple[set[str], set[str]]:
    """Words for the place and the variable of a cause of the library."""
    kind, _, where = name.partition("[")
    place = where.rstrip("]").split("/")[0]
    if kind in _BEARINGS:
        return _bearing(place, facts), set()
    if kind in _ENDS:
        place = _ENDS[kind]
    variable = _OF.get(kind, "")
    return _place(place, facts), {variable, place if variable == "angle" else ""} - {""}


def _words(law: Any, facts: Any) -> tuple[set[str], set[str]]:
    if law.part in ("load", "point"):
        return {"load"}, {*law.by}
    there = _bearing(law.place, facts) if law.part == "bearing" else _place(law.place, facts)
    place = {law.part, f"{law.part} {law.place}".strip()} | there
    variable = {*law.by, *law.joints} | ({"angle"} if law.angles else set[str]())
    for factor, _, joint in (f.partition(" ") for f in law.by if " " in f):
        variable |= {"others" if factor == "torque" and joint not in there else factor, f"{factor} {joint}", joint}
    variable |= {f"angle {j}" for j in law.joints} | {f"angle of {j}" for j in law.joints}
    return place, variable


def _bearing(joint: str, facts: Any) -> set[str]:
    """A joint's bearing gives as the link does that carries it: the two are one place."""
    k = facts.joint_index(joint)
    return {joint, f"joint {joint}", facts.links[k], f"link {facts.links[k]}"} | ({"base"} if k == 0 else set[str]())


def _place(name: str, facts: Any) -> set[str]:
    """What a joint, a link or another place is called: a drive and the link that it moves are one place."""
    out = {name} - {""}
    if name in facts.joints:
        out |= {f"drive {name}", f"gear {name}", f"joint {name}", f"link {facts.link_of(name)}"}
    elif name in (*facts.links, facts.flange):
        k = facts.link_index(name)
        out |= {f"link {name}"} | ({"base"} if k == 0 else {facts.joints[k - 1], f"joint {facts.joints[k - 1]}"})
        out |= {"tool", "flange"} if name == facts.flange else set[str]()
    return out


def place_right(said: list[Any], place: str) -> bool:
    """Whether what was said is of the right place."""
    return any(_told(place) in {_told(w) for w in places} for places, _ in said)


def variable_right(said: list[Any], place: str, variable: str) -> bool:
    """Whether place and variable are right."""
    wanted = _told(variable)
    both = {wanted} | _SAME.get(wanted, set())
    return any(place_right([one], place) and both & {_told(w) for w in one[1]} for one in said)


def _told(word: str) -> str:
    return " ".join(word.lower().replace("_", " ").replace("/", " ").split())

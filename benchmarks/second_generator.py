"""Cases of the second generator (`independent.py`) for `diagnosis.py`: what is hidden, what is answered, and the goals.

Groups: `second_effects`, causes that the library holds; `second_nulls`, nothing hidden, for each noise and number of
poses; `second_structures`, arms that are not those of their files. Effects that no library holds run only where they
are asked for: `untouched`, of `untouched.py`, which no threshold is ever tuned on, `touched`, of `touched.py`, on which
learning was developed, and `kinds_a` to `kinds_d`, four more sets of like difficulty.
"""

from __future__ import annotations

import tempfile
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from common import table
from fresh_poses import Fresh, alike, among, fresh_errors, place_right, spoken, variable_right
from independent import (
    GAUGE,
    NOISES,
    SIGMA,
    Campaign,
    Mount,
    Setting,
    Unreachable,
    add_mounts,
    noisy,
    write_campaign,
    write_robot,
)
from independent_arm import ARMS, Arm, Array, Hidden, NoRest
from independent_effects import SHOWN, Places, campaign_for, hide, structures
from kinds_a import KINDS_A
from kinds_b import KINDS_B
from kinds_c import KINDS_C
from kinds_d import KINDS_D
from scipy.stats import f
from touched import TOUCHED
from untouched import UNTOUCHED

if TYPE_CHECKING:
    from qsframework.diagnoses import Diagnosis

GROUPS = ("second_effects", "second_nulls", "second_structures")
_SETS = {"kinds_a": KINDS_A, "kinds_b": KINDS_B, "kinds_c": KINDS_C, "kinds_d": KINDS_D}
_UNKNOWN = {"untouched": UNTOUCHED, "touched": TOUCHED, **_SETS}
ASKED = tuple(_UNKNOWN)
FILES = (
    "independent.py",
    "independent_arm.py",
    "independent_effects.py",
    "unknown.py",
    *(f"{group}.py" for group in ASKED),
    "second_generator.py",
    "fresh_poses.py",
)
SIZES = (10.0, 5.0)
POSES = (12, 14, 20, 40)
PLANNED = (40, 24, 60, 14)
"""Poses of the campaigns in which something is hidden, in turns."""
STRESSED = ("nominal", "shared", "nominal", "sigma_too_small", "nominal", "quantised", "repeatability")
UNKNOWN = (40, 14)
"""Poses of the campaigns of untouched kinds."""
MORE = 8
"""Visits of a second day, for the unknown kinds."""
_WORTH, _MOUNTS = 0.03, 3
"""By how much what is mounted must raise the chance of the right place, and how many reflectors and gauges are."""
_WORSE, _HARM = 1.02, 1.05
"""How many times larger errors at fresh poses may be than those of the springs alone."""
PLAIN = 5.0
"""s from which a structure must be named."""
SEEDS = 12
Result = dict[str, Any]
Row = tuple[str, str, str, str, int, str]


@dataclass(frozen=True)
class Case:
    """One campaign; number: of the case among those of its label."""

    id: str
    group: str
    number: int
    seed: int
    words: str = ""
    places: Places | None = None
    wanted: float = 0.0
    noise: str = "nominal"
    poses: int = 40


# ---------------------------------------------------------------- which cases


def make_cases(seeds: int, groups: Sequence[str], base: int, quick: bool = False) -> list[Case]:
    """In proportion to `seeds`: at 12 each effect of each kind of readings 5 times at each s, each null 60 times.

    quick: those of one seed that take a few minutes
    """
    cases = [case for group in groups if group in _MAKERS for case in _MAKERS[group](seeds, base)]
    return [c for c in cases if _fast(c)] if quick else cases


def _fast(case: Case) -> bool:
    """Displacements, at s = 10 or with the fewest poses."""
    if case.group == "second_effects":
        return case.words == "displacements" and case.wanted == SIZES[0]
    if case.group == "second_nulls":
        return case.number == 0 and case.poses == POSES[0]
    return case.group != "second_structures" or structures()[int(case.words)].kind == "displacements"


def _case(group: str, label: str, number: int, base: int, **more: Any) -> Case:
    name = f"{group}/{label}/{number}"
    return Case(name, group, number, zlib.crc32(f"{base}/{name}".encode()), **more)


def _effects(seeds: int, base: int) -> Iterator[Case]:
    kinds = [(words, places) for words, several in SHOWN.items() for places in several]
    for number in range(max(1, round(5 * seeds / SEEDS))):
        for i, (words, places) in enumerate(kinds):
            for s in SIZES:
                turn = number * len(kinds) + i
                more = {"noise": STRESSED[turn % len(STRESSED)], "poses": PLANNED[(turn // 6) % len(PLANNED)]}
                label = f"{words}/{places.__name__}/{s:g}"
                yield _case("second_effects", label, number, base, words=words, places=places, wanted=s, **more)


def _nulls(seeds: int, base: int) -> Iterator[Case]:
    for number in range(max(1, 5 * seeds)):
        for poses in POSES:
            for noise in NOISES:
                words = ("displacements", "displacements", "positions", "mixed")[number % 4]
                more: dict[str, Any] = {"words": words, "noise": noise, "poses": poses}
                yield _case("second_nulls", f"{noise}/{poses}", number, base, **more)


def _structures(seeds: int, base: int) -> Iterator[Case]:
    for number in range(max(1, round(3 * seeds / SEEDS))):
        for i, structure in enumerate(structures()):
            more = {"noise": STRESSED[(number + i) % len(STRESSED)], "poses": PLANNED[(number + i) % len(PLANNED)]}
            label = f"{structure.kind}/{structure.told.name}/{i}"
            yield _case("second_structures", label, number, base, words=str(i), **more)


def _unknowns(group: str, seeds: int, base: int) -> Iterator[Case]:
    for number in range(max(1, seeds)):
        for maker in _UNKNOWN[group]:
            for poses in UNKNOWN:
                label = f"{maker.__name__}/{poses}"
                yield _case(group, label, number, base, wanted=10.0, poses=poses)


_MAKERS: dict[str, Callable[[int, int], Iterator[Case]]] = {
    "second_effects": _effects,
    "second_nulls": _nulls,
    "second_structures": _structures,
    **{group: partial(_unknowns, group) for group in ASKED},
}


# ---------------------------------------------------------------- one case


@dataclass(frozen=True)
class Told:
    """A campaign with what is hidden in it: right names, the size s that it has, how many of the usual sizes."""

    campaign: Campaign
    hidden: Hidden
    names: tuple[str, ...]
    s: float = 0.0
    size: float = 0.0
    place: str = ""
    variable: str = ""


def make(case: Case) -> Told:
    """What is hidden; Unreachable where no place shows as much."""
    rng = np.random.default_rng([case.seed, 9])
    arm = list(ARMS.values())[int(rng.integers(len(ARMS)))]
    if case.group == "second_structures":
        return _structure(case, rng)
    if case.group == "second_nulls":
        setting = campaign_for(case.words, arm, case.poses, case.seed, case.noise)
        return Told(Campaign(_planned(replace(setting, recorded=bool(rng.integers(2))), rng)), Hidden(), ())
    if case.places is None:
        return _unknown(case, arm, rng)
    for a in map(int, rng.permutation(len(ARMS))):
        setting = campaign_for(case.words, list(ARMS.values())[a], case.poses, case.seed, case.noise)
        campaign = Campaign(_planned(setting, rng))
        try:
            effect, size = hide(campaign, case.places, case.wanted, rng)
        except Unreachable:
            continue
        return Told(campaign, effect.make(size), (effect.name,), campaign.s(effect.make(size)), size)
    raise Unreachable


def _unknown(case: Case, arm: Arm, rng: np.random.Generator) -> Told:
    maker = next(m for m in _UNKNOWN[case.group] if m.__name__ == case.id.split("/")[1])
    for _ in range(20):
        campaign = Campaign(Setting(arm, case.poses, case.seed, loads="many"))
        unknown = maker(arm, rng)
        try:
            size = campaign.sized(unknown.make, case.wanted, unknown.first, unknown.most)
        except Unreachable:
            arm = list(ARMS.values())[int(rng.integers(len(ARMS)))]
            continue
        s, usual = campaign.s(unknown.make(size)), size / unknown.first
        return Told(campaign, unknown.make(size), (), s, usual, unknown.place, unknown.variable)
    raise Unreachable


def _structure(case: Case, rng: np.random.Generator) -> Told:
    """An arm that is not that of its files; s: what the files' arm cannot absorb of it."""
    of = structures()[int(case.words)]
    setting = Setting(of.arm, case.poses, case.seed, of.kind, case.noise, loads=("two", "many")[case.number % 2])
    campaign = Campaign(_planned(replace(setting, told=of.told), rng))
    both, states = campaign.visits
    found = [(v.number, v.shown) for v in (both[0] if both else None, states) if v is not None]
    shown = {int(n): q for numbers, angles in found for n, q in zip(numbers, angles, strict=True)}
    plan = np.array([shown[n] for n in sorted(shown)])
    believed = Campaign(replace(campaign.setting, arm=of.told, told=None, plan=plan))
    more = campaign.whiten(campaign.clean(Hidden())) - campaign.whiten(believed.clean(Hidden()))
    s = float(np.linalg.norm(more - believed.fitted @ (believed.fitted.T @ more)))
    if s < PLAIN:
        raise Unreachable
    return Told(campaign, Hidden(), (of.name,), s)


def _planned(setting: Setting, rng: np.random.Generator) -> Setting:
    """Every third campaign has poses of a design in place of random ones."""
    if rng.integers(3) or any(a.lever for a in (setting.arm, setting.described)):
        return setting
    return replace(setting, plan=designed(setting.arm.name, setting.poses, int(rng.integers(2))))


@cache
def designed(name: str, poses: int, seed: int) -> Array:
    """Pendant angles (poses, n) rad of a plan by the product's own design."""
    from qsframework.experiment import load_experiment
    from qsframework.plans import design

    arm = ARMS[name]
    with tempfile.TemporaryDirectory() as folder:
        write_robot(arm, Path(folder) / "robot")
        weight = 9.81 * arm.payload
        markers = [f"  m{m}: {{xyz_mm: {[1e3 * c for c in xyz]}}}" for m, xyz in enumerate(arm.markers, 1)]
        loads = [f"  - {{name: weight, fz_N: {-0.9 * weight}}}"]
        loads += [f"  - {{name: pull, fz_N: {-0.9 * weight}, fy_N: {0.36 * weight}}}"]
        lines = ["robot: robot", f"load: {{point_mm: {[1e3 * c for c in arm.tool]}}}", "markers:", *markers]
        lines += ["noise: {sigma_mm: 0.03}", "loads:", *loads, "constraints: {load_capacity: false}"]
        path = Path(folder) / "experiment.yaml"
        path.write_text("\n".join(lines) + "\n")
        plan = design(load_experiment(path), poses, candidates=300, seed=seed)
    return np.asarray(np.deg2rad(np.round(np.rad2deg(plan.poses.pendant), 3)), dtype=np.float64)


def run(case: Case, code: str) -> Result:
    """Hide, write, diagnose from the files, and keep what the scores need."""
    out: Result = {"id": case.id, "group": case.group, "seed": case.seed, "code": code, "wanted": case.wanted}
    try:
        told = make(case)
    except (Unreachable, NoRest):
        return out | {"outcome": "unreachable"}
    setting = told.campaign.setting
    out |= {"arm": setting.arm.name, "kind": setting.kind, "noise": setting.noise, "loads": setting.loads}
    out |= {"poses": setting.poses, "designed": setting.plan is not None, "truth": told.names, "s": round(told.s, 2)}
    out |= {"size": round(told.size, 3), "place": told.place, "variable": told.variable}
    return out | answer(told, fresh=case.group in (*ASKED, "second_nulls"))


def answer(told: Told, fresh: bool = False) -> Result:
    """What the diagnosis says of these files; fresh: and what it is worth at poses that nobody has measured."""
    from qsframework.diagnoses import diagnose
    from qsframework.errors import QsfError
    from qsframework.experiment import load_experiment, read_readings

    with tempfile.TemporaryDirectory() as folder:
        readings = noisy(told.campaign, told.campaign.clean(told.hidden))
        experiment = load_experiment(write_campaign(told.campaign, readings, Path(folder)))
        start = time.process_time()
        try:
            assert experiment.data is not None
            d = diagnose(experiment, read_readings(experiment.data, experiment))
        except QsfError as error:
            return {"outcome": "refused", "error": f"{type(error).__name__}: {error}".replace(folder, "")[:300]}
        seconds = round(time.process_time() - start, 2)
    findings = [
        {
            "name": found.name,
            "alternatives": [r.name for r in found.alternatives],
            "doubtful": bool(found.doubtful),
            "s": round(found.s, 2),
            "p": float(found.p_value),
            "gain": round(found.heldout_gain, 3),
        }
        for found in d.findings
    ]
    return {
        "after": None if fresh is not True or not told.place else second_day(told, d),
        "outcome": "done",
        "seconds": seconds,
        "verdict": d.verdict,
        "findings": findings,
        "leftovers": [[x.law.name, float(x.p_value)] for x in d.leftovers[:3]],
        "learned": None if d.learned is None else [d.learned.name, d.learned.holds, round(d.learned.gain, 3)],
        **_said(d),
        "fresh": _fresh(told, d) if fresh else None,
        "rms_mm": [round(1e3 * v, 5) for v in (d.rms.heldout_identified, d.rms.heldout_extended, d.rms.noise)],
    }


def second_day(told: Told, found: Diagnosis) -> Result | None:
    """What the diagnosis says of both days, after the visits that it asked for, and with what it asked to mount; None
    where it asked for none."""
    from qsframework.diagnoses import follow_up
    from qsframework.errors import QsfError

    first, visits = told.campaign.setting, told.campaign.visits[0]
    try:
        start = time.process_time()
        asked = follow_up(found, MORE)
        seconds = round(time.process_time() - start, 2)
        assert visits is not None
        shown, pull = (visits[1].shown, asked.plan.pendant), (visits[1].force, asked.plan.wrench[:, :3])
        both = replace(first, plan=np.concatenate(shown), pull=np.concatenate(pull), poses=first.poses + MORE)
        better = [m for m in asked.mounts if m.chance > asked.after + _WORTH]
        reflectors = [_mount(m, told) for m in better if not m.along][:_MOUNTS]
        gauges = [_mount(m, told) for m in better if m.along][:_MOUNTS]
        out: Result = _both_days(told, Campaign(both), ())
        out["reflectors"] = _both_days(told, Campaign(both), reflectors) if reflectors else dict(out)
        out["gauges"] = _both_days(told, Campaign(both), [*reflectors, *gauges]) if gauges else out["reflectors"]
    except (QsfError, NoRest) as error:
        return {"error": f"{type(error).__name__}: {error}"[:200]}
    chances = [round(v, 3) for v in (asked.before, asked.after, asked.variable_before, asked.variable_after)]
    return out | {"seconds": seconds, "chances": chances, "asked": [m.marker.name for m in better]}


def _mount(asked: Any, told: Told) -> Mount:
    """What a second day asks to mount, on the arm of this campaign."""
    link = asked.marker.link
    where = {"world": -1, "base": 0}.get(link, int(link[1:]) if link[1:].isdigit() else 0)
    xyz = (float(asked.marker.xyz[0]), float(asked.marker.xyz[1]), float(asked.marker.xyz[2]))
    return Mount(asked.marker.name, link, (where, xyz), asked.along)


def _both_days(told: Told, day: Campaign, mounts: Sequence[Mount]) -> Result:
    """What a diagnosis says of both days, with readings of what is mounted on the second."""
    from qsframework.diagnoses import diagnose
    from qsframework.experiment import load_experiment, read_readings

    first = told.campaign.setting.poses
    built, places = told.campaign.built, [m.where for m in mounts]
    whole = day.clean(told.hidden, built, places)[0]
    clean, more = np.split(whole, [whole.shape[1] - len(mounts)], axis=1)
    touched = day.clean(replace(told.hidden, readings=()), built, places)[0][:, clean.shape[1] :]
    gauged = np.array([bool(m.along) for m in mounts], dtype=np.bool_)[:, None]
    more = np.where(gauged, touched, more)  # a gauge has no tracker
    before = told.campaign.clean(told.hidden)[0]
    later = noisy(day, (clean,))[0][first:]
    table = np.concatenate([clean[:first] + noisy(told.campaign, (before,))[0] - before, later])
    rng = np.random.default_rng([day.setting.seed, 4])
    sigma = np.array([GAUGE if m.along else SIGMA for m in mounts])
    with tempfile.TemporaryDirectory() as folder:
        path = write_campaign(day, (table,), Path(folder))
        if mounts:
            read = more[first:] + sigma[:, None] * rng.standard_normal(more[first:].shape)
            add_mounts(path, day, mounts, read, first)
        experiment = load_experiment(path)
        d = diagnose(experiment, read_readings(experiment.data, experiment))
    return {"verdict": d.verdict, **_said(d)}


def _said(d: Diagnosis) -> Result:
    """Places and variables that an answer speaks of."""
    return {
        "said": [[sorted(words) for words in both] for both in spoken(d)],
        "among": [[sorted(words) for words in both] for both in among(d)],
        "alike": [[sorted(words) for words in both] for both in alike(d)],
        "places": len(d.places),
        "share": round(d.places[0].share, 3) if d.places else 0.0,
    }


def _fresh(told: Told, found: Diagnosis) -> list[float] | None:
    """Errors, mm, at fresh poses: of the springs alone, of the extended model, of the oracle; None without a rest."""
    from qsframework.errors import QsfError

    try:
        errors = fresh_errors(told.campaign, told.hidden, found)
    except (QsfError, NoRest):
        return None
    return [round(1e3 * v, 5) for v in (errors.springs, errors.extended, errors.oracle)]


# ---------------------------------------------------------------- scores


def interval(hits: int, count: int) -> tuple[float, float]:
    """Of Clopper and Pearson, 95 %, by the quantiles of F."""

    def bound(share: float, more: int) -> float:
        a, b = hits + more, count - hits + 1 - more
        ratio = float(f.ppf(share, 2 * a, 2 * b)) * a / b
        return ratio / (1.0 + ratio)

    return bound(0.025, 0) if hits else 0.0, bound(0.975, 1) if hits < count else 1.0


def is_name(name: str, truth: str) -> bool:
    """Whether a name is the right one, or one of its parameters."""
    return name == truth or name.startswith(truth + ".")


def named(r: Result) -> bool:
    """Whether the right cause is a name, or a rival of one."""
    told = [n for found in r["findings"] for n in (found["name"], *found["alternatives"])]
    return all(any(is_name(n, truth) for n in told) for truth in r["truth"])


def wrong(r: Result) -> bool:
    """Whether the answer is sure of something else: where no library effect acts, of another place or variable."""
    if r["verdict"] != "explained":
        return False
    if r["truth"] or not r.get("place"):
        return not (r["truth"] and named(r))
    return not variable_right(r["said"], r["place"], r["variable"])


def alarmed(r: Result) -> bool:
    """Whether anything is said where nothing is hidden."""
    return r["verdict"] != "none"


def rate(label: str, goal: str, results: Sequence[Result], hit: Callable[[Result], bool]) -> Row:
    """Label, goal, measured, interval, cases, and whether the goal, such as `>= 95 %` or `-` for none, is met."""
    count, hits = len(results), sum(map(hit, results))
    if not count:
        return label, goal, "-", "-", 0, "-"
    low, high = interval(hits, count)
    p = hits / count
    if goal == "-":
        return label, goal, f"{100 * p:.1f} %", f"{100 * low:.1f} - {100 * high:.1f} %", count, "-"
    bound = float(goal.split()[1]) / 100.0
    least = goal.startswith(">")
    met = p >= bound if least else p <= bound
    near = high >= bound if least else low <= bound
    verdict = "yes" if met else "within the interval" if near else "no"
    return label, goal, f"{100 * p:.1f} %", f"{100 * low:.1f} - {100 * high:.1f} %", count, verdict


def learned(r: Result) -> bool:
    """Whether a law was learned that `--extend` writes."""
    return r["learned"] is not None and bool(r["learned"][1])


def _shares(results: Sequence[Result], share: Callable[[Fresh], float]) -> list[float]:
    """Of the oracle's gain at fresh poses, where there is any."""
    found = [share(Fresh(*r["fresh"])) for r in results if r["fresh"] is not None]
    return [v for v in found if np.isfinite(v)]


def learned_rows(results: Sequence[Result]) -> list[Row]:
    """The goals of learned laws where nothing is hidden."""
    nulls = [r for r in results if r["outcome"] == "done" and r["group"] == "second_nulls"]
    out = [rate("nothing hidden: a law learned", "<= 2 %", nulls, learned)]
    known = [r for r in nulls if r["fresh"] is not None]
    words = "nothing hidden: error at fresh poses more than 1.05 times that of the springs"
    out.append(rate(words, "<= 0 %", known, lambda r: Fresh(*r["fresh"]).harm > _HARM))
    return [row for row in out if row[4]]


def _title(group: str) -> str:
    """What its kinds are called: untouched kinds, kinds a."""
    return group.replace("_", " ") if "_" in group else f"{group} kinds"


def _unknown_rows(group: str, unknown: Sequence[Result]) -> list[Row]:
    kinds = _title(group)
    out = [rate(f"{kinds}, s = 10: confidently wrong", "<= 5 %", unknown, wrong)]
    out.append(rate(f"{kinds}: explained by a law of the library", "-", unknown, _explained))
    out.append(rate(f"{kinds}: nothing said", "-", unknown, lambda r: not alarmed(r)))
    for poses in ("", *UNKNOWN):
        own = [r for r in unknown if poses in ("", r["poses"])]
        where = f"{kinds}" + (f", {poses} poses" if poses else "")
        goals = (">= 95 %", ">= 85 %") if not poses else ("-", "-")
        out.append(rate(f"{where}: place right", goals[0], own, lambda r: place_right(r["said"], r["place"])))
        out.append(rate(f"{where}: place and variable right", goals[1], own, _variable_right))
        told = [r for r in own if "among" in r]
        out.append(rate(f"{where}: place among those told", "-", told, _place_told))
        out.append(rate(f"{where}: place and variable among those told", "-", told, _variable_told))
        out += _second_day_rows(where, [r for r in own if r.get("after")])
        moved = [r for r in own if "alike" in r]
        out.append(rate(f"{where}: place, or one that moves the markers alike", "-", moved, _place_alike))
    for poses, goal in ((40, 80.0), (14, 65.0)):
        own = [r for r in unknown if r["poses"] == poses and r["fresh"] is not None]
        words = f"{kinds}, {poses} poses: share of the oracle's gain at fresh poses, median"
        out.append(_median(words, goal, _shares(own, lambda f: f.share)))
        out.append(_median(f"{words}, in RMS", 0.0, _shares(own, lambda f: f.share_of_rms)))
        out.append(rate(f"{kinds}, {poses} poses: worse than the springs by 2 %", "<= 5 %", own, _worse))
    return out


def _second_day_rows(where: str, own: Sequence[Result]) -> list[Row]:
    """What both days say; a diagnosis that leaves nothing open has no second day, and counts as wrong."""
    out: list[Row] = []
    asked = (("", "85", "68"), ("reflectors", "92", "77"), ("gauges", "95", "85"))
    for what, place, variable in asked:
        after = [(r["after"].get(what, {}) if what else r["after"]) | {"of": r} for r in own]
        more = {"": "", "reflectors": " and the reflectors", "gauges": ", the reflectors and gauges"}[what]
        label = f"{where}, after {MORE} visits{more} that it asked for"
        goals = (f">= {place} %", f">= {variable} %") if "," not in where else ("-", "-")
        out.append(rate(f"{label}: place, or one of the same motion", goals[0], after, _place_settled))
        out.append(rate(f"{label}: place and variable", goals[1], after, _variable_settled))
    return out


def _place_settled(after: Result) -> bool:
    return "said" in after and place_right([*after["said"], *after["alike"]], after["of"]["place"])


def _variable_settled(after: Result) -> bool:
    return "said" in after and variable_right(after["said"], after["of"]["place"], after["of"]["variable"])


def _place_told(r: Result) -> bool:
    return place_right(r["among"], r["place"])


def _place_alike(r: Result) -> bool:
    return place_right([*r["among"], *r["alike"]], r["place"])


def _variable_told(r: Result) -> bool:
    return variable_right(r["among"], r["place"], r["variable"])


def _variable_right(r: Result) -> bool:
    return variable_right(r["said"], r["place"], r["variable"])


def by_kind(results: Sequence[Result], group: str) -> str:
    """What became of each kind of unknown effect."""
    cells: list[tuple[object, ...]] = []
    own = [r for r in results if r["group"] == group and r["outcome"] == "done"]
    for kind in sorted({r["id"].split("/")[1] for r in own}):
        for poses in UNKNOWN:
            some = [r for r in own if r["id"].split("/")[1] == kind and r["poses"] == poses]
            if not some:
                continue
            shares = _shares(some, lambda f: f.share)
            right = [sum(place_right(r["said"], r["place"]) for r in some), sum(map(_variable_right, some))]
            gain = f"{100 * float(np.median(shares)):.0f} %" if shares else "-"
            cells.append(
                (kind.replace("_", " "), some[0]["variable"], poses, len(some), *right, sum(map(wrong, some)), gain)
            )
    head = ("kind", "by", "poses", "cases", "place right", "variable too", "confidently wrong", "share of the gain")
    return table(head, cells)


def _explained(r: Result) -> bool:
    return r["verdict"] == "explained"


def _worse(r: Result) -> bool:
    return Fresh(*r["fresh"]).harm > _WORSE


def _median(label: str, goal: float, values: Sequence[float]) -> Row:
    """A median with its interval by order statistics, 95 %."""
    if not values:
        return label, "-", "-", "-", 0, "-"
    ordered, n = np.sort(values), len(values)
    draws = np.random.default_rng(0).choice(ordered, (2000, n))
    low, high = np.quantile(np.median(draws, axis=1), [0.025, 0.975])
    middle = 100.0 * float(np.median(ordered))
    said = f">= {goal:g} %" if goal else "-"
    met = "-" if not goal else "yes" if middle >= goal else "within the interval" if 100.0 * high >= goal else "no"
    return label, said, f"{middle:.0f} %", f"{100 * low:.0f} - {100 * high:.0f} %", n, met


def rows(results: Sequence[Result]) -> list[Row]:
    """The goals."""
    done = [r for r in results if r["outcome"] == "done"]
    effects = [r for r in done if r["group"] == "second_effects"]
    out: list[Row] = []
    for s, right, bad in ((10.0, ">= 95 %", "<= 1 %"), (5.0, ">= 65 %", "<= 2 %")):
        chosen = [r for r in effects if r["wanted"] == s]
        out.append(rate(f"library effects, s = {s:g}: named, or in the set", right, chosen, named))
        out.append(rate(f"library effects, s = {s:g}: confidently wrong", bad, chosen, wrong))
    right_ones = [r for r in effects if (r["wanted"], r["poses"]) == (10.0, 40) and named(r)]
    out.append(
        rate("library effects, s = 10, 40 poses: right names that stay explained", ">= 93 %", right_ones, _explained)
    )
    nulls = [r for r in done if r["group"] == "second_nulls"]
    out.append(rate("nothing hidden: said something", "<= 5 %", nulls, alarmed))
    for poses in POSES:
        chosen = [r for r in nulls if r["poses"] == poses]
        out.append(rate(f"nothing hidden, {poses} poses: said something", "<= 5 %", chosen, alarmed))
    for noise in NOISES:
        chosen = [r for r in nulls if r["noise"] == noise]
        out.append(rate(f"nothing hidden, {noise.replace('_', ' ')}: said something", "<= 5 %", chosen, alarmed))
    out.append(
        rate("another structure: named", ">= 95 %", [r for r in done if r["group"] == "second_structures"], named)
    )
    out += learned_rows(done)
    return [row for row in out if row[4]]


def parts(results: Sequence[Result]) -> str:
    """The library effects by readings, poses, noise and plan."""
    done = [r for r in results if r["outcome"] == "done" and r["group"] == "second_effects"]
    cells: list[tuple[object, ...]] = []
    for what in ("kind", "poses", "noise", "arm", "designed"):
        for value in sorted({r[what] for r in done}, key=str):
            for s in SIZES:
                chosen = [r for r in done if r[what] == value and r["wanted"] == s]
                if chosen:
                    right, bad = (f"{100 * sum(map(hit, chosen)) / len(chosen):.0f} %" for hit in (named, wrong))
                    cells.append((f"{what}: {str(value).replace('_', ' ')}", f"{s:g}", len(chosen), right, bad))
    return table(("campaigns", "s", "cases", "named, or in the set", "confidently wrong"), cells)


def called(results: Sequence[Result]) -> str:
    """What each effect and each structure was called, by the first name."""
    done = [r for r in results if r["outcome"] == "done" and r["group"] in ("second_effects", "second_structures")]
    cells: list[tuple[object, ...]] = []
    for kind in sorted({_kind(r) for r in done}):
        for s in sorted({r["wanted"] for r in done}, reverse=True):
            own = [r for r in done if _kind(r) == kind and r["wanted"] == s]
            count = Counter(map(_called, own))
            words = ", ".join(f"{name} {n}" for name, n in count.most_common())
            cells += [(kind, f"{s:g}" if s else "-", len(own), sum(map(named, own)), words)] if own else []
    return table(("hidden", "s", "cases", "named, or in the set", "called"), cells)


def _kind(r: Result) -> str:
    truth = r["truth"][0]
    return truth if ":" in truth else truth.partition("[")[0]


def _called(r: Result) -> str:
    if not r["findings"]:
        return "nothing" if r["verdict"] == "none" else "unexplained"
    first = r["findings"][0]["name"]
    right = any(is_name(first, truth) for truth in r["truth"])
    name = "itself" if right else first if ":" in first else first.partition("[")[0]
    more = " + more" if len(r["findings"]) > 1 else ""
    return name + more + (" + unexplained" if r["verdict"] == "partly_explained" else "")


def false_alarms(results: Sequence[Result]) -> str:
    """Campaigns with nothing hidden on which something was said, of how many, by noise and number of poses."""
    nulls = [r for r in results if r["group"] == "second_nulls" and r["outcome"] == "done"]
    body: list[tuple[str, ...]] = []
    for noise in NOISES:
        cells = [[r for r in nulls if r["noise"] == noise and r["poses"] == poses] for poses in POSES]
        body.append((noise.replace("_", " "), *(f"{sum(map(alarmed, c))} of {len(c)}" for c in cells)))
    return table(("noise", *(f"{poses} poses" for poses in POSES)), body)


HEAD = ("metric", "goal", "measured", "95 %", "cases", "goal met")


def report(results: Sequence[Result]) -> str:
    """All tables as Markdown; empty where no case of this generator was run."""
    own = [r for r in results if r["group"] in GROUPS]
    if not own:
        return ""
    return "\n\n".join(
        [
            table(HEAD, rows(own)),
            "#### Nothing hidden: how often something was said",
            false_alarms(own),
            "#### By campaign",
            parts(own),
            "#### What each effect was called by the second generator",
            called(own),
            _outcomes(own),
        ]
    )


def unknown_report(results: Sequence[Result]) -> str:
    """The tables of unknown kinds as Markdown; empty where none were run."""
    own = [r for r in results if r["group"] in ASKED]
    if not own:
        return ""
    out: list[str] = []
    for group in ASKED:
        some = [r for r in own if r["group"] == group]
        done = [r for r in some if r["outcome"] == "done"]
        if some:
            out += [f"#### {_title(group).capitalize()}", table(HEAD, [r for r in _unknown_rows(group, done) if r[4]])]
            out += [by_kind(some, group)]
    return "\n\n".join([*out, _outcomes(own)])


def _outcomes(results: Sequence[Result]) -> str:
    outcomes = Counter(r["outcome"] for r in results)
    times = [r["seconds"] for r in results if r["outcome"] == "done"]
    tail = "Outcomes: " + ", ".join(f"{n} {o}" for o, n in outcomes.most_common()) + "."
    return tail + f" CPU of a diagnosis, one thread: median {np.median(times):.1f} s, at most {max(times):.1f} s."

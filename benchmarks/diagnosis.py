"""What the diagnosis finds of effects that were hidden from it: `docs/results.md` holds the tables.

    python benchmarks/diagnosis.py [--quick] [--seeds 12] [--cases nulls,effects,...] [--out cases.jsonl] [--write]

Each case hides something in an experiment.yaml and its readings, by `benchmarks/hidden.py` or by the second generator,
which imports nothing of the package (`benchmarks/second_generator.py`); the diagnosis sees these files and nothing
else. The group `untouched` runs only where `--cases` names it. Results go to the checkpoint `--out` one line each: a
run that was stopped goes on where it was, and ends with the same numbers. `--score` scores what is there.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import tempfile
import time
import traceback
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from datetime import date
from functools import cache
from pathlib import Path
from typing import Any

import hidden
import numpy as np
import second_generator as second
from common import cores, replace_between, shelved, table
from hidden import CONVENTIONS, ROBOTS, STRESSES, UNKNOWN, Case, Setting, Truth
from threadpoolctl import threadpool_limits

from qsframework.files import write_text

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "docs" / "results.md"
SIZES = (4.0, 4.5, 6.0, 8.0, 12.0, 40.0)
PAIRED = (
    "joint_hardening",
    "joint_backlash",
    "offaxis_compliance",
    "link_compliance",
    "base_compliance",
    "flange_compliance",
    "load_direction",
    "tracker_frame",
    "bar_compliance",
)
ALIASED = ("offaxis_compliance", "link_compliance", "base_compliance", "flange_compliance")
GROUPS = (
    "nulls",
    "stress",
    "effects",
    "pairs",
    "triples",
    "aliases",
    "unknown",
    "unseen",
    "protocol",
    "conventions",
    "visible",
)
PROTOCOLS = {
    "gravity load only": {"loads": "gravity"},
    "one marker": {"markers": 1},
    "20 poses": {"poses": 20},
    "40 poses": {"poses": 40},
    "100 poses": {"poses": 100},
}
FULL = 12
DEGREES = float(np.rad2deg(hidden.ALIAS))
Result = dict[str, Any]


# ---------------------------------------------------------------- which cases


def kinds() -> list[str]:
    """Names of all effects that can act somewhere on one of the robots, third parties' included."""
    found: set[str] = set()
    for robot in ROBOTS:
        instances = hidden.instances_of(hidden.experiment_of(robot, 3), True)
        found |= {i.effect.effect_name() for i in instances.values()}
    return sorted(found)


def first_cases(seeds: int, groups: Sequence[str], base: int) -> list[Case]:
    """The cases of the chosen groups; their numbers are in proportion to `seeds`, with 400 nulls at 12."""

    def many(count: int) -> int:
        return max(1, round(count * seeds / FULL))

    makers: dict[str, Iterable[tuple[str, dict[str, Any]]]] = {
        "nulls": (("null", {}) for _ in range(many(400))),
        "stress": ((s, {"stress": s}) for s in STRESSES for _ in range(many(100))),
        "effects": ((f"{k}/{s:g}", {"effects": ((k, s),)}) for k in kinds() for s in SIZES for _ in range(seeds)),
        "pairs": _several(2, many(100), base),
        "triples": _several(3, many(40), base),
        "aliases": ((k, {"effects": ((k, 12.0),), "alias": True}) for k in ALIASED for _ in range(many(10))),
        "unknown": [
            (f"{kind}/{s:g}", {"unknown": (kind, s)})
            for s, known in ((8.0, UNKNOWN), (12.0, (*UNKNOWN, hidden.UNTOLD)))
            for kind in known
            for _ in range(many(40 if kind in UNKNOWN else 12))
        ],
        "unseen": [
            (f"{k}/{s:g}", {"unknown": (k, s)}) for k in hidden.UNSEEN for s in (8.0, 12.0) for _ in range(many(40))
        ],
        "protocol": _protocols(many(24), many(48)),
        "conventions": ((c, {"convention": c}) for c in CONVENTIONS for _ in range(many(8))),
        "visible": (("all", {}) for _ in range(min(8, many(8)))),
    }
    cases: list[Case] = []
    for group in groups:
        count: Counter[str] = Counter()
        for label, what in makers[group]:
            count[label] += 1
            cases.append(_case(f"{group}/{label}/{count[label]}", group, count[label], base, what))
    return cases


def _case(name: str, group: str, number: int, base: int, what: dict[str, Any]) -> Case:
    seed = zlib.crc32(f"{base}/{name}".encode())
    effects = what.get("effects", ())
    needs = any(hidden.registry()[kind].needs for kind, _ in effects)
    drift = what.get("unknown", ("",))[0] == "load_cell_drift"
    recorded = needs or drift or seed % 2 == 0 or group == "visible"
    every = 2 if group == "conventions" else 4
    robot = "fanuc_r2000ic" if number % every == 0 else "fanuc_m900ib"
    setting = Setting(robot, recorded=recorded, plan=(seed >> 4) % 8, **what.pop("setting", {}))
    return Case(name, group, seed, setting, **what)


def _several(count: int, number: int, base: int) -> Iterator[tuple[str, dict[str, Any]]]:
    rng = np.random.default_rng([base, count])
    for _ in range(number):
        chosen = rng.choice(len(PAIRED), count, replace=False)
        effects = tuple((PAIRED[k], 12.0) for k in sorted(chosen))
        yield "+".join(k for k, _ in effects), {"effects": effects, "apart": True}


def _protocols(nulls: int, effects: int) -> Iterator[tuple[str, dict[str, Any]]]:
    for name, setting in PROTOCOLS.items():
        for _ in range(nulls):
            yield f"{name}/null", {"setting": dict(setting)}
        for k in range(effects):
            yield f"{name}/effect", {"setting": dict(setting), "effects": ((PAIRED[k % len(PAIRED)], 8.0),)}


# ---------------------------------------------------------------- one case


@cache
def code(*generator: str) -> str:
    """What the results depend on: a hash of the package, the physics, the robots and the generator's files."""
    digest = hashlib.sha256()
    root = HERE.parent
    sources = [
        *(HERE / name for name in generator or ("hidden.py",)),
        *(p for part in ("qsframework", "plugins", "robots") for p in (root / part).rglob("*")),
    ]
    for path in sorted(p for p in sources if p.suffix in (".py", ".yaml", ".xacro") and "_version" not in p.name):
        if not {"cli", "report", "viz", "applications"} & set(path.parts):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def code_of(case: Case | second.Case) -> str:
    """Of its generator."""
    return code() if isinstance(case, Case) else code(*second.FILES)


def run(case: Case | second.Case) -> Result:
    """One case of either generator; what went wrong is a result too."""
    if isinstance(case, Case):
        return _run(case)
    try:
        return second.run(case, code_of(case))
    except Exception as error:  # a crash must not stop the benchmark
        out: Result = {"id": case.id, "group": case.group, "seed": case.seed, "code": code_of(case)}
        text = f"{type(error).__name__}: {error}"[:400]
        return out | {"outcome": "failed", "error": text, "trace": traceback.format_exc()[-800:]}


def _run(case: Case) -> Result:
    """Hide, write, diagnose from the files, and keep what the scores need."""
    out: Result = {
        "id": case.id,
        "group": case.group,
        "seed": case.seed,
        "code": code(),
        "robot": case.setting.robot,
        "wanted": [s for _, s in case.effects] or ([case.unknown[1]] if case.unknown else []),
        "kind": "+".join(k for k, _ in case.effects) or (case.unknown or ("",))[0],
    }
    try:
        truth = hidden.hide(case)
    except hidden.Unreachable as none:
        return out | {"outcome": "unreachable", "skipped": [n for n in str(none).split(", ") if n]}
    out["truth"] = truth.as_json()
    try:
        out |= _diagnosed(case, truth)
    except Exception as error:  # a refusal is right for some cases, and a crash must not stop the benchmark
        refused = type(error).__name__ == "InputError" and case.convention == "metres"
        text = re.sub(r"\S*/(readings\.csv|experiment\.yaml)", r"\1", f"{type(error).__name__}: {error}")
        out |= {
            "outcome": "refused" if refused else "failed",
            "error": text[:400],
            "trace": "" if refused else traceback.format_exc()[-800:],
        }
    return out


def _diagnosed(case: Case, truth: Truth) -> Result:
    from qsframework.diagnoses.diagnose import diagnose
    from qsframework.experiment import load_experiment, read_readings
    from qsframework.report.result_json import diagnosis_json

    with tempfile.TemporaryDirectory() as folder:
        path = hidden.write_case(truth, folder)
        clock: dict[str, float] = {"start": time.process_time()}
        experiment = load_experiment(path)
        assert experiment.data is not None
        readings = read_readings(experiment.data, experiment)
        d = diagnose(experiment, readings, progress=lambda step, *_: clock.setdefault(step, time.process_time()))
        seconds = time.process_time() - clock["start"]
    told = json.loads(json.dumps(diagnosis_json(d)))
    out: Result = {
        "outcome": "done",
        "seconds": round(seconds, 3),
        "search_s": round(clock.get("test for remaining signal", np.nan) - clock.get("search", np.nan), 3),
        "verdict": told["verdict"],
        "causes": [{"id": c["id"], "alternatives": c["alternatives"], "p": c["p_value"]} for c in told["causes"]],
        "conventions": told.get("conventions", []),
        "problems": [p["id"] for p in told["data_problems"]],
        "leftovers": told.get("leftovers", [])[:1],
        "rms_mm": told["rms_per_axis_mm"],
    }
    out["off"] = _off(truth, told)
    if case.group == "visible":
        out["invisible"] = _invisible(truth, told)
    elif case.convention is None:
        out["angles"] = _angles(truth, told)
        if truth.instances and len(out["causes"]) > 0:
            out["fresh_mm"] = _fresh(truth, d)
    return out


def _off(truth: Truth, told: Result) -> dict[str, float]:
    """Estimated minus true values of the hidden parameters in sds, where the cause is named."""
    found = {name: p for c in told["causes"] for name, p in c["parameters"].items()}
    return {
        n: round((found[n]["value"] - v) / found[n]["sd"], 2)
        for n, v in truth.values.items()
        if n in found and found[n]["sd"]
    }


def _angles(truth: Truth, told: Result) -> list[dict[str, float]]:
    """For each hidden effect: angle (deg) between what it did and what each named cause or rival can do."""
    h = truth.hider
    names = {n for c in told["causes"] for n in (c["id"], *c["alternatives"])}
    spaces = {n: h.subspace(h.instances[n]) for n in sorted(names) if n in h.instances}
    return [{n: round(float(np.rad2deg(hidden.angle(v, q))), 2) for n, q in spaces.items()} for v in truth.vectors]


def _invisible(truth: Truth, told: Result) -> dict[str, list[Any]]:
    """Instances that cannot be seen by the exact model, and those that the diagnosis declares."""
    h = truth.hider
    reached = {n: h.reaches(i) for n, i in h.instances.items()}
    declared = sorted(x["id"] for x in told["table"] if x["status"].startswith("invisible"))
    return {
        "own": sorted([n, round(r, 2)] for n, r in reached.items() if r < 1.15 * hidden.VISIBLE),
        "declared": declared,
        "all": len(reached),
    }


def _fresh(truth: Truth, d: Any) -> dict[str, float]:
    """RMS error, mm, at 60 other poses without noise: identified, extended, and the fit of the true effects."""
    setting = replace(truth.case.setting, plan=truth.case.setting.plan + 100, poses=60)
    poses = hidden.campaign(setting)
    h = truth.hider
    own = [p.name for i in truth.instances for k, p in enumerate(i.parameters) if h.switches(i, k)]
    oracle = hidden.Absorber(truth.model, truth.poses, truth.x, [*truth.experiment.fit_names(), *own])
    best = oracle.fit(hidden.measured(truth), weak=hidden.LIMIT, free=len(own))[0]
    wanted = hidden.exact(truth.model, poses, truth.x)

    def error(model: Any, x: Any) -> float:
        return round(1e3 * float(np.sqrt(np.mean((hidden.exact(model, poses, x) - wanted) ** 2))), 6)

    return {
        "identified": error(d.baseline.model, d.baseline.x),
        "extended": error(d.extended.model, d.extended.x),
        "oracle": error(truth.model, best),
    }


# ---------------------------------------------------------------- all cases


def run_all(cases: Sequence[Case | second.Case], out: Path, workers: int, any_code: bool = False) -> list[Result]:
    """Run what the checkpoint does not hold yet, or of other code; results in the order of the cases."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    done = read_checkpoint(out)

    def fits(case: Case | second.Case) -> bool:
        r = done.get(case.id)
        right = r is not None and r["seed"] == case.seed and r["outcome"] != "failed"
        return right and (any_code or r["code"] == code_of(case))

    left = [c for c in cases if not fits(c)]
    left.sort(key=lambda c: zlib.crc32(c.id.encode()))  # so that a part of a run is a fair sample of all groups
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with (
        out.open("a") as file,
        ProcessPoolExecutor(workers, initializer=threadpool_limits, initargs=(1,)) as pool,
        Progress(*columns) as bar,
    ):
        task = bar.add_task("hidden effects", total=len(cases), completed=len(cases) - len(left))
        for future in as_completed([pool.submit(run, c) for c in left]):
            result = future.result()
            done[result["id"]] = result
            file.write(json.dumps(result) + "\n")
            file.flush()
            bar.advance(task)
    return [done[c.id] for c in cases]


def read_checkpoint(path: Path) -> dict[str, Result]:
    """Results by case; a line that a kill cut short is dropped."""
    done: dict[str, Result] = {}
    text = path.read_text() if path.exists() else ""
    for line in text.splitlines():
        try:
            result = json.loads(line)
            done[result["id"]] = result
        except (ValueError, KeyError):
            continue
    if text and not text.endswith("\n"):
        write_text(path, "".join(json.dumps(r) + "\n" for r in done.values()))
    return done


# ---------------------------------------------------------------- scores


def wilson(hits: int, count: int) -> tuple[float, float]:
    """95 % interval of a rate."""
    if not count:
        return 0.0, 1.0
    z, p = 1.959964, hits / count
    middle = (p + z * z / (2 * count)) / (1 + z * z / count)
    half = z * np.sqrt(p * (1 - p) / count + z * z / (4 * count**2)) / (1 + z * z / count)
    return float(max(0.0, middle - half)), float(min(1.0, middle + half))


def alarmed(r: Result) -> bool:
    return r["verdict"] != "none"


def flagged(r: Result) -> bool:
    return r["verdict"] in ("partly_explained", "unexplained")


def named(r: Result, i: int = 0) -> bool:
    """Whether hidden effect i has been named, or is in a set all of whose members are its aliases."""
    truth = r["truth"]["effects"][i]
    for c in r["causes"]:
        if c["id"] == truth:
            return True
        members = (c["id"], *c["alternatives"])
        if truth in members and all(m == truth or r["angles"][i].get(m, 90.0) < DEGREES for m in members):
            return True
    return False


def matched(r: Result, i: int) -> bool:
    """`named`, or the name itself is an alias whether or not the set says so."""
    return named(r, i) or any(r["angles"][i].get(c["id"], 90.0) < DEGREES for c in r["causes"])


def covered(r: Result, i: int = 0) -> bool:
    return any(r["truth"]["effects"][i] in (c["id"], *c["alternatives"]) for c in r["causes"])


def exactly(r: Result) -> bool:
    return sorted(c["id"] for c in r["causes"]) == sorted(r["truth"]["effects"])


def up_to_aliases(r: Result) -> bool:
    effects = r["truth"]["effects"]
    return len(r["causes"]) == len(effects) and all(covered(r, i) or matched(r, i) for i in range(len(effects)))


def share(r: Result) -> float:
    """Share of the mean squared error that the true effects' fit takes away which the diagnosis takes away too."""
    f = r["fresh_mm"]
    most = f["identified"] ** 2 - f["oracle"] ** 2
    return (f["identified"] ** 2 - f["extended"] ** 2) / most if most > 0 else 1.0


def worse(r: Result) -> bool:
    e = r["rms_mm"]
    return e["heldout_extended"] > e["heldout_identified"] * (1 + 1e-9)


Row = tuple[str, str, str, str, int, str]


def rate(
    label: str,
    goal: str,
    results: Sequence[Result],
    hit: Callable[[Result], bool],
    least: float | None = None,
    most: float | None = None,
) -> Row:
    """A row of the table: measured rate, its interval, cases, and whether the goal is met or within the interval."""
    count, hits = len(results), sum(map(hit, results))
    low, high = wilson(hits, count)
    p = hits / count if count else float("nan")
    met = (least is None or p >= least) and (most is None or p <= most)
    near = (least is None or high >= least) and (most is None or low <= most)
    verdict = "-" if not count else "yes" if met else "within the interval" if near else "no"
    return label, goal, f"{100 * p:.1f} %", f"{100 * low:.1f} - {100 * high:.1f} %", count, verdict


def scores(results: Sequence[Result]) -> list[Row]:
    """The issue's table."""
    done = [r for r in results if r["outcome"] == "done"]

    def of(group: str, *sizes: float) -> list[Result]:
        chosen = [r for r in done if r["group"] == group and r["kind"] != hidden.UNTOLD]
        return [r for r in chosen if not sizes or r["wanted"][0] in sizes]

    rows = [rate("false alarms, nominal", "<= 5 %", of("nulls"), alarmed, most=0.05)]
    for stress in STRESSES:
        chosen = [r for r in of("stress") if f"/{stress}/" in r["id"]]
        rows.append(rate(f"false alarms, {stress.replace('_', ' ')}", "<= 8 %", chosen, alarmed, most=0.08))
    rows.append(rate("detected, s = 4.5", ">= 85 %", of("effects", 4.5), alarmed, least=0.85))
    for s, least in ((6.0, 0.95), (8.0, 0.99)):
        rows.append(rate(f"named right, s = {s:g}", f">= {100 * least:g} %", of("effects", s), named, least=least))
    rows.append(rate("set covers the truth, s = 8", ">= 93 %", of("effects", 8.0), covered, least=0.93))
    rows.append(_set_size(of("effects", 8.0)))
    rows.append(rate("two causes, s = 12: exact", ">= 85 %", of("pairs"), exactly, least=0.85))
    rows.append(rate("two causes, s = 12: up to aliases", ">= 95 %", of("pairs"), up_to_aliases, least=0.95))
    for s, least in ((8.0, 0.90), (12.0, 0.98)):
        rows.append(
            rate(f"unknown cause flagged, s = {s:g}", f">= {100 * least:g} %", of("unknown", s), flagged, least=least)
        )
    rows.append(
        rate(
            "unknown cause confidently wrong, s = 8",
            "<= 5 %",
            of("unknown", 8.0),
            lambda r: r["verdict"] == "explained",
            most=0.05,
        )
    )
    large = of("effects", 8.0, 12.0, 40.0)
    rows.append(_mean_share(large))
    rows.append(rate("held-out error worse than before, s >= 8", "<= 1 %", large, worse, most=0.01))
    rows.append(_declared(of("visible")))
    rows.append(_time("time, CPU, one thread: median", 20.0, [r["seconds"] for r in done if _is_base(r)]))
    rows.append(_time("time, the search alone: median", 0.5, [r["search_s"] for r in done if _is_base(r)]))
    return rows


def _set_size(results: Sequence[Result]) -> Row:
    sizes = [1 + len(c["alternatives"]) for r in results for c in r["causes"]]
    mean = float(np.mean(sizes)) if sizes else float("nan")
    half = 1.96 * float(np.std(sizes)) / np.sqrt(max(len(sizes), 1)) if sizes else float("nan")
    met = "yes" if mean <= 1.5 else "within the interval" if mean - half <= 1.5 else "no"
    return (
        "mean size of a set, s = 8",
        "<= 1.5",
        f"{mean:.2f}",
        f"{mean - half:.2f} - {mean + half:.2f}",
        len(sizes),
        met,
    )


def _mean_share(results: Sequence[Result]) -> Row:
    values = np.array([share(r) if "fresh_mm" in r else 0.0 for r in results])
    values = np.clip(values, -1.0, 1.5)
    rng = np.random.default_rng(0)
    means = [float(rng.choice(values, len(values)).mean()) for _ in range(2000)] if len(values) else [float("nan")]
    low, high = np.percentile(means, [2.5, 97.5])
    mean = float(values.mean()) if len(values) else float("nan")
    met = "yes" if mean >= 0.9 else "within the interval" if high >= 0.9 else "no"
    return (
        "gain at fresh poses against the oracle, s >= 8",
        ">= 0.9",
        f"{mean:.2f}",
        f"{low:.2f} - {high:.2f}",
        len(values),
        met,
    )


def _declared(results: Sequence[Result]) -> Row:
    """Effects below 0.9 of the limit must be declared; beside the limit two linearisations may differ."""
    own = [
        (n, r["invisible"]["declared"]) for r in results for n, s in r["invisible"]["own"] if s < 0.9 * hidden.VISIBLE
    ]
    hits = sum(n in declared for n, declared in own)
    low, high = wilson(hits, len(own))
    p = hits / len(own) if own else float("nan")
    return (
        "invisible effects declared",
        "all",
        f"{100 * p:.1f} %",
        f"{100 * low:.1f} - {100 * high:.1f} %",
        len(own),
        ("yes" if hits == len(own) else "no"),
    )


def _is_base(r: Result) -> bool:
    return r["group"] != "protocol"


def _time(label: str, most: float, taken: Sequence[float]) -> Row:
    if not taken:
        return label, f"<= {most:g} s", "-", "-", 0, "-"
    low, high = np.percentile(taken, [2.5, 97.5])
    met = "yes" if np.median(taken) <= most else "no"
    return label, f"<= {most:g} s", f"{np.median(taken):.2f} s", f"{low:.2f} - {high:.2f} s", len(taken), met


def by_size(results: Sequence[Result]) -> str:
    """Detection and naming over s, single hidden effects."""
    rows = []
    for s in SIZES:
        chosen = [r for r in results if r["outcome"] == "done" and r["group"] == "effects" and r["wanted"][0] == s]
        if not chosen:
            continue
        off = [v for r in chosen for v in r["off"].values()]
        sizes = [1 + len(c["alternatives"]) for r in chosen for c in r["causes"]]
        asked = (alarmed, named, lambda r: matched(r, 0), covered, lambda r: len(r["causes"]) > 1)
        cells = [f"{100 * sum(map(f, chosen)) / len(chosen):.1f} %" for f in asked]
        inside = f"{100 * np.mean(np.abs(off) <= 3.0):.1f} %" if off else "-"
        rows.append([f"{s:g}", len(chosen), *cells, f"{np.mean(sizes):.2f}" if sizes else "-", inside])
    head = (
        "s",
        "cases",
        "detected",
        "named right",
        "up to aliases",
        "set covers",
        "more than one named",
        "set size",
        "parameters within 3 sd",
    )
    return table(head, rows)


def confusion(results: Sequence[Result], *sizes: float) -> str:
    """What each effect was called, by the first name; effects of the library and outside."""
    rows = []
    chosen = [r for r in results if r["outcome"] == "done" and r["group"] in ("effects", "unknown", "unseen")]
    chosen = [r for r in chosen if r["wanted"][0] in sizes]
    for kind in sorted({r["kind"] for r in chosen}):
        own = [r for r in chosen if r["kind"] == kind]
        called = Counter(_called(r) for r in own)
        right = sum(named(r) for r in own) if own[0]["truth"]["effects"] else 0
        told = ", ".join(f"{name} {count}" for name, count in called.most_common())
        rows.append([kind, len(own), right, told])
    return table(("hidden", "cases", "named right", "called"), rows)


def _called(r: Result) -> str:
    if not r["causes"]:
        return "nothing" if r["verdict"] == "none" else "unexplained"
    first = r["causes"][0]["id"]
    more = " + more" if len(r["causes"]) > 1 else ""
    left = " + unexplained" if r["verdict"] == "partly_explained" else ""
    place = " elsewhere" if r["truth"]["effects"] and first not in r["truth"]["effects"] else ""
    kind = first.partition("[")[0]
    return kind + (place if kind == r["kind"] else "") + more + left


def others(results: Sequence[Result]) -> str:
    """Triples, aliases, protocols and conventions."""
    done = [r for r in results if r["outcome"] == "done"]
    rows: list[Row] = []

    def of(start: str) -> list[Result]:
        return [r for r in done if r["id"].startswith(start)]

    rows.append(rate("three causes, s = 12: exact", "", of("triples"), exactly))
    rows.append(rate("three causes, s = 12: up to aliases", "", of("triples"), up_to_aliases))
    rows.append(rate("an effect with an alias, s = 12: set covers the truth", "", of("aliases"), covered))
    rows.append(rate("an effect with an alias, s = 12: up to aliases", "", of("aliases"), up_to_aliases))
    for name in PROTOCOLS:
        rows.append(rate(f"{name}: false alarms", "", of(f"protocol/{name}/null"), alarmed))
        rows.append(rate(f"{name}: named right, s = 8", "", of(f"protocol/{name}/effect"), named))
    wanted = {
        "coupling_plus": "controller_coupling[joint_3]",
        "coupling_minus": "controller_coupling[joint_3]",
        "swapped_axes": "displacement_axes",
        "sign": "displacement_sign",
    }
    for convention, name in wanted.items():
        label = f"{convention.replace('_', ' ')}: named {name}"
        rows.append(rate(label, "", of(f"conventions/{convention}"), lambda r, name=name: name in _names(r)))
    for kind in hidden.UNSEEN:
        for size in ("8", "12"):
            rows.append(
                rate(
                    f"unknown: {kind.replace('_', ' ')}, s = {size}: flagged", "", of(f"unseen/{kind}/{size}/"), flagged
                )
            )
            rows.append(
                rate(
                    f"unknown: {kind.replace('_', ' ')}, s = {size}: confidently wrong",
                    "",
                    of(f"unseen/{kind}/{size}/"),
                    lambda r: r["verdict"] == "explained",
                )
            )
    rows.append(
        rate(
            "hose of two series, s = 12: a noise problem is named or it is flagged",
            "",
            of(f"unknown/{hidden.UNTOLD}"),
            lambda r: bool(r["problems"]) or alarmed(r),
        )
    )
    metres = [r for r in results if r["id"].startswith("conventions/metres")]
    rows.append(
        rate("millimetres called metres: refused by the reader", "", metres, lambda r: r["outcome"] == "refused")
    )
    rows.append(rate("nulls on which a noise problem is named", "", of("nulls"), lambda r: bool(r["problems"])))
    return table(("what", "measured", "95 %", "cases"), [(r[0], r[2], r[3], r[4]) for r in rows if r[4]])


def _names(r: Result) -> list[str]:
    return [*r["conventions"], *(c["id"] for c in r["causes"])]


def troubles(results: Sequence[Result]) -> str:
    """Cases that were not diagnosed."""
    count = Counter(r["outcome"] for r in results)
    kinds = Counter(r["kind"] for r in results if r["outcome"] == "unreachable")
    lines = ["Outcomes: " + ", ".join(f"{n} {o}" for o, n in count.most_common()) + "."]
    lines += [f"- {r['id']}: {r['error']}" for r in results if r["outcome"] == "failed"][:20]
    if not kinds:
        return "\n".join(lines)
    out = table(("effect", "cases"), sorted(kinds.items()))
    title = "### Out of reach within ten times the typical size"
    return "\n".join(lines) + f"\n\n{title}\n\n{out}"


def report(results: Sequence[Result]) -> str:
    """All tables of the first generator as Markdown; empty where none of its cases was run."""
    if not results:
        return ""
    head = ("metric", "goal", "measured", "95 %", "cases", "goal met")
    return "\n\n".join(
        [
            table(head, [r for r in scores(results) if r[4]]),
            "### Single effects by size",
            by_size(results),
            "### Further cases",
            others(results),
            "### What each effect was called, s = 6 and 8",
            confusion(results, 6.0, 8.0),
            "### What each effect was called, s = 12",
            confusion(results, 12.0),
            "### Cases without a diagnosis",
            troubles(results),
        ]
    )


def write_page(text: str, command: str, results: Sequence[Result], mark: str) -> None:
    """Put the results between their marks of docs/results.md, and the raw tables beside the page."""
    versions = ", ".join(sorted({r["code"] for r in results}))
    when = f"{command}; {date.today().isoformat()}; {cores()}; code {versions} (a hash of the sources)."
    record = f"{when}\n\n{shelved(text, f'diagnosis {mark}', aside='Touched kinds')}"
    replace_between(PAGE, f"<!-- {mark} -->", f"<!-- end of {mark} -->", record)


def main() -> None:
    """Run, score, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--quick", action="store_true", help="one seed of everything, 33 nulls; of the second generator some"
    )
    parser.add_argument("--seeds", type=int, default=FULL, help="per effect and size; the other groups in proportion")
    parser.add_argument("--seed", type=int, default=0, help="shifts all seeds")
    parser.add_argument("--cases", default=",".join((*GROUPS, *second.GROUPS)), help="groups, by comma")
    parser.add_argument("--only", default="", help="ids that contain this")
    parser.add_argument("--out", type=Path, default=HERE.parent / "build" / "diagnosis.jsonl")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--any-code", action="store_true", help="keep results of other versions of the code")
    parser.add_argument("--score", action="store_true", help="score the checkpoint without running")
    parser.add_argument("--write", action="store_true", help="write the tables to docs/results.md")
    given = parser.parse_args()
    seeds = 1 if given.quick else given.seeds
    asked = given.cases.split(",")
    of_both: list[Case | second.Case] = [
        *first_cases(seeds, [g for g in GROUPS if g in asked], given.seed),
        *second.make_cases(seeds, [g for g in (*second.GROUPS, *second.ASKED) if g in asked], given.seed, given.quick),
    ]
    cases = [c for c in of_both if given.only in c.id]
    given.out.parent.mkdir(parents=True, exist_ok=True)
    if given.score:
        done = read_checkpoint(given.out)
        results = [done[c.id] for c in cases if c.id in done]
    else:
        results = run_all(cases, given.out, given.workers, given.any_code)
    for mark, make, groups in (
        ("results", report, GROUPS),
        ("second generator", second.report, second.GROUPS),
        ("unknown kinds", second.unknown_report, second.ASKED),
    ):
        mine = sum(c.group in groups for c in cases)
        own = [r for r in results if r["group"] in groups]
        text = make(own)
        print(text)
        if given.write and own:
            some = "" if len(own) == mine else f", {len(own)} of its {mine} cases"
            command = f"`python benchmarks/diagnosis.py --seeds {seeds} --seed {given.seed}`{some}"
            write_page(text, command, own, mark)


if __name__ == "__main__":
    main()

"""The cases and goal quantities that `bands.py` holds a new state of the code to: those of the record of the diagnosis.

Every case is one of the record, with its seed, so that its answer can be compared with the answer that is on record.
A quantity counts hits of units in each case, by the same functions that score `docs/results.md`: mostly one unit, a
case; on clean days each state is one.
"""

from __future__ import annotations

import sys
import tempfile
import traceback
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import clean
import diagnosis as first
import hidden
import second_generator as second
import table_mistakes as mistakes
from fresh_poses import Fresh, place_right, variable_right

from qsframework.experiment import example, load_experiment

Result = dict[str, Any]
Count = tuple[int, int]
"""Hits, of units."""
NAMES = ("hidden", "second", "untouched", "touched", "clean", "tables", "days")
"""The groups of quantities."""
LIBRARY_GAIN = 0.9
"""Share of the oracle's gain at fresh poses that counts as had, where the cause is in the library."""
OUTSIDE_GAIN = {("untouched", 40): 0.78, ("untouched", 14): 0.69, ("touched", 40): 0.76, ("touched", 14): 0.42}
"""The same where it is not: the medians on record, reached in half of the cases."""
CLEAN_SEEDS, DAYS, TABLES, CLEAN_TABLES = 120, 20, 10, 100
"""As many as are on record: seeds of each robot, days, tables of each kind of mistake, tables without."""


# ---------------------------------------------------------------- which cases


@dataclass(frozen=True)
class Case:
    """One case of the record; what: of the two generators their own case, else what its runner takes."""

    id: str
    what: Any

    @property
    def stratum(self) -> str:
        """The group, and for single effects their size: what the sample is drawn from in turns."""
        group, *rest = self.id.split("/")
        sizes = {"effects": 1, "second_effects": 2}
        return f"{group}/{rest[sizes[group]]}" if group in sizes else group


def all_cases() -> list[Case]:
    """All cases of the record, a fair order within each stratum."""
    found = [
        *first.first_cases(first.FULL, [g for g in first.GROUPS if g != "visible"], 0),
        *second.make_cases(6, ["second_effects", "second_structures"], 0),
        *second.make_cases(1, ["second_nulls"], 0),
        *second.make_cases(3, ["untouched"], 0),
        *second.make_cases(2, ["touched"], 0),
    ]
    cases = [Case(c.id, c) for c in found]
    cases += [Case(f"clean/{robot}/{k}", (robot, k)) for robot in clean.ROBOTS for k in range(CLEAN_SEEDS)]
    cases += [Case(f"tables/{i}/{k}", (i, k)) for i in range(len(mistakes.KINDS)) for k in range(TABLES)]
    cases += [Case(f"clean_tables/{k}", (k, False)) for k in range(CLEAN_TABLES)]
    cases += [Case(f"hidden_tables/{k}", (k, True)) for k in range(CLEAN_TABLES)]
    cases += [Case(f"days/{k}", k) for k in range(DAYS)]
    return sorted(cases, key=lambda c: zlib.crc32(c.id.encode()))


# ---------------------------------------------------------------- one case


def run(case: Case) -> Result:
    """What is said of a case; a fault is a result too."""
    group = case.id.partition("/")[0]
    if group not in _RUNNERS:
        return first.run(case.what)
    out: Result = {"id": case.id, "group": group}
    try:
        return out | _RUNNERS[group](case.what)
    except (hidden.Unreachable, mistakes.Unreachable):
        return out | {"outcome": "unreachable"}
    except Exception as error:  # one fault must not stop the others
        text = f"{type(error).__name__}: {error}"[:300]
        return out | {"outcome": "failed", "error": text, "trace": traceback.format_exc()[-800:]}


@cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    """One for this process."""
    return tempfile.TemporaryDirectory()


@cache
def _pool(robot: str) -> tuple[Any, Any]:
    experiment = load_experiment(clean.written(robot, Path(_folder().name)))
    return experiment, clean.pool_of(experiment)


def _clean(what: tuple[str, int]) -> Result:
    return clean.one({what[0]: _pool(what[0])}, what)


def _table(what: tuple[int, int]) -> Result:
    kind, number = mistakes.KINDS[what[0]], what[1]
    return {"outcome": "done"} | {"answer": asdict(mistakes.ask(kind, number, 0, whole=number == 0))}


def _clean_table(what: tuple[int, bool]) -> Result:
    answer = mistakes.clean(what[0], 0, what[1])
    return {"outcome": "unreachable"} if answer is None else {"outcome": "done", "answer": asdict(answer)}


def _day(seed: int) -> Result:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "day"))
    import day_cell

    with tempfile.TemporaryDirectory() as folder:
        said = day_cell.play(load_experiment(example("m900ib") / "experiment.yaml"), Path(folder), seed)
    return {"outcome": "done", "states": len(said), "odd": sum(s.mistake is not None for s in said)}


_RUNNERS: dict[str, Callable[[Any], Result]] = {
    "clean": _clean,
    "tables": _table,
    "clean_tables": _clean_table,
    "hidden_tables": _clean_table,
    "days": _day,
}


def said(r: Result) -> str:
    """The answer in one line, as it is compared."""
    if r["outcome"] != "done":
        return r["outcome"]
    if r["group"] == "days":
        return f"{r['odd']} of {r['states']} states to be looked at"
    if "answer" in r:
        a = r["answer"]
        return f"{a.get('outcome', 'said')}: {', '.join([*a['said'], *a.get('physical', ())]) or 'nothing'}"
    causes = [(c["id"], c["alternatives"]) for c in r.get("causes", ())] + [
        (c["name"], c["alternatives"]) for c in r.get("findings", ())
    ]
    names = [*r.get("conventions", ()), *r.get("names", ())]
    names += [f"{name} of {1 + len(alternatives)}" if alternatives else name for name, alternatives in causes]
    learned = r.get("learned")
    names += [learned[0]] if learned and learned[1] else []
    return f"{r['verdict']}: {', '.join(names) or 'nothing named'}"


# ---------------------------------------------------------------- quantities


@dataclass(frozen=True)
class Quantity:
    """A goal quantity: its name, its group, whether more is better, and its units and hits in a case.

    step: of a size, in hundredths, by how much it must change in a case to count as changed; 0 where hits are counted
    """

    name: str
    group: str
    more: bool
    chosen: Callable[[Result], bool]
    hit: Callable[[Result], bool | Count]
    step: int = 0

    def count(self, r: Result) -> Count | None:
        """Hits and units in a case; None where the quantity is of other cases. A fault is the worst answer."""
        if not self.chosen(r):
            return None
        if r["outcome"] in ("failed", "refused") and not self._of_refusals:
            return (0 if self.more else 1), 1
        if r["outcome"] == "unreachable":
            return None
        found = self.hit(r)
        return found if isinstance(found, tuple) else (int(found), 1)

    @property
    def _of_refusals(self) -> bool:
        return self.name.endswith("refused")


def counted(r: Result) -> dict[str, Count]:
    """All quantities of a case."""
    found = ((q.name, q.count(r)) for q in QUANTITIES)
    return {name: count for name, count in found if count is not None}


def _of(start: str, *sizes: float) -> Callable[[Result], bool]:
    """Cases whose id begins so, of these sizes of what is hidden."""

    def chosen(r: Result) -> bool:
        if not r["id"].startswith(start) or r.get("kind") == hidden.UNTOLD:
            return False
        wanted = r.get("wanted")
        return not sizes or (wanted[0] if isinstance(wanted, list) else wanted) in sizes

    return chosen


def _explained(r: Result) -> bool:
    return r["verdict"] == "explained"


def _single(r: Result) -> bool:
    return first.named(r) and all(not c["alternatives"] for c in r["causes"])


def _had(r: Result) -> bool:
    return "fresh_mm" in r and first.share(r) >= LIBRARY_GAIN


def _percent(share: float) -> Count:
    """A share of a gain in hundredths, within -100 and 150."""
    return round(100.0 * min(max(share, -1.0), 1.5)), 100


def _hidden() -> Iterator[Quantity]:
    """Of the first generator."""

    def one(name: str, more: bool, chosen: Callable[[Result], bool], hit: Callable[[Result], bool]) -> Quantity:
        return Quantity(f"hidden: {name}", "hidden", more, chosen, hit)

    yield one("false alarms, nominal", False, _of("nulls/"), first.alarmed)
    for stress in hidden.STRESSES:
        yield one(f"false alarms, {stress}", False, _of(f"stress/{stress}/"), first.alarmed)
    yield one("detected, s = 4.5", True, _of("effects/", 4.5), first.alarmed)
    for s in (4.5, 6.0, 8.0, 12.0, 40.0):
        yield one(f"named right, s = {s:g}", True, _of("effects/", s), first.named)
    yield one("set covers the truth, s = 8", True, _of("effects/", 8.0), first.covered)
    yield one("named right and no rival, s = 8", True, _of("effects/", 8.0), _single)
    yield one("two causes, exact", True, _of("pairs/"), first.exactly)
    yield one("two causes, up to aliases", True, _of("pairs/"), first.up_to_aliases)
    yield one("three causes, exact", True, _of("triples/"), first.exactly)
    yield one("three causes, up to aliases", True, _of("triples/"), first.up_to_aliases)
    yield one("an effect with an alias, set covers the truth", True, _of("aliases/"), first.covered)
    for s in (8.0, 12.0):
        yield one(f"unknown cause flagged, s = {s:g}", True, _of("unknown/", s), first.flagged)
    yield one("unknown cause confidently wrong", False, _of("unknown/"), _explained)
    for kind in hidden.UNSEEN:
        for s in (8.0, 12.0):
            yield one(f"{kind} flagged, s = {s:g}", True, _of(f"unseen/{kind}/", s), first.flagged)
    yield one("rope and nest confidently wrong", False, _of("unseen/"), _explained)
    yield one("other protocols, false alarms", False, lambda r: _protocol(r, "null"), first.alarmed)
    yield one("other protocols, named right, s = 8", True, lambda r: _protocol(r, "effect"), first.named)
    yield one("wrong conventions named", True, _convention, lambda r: _CONVENTIONS[_label(r)] in first._names(r))
    yield one("metres refused", True, _of("conventions/metres/"), lambda r: r["outcome"] == "refused")
    yield one("gain at fresh poses had, s >= 8", True, _of("effects/", 8.0, 12.0, 40.0), _had)
    yield one("held-out error worse than before, s >= 8", False, _of("effects/", 8.0, 12.0, 40.0), first.worse)
    gain = "hidden: share of the oracle's gain, %"
    yield Quantity(gain, "hidden", True, _large, lambda r: _percent(first.share(r)), 2)


def _large(r: Result) -> bool:
    return _of("effects/", 8.0, 12.0, 40.0)(r) and "fresh_mm" in r


_CONVENTIONS = {
    "coupling_plus": "controller_coupling[joint_3]",
    "coupling_minus": "controller_coupling[joint_3]",
    "swapped_axes": "displacement_axes",
    "sign": "displacement_sign",
}


def _label(r: Result) -> str:
    return str(r["id"].split("/")[1])


def _protocol(r: Result, what: str) -> bool:
    return r["id"].startswith("protocol/") and r["id"].split("/")[2] == what


def _convention(r: Result) -> bool:
    return r["id"].startswith("conventions/") and _label(r) in _CONVENTIONS


def _second() -> Iterator[Quantity]:
    """Of the second generator."""

    def one(name: str, more: bool, chosen: Callable[[Result], bool], hit: Callable[[Result], bool]) -> Quantity:
        return Quantity(f"second: {name}", "second", more, chosen, hit)

    for s in second.SIZES:
        yield one(f"library effects, s = {s:g}: named, or in the set", True, _of("second_effects/", s), second.named)
        yield one(f"library effects, s = {s:g}: confidently wrong", False, _of("second_effects/", s), second.wrong)
    nulls = _of("second_nulls/")
    yield one("nothing hidden: said something", False, nulls, second.alarmed)
    yield one("nothing hidden: a law learned", False, nulls, second.learned)
    yield one("nothing hidden: worse at fresh poses", False, _measured(nulls), lambda r: _fresh(r).harm > second._HARM)
    yield one("another structure: named", True, _of("second_structures/"), second.named)


def _fresh(r: Result) -> Fresh:
    return Fresh(*r["fresh"])


def _measured(chosen: Callable[[Result], bool]) -> Callable[[Result], bool]:
    """Of these the ones with errors at fresh poses."""
    return lambda r: chosen(r) and (r["outcome"] != "done" or r.get("fresh") is not None)


def _finite(chosen: Callable[[Result], bool]) -> Callable[[Result], bool]:
    """Of these the ones in which the oracle has a gain."""
    return lambda r: chosen(r) and r.get("fresh") is not None and _fresh(r).share == _fresh(r).share


def _outside(group: str) -> Iterator[Quantity]:
    """Of causes that no effect of the library is."""
    own = _of(f"{group}/")

    def one(name: str, more: bool, hit: Callable[[Result], bool], chosen: Callable[[Result], bool] = own) -> Quantity:
        return Quantity(f"{group}: {name}", group, more, chosen, hit)

    yield one("confidently wrong", False, second.wrong)
    yield one("nothing said", False, lambda r: not second.alarmed(r))
    yield one("place right", True, lambda r: place_right(r["said"], r["place"]))
    yield one("place and variable right", True, lambda r: variable_right(r["said"], r["place"], r["variable"]))
    yield one("place among those told", True, lambda r: place_right(r["among"], r["place"]))
    yield one("place, or one that moves the markers alike", True, second._place_alike)
    for poses in second.UNKNOWN:
        some = _measured(lambda r, poses=poses: own(r) and r["id"].split("/")[2] == str(poses))
        least = OUTSIDE_GAIN[group, poses]
        had = f"at least {100 * least:.0f} % of the oracle's gain, {poses} poses"
        yield one(had, True, lambda r, least=least: _fresh(r).share >= least, some)
        yield one(f"worse than the springs, {poses} poses", False, lambda r: _fresh(r).harm > second._WORSE, some)
        share = f"{group}: share of the oracle's gain, {poses} poses, %"
        yield Quantity(share, group, True, _finite(some), lambda r: _percent(_fresh(r).share), 2)


def _others() -> Iterator[Quantity]:
    """Of clean campaigns, tables and days."""
    yield Quantity("clean: something is found", "clean", False, _of("clean/"), lambda r: r["verdict"] != "none")
    yield Quantity("clean: noise or rows blamed", "clean", False, _of("clean/"), lambda r: bool(r["problems"]))
    seen = lambda r: r["id"].startswith("tables/") and not r.get("answer", {}).get("outcome", "").startswith("small")  # noqa: E731
    yield Quantity("tables: mistakes named", "tables", True, seen, lambda r: r["answer"]["outcome"] in mistakes._RIGHT)
    yield Quantity("tables: called something else", "tables", False, seen, lambda r: r["answer"]["outcome"] == "wrong")
    for start, words in (("clean_tables/", "clean tables"), ("hidden_tables/", "a hidden effect")):
        name = f"tables: {words} called mistaken"
        yield Quantity(name, "tables", False, _of(start), lambda r: bool(r["answer"]["said"]))
    yield Quantity("days: right states to be looked at", "days", False, _of("days/"), lambda r: (r["odd"], r["states"]))


def quantities() -> Iterable[Quantity]:
    """All of them, by group."""
    yield from _hidden()
    yield from _second()
    yield from _outside("untouched")
    yield from _outside("touched")
    yield from _others()


QUANTITIES = tuple(quantities())

"""Is the diagnosis as good as on record? Runs a sample of the record's own cases and says *not worse* or *worse*.

    python benchmarks/bands.py --quick        # five minutes on one core
    python benchmarks/bands.py                # twenty minutes
    python benchmarks/bands.py --full         # all cases of the record: hours

`bands.json` holds, for each goal quantity, how often it was hit on record (hits `of` units, with the `source`), and for
the cases of the sample what the code answered when they were recorded. So each quantity is judged twice:

- against the rate on record, by Fisher's exact test of the sample's hits against the record's;
- case by case, which sees far more: of the cases that changed, how many were lost and how many won, by the sign test.
  A whole group of quantities, and all of them, are judged so as well. Shares of a gain are judged so alone; a case
  is lost or won where its share changed by more than `step` hundredths.

A run of code that is as good as the record's is called *worse* somewhere in at most 1 of 100 runs: of that 1 %, four
tenths go to all cases together, three to the groups and three to the quantities, in equal parts. The same level holds
for *better*. The exit code is 1 where a line is worse. It takes eight lost cases with none won to call all of them
worse, so look at the changed answers, which are listed in any case. With learning switched off both samples say worse.

`--record` writes what was found into bands.json: refused where a line is worse; answers of all cases that ran, and the
rate of a quantity that is better where it was counted on as many units as on record. `--draw` makes the sample anew,
with the answers of this code, and the rates of quantities that docs/results.md does not state.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

from common import table
from scipy.stats import binom, hypergeom
from threadpoolctl import threadpool_limits

HERE = Path(__file__).resolve().parent
BANDS = HERE / "bands.json"
LEVEL = 0.01
"""Of calling anything worse where nothing is, in one run; of better as well."""
OF_ALL, OF_GROUPS, OF_QUANTITIES = 0.4, 0.3, 0.3
"""Shares of it."""
SAMPLE = {
    "nulls": (6, 24),
    "stress": (6, 24),
    "effects/4.5": (8, 24),
    "effects/6": (8, 32),
    "effects/8": (8, 32),
    "effects/12": (3, 12),
    "effects/40": (2, 6),
    "pairs": (6, 20),
    "triples": (2, 6),
    "aliases": (2, 6),
    "unknown": (6, 24),
    "unseen": (4, 16),
    "protocol": (3, 12),
    "conventions": (3, 10),
    "second_effects/10": (6, 24),
    "second_effects/5": (4, 16),
    "second_nulls": (6, 24),
    "second_structures": (1, 5),
    "untouched": (18, 40),
    "touched": (24, 40),
    "clean": (6, 30),
    "tables": (12, 42),
    "clean_tables": (6, 20),
    "hidden_tables": (6, 20),
    "days": (1, 3),
}
"""Cases of a quick sample and of the usual one, by stratum."""
OWN = "the cases of this file"
"""Source of a rate that no page states."""
Counts = Mapping[str, tuple[int, int]]
"""Of a case, hits and units by quantity."""


# ---------------------------------------------------------------- the arithmetic


@dataclass(frozen=True)
class Line:
    """A verdict; worse, better: chances of a result as bad, or as good, where nothing changed; level: that speaks."""

    name: str
    record: tuple[int, int] | None
    now: tuple[int, int] | None
    lost: int
    won: int
    worse: float
    better: float
    level: float

    @property
    def verdict(self) -> str:
        if self.worse < self.level:
            return "worse"
        return "better" if self.better < self.level else "not worse"


def beside(record: tuple[int, int], now: tuple[int, int], more: bool) -> tuple[float, float]:
    """Fisher's exact test, one side each: chances that a sample of as many units is as bad, or as good, as this one.

    record, now: hits and units; more: whether hits are good.
    """
    hits, units = record
    own, count = now
    fewer = float(hypergeom.cdf(own, units + count, hits + own, count))
    most = float(hypergeom.sf(own - 1, units + count, hits + own, count))
    return (fewer, most) if more else (most, fewer)


def signs(lost: int, won: int) -> tuple[float, float]:
    """Chances that of as many changed cases so many or more are lost, or won, where either is as likely."""
    both = lost + won
    return float(binom.sf(lost - 1, both, 0.5)), float(binom.sf(won - 1, both, 0.5))


def change(before: Counts, after: Counts, known: Mapping[str, Mapping[str, Any]]) -> dict[str, int]:
    """By quantity whether a case was won (1), lost (-1) or neither (0); known: the quantities on record.

    A quantity that is no longer counted in a case is neither: the list of changed answers shows it.
    """
    out = {}
    for name, (hits, units) in before.items():
        if name in after and name in known:
            rise = after[name][0] * units - hits * after[name][1]
            least = known[name].get("step", 0) * units * after[name][1] / 100.0
            sign = (rise > least) - (rise < -least)
            out[name] = sign if known[name]["more_is_better"] else -sign
    return out


def net(changes: Iterable[int]) -> int:
    """Whether a case was won (1) or lost (-1) in whatever changed of it; 0 where it was both or neither."""
    found = set(changes) - {0}
    return found.pop() if len(found) == 1 else 0


def counts_of(bands: Mapping[str, Any], answers: Mapping[str, Mapping[str, Any]]) -> dict[str, Counts]:
    """Of each case; one that ends without an answer now has the worst in all that was counted of it on record."""
    out = {}
    for name, answer in answers.items():
        counts = dict(answer["counts"])
        if answer["said"] in ("failed", "refused") and name in bands["cases"]:
            for q, (_, units) in bands["cases"][name]["counts"].items():
                counts.setdefault(q, (0 if bands["quantities"][q]["more_is_better"] else units, units))
        out[name] = counts
    return out


def lines(bands: Mapping[str, Any], after: Mapping[str, Counts]) -> list[Line]:
    """All verdicts: of the quantities, the groups and all cases; after: counts of the cases that ran."""
    known = bands["quantities"]
    before = {name: c["counts"] for name, c in bands["cases"].items() if name in after}
    changes = {name: change(counts, after[name], known) for name, counts in before.items()}
    ran = [name for name in known if any(name in counts for counts in after.values())]
    groups = sorted({known[name]["group"] for name in ran})
    out = [_line(name, known[name], after, changes, LEVEL * OF_QUANTITIES / (2 * len(ran))) for name in ran]
    for group in groups:
        own = [net(v for q, v in c.items() if known[q]["group"] == group) for c in changes.values()]
        out.append(_whole(f"{group}, all its cases", own, LEVEL * OF_GROUPS / len(groups)))
    out.append(_whole("all cases", [net(c.values()) for c in changes.values()], LEVEL * OF_ALL))
    return out


def _line(
    name: str,
    known: Mapping[str, Any],
    after: Mapping[str, Counts],
    changes: Mapping[str, Mapping[str, int]],
    level: float,
) -> Line:
    found = [counts[name] for counts in after.values() if name in counts]
    now = sum(c[0] for c in found), sum(c[1] for c in found)
    own = [c[name] for c in changes.values() if name in c]
    lost, won = own.count(-1), own.count(1)
    record = (known["hits"], known["of"])
    worse, better = signs(lost, won)
    if "step" not in known:  # of sizes there are no hits
        rate = beside(record, now, known["more_is_better"])
        worse, better = min(worse, rate[0]), min(better, rate[1])
    return Line(name, record, now, lost, won, worse, better, level)


def _whole(name: str, changes: Sequence[int], level: float) -> Line:
    lost, won = changes.count(-1), changes.count(1)
    return Line(name, None, None, lost, won, *signs(lost, won), level)


# ---------------------------------------------------------------- the file


def read(path: Path = BANDS) -> dict[str, Any]:
    return json.loads(path.read_text())


def write(bands: Mapping[str, Any], path: Path = BANDS) -> None:
    """One quantity and one case a line, so that a change shows as one."""
    text = ["{"]
    for key in ("code", "date"):
        text.append(f" {json.dumps(key)}: {json.dumps(bands[key])},")
    for key in ("quantities", "cases"):
        rows = [f"  {json.dumps(name)}: {json.dumps(value)}" for name, value in bands[key].items()]
        text += [f" {json.dumps(key)}: {{", ",\n".join(rows), " }," if key == "quantities" else " }"]
    path.write_text("\n".join([*text, "}"]) + "\n")


def recorded(
    bands: Mapping[str, Any], answers: Mapping[str, Mapping[str, Any]], found: Sequence[Line]
) -> dict[str, Any]:
    """The record with the answers of this code, and with rates that are better on as many units."""
    quantities = {name: dict(q) for name, q in bands["quantities"].items()}
    for line in found:
        if (
            line.name in quantities
            and line.verdict == "better"
            and line.now
            and line.record
            and line.now[1] >= line.record[1]
        ):
            quantities[line.name] |= {"hits": line.now[0], "of": line.now[1], "source": f"bands.py, {date.today()}"}
    cases = {name: _kept(answers.get(name, case)) for name, case in bands["cases"].items()}
    return {"code": _code(), "date": date.today().isoformat(), "quantities": quantities, "cases": cases}


def _kept(answer: Mapping[str, Any]) -> dict[str, Any]:
    return {"said": answer["said"], "counts": answer["counts"]}


# ---------------------------------------------------------------- running


def _code() -> str:
    from diagnosis import code

    return code(*(p.name for p in sorted(HERE.glob("*.py")) if p.name != "bands.py"))


def _ask(case: Any) -> tuple[str, dict[str, Any]]:
    from bands_cases import counted, run, said

    result = run(case)
    return case.id, {"said": said(result), "counts": counted(result), "error": result.get("error", "")}


def ask_all(cases: Sequence[Any], jobs: int, out: Path) -> dict[str, dict[str, Any]]:
    """Answers of the cases; those of a run of the same code that was stopped are taken from `out`."""
    mark, done = _code(), {}
    out.parent.mkdir(parents=True, exist_ok=True)
    for text in out.read_text().splitlines() if out.exists() else ():
        kept = json.loads(text)
        if kept["code"] == mark:
            done[kept["id"]] = kept["answer"]
    left = [c for c in cases if c.id not in done]
    start = time.monotonic()
    with out.open("a") as file, ProcessPoolExecutor(jobs, initializer=threadpool_limits, initargs=(1,)) as pool:
        for count, (name, answer) in enumerate(pool.map(_ask, left), 1):
            done[name] = answer
            file.write(json.dumps({"code": mark, "id": name, "answer": answer}) + "\n")
            file.flush()
            if count % 20 == 0 or count == len(left):
                print(f"{count} of {len(left)} cases, {time.monotonic() - start:.0f} s", file=sys.stderr, flush=True)
    return {c.id: done[c.id] for c in cases}


def sample(bands: Mapping[str, Any], quick: bool, full: bool) -> list[Any]:
    """The cases of the record that are to run."""
    from bands_cases import all_cases

    cases = all_cases()
    if full:
        return cases
    own = [c for c in cases if c.id in bands["cases"]]
    strata: dict[str, list[Any]] = {}
    for case in own:
        strata.setdefault(case.stratum, []).append(case)
    return [case for name, some in strata.items() for case in some[: SAMPLE[name][0] if quick else None]]


def draw(jobs: int, out: Path) -> dict[str, Any]:
    """The sample's cases with the answers of this code: of each stratum so many of those that can be made."""
    from bands_cases import all_cases

    strata: dict[str, list[Any]] = {name: [] for name in SAMPLE}
    for case in all_cases():
        if case.stratum in strata:
            strata[case.stratum].append(case)
    kept: dict[str, Any] = {}
    for name, cases in strata.items():
        wanted, mine = SAMPLE[name][1], {}
        while cases and len(mine) < wanted:
            turn, cases = cases[: max(jobs, wanted - len(mine))], cases[max(jobs, wanted - len(mine)) :]
            answers = ask_all(turn, jobs, out)
            mine |= {k: a for k, a in answers.items() if a["said"] != "unreachable" and len(mine) < wanted}
        print(f"{name}: {len(mine)} of {wanted}", file=sys.stderr, flush=True)
        kept |= {k: _kept(a) for k, a in mine.items()}
    return kept


# ---------------------------------------------------------------- words


def report(bands: Mapping[str, Any], answers: Mapping[str, Mapping[str, Any]], found: Sequence[Line]) -> str:
    """The table of verdicts, and the cases that changed."""

    def told(line: Line, count: tuple[int, int] | None) -> str:
        if not count or not count[1]:
            return "-"
        sized = "step" in bands["quantities"].get(line.name, {})
        return f"{100 * count[0] / count[1]:.0f} %" if sized else f"{count[0]} of {count[1]}"

    rows = []
    for line in found:
        record, now = told(line, line.record), told(line, line.now)
        p = min(line.worse, line.better)
        rows.append((line.name, record, now, line.lost, line.won, f"{p:.2g}" if p < 0.05 else "-", line.verdict))
    head = ("quantity", "on record", "now", "cases lost", "won", "p", "verdict")
    return f"{table(head, rows)}\n\n" + "\n".join(changed(bands, answers))


def changed(bands: Mapping[str, Any], answers: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Each case with another answer than on record: what was said, what is said, and the quantities lost and won."""
    after, count = counts_of(bands, answers), 0
    for name, answer in answers.items():
        before = bands["cases"].get(name)
        if before is None:
            continue
        count += 1
        moved = change(before["counts"], after[name], bands["quantities"])
        if before["said"] != answer["said"] or any(moved.values()):
            error = f" ({answer['error']})" if answer["error"] else ""
            yield f"- {name}: {before['said']} -> {answer['said']}{error}"
            for word, sign in (("lost", -1), ("won", 1)):
                if names := [q for q, v in moved.items() if v == sign]:
                    yield f"  {word}: {'; '.join(names)}"
    yield f"{count} cases were asked before."


def main(argv: Sequence[str] | None = None, ask: Callable[..., dict[str, dict[str, Any]]] = ask_all) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="five minutes")
    parser.add_argument("--full", action="store_true", help="all cases of the record")
    parser.add_argument("--only", default="", help="cases whose id contains this")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--record", action="store_true", help="write into bands.json what is not worse")
    parser.add_argument("--draw", action="store_true", help="make the sample anew, with the answers of this code")
    parser.add_argument("--out", type=Path, default=HERE.parent / "build" / "bands.jsonl", help="answers, as they come")
    given = parser.parse_args(argv)
    bands = read()
    if given.draw:
        kept = draw(given.jobs, given.out)
        write({"code": _code(), "date": date.today().isoformat(), "quantities": rates(bands, kept), "cases": kept})
        return 0
    cases = [c for c in sample(bands, given.quick, given.full) if given.only in c.id]
    answers = ask(cases, given.jobs, given.out)
    found = lines(bands, counts_of(bands, answers))
    print(report(bands, answers, found))
    worse = [line.name for line in found if line.verdict == "worse"]
    print(f"worse: {', '.join(worse)}" if worse else "not worse than on record")
    if given.record and worse:
        print("nothing is recorded where a line is worse")
    elif given.record:
        write(recorded(bands, answers, found))
    return 1 if worse else 0


def rates(bands: Mapping[str, Any], cases: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """The rates on record; those that no page states are the ones of these cases."""
    out = {}
    for name, q in bands["quantities"].items():
        found = [c["counts"][name] for c in cases.values() if name in c["counts"]]
        own = {"hits": sum(c[0] for c in found), "of": sum(c[1] for c in found)} if q["source"] == OWN else {}
        out[name] = dict(q) | own
    return out


if __name__ == "__main__":
    sys.exit(main())

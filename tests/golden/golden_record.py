"""What a command left - exit code, text, files - as a record: its numbers, its names and its words apart.

Words change without a number and numbers without a word, so they are kept and compared apart:

- numbers: by file and place (a JSON pointer with `*` for the index of a list, a table's column, or the text as a
  whole), in the order in which they stand there; a null, true and false of a JSON are among them;
- names: strings of a JSON or of a table without a blank, such as a cause, a parameter or a state;
- words: texts and strings, each number in them replaced by `#`.

Folders, versions, dates, times and hashes are normalised before. Of a page only that it is there counts.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

Key = tuple[str, str]
"""File (or `stdout`, `stderr`), and place in it."""
DIGITS = 9
"""Significant digits that are stored of a number of a JSON."""
_NUMBER = re.compile(r"(?<![\w.])[+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?(?![\w])")
_NORMAL = (
    (re.compile(r"(?:\.\./?)+(?=<repository>)"), ""),  # the way there from a folder of any depth
    (re.compile(r"(?:\.\./)+(?:[\w.-]+/)*?(?=(?:examples|robots)/)"), "<repository>/"),
    (re.compile(r"\b[0-9a-f]{40,64}\b"), "<hash>"),
    (re.compile(r"\b\d{4}-\d\d-\d\d([T ]\d\d:\d\d(:\d\d(\.\d+)?)?(Z|[+-]\d\d:\d\d)?)?"), "<date>"),
    (re.compile(r"\b\d\d:\d\d:\d\d\b"), "<time>"),
    (re.compile(r"\bqsframework \d+\.\d+[\w.]*"), "qsframework <version>"),
    (re.compile(r"\b1[5-9]\d{8}\.\d+\b"), "<time>"),  # seconds since 1970
    (re.compile(r"\bimported: [0-9a-f]{16}\b"), "imported: <hash>"),
    (re.compile(r"\br[0-9a-f]{16}\b"), "<hash>"),  # of a reading
    (re.compile(r"\bcalib_[0-9a-f]{20}\b"), "calib_<hash>"),
    (re.compile(r"^[0-9a-f]{8} (?=\{)", re.MULTILINE), "<seal> "),
)
_RULES = re.compile(r"[\u2500-\u257f]+")
_PRINTED = "(text)"
"""Of a place: its numbers stand in sentences, so that they are rounded."""
_NAME = re.compile(r"\S+")
_TEXTS = {".txt", ".md", ".yaml", ".yml", ".urdf", ".xml", ".ls", ".src", ".dat", ".mod", ".script", ".jsonl", ".xacro"}
_PAGES = {".html", ".pdf"}
_LONGEST = 100
"""Values that a place has on one stored line."""


@dataclass
class Record:
    """What a command left."""

    code: int = 0
    numbers: dict[Key, list[str]] = field(default_factory=dict)
    names: dict[Key, list[str]] = field(default_factory=dict)
    words: dict[str, list[str]] = field(default_factory=dict)
    where: dict[Key, list[str]] = field(default_factory=dict)
    """Of each number, where exactly it stands; not stored."""

    def files(self) -> set[str]:
        """Everything that was written or printed, empty or not."""
        return set(self.words)


def normalised(text: str, places: Mapping[str, str]) -> str:
    """A text without what differs from run to run; places: folders and what stands for them."""
    for place, name in places.items():
        text = text.replace(place, name)
    for found, name in _NORMAL:
        text = found.sub(name, text)
    return text


def record(
    code: int,
    texts: Mapping[str, str],
    files: Mapping[str, Path],
    places: Mapping[str, str],
    known: Mapping[bytes, str] = MappingProxyType({}),
) -> Record:
    """The record of a command: its exit code, what it printed (by `stdout`, `stderr`) and the files that it wrote.

    places: what stands for a folder; known: contents of the repository's files, of which a copy may be written.
    """
    out = Record(code)
    for name, text in texts.items():
        _text(out, name, normalised(text, places))
    for name, path in files.items():
        if path.suffix in _PAGES:
            sound = path.stat().st_size > 1000
            out.words[name] = ["a page" if sound else "an empty page"]
            continue
        if path.read_bytes() in known:
            out.words[name] = [f"a copy of {known[path.read_bytes()]}"]
            continue
        text = normalised(path.read_text(encoding="utf-8"), places)
        if path.suffix == ".json":
            _json(out, name, json.loads(text))
        elif path.suffix == ".csv" and _is_table(text):
            _table(out, name, text)
        else:
            assert path.suffix in _TEXTS | {".csv"}, f"{name}: say in golden_record.py how this kind of file is read"
            _text(out, name, text)
    return out


def _text(out: Record, name: str, text: str) -> None:
    """Lines with their numbers taken out; blanks and rules of tables, whose length follows the numbers', go."""
    words = out.words.setdefault(name, [])
    numbers, where = out.numbers.setdefault((name, "text"), []), out.where.setdefault((name, "text"), [])
    for count, line in enumerate(text.splitlines(), 1):
        line = re.sub(r"\s+", " ", _RULES.sub(" ", line)).strip()
        if not line:
            continue
        found = _NUMBER.findall(line)
        said = _NUMBER.sub("#", line)
        numbers += found
        where += [f"line {count}, number {k} of: {said[:90]}" for k in range(1, len(found) + 1)]
        words.append(said)
    if not numbers:
        del out.numbers[name, "text"], out.where[name, "text"]


def _json(out: Record, name: str, document: Any) -> None:
    out.words.setdefault(name, [])
    for place, exact, value in _leaves(document, "", ""):
        if isinstance(value, str):
            if _NAME.fullmatch(value):
                out.names.setdefault((name, place), []).append(value)
                continue
            said = _NUMBER.sub("#", value).replace("\n", " | ")
            out.words[name].append(f"{place} {said}")
            for k, number in enumerate(_NUMBER.findall(value), 1):
                out.numbers.setdefault((name, f"{place} {_PRINTED}"), []).append(number)
                out.where.setdefault((name, f"{place} {_PRINTED}"), []).append(f"{exact}, number {k} of: {said[:90]}")
        else:
            out.numbers.setdefault((name, place), []).append(_shown(value))
            out.where.setdefault((name, place), []).append(exact)


def _leaves(value: Any, place: str, exact: str) -> Iterator[tuple[str, str, Any]]:
    """Leaves of a JSON with their pointers: that of the place, where `*` stands for an index, and the exact one."""
    if isinstance(value, dict) and value:
        for key, below in value.items():
            yield from _leaves(below, f"{place}/{key}", f"{exact}/{key}")
    elif isinstance(value, list) and value:
        for k, below in enumerate(value):
            yield from _leaves(below, f"{place}/*", f"{exact}/{k}")
    elif isinstance(value, dict | list):
        yield place, exact, "{}" if isinstance(value, dict) else "[]"
    else:
        yield place, exact, value


def _shown(value: float | bool | None) -> str:
    """A number of a JSON, whole numbers in full, others with so many digits and always a point or an exponent."""
    if value is None or isinstance(value, bool | int):
        return json.dumps(value)
    if not math.isfinite(value):
        return str(value)
    text = f"{value:.{DIGITS}g}"
    return text if re.search(r"[.e]", text) else f"{text}.0"


def _is_table(text: str) -> bool:
    rows = [r for r in text.splitlines() if r and r[0] != "#"]
    return len(rows) > 1 and "," in rows[0] and len({r.count(",") for r in rows}) == 1 and '"' not in text


def _table(out: Record, name: str, text: str) -> None:
    """A table by its columns; the lines above its header are words."""
    lines = [row for row in text.splitlines() if row]
    out.words[name] = [_NUMBER.sub("#", row) for row in lines if row[0] == "#"]
    header, *rows = (row.split(",") for row in lines if row[0] != "#")
    out.names[name, "header"] = [column.replace(" ", "_") or "-" for column in header]
    for k, column in enumerate(header):
        cells = [row[k].strip() for row in rows]
        key = (name, column)
        if all(not c or _NUMBER.fullmatch(c) for c in cells):
            out.numbers[key] = [c or "-" for c in cells]
            out.where[key] = [f"row {i}, column {column}" for i in range(1, len(cells) + 1)]
        else:
            out.names[key] = [c.replace(" ", "_") or "-" for c in cells]


# The two files of a record


def stored_numbers(record: Record, line: str) -> str:
    """The exit code, numbers and names, one place a line or several where they are many."""
    out = [f"# qsf {line}", f"exit {record.code}"]
    for title, kept in (("numbers", record.numbers), ("names", record.names)):
        out.append(f"= {title}")
        for (name, place), values in kept.items():
            head = f"{name}\t{place}\t"
            chunks = [values[k : k + _LONGEST] for k in range(0, len(values), _LONGEST)]
            out += [head + " ".join(chunk) for chunk in chunks]
    return "\n".join(out) + "\n"


def stored_words(record: Record, line: str) -> str:
    """Every file with its words; equal lines one below the other are counted."""
    out = [f"# qsf {line}"]
    for name, lines in record.words.items():
        out += [f"= {name}", *lines]
    return "\n".join(out) + "\n"


def read_record(numbers: str, words: str) -> Record:
    """The record of its two files."""
    out = Record()
    kept = out.numbers
    for line in numbers.splitlines()[1:]:
        if line.startswith("exit "):
            out.code = int(line[5:])
        elif line.startswith("= "):
            kept = out.numbers if line == "= numbers" else out.names
        else:
            name, place, values = line.split("\t")
            kept.setdefault((name, place), []).extend(values.split(" "))
    name = ""
    for line in words.splitlines()[1:]:
        if line.startswith("= "):
            name = line[2:]
            out.words[name] = []
        else:
            out.words[name].append(line)
    return out


# Comparing

_EFFECT = re.compile(r"\b[a-z_]+\[[\w/]+\]")
RELATIVE = 1e-6
"""What two processors' numbers may differ by, and what is far below what a reading tells."""
REMAINDER = 1e-9
"""Of the largest number at a place: what is smaller is the remainder of a difference."""


@dataclass(frozen=True)
class Tolerance:
    """Where more may differ than elsewhere: patterns of command line, file and place, and why.

    infinite: numbers from this size on, and null, are the same.
    ties: which of several effects that do the same to the readings is named, and in which order they stand, is left to
    rounding: their names are not compared, and lines of words may come in another order.
    """

    reason: str
    line: str = ".*"
    file: str = ".*"
    place: str = ".*"
    relative: float = RELATIVE
    absolute: float = 0.0
    infinite: float = math.inf
    ties: bool = False

    def holds(self, line: str, key: Key) -> bool:
        pairs = zip((self.line, self.file, self.place), (line, *key), strict=True)
        return all(re.fullmatch(pattern, text) for pattern, text in pairs)


def differences(
    name: str, expected: Record, found: Record, tolerances: Sequence[Tolerance] = ()
) -> dict[str, list[str]]:
    """What differs, by kind: `exit code`, `files`, `numbers`, `names`, `words`; nothing where all agree."""
    out: dict[str, list[str]] = {}
    if expected.code != found.code:
        out["exit code"] = [f"{expected.code} -> {found.code}"]
    gone, new = expected.files() - found.files(), found.files() - expected.files()
    if gone or new:
        out["files"] = [f"{n}: no longer written" for n in sorted(gone)] + [f"{n}: new" for n in sorted(new)]
    for key in [*expected.numbers, *(k for k in found.numbers if k not in expected.numbers)]:
        if key[0] not in gone | new:
            special = next((t for t in tolerances if not t.ties and t.holds(name, key)), None)
            out.setdefault("numbers", []).extend(_numbers(key, expected, found, special))
    tied = [t for t in tolerances if t.ties]
    for key in [*expected.names, *(k for k in found.names if k not in expected.names)]:
        if key[0] not in gone | new and not any(t.holds(name, key) for t in tied):
            out.setdefault("names", []).extend(_names(key, expected.names.get(key, []), found.names.get(key, [])))
    for file in expected.words:
        if file in found.words:
            old, come = expected.words[file], found.words[file]
            if any(t.holds(name, (file, "words")) for t in tied):
                old, come = (sorted(_EFFECT.sub("<effect>", said) for said in lines) for lines in (old, come))
            out.setdefault("words", []).extend(_words(file, old, come))
    return {kind: said for kind, said in out.items() if said}


def _numbers(key: Key, expected: Record, found: Record, special: Tolerance | None) -> list[str]:
    old, new = (_bounded(r.numbers.get(key, []), special) for r in (expected, found))
    at = f"{key[0]} {key[1]}"
    if len(old) != len(new):
        k = next((k for k, (a, b) in enumerate(zip(old, new, strict=False)) if a != b), min(len(old), len(new)))
        return [f"{at}: {len(old)} numbers -> {len(new)}, from the {k + 1}. on: {_few(old[k:])} -> {_few(new[k:])}"]
    sizes = [abs(float(v)) for v in old if _NUMBER.fullmatch(v)]
    remainder = REMAINDER * max(sizes, default=0.0)
    relative, absolute = (special.relative, special.absolute) if special else (RELATIVE, 0.0)
    printed = not key[1].startswith("/") or key[1].endswith(_PRINTED)
    out = []
    for k, (a, b) in enumerate(zip(old, new, strict=True)):
        near = max(absolute, remainder, _last(a) if printed else 0.0, _last(b) if printed else 0.0)
        if not _alike(a, b, relative, near, special is None):
            out.append(f"{key[0]} {found.where.get(key, [key[1]] * len(new))[k]}: {a} -> {b}")
    return out


def _bounded(values: list[str], special: Tolerance | None) -> list[str]:
    """Numbers, those that count as infinite as null."""
    if special is None or special.infinite == math.inf:
        return values
    return ["null" if _NUMBER.fullmatch(v) and abs(float(v)) >= special.infinite else v for v in values]


def _alike(a: str, b: str, relative: float, absolute: float, counts: bool) -> bool:
    """counts: whole numbers are counted, and agree."""
    if a == b or not (_NUMBER.fullmatch(a) and _NUMBER.fullmatch(b)):
        return a == b
    x, y = float(a), float(b)
    whole = counts and not re.search(r"[.e]", a + b)
    return x == y if whole else abs(x - y) <= max(relative * max(abs(x), abs(y)), absolute)


def _last(number: str) -> float:
    """One of the last digit of a printed number, by which it may be rounded the other way; 0 of one with all digits."""
    digits, _, power = number.lower().partition("e")
    if len(digits.strip("+-").replace(".", "").lstrip("0")) >= DIGITS - 1:
        return 0.0
    return 1.01 * 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))


def _names(key: Key, old: list[str], new: list[str]) -> list[str]:
    if old == new:
        return []
    if len(old) != len(new):
        gone, come = [n for n in old if n not in new], [n for n in new if n not in old]
        return [f"{key[0]} {key[1]}: {len(old)} names -> {len(new)}: {_few(gone)} -> {_few(come)}"]
    pairs = [(k, a, b) for k, (a, b) in enumerate(zip(old, new, strict=True)) if a != b]
    return [f"{key[0]} {key[1]}, {k + 1}.: {a} -> {b}" for k, a, b in pairs]


def _words(file: str, old: list[str], new: list[str]) -> list[str]:
    import difflib

    out = []
    for what, a, b, c, d in difflib.SequenceMatcher(None, old, new, autojunk=False).get_opcodes():
        if what != "equal":
            out.append(f"{file} line {a + 1}: {' | '.join(old[a:b])[:300]!r} -> {' | '.join(new[c:d])[:300]!r}")
    return out


def _few(values: list[str]) -> str:
    return " ".join(values[:6]) + (" ..." if len(values) > 6 else "") if values else "none"

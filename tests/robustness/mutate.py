"""Spoiled files: from a good one and a seed to a bad one, always the same for the same seed."""

from __future__ import annotations

import json
import random
import re
from collections.abc import Callable
from typing import Any

import yaml

NUMBERS = (
    "nan",
    ".nan",
    "inf",
    "-inf",
    ".inf",
    "1e400",
    "-1e400",
    "1e308",
    "1e300",
    "-1e300",
    "1e160",
    "1e30",
    "1e9",
    "-1",
    "0",
    "-0.0",
    "5e-324",
    "1e-300",
    "1e-160",
    "1e-9",
    "0x1F",
    "0b1",
    "017",
    "1_000",
    "1,5",
    "1:30",
    "1e",
    "--1",
    "+-1",
    "9" * 18,
    "9" * 19,
    "9" * 400,
    "9" * 5000,
    "0." + "0" * 400 + "1",
    "2026-01-01",
    "True",
    "true",
    "null",
    "~",
    "½",
    "٣",
    "1e5",
    "1E+5",
    "360.0001",
    "90",
    "3.14159",
    "100001",
    "2147483648",
    "9223372036854775808",
    "",
)
TEXTS = (
    "",
    " ",
    "a",
    "-",
    "null",
    "all",
    "\x00",
    "a\x00b",
    "\ufeff",
    "\u202e",
    "\ud7ff",
    "é",
    "日本語",
    "😀",
    "a b",
    "a\tb",
    "../x",
    "../../../../etc/passwd",
    "/etc/passwd",
    "/dev/zero",
    "/dev/stdin",
    "/",
    ".",
    "..",
    "~",
    "~root",
    "*",
    "?",
    "file:///etc/passwd",
    "package://x/y",
    "http://localhost/x",
    "CON",
    "a" * 300,
    "a" * 5000,
    "a/" * 200,
    "\\",
    "'",
    '"',
    "`id`",
    "$(id)",
    "${1+1}",
    "${9**9**9}",
    "%s%n",
    "{{7*7}}",
    "<script>alert(1)</script>",
    "]]>",
    "&amp;",
    "&lol;",
    "<!--",
    "__class__",
    "joint_1",
    "joint_99",
    "-J1",
    "J1 + J2",
    "J999999999999999999999",
    "J0",
    "1e9*J2",
    "J2 + " * 30 + "J1",
    "9" * 150 + " deg + J1",
    "!!python/object/apply:os.system [id]",
    "&a [*a]",
    "*a",
    "!a",
    "- a",
)
SUFFIXES = (
    "_mm",
    "_m",
    "_deg",
    "_rad",
    "_N",
    "_kN",
    "_Nm",
    "_kg",
    "_s",
    "_K",
    "_degC",
    "_percent",
    "_dB",
    "_parsec",
    "_9**9**9",
    "_mm**9**9**9",
    "_m**99",
    "_(((((((",
    "_1/m",
    "_m/0",
    "_nan",
    "_inf*m",
    "_",
    "__",
    "_ mm",
    "_lightyear",
    "_ym",
    "_Ym",
)
EXPRESSIONS = (
    "${9**9**9}",
    "${9**9**9**9}",
    "${'a'*10**9}",
    "${().__class__.__bases__}",
    "${[].__class__}",
    "$(eval 1+1)",
    "$(env HOME)",
    "$(find ..)",
    "$(arg x)",
    "$(cwd)",
    "$(dirname)",
    "${",
    "${}",
    "${1/0}",
    "${pi}",
    "${-pi*2}",
    "${1e308*10}",
    "${nan}",
    "${float('nan')}",
    "${float('inf')}",
    "${int('9'*9)}",
    "${[1]*9}",
    "${len}",
    "${math}",
    "${xacro}",
    "${load_yaml('x')}",
    "${open('/etc/passwd')}",
    "${lambda: 0}",
    "${x := 1}",
    "${'%s' % 1}",
    "${f'{1}'}",
    "${1 if 2 else 3}",
    "${" + "(" * 200 + "1" + ")" * 200 + "}",
    "${" + "-" * 3000 + "1}",
    "${" + "1+" * 3000 + "1}",
    "${'a' in 'b'}",
    "${1 in 2}",
    "${[1,2][9]}",
    "${{1:2}}",
    "${None}",
    "${True}",
    "$${1}",
    "${1}${2}",
    "${round(1e308, -308)}",
    "${str(9**99)}",
    "${not}",
    "${a.b.c}",
    "${max()}",
    "${sqrt(-1)}",
    "${acos(2)}",
    "${(-1)**0.5}",
    "${0**-1}",
    "${0x10}",
    "${pow(9,9**9)}",
    "${exp(1000)}",
    "${sum([1,[2]])}",
    "${1 << 99999999}",
    "${~1}",
    "${5 % 0}",
    "${abs('a')}",
    "${'\\ud800'}",
)
ELEMENTS = (
    '<xacro:include filename="../x.xacro"/>',
    '<xacro:include filename="/etc/passwd"/>',
    "<xacro:macro/>",
    "<xacro:if/>",
    '<xacro:if value="${1/0}"/>',
    '<xacro:if value="maybe"><link/></xacro:if>',
    '<xacro:property name="a" value="${a}"/>${a}',
    '<xacro:property name="a" value="${b}"/><xacro:property name="b" value="${a}"/><link name="${a}"/>',
    "<xacro:arg/>",
    '<xacro:macro name="m" params="*a **b c:=^ d:=${d}"><xacro:m/></xacro:macro><xacro:m/>',
    "<xacro:unknown/>",
    "<link/>",
    '<xacro:property name="__class__" value="1"/>',
    '<xacro:insert_block name="x"/>',
    '<xacro:element xacro:name="${1}"/>',
    '<xacro:attribute name="x" value="1"/>',
    '<xacro:call macro="m"/>',
    "<joint/>",
    '<joint name="j" type="fixed"/>',
    '<xacro:property name="a" default="1" remove="true"/>',
    "<!-- -->",
    "<![CDATA[x]]>",
    "<?xml version='1.0'?>",
    "<?a b?>",
    '<!DOCTYPE a [<!ENTITY b "c">]>',
    "&b;",
    "&#0;",
    "&#x41;",
    "<a xmlns='b'/>",
    "<a:b/>",
    '<a xmlns:a="b" a:c="d"/>',
    "text",
    '<material name="m"><color rgba="nan 0 0 1"/></material>',
    '<xacro:property name="a"><link/></xacro:property>',
    '<xacro:include filename=""/>',
    "<xacro:include/>",
    '<xacro:macro name="" params=""/>',
    '<xacro:macro name="link"/>',
    '<link name="&lt;script&gt;"/>',
    '<xacro:property name="a b" value="1"/>',
    '<xacro:if value="${True}"/>',
)
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:[eE]-?\d+)?")
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_VALUE = re.compile(r'"[^"<>]*"')
_TAG = re.compile(r"<[^<>]*/>|<(\w+)[^<>]*>[^<>]*</\1>")


def mutated(content: bytes, kind: str, rng: random.Random) -> bytes:
    """One to four mutations of a file of the kind "yaml", "json", "xml" or "csv"."""
    for _ in range(rng.choice((1, 1, 1, 2, 2, 4))):
        try:
            content = rng.choice(_MUTATIONS[kind])(content, rng)
        except (UnicodeDecodeError, yaml.YAMLError, ValueError, RecursionError, IndexError):
            content = _bytes(content, rng)  # no longer a file of its kind
    return content


def _bytes(content: bytes, rng: random.Random) -> bytes:
    """Flipped, lost, doubled and strange bytes."""
    data = bytearray(content or b"a")
    at = rng.randrange(len(data))
    match rng.randrange(8):
        case 0:
            data[at] ^= 1 << rng.randrange(8)
        case 1:
            data[at] = rng.randrange(256)
        case 2:
            del data[at : at + rng.choice((1, 1, 2, 7, 60))]
        case 3:
            data[at:at] = bytes(rng.randrange(256) for _ in range(rng.choice((1, 3, 16))))
        case 4:
            data = data[:at]
        case 5:
            data[at:at] = rng.choice(
                (b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"\r", b"\r\n", b"\x85", b"\xe2\x80\xa8", b"\x1b[2J", b"\t", b"#")
            )
        case 6:
            stop = min(len(data), at + rng.choice((1, 5, 40)))
            data[at:at] = data[at:stop] * rng.choice((1, 2, 50))
        case 7:
            for k in range(rng.choice((2, 8))):
                data[(at + k * 13) % len(data)] ^= 1 << rng.randrange(8)
    return bytes(data)


def _coded(content: bytes, rng: random.Random) -> bytes:
    """Another encoding, line ends, or a very long line."""
    text = content.decode("utf-8")
    match rng.randrange(6):
        case 0:
            return text.encode(rng.choice(("utf-16", "utf-16-le", "utf-32", "utf-8-sig")))
        case 1:
            return (text + "é").encode("latin-1", "replace")
        case 2:
            return text.replace("\n", rng.choice(("\r\n", "\r", "\n\n", "\u2028", "\x0b"))).encode()
        case 3:
            return (text + rng.choice(("# ", "a", '"', "<!--", " ")) + "x" * 100_000).encode()
        case 4:
            return ("\n" * rng.choice((1, 1000)) + text).encode()
    return text.replace(" ", rng.choice(("\u00a0", "\t", "  ", ""))).encode()


def _lines(content: bytes, rng: random.Random) -> bytes:
    """Lines lost, doubled, exchanged, indented or spoiled."""
    lines = content.decode("utf-8").split("\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(6):
        case 0:
            del lines[i]
        case 1:
            lines.insert(j, lines[i])
        case 2:
            lines[i], lines[j] = lines[j], lines[i]
        case 3:
            lines[i] = rng.choice(("  ", "\t", "- ", "# ", ",", "    ")) + lines[i]
        case 4:
            lines[i] = lines[i].lstrip() if rng.random() < 0.5 else lines[i][: rng.randrange(len(lines[i]) + 1)]
        case 5:
            lines[i] = rng.choice(TEXTS)
    return "\n".join(lines).encode("utf-8", "replace")


def _tokens(content: bytes, rng: random.Random) -> bytes:
    """A number, a word or a text in quotes replaced."""
    text = content.decode("utf-8")
    pattern = rng.choice((_NUMBER, _NUMBER, _WORD, _VALUE))
    found = list(pattern.finditer(text))
    if not found:
        return _bytes(content, rng)
    match = rng.choice(found)
    if pattern is _VALUE:
        new = '"' + rng.choice((*NUMBERS, *TEXTS, *EXPRESSIONS)) + '"'
    elif pattern is _NUMBER:
        new = rng.choice(NUMBERS)
    else:
        other = rng.choice(list(_WORD.finditer(text))).group()
        new = rng.choice((other, rng.choice(TEXTS), match.group() + rng.choice(SUFFIXES), match.group()[:-1]))
    return (text[: match.start()] + new + text[match.end() :]).encode("utf-8", "replace")


def _strange(rng: random.Random, depth: int = 0) -> Any:
    """A value of any type."""
    match rng.randrange(9 if depth < 3 else 6):
        case 0:
            return rng.choice((0, 1, -1, 2, 7, 10**9, 10**18, 10**30, -(10**400)))
        case 1:
            return rng.choice((0.0, -1.5, 1e308, 1e-308, 1e160, 5e-324, float("inf"), float("-inf"), float("nan"), 0.5))
        case 2:
            return rng.choice((None, True, False, [], {}))
        case 3 | 4 | 5:
            return rng.choice((*TEXTS, *NUMBERS))
        case 6:
            return [_strange(rng, depth + 1) for _ in range(rng.choice((0, 1, 2, 3, 3, 30)))]
        case 7:
            return {rng.choice((*TEXTS[:20], "value", "x_mm")): _strange(rng, depth + 1) for _ in range(2)}
    deep: Any = 0
    for _ in range(rng.choice((5, 40, 300))):
        deep = [deep] if rng.random() < 0.5 else {"a": deep}
    return deep


def _owners(value: Any) -> list[Any]:
    """All mappings and lists in a value, itself included."""
    out, todo = [], [value]
    while todo:
        one = todo.pop()
        if isinstance(one, dict | list) and one:
            out.append(one)
            todo.extend(one.values() if isinstance(one, dict) else one)
    return out


def _edit(tree: Any, rng: random.Random) -> Any:
    """A key or entry of a tree lost, renamed, doubled, moved, or given a value of another type."""
    owners = _owners(tree)
    if not owners:
        return _strange(rng)
    owner = rng.choice(owners)
    key = rng.choice(list(owner)) if isinstance(owner, dict) else rng.randrange(len(owner))
    match rng.randrange(7):
        case 0:
            del owner[key]
        case 1 | 2:
            owner[key] = _strange(rng)
        case 3:
            other = rng.choice(owners)
            if not any(one is owner for one in _owners(other)):  # no circles
                owner[key] = other
        case 4 if isinstance(owner, dict):
            new = rng.choice((str(key) + rng.choice(SUFFIXES), str(key).rpartition("_")[0], rng.choice(TEXTS)))
            owner[new] = owner.pop(key)
        case 5 if isinstance(owner, dict):
            owner[rng.choice((str(key) + rng.choice(SUFFIXES), str(key).rpartition("_")[0] + rng.choice(SUFFIXES)))] = (
                owner[key]
            )
        case _:
            if isinstance(owner, list):
                owner.insert(key, rng.choice((owner[key], _strange(rng))))
            elif isinstance(owner[key], int | float):
                owner[key] = rng.choice((0, -owner[key], owner[key] * 1e12, owner[key] * 1e-12, str(owner[key])))
            else:
                owner[key] = [owner[key]]
    return tree


class Plain(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        return True


def _yaml_tree(content: bytes, rng: random.Random) -> bytes:
    tree = _edit(yaml.safe_load(content), rng)
    return yaml.dump(tree, Dumper=Plain, sort_keys=False, allow_unicode=True).encode("utf-8", "replace")


def _json_tree(content: bytes, rng: random.Random) -> bytes:
    tree = _edit(json.loads(content), rng)
    return json.dumps(tree, indent=rng.choice((None, 2)), ensure_ascii=rng.random() < 0.5).encode("utf-8", "replace")


def _cells(content: bytes, rng: random.Random) -> bytes:
    """A cell of a table changed, a column lost, doubled or renamed."""
    rows = [line.split(",") for line in content.decode("utf-8").split("\n")]
    header = next((i for i, row in enumerate(rows) if not row[0].startswith("#")), 0)
    k = rng.randrange(len(rows[header]))
    own = [row for row in rows[header:] if len(row) > k]
    match rng.randrange(6):
        case 0 | 1:
            row = rng.choice(own)
            row[k] = rng.choice((*NUMBERS, *TEXTS, rng.choice(own)[k], rng.choice(row)))
        case 2:
            for row in own:
                del row[k]
        case 3:
            for row in own:
                row.append(row[k])
        case 4:
            name = own[0][k]
            own[0][k] = rng.choice(
                (name.rpartition("_")[0] + rng.choice(SUFFIXES), rng.choice(TEXTS), name + " ", _column(rng))
            )
        case 5:
            value = rng.choice(NUMBERS)
            own[0].append(_column(rng))
            for row in own[1:]:
                row.append(value)
    return "\n".join(",".join(row) for row in rows).encode("utf-8", "replace")


def _column(rng: random.Random) -> str:
    stems = (
        "sigma",
        "time",
        "temperature",
        "approach",
        "use",
        "repeat",
        "cycle",
        "repeats",
        "load",
        "mx",
        "q7",
        "x",
        "reference",
        "state",
        "series",
        "load_id",
        "drive_state",
        "rx",
        "quat_w",
    )
    return rng.choice(stems) + rng.choice(("", *SUFFIXES))


def _elements(content: bytes, rng: random.Random) -> bytes:
    """An element lost, doubled, moved or put in; an attribute given an expression."""
    text = content.decode("utf-8")
    tags, values = list(_TAG.finditer(text)), list(_VALUE.finditer(text))
    choice = rng.randrange(6)
    if choice <= 2 and values:
        match = rng.choice(values)
        new = '"' + rng.choice((*EXPRESSIONS, *NUMBERS, rng.choice(values).group().strip('"'))) + '"'
        return (text[: match.start()] + new + text[match.end() :]).encode("utf-8", "replace")
    if not tags:
        return _bytes(content, rng)
    match, other = rng.choice(tags), rng.choice(tags)
    if choice == 3:
        return (text[: match.start()] + text[match.end() :]).encode()
    more = match.group() if choice == 4 else rng.choice(ELEMENTS)
    return (text[: other.end()] + more + text[other.end() :]).encode()


_Mutation = Callable[[bytes, random.Random], bytes]
_MUTATIONS: dict[str, tuple[_Mutation, ...]] = {
    "yaml": (_bytes, _coded, _lines, _tokens, _tokens, _yaml_tree, _yaml_tree, _yaml_tree),
    "json": (_bytes, _coded, _lines, _tokens, _tokens, _json_tree, _json_tree, _json_tree),
    "xml": (_bytes, _coded, _lines, _tokens, _tokens, _elements, _elements, _elements),
    "csv": (_bytes, _coded, _lines, _tokens, _cells, _cells, _cells),
    "lines": (_bytes, _coded, _lines, _tokens, _tokens),
}

"""The sheet of `make size`: what a reader of the tree must hold in mind, beside its bounds and goals in `ratchet.yaml`.

Standard library and PyYAML only. A line of code holds a token that is no comment and no docstring. A branch is an if,
a loop, an except clause, a comprehension or a boolean operator. A data class is a dataclass, a pydantic model, a
NamedTuple or a TypedDict; one is built at one place where one call bears its name. A literal is a number other than 0,
1, 2, 0.5 and their negatives. A name is behind a door where a package beside the core imports it from inside one of the
core's packages. A binding (assigned name, argument, function, class) is vague where one of its words is in `VAGUE`.
What a command enters is counted under `sys.setprofile`, in a process of its own: `sheet.py WALK`.
"""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from io import StringIO
from pathlib import Path
from types import CodeType, FrameType

import yaml

ROOT = Path(__file__).resolve().parents[2]
RATCHET = Path(__file__).with_name("ratchet.yaml")
WALKS = {
    "identify": ("identify", "examples/r2000ic/experiment.yaml"),
    "diagnose": ("diagnose", "examples/hidden_effect/experiment.yaml"),
}
VAGUE_WORDS = """told tell tells said says left aside own beside here there whole good given found seen wanted asked now
held known stand standing stood grown apart far some most more other others one least still again turned moved lost bent
taken meant instead mended gross missed data item items info tmp res obj thing things"""
VAGUE = frozenset(VAGUE_WORDS.split())
FIELD_PACKAGES = ("qsf_trackers", "qsf_controllers", "qsf_day", "qsf_onboarding")
NO_CODE = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}
BRANCH = (ast.If, ast.IfExp, ast.For, ast.While, ast.ExceptHandler, ast.comprehension, ast.BoolOp)
FUNCTION = (ast.FunctionDef, ast.AsyncFunctionDef)
RECORD_BASES = {"BaseModel", "NamedTuple", "TypedDict"}
PLAIN_NUMBERS = (0, 1, 2, 0.5)


@dataclass(frozen=True)
class Module:
    """A Python file: its lines and the nodes of its syntax tree."""

    path: Path
    rows: tuple[str, ...]
    nodes: tuple[ast.AST, ...]

    @cached_property
    def code(self) -> frozenset[int]:
        """Numbers of its lines of code."""
        written = {n for n, row in enumerate(self.rows, 1) if row.strip() and not row.lstrip().startswith("#")}
        texts = (node for node in self.nodes if isinstance(node, (ast.Constant, ast.JoinedStr)))
        long = (range(node.lineno, (node.end_lineno or 0) + 1) for node in texts if node.end_lineno != node.lineno)
        documentation = (
            range(node.lineno, (node.end_lineno or 0) + 1)
            for node in self.nodes
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        )
        return frozenset(written.union(*long).difference(*documentation))

    @property
    def tokens(self) -> int:
        """Tokens on its lines of code."""
        source = StringIO("".join(f"{row}\n" for row in self.rows))
        return sum(
            token.type not in NO_CODE and (token.start[0] in self.code or token.end[0] in self.code)
            for token in tokenize.generate_tokens(source.readline)
        )


def modules(*groups: str) -> list[Module]:
    """The Python files of folders."""
    paths = (path for group in groups for path in sorted((ROOT / group).rglob("*.py")))
    texts = ((path, path.read_text()) for path in paths)
    return [Module(path, tuple(text.splitlines()), tuple(ast.walk(ast.parse(text)))) for path, text in texts]


def lines_of(group: Iterable[Module]) -> int:
    """Lines of code of modules."""
    return sum(len(module.code) for module in group)


def is_record(node: ast.ClassDef) -> bool:
    """Whether a class only holds data, of any kind."""
    bases = {ast.unparse(base).split(".")[-1].split("[")[0] for base in node.bases}
    return bool(bases & RECORD_BASES) or any("dataclass" in ast.unparse(d) for d in node.decorator_list)


def _inside(path: Path) -> Path:
    """A file from the folder on which Python looks for its package."""
    own = path.relative_to(ROOT)
    return Path(*own.parts[1:]) if own.parts[0] == "plugins" else own


def names_behind_doors(field: Iterable[Module]) -> set[tuple[str, str]]:
    """What the packages beside the core import from inside its packages, and not from their `__init__`."""
    return {
        (node.module, alias.name)
        for module in field
        for node in module.nodes
        if isinstance(node, ast.ImportFrom) and re.match(r"qsframework\.\w+\.", node.module or "") and node.module
        for alias in node.names
    }


def importers(group: list[Module]) -> dict[Path, set[Path]]:
    """The files that import each file."""
    names = {".".join(_inside(module.path).with_suffix("").parts): module.path for module in group}
    found: dict[Path, set[Path]] = defaultdict(set)
    for module in group:
        for node in module.nodes:
            if isinstance(node, ast.ImportFrom) and node.module:
                candidates = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            elif isinstance(node, ast.Import):
                candidates = [alias.name for alias in node.names]
            else:
                continue
            for name in candidates:
                if names.get(name, module.path) != module.path:
                    found[names[name]].add(module.path)
    return found


def bindings(nodes: list[ast.AST]) -> Iterator[str]:
    """Names that the code gives: assigned names, arguments, functions, classes."""
    for node in nodes:
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            yield node.name


def imports_private_name(module: Module) -> bool:
    """Whether a test imports a name with a leading underscore from the library."""
    return any(
        isinstance(node, ast.ImportFrom)
        and (node.module or "").startswith("qsframework")
        and any(alias.name.startswith("_") for alias in node.names)
        for node in module.nodes
    )


def static_counts() -> dict[str, float]:
    """All counts that need no run, by the keys of the ratchet."""
    core, effects, tests = (modules(group) for group in ("qsframework", "plugins/qsf_plugins", "tests"))
    field = [module for package in FIELD_PACKAGES for module in modules(f"plugins/{package}")]
    library = [*core, *field]
    both = [*library, *effects]
    nodes = [node for module in both for node in module.nodes]
    functions = [node for node in nodes if isinstance(node, FUNCTION)]
    complexity = [1 + sum(isinstance(inner, BRANCH) for inner in ast.walk(node)) for node in functions]
    methods = {
        node.name: sum(isinstance(part, ast.FunctionDef) for part in node.body)
        for node in nodes
        if isinstance(node, ast.ClassDef) and is_record(node)
    }
    calls = Counter(
        f.id if isinstance(f := node.func, ast.Name) else getattr(f, "attr", "")
        for node in nodes
        if isinstance(node, ast.Call)
    )
    numbers = (node.value for node in nodes if isinstance(node, ast.Constant) and type(node.value) in (int, float))
    users = importers(both)
    single = [m for m in both if len(users.get(m.path, ())) == 1 and m.path.name != "__init__.py"]
    characters = sum(len(module.rows[n - 1]) for module in library for n in module.code)
    return {
        "core_lines": lines_of(core),
        "field_lines": lines_of(field),
        "effect_lines": lines_of(effects),
        "names_behind_doors": len(names_behind_doors(field)),
        "tokens": sum(module.tokens for module in both),
        "mean_line": round(characters / lines_of(library), 1),
        "branches": sum(isinstance(node, BRANCH) for node in nodes),
        "functions_above_10_branches": sum(count > 10 for count in complexity),
        "data_classes": len(methods),
        "data_classes_built_once_without_method": sum(calls[r] == 1 and not count for r, count in methods.items()),
        "numeric_literals": sum(number not in PLAIN_NUMBERS for number in numbers),
        "vague_names": sum(len(set(re.split("_+", name.lower())) & VAGUE) for name in bindings(nodes)),
        "files_with_one_importer": len(single),
        "lines_with_one_importer": lines_of(single),
        "largest_file": max(len(module.code) for module in both),
        "test_files_on_private_names": sum(map(imports_private_name, tests)),
        "test_lines": lines_of(tests),
    }


def walk(command: tuple[str, ...]) -> dict[str, int]:
    """Files, functions and data types of library and plugins that a command enters, in this process."""
    folders = tuple(f"{ROOT / group}/" for group in ("qsframework", "plugins"))
    files: set[str] = set()
    functions: set[tuple[str, str]] = set()
    types: set[str] = set()
    entered: dict[int, CodeType] = {}  # by identity: equal code of two files is equal to Python

    def enter(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event != "call" or id(code) in entered:
            return
        if code.co_filename.startswith(folders):
            if not code.co_name.startswith("<"):
                files.add(code.co_filename)
                functions.add((code.co_filename, code.co_qualname))
            entered[id(code)] = code
        elif code.co_name == "__init__" and "self" in frame.f_locals:
            kind = type(frame.f_locals["self"])
            if kind.__module__.startswith(("qsframework", "qsf_")):
                types.add(kind.__qualname__)
        else:
            entered[id(code)] = code

    sys.path[:0] = [str(ROOT), str(ROOT / "plugins")]
    sys.argv = ["qsf", *command]
    from qsframework.cli import main

    sys.setprofile(enter)
    try:
        main()
    except SystemExit as stop:
        if stop.code:
            raise
    finally:
        sys.setprofile(None)
    return {"files": len(files), "functions": len(functions), "data_types": len(types)}


def walk_counts(name: str) -> dict[str, int]:
    """The counts of one of `WALKS`, in a process of its own, by the keys of the ratchet."""
    done = subprocess.run(
        [sys.executable, __file__, name], cwd=ROOT, capture_output=True, text=True, timeout=1800, check=True
    )
    counts = json.loads(done.stdout.splitlines()[-1])
    return {f"{name}_{key}": value for key, value in counts.items()}


def ratchet() -> dict[str, dict[str, float]]:
    """Bound and goals of every count."""
    return yaml.safe_load(RATCHET.read_text())


def complaints(counts: dict[str, float]) -> list[str]:
    """What exceeds its bound, and what has fallen below it by more than 1 % and is to be written down."""
    bounds = ratchet()
    return [
        f"{key}: {count:g} exceeds {bound:g} of {RATCHET.name}"
        if count > bound
        else f"{key}: {count:g}: write it into {RATCHET.name}, where {bound:g} stands"
        for key, count in counts.items()
        if count > (bound := bounds[key]["bound"]) or count < 0.99 * bound
    ]


def table() -> str:
    """The sheet as it is printed: each count, its bound, the goal of the open issues and the goal after them."""
    counts = static_counts()
    for name in WALKS:
        counts |= walk_counts(name)
    rows = [f"{'':40}{'now':>10}{'bound':>10}{'next':>10}{'goal':>10}"]
    for key, bounds in ratchet().items():
        columns = (counts.get(key, bounds["bound"]), bounds["bound"], bounds["next"], bounds["goal"])
        rows.append(f"{key.replace('_', ' '):40}" + "".join(f"{column:>10,g}" for column in columns))
    return "\n".join(rows)


if __name__ == "__main__":
    print(json.dumps(walk(WALKS[sys.argv[1]])) if sys.argv[1:] else table())

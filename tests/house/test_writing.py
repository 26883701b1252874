"""Files are written by `files` only: whole files and folders, and journals record by record."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
from sources import MODULES, ROOT, complaints, tree

WRITERS = ("qsframework/files/output.py", "qsframework/files/folders.py", "qsframework/files/journal.py")
METHODS = {
    "write_text",
    "write_bytes",
    "mkstemp",
    "mkdtemp",
    "NamedTemporaryFile",
    "touch",
    "rename",
    "savez",
    "savetxt",
    "tofile",
    "to_csv",
    "copyfile",
    "copytree",
    "symlink_to",
    "unlink",
    "rmtree",
}
SYSTEM = ("open", "replace", "rename", "remove", "move", "copy", "copy2")


def writes(parsed: ast.AST) -> Iterator[str]:
    """Calls that write, move or remove files."""
    for node in ast.walk(parsed):
        if not isinstance(node, ast.Call) or (node.args and ast.unparse(node.args[0]) == "os.devnull"):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        owner = ast.unparse(node.func.value) if isinstance(node.func, ast.Attribute) else ""
        if (owner and name in METHODS) or (owner in ("os", "shutil") and name in SYSTEM):
            yield f"{owner}.{name}"
        elif name == "open":
            modes = [*node.args[0 if owner else 1 :][:1], *(k.value for k in node.keywords if k.arg == "mode")]
            if not all(isinstance(m, ast.Constant) and not set(str(m.value)) & set("wax+") for m in modes):
                yield f"{owner}.open" if owner else "open"


def writing(path: Path) -> Iterator[str]:
    return iter(()) if path.relative_to(ROOT).as_posix() in WRITERS else writes(tree(path))


def test_nothing_else_writes() -> None:
    assert complaints(MODULES, writing) == [], "write by qsframework.files.write_text and its kin"


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("path.write_text(x)", ["path.write_text"]),
        ("write_text(path, x)", []),
        ("open(p, 'w')", ["open"]),
        ("open(p)", []),
        ("p.open('rb')", []),
        ("p.open(mode='a')", ["p.open"]),
        ("open(p, mode)", ["open"]),
        ("os.replace(a, b)", ["os.replace"]),
        ("os.open(os.devnull, os.O_WRONLY)", []),
        ("text.replace(a, b)", []),
    ],
)
def test_the_reading_of_calls(source: str, found: list[str]) -> None:
    assert list(writes(ast.parse(source))) == found

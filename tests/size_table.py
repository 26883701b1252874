"""The table of `make size`: lines of code, tokens, files and the mean line of what the project is made of.

A line of code is one that holds a token of Python that is no comment and no docstring; of a template (HTML, CSS,
JavaScript) every line that is not blank. The mean line is its length in characters, indentation included.
"""

from __future__ import annotations

import ast
import subprocess
import sys
import tokenize
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
GROUPS = {
    "qsframework": ("qsframework/*.py", "qsframework/*.pyi"),
    "plugins": ("plugins/*.py",),
    "templates": ("qsframework/*.j2", "qsframework/*.html", "qsframework/*.css", "qsframework/*.js"),
    "tests": ("tests/*.py",),
    "benchmarks, docs": ("benchmarks/*.py", "docs/*.py"),
}
MADE = (".min.js",)
"""Ends of names of files that come from elsewhere."""
_NO_CODE = (
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
)


@dataclass(frozen=True)
class CodeSize:
    """Lines of code, their characters, tokens and files."""

    lines: int = 0
    characters: int = 0
    tokens: int = 0
    files: int = 0

    def __add__(self, other: CodeSize) -> CodeSize:
        return CodeSize(
            self.lines + other.lines,
            self.characters + other.characters,
            self.tokens + other.tokens,
            self.files + other.files,
        )

    @property
    def mean_line(self) -> float:
        """Characters of a line; 0 where there is none."""
        return self.characters / self.lines if self.lines else 0.0


def python_size(source: str) -> CodeSize:
    """Of a module's text."""
    strings = (n for n in ast.walk(ast.parse(source)) if isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant))
    spans = [range(n.lineno, (n.end_lineno or n.lineno) + 1) for n in strings if isinstance(n.value.value, str)]
    docstrings = {line for span in spans for line in span}
    tokens = [
        token
        for token in tokenize.generate_tokens(StringIO(source).readline)
        if token.type not in _NO_CODE and token.start[0] not in docstrings
    ]
    code = {line for token in tokens for line in range(token.start[0], token.end[0] + 1)}
    text = source.splitlines()
    return CodeSize(len(code), sum(len(text[line - 1]) for line in code), len(tokens), 1)


def text_size(source: str) -> CodeSize:
    """Of a template's text; its words count as tokens."""
    lines = [line.rstrip() for line in source.splitlines() if line.strip()]
    return CodeSize(len(lines), sum(map(len, lines)), sum(len(line.split()) for line in lines), 1)


def sizes(root: Path = ROOT) -> dict[str, CodeSize]:
    """Of each group, from the files that git knows."""
    out: dict[str, CodeSize] = {}
    for group, patterns in GROUPS.items():
        names = subprocess.check_output(["git", "ls-files", "-z", "--", *patterns], cwd=root, text=True).split("\0")
        total = CodeSize()
        for name in filter(None, names):
            if not name.endswith(MADE) and (root / name).exists():
                source = (root / name).read_text(encoding="utf-8")
                total += python_size(source) if name.endswith((".py", ".pyi")) else text_size(source)
        out[group] = total
    return out


def table(found: dict[str, CodeSize]) -> str:
    """As it is printed."""
    lines = [f"{'':18}{'code lines':>12}{'tokens':>10}{'files':>7}{'mean line':>11}"]
    lines += [f"{g:18}{s.lines:12,}{s.tokens:10,}{s.files:7,}{s.mean_line:11.1f}" for g, s in found.items()]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.stdout.write(table(sizes()) + "\n")

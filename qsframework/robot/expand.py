"""From a URDF or xacro file to one tree of elements, each with the file and line it comes from.

xacro runs without ROS, inside the robot's folder only. Every element is marked with its origin
before expansion. An element that a macro writes from its parameters alone is placed at the line
that calls the macro, where its name and numbers stand.
"""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from qsframework.errors import InputError, Problem
from qsframework.files import read_text, read_yaml
from qsframework.files.plain import is_list, is_mapping
from qsframework.robot import xml_tree
from qsframework.robot.packages import Sources, inside
from qsframework.robot.xacro_math import NotAllowed, evaluate
from qsframework.robot.xml_tree import Node, XmlPlace

_LARGEST = 5_000_000
_MOST_CALLS = 10_000
_MOST_ELEMENTS = 20_000
_MOST_TEXT = 20_000_000
_LONGEST = 20_000
"""Of an attribute or text with expressions: xacro's time for one grows with the square of its length."""
_ORIGIN = "qsf_origin"
_LONGEST_NAME = 1000
_UNITS = {
    "radians": 1.0,
    "degrees": math.pi / 180.0,
    "meters": 1.0,
    "millimeters": 1e-3,
    "foot": 0.3048,
    "inches": 0.0254,
}


def _in_si(factor: float) -> Callable[[str], float]:
    return lambda text: float(evaluate(text, {"pi": math.pi})) * factor


_TAGS = {f"!{unit}": _in_si(factor) for unit, factor in _UNITS.items()}
"""Of values in a YAML file that a xacro loads: `!degrees 90`."""
_BUILT_IN = frozenset(
    f"xacro:{name}" for name in ("include", "property", "macro", "if", "unless", "arg", "insert_block", "attribute")
)
_LOCK = threading.Lock()  # xacro keeps its state in its module


def read_tree(path: Path, folder: Path, sources: Sources | None = None, notes: list[str] | None = None) -> Node:
    """The expanded tree of a robot file. InputError with file and line if it cannot be read.

    notes: takes up what xacro lets pass and a reader should know
    """
    root, expansion = _expanded(path, folder, sources)
    if notes is not None and expansion is not None:
        notes += expansion.notes
    return root


def files_of(path: Path, folder: Path) -> tuple[Path, ...]:
    """The file and all that it includes, in the order in which xacro reads them."""
    _, expansion = _expanded(path, folder, None)
    return (path,) if expansion is None else tuple(dict.fromkeys(map(Path, expansion.files)))


def _expanded(path: Path, folder: Path, sources: Sources | None) -> tuple[Node, _Expansion | None]:
    """The tree of a file, and the run of xacro that made it, if the file is one for xacro."""
    root = xml_tree.parse(read_text(path, _LARGEST), str(path))
    if path.suffix != ".xacro" and "xmlns:xacro" not in root.attributes:
        return root, None
    with _LOCK:
        expansion = _Expansion(folder, sources)
        return expansion.run(path), expansion


class _Expansion:
    """One run of xacro: the files it read, the limits it keeps."""

    def __init__(self, folder: Path, sources: Sources | None = None):
        self.folder = folder
        self.sources = sources or Sources()
        self.roots = [folder, self.sources.home(folder)]
        self.files: list[str] = []
        self.tables: dict[Path, dict[str, Any]] = {}
        self.notes: list[str] = []
        self.failed: tuple[Path, str] | None = None
        self.bare: list[str] = []
        self.calls = self.elements = self.text = 0

    def run(self, path: Path) -> Node:
        import xacro

        with self._confined(xacro), self._placed(lambda: XmlPlace(self._current() or str(path), None)):
            document: Any = xacro.process_file(str(path), mappings=dict(self.sources.arguments), verbosity=0)
            return self._node(document.documentElement)

    @contextmanager
    def _placed(self, place: Callable[[], XmlPlace]) -> Generator[None, None, None]:
        """InputError at a place for whatever xacro raises meanwhile."""
        try:
            yield
        except InputError:
            raise
        except Exception as error:  # xacro raises many kinds on a wrong file
            _raise_ours(error)
            raise InputError(self._problem(error, place())) from error

    @contextmanager
    def _confined(self, xacro: Any) -> Generator[None, None, None]:
        """Put our reading, evaluation and limits in the place of xacro's for the time of the run."""

        def eval_text(text: str, symbols: Any) -> Any:
            if len(text) > _LONGEST and "$" in text:
                raise ValueError(f"an attribute or text with expressions has more than {_LONGEST} characters")
            return their_text(text, symbols)

        def eval_all(node: Any, macros: Any, symbols: Any) -> None:
            self.elements += 1
            if self.elements > _MOST_ELEMENTS:
                raise ValueError(f"more than {_MOST_ELEMENTS} elements")
            self._grow(sum(len(child.data) for child in node.childNodes if hasattr(child, "data")))
            self._grow(sum(len(text) for _, text in node.attributes.items()))
            their_all(node, macros, symbols)

        def call(node: Any, macros: Any, symbols: Any) -> Any:
            return self._call(theirs, node, macros, symbols)

        theirs, their_text, their_all = xacro.handle_macro_call, xacro.eval_text, xacro.eval_all
        changed: dict[str, Any] = {
            "parse": self._parse,
            "safe_eval": self._value,
            "eval_extension": self._extension,
            "handle_macro_call": call,
            "eval_text": eval_text,
            "eval_all": eval_all,
            "warning": _quiet,
            "print_location": _quiet,
            "glob": _NoGlob,
        }
        before = {name: getattr(xacro, name) for name in changed}
        for name, own in changed.items():
            setattr(xacro, name, own)
        self._xacro = xacro
        try:
            yield
        finally:
            for name, their in before.items():
                setattr(xacro, name, their)

    def _value(self, text: str, names: Mapping[str, Any], _: Any = None) -> Any:
        own: dict[str, Callable[[str], Any]] = {
            "load_yaml": lambda file: self._load_yaml(file, text),
            "arg": lambda name: self._extension(f"$(arg {name})"),
        }
        try:
            found = evaluate(text, names, own)
        except ValueError:
            self.failed = (self._here, text)
            raise
        if is_mapping(found) or is_list(found) or isinstance(found, str):
            self._grow(len(str(found)))
        return found

    def _load_yaml(self, name: str, expression: str) -> dict[str, Any]:
        """The table of a YAML file, which may use xacro's tags for units; placed where the expression stands."""
        here = self._here
        path = here.parent / name.removeprefix("file://")
        problem = None
        if len(name) > _LONGEST_NAME or not any(inside(path, folder) for folder in self.roots):
            problem = f"load_yaml: {name[:80]!r} is outside the robot's packages"
        elif not path.is_file():
            problem = f"load_yaml: there is no file {name!r}"
        if problem:
            hint = "Put the file into the folder of the robot or of a package that it names."
            line = self._line(here, expression)
            raise InputError(Problem(problem, file=str(here), line=line, hint=hint, argument=self.sources.argument))
        if path not in self.tables:
            self.files.append(str(path))
            doubled: list[Problem] = []
            self.tables[path] = read_yaml(path, _TAGS, doubled).data
            self.notes += [f"{p.file}, line {p.line}: {p.message}; as in xacro the later one counts" for p in doubled]
        return self.tables[path]

    @staticmethod
    def _line(file: Path, expression: str) -> int | None:
        """The line of a file where an expression stands, if it is there once."""
        lines = [n for n, line in enumerate(read_text(file, _LARGEST).splitlines(), 1) if expression.strip() in line]
        return lines[0] if len(lines) == 1 else None

    def _problem(self, error: Exception, place: XmlPlace) -> Problem:
        """What xacro could not do, at the line of the expression where that stands there once."""
        problem = place.problem(_reason(error))
        if any(isinstance(one, NotAllowed) for one in _causes(error)):
            hint = "Expand it with xacro and give the URDF: xacro FILE -o arm.urdf."
            problem = replace(problem, hint=hint)
        elif self.bare:
            hint = f"{self.bare[0]} is none of xacro's: write it with xacro: before its name, as all of its kind."
            problem = replace(problem, hint=hint)
        line = None if self.failed is None else self._line(*self.failed)
        if self.failed is not None and line is not None:
            problem = replace(problem, file=str(self.failed[0]), line=line)
        return problem

    def _grow(self, characters: int) -> None:
        """Count what the file expands to: a few lines that double each other would fill the memory."""
        self.text += characters
        if self.text > _MOST_TEXT:
            raise ValueError(f"it expands to more than {_MOST_TEXT // 1_000_000} MB")

    def _parse(self, source: Any, filename: str | None = None) -> Any:
        """A file's document, its elements marked with `qsf_origin="file index:line"`."""
        from xml.dom import minidom

        path = Path(str(filename))
        if not any(inside(path, folder) for folder in self.roots):
            raise InputError(Problem(f"includes {path.name!r} from outside the robot's folder", file=self._current()))
        if len(self._xacro.filestack) > 20:
            raise InputError(Problem("includes are nested too deeply", file=str(path)))
        data = read_text(path, _LARGEST)
        self.files.append(str(path))
        content = data.encode("utf-8")
        parts: list[bytes] = []
        last = 0
        for tag, offset, line, attributes in xml_tree.starts(data, str(path)):
            if f"xacro:{tag}" in _BUILT_IN:  # as in the files of the first xacro
                self.bare.append(f"<{tag}> of {path.name}, line {line},")
            if tag in _BUILT_IN:
                continue
            at = offset + 1 + len(tag.encode("utf-8"))
            origin = f"{len(self.files) - 1}:{line}:{'own' if _says_something(attributes) else 'macro'}"
            parts += [content[last:at], f' {_ORIGIN}="{origin}"'.encode()]
            last = at
        return minidom.parseString(b"".join([*parts, content[last:]]))

    def _current(self) -> str | None:
        stack = [name for name in self._xacro.filestack or () if name]
        return next((name for name in reversed(stack) if name in self.files), None)

    @property
    def _here(self) -> Path:
        return Path(self._current() or self.folder / "robot")

    def _extension(self, text: str) -> str:
        """`$(find package)` is a folder of the robot's folder, `$(arg name)` an argument; no others."""
        words = text[2:-1].split()
        if len(words) == 2 and words[0] == "find":
            return self._package(words[1])
        if len(words) == 2 and words[0] == "arg":
            arguments = self._xacro.substitution_args_context["arg"]
            if words[1] in arguments:
                self._grow(len(arguments[words[1]]))
                return arguments[words[1]]
            message, argument = f"argument {words[1]!r} has no default; give it a value", ("arg", f"{words[1]}=VALUE")
            raise InputError(Problem(message, file=self._current(), argument=argument))
        if text == "$(cwd)" or words[:1] == ["dirname"]:
            return str((self._here.parent if words[0] == "dirname" else self.folder).resolve())
        raise NotAllowed(f"{text} is not allowed; a robot file may use $(arg NAME) and $(find FOLDER)")

    def _package(self, name: str) -> str:
        if "/" in name or name.startswith("."):  # a path: refused where a file is read through it
            return str(self.folder / name)
        found = self.sources.find(name, self.folder)
        if found is None:
            message = f"$(find {name}): no folder or package of this name in {self.folder}; say where it is"
            raise InputError(Problem(message, file=self._current(), argument=self.sources.argument))
        if found != self.folder / name:  # a link in the robot's own folder leads to nowhere else
            self.roots.append(found)
        return str(found)

    def _call(self, call: Any, node: Any, macros: Any, symbols: Any) -> Any:
        """Expand a macro and place what it wrote at the line of the call."""
        if not node.tagName.startswith("xacro:"):
            return call(node, macros, symbols)
        self.calls += 1
        if self.calls > _MOST_CALLS:
            raise ValueError(f"more than {_MOST_CALLS} macro calls")
        origin = node.getAttribute(_ORIGIN)
        if not origin:  # the second pass of xacro:call
            return call(node, macros, symbols)
        node.removeAttribute(_ORIGIN)
        parent, before = node.parentNode, {id(child) for child in node.parentNode.childNodes}
        with self._placed(lambda: self._place(origin)):
            result = call(node, macros, symbols)
        for child in parent.childNodes:
            if id(child) not in before:
                _mark(child, origin)
        return result

    def _node(self, element: Any) -> Node:
        place = self._place(element.getAttribute(_ORIGIN) or "0:1:own")
        attributes = {name: value for name, value in element.attributes.items() if name != _ORIGIN}
        children = [self._node(c) for c in element.childNodes if c.nodeType == c.ELEMENT_NODE]
        return Node(element.tagName, attributes, place, children)

    def _place(self, origin: str) -> XmlPlace:
        file, line, _ = origin.split(":")
        return XmlPlace(self.files[int(file)], int(line))


class _NoGlob:
    """Includes name one file; patterns are not expanded."""

    @staticmethod
    def glob(pattern: str) -> list[str]:
        raise ValueError(f"an include names one file, not a pattern: {Path(pattern).name!r}")


def _quiet(*_: Any, **__: Any) -> None:
    """In the place of what xacro would print."""


def _says_something(attributes: dict[str, str]) -> bool:
    """Whether a tag carries a name or numbers of its own, not only a macro's parameters."""
    if "name" in attributes:
        return bool(re.sub(r"\$\{[^}]*\}|\$\([^)]*\)", "", attributes["name"]))
    return bool(attributes) and not any("$" in value for value in attributes.values())


def _mark(node: Any, origin: str) -> None:
    """Place an element, and what it holds, at a macro's call unless it has a place of its own."""
    if node.nodeType == node.ELEMENT_NODE and not node.getAttribute(_ORIGIN).endswith(":own"):
        node.setAttribute(_ORIGIN, origin)
        for child in node.childNodes:
            _mark(child, origin)


def _raise_ours(error: BaseException | None) -> None:
    """Raise the InputError that xacro has wrapped into one of its own, if there is one."""
    for one in _causes(error):
        if isinstance(one, InputError):
            raise one


def _causes(error: BaseException | None) -> Generator[BaseException, None, None]:
    """An error of xacro's and those that it has wrapped, the innermost last."""
    while error is not None:
        yield error
        error = getattr(error, "exc", None)


def _reason(error: Exception) -> str:
    if isinstance(error, RecursionError):
        return "xacro: macros, includes or elements are nested without end"
    text = " ".join(str(error).split()) or type(error).__name__
    return f"xacro: {text}"

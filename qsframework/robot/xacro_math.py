"""The expressions of a xacro file, evaluated as arithmetic and nothing else.

xacro hands `${...}` to Python's `eval` behind a filter that a lambda walks around. A robot file is
data, so only numbers, texts, lists, tables, the names of the file and the functions listed here are understood.
"""

from __future__ import annotations

import ast
import builtins
import math
import operator
from collections.abc import Callable, Mapping
from typing import Any, cast

from qsframework.files.plain import is_list, is_mapping

_BIGGEST = 10**18
_LONGEST = 10_000
_MOST_ITEMS = 1000
_SHOWN = 200


class NotAllowed(ValueError):
    """An expression that xacro itself would evaluate and a robot file may not hold."""


FUNCTIONS: dict[str, Callable[..., Any]] = {
    name: getattr(math, name)
    for name in (
        *("acos", "asin", "atan", "atan2", "cos", "hypot", "sin", "tan", "degrees", "radians"),
        *("ceil", "copysign", "exp", "fabs", "floor", "fmod", "log", "log10", "pow", "sqrt"),
    )
} | {
    name: getattr(builtins, name)
    for name in (
        *("abs", "all", "any", "len", "max", "min", "round", "sorted", "sum"),
        *("bool", "dict", "float", "int", "list", "str"),
    )
}
_METHODS: dict[type, tuple[str, ...]] = {
    str: (
        *("split", "strip", "lstrip", "rstrip", "removeprefix", "removesuffix", "lower", "upper", "title"),
        *("replace", "startswith", "endswith", "find", "count", "isdigit"),
    ),
    list: ("index", "count"),
    dict: ("get", "keys", "values", "items"),
}
"""What a text, a list and a table may be asked."""


def _is(a: Any, b: Any) -> bool:
    if b is not None:
        raise NotAllowed("`is` asks of None only in a robot file")
    return a is None


_SIGNS: dict[type[ast.AST], Callable[[Any], Any]] = {
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
    ast.Not: operator.not_,
}
_OPERATORS: dict[type[ast.AST], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: lambda a, b: a / b,
    ast.FloorDiv: lambda a, b: a // b,
    ast.Mod: operator.mod,
    ast.Pow: lambda a, b: float(a) ** float(b),
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.In: lambda a, b: a in b,
    ast.NotIn: lambda a, b: a not in b,
    ast.Is: _is,
    ast.IsNot: lambda a, b: not _is(a, b),
}


def evaluate(expression: str, names: Mapping[str, Any], own: Mapping[str, Callable[[str], Any]] | None = None) -> Any:
    """The value of an expression over the names. ValueError for what has none, NotAllowed for what is not arithmetic.

    own: functions of one text that belong to the file, such as what reads the table of `load_yaml('FILE')`
    """
    if len(expression) > _LONGEST:
        raise ValueError("the expression is too long")
    try:
        body = ast.parse(expression.strip(), mode="eval").body
    except SyntaxError as error:
        raise ValueError(f"not an expression: {expression.strip()!r}") from error
    found = _value(body, (names, own or {}))
    if not _is_data(found):
        raise ValueError(f"{expression.strip()!r} is no number, text, list or table of values")
    return found


Scope = tuple[Mapping[str, Any], Mapping[str, Callable[[str], Any]]]
"""The names of an expression, and the functions of the file."""


def _is_data(value: Any) -> bool:
    """Whether a value is plain data: xacro's own tables of names and functions are not."""
    if type(value) is dict:
        return all(_is_data(v) for v in cast("dict[str, Any]", value).values())
    return all(_is_data(v) for v in value) if is_list(value) else isinstance(value, bool | int | float | str | None)


def _value(node: ast.expr, scope: Scope) -> Any:
    match node:
        case ast.Constant(value=bool() | int() | float() | str() | None):
            return node.value
        case ast.Name():
            return _name(node.id, scope[0])
        case ast.UnaryOp() if type(node.op) in _SIGNS:
            return _SIGNS[type(node.op)](_value(node.operand, scope))
        case ast.BinOp():
            return _binary(node.op, _value(node.left, scope), _value(node.right, scope))
        case ast.BoolOp():
            values = [_value(v, scope) for v in node.values]
            return all(values) if isinstance(node.op, ast.And) else any(values)
        case ast.IfExp():
            return _value(node.body if _value(node.test, scope) else node.orelse, scope)
        case ast.Compare(ops=[op], comparators=[right]) if type(op) in _OPERATORS:
            return _OPERATORS[type(op)](_value(node.left, scope), _value(right, scope))
        case ast.List() | ast.Tuple():
            return _list([_value(element, scope) for element in node.elts])
        case ast.Dict() if None not in node.keys:
            return _table(node, scope)
        case ast.Subscript(slice=ast.Slice() as part):
            return _part(_value(node.value, scope), part, scope)
        case ast.Subscript():
            return _item(_value(node.value, scope), _value(node.slice, scope))
        case ast.Attribute():
            return _attribute(node, scope)
        case ast.Call():
            return _call(node, scope)
        case _:
            raise NotAllowed("only arithmetic is allowed in an expression of a robot file")


def _table(node: ast.Dict, scope: Scope) -> dict[str, Any]:
    """`{'name': value, ..}`, whose keys are texts."""
    keys = [_value(key, scope) for key in node.keys if key is not None]
    if not all(isinstance(key, str) for key in keys):
        raise NotAllowed("the keys of a table are texts in a robot file")
    return dict(zip(keys, _list([_value(value, scope) for value in node.values]), strict=True))


def _part(owner: Any, part: ast.Slice, scope: Scope) -> Any:
    """`text[1:]`, `list[:3]`."""
    ends = [None if end is None else _value(end, scope) for end in (part.lower, part.upper, part.step)]
    if not isinstance(owner, str | list) or not all(end is None or type(end) is int for end in ends):
        raise ValueError("only a text or a list has parts, between whole numbers")
    return cast("Any", owner)[slice(*ends)]


def _name(name: str, names: Mapping[str, Any]) -> Any:
    if name.startswith("_"):
        raise ValueError(f"the name {name!r} is not allowed")
    try:
        value = names[name]
    except KeyError as error:
        raise ValueError(f"name {name!r} is not defined") from error
    if _is_function(value):
        raise ValueError(f"{name!r} is a function; call it")
    return value


def _is_function(value: object) -> bool:
    return callable(value) and not isinstance(value, Mapping)


def _item(owner: Any, key: Any) -> Any:
    if is_mapping(owner):
        return _entry(owner, key)
    if (is_list(owner) or isinstance(owner, str)) and isinstance(key, int) and -len(owner) <= key < len(owner):
        return owner[key]
    raise ValueError(f"there is no entry {key!r} in a {'list' if is_list(owner) else 'value'}")


def _entry(owner: Mapping[str, Any], key: Any) -> Any:
    try:
        value = owner[key]
    except (KeyError, TypeError) as error:
        allowed = f"; it has {', '.join(owner)[:_SHOWN]}" if _is_data(owner) else ""
        raise ValueError(f"there is no entry {key!r}{allowed}") from error
    if _is_function(value):
        raise ValueError(f"{key!r} is a function; call it")
    return value


def _attribute(node: ast.Attribute, scope: Scope) -> Any:
    owner = _value(node.value, scope)
    if not is_mapping(owner):
        raise ValueError(f"{node.attr!r} is not the name of a value")
    return _entry(owner, node.attr) if _is_data(owner) else _name(node.attr, owner)


def _call(node: ast.Call, scope: Scope) -> Any:
    _, of_file = scope
    named = {keyword.arg: _value(keyword.value, scope) for keyword in node.keywords if keyword.arg}
    if len(named) < len(node.keywords) or not _is_data(named):
        raise NotAllowed(f"{ast.unparse(node)!r} is not allowed in a robot file")
    match node.func:
        case ast.Name(id=name) | ast.Attribute(value=ast.Name(id="xacro"), attr=name) if name in of_file and not named:
            (text,) = _arguments(node, scope)
            return of_file[name](str(text))
        case ast.Name(id="dict") | ast.Attribute(value=ast.Name(id="python"), attr="dict"):
            return _data(dict(*_arguments(node, scope), **named))
        case ast.Name(id=name) | ast.Attribute(value=ast.Name(id="math" | "python"), attr=name) if (
            name in FUNCTIONS and not named
        ):
            return _data(FUNCTIONS[name](*_arguments(node, scope)))
        case ast.Attribute(value=owner, attr=name) if any(name in names for names in _METHODS.values()) and not named:
            return _ask(_value(owner, scope), name, _arguments(node, scope))
        case _:
            raise NotAllowed(f"the function {ast.unparse(node.func)!r} is not allowed in a robot file")


def _ask(owner: Any, name: str, given: list[Any]) -> Any:
    """What a text, a list or a table says of itself: `where.split(' ')`, `table.get('x', 0)`."""
    kind = next((kind for kind, names in _METHODS.items() if isinstance(owner, kind) and name in names), None)
    if kind is None or not _is_data(owner):
        raise NotAllowed(f"a value of a robot file has no {name!r}")
    if name == "replace" and sum(len(str(text)) for text in given) * (len(owner) + 1) > _LONGEST * 100:
        raise ValueError("the text is too long")
    found = getattr(owner, name)(*given)
    return _data(found if isinstance(found, bool | int | float | str | None) else _listed(found))


def _listed(found: Any) -> Any:
    """Views of a table, and pairs, as lists."""
    if isinstance(found, dict):
        return cast("Any", found)
    return [list(cast("Any", one)) if isinstance(one, tuple) else one for one in found]


def _data(value: Any) -> Any:
    """The value of a function, unless it is too large to go on with."""
    if isinstance(value, str) and len(value) > _LONGEST:
        raise ValueError("the text is too long")
    if is_list(value) or is_mapping(value):
        _list([value])
    return value


def _arguments(node: ast.Call, scope: Scope) -> list[Any]:
    """The values between the brackets: data, for the text of what is no data tells where it lies in memory."""
    found = [_value(argument, scope) for argument in node.args]
    if not all(map(_is_data, found)):
        raise ValueError(f"{ast.unparse(node)!r}: its argument is no number, text, list or table of values")
    return found


def _list(values: list[Any]) -> list[Any]:
    """The list, which may hold lists and tables: not so many that writing it out takes for ever."""
    if _items(values) > _MOST_ITEMS:
        raise ValueError(f"a list of more than {_MOST_ITEMS} numbers")
    return values


def _items(value: Any) -> int:
    inside = value if is_list(value) else list(value.values()) if is_mapping(value) else []
    return 1 + sum(map(_items, inside))


def _binary(op: ast.operator, left: Any, right: Any) -> Any:
    numbers = isinstance(left, int | float) and isinstance(right, int | float)
    alike = (isinstance(left, str) and isinstance(right, str)) or (is_list(left) and is_list(right))
    if type(op) not in _OPERATORS or not (numbers or (isinstance(op, ast.Add) and alike)):
        raise NotAllowed("an operator of a robot file joins two numbers, or two texts or lists by +")
    value = _OPERATORS[type(op)](left, right)
    if isinstance(value, complex):
        raise ValueError("the value is not a real number")
    if isinstance(value, str) and len(value) > _LONGEST:
        raise ValueError("the text is too long")
    if is_list(value):
        return _list(value)
    return float(value) if isinstance(value, int) and abs(value) > _BIGGEST else value

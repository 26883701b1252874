from collections.abc import Callable, Iterator
from typing import Any, TypeVar

class Mark:
    line: int
    column: int

class YAMLError(Exception): ...

class Node:
    tag: str
    value: Any
    start_mark: Mark

class ScalarNode(Node):
    value: str
    style: str | None

class SequenceNode(Node):
    value: list[Node]

class MappingNode(Node):
    value: list[tuple[Node, Node]]

class Event:
    start_mark: Mark

class AliasEvent(Event):
    anchor: str

class MappingStartEvent(Event): ...
class MappingEndEvent(Event): ...
class SequenceStartEvent(Event): ...
class SequenceEndEvent(Event): ...

_T = TypeVar("_T")

class SafeLoader:
    def __init__(self, stream: str) -> None: ...
    def construct_object(self, node: Node) -> Any: ...

class SafeDumper:
    def ignore_aliases(self, data: Any) -> bool: ...
    def represent_scalar(self, tag: str, value: str, style: str | None = ...) -> ScalarNode: ...
    @classmethod
    def add_representer(cls, data_type: type[_T], representer: Callable[[Any, _T], Node]) -> None: ...

def parse(stream: str, Loader: type[SafeLoader]) -> Iterator[Event]: ...
def compose(stream: str, Loader: type[SafeLoader]) -> Node | None: ...
def dump(
    data: Any,
    stream: None = ...,
    Dumper: type[SafeDumper] = ...,
    *,
    sort_keys: bool = ...,
    allow_unicode: bool = ...,
    width: int = ...,
) -> str: ...

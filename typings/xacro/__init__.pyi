from collections.abc import Mapping
from typing import Any
from xml.dom.minidom import Document

filestack: list[str] | None
substitution_args_context: dict[str, dict[str, str]]

def __getattr__(name: str) -> Any: ...
def process_file(
    input_file_name: str, *, mappings: Mapping[str, str] | None = ..., verbosity: int = ...
) -> Document: ...

"""What needs no reader of files: the mark of a record that is written and read back, and what plain data is, in words
that a type checker understands too."""

from __future__ import annotations

from typing import Any, ClassVar, TypeGuard


class FileRecord:
    """A frozen dataclass whose fields are the keys of a file that qsframework itself writes: `validate` reads it,
    `as_file` writes it. Keys that are for people only are passed over."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"strict": True, "allow_inf_nan": False}


def is_mapping(value: object) -> TypeGuard[dict[str, Any]]:
    """Whether it is a mapping; keys of a file that has been read are text."""
    return isinstance(value, dict)


def is_tuple(value: object) -> TypeGuard[tuple[Any, ...]]:
    """Whether it is a tuple."""
    return isinstance(value, tuple)


def is_list(value: object) -> TypeGuard[list[Any]]:
    """Whether it is a list."""
    return isinstance(value, list)

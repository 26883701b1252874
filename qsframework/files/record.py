"""What is written to a file and read back."""

from __future__ import annotations

from typing import Any, ClassVar


class FileRecord:
    """A frozen dataclass whose fields are the keys of a file that qsframework itself writes: `validate` reads it,
    `as_file` writes it. Keys that are for people only are passed over."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"strict": True, "allow_inf_nan": False}

"""How readings are simulated and read."""

from __future__ import annotations

from typing import Annotated

from qsframework.option import Option

Truth = Annotated[
    str, Option("'nominal' values, or 'drawn': by stated sds or typical sizes.", choices=("nominal", "drawn"))
]
ReadAs = Annotated[
    str | None,
    Option(
        "Read files of states as 'differences' (loaded minus unloaded) or 'positions'.",
        name="states",
        choices=("differences", "positions"),
    ),
]

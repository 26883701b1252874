"""How a fit is validated."""

from __future__ import annotations

from typing import Annotated

from qsframework.option import Option

Halves = Annotated[int, Option("Cross-validate: fit N random halves, report errors on the others.", least=0, most=1000)]

"""What is wrong with readings, or with a file that a campaign reads: one record, from its finder to whoever stops.

`identify` makes the findings of its readings and campaign once and keeps them in the fit's account. identify, check and
diagnose begin with them and go on; whatever uses the fit stops.
"""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from typing import Annotated

from qsframework.files import FileRecord, null


@dataclass(frozen=True)
class Finding(FileRecord):
    """What was found, and what is to be done.

    name: its kind, with its place in brackets where it has one; words: what was found, a clause; mend: what to do, a
    sentence; place: the file or the column, "" for the whole table; rows: lines of the file, none for all
    evidence: log of how much likelier the readings are with what was meant, NaN where no two fits were compared
    stops: whether what uses the fit stops there, or notes it
    """

    name: str
    words: str
    mend: str
    place: str = ""
    _: KW_ONLY
    rows: tuple[int, ...] = ()
    evidence: Annotated[float, null(math.nan)] = math.nan
    stops: bool = True

    @property
    def title(self) -> str:
        """Its name as people read it."""
        return self.name.replace("_", " ")

    @property
    def sentence(self) -> str:
        """What was found and what to do."""
        return f"{self.title}: {self.words}. {self.mend}"

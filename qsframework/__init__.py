"""qsframework: elastostatic calibration of heavy, quasi-serial industrial robots."""

from __future__ import annotations

from typing import TYPE_CHECKING

__all__ = ["__version__"]

if TYPE_CHECKING:
    __version__: str
else:

    def __getattr__(name: str) -> str:
        """The version, looked up when it is asked for: it stands in the package's metadata alone."""
        if name != "__version__":
            raise AttributeError(f"module 'qsframework' has no attribute {name!r}")
        from importlib.metadata import version

        return version("qsframework")

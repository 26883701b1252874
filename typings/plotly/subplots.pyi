from collections.abc import Sequence

from .graph_objects import Figure

def make_subplots(
    rows: int = ...,
    cols: int = ...,
    *,
    shared_xaxes: bool = ...,
    shared_yaxes: bool = ...,
    subplot_titles: Sequence[str] | None = ...,
    horizontal_spacing: float | None = ...,
    vertical_spacing: float | None = ...,
) -> Figure: ...

"""What readings can tell: whitened sensitivities, advice, certificates."""

from typing import TYPE_CHECKING

from qsframework.lazily import lazily

if TYPE_CHECKING:
    from qsframework.information.advice import loss_words, what_would_help
    from qsframework.information.certificate import Allowed, bound_of, efficiency_bound, everything
    from qsframework.information.promise import Promise, promises
    from qsframework.information.rows import HeldRows, MadeRows, MappedRows, Rows, as_rows, scores, weighted_information
    from qsframework.information.sensitivities import (
        information,
        information_rows,
        predicted_sd,
        promised_beyond,
        promised_sd,
    )

__all__ = [
    "Allowed",
    "HeldRows",
    "MadeRows",
    "MappedRows",
    "Promise",
    "Rows",
    "as_rows",
    "bound_of",
    "efficiency_bound",
    "everything",
    "information",
    "information_rows",
    "loss_words",
    "predicted_sd",
    "promised_beyond",
    "promised_sd",
    "promises",
    "scores",
    "weighted_information",
    "what_would_help",
]
__getattr__ = lazily(
    __name__,
    {
        "advice": "loss_words what_would_help",
        "certificate": "Allowed bound_of efficiency_bound everything",
        "promise": "Promise promises",
        "rows": "HeldRows MadeRows MappedRows Rows as_rows scores weighted_information",
        "sensitivities": "information information_rows predicted_sd promised_beyond promised_sd",
    },
)

"""What readings can tell: whitened sensitivities, rank in words, certificates."""

from qsframework.information.advice import loss_words, what_would_help
from qsframework.information.certificate import Allowed, bound_of, efficiency_bound, everything
from qsframework.information.observations import (
    information,
    information_rows,
    predicted_sd,
    promised_beyond,
    promised_sd,
    scales,
)
from qsframework.information.promise import Promise, promises
from qsframework.information.rank import RankTest, rank_test
from qsframework.information.rows import HeldRows, MadeRows, MappedRows, Rows, as_rows, scores, weighted_information

__all__ = [
    "Allowed",
    "HeldRows",
    "MadeRows",
    "MappedRows",
    "Promise",
    "RankTest",
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
    "rank_test",
    "scales",
    "scores",
    "weighted_information",
    "what_would_help",
]

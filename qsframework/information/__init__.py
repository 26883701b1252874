"""What readings can tell: whitened sensitivities, rank in words, certificates."""

from qsframework.information.certificate import Allowed, efficiency_bound, everything, scores, weighted_information
from qsframework.information.observations import information, information_rows, predicted_sd, promised_sd, scales
from qsframework.information.rank import RankTest, rank_test

__all__ = [
    "Allowed",
    "RankTest",
    "efficiency_bound",
    "everything",
    "information",
    "information_rows",
    "predicted_sd",
    "promised_sd",
    "rank_test",
    "scales",
    "scores",
    "weighted_information",
]

from .advice import loss_words as loss_words, what_would_help as what_would_help
from .certificate import (
    Allowed as Allowed,
    bound_of as bound_of,
    everything as everything,
)
from .identifiable import NotEstimated as NotEstimated
from .promise import PredictedUncertainty as PredictedUncertainty, predicted_uncertainties as predicted_uncertainties
from .rows import (
    CandidateRows as CandidateRows,
    HeldRows as HeldRows,
    MadeRows as MadeRows,
    as_rows as as_rows,
    scores as scores,
    weighted_information as weighted_information,
)
from .sensitivities import (
    information as information,
    information_rows as information_rows,
    predicted_beyond as predicted_beyond,
    predicted_sd as predicted_sd,
)

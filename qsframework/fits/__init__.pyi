from .estimate import Estimate as Estimate, EstimateState as EstimateState
from .fit import Fit as Fit
from .held import Held as Held
from .identify import identify as identify, masked_words as masked_words
from .io import write_nominal as write_nominal
from .record import FitRecord as FitRecord, Masked as Masked, read_fit as read_fit, write_fit as write_fit
from .validate import Validation as Validation, validate as validate, validate_halves as validate_halves

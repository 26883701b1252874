from .fit import Estimate as Estimate, Fit as Fit, Masked as Masked, State as State
from .identify import identify as identify, masked_words as masked_words
from .io import StoredFit as StoredFit, read_fit as read_fit, write_fit as write_fit, write_nominal as write_nominal
from .selection import LeftAside as LeftAside
from .validate import Validation as Validation, validate as validate, validate_halves as validate_halves

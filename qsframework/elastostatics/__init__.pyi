from .equilibrium import (
    Equilibrium as Equilibrium,
    cartesian_compliance as cartesian_compliance,
    cartesian_stiffness as cartesian_stiffness,
    equilibrium as equilibrium,
)
from .evaluation import spring_stiffness as spring_stiffness
from .model import Model as Model, make_model as make_model
from .ranges import Beyond as Beyond, beyond as beyond, range_notes as range_notes
from .state import Site as Site, State as State
from .torques import actuator_torques as actuator_torques, flip_margin as flip_margin

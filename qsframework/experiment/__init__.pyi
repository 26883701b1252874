from .alternatives import as_shown as as_shown, on_robot as on_robot
from .constraints import Constraints as Constraints, Sight as Sight
from .differences import differences as differences
from .examples import example as example
from .frames import Frame as Frame
from .noise import NoiseModel as NoiseModel
from .observations import (
    ObservationModel as ObservationModel,
    ReadingRows as ReadingRows,
    make_rows as make_rows,
    observation_model as observation_model,
)
from .plan import (
    Plan as Plan,
    PlanCertificate as PlanCertificate,
    make_plan as make_plan,
    read_plan as read_plan,
    read_poses as read_poses,
    write_plan as write_plan,
)
from .readings import Readings as Readings, States as States
from .readings_file import read_readings as read_readings
from .readings_table import holds_states as holds_states, write_readings as write_readings
from .setup import (
    Experiment as Experiment,
    LoadCase as LoadCase,
    LoadUncertainty as LoadUncertainty,
    Marker as Marker,
    load_experiment as load_experiment,
)
from .simulate import Simulation as Simulation, simulate as simulate, simulate_rows as simulate_rows

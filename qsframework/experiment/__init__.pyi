from .alternatives import as_shown as as_shown, on_robot as on_robot
from .columns import (
    WRENCH as WRENCH,
    WRENCH_NAMES as WRENCH_NAMES,
    XYZ as XYZ,
    Column as Column,
    Table as Table,
    joint_cells as joint_cells,
    joint_stems as joint_stems,
    make_table as make_table,
    number as number,
    read_table as read_table,
    table_text as table_text,
    write_table as write_table,
)
from .constraints import Constraints as Constraints, Sight as Sight
from .differences import differences as differences
from .examples import example as example
from .frames import Frame as Frame, motion_rows as motion_rows, procrustes as procrustes
from .measured import keep_measured as keep_measured, write_imported as write_imported
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
    other_angles as other_angles,
    read_plan as read_plan,
    read_poses as read_poses,
    write_plan as write_plan,
)
from .readings import Readings as Readings, States as States
from .readings_file import read_readings as read_readings, readings_of as readings_of
from .readings_table import (
    HALF_LOAD as HALF_LOAD,
    STATES as STATES,
    displacement_columns as displacement_columns,
    floor_file as floor_file,
    header_of as header_of,
    state_columns as state_columns,
    write_readings as write_readings,
)
from .setup import (
    Experiment as Experiment,
    LoadCase as LoadCase,
    LoadUncertainty as LoadUncertainty,
    Marker as Marker,
    load_experiment as load_experiment,
)
from .simulate import Simulation as Simulation, simulate as simulate, simulate_rows as simulate_rows
from .stations import seen_markers as seen_markers

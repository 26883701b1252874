from . import units as units
from .applications.compare import compare as compare
from .applications.compensate import compensate as compensate
from .applications.stiffness import stiffness_at
from .applications.targets import joint_targets as joint_targets, read_targets as read_targets
from .applications.task import load_task as load_task
from .design import design as design
from .design.programme import make_programme as make_programme
from .diagnose import diagnose as diagnose
from .diagnose.power import forecast as forecast
from .diagnose.second_day import follow_up as follow_up
from .errors import (
    InputError as InputError,
    NotCertified as NotCertified,
    NotConverged as NotConverged,
    NotIdentifiable as NotIdentifiable,
    QsfError as QsfError,
)
from .estimation import FitOptions as FitOptions
from .experiment import (
    Experiment as Experiment,
    Plan as Plan,
    Readings as Readings,
    load_experiment as load_experiment,
    read_plan as read_plan,
    read_readings as read_readings,
    simulate as simulate,
    write_plan as write_plan,
    write_readings as write_readings,
)
from .identify import (
    Fit as Fit,
    identify as identify,
    read_fit as read_fit,
    validate as validate,
    write_fit as write_fit,
)
from .plugin import check_effect as check_effect
from .report.extended import write_extended
from .report.results import report as report
from .report.words.diagnosis import diagnosis_words as diagnosis_words
from .robot import Robot as Robot, load_robot as load_robot
from .screening import find_mistakes as find_mistakes
from .viz.show_scene import show_scene

__version__: str
extend = write_extended
show = show_scene
stiffness = stiffness_at

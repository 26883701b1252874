from . import units as units
from .diagnoses import diagnose as diagnose
from .diagnoses.power import forecast as forecast
from .diagnoses.second_day import follow_up as follow_up
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
from .fits import (
    Fit as Fit,
    identify as identify,
    read_fit as read_fit,
    validate as validate,
    write_fit as write_fit,
)
from .plans import design as design
from .plans.programme import make_programme as make_programme
from .plugin import check_effect as check_effect
from .report.extended import write_extended
from .report.results import report as report
from .report.words.diagnosis import diagnosis_words as diagnosis_words
from .robot import Robot as Robot, load_robot as load_robot
from .screening import find_mistakes as find_mistakes
from .uses.compare import compare as compare
from .uses.compensate import compensate as compensate
from .uses.stiffness import stiffness_at
from .uses.targets import joint_targets as joint_targets, read_targets as read_targets
from .uses.task import load_task as load_task
from .viz.show_scene import show_scene

__version__: str
extend = write_extended
show = show_scene
stiffness = stiffness_at

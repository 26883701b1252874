from .compensate import Compensation as Compensation, compensate as compensate
from .options import ProgrammeOptions as ProgrammeOptions
from .programme_targets import ProgrammeTargets as ProgrammeTargets, read_programme as read_programme
from .stiffness import Stiffness as Stiffness, stiffness_at as stiffness_at
from .targets import Targets as Targets, joint_targets as joint_targets, read_targets as read_targets

from .compensate import Compensation as Compensation, compensate as compensate
from .stiffness import Stiffness as Stiffness, stiffness_at as stiffness_at
from .targets import Targets as Targets, joint_targets as joint_targets, read_targets as read_targets

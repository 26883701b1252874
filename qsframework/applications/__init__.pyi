from .compensate import Compensation as Compensation, compensate as compensate
from .options import (
    ExportOptions as ExportOptions,
    ImportOptions as ImportOptions,
    ProgrammeOptions as ProgrammeOptions,
    ProtocolOptions as ProtocolOptions,
)
from .stiffness import Stiffness as Stiffness, stiffness_at as stiffness_at
from .targets import Targets as Targets, joint_targets as joint_targets, read_targets as read_targets

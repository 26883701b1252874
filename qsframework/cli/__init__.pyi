from .app import main as main
from .check import print_checks as print_checks
from .check_command import check_command as check_command
from .commands import (
    beside as beside,
    distinct_outputs as distinct_outputs,
    load_campaign as load_campaign,
    load_plan as load_plan,
    plan_of as plan_of,
    readings_files as readings_files,
    write_json as write_json,
)
from .files import PlanFile as PlanFile, Readings as Readings
from .kinds import sorted_out as sorted_out
from .numbers import home_pose as home_pose, numbers as numbers, point_of as point_of, wrench_of as wrench_of
from .options import (
    Anyway as Anyway,
    DaskAddress as DaskAddress,
    ExperimentFile as ExperimentFile,
    Jobs as Jobs,
    Json as Json,
    Report as Report,
    Trust as Trust,
)
from .printing import (
    print_folded as print_folded,
    print_line as print_line,
    print_notes as print_notes,
    print_table as print_table,
    print_verdict as print_verdict,
)
from .progress import progress as progress, steps as steps

from .candidates import (
    Candidates as Candidates,
    broken_constraints as broken_constraints,
    check_poses as check_poses,
    filter_candidates as filter_candidates,
    generate_candidates as generate_candidates,
    grid_candidates as grid_candidates,
    read_candidates as read_candidates,
)
from .catalogue import CRITERIA as CRITERIA, TITLES as TITLES, find_criterion as find_criterion
from .design import design as design
from .need import Needed as Needed, plan_for as plan_for
from .options import DesignOptions as DesignOptions
from .ordering import turning as turning, visits as visits, with_repeats as with_repeats
from .problem import joint_sd as joint_sd
from .programme import (
    check_plan as check_plan,
    draft as draft,
    load_name as load_name,
    make_programme as make_programme,
    overloads as overloads,
    payload_notes as payload_notes,
)
from .symmetry import equivalent_poses as equivalent_poses

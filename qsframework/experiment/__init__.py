"""What is done to the robot: campaigns, plans, readings, simulation, and readings as observations."""

from typing import TYPE_CHECKING

from qsframework.lazily import lazily

if TYPE_CHECKING:
    from qsframework.experiment.alternatives import as_shown, on_robot
    from qsframework.experiment.constraints import Constraints, Sight
    from qsframework.experiment.differences import differences
    from qsframework.experiment.examples import example
    from qsframework.experiment.frames import Frame
    from qsframework.experiment.observations import Bridge, Rows, bridge, make_rows
    from qsframework.experiment.plan import Certificate, Plan, make_plan, read_plan, read_poses, write_plan
    from qsframework.experiment.readings import Readings, States
    from qsframework.experiment.readings_table import holds_states, read_readings, write_readings
    from qsframework.experiment.setup import Experiment, LoadCase, LoadUncertainty, Marker, Noise, load_experiment
    from qsframework.experiment.simulate import Simulation, simulate

__all__ = [
    "Bridge",
    "Certificate",
    "Constraints",
    "Experiment",
    "Frame",
    "LoadCase",
    "LoadUncertainty",
    "Marker",
    "Noise",
    "Plan",
    "Readings",
    "Rows",
    "Sight",
    "Simulation",
    "States",
    "as_shown",
    "bridge",
    "differences",
    "example",
    "holds_states",
    "load_experiment",
    "make_plan",
    "make_rows",
    "on_robot",
    "read_plan",
    "read_poses",
    "read_readings",
    "simulate",
    "write_plan",
    "write_readings",
]
__getattr__ = lazily(
    __name__,
    {
        "alternatives": "as_shown on_robot",
        "constraints": "Constraints Sight",
        "differences": "differences",
        "examples": "example",
        "frames": "Frame",
        "observations": "Bridge Rows bridge make_rows",
        "plan": "Certificate Plan make_plan read_plan read_poses write_plan",
        "readings": "Readings States",
        "readings_table": "holds_states read_readings write_readings",
        "setup": "Experiment LoadCase LoadUncertainty Marker Noise load_experiment",
        "simulate": "Simulation simulate",
    },
)

"""What is done to the robot: campaigns, plans, readings, simulation."""

from qsframework.experiment.constraints import Constraints, Sight
from qsframework.experiment.examples import example
from qsframework.experiment.plan import Certificate, Plan, make_plan, read_plan, read_poses, write_plan
from qsframework.experiment.readings import Readings, read_readings, write_readings
from qsframework.experiment.setup import Experiment, LoadCase, LoadUncertainty, Marker, Noise, load_experiment
from qsframework.experiment.simulate import Simulation, simulate
from qsframework.experiment.states import StateReadings, is_states, read_states, write_states

__all__ = [
    "Certificate",
    "Constraints",
    "Experiment",
    "LoadCase",
    "LoadUncertainty",
    "Marker",
    "Noise",
    "Plan",
    "Readings",
    "Sight",
    "Simulation",
    "StateReadings",
    "example",
    "is_states",
    "load_experiment",
    "make_plan",
    "read_plan",
    "read_poses",
    "read_readings",
    "read_states",
    "simulate",
    "write_plan",
    "write_readings",
    "write_states",
]

from .alternatives import Alternative as Alternative, StructuralChange as StructuralChange, alternatives as alternatives
from .controller import Controller as Controller, Drive as Drive
from .loader import as_robot as as_robot, load_robot as load_robot
from .robot import LinkFrame as LinkFrame, Robot as Robot, Shape as Shape
from .search import robot_names as robot_names

from .dh_table import read_denavit as read_denavit
from .folder import NewRobot as NewRobot, new as new
from .options import Arm as Arm

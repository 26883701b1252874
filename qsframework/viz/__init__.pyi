from .scene import Scene as Scene
from .scenes import residual_scene as residual_scene, robot_row as robot_row, task_scene as task_scene
from .server import SceneSite as SceneSite, serve as serve
from .show_scene import Residuals as Residuals, place_poses as place_poses, show_scene as show_scene
from .subject import residuals as residuals

"""Effects of the first edition: their laws had other arguments, and each is told how to write them now."""

from __future__ import annotations

import inspect

from qsframework.errors import PluginError

_LAWS = {
    "errors": "x, context",
    "closure": "actuators, bars, context",
    "mixing": "x, context",
    "torque": "q, x, context",
    "stiffness": "q, x, context",
    "tension": "length, x, context",
    "extra": "torque, x, context",
    "apply": "loads, x, context",
    "read": "reading, x, context",
}
_GONE = ("poses", "robot", "conditions", "markers")


def refuse_first_edition(effect: type) -> None:
    """PluginError for a law with the arguments of the first edition, which says what to write instead."""
    for law, now in _LAWS.items():
        own = effect.__dict__.get(law)
        if not inspect.isfunction(own):
            continue
        found = list(inspect.signature(own).parameters)[1:]
        if len(found) != now.count(",") + 1 or found[-1] in _GONE:
            raise PluginError(
                f"{effect.__name__}.{law}({', '.join(found)}) in {own.__code__.co_filename}, line "
                f"{own.__code__.co_firstlineno}, is a law of the first edition. Write {law}(self, {now}): poses is "
                "context.poses, conditions is context.conditions, robot is context.robot, markers is reading.markers; "
                "springs() gives roles and places, such as ('gear', 'joint_2'). Derivatives may be left out"
            )

"""A pedestal that gives, as an effect for qsframework."""

from dataclasses import dataclass

from qsframework.plugin import Parameter, Spring, VirtualJoint, place


@dataclass(frozen=True)
class BoltedBase(Spring):
    """The pedestal turns about one base axis under the moment there."""

    axis: str = place()
    check = "Anchor bolts, foundation, riser plate."

    def parameters(self, robot):
        return (Parameter(self.name, "rad/(N m)", typical=2e-8, sd=2e-8, lower=0.0),)

    def virtual_joints(self, robot):
        return (VirtualJoint(robot.base, self.axis, "rotation"),)

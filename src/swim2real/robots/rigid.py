"""Which markers a film's scale can be told from: those that keep their distances as the robot moves."""

from __future__ import annotations

from swim2real.robots.robot import Robot


def rigid_markers(robot: Robot) -> tuple[int, ...]:
    """Indices of the first marker and of those on its body, or on bodies that are welded to it."""
    model = robot.build(robot.space.published).compile()
    sensors = [model.sensor(i) for i in range(model.nsensor)][-len(robot.marker_names) :]
    bodies = [int(model.body_weldid[model.site_bodyid[int(sensor.objid[0])]]) for sensor in sensors]
    return tuple(m for m, body in enumerate(bodies) if body == bodies[0])

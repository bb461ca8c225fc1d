"""`pick`."""

from __future__ import annotations

from swim2real.cli.arguments import Pick
from swim2real.cli.hints import for_robot
from swim2real.cli.tables import console
from swim2real.robots import robot_named


def pick(a: Pick) -> int:
    """Writes the page on which the markers of a video's first frame are clicked."""
    from swim2real.tracking.picking import write_pick_page
    from swim2real.video import first_frame

    robot = robot_named(a.robot)
    out = a.out or a.video.with_name(f"{a.video.stem}.pick.html")
    write_pick_page(first_frame(a.video).image, robot.marker_names, a.video.name, out, robot.rest_markers)
    console.print(
        f"{out}: open it in a browser, click {robot.marker_names[0]} to {robot.marker_names[-1]}, "
        f"download points.json, then: swim2real track {a.video} --markers points.json --to REFERENCE"
        f"{for_robot(a.robot)}",
        soft_wrap=True, markup=False,
    )  # fmt: skip
    return 0

"""`pick`."""

from __future__ import annotations

from swim2real.cli.arguments import Pick
from swim2real.cli.hints import for_robot
from swim2real.cli.tables import console
from swim2real.errors import ArgumentError
from swim2real.robots import robot_named


def pick(a: Pick) -> int:
    """Writes the pages on which the markers of videos' first frames are clicked."""
    from swim2real.tracking.picking import write_pick_page
    from swim2real.video import first_frame

    if not a.videos:
        raise ArgumentError("no video was given")
    if a.out is not None and len(a.videos) > 1:
        raise ArgumentError(f"--out '{a.out}' is one page for {len(a.videos)} videos; leave it out")
    robot = robot_named(a.robot)
    names = robot.marker_names
    for video in a.videos:
        page = a.out or video.with_name(f"{video.stem}.pick.html")
        write_pick_page(first_frame(video).image, names, video.name, page, robot.rest_markers)
        console.print(
            f"{page}: open it in a browser, click {names[0]} to {names[-1]}, download {video.stem}.points.json",
            soft_wrap=True, markup=False,
        )  # fmt: skip
    console.print(
        f"Next: swim2real track {' '.join(map(str, a.videos))} --markers "
        f"{' '.join(f'{video.stem}.points.json' for video in a.videos)} --to REFERENCE{for_robot(a.robot)}",
        soft_wrap=True, markup=False,
    )  # fmt: skip
    return 0

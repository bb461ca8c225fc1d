"""A stranger's robot from films to a fit by clicks: `python benchmarks/stranger_by_clicks.py [FOLDER]`, made anew.

The example's snake with six markers and hidden parameters at three frequencies is filmed by the camera of
`lattice_films.py`; beside each film is the table of its commands. `init` writes the robot file, and nobody edits it.
The rest is clicked in Chromium: the markers, one a second, each beside its middle by the error of a hand.
"""

import shutil
import subprocess
import sys
import time
from pathlib import Path

import mujoco
import numpy as np
from lattice_camera import write
from lattice_truth import Body, Box, Camera, Scene, planned

SNAKE = Path(__file__).parents[1] / "examples/snake/snake.xml"
FREQUENCIES, SECONDS, SCALE, PACE = (0.8, 1.2, 1.7), 3.2, 900.0, 1.0  # Hz, s, px/m, s a click
LAST, HAND = "back4", 1.5  # the marker that is left out; standard deviation of a click [px]


def wave(times, frequency):
    """Commands of the servos [rad]. Shape (N, 4)."""
    return 0.6 * np.sin(2 * np.pi * frequency * np.asarray(times)[:, None] - 1.1 * np.arange(4))


def swim(model, frequency):
    """Times [s], and places and angles of the links. Shapes (N,), (N, B, 3)."""
    spec = mujoco.MjSpec.from_file(str(model))
    spec.option.timestep = 5e-4
    for geom in spec.geoms:
        geom.fluid_coefs = [0.7, 0.3, 1.2, 0.8, 0.5]
    for joint in spec.joints[3:]:
        joint.stiffness[0], joint.damping[0] = 0.04, 0.005
    for servo in spec.actuators:
        servo.gainprm[0], servo.biasprm[1] = 0.4, -0.4
    body = spec.compile()
    data, times, poses = mujoco.MjData(body), [], []
    while data.time < SECONDS + 0.1:
        mujoco.mj_forward(body, data)
        times.append(data.time)
        poses.append([[*data.xpos[k][:2], 2 * np.arctan2(data.xquat[k][3], data.xquat[k][0])] for k in range(1, 6)])
        data.ctrl[:] = wave([data.time], frequency)[0]
        mujoco.mj_step(body, data)
    return np.array(times), np.unwrap(poses, axis=0), body


def film(model, frequency, folder):
    """A film and the table of its commands; the places of the markers in its first frame [px]."""
    times, poses, body = swim(model, frequency)
    camera = Camera(width=960, height=540, fps=30.0, bend=0.01, background=(110, 140, 120), seed=round(10 * frequency))
    drawn = (poses - [*poses[:, :, :2].mean((0, 1)), 0]) * [SCALE, -SCALE, -1] + [*camera.center, 0]
    of = [[SCALE * s[:2] * [1, -1] for s in body.site_pos[body.site_bodyid == k]] for k in range(1, 6)]
    begins, end = SCALE * np.array([-0.018, *[-0.002] * 4]), 0.102 * SCALE  # of the links, which hold their markers
    links = [Box(((end + x) / 2, 0.0), ((end - x) / 2, 0.018 * SCALE), 9.0) for x in begins.tolist()]
    bodies = tuple(Body((link,), np.reshape(m, (-1, 2)), (60, 55, 90)) for link, m in zip(links, of, strict=True))

    def at(moments):
        flat = [np.interp(moments, times, one) for one in drawn.reshape(len(times), -1).T]
        return np.transpose(flat).reshape(len(moments), -1, 3)

    scene = Scene(bodies, None, (), at, (240, 225, 70), False, 6.0, SECONDS)
    path = folder / f"f{frequency:.2f}".replace(".", "_")
    made = planned("", scene, camera, path.with_suffix(".mp4"))
    write(made)
    table = np.column_stack([times, wave(times, frequency)])[::10]
    np.savetxt(
        path.with_suffix(".controls.csv"), table, "%.5f", ",", header="time_s,servo1,servo2,servo3,servo4", comments=""
    )
    return made.path.name, made.places[0]


def made(folder):
    """Films, tables and a robot file in a new folder; the places of the markers by film [px]."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    lines = SNAKE.read_text().splitlines(keepends=True)
    (folder / "snake.xml").write_text("".join(line for line in lines if f'"{LAST}"' not in line))
    films = dict(film(folder / "snake.xml", frequency, folder) for frequency in FREQUENCIES)
    subprocess.run([sys.executable, "-m", "swim2real", "init", folder / "snake.xml"], check=True)
    return films


def clicked(page, films, pace):
    """Films clicked and tracked, and a search from the robot's own values until it ends; pace is of clicks [s]."""
    rng, begun = np.random.default_rng(0), time.monotonic()

    def told(what):
        print(f"{time.monotonic() - begun:6.1f} s  {what}: {' '.join(page.inner_text('#job').split())}", flush=True)

    for name, places in films.items():
        page.select_option("#film", name)
        page.locator("#status:has-text('Click nose')").wait_for()
        left, top, *size = page.locator("#stage canvas[tabindex]").bounding_box().values()
        scale = 0.98 * min(size[0] / 960, size[1] / 540)
        for place in places + HAND * rng.standard_normal(places.shape):
            offset = (place + 0.5 - [480, 270]) * scale
            page.mouse.click(left + size[0] / 2 + offset[0], top + size[1] / 2 + offset[1])
            time.sleep(pace)
        page.click("#track")
        page.locator("#track:has-text('Track again')").wait_for()
        told(name)
    page.click("#tofit")
    page.locator("#trials output:has-text('mm')").first.wait_for()
    page.click("#search")
    page.locator("#said:has-text('run fit-1:')").wait_for(timeout=900_000)
    told("search")


if __name__ == "__main__":
    from live_page import opened

    place = Path(sys.argv[1] if len(sys.argv) > 1 else "stranger")
    there = made(place)
    with opened(str(place)) as (page, _):
        clicked(page, there, PACE)

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Is the cause of a bad calibration named, and are good ones left alone?

    bench/faults --program build/release/apps/plenocal                    # 20 seeds of each fault, 200 good sessions
    bench/faults --only target_spacing --seeds 5 --good 0 --keep build/faults
    PLENOCAL_DATA=... bench/faults --real                                 # real sets, with right and wrong target files

Each case is a random session (camera model, lens, image size, target, frames, noise; one camera, a stereo pair or a plenoptic
camera) whose detections, or images where it takes images, are simulated; a fault is put into it; `plenocal calibrate` must
name the fault first in `verdict:` of calibration.yaml. Prints the table of bench/README.md. Needs python3-yaml.
"""
import collections
import copy
import csv
import math
import pathlib
import random
import re
import shutil
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from common import run, save

MILLIMETRES, INCHES = 1000, 1 / 0.0254  # numbers in a file that should be in metres


# ---- sessions

class Session:
    """A simulated session in memory: what the target's file says, cameras, points by camera."""

    def __init__(self, program, folder, rng):
        self.program, self.folder, self.rng = program, folder, rng
        self.target = {}    # what the session's file will say
        self.printed = {}   # what is in front of the cameras
        self.cameras = {}   # of the simulator
        self.models = {}    # name -> model of the session
        self.poses = {}     # of the simulator
        self.points = {}    # camera -> frame -> marker -> list of rows (dicts)
        self.images = False
        self.stage = 0

    def simulate(self, poses=None, cameras=None, printed=None):
        """Points (or images) of other poses, cameras or targets; returns the folder."""
        self.stage += 1
        out = f"simulated{self.stage}"
        save(self.folder / "printed.yaml", printed or self.printed)
        spec = {"seed": self.rng.randrange(1 << 30), "target": "printed.yaml", "target_error": 0,
                "poses": poses or self.poses, "cameras": cameras or self.cameras}
        return common.simulate(self.program, self.folder, spec, *([] if self.images else ["--points"]), "--threads", 1, out=out)

    def read(self, out):
        return {name: read_points(out / f"detections_{name}.csv") for name in self.cameras}

    def start(self):
        out = self.simulate()
        self.poses = {"file": str(out / "truth/poses.csv")}  # further simulations see the same poses
        if not self.images:
            self.points = self.read(out)
        return out

    def frames(self):
        return sorted({frame for points in self.points.values() for frame in points})

    def write(self):
        """The session's files; points of markers that the target's file does not have are left out, as detectors do."""
        path = self.folder / "session.yaml"
        save(self.folder / "target.yaml", self.target)
        cameras = {}
        for name, camera in self.cameras.items():
            keys = {"model": self.models.get(name, camera["model"])}
            if self.images:
                keys["images"] = f"simulated1/{name}/*.png"
            else:
                keys |= {"detections": f"{name}.csv", "image_size": camera["image_size"]}
                write_points(self.folder / f"{name}.csv", self.points[name], markers_of(self.target))
            if "pixel_size" in camera:
                keys["pixel_size"] = camera["pixel_size"]
            cameras[name] = keys
        save(path, {"target": "target.yaml", "cameras": cameras})
        return path


def read_points(path):
    points = collections.defaultdict(lambda: collections.defaultdict(list))
    for row in common.read_table(path):
        row["x"], row["y"] = float(row["x"]), float(row["y"])
        points[row["frame"]][int(row["marker"])].append(row)
    return points


def write_points(path, points, known):
    rows = [{**row, "frame": frame, "marker": marker} for frame, by_marker in sorted(points.items())
            for marker, of_marker in sorted(by_marker.items()) if known is None or marker in known for row in of_marker]
    with open(path, "w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows({**row, "x": f"{row['x']:.6f}", "y": f"{row['y']:.6f}"} for row in rows)


def points_of(points):
    """All rows."""
    return [row for by_marker in points.values() for rows in by_marker.values() for row in rows]


# ---- targets

def grid_corners(target):
    """Marker number -> nominal position."""
    t, markers = target, {}
    if t["type"] == "aprilgrid":
        pitch, size = t["size"] * (1 + t["spacing"]), t["size"]
        for i in range(t["columns"] * t["rows"]):
            x, y = i % t["columns"] * pitch, i // t["columns"] * pitch
            for k, (dx, dy) in enumerate([(0, 0), (1, 0), (1, 1), (0, 1)]):
                markers[4 * (t.get("first_id", 0) + i) + k] = [x + dx * size, y + dy * size, 0.0]
        return markers
    columns, rows = t["columns"], t["rows"]
    if t["type"] == "charuco":
        columns, rows = columns - 1, rows - 1
    for row in range(rows):
        for column in range(columns):
            step = t.get("square", t.get("spacing"))
            across = 2 * column + row % 2 if t.get("pattern") == "asymmetric" else column
            markers[row * columns + column] = [across * step, row * step, 0.0]
    return markers


def scaled(target, factor):
    """Its lengths times the factor; the spacing of an AprilGrid is a ratio."""
    lengths = {"square", "marker", "size"} | ({"spacing"} if target["type"] != "aprilgrid" else set())
    return {key: round(value * factor, 5) if key in lengths else value for key, value in target.items()}


def markers_of(target):
    return None if target["type"] in ("markers", "apriltag") else set(grid_corners(target))


def span(target):
    """Width of the target, m."""
    markers = grid_corners(target).values()
    return max(max(p[axis] for p in markers) - min(p[axis] for p in markers) for axis in (0, 1))


def chessboard(rng):
    columns = rng.randrange(8, 14)
    return {"type": "chessboard", "columns": columns, "rows": rng.choice([r for r in range(6, 10) if r != columns]),
            "square": rng.choice([0.02, 0.025, 0.03, 0.04])}


def aprilgrid(rng):
    columns = rng.choice([5, 6, 7])
    return {"type": "aprilgrid", "columns": columns, "rows": rng.choice([r for r in (4, 5, 6) if r != columns]),
            "size": rng.choice([0.03, 0.055, 0.088]), "spacing": rng.choice([0.25, 0.3, 0.4])}


def charuco(rng):
    square = rng.choice([0.025, 0.03, 0.04])
    return {"type": "charuco", "columns": rng.choice([8, 10, 12]), "rows": rng.choice([6, 8]), "square": square,
            "marker": 0.75 * square, "dictionary": "DICT_5X5_100"}


def circles(rng):
    if rng.random() < 0.5:
        return {"type": "circles", "columns": rng.randrange(8, 12), "rows": rng.randrange(5, 8), "spacing": 0.03,
                "pattern": "symmetric"}
    return {"type": "circles", "columns": rng.randrange(4, 7), "rows": rng.randrange(9, 14), "spacing": 0.02,
            "pattern": "asymmetric"}


BOARDS = [chessboard, aprilgrid, charuco, circles]


# ---- cameras

def camera(rng, model=None, size=None):
    """A plausible lens; the share of its width that an f-theta or pinhole lens sees gives the focal length."""
    u = rng.uniform
    model = model or rng.choice(["pinhole-radtan", "pinhole-radial3", "pinhole-radtan8", "kannala-brandt4", "eucm"])
    size = size or rng.choice([[640, 480], [1280, 960], [1920, 1200], [2448, 2048]])
    width = size[0]
    focal = width * {"kannala-brandt4": u(0.3, 0.42), "eucm": u(0.3, 0.45)}.get(model, u(0.6, 1.3))
    parameters = {"f_x": focal, "f_y": focal * u(0.995, 1.005), "c_x": width / 2 + width * u(-0.02, 0.02),
                  "c_y": size[1] / 2 + size[1] * u(-0.02, 0.02)}
    soft = (focal / width / 0.6) ** 2  # the same bend at the edge for any angle of view
    if model == "pinhole-radial3":
        parameters |= {"A_0": u(-0.2, -0.05) * soft, "A_1": u(0, 0.05) * soft ** 2, "A_2": 0.0}
    if model in ("pinhole-radtan", "pinhole-radtan4"):
        parameters |= {"k_1": u(-0.2, -0.05) * soft, "k_2": u(0, 0.05) * soft ** 2, "p_1": u(-1e-3, 1e-3), "p_2": u(-1e-3, 1e-3)}
    if model == "pinhole-radtan":
        parameters["k_3"] = 0.0
    if model == "pinhole-radtan8":
        parameters |= {"k_1": u(0.2, 0.5), "k_2": u(0, 0.08), "p_1": u(-1e-3, 1e-3), "p_2": u(-1e-3, 1e-3),
                       "k_3": u(0, 0.01), "k_4": u(0.4, 0.7), "k_5": u(0.05, 0.15), "k_6": u(0, 0.01)}
    if model == "kannala-brandt4":
        parameters |= {"k_1": u(-0.03, 0.03), "k_2": u(-0.01, 0.01), "k_3": 0.0, "k_4": 0.0}
    if model == "eucm":
        parameters |= {"alpha": u(0.5, 0.65), "beta": u(0.9, 1.2)}
    return {"model": model, "image_size": size, "parameters": parameters, "detection_sigma": round(10 ** u(-1.5, -0.55), 3)}


def second(first, rng, baseline):
    """The other camera of a stereo pair."""
    other = copy.deepcopy(first)
    other["parameters"]["f_x"] *= rng.uniform(0.99, 1.01)
    other["parameters"]["f_y"] = other["parameters"]["f_x"] * rng.uniform(0.995, 1.005)
    other["parameters"]["c_x"] += rng.uniform(-8, 8)
    other["xi_camera_rig"] = [-baseline, rng.uniform(-0.002, 0.002), rng.uniform(-0.002, 0.002),
                              *(rng.uniform(-0.02, 0.02) for _ in range(3))]
    return other


def plenoptic(rng):
    return {"model": "focused-plenoptic", "image_size": [800, 800], "pixel_size": 7.4e-6,
            "parameters": {"f_L": 0.0122, "b_L0": 0.01166, "B": 0.00026, "c_x": 400 + rng.uniform(-5, 5),
                           "c_y": 400 + rng.uniform(-5, 5), "A_0": rng.uniform(-250, -150), "A_1": 1.2e6,
                           "B_0": 0.03, "B_1": -0.02},
            "detection_sigma": round(rng.uniform(0.03, 0.15), 3),
            "micro_lenses": {"pitch": 19, "rotation": rng.uniform(-0.01, 0.01), "focus": [2.4, 3.0, 3.9]}}


def make(session, kind=None, board=None, model=None, size=None, frames=None, poses=None):
    """A good session: varied poses of a board that fills a good part of the image."""
    rng = session.rng
    kind = kind or rng.choices(["mono", "stereo", "plenoptic"], [6, 3, 1])[0]
    session.printed = (board or rng.choice(BOARDS))(rng)
    width = span(session.printed)
    if kind == "plenoptic":
        session.printed = scaled(session.printed, 0.16 / width)  # what the small camera sees sharp is 0.36 to 0.7 m away
        session.cameras = {"plenoptic": plenoptic(rng)}
        distance = [0.36, 0.7]
    else:
        first = camera(rng, model, size)
        # The target as wide as the image, by the focal length (of a fisheye about its middle).
        fills = width * first["parameters"]["f_x"] / first["image_size"][0]
        distance = [0.8 * fills, 2.2 * fills]
        session.cameras = {"left": first}
        if kind == "stereo":
            session.cameras["right"] = second(first, rng, 0.12 * (distance[0] + distance[1]) / 2)
    session.target = copy.deepcopy(session.printed)
    session.poses = {"kind": "varied", "frames": frames or rng.randrange(15, 41), "distance": distance, "partial": 0.3,
                     **(poses or {})}
    return session


# ---- faults of the target

def target_spacing(s):
    make(s, board=aprilgrid).start()
    right = s.target["spacing"]
    s.target["spacing"] = round(s.rng.choice([right * s.target["size"], right * s.rng.uniform(1.15, 2.5),
                                              right * s.rng.uniform(0.4, 0.85)]), 5)


def target_tag_size(s):
    make(s, kind=s.rng.choice(["mono", "stereo"]), board=aprilgrid)
    corners = grid_corners(s.printed)
    for tag in s.rng.sample(range(len(corners) // 4), s.rng.randrange(1, 4)):
        factor = s.rng.choice([s.rng.uniform(0.8, 0.93), s.rng.uniform(1.07, 1.2)])
        middle = [sum(corners[4 * tag + k][axis] for k in range(4)) / 4 for axis in range(3)]
        for k in range(4):
            corners[4 * tag + k] = [m + factor * (c - m) for c, m in zip(corners[4 * tag + k], middle)]
    s.printed["markers"] = corners
    s.start()


def target_layout(s):
    make(s, kind=s.rng.choice(["mono", "mono", "stereo"]), board=s.rng.choice([chessboard, aprilgrid, circles])).start()
    columns, rows = s.target["columns"], s.target["rows"]
    if s.target["type"] == "aprilgrid" and s.rng.random() < 0.3:
        s.target["first_id"] = s.rng.randrange(1, columns)  # ids of the first row before it are not on this target
        return
    wrong = [(c, columns * rows // c) for c in range(3, columns * rows // 2) if columns * rows % c == 0 and c != columns]
    s.target["columns"], s.target["rows"] = s.rng.choice([(rows, columns), s.rng.choice(wrong)])


def target_corner_order(s):
    make(s, board=aprilgrid)
    if "plenoptic" not in s.cameras and s.rng.random() < 0.5:
        box(s)
    s.start()
    order = s.rng.choice([(3, 2, 1, 0), (1, 2, 3, 0), (2, 3, 0, 1), (3, 0, 1, 2), (0, 3, 2, 1)])
    for points in s.points.values():
        for frame, by_marker in points.items():
            points[frame] = {marker - marker % 4 + order[marker % 4]: rows for marker, rows in by_marker.items()}


def box(s):
    """Tags on three faces of a box in place of the grid."""
    size, tags = 0.06, []
    for i in range(12):
        face, u, v = i % 3, 0.02 + 0.08 * (i // 3 % 2), 0.02 + 0.08 * (i // 6)
        corners = []
        for x, y in ((u, v), (u + size, v), (u + size, v + size), (u, v + size)):
            corners.append([[x, y, 0.0], [0.0, y, x], [x, 0.0, y]][face] if face != 1 else [0.0, y, round(-x, 6)])
        if face == 1:  # left face, seen from outside
            corners = [[0.0, c[1], round(0.16 + c[2], 6)] for c in corners]
            corners = [[0.0, c[1], round(-(0.16 - c[2]) + 0.0, 6)] for c in corners]
        tags.append({"id": i, "corners": corners})
    s.printed = {"type": "apriltag", "family": "tag36h11", "tags": tags}
    s.target = copy.deepcopy(s.printed)
    first = s.cameras["left"]
    fills = 0.2 * first["parameters"]["f_x"] / first["image_size"][0]
    s.poses |= {"distance": [1.2 * fills, 2.5 * fills], "frames": 30}


def target_legacy(s):
    s.images = True
    make(s, kind="mono", board=charuco, model="pinhole-radial3", size=[800, 600], frames=12)
    s.printed["legacy"] = s.rng.random() < 0.5
    s.start()
    s.target["legacy"] = not s.printed["legacy"]


def target_border_bits(s):
    s.images = True
    make(s, kind="mono", board=aprilgrid, model="pinhole-radial3", size=[800, 600], frames=12)
    s.printed["border_bits"] = 1
    s.start()
    s.target["border_bits"] = 2


def target_ids_twice(s):
    make(s, kind=s.rng.choice(["mono", "stereo"]), board=aprilgrid).start()
    frames = [frame for frame in s.frames()]
    other = s.read(s.simulate(poses=shuffled_poses(s)))
    for frame in s.rng.sample(frames, max(3, len(frames) // 2)):
        tags = {tag for tag in range(200) if s.rng.random() < 0.4}
        for name, points in s.points.items():
            for marker in [m for m in points.get(frame, {}) if m // 4 in tags]:
                if marker in other[name].get(frame, {}):
                    points[frame][marker] = other[name][frame][marker]


def shuffled_poses(s):
    """The frames' poses in another order."""
    rows = read_poses(s.poses["file"])
    poses = [row[1:] for row in rows]
    poses = poses[1:] + poses[:1]
    return write_poses(s, [[row[0], *pose] for row, pose in zip(rows, poses)])


def target_scale(s):
    make(s).start()
    s.target = scaled(s.target, s.rng.choice([MILLIMETRES, INCHES]))


def target_not_flat(s):
    make(s, kind=s.rng.choice(["mono", "mono", "stereo"]))
    corners = grid_corners(s.printed)
    width = span(s.printed)
    middle = [sum(p[axis] for p in corners.values()) / len(corners) for axis in range(2)]
    height, angle = width * s.rng.uniform(0.006, 0.015) * s.rng.choice([-1, 1]), s.rng.uniform(0, math.pi)
    for p in corners.values():
        x, y = p[0] - middle[0], p[1] - middle[1]
        p[2] = height * ((x * math.cos(angle) + y * math.sin(angle)) / (width / 2)) ** 2
    s.printed["markers"] = corners
    s.start()


def target_marker_moved(s):
    make(s, kind=s.rng.choice(["mono", "stereo"]))
    corners = grid_corners(s.printed)
    step = s.printed.get("square", s.printed.get("spacing"))
    if s.printed["type"] == "aprilgrid":
        step = s.printed["size"]
    for piece in s.rng.sample(range(len(corners)), s.rng.randrange(1, 4)):
        angle, length = s.rng.uniform(0, 2 * math.pi), step * s.rng.uniform(0.08, 0.3)
        piece = sorted(corners)[piece]
        group = [piece - piece % 4 + k for k in range(4)] if s.printed["type"] == "aprilgrid" else [piece]
        for marker in group:
            corners[marker][0] += length * math.cos(angle)
            corners[marker][1] += length * math.sin(angle)
    s.printed["markers"] = corners
    s.start()


# ---- faults of lens and recording

def model_misfit(s):
    real, taken = s.rng.choice([("kannala-brandt4", "division"), ("kannala-brandt4", "pinhole-radtan4"),
                                ("eucm", "division"), ("pinhole-radtan", "pinhole-radial3")])
    make(s, kind=s.rng.choice(["mono", "stereo"]), model=real)
    for c in s.cameras.values():
        if real == "pinhole-radtan":
            c["parameters"] |= {"p_1": s.rng.choice([-1, 1]) * s.rng.uniform(0.01, 0.02), "p_2": s.rng.uniform(-0.01, 0.01)}
    s.start()
    s.models = {name: taken for name in s.cameras}


def strong_distortion_pinhole(s):
    make(s, kind=s.rng.choice(["mono", "stereo"]), model=s.rng.choice(["pinhole-radtan", "pinhole-radial3"]))
    first = "k_1" if "k_1" in s.cameras["left"]["parameters"] else "A_0"
    for c in s.cameras.values():
        c["parameters"][first] *= 1.5
    s.start()
    s.models = {name: "pinhole" for name in s.cameras}


def images_mirrored(s):
    make(s, kind=s.rng.choice(["mono", "stereo"])).start()
    for name, points in s.points.items():
        for row in points_of(points):
            row["x"] = s.cameras[name]["image_size"][0] - 1 - row["x"]


def images_rotated(s):
    """By 180 degrees, some of them, of a camera whose principal point is off the middle."""
    make(s, kind="mono")
    width, height = s.cameras["left"]["image_size"]
    s.cameras["left"]["parameters"] |= {"c_x": width * s.rng.uniform(0.46, 0.48), "c_y": height * s.rng.uniform(0.52, 0.54)}
    s.start()
    frames = s.frames()
    for frame in s.rng.sample(frames, len(frames) // 3):
        for rows in s.points["left"][frame].values():
            for row in rows:
                row["x"], row["y"] = width - 1 - row["x"], height - 1 - row["y"]


def duplicate_images(s):
    make(s, frames=s.rng.randrange(15, 30)).start()
    frames = s.frames()
    for frame in s.rng.sample(frames, s.rng.randrange(3, 8)):
        for points in s.points.values():
            if frame in points:
                points[frame + "_copy"] = points[frame]


def one_pose(s):
    make(s, kind=s.rng.choice(["mono", "stereo"])).start()
    rows = read_poses(s.poses["file"])
    first = rows[0]
    s.poses = write_poses(s, [[row[0], *first[1:]] for row in rows])
    s.points = s.read(s.simulate())


def one_distance(s):
    make(s, kind=s.rng.choice(["mono", "stereo"]), poses={"kind": ["one-distance", "no-tilt"], "partial": 0}).start()


def no_tilt(s):
    make(s, kind=s.rng.choice(["mono", "stereo"]), poses={"kind": "no-tilt", "partial": 0}).start()


def frames_misaligned(s):
    make(s, kind="stereo", frames=s.rng.randrange(15, 41)).start()
    frames = s.frames()
    step = s.rng.choice([-1, 1])
    names = dict(zip(frames, frames[step:] + frames[:step]))
    s.points["right"] = {names[frame]: by_marker for frame, by_marker in s.points["right"].items()}


def not_synchronous(s):
    make(s, kind="stereo").start()
    distance = s_distance(s)
    moved = move_poses(s, shift=0.01 * distance * s.rng.uniform(1, 3), turn=math.radians(s.rng.uniform(0.5, 2)))
    s.points["right"] = s.read(s.simulate(poses=moved))["right"]


def rig_not_rigid(s):
    """The right camera is knocked in the middle of the recording."""
    make(s, kind="stereo").start()
    cameras = copy.deepcopy(s.cameras)
    for axis in range(3):
        cameras["right"]["xi_camera_rig"][3 + axis] += s.rng.choice([-1, 1]) * math.radians(s.rng.uniform(0.3, 1))
    other = s.read(s.simulate(cameras=cameras))["right"]
    for frame in s.frames()[len(s.frames()) // 2:]:
        if frame in other:
            s.points["right"][frame] = other[frame]


def focus_changed(s):
    make(s, kind="mono").start()
    cameras = copy.deepcopy(s.cameras)
    factor = 1 + s.rng.choice([-1, 1]) * s.rng.uniform(0.01, 0.04)
    for key in ("f_x", "f_y"):
        cameras["left"]["parameters"][key] *= factor
    other = s.read(s.simulate(cameras=cameras))["left"]
    for frame in s.frames()[len(s.frames()) // 2:]:
        if frame in other:
            s.points["left"][frame] = other[frame]


def rolling_shutter(s):
    """The target moves while the rows are read: a row y sees the pose at the time y / height."""
    make(s, kind="mono").start()
    distance = s_distance(s)
    moved = move_poses(s, shift=0.01 * distance * s.rng.uniform(1, 3), turn=math.radians(s.rng.uniform(0.5, 2)))
    quiet = copy.deepcopy(s.cameras)
    quiet["left"]["detection_sigma"] = 0
    before, after = (s.read(s.simulate(poses=poses, cameras=quiet))["left"] for poses in (s.poses, moved))
    height = s.cameras["left"]["image_size"][1]
    for frame, by_marker in s.points["left"].items():
        for marker, rows in by_marker.items():
            if marker not in before.get(frame, {}) or marker not in after.get(frame, {}):
                continue
            a, b = before[frame][marker][0], after[frame][marker][0]
            for key in ("x", "y"):
                rows[0][key] += (b[key] - a[key]) * rows[0]["y"] / height


def frame_outlier(s):
    """One or two frames whose target moved during the exposure, or was bent: 20 times the noise."""
    make(s, kind=s.rng.choice(["mono", "stereo"])).start()
    for frame in s.rng.sample(s.frames(), s.rng.randrange(1, 3)):
        for name, points in s.points.items():
            noise = 20 * s.cameras[name]["detection_sigma"]
            for rows in points.get(frame, {}).values():
                for row in rows:
                    row["x"] += s.rng.gauss(0, noise)
                    row["y"] += s.rng.gauss(0, noise)


def marker_outlier(s):
    """One marker that is measured wrongly nearly everywhere, in no constant way (a reflection)."""
    make(s, kind=s.rng.choice(["mono", "stereo"])).start()
    seen = collections.Counter(marker for points in s.points.values() for by in points.values() for marker in by)
    marker = s.rng.choice([m for m, count in seen.items() if count > 0.6 * max(seen.values())])
    for name, points in s.points.items():
        for by_marker in points.values():
            for row in by_marker.get(marker, []):
                if s.rng.random() < 0.8:
                    row["x"] += s.rng.choice([-1, 1]) * s.rng.uniform(2, 12)
                    row["y"] += s.rng.choice([-1, 1]) * s.rng.uniform(2, 12)


def border_points(s):
    """Points near the image's border are pulled inward: their windows are cut off there."""
    make(s, kind=s.rng.choice(["mono", "stereo"]), poses={"partial": 0.6}).start()
    for name, points in s.points.items():
        camera = s.cameras[name]
        half = s.rng.uniform(0.006, 0.012) * camera["image_size"][0]  # of the detector's window
        pull = s.rng.uniform(4, 10) * camera["detection_sigma"]
        for row in points_of(points):
            for axis, size in zip("xy", camera["image_size"]):
                near, far = row[axis] + 0.5, size - 0.5 - row[axis]
                row[axis] += pull * (max(0, 1 - near / half) - max(0, 1 - far / half))


def read_poses(path):
    return [[row["frame"], *(float(row[key]) for key in ("x", "y", "z", "qx", "qy", "qz", "qw"))] for row in common.read_table(path)]


def write_poses(s, rows):
    path = s.folder / f"poses{s.stage}.csv"
    path.write_text("frame,x,y,z,qx,qy,qz,qw\n" + "".join(",".join(map(str, row)) + "\n" for row in rows))
    return {"file": str(path)}


def s_distance(s):
    """Typical distance of camera and target, m."""
    rows = read_poses(s.poses["file"])
    return sorted(math.dist((0, 0, 0), row[1:4]) for row in rows)[len(rows) // 2]


def move_poses(s, shift, turn):
    """Each frame's rig moved at random by these amounts."""
    rows = []
    for name, x, y, z, *q in read_poses(s.poses["file"]):
        axis = [s.rng.gauss(0, 1) for _ in range(3)]
        length, half = math.hypot(*axis), turn / 2
        b = [math.sin(half) * a / length for a in axis] + [math.cos(half)]
        a = q
        rows.append([name, x + s.rng.gauss(0, shift), y + s.rng.gauss(0, shift), z + s.rng.gauss(0, shift),
                     a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
                     a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
                     a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
                     a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2]])
    s.stage += 1
    return write_poses(s, rows)


FAULTS = [target_spacing, target_tag_size, target_layout, target_corner_order, target_legacy, target_border_bits,
          target_ids_twice, target_scale, target_not_flat, target_marker_moved, model_misfit, strong_distortion_pinhole,
          images_mirrored, images_rotated, duplicate_images, one_pose, one_distance, no_tilt, frames_misaligned,
          not_synchronous, rig_not_rigid, focus_changed, rolling_shutter, frame_outlier, marker_outlier, border_points]


# ---- judging

# Refused when the target's file is read, with the mend, but without a code.
LENGTH_REFUSED = "millimetres are meant"


def judge(program, session_path):
    """(grade, codes worst first, text) of a session's calibration."""
    folder = session_path.parent
    done = run(program, "calibrate", session_path, "-o", folder / "out", "--no-report", "--threads", 1, statuses=common.ANY_STATUS)
    text = done.stdout + done.stderr
    if done.returncode != 0:
        codes = ["target_scale"] if LENGTH_REFUSED in done.stderr else re.findall(r"\((\w+_\w+)\)", done.stderr)
        return "failed", codes, text
    calibration = common.load(folder / "out/calibration.yaml")
    verdict = calibration.get("verdict")
    if verdict is None:  # a program without verdicts prints causes alone
        codes = re.findall(r"^(target_\w+): ", done.stdout, re.M)
        return ("bad" if codes else "good"), codes, text
    return verdict["grade"], [finding["code"] for finding in verdict["findings"] if finding["grade"] != "good"], text


def attempt(program, fault, seed, keep):
    """Runs one case; returns what is printed about it and whether it is right."""
    name = fault.__name__ if fault else "good"
    with common.folder() as folder:
        session = Session(program, folder, random.Random(f"{name} {seed}"))
        try:
            if fault:
                fault(session)
            else:
                make(session).start()
            path = session.write()
            grade, codes, text = judge(program, path)
        except (common.Failed, OSError) as error:
            grade, codes, text, path = "not made", [], str(error), None
        right = codes[:1] == [name] if fault else grade == "good"
        what = ", ".join(f"{c['model']} {c['image_size'][0]}x{c['image_size'][1]}" for c in session.cameras.values())
        line = f"{name} {seed}: {grade}, {' '.join(codes) or '-'} ({session.printed.get('type')}; {what})"
        if not right and keep:
            kept = keep / f"{name}_{seed}"
            shutil.rmtree(kept, ignore_errors=True)
            shutil.copytree(folder, kept)
            (kept / "output.txt").write_text(text)
        return name, right, grade, codes, line


def print_table(results):
    by_name = collections.defaultdict(list)
    for name, right, grade, codes, _ in results:
        by_name[name].append((right, grade, codes))
    common.head("fault", "sessions", "named first", "named", "otherwise first")
    for name, cases in by_name.items():
        if name == "good":
            continue
        named = sum(name in codes for _, _, codes in cases)
        others = collections.Counter(codes[0] if codes else grade for right, grade, codes in cases if not right)
        common.row(f"`{name}`", len(cases), sum(right for right, _, _ in cases), named,
                   ", ".join(f"{code} ({count})" for code, count in others.most_common()))
    if by_name["good"]:
        others = collections.Counter(" ".join([grade, *codes[:1]]) for right, grade, codes in by_name["good"] if not right)
        print(f"\n{sum(right for right, _, _ in by_name['good'])} of {len(by_name['good'])} good sessions are graded good"
              f"{': others ' if others else ''}{', '.join(f'{what} ({count})' for what, count in others.most_common())}.")


# ---- real sets

def real(program):
    """Grade and first finding of each real set with its right target, and with wrong ones."""
    from accuracy import try_real_sets as sets
    common.head("set", "target file", "grade", "first finding", "expected")
    for name, images, target, _, model, _ in sets.SETS:
        cases = [("right", target, "")]
        if target["type"] == "aprilgrid":
            cases += [("spacing: 0.0264", {**target, "spacing": 0.0264}, "target_spacing"),
                      ("columns, rows: 7, 5", {**target, "columns": 7, "rows": 5}, "target_layout")]
        if target["type"] == "charuco":
            cases += [("wrong legacy", {**target, "legacy": not target.get("legacy", False)}, "target_legacy")]
        cases += [("in mm", scaled(target, MILLIMETRES), "target_scale")]
        for what, stated, expected in cases:
            with common.folder() as folder:
                save(folder / "target.yaml", stated)
                save(folder / "session.yaml",
                     {"target": "target.yaml", "cameras": {"camera": {"model": model, "images": str(sets.FRAMES / name / images)}}})
                grade, codes, _ = judge(program, folder / "session.yaml")
            common.row(f"{name} {images}", what, grade, " ".join(codes[:1]) or "-", expected)


def main():
    parser = common.parser(__doc__)
    parser.add_argument("--seeds", default=20, type=int, help="sessions of each fault")
    parser.add_argument("--good", default=200, type=int, help="sessions without a fault")
    parser.add_argument("--only", default="", help="codes, with commas; 'good': sessions without a fault")
    parser.add_argument("--jobs", default=2, type=int, help="sessions at a time")
    parser.add_argument("--keep", type=pathlib.Path, help="folder that keeps the sessions that are judged wrongly")
    parser.add_argument("--real", action="store_true", help="the real sets of docs/data.md instead")
    options = parser.parse_args()
    if options.real:
        real(options.program)
        return
    only = set(filter(None, options.only.split(",")))
    unknown = only - {fault.__name__ for fault in FAULTS} - {"good"}
    if unknown:
        parser.error(f"unknown: {', '.join(sorted(unknown))}")
    # Seed by seed, so that an unfinished run says something about each fault.
    cases = [(fault, seed) for seed in range(options.seeds) for fault in FAULTS if not only or fault.__name__ in only]
    if not only or "good" in only:
        cases += [(None, seed) for seed in range(options.good)]
    results = []
    for result in common.in_threads(options.jobs, lambda case: attempt(options.program, *case, options.keep), cases):
        results.append(result)
        print(result[-1] + ("" if result[1] else "  WRONG"), file=sys.stderr, flush=True)
    print_table(results)


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Does the grade of a calibration follow its error?

    bench/grades --program build/release/apps/plenocal            # ten kinds of sessions, 5 seeds each

Sessions as in bench/faults: of a simulated camera, whose projection is known. Prints for each kind the grades, the median of
the verdict's figure (`projection`, px, within 90 % of the image) and of the true error: the difference from the true camera
(`plenocal compare`, RMS by ninths of the image, at the target's median distance), of the worst ninth but one.
"""
import math
import pathlib
import random
import statistics
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from common import run
from robustness import faults

GRADES = ["good", "usable", "bad", "failed"]


def lens(s, frames, noise=0.1, poses=None):
    """One ordinary lens and a board of 0.26 m, of `frames` images."""
    faults.make(s, kind="mono", model="pinhole-radtan", size=[1280, 960], frames=frames, poses=poses,
                board=lambda rng: {"type": "chessboard", "columns": 11, "rows": 8, "square": 0.026})
    s.cameras["left"]["detection_sigma"] = noise
    return s


def four(s):
    """From one distance, where the board fills the middle half of the image."""
    lens(s, 4, poses={"kind": ["one-distance"], "partial": 0})
    far = s.poses["distance"][1]
    s.poses["distance"] = [far, far]
    s.start()


def bent(s, frames, height):
    lens(s, frames)
    corners = faults.grid_corners(s.printed)
    half = faults.span(s.printed) / 2
    for p in corners.values():
        p[2] = height * ((p[0] - half) / half) ** 2
    s.printed["markers"] = corners
    return s


def near_middle(s):
    """Points within the middle half of width and height alone."""
    lens(s, 20).start()
    for by_marker in s.points["left"].values():
        for marker, rows in list(by_marker.items()):
            x, y = rows[0]["x"] / 1280 - 0.5, rows[0]["y"] / 960 - 0.5
            if max(abs(x), abs(y)) > 0.25:
                del by_marker[marker]


def other_model(s):
    lens(s, 20).start()
    s.models = {"left": "division"}


SESSIONS = [
    ("forty images, noise 0.1 px", lambda s: lens(s, 40).start()),
    ("twenty images, noise 0.1 px", lambda s: lens(s, 20).start()),
    ("eight images, noise 0.1 px", lambda s: lens(s, 8).start()),
    ("twenty images, noise 0.5 px", lambda s: lens(s, 20, noise=0.5).start()),
    ("four images from one distance, board in the middle", four),
    ("twenty images, never tilted", lambda s: lens(s, 20, poses={"kind": "no-tilt", "partial": 0}).start()),
    ("twenty images, points in the middle alone", near_middle),
    ("eighteen images, board bent by 0.8 mm", lambda s: bent(s, 18, 0.8e-3).start()),
    ("eighteen images, board bent by 4 mm", lambda s: bent(s, 18, 4e-3).start()),
    ("twenty images, model with one coefficient", other_model),
]


def judge(program, name, make, seed):
    """(grade, figure of the verdict, true error)"""
    with common.folder() as folder:
        session = faults.Session(program, folder, random.Random(f"{name} {seed}"))
        make(session)
        grade, _, text = faults.judge(program, session.write())
        if grade == "failed":
            return grade, None, None
        result = common.load(folder / "out/calibration.yaml")
        figures = [each["value"] for each in result["verdict"]["findings"] if each["code"] == "projection"]
        distances = [math.hypot(*map(float, row[1:4])) for row in faults.read_poses(folder / "simulated1/truth/poses.csv")]
        done = run(program, "compare", folder / "out/calibration.yaml", folder / "simulated1/truth/calibration.yaml",
            "--distance", statistics.median(distances), "-o", folder / "compared", statuses=(0, 1))
        if done.returncode:  # no pixel in common
            return grade, figures[0] if figures else None, math.inf
        parts = sorted(float(row["rms"]) for row in common.read_table(folder / "compared/compare.csv") if row["part"] != "all")
        return grade, figures[0] if figures else None, parts[-2]


def main():
    parser = common.parser(__doc__)
    parser.add_argument("--seeds", default=5, type=int, help="sessions of each kind")
    options = parser.parse_args()
    common.head("session", "grades", "figure of the verdict, px", "true error, px")
    for name, make in SESSIONS:
        results = list(common.in_threads(2, lambda seed: judge(options.program, name, make, seed), range(options.seeds)))
        grades = [grade for grade, _, _ in results]
        middle = lambda values: f"{statistics.median([v for v in values if v is not None] or [float('nan')]):.2g}"
        common.row(name, ", ".join(f"{grade} {grades.count(grade)}" for grade in GRADES if grade in grades),
                   middle([figure for _, figure, _ in results]), middle([error for _, _, error in results]))


if __name__ == "__main__":
    main()

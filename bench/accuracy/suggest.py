#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Frames until a goal: suggested views against random ones and greedy coverage (docs/suggest.md).

bench/accuracy/suggest.py [--cameras N] [--seed N] [--build build/release] [--jobs 2] [--without-coverage]
bench/accuracy/suggest.py --faults

50 cameras (10 narrow, 15 normal, 10 fisheyes, 10 plenoptic, 5 stereo pairs), or N of each class.
Four random frames each; the goal is the sigma that random views reach with 20 frames. Poses are
carried out with 5 degrees and 5 % of error. The bound on the frames until the goal is that of the
estimate at the end, given the four frames.

--faults: the faulty sets of docs/recordings.md; each suggestion is taken (with these errors) and
calibrated with the rest, until the verdict is good or five were taken.
"""
import csv
import json
import math
import pathlib
import random
import statistics
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from accuracy.geometry import exp_rotation

EXAMPLE = common.ROOT / "examples/simulate"
CLASSES = {"narrow": 10, "normal": 15, "fisheye": 10, "plenoptic": 10, "stereo": 5}


def image(point):
    """The camera of examples/simulate/one_camera.yaml; nothing outside its image."""
    if point[2] <= 0:
        return None
    x, y = point[0] / point[2], point[1] / point[2]
    r2 = x * x + y * y
    factor = 1 + r2 * (-0.21 + r2 * (0.07 - 0.012 * r2))
    u, v = 900 * x * factor + 636, 901 * y * factor + 483
    return (u, v) if 3 <= u <= 1276 and 3 <= v <= 956 and r2 < 1.5 else None


def take(view, markers, frame, dice):
    """Rows of detections of a suggestion as a person carries it out."""
    T = np.array(view["T_camera_target"])
    middle = np.mean(list(markers.values()), axis=0)
    axis = np.array([dice.gauss(0, 1) for _ in range(3)])
    rotation = exp_rotation(axis / np.linalg.norm(axis) * math.radians(5) * dice.gauss(0, 1)) @ T[:3, :3]
    place = (1 + dice.gauss(0, 0.05)) * (T[:3, :3] @ middle + T[:3, 3])
    rows = []
    for number, p in markers.items():
        seen = image(rotation @ (p - middle) + place)
        if seen:
            rows.append(f"{frame},{number},{seen[0] + dice.gauss(0, 0.1):.4f},{seen[1] + dice.gauss(0, 0.1):.4f},0.1")
    return rows


def cure_faults(options):
    program = options.build / "apps/plenocal"
    dice = random.Random(options.seed)
    for kind in ("one-distance", "no-tilt", "corner"):
        with common.folder() as folder:
            spec = common.load(EXAMPLE / "one_camera.yaml")
            spec["poses"]["kind"] = kind
            common.simulate(program, folder, {**spec, "target": "target.yaml"}, "--points", target=common.load(EXAMPLE / "board.yaml"))
            run = lambda *command: common.run(program, *command, statuses=common.ANY_STATUS)
            points = folder / "set" / "detections_cam.csv"
            markers = {number: np.array(place, float)
                       for number, place in common.load(folder / "set/truth/target.yaml")["markers"].items()}
            steps = []
            for step in range(6):
                result = json.loads(run("calibrate", folder / "set/session.yaml", "-o", folder / "out", "--quiet",
                                        "--no-report", "--json").stdout)
                codes = [f["code"] for f in result["verdict"]["findings"] if f["grade"] != "good"]
                steps.append(f"{result['verdict']['grade']} ({', '.join(codes) or '-'})")
                if result["verdict"]["grade"] == "good":
                    break
                view = json.loads(run("suggest", folder / "out", "--count", "1", "--json",
                                      *(("--angle", 70) if "undetermined" in codes else ())).stdout)["views"][0]
                with points.open("a") as table:
                    table.write("".join(row + "\n" for row in take(view, markers, f"s{step}", dice)))
            print(f"{kind}: " + " -> ".join(steps))


def compare_policies(options):
    def run(camera):
        less = ["without-coverage"] if options.without_coverage else []
        return list(csv.DictReader(common.run(options.build / "bench/suggest_views", *camera, *less).stdout.splitlines()))

    cameras = [(kind, options.seed + i) for kind, count in CLASSES.items() for i in range(options.cameras or count)]
    rows = [row for rows in common.in_threads(options.jobs, run, cameras) for row in rows]
    frames = {}
    for row in rows:
        frames.setdefault(row["camera"], {})[row["policy"]] = int(row["frames"])
    classes = {}
    for camera, by_policy in frames.items():
        classes.setdefault(camera.rstrip("0123456789"), []).append(by_policy)
    classes["all"] = list(frames.values())

    policies = ("random", "suggest") if options.without_coverage else ("random", "coverage", "suggest")
    suggested = [row for row in rows if row["policy"] == "suggest"]
    for row in suggested:
        frames[row["camera"]]["bound"] = int(row["bound"])
    print("frames after the start until the goal: medians; sums of suggest and of the bound, and their ratio")
    print("class     ", *(f"{p:>8}" for p in policies), "    sum bound ratio")
    for name, cameras in classes.items():
        medians = [statistics.median(c[p] for c in cameras) for p in policies]
        taken, bound = (sum(c[p] for c in cameras) for p in ("suggest", "bound"))
        print(f"{name:10}", *(f"{median:8g}" for median in medians), f"{taken:7} {bound:5} {taken / bound:5.2f}")
    for column in ("taken_by_bound", "searched_by_bound"):
        parts = [float(row[column]) for row in suggested]
        print(f"{column}, of a sigma 3 % larger: largest {max(parts):.3f}, above 1: {sum(p > 1 for p in parts)} of {len(parts)}")
    ratios = sorted(float(r) for row in suggested for r in row["predicted_over_computed"].split())
    if ratios:
        part = sum(abs(r - 1) < 0.35 for r in ratios) / len(ratios)
        print(f"predicted / computed sigma: median {statistics.median(ratios):.3f}, within 35 %: {100 * part:.0f} % of {len(ratios)}")
    errors = [float(row["error_px"]) / float(row["sigma_px"]) for row in suggested]
    print(f"true error / sigma at the end: RMS {common.rms(errors):.2f}, largest {max(errors):.2f}")


def main():
    parser = common.parser(__doc__, plenocal=None)
    parser.add_argument("--cameras", type=int)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--build", type=pathlib.Path, default=common.BUILD)
    parser.add_argument("--without-coverage", action="store_true")
    parser.add_argument("--faults", action="store_true")
    options = parser.parse_args()
    (cure_faults if options.faults else compare_policies)(options)


if __name__ == "__main__":
    main()

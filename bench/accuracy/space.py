#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Points, lengths and intervals in space against the truth, over calibrated rigs (docs/space.md).

    bench/space PLENOCAL [--rigs 40] [--kinds pinhole fisheye plenoptic mixed far] [--first 0]

Each rig is simulated by points, calibrated, and then triangulates 20 points of a second recording with other poses, in the
frame of its first camera. Prints, by kind: NEES / n of all 20 points together (their errors share the calibration), mean
(error / sigma)^2 of the length between the first two points of each frame, the part of points whose 95 % interval of the
distance holds it, and the part of rigs whose rays meet by the test of all points (99.9 %). The chance interval is that of NEES /
n; lengths and intervals of a rig share its calibration and scatter more. far: points at 45 to 65 baselines. Needs python3-numpy, python3-scipy, python3-yaml.
"""
import pathlib
import sys

import numpy as np
from scipy.stats import chi2

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from accuracy.geometry import read_poses

POINTS = 20
BOARD = "plenocal: 1\ntype: aprilgrid\ncolumns: 6\nrows: 6\nsize: 0.055\nspacing: 0.3\ntolerance: 0.0003\n"


def ordinary(model, random, x):
    f = random.uniform(600, 1100)
    parameters = {"f_x": f, "f_y": f * random.uniform(0.995, 1.005), "c_x": 640 + random.uniform(-20, 20),
                  "c_y": 480 + random.uniform(-20, 20)}
    if model == "kannala-brandt4":
        parameters.update({"f_x": f / 2, "f_y": f / 2, "k_1": random.uniform(-0.03, 0.03), "k_2": random.uniform(-0.01, 0.01), "k_3": 0.0, "k_4": 0.0})
    else:
        parameters.update({"A_0": random.uniform(-0.25, -0.1), "A_1": random.uniform(0.0, 0.08), "A_2": 0.0})
    camera = {"model": model, "image_size": [1280, 960], "parameters": parameters, "detection_sigma": float(random.uniform(0.05, 0.2))}
    if x:
        camera["xi_camera_rig"] = [-x, *random.uniform(-0.005, 0.005, 2), *random.uniform(-0.03, 0.03, 3)]
    return camera


def plenoptic(random, x):
    camera = {"model": "focused-plenoptic", "image_size": [800, 800], "pixel_size": 7.4e-6,
              "parameters": {"f_L": 0.0122, "b_L0": 0.01166, "B": 0.00026, "c_x": 402, "c_y": 397, "A_0": -210, "A_1": 1.2e6,
                             "B_0": 0.03, "B_1": -0.02},
              "detection_sigma": float(random.uniform(0.02, 0.06)),
              "micro_lenses": {"pitch": 19, "rotation": 0.006, "focus": [2.4, 3.0, 3.9]}}
    if x:
        camera["xi_camera_rig"] = [-x, *random.uniform(-0.005, 0.005, 2), *random.uniform(-0.03, 0.03, 3)]
    return camera


def cameras_of(kind, random):
    if kind == "plenoptic":
        return {"plenoptic": plenoptic(random, 0)}
    if kind == "mixed":
        return {"left": ordinary("pinhole-radial3", random, 0), "right": ordinary("pinhole-radial3", random, 0.1),
                "plenoptic": plenoptic(random, 0.05)}
    model = "kannala-brandt4" if kind == "fisheye" else "pinhole-radial3"
    return {"left": ordinary(model, random, 0), "right": ordinary(model, random, 0.02 if kind == "far" else 0.12)}


def plain(value):
    if isinstance(value, dict):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    return float(value) if isinstance(value, np.floating) else value


def one_rig(plenocal, place, kind, seed):
    """Error / sigma of one rig's points: NEES, lengths, whether intervals hold, whether the rays meet."""
    random = np.random.default_rng(seed)
    (place / "target.yaml").write_text(BOARD)
    near = [0.36, 0.7] if kind in ("plenoptic", "mixed") else [0.4, 1.2]
    cameras = plain(cameras_of(kind, random))
    for name, frames, distance, offset in [("set", 25, near, 0), ("new", 6, [0.9, 1.3] if kind == "far" else near, 1)]:
        poses = {"kind": "varied", "frames": frames, "distance": distance, "partial": 0.3}
        common.save(place / f"{name}.yaml", {"plenocal": 1, "seed": 2 * seed + offset, "target": "target.yaml", "poses": poses,
                                             "cameras": cameras})
        common.run(plenocal, "simulate", place / f"{name}.yaml", "--points", "-o", place / name, "--quiet")
    common.run(plenocal, "calibrate", place / "set/session.yaml", "-o", place / "result", "--quiet", statuses=(0, 1))
    tables = [f"{name}={place / 'new' / f'detections_{name}.csv'}" for name in cameras]
    done = common.run(plenocal, "triangulate", place / "result", *tables, "-o", place / "tri", "--quiet", statuses=(0, 1))
    if done.returncode:
        return None
    rows = [row for row in common.read_table(place / "tri/points.csv") if row["used"] == "1"]
    if len(rows) < POINTS:
        return None
    rows = [rows[i] for i in random.choice(len(rows), POINTS, replace=False)]
    shared = {}
    for row in common.read_table(place / "tri/shared.csv"):
        key = row["frame"], row["marker"]
        shared.setdefault(key, []).append([float(v) for k, v in row.items() if k.startswith("c_")])
    target = common.load(place / "new/truth/target.yaml")["markers"]
    poses = read_poses(place / "new/truth/poses.csv")
    error, roots, noise, holds = [], [], [], []
    for row in rows:
        T = poses[row["frame"]]  # T_target_rig
        marker = np.array(target[int(row["marker"])])
        truth = T[:3, :3].T @ (marker - T[:3, 3])
        found = np.array([float(row[c]) for c in "xyz"])
        error.append(found - truth)
        roots.append(np.array(shared[row["frame"], row["marker"]]))
        N = np.zeros((3, 3))
        for i, a in enumerate("xyz"):
            for j, b in enumerate("xyz"):
                N[i, j] = float(row[f"noise_{min(a, b)}_{max(a, b)}"])
        noise.append(N)
        # The interval is symmetric in rho = 1 / distance, of which the true one follows along the ray.
        rho, nearest = float(row["rho"]), float(row["nearest"])
        true_rho = 1 / (1 / rho - (found - truth) @ found / np.linalg.norm(found))
        holds.append(abs(true_rho - rho) <= 1 / nearest - rho)
    root = np.vstack(roots)
    covariance = root @ root.T
    for i, N in enumerate(noise):
        covariance[3 * i:3 * i + 3, 3 * i:3 * i + 3] += N
    e = np.concatenate(error)
    nees = e @ np.linalg.solve(covariance, e) / len(e)
    lengths = []
    for i in range(0, POINTS, 2):
        found = np.array([[float(rows[k][c]) for c in "xyz"] for k in (i, i + 1)])
        between = found[0] - found[1]
        size = np.linalg.norm(between)
        true = np.linalg.norm(between - (error[i] - error[i + 1]))
        u = between / size
        g = u @ (roots[i] - roots[i + 1])
        lengths.append((size - true) ** 2 / (u @ (noise[i] + noise[i + 1]) @ u + g @ g))
    summary = common.load(place / "tri/triangulation.yaml")
    return nees, np.mean(lengths), np.mean(holds), summary["probability"] > 1e-3


def main():
    arguments = common.parser(__doc__, "plenocal")
    arguments.add_argument("--rigs", type=int, default=40)
    arguments.add_argument("--first", type=int, default=0)
    arguments.add_argument("--kinds", nargs="+", default=["pinhole", "fisheye", "plenoptic", "mixed", "far"])
    arguments = arguments.parse_args()
    common.head("rigs", "number", "NEES / n", "by chance (99 %)", "lengths", "intervals of 95 % hold", "rays meet")
    for kind in arguments.kinds:
        found = []
        for seed in range(arguments.first, arguments.first + arguments.rigs):
            with common.folder() as place:
                result = one_rig(arguments.plenocal, place, kind, seed)
            if result:
                found.append(result)
        nees, lengths, holds, meet = np.array(found).mean(axis=0)
        n = 3 * POINTS * len(found)
        low, high = chi2.ppf([0.005, 0.995], n) / n
        common.row(kind, len(found), f"{nees:.3f}", f"{low:.2f} to {high:.2f}", f"{lengths:.2f}", f"{100 * holds:.1f} %",
                   f"{100 * meet:.0f} %")


if __name__ == "__main__":
    main()

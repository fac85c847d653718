#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Points, lengths and intervals in space against the truth, over calibrated rigs (docs/space.md).

    bench/space PLENOCAL [--rigs 40] [--kinds pinhole fisheye spline plenoptic mixed far beyond] [--first 0]
    PATH=/usr/bin:$PATH /usr/bin/python3 bench/space PLENOCAL mrcal       # beside mrcal's standard errors
    bench/space PLENOCAL known                                           # `if_known` beside calibrations that know it
    bench/space PLENOCAL real                                            # scatter of real lengths

Each rig is simulated by points, calibrated, and then triangulates 20 points of a second recording with other poses, in the
frame of its first camera. Prints, by kind: NEES / n of all 20 points together (their errors share the calibration), that of
the calibration's part alone (exact pixels; in the directions of its covariance with at least 1 % of the largest sigma), mean
(error / sigma)^2 of the length between the first two points of each frame, the part of points whose 95 % interval of the
distance holds it, and the part of rigs whose rays meet by the test of all points (99.9 %). The chance interval is that of NEES /
n; lengths and intervals of a rig share its calibration and scatter more. far: points at 45 to 65 baselines, beyond: at 1000 to
2000, where X is not Gaussian and has no NEES. Needs python3-numpy, python3-scipy, python3-yaml.
"""
import pathlib
import random as plain_random
import sys

import numpy as np
from scipy.stats import chi2

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from accuracy import space_known, space_mrcal, space_real, try_simulated
from accuracy.geometry import read_poses

POINTS = 20
FIXED_KNOTS = ("x_05_04", "y_05_04", "y_07_04")  # models/splined.h
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
    if model == "splined":
        f = random.uniform(330, 400)
        camera["image_size"] = try_simulated.SIZE
        camera["parameters"] = {"f_x": f, "f_y": f, "c_x": 319.5 + random.uniform(-8, 8), "c_y": 239.5 + random.uniform(-8, 8),
                                **try_simulated.spline(f, plain_random.Random(int(random.integers(1 << 30))))}
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
    model = {"fisheye": "kannala-brandt4", "spline": "splined"}.get(kind, "pinhole-radial3")
    return {"left": ordinary(model, random, 0), "right": ordinary(model, random, 0.02 if kind in ("far", "beyond") else 0.12)}


def plain(value):
    if isinstance(value, dict):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    return float(value) if isinstance(value, np.floating) else value


def triangulated(plenocal, place, recording, cameras, chosen, *options):
    """Errors (N, 3), noise (N, 3, 3), roots (N, 3, P), rows and truth of used points that `chosen` takes of the number of all."""
    tables = [f"{name}={place / recording / f'detections_{name}.csv'}" for name in cameras]
    done = common.run(plenocal, "triangulate", place / "result", *tables, *options, "-o", place / "tri", "--quiet", statuses=(0, 1))
    rows = [row for row in common.read_table(place / "tri/points.csv") if row["used"] == "1"] if done.returncode == 0 else []
    if len(rows) < POINTS:
        return None
    rows = [rows[i] for i in chosen(len(rows))]
    shared = {}
    for row in common.read_table(place / "tri/shared.csv"):
        key = row["frame"], row["marker"]
        shared.setdefault(key, []).append([float(v) for k, v in row.items() if k.startswith("c_")])
    target = common.load(place / recording / "truth/target.yaml")["markers"]
    poses = read_poses(place / recording / "truth/poses.csv")
    errors, noise, truths = [], [], []
    for row in rows:
        T = poses[row["frame"]]  # T_target_rig
        truths.append(T[:3, :3].T @ (np.array(target[int(row["marker"])]) - T[:3, 3]))
        errors.append(np.array([float(row[c]) for c in "xyz"]) - truths[-1])
        noise.append([[float(row[f"noise_{min(a, b)}_{max(a, b)}"]) for b in "xyz"] for a in "xyz"])
    return np.array(errors), np.array(noise), np.array([shared[row["frame"], row["marker"]] for row in rows]), rows, truths


def of_calibration(errors, roots):
    """Chi-square and degrees of errors without noise, in the directions of at least 1 % of the largest standard error."""
    U, s, _ = np.linalg.svd(roots.reshape(errors.size, -1), full_matrices=False)
    seen = s > 1e-2 * s[0]
    return np.sum((U[:, seen].T @ errors.ravel() / s[seen]) ** 2), seen.sum()


def one_rig(plenocal, place, kind, seed):
    """Error / sigma of one rig's points: NEES, lengths, whether intervals hold and rays meet, chi-square and degrees of the calibration,
    sigma of rho over rho."""
    random = np.random.default_rng(seed)
    (place / "target.yaml").write_text(BOARD)
    near = {"plenoptic": [0.36, 0.7], "mixed": [0.36, 0.7], "spline": [0.25, 0.7]}.get(kind, [0.4, 1.2])
    cameras = plain(cameras_of(kind, random))
    exact = {name: {**camera, "detection_sigma": 1e-6} for name, camera in cameras.items()}
    far = {"far": [0.9, 1.3], "beyond": [20, 40]}.get(kind, near)
    for name, frames, distance, offset, simulated in [("set", 80 if kind == "spline" else 25, near, 0, cameras),
                                                      ("new", 6, far, 1, cameras), ("exact", 6, far, 1, exact)]:
        poses = {"kind": "varied", "frames": frames, "distance": distance, "partial": 0.3}
        common.save(place / f"{name}.yaml", {"plenocal": 1, "seed": 2 * seed + offset, "target": "target.yaml", "poses": poses,
                                             "cameras": simulated})
        common.run(plenocal, "simulate", place / f"{name}.yaml", "--points", "-o", place / name, "--quiet")
    if kind == "spline":
        # The knots' places and three knots define the camera's own frame: as those of the truth.
        session = common.load(place / "set/session.yaml")
        for name, camera in session["cameras"].items():
            same = {key: cameras[name]["parameters"][key] for key in ("f_x", "f_y", "c_x", "c_y", "fov", *FIXED_KNOTS)}
            camera |= {"initial": same, "fixed": list(same)}
        common.save(place / "set/session.yaml", session)
    common.run(plenocal, "calibrate", place / "set/session.yaml", "-o", place / "result", "--quiet", statuses=(0, 1))
    chosen = lambda count: random.choice(count, POINTS, replace=False)
    found = triangulated(plenocal, place, "new", cameras, chosen)
    if not found:
        return None
    error, noise, roots, rows, truth = found
    meet = common.load(place / "tri/triangulation.yaml")["probability"] > 1e-3
    without_noise = triangulated(plenocal, place, "exact", cameras, chosen, "--sigma", "0.05")
    if not without_noise:
        return None
    # Distances from the mean centre; those of points at infinity from the first camera's.
    holds, relative = [], []
    for row, true in zip(rows, truth):
        rho, found = float(row["rho"]), np.linalg.norm([float(row[c]) for c in "xyz"])
        distance = np.linalg.norm(true) + (1 / rho - found if np.isfinite(found) else 0)
        holds.append(float(row["nearest"]) <= distance <= float(row["farthest"]))
        relative.append(float(row["sigma_rho"]) * distance)
    if kind == "beyond":
        return np.nan, np.nan, np.mean(holds), meet, *of_calibration(without_noise[0], without_noise[2]), np.median(relative)
    root = roots.reshape(error.size, -1)
    covariance = root @ root.T
    for i, N in enumerate(noise):
        covariance[3 * i:3 * i + 3, 3 * i:3 * i + 3] += N
    nees = error.ravel() @ np.linalg.solve(covariance, error.ravel()) / error.size
    lengths = []
    for i in range(0, POINTS, 2):
        found = np.array([[float(rows[k][c]) for c in "xyz"] for k in (i, i + 1)])
        between = found[0] - found[1]
        size = np.linalg.norm(between)
        true = np.linalg.norm(between - (error[i] - error[i + 1]))
        u = between / size
        g = u @ (roots[i] - roots[i + 1])
        lengths.append((size - true) ** 2 / (u @ (noise[i] + noise[i + 1]) @ u + g @ g))
    return nees, np.mean(lengths), np.mean(holds), meet, *of_calibration(without_noise[0], without_noise[2]), np.median(relative)


def main():
    arguments = common.parser(__doc__, "plenocal")
    arguments.add_argument("part", nargs="?", choices=["nees", "known", "mrcal", "real"], default="nees")
    arguments.add_argument("--rigs", type=int, default=40)
    arguments.add_argument("--first", type=int, default=0)
    arguments.add_argument("--kinds", nargs="+", default=["pinhole", "fisheye", "spline", "plenoptic", "mixed", "far", "beyond"])
    arguments = arguments.parse_args()
    if arguments.part != "nees":
        return {"known": space_known, "mrcal": space_mrcal, "real": space_real}[arguments.part].run(arguments.plenocal)
    common.head("rigs", "number", "NEES / n", "by chance (99 %)", "of the calibration", "by chance (99 %)", "lengths",
                "s / rho", "intervals of 95 % hold", "rays meet")
    for kind in arguments.kinds:
        found = []
        for seed in range(arguments.first, arguments.first + arguments.rigs):
            with common.folder() as place:
                result = one_rig(arguments.plenocal, place, kind, seed)
            if result:
                found.append(result)
        nees, lengths, holds, meet, chi_square, degrees, relative = np.array(found, float).mean(axis=0)
        band = lambda n: "{:.2f} to {:.2f}".format(*chi2.ppf([0.005, 0.995], n) / n)
        common.row(kind, len(found), f"{nees:.3f}", band(3 * POINTS * len(found)), f"{chi_square / degrees:.3f}",
                   band(degrees * len(found)), f"{lengths:.2f}", f"{relative:.2g}", f"{100 * holds:.1f} %", f"{100 * meet:.0f} %")


if __name__ == "__main__":
    main()

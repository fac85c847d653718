#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Calibration without a target on simulated tracks: errors and their standard errors.

    bench/accuracy/scene_free.py PLENOCAL OUT [--seeds 20] [--cases A-stereo,B-distances,...]

Each case simulates `--seeds` recordings of 40 frames, calibrates them with one thread, and prints
for f_L, b_L0, B of the plenoptic camera (f_x of an ordinary one) the root mean square and the
largest relative error, and the mean of (error / standard error)^2; then that of distances between
points at 2 m. docs/scene.md has the table.
"""
import collections
import math
import pathlib
import random
import statistics
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from common import load, save

# Main lens, micro-lens distance, B, m; near and far points, m.
OPTICS = {
    "A": ((0.016, 0.015254, 0.000378), 0.35, 3.0),
    "B": ((0.050, 0.056724, 0.000369), 0.29, 0.385),
    "C": ((0.035, 0.034252, 0.0003916), 0.8, 4.0),
}


def specification(optics, seed):
    lens, near, far = OPTICS[optics]
    f_L, b_L0, B = lens
    pinhole = {"model": "pinhole-radial3", "image_size": [1280, 1024], "blur": 0.6, "detection_sigma": 0.3}
    return {
        "seed": seed,
        "scene": {"points": 1000, "near": near, "far": far, "distances": 4, "distance_sigma": 0.0005},
        "trajectory": {"kind": "handheld", "frames": 40, "turn": 0.35, "roll": 0.8},
        "cameras": {
            "left": {
                **pinhole,
                "parameters": {"f_x": 820, "f_y": 822, "c_x": 632, "c_y": 518, "A_0": -0.21, "A_1": 0.07, "A_2": -0.012},
            },
            "right": {
                **pinhole,
                "parameters": {"f_x": 810, "f_y": 808, "c_x": 650, "c_y": 500, "A_0": -0.2, "A_1": 0.06, "A_2": -0.01},
                "xi_camera_rig": [-0.1, 0.001, -0.002, 0.005, -0.02, 0.01],
            },
            "plenoptic": {
                "model": "focused-plenoptic",
                "image_size": [1500, 1500],
                "pixel_size": 7.4e-6,
                "parameters": {
                    "f_L": f_L, "b_L0": b_L0, "B": B, "c_x": 752, "c_y": 747,
                    "A_0": -100, "A_1": 4e5, "B_0": 0.03, "B_1": -0.02,
                },
                "xi_camera_rig": [-0.05, 0.045, -0.008, -0.08, 0.01, 0.005],
                "blur": 0.35,
                "detection_sigma": 0.15,
                "micro_lenses": {"pitch": 19, "rotation": 0.006, "focus": [2.4, 3.0, 3.9], "aperture": 0.7, "fill": 0.92},
            },
        },
    }


def stereo_pair(folder):
    """The simulated calibration of the pair alone."""
    calibration = load(folder / "calibration.yaml")
    del calibration["cameras"]["plenoptic"]
    save(folder / "pair.yaml", calibration)


def session_of(case, folder):
    session = load(folder / "session.yaml")
    cameras = session["cameras"]
    if case == "stereo":
        stereo_pair(folder)
        del session["scene"]["distances"]
        session["from"] = "pair.yaml"
    if case == "distances":
        del cameras["left"], cameras["right"]
        session["scene"]["distances"] = measured_distances(folder)
    if case in ("ordinary", "ordinary-distances"):
        del cameras["right"], cameras["plenoptic"]
        if case == "ordinary":
            del session["scene"]["distances"]
    if case == "none":
        del cameras["left"], cameras["right"], session["scene"]["distances"]
    if case == "refocus":
        del cameras["left"], cameras["right"], session["scene"]["distances"]
        session["from"] = "earlier.yaml"
        cameras["plenoptic"]["free"] = ["b_L0"]
        earlier(folder)
    save(folder / "session.yaml", session)


def measured_distances(folder):
    """Four distances between the points that most frames of the plenoptic camera show."""
    frames = collections.defaultdict(set)
    for row in csv_rows(folder / "tracks_plenoptic.csv"):
        frames[int(row[1])].add(row[0])
    truth, errors = true_points(folder), random.Random(folder.name)
    best = [number for number in sorted(frames, key=lambda n: (-len(frames[n]), n)) if number in truth][:40]
    distances = []
    for _ in range(4):
        a = best.pop(0)
        b = max(best, key=lambda n: math.dist(truth[a], truth[n]))
        best.remove(b)
        value = math.dist(truth[a], truth[b]) + errors.gauss(0, 5e-4)
        distances.append({"between": [f"point {a}", f"point {b}"], "value": value, "sigma": 5e-4})
    return distances


def csv_rows(path):
    return [line.split(",") for line in path.read_text().splitlines()[1:]]


def true_points(folder):
    return {int(number): [float(x) for x in place] for number, *place in csv_rows(folder / "truth/points.csv")}


def earlier(folder):
    """A calibration of the plenoptic camera before refocusing, with standard errors as table A has them."""
    calibration = load(folder / "truth/calibration.yaml")
    camera = calibration["cameras"]["plenoptic"]
    errors = random.Random(folder.name)
    camera["parameters"]["b_L0"] -= 2e-4
    relative = {"f_L": 3e-4, "B": 5e-3}
    sigma = {name: 0.0 for name in camera["parameters"]}
    for name, part in relative.items():
        sigma[name] = part * camera["parameters"][name]
        camera["parameters"][name] += errors.gauss(0, sigma[name])
    for name in ("c_x", "c_y"):
        sigma[name] = 0.3
        camera["parameters"][name] += errors.gauss(0, 0.3)
    camera["sigma"] = sigma
    camera.pop("correlation", None)
    calibration["cameras"] = {"plenoptic": camera}
    camera["T_camera_rig"] = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    camera.pop("xi_camera_rig", None)
    save(folder / "earlier.yaml", calibration)


def points_of(path):
    lines = path.read_text().split("end_header\n")[1].split("\n")
    rows = [line.split() for line in lines if line]
    return {int(row[3]): [float(x) for x in row[:3]] for row in rows}


def distance_error(folder):
    """Median relative error of the distances between points and their neighbours in the list."""
    truth = true_points(folder)
    found = points_of(folder / "out" / "points.ply")
    common = [number for number in found if number in truth]
    pairs = zip(common, common[1:])
    return statistics.median(math.dist(found[a], found[b]) / math.dist(truth[a], truth[b]) for a, b in pairs) - 1


def run(arguments, optics, scale, seed):
    folder = arguments.out / f"{optics}-{scale}-{seed}"
    folder.mkdir(parents=True, exist_ok=True)
    common.simulate(arguments.program, folder, specification(optics, seed), "--points", out="")
    session_of(scale, folder)
    try:
        found = common.calibrate(arguments.program, folder / "session.yaml", folder / "out", "--threads", 1)["cameras"]
    except common.Failed as failure:
        print(failure, file=sys.stderr)
        return None
    truth = load(folder / "truth/calibration.yaml")["cameras"]
    name, params = ("left", ["f_x"]) if "ordinary" in scale else ("plenoptic", ["f_L", "b_L0", "B"])
    rows = {}
    for param in params:
        true, value = truth[name]["parameters"][param], found[name]["parameters"][param]
        rows[param] = ((value - true) / true, found[name]["sigma"][param] / true)
    if scale != "ordinary":  # which has no scale
        rows["distance"] = (distance_error(folder), float("nan"))
    return rows


def main():
    parser = common.parser(__doc__, "program")
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--seeds", type=int, default=20)
    cases = [f"{optics}-stereo" for optics in OPTICS] + ["A-distances", "A-ordinary", "A-refocus"]
    parser.add_argument("--cases", default=",".join(cases))
    arguments = parser.parse_args()
    common.head("case", "runs", "unknown", "RMS error %", "largest %", "mean sigma %", "(error/sigma)^2")
    for case in arguments.cases.split(","):
        optics, scale = case.split("-", 1)
        results = [run(arguments, optics, scale, seed) for seed in range(1, arguments.seeds + 1)]
        results = [result for result in results if result]
        for name in results[0] if results else []:
            errors, sigmas = zip(*(result[name] for result in results))
            squares = common.mean_square(error / sigma for error, sigma in zip(errors, sigmas))
            common.row(case, len(results), name, f"{100 * common.rms(errors):.3f}", f"{100 * max(map(abs, errors)):.3f}",
                       f"{100 * statistics.mean(sigmas):.3f}", f"{squares:.2f}")


if __name__ == "__main__":
    main()

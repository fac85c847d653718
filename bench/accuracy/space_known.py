# SPDX-License-Identifier: Apache-2.0
"""`bench/space PLENOCAL known`: sigma of z of calibrations with perfect intrinsics, or extrinsics, over what `accuracy` predicts for
them (`if_known`), by the calibration's part alone.

Simulated pairs; the perfect numbers are the true ones: intrinsics as fixed values, extrinsics as a prior of 1 nm and 1 nrad.
"""
import json
import pathlib
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common

RIGS, DISTANCES = 20, (0.6, 1.2, 3.0)
BOARD = "plenocal: 1\ntype: aprilgrid\ncolumns: 6\nrows: 6\nsize: 0.055\nspacing: 0.3\n"


def accuracy(plenocal, result):
    """By distance: sigma of z by the calibration, and if numbers were known."""
    done = common.run(plenocal, "accuracy", result, "--distances", ",".join(map(str, DISTANCES)), "--noise", "1e-9", "--json")
    return [(each["z"]["median"], each["if_known"]) for each in json.loads(done.stdout)[0]["distances"]]


def one_rig(plenocal, place, seed):
    random = np.random.default_rng(seed)
    (place / "target.yaml").write_text(BOARD)
    cameras = {}
    for name in ("left", "right"):
        f = float(random.uniform(600, 1100))
        parameters = {"f_x": f, "f_y": f * float(random.uniform(0.995, 1.005)), "c_x": 640 + float(random.uniform(-20, 20)),
                      "c_y": 480 + float(random.uniform(-20, 20)), "A_0": float(random.uniform(-0.25, -0.1)), "A_1": 0.03, "A_2": 0.0}
        cameras[name] = {"model": "pinhole-radial3", "image_size": [1280, 960], "parameters": parameters, "detection_sigma": 0.1}
    cameras["right"]["xi_camera_rig"] = [-0.12, *(float(v) for v in random.uniform(-0.03, 0.03, 5))]
    poses = {"kind": "varied", "frames": 25, "distance": [0.4, 1.2], "partial": 0.3}
    common.save(place / "set.yaml", {"plenocal": 1, "seed": seed, "target": "target.yaml", "poses": poses, "cameras": cameras})
    common.run(plenocal, "simulate", place / "set.yaml", "--points", "-o", place / "set", "--quiet")
    session = common.load(place / "set/session.yaml")

    def calibrated(name, changes, **more):
        own = {**session, **more, "cameras": {c: {**session["cameras"][c], **changes(c)} for c in cameras}}
        common.save(place / f"set/{name}.yaml", own)
        common.run(plenocal, "calibrate", place / f"set/{name}.yaml", "-o", place / name, "--no-report", "--quiet", statuses=(0, 1))
        return accuracy(plenocal, place / name)

    names = list(cameras["left"]["parameters"])
    truth = common.load(place / "set/truth/calibration.yaml")
    truth["cameras"]["right"]["sigma_xi"] = [1e-9] * 6
    common.save(place / "set/exact.yaml", truth)
    free = calibrated("free", lambda c: {})
    known = {"intrinsics": calibrated("intrinsics", lambda c: {"initial": cameras[c]["parameters"], "fixed": names}),
             "extrinsics": calibrated("extrinsics", lambda c: {"free": names}, **{"from": "exact.yaml"})}
    return {kind: [found[k][0] / free[k][1][kind] for k in range(len(DISTANCES))] for kind, found in known.items()}


def run(plenocal):
    ratios = {}
    for seed in range(RIGS):
        with common.folder() as place:
            for kind, found in one_rig(plenocal, place, seed).items():
                ratios.setdefault(kind, []).append(found)
    common.head("known", "distance", "rigs", "found / predicted: median", "least", "largest")
    for kind, found in ratios.items():
        for distance, column in zip(DISTANCES, np.array(found).T):
            common.row(kind, f"{distance:g} m", len(column), *(f"{value:.3f}" for value in (np.median(column), column.min(), column.max())))

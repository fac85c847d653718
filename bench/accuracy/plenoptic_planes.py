#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Planes of virtual depth of tags (`plenocal focus --markers`) and their sigmas, on simulated plenoptic cameras.

    bench/plenoptic_planes build/release/apps/plenocal

Prints, of the depths in the middle of all tags of a camera, (estimate - truth) / truth in the mean and RMS, the median of sigma and
the mean of (error / sigma)^2. Four minutes of CPU. Needs python3-numpy, python3-opencv, python3-yaml.
"""
import collections
import pathlib
import sys

import cv2
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common

EXAMPLE = common.ROOT / "examples/simulate"
CAMERAS = {  # of the camera, its parameters, its micro lenses
    "3 types, 19 px": ({}, {}, {}),
    "one type, 19 px": ({}, {}, dict(focus=[3.0])),
    "3 types, 24 px": ({}, dict(B=0.00036), dict(pitch=24)),
    "3 types, 14 px": ({}, dict(B=0.00019, c_x=400, c_y=400), dict(pitch=14)),
    "3 types, 26 px": (dict(image_size=[1100, 1100], pixel_size=5.5e-6), dict(c_x=550, c_y=550), dict(pitch=26)),
    "one type, blurred": (dict(blur=0.6), dict(c_x=400, c_y=400), dict(focus=[3.0])),
    "one type, 24 px": ({}, dict(B=0.00036), dict(pitch=24, focus=[3.0])),
}


def specification(number, camera, parameters, lenses):
    spec = common.load(EXAMPLE / "plenoptic_stereo.yaml")
    plenoptic = spec["cameras"]["plenoptic"]
    del plenoptic["xi_camera_rig"]  # the first camera is the rig
    plenoptic.update(camera)
    plenoptic["parameters"].update(parameters)
    plenoptic["micro_lenses"].update(lenses)
    spec.update(cameras={"plenoptic": plenoptic}, seed=71 + number)
    spec["poses"] = dict(kind="varied", frames=10, distance=[0.36, 0.7], partial=0.2)
    return spec


def exact_depth(rows):
    """Place in the virtual image and virtual depth of a marker that several micro images show, without noise."""
    c = np.array([[float(row["lens_x"]), float(row["lens_y"])] for row in rows])
    x = np.array([[float(row["x"]), float(row["y"])] for row in rows])
    d = c - c.mean(0)
    s = (d * (x - x.mean(0))).sum() / (d * d).sum()
    return np.append((x.mean(0) - s * c.mean(0)) / (1 - s), 1 / (1 - s))


def errors(folder):
    """Error and sigma of the depth in the middle of each tag, parts of the depth."""
    seen = collections.defaultdict(list)
    for row in common.read_table(folder / "set/truth/detections_plenoptic.csv"):
        seen[row["frame"], int(row["marker"])].append(row)
    for frame in sorted({frame for frame, _ in seen}):
        depth, sigma = (cv2.imread(str(folder / f"focused/{frame}/virtual_depth{name}.tiff"), -1) for name in ("", "_sigma"))
        for first in range(0, 128, 4):
            rows = [seen.get((frame, first + k), []) for k in range(4)]
            if min(map(len, rows)) < 3:
                continue
            corners = np.array([exact_depth(each) for each in rows])
            x, y = np.round(corners[:, :2].mean(0) / 2).astype(int)
            plane = np.linalg.lstsq(np.c_[corners[:, :2], np.ones(4)], corners[:, 2], rcond=None)[0]
            truth = plane @ (2 * x, 2 * y, 1)
            tag = np.zeros(depth.shape, np.uint8)
            corners[:, :2] += 0.2 * (corners[:, :2].mean(0) - corners[:, :2])
            cv2.fillConvexPoly(tag, np.round(corners[:, :2] / 2).astype(int), 1)
            at = np.argwhere(tag > 0) @ np.eye(2, 3) + (0, 0, 1)
            inside = depth[tag > 0]
            # Found as a part: its depth is exactly a plane.
            if len(inside) > 3 and np.abs(at @ np.linalg.lstsq(at, inside, rcond=None)[0] - inside).max() < 1e-4:
                yield depth[y, x] / truth - 1, sigma[y, x] / truth


def main():
    parser = common.parser(__doc__, "program")
    parser.add_argument("--only", choices=CAMERAS, nargs="+", default=CAMERAS)
    options = parser.parse_args()
    common.head("camera", "tags", "mean error, %", "RMS, %", "sigma, %", "mean (error / sigma)^2")
    for number, name in enumerate(CAMERAS):
        if name not in options.only:
            continue
        with common.folder() as folder:
            common.simulate(options.program, folder, specification(number, *CAMERAS[name]), target=common.load(EXAMPLE / "target.yaml"))
            common.run(options.program, "focus", folder / "set/plenoptic", "--white", folder / "set/plenoptic_white", "--markers",
                       folder / "set/target.yaml", "-o", folder / "focused")
            error, sigma = np.array(list(errors(folder))).T
        common.row(name, len(error), f"{100 * error.mean():.3f}", f"{100 * (error**2).mean()**0.5:.3f}", f"{100 * np.median(sigma):.3f}",
                   f"{((error / sigma)**2).mean():.2f}")


if __name__ == "__main__":
    main()

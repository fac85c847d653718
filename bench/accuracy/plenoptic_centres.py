#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Standard errors of plenoptic calibrations whose micro-image centres have errors, without images.

    bench/plenoptic_centres PLENOCAL OUT [--sets 100] [--noise 0 0.002 0.005]     # px

Cameras and points of `bench/plenoptic_nees --points`, with 0.014 px. The single centres of each array get noise of so many pixels, a
polynomial of degree 5 of the lattice coordinates is fitted to them, and its errors are added to the centres of the detections.
Calibrates without and with the covariance of these errors (`lattice_plenoptic.yaml`) and prints the mean of (error / sigma)^2 of each
parameter and NEES / n: chi-square of a camera's nine parameters over nine. 0 px: what the points' noise alone gives.
Needs python3-numba, python3-numpy, python3-opencv, python3-scipy, python3-yaml.
"""
import csv
import pathlib
import sys

import numpy as np
from scipy.spatial import cKDTree

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from accuracy.plenoptic_nees import NAMES, Optics, interval, write_points
from common import load, mean_square, save


def terms(places, degree=5):
    x, y = np.asarray(places, float).T
    return np.stack([x**(total - k) * y**k for total in range(degree + 1) for k in range(total + 1)], -1)


def displace(folder, seed, noise):
    """Adds the errors of a fitted lattice to the points in `folder`; the covariance of these errors as its file has it."""
    camera, random = Optics(seed, 0, False, False, points=True), np.random.default_rng([seed, 1])
    centres = camera.in_image(camera.centres)
    inside = ((centres > -0.5) & (centres < camera.size - 0.5)).all(axis=1)
    centres, nodes = centres[inside], np.array(list(camera.index), float)[inside]
    nodes = (nodes - nodes.mean(axis=0)) / np.abs(nodes).max()
    errors = terms(nodes) @ np.linalg.lstsq(terms(nodes), noise * random.normal(size=centres.shape), rcond=None)[0]
    of_image = terms((centres - (camera.size - 1) / 2) / (camera.size / 2))
    covariance = noise**2 * np.linalg.inv(of_image.T @ of_image)
    rows = common.read_table(folder / "points.csv")
    seen = np.array([[float(row["lens_x"]), float(row["lens_y"])] for row in rows])
    with open(folder / "moved.csv", "w", newline="") as file:
        table = csv.DictWriter(file, rows[0].keys())
        table.writeheader()
        for row, moved in zip(rows, seen + errors[cKDTree(centres).query(seen)[1]]):
            table.writerow(row | dict(lens_x=moved[0], lens_y=moved[1]))
    session = load(folder / "session.yaml")
    session["cameras"]["plenoptic"]["detections"] = "moved.csv"
    save(folder / "session.yaml", session)
    return dict(image_size=[camera.size] * 2, covariance=[[float(x) for x in row[:k + 1]] for k, row in enumerate(covariance)])


def main():
    parser = common.parser(__doc__, "program")
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--sets", type=int, default=100)
    parser.add_argument("--noise", type=float, nargs="+", default=[0, 0.002, 0.005])
    arguments = parser.parse_args()
    found = {(noise, name): [] for noise in arguments.noise for name in ("without", "with")}
    for seed in range(arguments.sets):
        folder = arguments.out / f"{seed:03}"
        folder.mkdir(parents=True, exist_ok=True)
        write_points(folder, seed, 0, noise=0.014)
        truth, lattice = load(folder / "truth.yaml"), folder / "lattice_plenoptic.yaml"
        for noise in arguments.noise:
            lattice.unlink(missing_ok=True)
            covariance = displace(folder, seed, noise)
            for name in ("without", "with"):
                if name == "with":
                    save(lattice, covariance)
                camera = common.calibrate(arguments.program, folder / "session.yaml", folder / name)["cameras"]["plenoptic"]
                found[noise, name].append(common.errors_in_sigmas(camera, truth))
    common.head("single centres, px", "covariance of the lattice", *NAMES, "NEES / n")
    for (noise, name), results in found.items():
        common.row(f"{noise:g}", name, *(f"{mean_square([z[key] for z, _ in results]):.2f}" for key in NAMES),
                   f"{np.mean([chi_square for _, chi_square in results]):.2f}")
    print("by chance in 99 %: a parameter {:.2f} to {:.2f}, NEES / n {:.2f} to {:.2f}".format(*interval(arguments.sets), *interval(9 * arguments.sets)))


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Photometric calibration of simulated cameras against their truth (docs/photometry.md).

    bench/accuracy/photometry.py PLENOCAL OUT [--views 100] [--size 1280x1024] [--seeds 10]

prints: the response of a sweep of 120 exposures (gamma 2.2 and a measured curve): RMS and largest
error from 5 to 250 in % of full scale, mean (error / sigma)^2, time; the vignetting of a wall sequence: RMS, mean
(error / sigma)^2, time and memory, against white images of the same camera; both of small
images with several seeds; images of one scene at ten exposures, corrected; and DSO's three files,
read here without Plenocal. Needs numpy and OpenCV's Python module.
"""
import pathlib
import sys

import cv2
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common

TAG = "plenocal: 1\ntype: apriltag\nfamily: tag36h11\ntags:\n  - {id: 0, corners: [[-0.1, -0.1, 0], [0.1, -0.1, 0], [0.1, 0.1, 0], [-0.1, 0.1, 0]]}\n"
GREYS = np.arange(256)


def measured_curve():
    """The mean of 201 measured responses (Grossberg and Nayar, "Modeling the Space of Camera Response Functions", 2004), as a polynomial
    that is within 0.2 % of full scale of it."""
    x = GREYS / 255
    return 255 * x * (0.20815 + x * (0.80825 + x * (-1.10689 + x * 1.09049)))


def camera(size, response):
    w, h = size
    f = 0.64 * w
    return (
        f"cameras:\n  left:\n    model: pinhole-radial3\n    image_size: [{w}, {h}]\n"
        f"    parameters: {{f_x: {f}, f_y: {f}, c_x: {0.494 * w}, c_y: {0.506 * h}, A_0: -0.21, A_1: 0.07, A_2: -0.012}}\n"
        f"    response: {response}\n"
        f"    vignetting: {{polynomial: [-0.25, -0.1], centre: [{0.515 * w}, {0.49 * h}], axes: [1, 0.95]}}\n"
    )


class Bench:
    def __init__(self, arguments):
        self.program, self.out = arguments.program, arguments.out
        self.out.mkdir(parents=True, exist_ok=True)
        (self.out / "tag.yaml").write_text(TAG)
        (self.out / "measured.txt").write_text(" ".join(f"{u:.9g}" for u in measured_curve()) + "\n")

    def simulate(self, name, seed, rest, size, response):
        spec = self.out / f"{name}.yaml"
        spec.write_text(f"plenocal: 1\nseed: {seed}\ntarget: tag.yaml\n{rest}{camera(size, response)}")
        common.run(self.program, "simulate", spec, "-o", self.out / name)
        return self.out / name

    def response(self, name, seed, size, response):
        sweep = self.simulate(
            name, seed,
            "wall: {contrast: 0.4, light: 0.5}\nwhite_images: 1\nexposures: {range: [0.1, 20], nominal: 5, order: sweep}\n"
            "poses: {kind: still, frames: 120, distance: [1.2, 1.2]}\n", size, response)
        _, seconds, user = common.timed(self.program, "response", sweep / "recording.yaml", "-o", sweep / "response")
        truth = np.loadtxt(sweep / "truth" / "pcalib_left.txt")
        rows = common.read_table(sweep / "response" / "response.csv")
        U = np.array([float(row["U"]) for row in rows])
        sigma = np.array([float(row["sigma"] or "nan") for row in rows])
        used = (GREYS >= 5) & (GREYS <= 250)
        weight = np.where(used & ~np.isnan(sigma), 1, 0)
        error = U * np.sum(weight * U * truth) / np.sum(weight * U * U) - truth
        ratio = np.nanmean((error[used] / sigma[used]) ** 2)
        print(f"response {name}: RMS {100 * np.sqrt(np.mean(error[used] ** 2)) / 255:.4f} %, largest {100 * np.abs(error[used]).max() / 255:.3f} % "
              f"of full scale, (error/sigma)^2 {ratio:.2f}; {seconds:.0f} s, {user:.0f} s of CPU", flush=True)
        return sweep, ratio

    def vignette(self, name, seed, size, response, views, curve=None, structure=0.004):
        wall = self.simulate(
            name, seed,
            f"wall: {{contrast: 0.25, light: 0.2, structure: {structure}}}\nwhite_images: 20\nexposures: {{range: [2, 5]}}\n"
            f"poses: {{frames: {views}, distance: [0.9, 1.6], tilt: 0.4, roll: 3.1, partial: 0}}\n", size, response)
        done, seconds, user = common.timed(
            "/usr/bin/time", "-f", "%M", self.program, "vignette", wall / "recording.yaml", "--target", self.out / "tag.yaml",
            "--response", curve or wall / "truth" / "pcalib_left.txt", "-o", wall / "vignette")
        truth = cv2.imread(str(wall / "truth" / "vignetting_left.tiff"), -1).astype(float)
        found = cv2.imread(str(wall / "vignette" / "vignetting_left.tiff"), -1).astype(float)
        sigma = cv2.imread(str(wall / "vignette" / "vignetting_sigma_left.tiff"), -1).astype(float)
        error = np.log(found / truth)
        error -= error.mean()
        rows = common.read_table(wall / "vignette" / "vignetting_compare.csv")
        ratio = np.array([float(row["ratio"]) for row in rows if row["section"] == "row"])
        ratio_sigma = np.array([float(row["sigma"]) for row in rows if row["section"] == "row"])
        kilobytes = int(done.stderr.split()[-1])
        print(f"vignetting {name}: {views} images of {size[0]} x {size[1]}: RMS {100 * np.sqrt(np.mean(error ** 2)):.3f} %, "
              f"largest {100 * np.abs(error).max():.2f} %, (error/sigma)^2 {np.mean((error / sigma) ** 2):.2f}; {seconds:.0f} s, "
              f"{user:.0f} s of CPU, {kilobytes / 1024:.0f} MB", flush=True)
        print("  " + " ".join(done.stdout.split("\n")[3].split()) + f"; middle row (difference/sigma)^2 {np.mean(((ratio - 1) / ratio_sigma) ** 2):.2f}", flush=True)
        return wall, np.mean((error / sigma) ** 2)

    def correct(self, sweep, wall):
        """Ten exposures of the sweep, by a factor of 5, corrected with the response and vignetting that were found."""
        U = np.loadtxt(sweep / "response" / "pcalib.txt")
        V = cv2.imread(str(wall / "vignette" / "vignette.png"), -1) / 65535
        times = [line.split() for line in open(sweep / "times_left.txt") if not line.startswith("#")]
        # Pixels are chosen by another image than the ten.
        chosen = cv2.imread(str(sweep / "left" / f"{times[82][0]}.png"), 0)
        used = (chosen > 120) & (chosen < 235)
        light = np.array([(U[cv2.imread(str(sweep / "left" / f"{name}.png"), 0)] / V / float(exposure))[used].mean()
                          for name, _, exposure in times[40:80:4]])
        levels = np.std(light / light.mean())
        print(f"ten exposures corrected: levels differ by {100 * levels:.3f} % RMS", flush=True)

    def read_dso(self, sweep, wall):
        """camera.txt, pcalib.txt and vignette.png as DSO's reader takes them."""
        text = (wall / "truth" / "calibration.yaml").read_text()
        folder = self.out / "dso"
        folder.mkdir(exist_ok=True)
        calibration = wall / "dso_calibration.yaml"
        calibration.write_text(text.replace("vignetting_left.tiff", str(wall / "vignette" / "vignetting_left.tiff")).replace("A_2: -0.012", "A_2: 0"))
        common.run(self.program, "export", calibration, "--format", "dso", "--camera", "left", "--response", sweep / "response" / "pcalib.txt", "-o", folder / "camera.txt")
        lines = (folder / "camera.txt").read_text().split("\n")
        values = [float(value) for value in lines[0].split()[1:]]
        G = np.loadtxt(folder / "pcalib.txt")
        V = cv2.imread(str(folder / "vignette.png"), cv2.IMREAD_UNCHANGED)
        assert lines[0].startswith("RadTan ") and len(values) == 8 and 0 < values[2] < 1
        assert G.shape == (256,) and (np.diff(G) > 0).all()
        assert V.dtype == np.uint16 and V.max() == 65535 and V.shape == tuple(int(x) for x in lines[1].split())[::-1]
        found = cv2.imread(str(wall / "vignette" / "vignetting_left.tiff"), -1)
        assert np.abs(V / 65535 - found).max() < 1e-5
        print(f"DSO: {lines[0].split()[0]} {lines[1]}, 256 rising values, vignette {V.shape[1]} x {V.shape[0]} of 16 bits: read back", flush=True)


def main():
    parser = common.parser(__doc__, "program")
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--views", type=int, default=100)
    parser.add_argument("--size", default="1280x1024")
    parser.add_argument("--seeds", type=int, default=10)
    arguments = parser.parse_args()
    size = tuple(int(part) for part in arguments.size.split("x"))
    bench = Bench(arguments)
    sweep, _ = bench.response("gamma_2.2", 7, size, "{gamma: 2.2}")
    bench.response("measured", 8, size, "{file: measured.txt}")
    wall, _ = bench.vignette("wall", 3, size, "{gamma: 2.2}", arguments.views, sweep / "response" / "pcalib.txt")
    bench.correct(sweep, wall)
    bench.read_dso(sweep, wall)
    seeds = range(1, arguments.seeds + 1)
    curve = "{file: measured.txt}"
    for what, ratios in (("responses", [bench.response(f"small_sweep_{seed}", seed, (320, 256), curve)[1] for seed in seeds]),
                         ("vignettings", [bench.vignette(f"small_{seed}", seed, (320, 256), curve, 40, structure=0.016)[1] for seed in seeds])):
        if ratios:
            print(f"mean (error/sigma)^2 of {len(ratios)} {what}: {np.mean(ratios):.2f}")


if __name__ == "__main__":
    main()

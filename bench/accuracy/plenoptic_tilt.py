#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tilted micro-lens arrays: is the tilt found, are its standard errors true, does `plenocal try` see it?

    bench/plenoptic_tilt PLENOCAL OUT [--seeds 20] [--tilts 0 0.3 0.8 2]     # mrad

Simulated detections (0.03 px noise, no images) of a focused plenoptic camera of 1400 x 1400 px in 18 frames before an AprilGrid;
the tilt's direction is drawn for each seed. Calibrates with focused-plenoptic-tilt and prints the largest |error| / sigma of the
two angles, the mean of (error / sigma)^2 of these and of all parameters, and how often `try` recommends a thick lens, which it is not,
and the tilted model. Calibrates with focused-plenoptic, too, and prints how often `array_tilted` is named and the largest relative
error of its angle.
"""
import math
import pathlib
import random
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from common import load, mean_square, save

MODEL = "focused-plenoptic-tilt"
NOISE_PX = 0.03


TARGET = {"type": "aprilgrid", "columns": 6, "rows": 6, "size": 0.024, "spacing": 0.3, "tolerance": 0.0003}


def specification(seed, tilt_mrad):
    rng = random.Random(f"{seed} {tilt_mrad}")
    direction = rng.uniform(0, 2 * math.pi)
    camera = {"model": MODEL, "image_size": [1400, 1400], "pixel_size": 5.5e-6, "detection_sigma": NOISE_PX,
              "parameters": {"f_L": 0.0161, "b_L0": 0.0154, "B": 0.00033, "c_x": 706, "c_y": 691, "A_0": -180.0, "A_1": 8e5, "B_0": 0.02,
                             "B_1": -0.03, "t_x": 1e-3 * tilt_mrad * math.cos(direction), "t_y": 1e-3 * tilt_mrad * math.sin(direction)},
              "micro_lenses": {"pitch": 23, "rotation": 0.01, "focus": [2.4, 3.1, 4.6]}}
    return {"seed": seed + 1, "poses": {"kind": "varied", "frames": 18, "distance": [0.3, 0.8], "partial": 0.3}, "cameras": {"plenoptic": camera}}


def angle_named(program, folder):
    """The angle of `array_tilted` on a calibration without the tilt, rad, in a list; empty where it is not named."""
    session = load(folder / "set/session.yaml")
    session["cameras"]["plenoptic"]["model"] = "focused-plenoptic"
    save(folder / "set/parallel.yaml", session)
    result = common.calibrate(program, folder / "set/parallel.yaml", folder / "parallel")
    return [finding["value"] for finding in result["verdict"]["findings"] if finding["code"] == "array_tilted"]


def main():
    parser = common.parser(__doc__, "program")
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--tilts", type=float, nargs="+", default=[0, 0.3, 0.8, 2])
    parser.add_argument("--no-try", action="store_true")
    arguments = parser.parse_args()
    print("tilt mrad  seeds  worst angle  mean square: angles  all parameters  try recommends thick  the tilt  array_tilted named  angle off")
    for tilt in arguments.tilts:
        angles, everything, chosen, named = [], [], [], []
        for seed in range(arguments.seeds):
            folder = arguments.out / f"{tilt:g}_{seed:02}"
            folder.mkdir(parents=True, exist_ok=True)
            common.simulate(arguments.program, folder, specification(seed, tilt), "--points", target=TARGET)
            camera = common.calibrate(arguments.program, folder / "set/session.yaml", folder / "result")["cameras"]["plenoptic"]
            truth = load(folder / "set/truth/calibration.yaml")["cameras"]["plenoptic"]
            z, _ = common.errors_in_sigmas(camera, truth)
            angles += [z["t_x"], z["t_y"]]
            everything += z.values()
            named += angle_named(arguments.program, folder)
            if not arguments.no_try:
                common.run(arguments.program, "try", folder / "set/session.yaml", "-o", folder / "try", "--models", "focused-plenoptic",
                    MODEL, "plenoptic-thick", "--quiet")
                chosen.append(load(folder / "try/try.yaml")["recommended"])
        thick, tilted = ["-" if arguments.no_try else chosen.count(model) for model in ("plenoptic-thick", MODEL)]
        print(f"{tilt:9g}  {arguments.seeds:5}  {max(map(abs, angles)):11.2f}  {mean_square(angles):19.2f}"
              f"  {mean_square(everything):14.2f}  {thick:>20}  {tilted:>8}  {len(named):18}"
              f"  {max((abs(1e3 * angle / tilt - 1) for angle in named if tilt > 0), default=0):9.1%}", flush=True)


if __name__ == "__main__":
    main()

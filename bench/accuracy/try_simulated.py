#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Does `plenocal try` find the model behind simulated detections?

    bench/try_simulated --program build/release/apps/plenocal        # 100 cases, each model in turn

Each case is a random camera of one model, its detections (0.05 px noise, 30 frames of 140 points) and `plenocal try` over all models. It counts
as right when the true model is recommended, or one that reproduces the true camera to 0.02 px at every pixel of the
image (`plenocal convert` of the truth; its largest error).
"""
import collections
import math
import pathlib
import random
import re
import shutil
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common

LIMIT_PX = 0.02
NOISE_PX = 0.05
SIZE = [640, 480]

TARGET = {"type": "chessboard", "columns": 14, "rows": 10, "square": 0.03}


def camera(model, rng):
    """Parameters of a plausible lens."""
    u = rng.uniform
    focal = {"pinhole": u(350, 800), "pinhole-radial3": u(330, 600), "pinhole-radtan4": u(330, 600),
             "pinhole-radtan": u(330, 600), "pinhole-radtan8": u(330, 600), "pinhole-radtan12": u(330, 600),
             "kannala-brandt4": u(180, 260), "fov": u(230, 320), "ucm": u(200, 320), "eucm": u(200, 300),
             "double-sphere": u(170, 260), "division": u(230, 330), "spherical": u(170, 230),
             "splined": u(200, 260)}[model]
    parameters = {"f_x": focal, "f_y": focal * u(0.98, 1.02), "c_x": 319.5 + u(-12, 12), "c_y": 239.5 + u(-12, 12)}
    if model == "pinhole-radial3":
        parameters |= {"A_0": u(-0.3, -0.1), "A_1": u(0.03, 0.12), "A_2": u(-0.03, 0)}
    if model.startswith("pinhole-radtan"):
        parameters |= {"k_1": u(-0.3, -0.1), "k_2": u(0.03, 0.12), "p_1": u(-2e-3, 2e-3), "p_2": u(-2e-3, 2e-3)}
    if model == "pinhole-radtan":
        parameters |= {"k_3": u(-0.03, 0)}
    if model in ("pinhole-radtan8", "pinhole-radtan12"):
        parameters |= {"k_1": u(0.2, 0.6), "k_2": u(0, 0.1), "k_3": u(0, 0.01),
                       "k_4": u(0.5, 0.9), "k_5": u(0.05, 0.2), "k_6": u(0, 0.02)}
    if model == "pinhole-radtan12":
        parameters |= {f"s_{i}": u(-4e-3, 4e-3) for i in range(1, 5)}
    if model == "kannala-brandt4":
        parameters |= {"k_1": u(-0.05, 0.05), "k_2": u(-0.02, 0.02), "k_3": u(-0.005, 0.005), "k_4": u(-0.001, 0.001)}
    if model == "fov":
        parameters |= {"omega": u(0.7, 1.1)}
    if model in ("ucm", "eucm"):
        parameters |= {"alpha": u(0.4, 0.7)}
    if model == "eucm":
        parameters |= {"beta": u(0.8, 1.4)}
    if model == "double-sphere":
        parameters |= {"xi": u(-0.3, 0.2), "alpha": u(0.5, 0.65)}
    if model == "division":
        parameters |= {"lambda": u(-0.3, -0.1)}
    if model == "spherical":
        parameters["c_x"] = 319.5  # only turns the camera
    if model == "splined":
        parameters |= spline(focal, rng)
    return parameters


def spline(focal, rng, columns=11, rows=9):
    """A stereographic lens with a radial stretch and an unevenness of about a pixel, knots beyond the image's corners."""
    edge = 1.1 * max(SIZE[0] / 2 / focal, SIZE[1] / 2 / focal * (columns - 3) / (rows - 3))
    values = {"fov": math.ceil(math.degrees(4 * math.atan(edge / 2)))}
    pitch = 4 * math.tan(math.radians(values["fov"]) / 4) / (columns - 3)
    stretch = rng.uniform(-0.05, 0.05)
    for b in range(rows):
        for a in range(columns):
            u = [(a - (columns - 1) / 2) * pitch, (b - (rows - 1) / 2) * pitch]
            radial = stretch * (u[0] ** 2 + u[1] ** 2)
            for axis, place in zip("xy", u):
                values[f"{axis}_{a:02}_{b:02}"] = radial * place + rng.gauss(0, 1 / focal)
    return values


def run(*command):
    return common.run(*command, statuses=common.ANY_STATUS)


def simulate(program, model, rng, folder):
    """Writes folder/set; cameras whose image folds inside are drawn again."""
    while True:
        spec = {"seed": rng.randrange(1 << 30), "target_error": 0,
                "cameras": {"camera": {"model": model, "image_size": SIZE, "parameters": camera(model, rng),
                                       "detection_sigma": NOISE_PX}},
                "poses": {"frames": 30, "distance": [0.18, 0.45], "partial": 0.3}}
        try:
            common.simulate(program, folder, spec, "--points", target=TARGET)
        except common.Failed:
            continue
        # The whole image must belong to the model, else there is nothing to reproduce.
        same = run(program, "convert", folder / "set/truth/calibration.yaml", "--to", model, "-o", folder / "same")
        if same.returncode == 0 and "images nothing" not in same.stdout:
            if len(common.read_table(folder / "same/conversion_errors.csv")) == 41 * 31:
                return


def largest_error(program, folder, model):
    """Of the best camera of `model` against the truth over the image, px."""
    done = run(program, "convert", folder / "set/truth/calibration.yaml", "--to", model, "-o", folder / "converted")
    found = re.search(r"at most ([\d.e+-]+) px", done.stdout)
    return float(found.group(1)) if found and "images nothing" not in done.stdout else float("inf")


def main():
    parser = common.parser(__doc__)
    parser.add_argument("--cases", default=100, type=int)
    parser.add_argument("--seed", default=1, type=int)
    parser.add_argument("--threads", default=0, type=int, help="of plenocal (default: all cores)")
    parser.add_argument("--keep", type=pathlib.Path, help="folder that keeps the cases that are wrong")
    options = parser.parse_args()
    program = options.program
    threads = ["--threads", options.threads] if options.threads else []

    listing = run(program, "models").stdout
    models = [name for name in re.findall(r"^([a-z][\w-]+)", listing, re.M) if "plenoptic" not in name]
    right, by_model = 0, collections.defaultdict(list)
    for case in range(options.cases):
        model = models[case % len(models)]
        rng = random.Random(f"{options.seed} {case}")
        with common.folder() as folder:
            simulate(program, model, rng, folder)
            done = run(program, "try", folder / "set/session.yaml", "-o", folder / "out", "--quiet", *threads)
            if done.returncode != 0:
                recommended, error = done.stderr.strip(), float("inf")
            else:
                recommended = common.load(folder / "out/try.yaml")["recommended"]
                error = 0 if recommended == model else largest_error(program, folder, recommended)
            good = error <= LIMIT_PX
            right += good
            by_model[model].append(good)
            print(f"{case:3d} {model:18} -> {recommended:18} {error:9.4f} px {'' if good else 'WRONG'}", flush=True)
            if not good:
                print(done.stdout, flush=True)
                if options.keep:
                    shutil.copytree(folder, options.keep / str(case), dirs_exist_ok=True)
    for model, results in sorted(by_model.items()):
        print(f"{model:18} {sum(results)} of {len(results)}")
    print(f"right: {right} of {options.cases}")
    sys.exit(0 if right >= 0.95 * options.cases else 1)


if __name__ == "__main__":
    main()

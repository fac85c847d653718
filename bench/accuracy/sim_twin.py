#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Simulates the geometry of sim_small (docs/data.md), which another program has rendered, calibrates both sets and compares
residuals and sigmas.

    bench/sim_twin PLENOCAL $PLENOCAL_DATA/sim_small OUT [--sampling-noise] [--seeds 20]

The images of sim_small are means of random samples a pixel, blurred afterwards, which leaves noise at edges; Plenocal's
renderer has none. With --sampling-noise the simulated images are made in the same way, and as dark as those of sim_small.
With --seeds: so many twins with other noise; prints errors of each camera's parameters, NEES / n as
plenoptic_nees has it, in place of the comparison.
Needs python3-numpy, python3-opencv, python3-scipy, python3-yaml.
"""
import pathlib
import shutil
import sys

import cv2
import numpy as np
from scipy.stats import chi2

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from accuracy.geometry import plenoptic_undistorted
from common import load

# Of each camera: blur and electrons as SOURCE.md has them; independent samples a pixel that leave the noise measured at
# edges (docs/simulate.md); width of the neighbourhood in which a pixel's samples find the brightest and the darkest.
CAMERAS = {"left": (0.7, 12000, 10, 64, 3), "right": (0.7, 12000, 10, 64, 3), "plenoptic": (0.35, 10000, 8, 150, 7)}


def read_centres(path):
    return np.array([[float(row["x"]), float(row["y"])] for row in common.read_table(path)])


def lattice(path, camera):
    """Pitch, rotation and offset from the principal point of a hexagonal array of micro-image centres."""
    centres = read_centres(path)
    middle = np.array([camera["parameters"][key] for key in ("c_x", "c_y")])
    near = plenoptic_undistorted((centres - middle) * camera["pixel_size"], camera["parameters"]) / camera["pixel_size"]
    origin = near[np.argmin(np.hypot(*near.T))]
    steps = near - origin
    lengths = np.hypot(*steps.T)
    around = steps[(lengths > 0) & (lengths < 1.3 * np.sort(lengths)[1])]
    angles = np.arctan2(around[:, 1], around[:, 0])
    basis = np.array([around[np.argmin(np.abs(angles))], around[np.argmin(np.abs(angles - np.pi / 3))]])
    for _ in range(3):
        index = np.rint(np.linalg.solve(basis.T, (near - origin).T)).T
        fit = np.linalg.lstsq(np.c_[index, np.ones(len(index))], near, rcond=None)[0]
        basis, origin = fit[:2], fit[2]
    pitch = np.hypot(*basis.T).mean()
    return float(pitch), float(np.arctan2(basis[0, 1], basis[0, 0])), [float(v) for v in origin]


def specification(data, sampling_noise, seed):
    """What SOURCE.md and truth/ of sim_small say, as a specification of `plenocal simulate`."""
    truth = load(data / "truth/calibration.yaml")["cameras"]
    cameras = {}
    for name, camera in truth.items():
        keys = ("model", "image_size", "pixel_size", "parameters", "xi_camera_rig")
        cameras[name] = {key: camera[key] for key in keys if key in camera}
    for name, (blur, full_well, read_noise, _, _) in CAMERAS.items():
        if sampling_noise:  # all of it comes later
            cameras[name].update(blur=0, full_well=1e9, read_noise=0, bits=16, exposure=0.7)
        else:
            cameras[name].update(blur=blur, full_well=full_well, read_noise=read_noise)
    plenoptic = cameras["plenoptic"]
    pitch, rotation, offset = lattice(data / "truth/micro_lenses_plenoptic.csv", plenoptic)
    # The set's SOURCE.md names virtual depths by micro-lens centres; docs/plenoptic.md has the conversion.
    b_L0, B = (plenoptic["parameters"][key] for key in ("b_L0", "B"))
    focus = [1 / (1 - b_L0 / (b_L0 + B) * (1 - 1 / v)) for v in (2.5, 3.2, 4.4)]
    plenoptic["micro_lenses"] = {"pitch": pitch, "rotation": rotation, "offset": offset, "focus": focus, "aperture": 0.7,
                                 "fill": 0.91, "gain_sigma": 0.008, "dull": 3}
    return {"seed": seed, "target": "target.yaml", "target_error": 0, "poses": {"file": "poses.csv"},
            "white_images": 10, "cameras": cameras}


def add_sampling_noise(folder, seed):
    """Sampling noise, blur, shot and read noise for sharp images without noise; white images have even samples."""
    random = np.random.default_rng(seed)

    def read(path):
        return cv2.imread(str(path), cv2.IMREAD_UNCHANGED) / 257

    for name, (blur, full_well, read_noise, samples, width) in CAMERAS.items():
        whites = sorted((folder / f"{name}_white").glob("*.png"))
        white = np.maximum(np.mean([read(path) for path in whites], axis=0), 1)
        around = np.ones((width, width))
        for path in whites + sorted((folder / name).glob("*.png")):
            sharp = read(path) / white
            variance = (cv2.dilate(sharp, around) - sharp) * (sharp - cv2.erode(sharp, around)) / samples
            image = white * (sharp + random.normal(size=sharp.shape) * np.sqrt(variance))
            image = cv2.GaussianBlur(image, (0, 0), blur)
            grays = 255 / full_well  # an electron
            image += random.normal(size=sharp.shape) * np.sqrt(np.maximum(image, 0) * grays + (read_noise * grays) ** 2)
            cv2.imwrite(str(path), np.clip(np.rint(image), 0, 255).astype(np.uint8))


def print_edge_noise(folder, data):
    """Noise of sim_small's plenoptic images where tags have edges, against the same images without noise in `folder`."""
    random_samples = []  # share of white, grays^2 of noise, of light and reading alone, of one random sample a pixel
    white = np.mean([cv2.imread(str(path), 0) for path in sorted((data / "plenoptic_white").glob("*.png"))], axis=0)
    even = np.mean([cv2.imread(str(path), -1) for path in sorted((folder / "plenoptic_white").glob("*.png"))], axis=0)
    _, full_well, read_noise, _, _ = CAMERAS["plenoptic"]
    grays = 255 / full_well
    centres = read_centres(data / "truth/micro_lenses_plenoptic.csv")
    inside = np.hypot(*np.mgrid[-6:7, -6:7]) < 6
    for path in sorted((data / "plenoptic").glob("*.png")):
        seen = cv2.imread(str(path), 0).astype(float)
        exact = cv2.GaussianBlur(cv2.imread(str(folder / "plenoptic" / path.name), -1) / np.maximum(even, 1), (0, 0), 0.35)
        flat = cv2.dilate(exact, np.ones((3, 3))) - cv2.erode(exact, np.ones((3, 3))) < 0.2
        board = flat & (exact > 0.1) & (exact < 0.85)  # its spots are not those of sim_small
        for x, y in centres:
            window = np.s_[round(y) - 6:round(y) + 7, round(x) - 6:round(x) + 7]
            if exact[window].shape != inside.shape or board[window].any() or np.ptp(exact[window][inside]) < 0.6:
                continue
            e, w, s = exact[window][inside], white[window][inside], seen[window][inside]
            design = np.c_[w, e * w]
            fit = np.linalg.lstsq(design, s, rcond=None)[0]
            share = (e - 0.03) / 0.94
            light = np.maximum(s, 0) * grays + (read_noise * grays) ** 2 + 1 / 12
            random_samples.append(np.stack([share, (s - design @ fit) ** 2, light, (0.94 * fit[1] * w) ** 2 * share * (1 - share)]))
    share, noise, light, sample = np.concatenate(random_samples, axis=1)
    print("share of white   pixels   noise   light and reading   grays^2; samples a pixel that leave the difference")
    for low, high in ((0.1, 0.2), (0.2, 0.35), (0.35, 0.65), (0.65, 0.8), (0.8, 0.9)):
        of = (share > low) & (share < high)
        left = np.median(noise[of]) / 0.455 - light[of].mean()  # 0.455: median of a squared normal variable
        print(f"{low:5.2f} to {high:4.2f} {of.sum():11} {np.median(noise[of]) / 0.455:8.1f} {light[of].mean():12.1f} {sample[of].mean() / left:23.0f}")


def write_twin(program, data, folder, sampling_noise, seed, report):
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(data / "truth/target.yaml", folder)
    shutil.copy(data / "truth/poses.csv", folder)
    shutil.rmtree(folder / "set", ignore_errors=True)
    common.simulate(program, folder, specification(data, sampling_noise, seed))
    shutil.copy(data / "target.yaml", folder / "set")  # where the tags really are is not for the calibration
    if sampling_noise:
        if report:
            print_edge_noise(folder / "set", data)
        add_sampling_noise(folder / "set", seed)


def compare_residuals(twin, independent):
    print(f"{'':24}{'simulate':>12}{'sim_small':>12}{'ratio':>8}")
    for name, camera in twin.items():
        other = independent[name]
        rows = [(key, camera["residuals"][key], other["residuals"][key])
                for key in ("points", "rejected", "rms", "noise", "detector_sigma")]
        rows += [(f"sigma {key}", camera["sigma"][key], other["sigma"][key]) for key in camera["sigma"]]
        for key, a, b in rows:
            print(f"{name + ' ' + key:24}{a:12.4g}{b:12.4g}{a / b if b else float('nan'):8.2f}")


def main():
    parser = common.parser(__doc__, "program")
    parser.add_argument("sim_small", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--sampling-noise", action="store_true")
    parser.add_argument("--seeds", type=int, default=0)
    arguments = parser.parse_args()
    program, data, out = arguments.program, arguments.sim_small, arguments.out
    if arguments.seeds == 0:
        write_twin(program, data, out, arguments.sampling_noise, 11, report=True)
        compare_residuals(*(common.calibrate(program, session, out / name)["cameras"]
                            for session, name in ((out / "set/session.yaml", "twin"), (data / "session.yaml", "sim_small"))))
        return
    truth = load(data / "truth/calibration.yaml")["cameras"]
    chi_squares = {name: [] for name in truth}
    for seed in range(1, arguments.seeds + 1):
        folder = out / f"{seed:02}"
        write_twin(program, data, folder, arguments.sampling_noise, seed, report=False)
        for name, camera in common.calibrate(program, folder / "set/session.yaml", folder / "twin")["cameras"].items():
            z, chi_square = common.errors_in_sigmas(camera, truth[name])
            chi_squares[name].append(chi_square * len(z))
            print(f"{seed:3} {name:10} NEES / n {chi_square:5.2f} " + "".join(f" {key} {value:.2f}" for key, value in z.items()), flush=True)
    for name, values in chi_squares.items():
        n = len(values) * len(truth[name]["parameters"])
        low, high = chi2.ppf([0.005, 0.995], n) / n
        print(f"{name:10} NEES / n {sum(values) / n:.2f}, 99 % interval {low:.2f} to {high:.2f}")


if __name__ == "__main__":
    main()

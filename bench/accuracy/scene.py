#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Is the covariance of `groundtruth` true, and what does it cost?

    bench/scene --program build/release/apps/plenocal               # 50 seeds of each case
    bench/scene --program build/release/apps/plenocal --seeds 5 --cases clean
    bench/scene --program build/release/apps/plenocal --images --seeds 20   # from rendered images of textured walls
    bench/scene --program build/release/apps/plenocal --two         # truth of the pair against that of a plenoptic camera
    bench/scene --program build/release/apps/plenocal --load        # 2 x 500 frames, 20,000 points

A stereo pair of 755 px and 0.1 m on a loop of 100 m, scene at 2 to 6 m, image noise 0.3 px, 2 x 200 frames, tracks without
images. For each case: NEES / 7 of the end segment's similarity against the start segment's (translation, rotation, scale;
1 for a true covariance), the largest single error of these seven numbers over all seeds in its sigmas, the error of the
scale (root mean square) and the mean of its stated sigma, and the same ratio squared. Prints a Markdown table.
With --images: the same of 2 x 25 stereo pairs of 640 x 480 px (bench/accuracy/walls.py), with a random calibration of its stated sigmas.
With --two: the same of `compare A/groundtruth.yaml B/groundtruth.yaml`, A of the pair, B of a plenoptic camera (16 mm) alone.
Needs python3-numpy and python3-yaml.
"""
import concurrent.futures
import pathlib
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from accuracy import walls
from accuracy.geometry import exp_rotation, numbers, read_trajectory, transform

CAMERA = """    model: pinhole-radial3
    image_size: [1280, 1024]
    parameters: {f_x: 755, f_y: 755, c_x: 640, c_y: 512, A_0: -0.2, A_1: 0.06, A_2: -0.01}
    detection_sigma: 0.3
"""
SPECIFICATION = """plenocal: 1
seed: {seed}
scene: {{points: {points}, near: 2, far: 6, wrong_matches: {wrong_matches}, moving: {moving}}}
trajectory: {{kind: loop, length: 100, frames: {frames}}}
cameras:
  left:
{camera}  right:
{camera}    xi_camera_rig: [-0.1, 0, 0, 0, 0, 0]
"""
PLENOPTIC = """  plenoptic:
    model: focused-plenoptic
    image_size: [1500, 1500]
    pixel_size: 7.4e-6
    parameters: {f_L: 0.016, b_L0: 0.015254, B: 0.000378, c_x: 752, c_y: 747, A_0: -100, A_1: 4e5, B_0: 0.03, B_1: -0.02}
    xi_camera_rig: [-0.05, 0.045, -0.008, -0.08, 0.01, 0.005]
    blur: 0.35
    detection_sigma: 0.15
    micro_lenses: {pitch: 19, rotation: 0.006, focus: [2.4, 3.0, 3.9], aperture: 0.7, fill: 0.92}
"""
CASES = {
    "clean": {},
    "10 % wrong matches, 20 % moving points": {"wrong_matches": 0.1, "moving": 0.2},
    "vergence 2 sigma off": {"off": 2.0},
    "the same, calibration fixed": {"off": 2.0, "held": True},
}
VERGENCE = 4  # component of xi_camera_rig


def effect(p, centre):
    """Rows by [translation, rotation, scale] of a small similarity about `centre`."""
    d = p - centre
    hat = np.array([[0, -d[2], d[1]], [d[2], 0, -d[0]], [-d[1], d[0], 0]])
    return np.hstack([np.eye(3), -hat, d[:, None]])


def fit(positions, changes, centre):
    rows = np.vstack([effect(p, centre) for p in positions])
    return np.linalg.lstsq(rows, changes.ravel(), rcond=None)[0]


def disturb(path, off, held):
    """Moves the vergence by `off` sigmas from the truth, else exact; `held`: states no standard errors."""
    calibration, truth = common.load(path), common.load(path.parent / "truth/calibration.yaml")
    for name, camera in calibration["cameras"].items():
        exact = truth["cameras"][name]
        camera["parameters"] = exact["parameters"]
        xi = numbers(exact["xi_camera_rig"])
        xi[VERGENCE] += off * float(camera["sigma_xi"][VERGENCE])
        T = transform(exp_rotation(xi[3:]), xi[:3])  # that of Exp to first order in the rotation, which is below 0.1 mrad
        camera["T_camera_rig"], camera["xi_camera_rig"] = T.tolist(), xi.tolist()
        if held:
            camera["sigma"] = {key: 0 for key in camera["sigma"]}
            camera["sigma_xi"] = [0] * 6
    common.save(path, calibration)


class NoResult(Exception):
    """The program has refused the recording."""


def run(program, arguments, folder):
    done = common.run(program, *arguments, "--quiet", "--threads", 1, cwd=folder, statuses=(0, 1))
    if done.returncode == 1:
        raise NoResult(done.stderr)


def compare(folder):
    """Seven errors of end against start with their covariance, error and sigma of the scale."""
    stated = common.load(folder / "out/groundtruth.yaml")
    covariance = stated["segment_covariance"]
    C = np.array(covariance["matrix"])
    relative = C[:7, :7] + C[7:, 7:] - C[:7, 7:] - C[7:, :7]
    times, p, _ = read_trajectory(folder / "out/segments_left.txt")
    true_times, true_p, true_R = read_trajectory(folder / "recording/truth/segments_left.txt")
    at = [int(np.argmin(abs(true_times - t))) for t in times]
    # The truth in the frame of the first rig pose.
    first = at[0]
    true_p = (true_p[at] - true_p[first]) @ true_R[first]
    start = slice(0, stated["segments"]["start"]["frames"])
    end = slice(start.stop, None)
    changes = p - true_p
    d_start = fit(true_p[start], changes[start], np.array(covariance["start_centre"]))
    d_end = fit(true_p[end], changes[end], np.array(covariance["end_centre"]))
    scale = fit(true_p, changes, true_p.mean(axis=0))[6]
    return d_end - d_start, relative, scale, stated["scale"]["sigma"]


def measure(job):
    program, seed, points, frames, case = job
    case = dict(case)
    off, held = case.pop("off", None), case.pop("held", False)
    with common.folder() as folder:
        (folder / "loop.yaml").write_text(SPECIFICATION.format(
            seed=seed, points=points, frames=frames, camera=CAMERA, **{"wrong_matches": 0, "moving": 0, **case}))
        run(program, ["simulate", "loop.yaml", "--points", "-o", "recording"], folder)
        if off is not None:
            disturb(folder / "recording/calibration.yaml", off, held)
        return estimate(program, seed, folder)


def estimate(program, seed, folder):
    try:
        run(program, ["groundtruth", "recording", "-o", "out"], folder)
    except NoResult as refusal:
        print(f"seed {seed}: {refusal}", file=sys.stderr)
        return None
    return compare(folder)


def measure_images(job):
    program, seed = job
    with common.folder() as folder:
        walls.write_recording(folder / "recording", seed)
        return estimate(program, seed, folder)


def row(name, all_results):
    results = [result for result in all_results if result is not None]
    nees = np.array([d @ np.linalg.solve(C, d) for d, C, _, _ in results]) / 7
    sigmas = np.array([d / np.sqrt(np.diag(C)) for d, C, _, _ in results])
    scale = np.array([s for _, _, s, _ in results])
    stated = np.array([s for _, _, _, s in results])
    spread = nees.std(ddof=1) / np.sqrt(len(nees)) if len(nees) > 1 else np.nan
    return (f"| {name} | {len(nees)} of {len(all_results)} | {nees.mean():.2f} +- {spread:.2f} | {abs(sigmas).max():.1f} | "
            f"{100 * np.sqrt((scale**2).mean()):.3f} % | {100 * stated.mean():.3f} % | {((scale / stated)**2).mean():.2f} |")


def measure_two(job):
    """chi-square / 7 of the ends and the squared ratio of the scales' difference to its sigma."""
    program, seed, points, frames = job
    with common.folder() as folder:
        (folder / "loop.yaml").write_text(SPECIFICATION.format(
            seed=seed, points=points, frames=frames, camera=CAMERA, wrong_matches=0, moving=0) + PLENOPTIC)
        run(program, ["simulate", "loop.yaml", "--points", "-o", "recording"], folder)
        try:
            run(program, ["groundtruth", "recording", "--cameras", "left,right", "-o", "a"], folder)
            run(program, ["groundtruth", "recording", "--cameras", "plenoptic", "-o", "b"], folder)
        except NoResult as refusal:
            print(f"seed {seed}: {refusal}", file=sys.stderr)
            return None
        done = common.run(program, "compare", "a/groundtruth.yaml", "b/groundtruth.yaml", "-o", "compared", cwd=folder)
        chi_square = float(done.stdout.split("chi-square ")[1].split()[0])
        _, difference, sigma, _ = (folder / "compared/groundtruth_compare.csv").read_text().split("\n")[8].split(",")
        return chi_square / 7, float(difference), float(sigma)


def two_truths(program, seeds, points, frames, pool):
    results = [r for r in pool.map(measure_two, [(program, seed, points, frames) for seed in range(1, seeds + 1)]) if r]
    chi_square, scale, sigma = np.array(results).T
    print(f"{len(results)} of {seeds} loops: chi-square / 7 {chi_square.mean():.2f} +- "
          f"{chi_square.std(ddof=1) / np.sqrt(len(results)):.2f}, largest {chi_square.max():.2f}; scales apart by "
          f"{100 * np.sqrt((scale**2).mean()):.2f} %, sigma {100 * sigma.mean():.2f} %, squared ratio {((scale / sigma)**2).mean():.2f}")


def thin(path, frames, seed=1):
    """Leaves of each point those observations that are in `frames` frames of each segment."""
    header, *lines = path.read_text().split("\n")
    rows = [(int(frame), int(number), line) for line in lines if line for frame, number in [line.split(",")[:2]]]
    times = sorted({frame for frame, _, _ in rows})
    index = {time: i for i, time in enumerate(times)}
    half = len(times) // 2
    # The same run of frames in all cameras.
    first = lambda number, segment: (number * 7919 + segment * 104729 + seed) % (half + frames - 1) - frames + 1
    kept = [line for frame, number, line in rows
            if 0 <= index[frame] % half - first(number, index[frame] // half) < frames]
    path.write_text("\n".join([header, *kept]) + "\n")
    return len(kept)


def load(program):
    """Time and memory of 2 x 500 frames, 20,000 points and some 800,000 observations."""
    with common.folder() as folder:
        (folder / "loop.yaml").write_text(SPECIFICATION.format(
            seed=1, points=20000, frames=500, camera=CAMERA, wrong_matches=0, moving=0))
        run(program, ["simulate", "loop.yaml", "--points", "-o", "recording"], folder)
        print(sum(thin(folder / f"recording/tracks_{camera}.csv", 40) for camera in ("left", "right")), "observations")
        _, wall, cpu = common.timed(program, "groundtruth", "recording", "-o", "out", "--threads", 2, cwd=folder)
        print(f"{wall:.0f} s, {cpu:.0f} s of CPU, {common.peak_megabytes():.0f} MB")


def main():
    parser = common.parser(__doc__)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--points", type=int, default=250)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--images", action="store_true")
    parser.add_argument("--two", action="store_true")
    parser.add_argument("--load", action="store_true")
    arguments = parser.parse_args()
    program = arguments.program
    if arguments.load:
        return load(program)
    if arguments.two:
        with concurrent.futures.ProcessPoolExecutor(arguments.jobs) as pool:
            return two_truths(program, arguments.seeds, arguments.points, arguments.frames, pool)
    common.head("case", "runs with a result", "NEES / 7", "largest error, sigmas", "error of the scale", "its sigma", "squared ratio")
    with concurrent.futures.ProcessPoolExecutor(arguments.jobs) as pool:
        if arguments.images:
            jobs = [(program, seed) for seed in range(1, arguments.seeds + 1)]
            print(row("textured walls", list(pool.map(measure_images, jobs))))
            return
        for name in arguments.cases:
            jobs = [(program, seed, arguments.points, arguments.frames, CASES[name])
                    for seed in range(1, arguments.seeds + 1)]
            print(row(name, list(pool.map(measure, jobs))), flush=True)


if __name__ == "__main__":
    main()

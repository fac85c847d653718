#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""`groundtruth` and COLMAP's sparse pipeline on the same rendered loop: time, memory, drift from start to end.

    bench/speed/scene_colmap.py --program build/release/apps/plenocal OUT [--frames 30] [--features 8192]

Renders 2 x `--frames` stereo frames of 1280 x 1024 px (8 s of CPU an image) unless OUT has them. COLMAP (3.8, Debian's, without
a GPU) gets the true parameters and holds them, and the pairs of images that can match: left with right, five neighbours in
time, every fifth frame of the start with every fifth of the end. Prints CPU time and memory of each step and
how far the end segment's path is off where the start segments coincide (alignment with scale). Needs python3-numpy, colmap.
"""
import os
import pathlib
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from accuracy.geometry import rotation_of

SPECIFICATION = """plenocal: 1
seed: 3
scene: {{points: 1000, near: 2, far: 6}}
trajectory: {{kind: loop, length: 100, frames: {frames}}}
cameras:
  left:
    model: pinhole-radial3
    image_size: [1280, 1024]
    parameters: {{f_x: 755, f_y: 755, c_x: 640, c_y: 512, A_0: -0.2, A_1: 0.06, A_2: -0.01}}
    blur: 0.6
  right:
    model: pinhole-radial3
    image_size: [1280, 1024]
    parameters: {{f_x: 755, f_y: 755, c_x: 640, c_y: 512, A_0: -0.2, A_1: 0.06, A_2: -0.01}}
    xi_camera_rig: [-0.1, 0, 0, 0, 0, 0]
    blur: 0.6
"""
PARAMETERS = "755,755,640,512,-0.2,0.06,0,0,-0.01,0,0,0"


def measured(name, command, log):
    done, _, seconds = common.timed(*command, env={**os.environ, "QT_QPA_PLATFORM": "offscreen"})
    log.write_text(done.stdout + done.stderr)
    print(f"{name}: {seconds:.0f} s of CPU", flush=True)
    return seconds


def pairs_of(names):
    half = len(names) // 2
    start, end = names[:half], names[half:]
    pairs = []
    for segment in (start, end):
        for i, name in enumerate(segment):
            pairs.append((f"left/{name}", f"right/{name}"))
            pairs += [(f"{camera}/{name}", f"{camera}/{other}") for other in segment[i + 1:i + 6] for camera in ("left", "right")]
    pairs += [(f"left/{a}", f"left/{b}") for a in start[::5] for b in end[::5]]
    return pairs


def run_colmap(images, out, features):
    names = sorted(os.listdir(images / "left"))
    (out / "images.txt").write_text("".join(f"{c}/{n}\n" for c in ("left", "right") for n in names))
    (out / "pairs.txt").write_text("".join(f"{a} {b}\n" for a, b in pairs_of(names)))
    (out / "sparse").mkdir(exist_ok=True)
    database = ["--database_path", out / "colmap.db"]
    (out / "colmap.db").unlink(missing_ok=True)
    total = measured("colmap, features", [
        "colmap", "feature_extractor", *database, "--image_path", images, "--image_list_path", out / "images.txt",
        "--ImageReader.camera_model", "FULL_OPENCV", "--ImageReader.single_camera_per_folder", "1", "--ImageReader.camera_params",
        PARAMETERS, "--SiftExtraction.use_gpu", "0", "--SiftExtraction.max_num_features", str(features)], out / "features.log")
    total += measured("colmap, matches", [
        "colmap", "matches_importer", *database, "--match_list_path", out / "pairs.txt", "--match_type", "pairs",
        "--SiftMatching.use_gpu", "0"], out / "matches.log")
    total += measured("colmap, mapper", [
        "colmap", "mapper", *database, "--image_path", images, "--output_path", out / "sparse", "--Mapper.ba_refine_focal_length",
        "0", "--Mapper.ba_refine_extra_params", "0"], out / "mapper.log")
    print(f"colmap: {total:.0f} s of CPU in all")
    common.run("colmap", "model_converter", "--input_path", out / "sparse/0", "--output_path", out / "sparse/0", "--output_type", "TXT")
    path = {}
    for line in (out / "sparse/0/images.txt").read_text().split("\n"):
        cells = line.split()
        if len(cells) == 10 and cells[9].startswith("left/"):
            w, x, y, z, *t = (float(v) for v in cells[1:8])
            path[cells[9][5:].removesuffix(".png")] = -rotation_of(x, y, z, w).T @ np.array(t)
    return path


def align(source, target):
    """The similarity (Umeyama 1991) that maps the columns of source onto target."""
    a, b = source.mean(1, keepdims=True), target.mean(1, keepdims=True)
    U, S, Vt = np.linalg.svd((target - b) @ (source - a).T)
    D = np.diag([1, 1, np.sign(np.linalg.det(U @ Vt))])
    R, s = U @ D @ Vt, (S * np.diag(D)).sum() / ((source - a)**2).sum()
    return lambda p: s * R @ (p - a) + b


def report_drift(name, path, truth):
    """Of positions by the name of the frame."""
    found, half = sorted(path), sorted(truth)[len(truth) // 2]
    start, end = [i for i in found if i < half], [i for i in found if i >= half]
    columns = lambda positions, frames: np.array([positions[i] for i in frames]).T
    error = align(columns(path, start), columns(truth, start))(columns(path, end)) - columns(truth, end)
    print(f"{name}: {len(found)} of {len(truth)} frames; the end is off by {1e3 * np.sqrt((error**2).sum(0).mean()):.2f} mm")


def positions_at(trajectory, times):
    """By the name of the frame; frames without a pose are left out."""
    rows = np.loadtxt(trajectory)
    nearest = {name: np.argmin(abs(rows[:, 0] - time)) for name, time in times.items()}
    return {name: rows[i, 1:4] for name, i in nearest.items() if abs(rows[i, 0] - times[name]) < 1e-3}


def main():
    parser = common.parser(__doc__)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--frames", type=int, default=30)
    parser.add_argument("--features", type=int, default=8192)
    arguments = parser.parse_args()
    program, out = arguments.program, arguments.out
    out.mkdir(parents=True, exist_ok=True)
    images = out / "recording"
    if not images.exists():
        (out / "loop.yaml").write_text(SPECIFICATION.format(frames=arguments.frames))
        common.run(program, "simulate", out / "loop.yaml", "-o", images, "--quiet")
    lines = [line.split() for line in (images / "times.txt").read_text().split("\n") if line and line[0] != "#"]
    times = {cells[0]: float(cells[1]) for cells in lines}
    truth = positions_at(images / "truth/segments_left.txt", times)
    measured("plenocal", [program, "groundtruth", images, "-o", out / "truth"], out / "plenocal.log")
    print(f"  {common.peak_megabytes():.0f} MB")
    report_drift("plenocal", positions_at(out / "truth/segments_left.txt", times), truth)
    path = run_colmap(images, out, arguments.features)
    print(f"  {common.peak_megabytes():.0f} MB at most, of either program")
    report_drift("colmap", path, truth)


if __name__ == "__main__":
    main()

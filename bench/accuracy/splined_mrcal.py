#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Our splines beside mrcal's spline of the same knots, on the corners of corners_mrcal_figueroa.

    PLENOCAL_DATA=... bench/accuracy/splined_mrcal.py --program build/release/apps/plenocal [--models splined splined2-30x20]

Both are calibrated from every second of the 186 frames. Each camera is then held and judged by the other frames: only
poses and the target's markers (tolerance 2 mm) are free. What is left of our residuals is then explained by a bend of the
board of each frame, a quadratic or a cubic, beside its pose. Needs /usr/bin/python3 with mrcal (Debian's python3-mrcal).
"""
import os
import pathlib
import sys
import time

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common

SET = pathlib.Path(os.environ.get("PLENOCAL_DATA", "$PLENOCAL_DATA")).absolute() / "frames/corners_mrcal_figueroa"  # docs/data.md
TARGET = {"type": "chessboard", "columns": 10, "rows": 10, "square": 0.077, "tolerance": 0.002}


def write_session(folder, name, model, detections, parameters=None):
    camera = {"model": model, "detections": detections, "image_size": [6016, 4016]}
    if parameters:
        camera |= {"initial": parameters, "fixed": list(parameters)}
    common.save(folder / name, {"target": "target.yaml", "cameras": {"cam": camera}, "options": {"refine_target": True}})


def parameters(folder, result):
    cameras = common.load(folder / result / "calibration.yaml")["cameras"]
    return next(iter(cameras.values()))["parameters"]


def rms(folder, result):
    rows = np.genfromtxt(folder / result / "residuals.csv", delimiter=",", names=True, dtype=None, encoding=None)
    used = rows["used"] == 1
    return np.sqrt(np.mean(rows["dx"][used] ** 2 + rows["dy"][used] ** 2)), used.sum(), (~used).sum()


def board_bends(folder, result, cameramodel):
    """Residuals of all used points, px RMS, less a board's polynomial bend out of its plane and a motion in each frame."""
    import mrcal
    lens = mrcal.cameramodel(str(folder / cameramodel)).intrinsics()
    read = lambda name: np.genfromtxt(folder / result / name, delimiter=",", names=True, dtype=None, encoding=None)
    rows, poses = read("residuals.csv"), {pose["frame"]: pose for pose in read("poses.csv")}
    rows = rows[rows["used"] == 1]
    markers = common.load(folder / result / "target.yaml")["markers"]
    points = np.array([markers[int(marker)] for marker in rows["marker"]])
    x, y = ((points - points.mean(0)) / np.ptp(points, axis=0).max() * 2).T[:2]
    motion = [(0, 1), (1, 1), (2, 1), (2, x), (2, y)]  # direction in the board's frame, and how far
    bends = {"pose": motion, "pose, quadratic bend": motion + [(2, g) for g in (x * x, x * y, y * y)]}
    bends["pose, cubic bend"] = bends["pose, quadratic bend"] + [(2, g) for g in (x**3, x * x * y, x * y * y, y**3)]
    left, numbers = dict.fromkeys(bends, 0.0), dict.fromkeys(bends, 0)
    for frame, pose in poses.items():
        mine = rows["frame"] == frame
        qx, qy, qz, qw = (pose[key] for key in ("qx", "qy", "qz", "qw"))
        axis, cross = np.array([qx, qy, qz]), np.array([[0, -qz, qy], [qz, 0, -qx], [-qy, qx, 0]])
        R = (qw**2 - axis @ axis) * np.eye(3) + 2 * np.outer(axis, axis) + 2 * qw * cross
        image = lambda p: mrcal.project((p - [pose["x"], pose["y"], pose["z"]]) @ R, *lens)
        J = [(image(points[mine] + h) - image(points[mine] - h)) / 2e-5 for h in 1e-5 * np.eye(3)]
        e = np.stack([rows["dx"][mine], rows["dy"][mine]], 1)
        for name, fields in bends.items():
            columns = [(J[axis] * (np.ones_like(x) * field)[mine, None]).ravel() for axis, field in fields]
            columns.append((J[1] * x[mine, None] - J[0] * y[mine, None]).ravel())
            A = np.stack(columns, 1)
            left[name] += np.sum((e.ravel() - A @ np.linalg.lstsq(A, e.ravel(), rcond=None)[0]) ** 2)
            numbers[name] += A.shape[1]
    whole = np.sum(rows["dx"] ** 2 + rows["dy"] ** 2) / len(rows)
    for name in bends:
        by_noise = np.sqrt(whole * (1 - numbers[name] / (2 * len(rows))))
        print(f"    less {name}: {np.sqrt(left[name] / len(rows)):.4f} px; of independent errors {by_noise:.4f} px would be left")


def calibrate_with_mrcal(folder, start):
    """Of the frames 0, 2, 4, ..., from our camera as start; writes folder/mrcal.cameramodel."""
    import mrcal
    inputs = mrcal.cameramodel(str(SET / "splined-0.cameramodel")).optimization_inputs()
    model = mrcal.cameramodel(str(folder / start))
    even = inputs["indices_frame_camintrinsics_camextrinsics"][:, 0] % 2 == 0
    indices = inputs["indices_frame_camintrinsics_camextrinsics"][even].copy()
    frames, indices[:, 0] = np.unique(indices[:, 0], return_inverse=True)
    inputs |= {"indices_frame_camintrinsics_camextrinsics": indices.astype(np.int32),
               "frames_rt_toref": np.ascontiguousarray(inputs["frames_rt_toref"][frames]),
               "observations_board": np.ascontiguousarray(inputs["observations_board"][even]),
               "lensmodel": model.intrinsics()[0], "intrinsics": np.ascontiguousarray(model.intrinsics()[1][None])}
    mrcal.optimize(**inputs)
    mrcal.cameramodel(intrinsics=(inputs["lensmodel"], inputs["intrinsics"][0]),
                      imagersize=inputs["imagersizes"][0]).write(str(folder / "mrcal.cameramodel"))


def main():
    parser = common.parser(__doc__)
    parser.add_argument("--models", nargs="+", default=["splined"])
    arguments = parser.parse_args()
    if not SET.is_dir():
        sys.exit(f"no folder {SET}: set PLENOCAL_DATA to the folder of the optional data sets (docs/data.md)")
    with common.folder() as folder:
        run = lambda *command: common.run(arguments.program, *command, cwd=folder)
        common.save(folder / "target.yaml", TARGET)
        run("import", SET / "corners.vnl", "--format", "mrcal-corners", "-o", "all")
        head, *rows = (folder / "all/detections_corners.csv").read_text().splitlines()
        for part, parity in (("train", 0), ("test", 1)):
            mine = [row for row in rows if int(row.split(",")[0].removeprefix("frame")) % 2 == parity]
            (folder / f"{part}.csv").write_text("\n".join([head, *mine]) + "\n")

        for model in arguments.models:
            write_session(folder, "train.yaml", model, "train.csv")
            begin = time.time()
            run("calibrate", "train.yaml", "-o", "ours", "--no-report", "--threads", 1)
            print(f"{model}: {time.time() - begin:.1f} s, RMS {rms(folder, 'ours')[0]:.4f} px in sample")
            run("export", "ours/calibration.yaml", "--format", "mrcal", "-o", "ours.cameramodel")
            begin = time.time()
            calibrate_with_mrcal(folder, "ours.cameramodel")
            print(f"mrcal: {time.time() - begin:.1f} s from there")
            run("import", "mrcal.cameramodel", "--format", "mrcal", "-o", "mrcal")
            for result in ("ours", "mrcal"):
                write_session(folder, "test.yaml", model, "test.csv", parameters(folder, result))
                run("calibrate", "test.yaml", "-o", f"test_{result}", "--no-report")
                value, used, rejected = rms(folder, f"test_{result}")
                print(f"held out, {result:5}: RMS {value:.4f} px over {used} points, {rejected} rejected", flush=True)
            board_bends(folder, "test_ours", "ours.cameramodel")


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Calibrators that pip installs, and Plenocal, on the same points of one camera.

    python3 -m venv V && V/bin/pip install pyyaml opencv-contrib-python==5.1.0.95 lensboy==4.0.3 vision-calibration==0.9.0
    V/bin/python bench/peers [--frames 100 1000]

Points of bench/make_problem with markers at their nominal places, which all hold there (lensboy with a warp of the board). CPU
seconds: of the peers the call that calibrates, of Plenocal the whole process with all standard errors, diagnosis and report.
Who comes to the same minimum has the same RMS of the differences to the true projections over the image, less what a
rotation of the camera explains. Peers that are not installed, or fail, are named. Needs the preset dev (build/release/bench).
"""
import contextlib
import importlib.metadata
import io
import pathlib
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from common import BUILD

COLUMNS, ROWS, SQUARE, WIDTH, HEIGHT = 10, 7, 0.03, 1280, 960
BOARD = np.array([[SQUARE * (k % COLUMNS), SQUARE * (k // COLUMNS), 0] for k in range(COLUMNS * ROWS)])


def read_views(path):
    """[(markers, pixels)], a pair a frame."""
    views = {}
    for row in common.read_table(path):
        markers, pixels = views.setdefault(row["frame"], ([], []))
        markers.append(int(row["marker"]))
        pixels.append((float(row["x"]), float(row["y"])))
    return [(np.array(markers), np.array(pixels)) for markers, pixels in views.values()]


def read_truth(path):
    value = {row["parameter"]: float(row["value"]) for row in common.read_table(path)}
    radial = np.array([value["A_0"], value["A_1"], 0, 0, value["A_2"]])
    return value["f_x"], value["f_y"], value["c_x"], value["c_y"], radial


def project(f_x, f_y, c_x, c_y, k, rays):
    """OpenCV's model of five coefficients."""
    x, y = rays[:, 0] / rays[:, 2], rays[:, 1] / rays[:, 2]
    r2 = x * x + y * y
    radial = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
    return np.stack([f_x * (x * radial + 2 * k[2] * x * y + k[3] * (r2 + 2 * x * x)) + c_x,
                     f_y * (y * radial + k[2] * (r2 + 2 * y * y) + 2 * k[3] * x * y) + c_y], axis=1)


def difference(camera, truth):
    """RMS in px over the image; a small rotation of the camera frame is free, as the poses take it up."""
    x, y = np.meshgrid(np.linspace(-0.55, 0.55, 21), np.linspace(-0.4, 0.4, 15))
    rays = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1)
    true = project(*truth, rays)
    off = (project(*camera, rays) - true).ravel()
    step = 1e-5
    turned = [(project(*truth, rays + step * np.cross(axis, rays)) - true).ravel() / step for axis in np.eye(3)]
    J = np.stack(turned, axis=1)
    rest = off - J @ np.linalg.lstsq(J, off, rcond=None)[0]
    return np.sqrt(2 * np.mean(rest**2))


def by_opencv(views):
    import cv2
    boards = [BOARD[markers].astype(np.float32) for markers, _ in views]
    images = [pixels.astype(np.float32) for _, pixels in views]
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-12)
    _, K, k, _, _ = cv2.calibrateCamera(boards, images, (WIDTH, HEIGHT), None, None, flags=cv2.CALIB_USE_LU, criteria=criteria)
    return K[0, 0], K[1, 1], K[0, 2], K[1, 2], k.ravel()


def by_lensboy(views):
    import lensboy
    frames = [lensboy.Frame(markers, pixels) for markers, pixels in views]
    config = lensboy.OpenCVConfig(image_height=HEIGHT, image_width=WIDTH,
                                  included_distortion_coefficients=lensboy.OpenCVConfig.STANDARD)
    model = lensboy.calibrate_camera(BOARD, frames, config).camera_model
    return model.fx, model.fy, model.cx, model.cy, np.asarray(model.distortion_coeffs)


def by_vision_calibration(views):
    import vision_calibration as vc
    views = [vc.PlanarView(vc.Observation([tuple(p) for p in BOARD[markers].tolist()], [tuple(p) for p in pixels.tolist()]))
             for markers, pixels in views]
    config = vc.PlanarCalibrationConfig(init=vc.IntrinsicsInitConfig(fix_k3=False), solver=vc.SolverConfig(max_iters=500))
    camera = vc.run_planar_intrinsics(vc.PlanarDataset(views), config).camera
    k, d = camera.intrinsics, camera.distortion
    return k.fx, k.fy, k.cx, k.cy, np.array([d.k1, d.k2, d.p1, d.p2, d.k3])


def by_plenocal(folder):
    session = (folder / "session.yaml").read_text()
    target = folder / "target.yaml"
    target.write_text("".join(line for line in target.read_text().splitlines(True) if "tolerance" not in line))
    (folder / "radtan.yaml").write_text(session.replace("pinhole-radial3", "pinhole-radtan"))
    common.run(BUILD / "apps/plenocal", "calibrate", folder / "radtan.yaml", "-o", folder / "out", "--quiet")
    camera = common.load(folder / "out/calibration.yaml")["cameras"]["cam0"]["parameters"]
    return (*(camera[key] for key in ("f_x", "f_y", "c_x", "c_y")),
            np.array([camera[key] for key in ("k_1", "k_2", "p_1", "p_2", "k_3")]))


PEERS = {"opencv-contrib-python": by_opencv, "lensboy": by_lensboy, "vision-calibration": by_vision_calibration}


def main():
    parser = common.parser(__doc__, plenocal=None)
    parser.add_argument("--frames", type=int, nargs="+", default=[100, 1000])
    options = parser.parse_args()
    common.head("frames", "calibrator", "CPU s", "ratio to Plenocal", "RMS to the true projections, px")
    for frames in options.frames:
        with common.folder() as folder:
            common.run(BUILD / "bench/make_problem", 1, frames, "exact", folder)
            views = read_views(folder / "cam0.csv")
            truth = read_truth(folder / "truth.csv")
            own = None
            for name, solve in {"plenocal": lambda _: by_plenocal(folder), **PEERS}.items():
                version = "" if name == "plenocal" else importlib.metadata.version(name)
                begin = common.processor_seconds()
                try:
                    with contextlib.redirect_stdout(io.StringIO()):  # of peers that print their progress
                        camera = solve(views)
                except Exception as error:
                    common.row(frames, f"{name} {version}", f"failed: {str(error)[:100]}", "", "")
                    continue
                seconds = common.processor_seconds() - begin
                own = own or seconds
                common.row(frames, f"{name} {version}", f"{seconds:.2f}", f"{seconds / own:.1f}", f"{difference(camera, truth):.4f}")


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Figures of docs/python.md: import, one more frame, projection of a million points, models in numpy, agreement with OpenCV and
mrcal.

    PYTHONPATH=build/release/python build/venv/bin/python bench/speed/python_module.py [--opencv] [--mrcal]

The C++ call is timed by build/release/bench/project_points, of the same models and points.
"""

from __future__ import annotations

import pathlib
import subprocess
import sys
import tempfile
import time

import numpy as np

import plenocal

ROOT = pathlib.Path(__file__).resolve().parents[2]
POINTS = 1_000_000


def example(model: str) -> plenocal.Camera:
    info = plenocal.model_info(model)
    return plenocal.Camera(model, info["example_size"], info["example"])


def points(count: int) -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.stack(
        [rng.uniform(-0.5, 0.5, count), rng.uniform(-0.4, 0.4, count), np.ones(count)], axis=1
    )


def seconds(call: object, repetitions: int = 15) -> float:
    times = []
    for _ in range(repetitions):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def report_speed() -> None:
    p = points(POINTS)
    rounds = 5  # in turns, since other programs share the machine
    print(f"{POINTS} points projected, ms (best of {15 * rounds}): Python, C++, ratio")
    with tempfile.NamedTemporaryFile(suffix=".f64") as file:
        p.tofile(file.name)
        for model in ("pinhole", "pinhole-radtan", "kannala-brandt4", "double-sphere", "splined"):
            camera = example(model)
            program = ROOT / "build/release/bench/project_points"
            python = cpp = np.inf
            for _ in range(rounds):
                python = min(python, seconds(lambda: camera.project(p)))
                call = subprocess.run([program, model, file.name], check=True, capture_output=True)
                cpp = min(cpp, float(call.stdout))
            print(f"  {model:16} {1e3 * python:8.1f} {1e3 * cpp:8.1f} {python / cpp:6.2f}")


def report_import() -> None:
    code = "import time; t = time.perf_counter(); import plenocal; print(time.perf_counter() - t)"
    times = [
        float(subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout)
        for _ in range(10)
    ]
    print(f"import plenocal: {1e3 * np.median(times):.0f} ms (median of 10)")


def report_one_more_frame() -> None:
    """One more frame in a calibration of 200 frames of 70 markers, from points, in a process that has made one."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([ROOT / "build/release/bench/make_problem", "1", "201", "bent", folder], check=True)
        table = pathlib.Path(folder, "cam0.csv")
        last = table.read_text().splitlines()[-1].split(",")[0]
        plenocal.calibrate(f"{folder}/session.yaml", exclude=[f"frame: '{last}'"])
        warm = 1e3 * np.median([seconds(lambda: plenocal.calibrate(f"{folder}/session.yaml"), 1) for _ in range(5)])
    print(f"201 frames after 200 of them: {warm:.0f} ms (median of 5)")


class KannalaBrandt(plenocal.CameraModel):
    """The header's equations in numpy."""

    name = "bench-kannala-brandt4"
    params = (*plenocal.INTRINSICS, *(plenocal.Param(f"k_{i}", scale=0.4**i, neutral=0) for i in (1, 2, 3, 4)))
    example = (210, 212, 322, 243, -0.01, 0.003, -0.0002, 1e-05)

    def project(self, params, point):
        f_x, f_y, c_x, c_y, *k = params
        x, y, z = point
        r = np.hypot(x, y)
        t = np.arctan2(r, z)
        q = t * t
        radius = t * (1 + q * (k[0] + q * (k[1] + q * (k[2] + q * k[3]))))
        slope = 1 + q * (3 * k[0] + q * (5 * k[1] + q * (7 * k[2] + q * 9 * k[3])))
        g = np.where(r > 0, radius / np.where(r > 0, r, 1), 1 / z)
        return np.where(slope > 0, f_x * g * x + c_x, np.nan), f_y * g * y + c_y


class KannalaBrandtSlopes(KannalaBrandt):
    name = "bench-kannala-brandt4-jacobian"

    def jacobian(self, params, point):
        f, k = np.array(params[:2]), params[4:]
        x, y, z = point
        r2 = np.maximum(x * x + y * y, 1e-24)
        r, d2 = np.sqrt(r2), r2 + z * z
        t = np.arctan2(r, z)
        q = t * t
        powers = t[:, None] * q[:, None] ** np.arange(1, 5)
        radius = t + powers @ k
        slope = 1 + powers @ (np.array([3, 5, 7, 9]) * k) / t
        m = np.stack([x, y], 1) / r[:, None]
        u = f * m * radius[:, None] + params[2:4]
        J_params, J_point = np.zeros((len(x), 2, 8)), np.empty((len(x), 2, 3))
        J_params[:, [0, 1], [0, 1]] = m * radius[:, None]
        J_params[:, [0, 1], [2, 3]] = 1
        J_params[:, :, 4:] = (f * m)[:, :, None] * powers[:, None]
        by_r = m[:, :, None] * m[:, None] * (slope * z / d2 - radius / r)[:, None, None]
        J_point[:, :, :2] = f[:, None] * (by_r + np.eye(2) * (radius / r)[:, None, None])
        J_point[:, :, 2] = -f * m * (slope * r / d2)[:, None]
        u[~(slope > 0)] = np.nan
        return u, J_params, J_point


def report_python_models() -> None:
    """CPU time of calibrations by models in numpy, beside the header of the same lens: 100 frames of 140 points."""
    models = ["kannala-brandt4", KannalaBrandt.name, KannalaBrandtSlopes.name]
    for model in (KannalaBrandt, KannalaBrandtSlopes):
        plenocal.register(model)
    p = np.random.default_rng(1).normal(size=(14000, 3)) * [0.5, 0.4, 0.1] + [0, 0, 1]
    with tempfile.TemporaryDirectory() as folder:
        pathlib.Path(folder, "target.yaml").write_text("plenocal: 1\ntype: chessboard\ncolumns: 14\nrows: 10\nsquare: 0.03\n")
        values = ", ".join(f"{param.name}: {value}" for param, value in zip(KannalaBrandt.params, KannalaBrandt.example))
        pathlib.Path(folder, "specification.yaml").write_text(
            "plenocal: 1\nseed: 2\ntarget: target.yaml\nposes: {frames: 100, distance: [0.25, 0.6], partial: 0.3}\n"
            "cameras: {cam: {model: kannala-brandt4, image_size: [640, 480], detection_sigma: 0.05, "
            f"parameters: {{{values}}}}}}}\n")
        plenocal.simulate(f"{folder}/specification.yaml", f"{folder}/set", points=True)
        session = pathlib.Path(folder, "set/session.yaml")
        text = session.read_text()
        for model in models:
            session.write_text(text.replace("model: kannala-brandt4", f"model: {model}"))
            times = []
            for _ in range(3):
                begin = time.process_time()
                plenocal.calibrate(session, threads=1)
                times.append(time.process_time() - begin)
            camera = plenocal.Camera(model, (640, 480), KannalaBrandt.example)
            point = 1e6 * seconds(lambda: camera.jacobian(p)) / len(p)
            print(f"{model}: calibration {np.median(times):.2f} s of CPU, projection with derivatives {point:.2f} us a point")


def report_opencv() -> None:
    import cv2

    p = points(1000)
    K = lambda c: np.array([[c.params[0], 0, c.params[2]], [0, c.params[1], c.params[3]], [0, 0, 1]])
    zero = np.zeros(3)
    for model, order in (("pinhole-radtan4", 4), ("pinhole-radtan", 5), ("pinhole-radtan8", 8)):
        camera = example(model)
        pixels = cv2.projectPoints(p, zero, zero, K(camera), camera.params[4 : 4 + order])[0][:, 0]
        report("OpenCV " + cv2.__version__, camera, pixels, p)
    camera = example("kannala-brandt4")
    pixels = cv2.fisheye.projectPoints(p[:, None], zero, zero, K(camera), camera.params[4:8])[0][:, 0]
    report("OpenCV " + cv2.__version__, camera, pixels, p)


def report(tool: str, camera: plenocal.Camera, pixels: np.ndarray, p: np.ndarray) -> None:
    found = camera.project(p)
    inside = np.isfinite(found).all(axis=1)
    largest = np.abs(found - pixels)[inside].max()
    print(f"{tool}: {camera.model}: {inside.sum()} points, largest difference {largest:.1e} px")


MRCAL = """
import sys, numpy as np, mrcal
p = np.fromfile(sys.argv[2]).reshape(-1, 3)
model = mrcal.cameramodel(sys.argv[1])
mrcal.project(p, *model.intrinsics()).tofile(sys.argv[3])
"""


def report_mrcal() -> None:
    """With Debian's Python, for which python3-mrcal is."""
    p = points(1000)
    with tempfile.TemporaryDirectory() as folder:
        p.tofile(f"{folder}/points")
        for model in ("pinhole-radtan", "pinhole-radtan8", "pinhole-radtan12", "splined"):
            camera = example(model)
            plenocal.Calibration.of_cameras([camera]).to_mrcal(f"{folder}/a.cameramodel")
            arguments = [f"{folder}/a.cameramodel", f"{folder}/points", f"{folder}/pixels"]
            environment = {"PATH": "/usr/bin:/bin"}
            subprocess.run(["/usr/bin/python3", "-c", MRCAL, *arguments], check=True, env=environment)
            report("mrcal", camera, np.fromfile(f"{folder}/pixels").reshape(-1, 2), p)


if __name__ == "__main__":
    report_import()
    report_one_more_frame()
    report_speed()
    report_python_models()
    if "--opencv" in sys.argv:
        report_opencv()
    if "--mrcal" in sys.argv:
        report_mrcal()

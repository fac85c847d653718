#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Figures of docs/python.md: import, one more frame, projection of a million points, agreement with OpenCV and mrcal.

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
    if "--opencv" in sys.argv:
        report_opencv()
    if "--mrcal" in sys.argv:
        report_mrcal()

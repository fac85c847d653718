#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Holds the results of one build against those of another: a net under changes that must not change results.

    bench/net record  PROGRAM RESULTS   # runs all cases with PROGRAM, keeps what they write in the folder RESULTS
    bench/net compare PROGRAM RESULTS   # runs them with another PROGRAM; exit status 1 when something differs
    bench/net compare RESULTS RESULTS   # compares two records

Numbers must agree to 1e-9 of their size, all else to the letter; what was renamed on purpose stands in RENAMED, texts
for people are in PROSE and not compared. With --in-sigmas an estimate may move by 1e-4 of the standard error that stands
beside it, and other numbers by 1e-5 of their size or of the largest one in their list or column; whole numbers, words
and all that is chosen stay the same but for the iterations. Real sets are read from the folder in PLENOCAL_DATA.
"""
import csv
import hashlib
import io
import json
import math
import os
import pathlib
import re
import shutil
import sys

import yaml

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from common import save

DATA = pathlib.Path(os.environ.get("PLENOCAL_DATA", "/nonexistent"))
FRAMES = DATA / "frames"
TOLERANCE = 1e-9
# Differences of numbers that are rounding of larger ones: below this part of the largest number in the same list or
# column a number counts as zero.
ROUNDING = 1e-12
# With --in-sigmas: of a standard error; of other numbers.
OF_SIGMA, OF_OTHERS = 1e-4, 1e-5
# Estimates in YAML and JSON files and their standard errors in the same map; of others `sigma_` stands before the name.
SIGMAS = {"parameters": "sigma", "markers": "sigma", "value": "sigma", "xi_camera_rig": "sigma_xi", "xi_target_own": "sigma_xi"}

# Keys of YAML and JSON files and columns of CSV files: name before -> name now; "file: name" for one file alone.
RENAMED = {"residuals.csv: sigma": "noise_sigma"}
# Keys and files that the recorded program did not write.
ADDED = {"verdict", "left_out.csv"}
# Keys whose values are sentences, and what depends on the program's version or on where it runs.
PROSE = {"warnings", "left_out", "what", "remedy", "provenance", "failure", "source", "generated_by"}


def chessboard(columns, rows, square, **more):
    return {"type": "chessboard", "columns": columns, "rows": rows, "square": square, **more}


APRILGRID = {"type": "aprilgrid", "columns": 6, "rows": 6, "size": 0.088, "spacing": 0.3, "border_bits": 2}
LIFECAM = {"type": "charuco", "columns": 8, "rows": 8, "square": 0.0254, "marker": 0.01905, "dictionary": "DICT_4X4_1000"}
CIRCLES = {"type": "circles", "columns": 6, "rows": 6, "spacing": 0.034, "pattern": "symmetric"}


def camera(model, images, **more):
    return {"model": model, "images": str(images), **more}


# name: (target, cameras, options)
REAL_SETS = {
    "aprilgrid": ({**APRILGRID, "tolerance": 0.0003}, {"cam": camera("pinhole-radtan", FRAMES / "aprilgrid_d435i_mocap/cam0/data/*.jpg")}, {}),
    "charuco": (LIFECAM, {"cam": camera("pinhole-radtan", FRAMES / "charuco_lifecam/2024-05-07_lifecam_480/*")}, {"refine_target": False}),
    "circles": (CIRCLES, {"cam": camera("pinhole-radtan4", FRAMES / "circles_visp/*.jpg")}, {"refine_target": False, "loss": "cauchy"}),
    "fisheye": (chessboard(9, 6, 0.03), {"cam": camera("kannala-brandt4", FRAMES / "mono_fisheye_camodocal/img*.png")}, {"loss": "none"}),
    "stereo": (chessboard(9, 6, 0.025, tolerance=0.00025),
               {"left": camera("pinhole-radial3", FRAMES / "stereo_chess_opencv/left*.jpg", prior={"f_x": {"value": 530, "sigma": 20}}),
                "right": camera("pinhole-radial3", FRAMES / "stereo_chess_opencv/right*.jpg", equal=[["f_x", "f_y"]], shared={"A_2": "left"})}, {}),
    "jitter": (chessboard(8, 6, 0.03),
               {"left": camera("double-sphere", FRAMES / "stereo_fisheye_ros/left*.png"),
                "right": camera("double-sphere", FRAMES / "stereo_fisheye_ros/right*.png")}, {"refine_target": False}),
}

SIMULATED = {
    "seed": 11, "white_images": 2,
    "poses": {"kind": "varied", "frames": 3, "distance": [0.36, 0.6], "aim": "plenoptic", "partial": 0.0},
    "cameras": {
        "left": {"model": "pinhole-radial3", "image_size": [480, 384], "blur": 0.6,
                 "parameters": {"f_x": 310, "f_y": 311, "c_x": 236, "c_y": 194, "A_0": -0.21, "A_1": 0.07, "A_2": -0.012}},
        "plenoptic": {"model": "focused-plenoptic", "image_size": [480, 480], "pixel_size": 7.4e-6, "blur": 0.35,
                      "parameters": {"f_L": 0.0122, "b_L0": 0.01166, "B": 0.00026, "c_x": 242, "c_y": 237},
                      "xi_camera_rig": [-0.05, 0.045, -0.008, -0.08, 0.01, 0.005],
                      "micro_lenses": {"pitch": 19, "rotation": 0.006, "focus": [2.4, 3.0, 3.9]}}}}
BOARD = {"type": "aprilgrid", "columns": 6, "rows": 6, "size": 0.055, "spacing": 0.3, "tolerance": 0.0003}
POINTS = {
    "seed": 3, "target": "board.yaml", "poses": {"kind": "varied", "frames": 24, "distance": [0.4, 1.2]},
    "cameras": {"cam": {"model": "pinhole-radial3", "image_size": [1280, 960], "detection_sigma": 0.1,
                        "parameters": {"f_x": 900, "f_y": 901, "c_x": 636, "c_y": 483, "A_0": -0.21, "A_1": 0.07, "A_2": -0.012}},
                "other": {"model": "double-sphere", "image_size": [1280, 960], "detection_sigma": 0.2,
                          "parameters": {"f_x": 500, "f_y": 501, "c_x": 636, "c_y": 483, "xi": -0.2, "alpha": 0.6},
                          "xi_camera_rig": [-0.1, 0.001, -0.002, 0.005, -0.02, 0.01]}}}


class Cases:
    def __init__(self, program, folder, only):
        self.program, self.folder, self.only = program, folder, only

    def run(self, name, *words, kept=None, statuses=(0,)):
        """Runs one command in the folder; its standard output is kept as a file where `kept` names one."""
        done, seconds, _ = common.timed(self.program, *words, cwd=self.folder, statuses=statuses)
        print(f"{seconds:7.1f} s  {name}", file=sys.stderr, flush=True)
        if kept:
            (self.folder / kept).write_text(done.stdout)

    # Plenoptic detections of several threads differ in the last digits from run to run, so they run on one.
    def calibrate(self, name, session, *more):
        self.run(name, "calibrate", session, "-o", name, "--no-report", "--quiet", *more)

    def points(self):
        """Simulated points and what every command makes of them."""
        save(self.folder / "points.yaml", POINTS)
        save(self.folder / "board.yaml", BOARD)
        self.run("simulate points", "simulate", "points.yaml", "--points", "-o", "points", "--quiet")
        self.calibrate("points_result", "points/session.yaml", "--jackknife")
        result, truth = "points_result/calibration.yaml", "points/truth/calibration.yaml"
        self.run("compare", "compare", result, truth, "-o", "compared", "--quiet", kept="compare.txt")
        self.run("check", "compare", result, "--check", "points/session.yaml", "--json", "--quiet", kept="check.json", statuses=(0, 1))
        self.run("try", "try", "points/session.yaml", "--models", "pinhole,pinhole-radtan,double-sphere,pinhole-radial3", "-o", "tried", "--quiet")
        self.run("convert", "convert", result, "--camera", "cam", "--to", "pinhole-radtan4", "-o", "converted", "--quiet")
        self.run("map", "map", result, "--camera", "cam", "-o", "map.yaml", "--quiet")
        self.run("models", "models", kept="models.txt")
        for kind, suffix in [("opencv", "yml"), ("ros", "yaml"), ("kalibr", "yaml"), ("basalt", "json"), ("matlab", "mat"),
                             ("mrcal", "cameramodel"), ("colmap", "txt"), ("orbslam3", "yaml")]:
            camera = "other" if kind in ("basalt",) else "cam"
            self.run(f"export {kind}", "export", "converted/calibration.yaml" if camera == "cam" else result, "--format", kind,
                     "--camera", camera, "-o", f"export_{kind}.{suffix}", "--quiet")
        self.run("import kalibr", "import", "export_kalibr.yaml", "--format", "kalibr", "-o", "imported", "--quiet")
        self.run("import opencv", "import", "export_opencv.yml", "--format", "opencv", "-o", "imported_opencv", "--quiet")
        self.run("target", "target", "board.yaml", "-o", "board.svg")

    def images(self):
        """Simulated images of a plenoptic and an ordinary camera."""
        save(self.folder / "spec.yaml", {**SIMULATED, "target": "target.yaml"})
        shutil.copy(common.ROOT / "examples/simulate/target.yaml", self.folder / "target.yaml")
        self.run("simulate images", "simulate", "spec.yaml", "-o", "images", "--quiet")
        self.run("white", "white", "images/session.yaml", "-o", "white", "--quiet")
        raw = sorted((self.folder / "images/plenoptic").glob("*.png"))[0]
        self.run("focus", "focus", raw, "--white", "images/plenoptic_white", "-o", "focus", "--quiet")
        self.run("detect", "detect", "images/session.yaml", "-o", "detected", "--quiet", "--threads", 1)
        self.run("undistort", "undistort", "images/truth/calibration.yaml", "--camera", "left", "images/left", "-o", "undistorted", "--quiet")

    def given(self):
        """Sets of other programs: rendered rig with a plenoptic camera, real plenoptic detections, real images, trajectories."""
        self.calibrate("sim_small", DATA / "sim_small/session.yaml", "--threads", 1)
        self.calibrate("r12a", DATA / "plenoptic_real/r12a/session.yaml")
        for name, (target, cameras, options) in REAL_SETS.items():
            if self.only and self.only not in name:
                continue
            save(self.folder / f"{name}_target.yaml", target)
            save(self.folder / f"{name}.yaml", {"target": f"{name}_target.yaml", "cameras": cameras, "options": options})
            self.calibrate(name, f"{name}.yaml")
        self.run("corners by another detector", "import", FRAMES / "corners_mrcal_figueroa/corners.vnl", "--format", "mrcal-corners",
                 "--size", "6016x4016", "-o", "corners", "--quiet")
        save(self.folder / "corners_target.yaml", chessboard(10, 10, 0.077, tolerance=0.001))
        detections = sorted((self.folder / "corners").glob("detections_*.csv"))[0]
        save(self.folder / "corners.yaml", {"target": "corners_target.yaml", "cameras": {
            "cam": {"model": "pinhole-radtan8", "detections": str(detections.relative_to(self.folder)), "image_size": [6016, 4016]}}})
        self.calibrate("corners_result", "corners.yaml")
        trajectories = FRAMES / "traj_tum_rgbd"
        self.run("evaluate", "evaluate", "--estimate", trajectories / "freiburg1_xyz-rgbdslam.txt", "--truth",
                 trajectories / "freiburg1_xyz-groundtruth.txt", "--json", kept="evaluate.json")


def is_whole(text):
    return bool(re.fullmatch(r"[-+]?\d+", text.strip()))


class Differences(list):
    def __init__(self, in_sigmas):
        super().__init__()
        self.in_sigmas = in_sigmas
        self.name = ""  # of the file at work
        self.largest = {}  # by file: largest shift in sigmas, its place

    def number(self, place, a, b, size=0.0, sigma=None, whole=False):
        """`sigma`: standard error of both, a number where it is known. `whole`: counts and numbers of things."""
        if a == b or (math.isnan(a) and math.isnan(b)):
            return
        if math.isfinite(a) and math.isfinite(b):
            if self.in_sigmas and isinstance(sigma, (int, float)) and 0 < sigma < math.inf:
                shift = abs(a - b) / sigma
                self.largest[self.name] = max(self.largest.get(self.name, (0.0, "")), (shift, place))
                if shift <= OF_SIGMA:
                    return
                place = f"{place} ({shift:.2g} sigmas)"
            else:
                relative, rounding = (OF_OTHERS, OF_OTHERS) if self.in_sigmas and not whole else (TOLERANCE, ROUNDING)
                if abs(a - b) <= max(relative * max(abs(a), abs(b)), rounding * size):
                    return
        self.append(f"{place}: {a!r} became {b!r}")

    def value(self, place, a, b, size=0.0, sigma=None):
        if isinstance(a, (int, float)) and isinstance(b, (int, float)) and not isinstance(a, bool):
            self.number(place, float(a), float(b), size, sigma, isinstance(a, int) and isinstance(b, int))
        elif isinstance(a, dict) and isinstance(b, dict):
            a = {RENAMED.get(key, key): item for key, item in a.items() if key not in PROSE}
            b = {key: item for key, item in b.items() if key not in PROSE}
            for key in a.keys() | b.keys():
                if (key not in a and key in ADDED) or (self.in_sigmas and key == "iterations"):
                    continue
                if key not in a or key not in b:
                    self.append(f"{place}.{key}: {'new' if key in b else 'gone'}")
                else:
                    beside = sigma.get(key) if isinstance(sigma, dict) else a.get(f"sigma_{key}", a.get(SIGMAS.get(key)))
                    self.value(f"{place}.{key}", a[key], b[key], sigma=beside)
        elif isinstance(a, list) and isinstance(b, list):
            if len(a) != len(b):
                self.append(f"{place}: {len(a)} entries became {len(b)}")
            numbers = [abs(item) for item in a if isinstance(item, (int, float)) and math.isfinite(item)]
            for i, (x, y) in enumerate(zip(a, b)):
                beside = sigma[i] if isinstance(sigma, list) and i < len(sigma) else None
                self.value(f"{place}[{i}]", x, y, max(numbers, default=0.0), beside)
        elif a != b:
            self.text(place, str(a), str(b))

    def text(self, place, a, b):
        """Words to the letter, numbers in them as numbers."""
        split = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")
        a_parts, b_parts = split.split(a), split.split(b)
        if len(a_parts) != len(b_parts) or a_parts[::2] != b_parts[::2]:
            self.append(f"{place}: texts differ")
            return
        for x, y in zip(a_parts[1::2], b_parts[1::2]):
            self.number(place, float(x), float(y), whole=is_whole(x) and is_whole(y))

    def table(self, place, a, b):
        a_rows, b_rows = list(csv.reader(io.StringIO(a))), list(csv.reader(io.StringIO(b)))
        file = pathlib.Path(place).name
        names = [RENAMED.get(f"{file}: {name}", RENAMED.get(name, name)) for name in a_rows[0]]
        if names != b_rows[0] or len(a_rows) != len(b_rows):
            self.append(f"{place}: columns {names}, {len(a_rows)} rows became {b_rows[0]}, {len(b_rows)} rows")
            return
        for k, name in enumerate(names):
            def numbers(rows):
                return [float(row[k]) for row in rows[1:]]
            try:
                x, y = numbers(a_rows), numbers(b_rows)
            except (ValueError, IndexError):
                if [row[k:k + 1] for row in a_rows[1:]] != [row[k:k + 1] for row in b_rows[1:]]:
                    self.append(f"{place}: column {name} differs")
                continue
            size = max((abs(v) for v in x if math.isfinite(v)), default=0.0)
            whole = all(is_whole(row[k]) for row in a_rows[1:] + b_rows[1:])
            beside = names.index(f"sigma_{name}") if f"sigma_{name}" in names else None
            for i, (u, v) in enumerate(zip(x, y)):
                sigma = float(a_rows[i + 1][beside] or "nan") if beside is not None else None
                self.number(f"{place}: row {i + 1}, {name}", u, v, size, sigma, whole)

    def file(self, name, a, b):
        self.name = name
        if a == b:
            return
        suffix = pathlib.Path(name).suffix
        try:
            a_text, b_text = a.decode(), b.decode()
        except UnicodeDecodeError:
            self.append(f"{name}: {hashlib.sha1(a).hexdigest()[:8]} became {hashlib.sha1(b).hexdigest()[:8]}")
            return
        if suffix == ".csv":
            self.table(name, a_text, b_text)
        elif suffix == ".json":
            self.value(name, json.loads(a_text), json.loads(b_text))
        elif suffix in (".yaml", ".yml") and not a_text.startswith("%YAML"):
            self.value(name, yaml.safe_load(a_text), yaml.safe_load(b_text))
        elif suffix != ".html":
            self.text(name, a_text, b_text)


def results(folder):
    """The files that the cases wrote, without caches and pages."""
    return {str(path.relative_to(folder)): path for path in sorted(folder.rglob("*"))
            if path.is_file() and ".cache" not in path.parts and path.suffix != ".html"}


def main():
    parser = common.parser(__doc__, plenocal=None)
    parser.add_argument("what", choices=["record", "compare"])
    parser.add_argument("program", type=lambda path: pathlib.Path(path) if os.path.isdir(path) else common.program(path))
    parser.add_argument("results", type=pathlib.Path)
    parser.add_argument("--only", default="", help="points, images, given, or one real set")
    parser.add_argument("--lines", default=60, type=int, help="differences to print")
    parser.add_argument("--in-sigmas", action="store_true", help="compare estimates in their standard errors")
    options = parser.parse_args()
    with common.folder() as folder:
        if options.program.is_dir():
            folder = options.program
        else:
            cases = Cases(options.program, folder, options.only if options.only in REAL_SETS else "")
            for part in ("points", "images", "given"):
                if not options.only or part == options.only or (part == "given" and options.only in REAL_SETS):
                    getattr(cases, part)()
        now = results(folder)
        if options.what == "record":
            shutil.rmtree(options.results, ignore_errors=True)
            shutil.copytree(folder, options.results, ignore=shutil.ignore_patterns(".cache", "*.html"))
            print(f"{len(now)} files kept in {options.results}")
            return 0
        before = results(options.results)
        differences = Differences(options.in_sigmas)
        for name in sorted(before.keys() | now.keys()):
            if name in before and name in now:
                differences.file(name, before[name].read_bytes(), now[name].read_bytes())
            elif not options.only and (name in before or pathlib.Path(name).name not in ADDED):
                differences.append(f"{name}: {'new' if name in now else 'gone'}")
        for line in differences[:options.lines]:
            print(line)
        for shift, place in differences.largest.values():
            print(f"largest shift of a file {shift:.2g} sigmas: {place}")
        print(f"{len(now)} files compared, {len(differences)} differences")
        return 1 if differences else 0


if __name__ == "__main__":
    sys.exit(main())

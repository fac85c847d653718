#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Camera models of other programs: their projections beside those of the cameras that `plenocal import` makes of their files.

    bench/equivalence [--draws 200]

Each line is one of a program's models: 1000 points inside both domains for each of the drawn parameter sets, the largest
difference in px (docs/exchange.md). Written back by `plenocal export` the numbers are those of the file. Run by an interpreter that
has the Python module `plenocal`, numpy and what is compared: `pip install pycolmap opencv-contrib-python-headless
projectaria-tools`; a program that is missing is left out with a message.
"""
import pathlib
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common

POINTS = 1000
WIDTH, HEIGHT = 1280, 960


def directions(random, degrees):
    """(POINTS, 3): within so many degrees of the axis, at 0.2 to 5 m."""
    theta = np.radians(degrees) * np.sqrt(random.uniform(0, 1, POINTS))
    phi = random.uniform(0, 2 * np.pi, POINTS)
    ray = np.column_stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
    return ray * random.uniform(0.2, 5, (POINTS, 1))


def imported(plenocal, place, name, content, style):
    (place / name).write_text(content)
    plenocal.run(["import", place / name, "--format", style, "-o", place / "imported"])
    return plenocal.Calibration(place / "imported/calibration.yaml")


def intrinsics(random, one_focal_length=False):
    f = random.uniform(300, 700)
    centre = [WIDTH / 2 + random.uniform(-20, 20), HEIGHT / 2 + random.uniform(-20, 20)]
    return [f, *centre] if one_focal_length else [f, f * random.uniform(0.98, 1.02), *centre]


# Sizes of the coefficients after the intrinsics, in the program's order, and the angle that is seen.
COLMAP = {
    "SIMPLE_PINHOLE": ([], 45), "PINHOLE": ([], 45), "SIMPLE_RADIAL": ([0.1], 35), "RADIAL": ([0.1, 0.03], 35),
    "OPENCV": ([0.1, 0.03, 1e-3, 1e-3], 35), "FULL_OPENCV": ([0.1, 0.03, 1e-3, 1e-3, 0.01, 0.05, 0.01, 0.003], 35),
    "OPENCV_FISHEYE": ([0.05, 0.02, 0.005, 0.001], 70), "SIMPLE_FISHEYE": ([], 80), "FISHEYE": ([], 80),
    "SIMPLE_RADIAL_FISHEYE": ([0.05], 70), "RADIAL_FISHEYE": ([0.05, 0.01], 70),
    "THIN_PRISM_FISHEYE": ([0.05, 0.01, 1e-3, 1e-3, 0.005, 0.001, 1e-3, 1e-3], 60),
    "RAD_TAN_THIN_PRISM_FISHEYE": ([0.05, 0.02, 0.005, 0.001, 3e-4, 1e-4, 1e-3, 1e-3, 1e-3, 3e-4, 1e-3, 3e-4], 60),
    "FOV": ([], 60), "SIMPLE_DIVISION": ([0.1], 40), "DIVISION": ([0.1], 40), "EUCM": ([], 70),
    "EQUIRECTANGULAR": ([], 170),
}


def colmap(plenocal, random, place, name):
    import pycolmap
    sizes, degrees = COLMAP[name]
    numbers = intrinsics(random, name.startswith("SIMPLE") or name.startswith("RADIAL"))
    numbers += [size * random.uniform(-1, 1) for size in sizes]
    if name == "FOV":
        numbers.append(random.uniform(0.3, 1.2))
    if name == "EUCM":
        numbers += [random.uniform(0.3, 0.7), random.uniform(0.8, 1.2)]
    if name == "EQUIRECTANGULAR":
        numbers = [WIDTH, HEIGHT]
    text = f"1 {name} {WIDTH} {HEIGHT} {' '.join(map(repr, map(float, numbers)))}\n"
    camera = imported(plenocal, place, "cameras.txt", text, "colmap").cameras[0]
    theirs = pycolmap.Camera(model=name, width=WIDTH, height=HEIGHT, params=numbers)
    points = directions(random, degrees)
    seen = np.array([np.full(2, np.nan) if at is None else at for at in (theirs.img_from_cam(p) for p in points)], float).reshape(-1, 2)
    return camera, points, seen - 0.5  # its first pixel has its centre at 0.5


def opencv14(plenocal, random, place, name):
    import cv2
    f_x, f_y, c_x, c_y = intrinsics(random)
    sizes = [0.1, 0.03, 1e-3, 1e-3, 0.01, 0.05, 0.01, 0.003, 1e-3, 3e-4, 1e-3, 3e-4, 0.05, 0.05]
    D = np.array([size * random.uniform(-1, 1) for size in sizes])
    K = np.array([[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]])
    matrix = lambda rows, data: (f"!!opencv-matrix\n   rows: {rows}\n   cols: {len(data) // rows}\n   dt: d\n   data: "
                                 f"[ {', '.join(repr(float(v)) for v in data)} ]\n")
    text = (f"%YAML:1.0\n---\nimage_width: {WIDTH}\nimage_height: {HEIGHT}\ncamera_matrix: {matrix(3, K.ravel())}"
            f"distortion_coefficients: {matrix(1, D)}")
    camera = imported(plenocal, place, "camera.yaml", text, "opencv").cameras[0]
    points = directions(random, 35)
    return camera, points, cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)


def omnidir(plenocal, random, place, name):
    """Of Kalibr's file, since OpenCV has none of its own; both have the equations of Mei and Rives."""
    import cv2
    f_x, f_y, c_x, c_y = intrinsics(random)
    xi, D = random.uniform(0.2, 1.8), np.array([0.05, 0.01, 1e-3, 1e-3]) * random.uniform(-1, 1, 4)
    numbers = lambda values: ", ".join(repr(float(v)) for v in values)
    text = (f"cam0:\n  camera_model: omni\n  intrinsics: [{numbers([xi, f_x, f_y, c_x, c_y])}]\n  distortion_model: radtan\n"
            f"  distortion_coeffs: [{numbers(D)}]\n  resolution: [{WIDTH}, {HEIGHT}]\n")
    camera = imported(plenocal, place, "camchain.yaml", text, "kalibr").cameras[0]
    points = directions(random, 60)
    K = np.array([[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]])
    # cv2 calls the model omnidir and takes single precision points only: double ones are float64 arrays (N, 1, 3).
    seen = cv2.omnidir.projectPoints(points.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), K, xi, D.reshape(1, 4))[0]
    return camera, points, seen.reshape(-1, 2)


# Number of radial, tangential and prism coefficients, with one focal length.
ARIA = {"FisheyeRadTanThinPrism": (6, 2, 4), "Fisheye62": (6, 2, 0), "KannalaBrandtK3": (4, 0, 0)}


def aria(plenocal, random, place, name):
    import json
    from projectaria_tools.core import calibration
    radial, tangential, prism = ARIA[name]
    sizes = [0.05, 0.02, 0.005, 0.001, 3e-4, 1e-4][:radial] + [1e-3] * tangential + [1e-3, 3e-4, 1e-3, 3e-4][:prism]
    numbers = intrinsics(random, one_focal_length=name != "KannalaBrandtK3") + [size * random.uniform(-1, 1) for size in sizes]
    label = "camera-slam-left"
    text = json.dumps({
        "DeviceClassInfo": {"BuildVersion": "DVT-S", "DeviceClass": "Aria"},
        "OriginSpecification": {"Type": "Custom", "ChildLabel": label},
        "CameraCalibrations": [{"Calibrated": True, "Label": label, "SerialNumber": "", "Projection": {"Name": name, "Params": numbers},
                                "ConfigData": {"ImageWidth": WIDTH, "ImageHeight": HEIGHT},
                                "T_Device_Camera": {"Translation": [0.0, 0.0, 0.0], "UnitQuaternion": [1.0, [0.0, 0.0, 0.0]]}}]})
    camera = imported(plenocal, place, "calibration.json", text, "aria").cameras[0]
    # Its reader takes the file that is written back.
    plenocal.run(["export", place / "imported/calibration.yaml", "--format", "aria", "-o", place / "back.json"])
    theirs = calibration.device_calibration_from_json_string((place / "back.json").read_text()).get_camera_calib(label)
    points = directions(random, 60)
    return camera, points, np.array([theirs.project_no_checks(p) for p in points])


def mrcal_file(plenocal, place, model, numbers):
    """The camera of a file beside another one, whose frame is the rig's: CAHVOR's own is turned."""
    for name, lens, values in ("a", "LENSMODEL_PINHOLE", [500, 500, 640, 480]), ("b", model, numbers):
        (place / f"{name}.cameramodel").write_text(
            f"{{ 'lensmodel': '{lens}', 'intrinsics': [{', '.join(repr(float(v)) for v in values)}],\n"
            f"'extrinsics': [0, 0, 0, 0, 0, 0], 'imagersize': [{WIDTH}, {HEIGHT}] }}\n")
    plenocal.run(["import", place / "a.cameramodel", place / "b.cameramodel", "--format", "mrcal", "-o", place / "imported"])
    return plenocal.Calibration(place / "imported/calibration.yaml").cameras[1]


def cahvore(plenocal, random, place, name):
    """At 1 m: mrcal's projection takes all points as if they were there."""
    import mrcal
    model = f"LENSMODEL_{name}"
    r, e = random.uniform(-0.05, 0.05, 3), random.uniform(-0.01, 0.01, 3)
    numbers = [*intrinsics(random), *random.uniform(-0.05, 0.05, 2), *r, *e]
    camera = mrcal_file(plenocal, place, model, numbers)
    points = directions(random, 55)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return camera, points @ camera.T_camera_rig[:3, :3].T, mrcal.project(points, model, np.array(numbers))


def mrcal_lens(plenocal, random, place, name):
    """Splines inside the last full cells: beyond them mrcal goes on, and we refuse."""
    import mrcal
    is_spline = name.startswith("order")
    model = f"LENSMODEL_SPLINED_STEREOGRAPHIC_{name}_fov_x_deg=130" if is_spline else f"LENSMODEL_{name}"
    numbers, points = intrinsics(random), directions(random, 45 if is_spline else 85)
    if is_spline:
        columns, rows = (int(part.split("=")[1]) for part in name.split("_")[1:])
        numbers += list(random.uniform(-0.02, 0.02, 2 * columns * rows))
    return mrcal_file(plenocal, place, model, numbers), points, mrcal.project(points, model, np.array(numbers))


PROGRAMS = {
    "COLMAP (pycolmap)": ("pycolmap", colmap, list(COLMAP)),
    "Project Aria (projectaria-tools)": ("projectaria_tools", aria, list(ARIA)),
    "OpenCV": ("cv2", opencv14, ["14 coefficients"]),
    "mrcal (2.2; at 1 m)": ("mrcal", cahvore, [f"CAHVORE_linearity={L}" for L in ("0.00", "0.35", "1.00")]),
    "mrcal (2.2)": ("mrcal", mrcal_lens, ["LONLAT", "LATLON", "STEREOGRAPHIC"] +
                    [f"order={order}_Nx={size}" for order in (2, 3) for size in ("11_Ny=9", "30_Ny=20")]),
    "OpenCV contrib": ("cv2.omnidir", omnidir, ["omnidir, Kalibr omni-radtan"]),
}


def main():
    arguments = common.parser(__doc__, None)
    arguments.add_argument("--draws", type=int, default=200)
    arguments = arguments.parse_args()
    try:
        import plenocal
    except ImportError:
        sys.exit("no Python module plenocal: set PYTHONPATH to build/release/python, or install the wheel")
    common.head("program", "its model", "in Plenocal", "largest difference, px", "points")
    for program, (module, compare, names) in PROGRAMS.items():
        try:
            __import__(module.split(".")[0])
        except ImportError:
            print(f"no {module}: {program} is left out", file=sys.stderr)
            continue
        for name in names:
            random, largest, count, models = np.random.default_rng(1), 0.0, 0, set()
            for _ in range(arguments.draws):
                with common.folder() as place:
                    camera, points, seen = compare(plenocal, random, place, name)
                difference = np.linalg.norm(camera.project(points) - seen, axis=1)
                inside = np.isfinite(difference)
                largest = max(largest, difference[inside].max(initial=0))
                count += int(inside.sum())
                models.add(camera.model)
            common.row(program, f"`{name}`", ", ".join(f"`{model}`" for model in sorted(models)), f"{largest:.1e}", count)


if __name__ == "__main__":
    main()

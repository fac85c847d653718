# SPDX-License-Identifier: Apache-2.0
"""The cases of bench/honest: which standard errors there are, and a run of each case: `function(program, folder, seed)` gives
{what: (errors, standard errors)}, what being a key of KEYS."""
import contextlib
import copy
import dataclasses
import functools
import io
import json
import types
import typing

import numpy as np

import common
from accuracy import honest_points as hp
from accuracy import scene
from accuracy import tag_corners as tags
from accuracy.geometry import exp_rotation as exp
from accuracy.geometry import numbers, plenoptic_distortion, quaternion, read_poses, read_trajectory, transform
from accuracy.honest_points import Board, Camera, Rig, pair
from common import Failed, load, read_table, save
from data.net import SIMULATED


class Program:
    def __init__(self, path):
        self.path = path

    def __call__(self, *words, folder=None, statuses=(0,)):
        if words[0] not in ("handeye", "merge", "evaluate"):
            words += ("--threads", 1)
        if "--json" not in words:
            words += ("--quiet",)
        return common.run(self.path, *words, cwd=folder, statuses=statuses).stdout

    def calibrate(self, folder, out="out", session="session.yaml", more=()):
        self("calibrate", folder / session, "-o", folder / out, "--no-report", *more)
        return folder / out


# what: (section of docs/formats.md or page, names there)
KEYS = {
    "parameters": ("a camera in calibration.yaml", ["sigma"]),
    "joint": ("a camera in calibration.yaml", ["sigma", "correlation"]),
    "extrinsics": ("a camera in calibration.yaml", ["sigma_xi"]),
    "board pose": ("a target in calibration.yaml", ["sigma_xi"]),
    "jackknife": ("a camera in calibration.yaml", ["sigma_jackknife"]),
    "jackknife of extrinsics": ("a camera in calibration.yaml", ["sigma_xi_jackknife"]),
    "markers": ("every target", ["sigma"]),
    "point noise": ("residuals.csv", ["noise_sigma"]),
    "noise": ("`residuals`", ["noise"]),
    "jitter translation": ("`jitter`", ["translation"]),
    "jitter rotation": ("`jitter`", ["rotation"]),
    "time shift": ("a camera in calibration.yaml", ["sigma_time_shift"]),
    "direction": ("an item of `undetermined`", ["parameters"]),
    "open": ("an item of `undetermined`", ["sigma"]),
    "merge": ("merge.csv", ["sigma"]),
    "mounts": ("mounts.csv", ["sigma_x", "sigma_y", "sigma_z", "sigma_w_x", "sigma_w_y", "sigma_w_z"]),
    "predicted": ("compare.csv", ["predicted"]),
    "handeye": ("handeye.yaml", ["sigma_..."]),
    "handeye scale": ("handeye.yaml", ["sigma_scale"]),
    "handeye time shift": ("handeye.yaml", ["sigma_time_shift"]),
    "handeye scatter": ("handeye.yaml", ["scatter"]),
    "locate": ("locate -o", ["cov_x_x", "cov_w_z_w_z"]),
    "sigma_now": ("suggest --json", ["sigma_now", "sigma_before"]),
    "sigma_after": ("suggest --json", ["sigma_after"]),
    "model sigma": ("a model in try.yaml", ["sigma"]),
    "image_sigma": ("a model in try.yaml", ["image_sigma"]),
    "held out": ("`held_out`", ["sigma"]),
    "common noise": ("`residuals`", ["common_noise"]),
    "detections": ("detections", ["sigma"]),
    "detector": ("`residuals`", ["detector_sigma"]),
    "gain": ("Images", ["noise_<camera>.yaml", "gain", "read"]),
    "levels": ("Images", ["noise_<camera>.yaml", "levels"]),
    "lens types": ("`lens_types`", ["sigma_focal_length"]),
    "apertures": ("`lens_types`", ["sigma_aperture"]),
    "virtual depth": ("Images", ["virtual_depth_sigma.tiff"]),
    "depth": ("Images", ["<image>_depth_sigma.tiff"]),
    "segments": ("groundtruth", ["segment_covariance"]),
    "ambiguous end": ("groundtruth, or its refusal", ["segment_covariance"]),
    "truth scale": ("groundtruth", ["scale"]),
    "poses": ("groundtruth", ["covariance.csv"]),
    "floor": ("a metric in `errors_by_truth`", ["floor"]),
    "truth metric": ("a metric in `errors_by_truth`", ["sigma"]),
    "two truths": ("groundtruth_compare.csv", ["sigma"]),
    "response": ("response.csv", ["sigma"]),
    "vignetting": ("Images", ["vignetting_sigma_<camera>.tiff"]),
    "exposures": ("exposures.csv", ["sigma"]),
    "vignetting ratio": ("vignetting_compare.csv", ["sigma"]),
}
SIX = ("x", "y", "z", "w_x", "w_y", "w_z")
# Not a standard error but an RMS that is predicted: coverage has no meaning.
OF_RMS = {"predicted", "sigma_now", "sigma_after", "model sigma", "image_sigma", "floor", "response", "vignetting"}
OF_SCATTER = {"held out"}  # the truth is the mean of all runs
OF_SHARE = {"direction", "open", "ambiguous end"}  # no standard error but whether what is open is named right
MOST_WRONG = 0.05  # of these
OTHERS = [
    ("detections", ["x_shared_<n>", "y_shared_<n>"], "given by the detector: what the common error moves; its size is estimated"),
    ("`lattice_<camera>.yaml`", ["covariance"], "of polynomials, not of a result; by `tests/calib/camera/lattice_errors_test.cc`"),
    ("a camera in calibration.yaml", ["nuisances"], "by `tests/calib/plenoptic_test.cc`"),
    ("points.csv of triangulate", ["sigma_rho", "cov_x_x", "cov_z_z", "noise_x_x", "noise_z_z", "sigma_z_noise", "sigma_z_calibration"], "by `bench/space` and `tests/calib/space/point_fit_test.cc`"),
    ("shared.csv", ["c_1"], "the same"),
    ("measures.csv", ["sigma", "sigma_noise", "sigma_calibration"], "the same"),
    ("compare_space.csv", ["predicted"], "an RMS; by `tests/assess/space/compare_in_space_test.cc`"),
    ("bars.yaml", ["lines"], "`sigma` is given"),
    ("acceptance.csv", ["sigma_reference", "sigma", "in_sigmas"], "given; lengths as in measures.csv"),
    ("acceptance.json", ["chi_square", "scale_sigma"], "of these; by `tests/apps/space/accept_command_test.cc`"),
    ("accuracy.csv", ["sigma_z", "sigma_z_noise", "sigma_z_calibration", "sigma_lateral", "sigma_lateral_noise", "sigma_lateral_calibration", "sigma_bar_across", "sigma_bar_along"], "predictions of these; by `tests/assess/space/accuracy_test.cc`"),
    ("`adjustment`", ["rejection_sigmas"], "a threshold"),
    ("`adjustment`", ["marker_sigma"], "the prior as it was given"),
    ("chosen_frames.csv", ["blur"], "a width of edges"),
    ("`held` and `refined`", ["tolerance"], "the prior as it was given"),
    ("`held` and `refined`", ["sigma"], "as `sigma` of a model in try.yaml"),
    ("a model in try.yaml", ["projection"], "a quantile of what `image_sigma` is the RMS of"),
    ("a stress test in try.yaml", ["predicted"], "an RMS; by `bench/stress`"),
    ("try.csv", ["sigma", "image_sigma", "held_out_sigma"], "the numbers of try.yaml"),
    ("a camera in calibrate --json", ["sigma", "noise", "detector_sigma"], "the numbers of calibration.yaml"),
    ("an item of `extrinsics`", ["sigma"], "those of `sigma_xi`, carried on; `tests/calib/rig/extrinsics_test.cc`"),
    ("groundtruth", ["track_factor"], "a factor that is in the covariances"),
    ("handeye.yaml", ["calibration_errors"], "words"),
    ("merge.csv", ["in_sigmas"], "`deviation` / `sigma`"),
]
REASONS = {
    ("images of circles", "detections"): "contains .003 px for errors of the edge model, half of the noise here",
    ("images of circles", "detector"): "as of the detections",
    ("images of circles", "parameters"): "fits of ellipses have common errors of about .0005 px",
    ("pair, jackknife", "jackknife of extrinsics"): "a scatter of 20 frames has Student's t distribution",
    ("straight", "segments"): "tracks have no errors in common here, and the factor for common errors of neighbours is at least 1",
    ("vignette", "exposures"): "errors of .02 % that an image's points share (pose, spline, response) are not in the scatter of parts of the wall",
}


@dataclasses.dataclass
class Case:
    function: typing.Callable
    title: str
    rows: list
    runs: int
    quick: int
    simulated: bool = False


CASES = {}


def case(name, title, rows, runs, quick, simulated=False):
    def add(function):
        CASES[name] = Case(function, title, rows, runs, quick, simulated)
        return function
    return add


# --- calibrate, points ---

def measured(program, folder, random, rig, measure=None, more=(), **write):
    """What `calibrate` makes of points of the rig's frames."""
    rig.write(folder / "set", rig.measure(random, **(measure or {})), **write)
    return hp.compare(program.calibrate(folder / "set", more=more), rig)


def one_camera(program, folder, seed, model="pinhole-radial3", frames=15, board=None, **more):
    random = np.random.default_rng([seed, 1])
    rig = Rig({"cam": Camera(model, random=random)}, {"board": board(random) if board else Board()})
    rig.add_views(random, frames)
    return measured(program, folder, random, rig, **more)


def shared_in_frames(random, camera):
    """All points of a frame share a displacement that is linear in the image: blur by motion, a rolling shutter."""
    of_frame = {}
    return lambda frame, number, u: of_frame.setdefault(frame, random.normal(0, 0.15, (2, 2))) @ (2 * u / camera.size - 1)


def shared_by_markers(random, camera):
    """A marker is displaced by the same in all images of a camera."""
    of_marker = {}
    return lambda frame, number, u: of_marker.setdefault(number, random.normal(0, 0.1, 2))


ONE = ["parameters", "joint", "point noise"]
for name, title, rows, runs, quick, options in [
        ("ordinary", "one camera, 15 frames of a chessboard", [*ONE, "noise"], 200, 40, {}),
        ("fisheye", "one fisheye (kannala-brandt4), 15 frames", ONE, 200, 40, {"model": "kannala-brandt4"}),
        ("pupil", "one fisheye with a moving pupil (kannala-brandt4+pupil), 30 frames", ONE, 200, 40,
         {"model": "kannala-brandt4+pupil", "frames": 30}),
        ("few frames", "one camera, 4 frames", ONE, 200, 40, {"frames": 4}),
        ("outliers 5 %", "one camera, 5 % outliers of 3 to 40 px", ONE, 200, 40, {"measure": {"outliers": 0.05}}),
        ("outliers 20 %", "one camera, 20 % outliers of 3 to 40 px", ONE, 200, 40, {"measure": {"outliers": 0.2}}),
        ("uneven", "one camera, points of 0.03 to 0.33 px, stated", ONE, 200, 40, {"measure": {"uneven": True}}),
        ("uneven, not stated", "one camera, points of 0.03 to 0.33 px, no sigma stated", ["parameters", "joint"], 200, 40,
         {"measure": {"uneven": True}, "sigma": False}),
        ("misstated", "one camera, stated sigmas three times too large", ONE, 200, 40, {"measure": {"stated": 3.0}}),
        ("no loss", "one camera, `loss: none`", ["parameters", "joint"], 200, 40, {"options": {"loss": "none"}}),
        ("5 mm", "one camera, a target of 5 mm", ONE, 200, 40, {"board": lambda r: Board(square=0.0006)}),
        ("2 m", "one camera, a target of 2 m", ONE, 200, 40, {"board": lambda r: Board(square=0.25)}),
        ("refined", "one camera, a board made to 0.1 mm, refined", [*ONE, "markers"], 200, 40,
         {"frames": 20, "board": lambda r: Board(tolerance=1e-4, random=r)}),
        ("refined 5 mm", "a target of 5 mm made to 3 um, refined", [*ONE, "markers"], 200, 40,
         {"frames": 20, "board": lambda r: Board(square=0.0006, tolerance=3e-6, random=r)}),
        ("jackknife", "one camera, 20 frames, `--jackknife`", ["jackknife"], 200, 40, {"frames": 20, "more": ["--jackknife"]}),
        ("frames share", "one camera, points of a frame share a displacement", ["parameters"], 200, 40,
         {"frames": 20, "measure": {"shared": shared_in_frames}}),
        ("markers share", "one camera, a marker has one displacement in all frames", ["parameters"], 200, 40,
         {"frames": 20, "measure": {"shared": shared_by_markers}})]:
    case(name, title, rows, runs, quick)(lambda program, folder, seed, options=options: one_camera(program, folder, seed, **options))


@case("no tilt", "one camera, all frames parallel to the board", ["open"], 50, 20)
def _(program, folder, seed):
    random = np.random.default_rng([seed, 2])
    rig = Rig({"cam": Camera(random=random)}, {"board": Board()})
    rig.add_views(random, 15, tilt=0)
    rows = rig.measure(random)
    rig.write(folder / "set", rows)
    # An estimate that is far off along an open direction has another open direction: it is not compared.
    return {"open": openness(program.calibrate(folder / "set"), rig, rows)["open"]}


def openness(out, rig, rows):
    """Whether what is open by an independent normal matrix has a standard error as good as infinite, and nothing else, and is named."""
    names, S = rig.normal_matrix(rows)
    # Changes that make another camera: px; m, rad, 1.
    scale = np.array([20.0 if n.split(".")[1] in hp.PX else 0.05 for n in names])
    infinite = 100  # of these
    values, vectors = np.linalg.eigh(S * np.outer(scale, scale))
    null = vectors[:, values < infinite**-2]
    found = load(out / "calibration.yaml")
    wrong, at = [], {n: i for i, n in enumerate(names)}

    def check(parts, sigmas, scales):
        for part, sigma, scale in zip(np.linalg.norm(parts, axis=1), numbers(sigmas), scales):
            if part > 0.3 or part < 0.003:
                wrong.append(bool(sigma > infinite * scale) != (part > 0.3))

    def check_pose(prefix, T, sigmas):
        index = [at[f"{prefix}.{k}"] for k in SIX]
        chart = null[index]
        steps = [(hp.se3_log(hp.retract(T, d)) - hp.se3_log(hp.retract(T, -d))) / 2e-6 for d in 1e-6 * np.eye(6)]
        parts = np.array(steps).T @ chart
        # Where a translation is open, errors of the rotation turn some of it into each coordinate: only what is open counts.
        of_open = np.linalg.norm(parts, axis=1) > 0.3
        judged = of_open | (np.arange(6) >= 3) | ~of_open[:3].any()
        check(parts[judged], np.array(sigmas)[judged], scale[index][judged])
    for name, camera in rig.cameras.items():
        sigma = found["cameras"][name]["sigma"]
        index = [at[f"{name}.{k}"] for k in camera.p]
        check(null[index], [sigma[k] for k in camera.p], scale[index])
        if f"{name}.T_camera_rig.x" in at:
            check_pose(f"{name}.T_camera_rig", camera.T, found["cameras"][name]["sigma_xi"])
    for name, board in list(rig.boards.items())[1:]:
        check_pose(name, board.T, found["targets"][name]["sigma_xi"])
    named = []
    for item in found.get("undetermined", []):
        # Boards' poses may be named in other words; the direction among the cameras' unknowns is compared.
        d = np.array([float(item["parameters"].get(n, 0)) for n in names])
        cameras = np.array([n.split(".")[0] in rig.cameras for n in names])
        span = np.linalg.qr(null[cameras])[0]
        named.append(np.linalg.norm(span.T @ d[cameras]) < 0.95 * np.linalg.norm(d[cameras]) if null.size and d.any() else True)
    return {"direction": pair([not named if null.size else bool(named), *named], [1] * (1 + len(named))), "open": pair(wrong, [1] * len(wrong))}


# --- rigs ---

def pair_of_cameras(random, **more):
    T = transform(exp(random.normal(0, 0.03, 3)), [-0.1, 0, 0] + random.normal(0, 0.005, 3))
    return {"left": Camera(random=random, **more), "right": Camera("pinhole-radtan", T=T, random=random, **more)}


def y_turn(angle, t=(0, 0, 0)):
    return transform(exp([0, angle, 0]), t)


def ring(random, cameras, boards, tolerance=0.0, radius=0.7, model="pinhole-radial3"):
    """Boards around, cameras in their middle that look outward, 72 degrees apart."""
    step = 2 * np.pi / 5
    rig = Rig({}, {})
    for k in range(cameras):
        T_rig_camera = y_turn(k * step, y_turn(k * step)[:3, :3] @ [0, 0, 0.05] - [0, 0, 0.05]) if k else np.eye(4)
        rig.cameras[f"c{k}"] = Camera(model, T=np.linalg.inv(T_rig_camera), f=450, random=random)
    middle = None
    for k in range(boards):
        board = Board(8, 7 + k, 0.03, tolerance=tolerance, random=random)
        turn = y_turn(k * step + random.normal(0, 0.05))
        T_middle_own = turn @ transform(np.eye(3), [0, 0, radius] - board.centre)
        middle = np.linalg.inv(T_middle_own) if k == 0 else middle
        board.T = middle @ T_middle_own
        rig.boards[f"b{k}"] = board
    return rig


RIG = ["parameters", "joint", "extrinsics"]


def pair_case(program, folder, seed, **more):
    random = np.random.default_rng([seed, 3])
    rig = Rig(pair_of_cameras(random), {"board": Board()})
    rig.add_views(random, 20)
    return measured(program, folder, random, rig, **more)


case("pair", "a stereo pair, 20 frames", RIG, 200, 20)(pair_case)
case("pair, jackknife", "a stereo pair, 20 frames, `--jackknife`", ["jackknife of extrinsics"], 200, 20)(
    lambda *run: pair_case(*run, more=["--jackknife"]))


@case("collinear", "a stereo pair, the board on a straight slide, one orientation", RIG, 200, 20)
def _(program, folder, seed):
    random = np.random.default_rng([seed, 5])
    rig = Rig(pair_of_cameras(random), {"board": Board()})
    R = exp([0.5, 0.4, 0.1])
    for k in range(15):
        z = 0.4 + 0.04 * k
        rig.frames[f"{k:03}"] = transform(R, [0.05 + 0.005 * k, 0.01 * k - 0.07, z] - R @ rig.boards["board"].centre)
    return measured(program, folder, random, rig)


def ring_case(program, folder, seed, cameras=3, boards=3, frames=30, tolerance=0.0, **measure):
    random = np.random.default_rng([seed, 6, cameras, boards])
    rig = ring(random, cameras, boards, tolerance)
    rig.add_views(random, frames, distance=(1.6, 3.0))
    return measured(program, folder, random, rig, measure)


for name, title, rows, runs, quick, options in [
        ("ring", "ring of three cameras and three boards, 30 frames", [*RIG, "board pose"], 200, 10, {}),
        ("ring, 32 unknowns", "ring of two cameras and five boards: 37 unknowns a camera", [*RIG, "board pose"], 200, 16,
         {"cameras": 2, "boards": 5, "frames": 50}),
        ("ring, refined", "ring of three cameras and five boards made to 0.2 mm, refined", [*RIG, "board pose", "markers"], 150, 10,
         {"cameras": 3, "boards": 5, "frames": 50, "tolerance": 2e-4}),
        ("ring, outliers 20 %", "ring of three cameras and three boards, 20 % outliers", [*RIG, "board pose"], 150, 10, {"outliers": 0.2})]:
    case(name, title, rows, runs, quick)(lambda program, folder, seed, options=options: ring_case(program, folder, seed, **options))


def one_axis(program, folder, seed, wobble):
    """Two cameras without a common view, which move and turn on a table before two boards."""
    random = np.random.default_rng([seed, 7])
    rig = ring(random, 2, 2, model="pinhole")
    first = rig.boards["b0"]
    for k in range(24):
        angle = np.radians(-18 + 1.5 * k)
        T_middle_rig = transform(exp(random.normal(0, wobble, 3)) @ exp([0, angle, 0]), [random.uniform(-0.06, 0.06), 0, random.uniform(-0.06, 0.06)])
        T_first_middle = np.linalg.inv(transform(np.eye(3), [0, 0, 0.7] - first.centre))
        rig.frames[f"{k:03}"] = np.linalg.inv(T_first_middle @ T_middle_rig)
    rows = rig.measure(random)
    rig.write(folder / "set", rows)
    return rig, rows, program.calibrate(folder / "set")


@case("one axis", "two cameras without a common view turned about one axis", ["extrinsics", "board pose", "direction", "open"], 100, 20)
def _(program, folder, seed):
    rig, rows, out = one_axis(program, folder, seed, 0.0)
    return {**hp.compare(out, rig), **openness(out, rig, rows)}


@case("nearly one axis", "two cameras without a common view turned about nearly one axis (1 degree)", ["extrinsics", "board pose"], 200, 10)
def _(program, folder, seed):
    rig, _, out = one_axis(program, folder, seed, np.radians(1))
    return hp.compare(out, rig)


@case("jitter", "a pair that is not synchronous: 0.5 mm, 1 mrad", [*RIG, "jitter translation", "jitter rotation"], 200, 15)
def _(program, folder, seed):
    random = np.random.default_rng([seed, 8])
    rig = Rig(pair_of_cameras(random), {"board": Board()})
    rig.add_views(random, 30)
    deltas = {}

    def pose(camera, frame):
        deltas[camera, frame] = np.concatenate([random.normal(0, 5e-4, 3), random.normal(0, 1e-3, 3)])
        return hp.retract(rig.frames[frame], deltas[camera, frame])
    rig.write(folder / "set", rig.measure(random, poses_of=pose))
    out = program.calibrate(folder / "set")
    jitter = load(out / "calibration.yaml").get("jitter")
    values = hp.compare(out, rig)
    if jitter:
        d = np.array(list(deltas.values()))
        for what, part in (("translation", d[:, :3]), ("rotation", d[:, 3:])):
            values[f"jitter {what}"] = pair(part, np.full(part.shape, float(jitter[what])))
    return values


# --- motion by a hand, clocks, robots ---

def hand(random, board, distance=0.6):
    """T_rig_first by time of a hand that moves the rig before the board: sums of sinusoids of 0.1 to 0.5 Hz."""
    waves = [(random.uniform(0.1, 0.5, 3), random.uniform(0, 2 * np.pi, 3)) for _ in range(6)]
    size = np.array([0.06, 0.05, 0.12, 0.25, 0.25, 0.3]) / 1.5

    def pose(t):
        q = size * [np.sin(2 * np.pi * f * t + phase).sum() for f, phase in waves]
        return transform(exp(q[3:]), [*q[:2], distance + q[2]] - exp(q[3:]) @ board.centre)
    return pose


def time_shift_case(program, folder, seed, rate, frames=80):
    random = np.random.default_rng([seed, 9, rate])
    rig = Rig(pair_of_cameras(random), {"board": Board()})
    pose, offset, shift = hand(random, rig.boards["board"]), 0.012, 0.004
    rig.frames = {f"{k:03}": pose(k / rate) for k in range(frames)}
    rows = rig.measure(random, poses_of=lambda c, f: pose(int(f) / rate + (offset + shift if c == "right" else 0)))
    rig.write(folder / "set", rows, cameras={c: {"times": f"times_{c}.txt"} for c in rig.cameras})
    for c, late in (("left", 0), ("right", offset)):
        (folder / f"set/times_{c}.txt").write_text("".join(f"{k:03} {100 + k / rate + late:.9f}\n" for k in range(frames)))
    out = program.calibrate(folder / "set")
    right = load(out / "calibration.yaml")["cameras"]["right"]
    values = hp.compare(out, rig)
    if "time_shift" in right:
        values["time shift"] = pair([float(right["time_shift"]) - shift], [float(right["sigma_time_shift"])])
    return values


for rate, runs in ((20, 400), (8, 400)):
    case(f"clocks, {rate} Hz", f"a hand-held pair, {rate} Hz, clocks 4 ms apart", ["time shift", "extrinsics"], runs, 8)(
        lambda program, folder, seed, rate=rate: time_shift_case(program, folder, seed, rate))


def pose_text(T, separator):
    return separator.join(f"{v:.12g}" for v in [*T[:3, 3], *quaternion(T[:3, :3])])


def handeye(program, folder, seed, motion, log_rate=None, in_step=False, scale=False):
    """A camera on a gripper whose poses have errors of 0.3 mm and 0.3 mrad; logged by frame or by time. `in_step`: each image is at
    the time of a logged pose."""
    random = np.random.default_rng([seed, 10, log_rate or 0, motion == "views"])
    rig = Rig({"cam": Camera(random=random)}, {"board": Board()})
    stated = Board(square=0.0303) if scale else rig.boards["board"]
    X = transform(exp(random.normal(0, 1, 3)), random.normal(0, 0.08, 3))  # T_gripper_rig
    Z = transform(exp(random.normal(0, 1, 3)), random.normal(0, 0.5, 3))   # T_base_target
    rate, shift, count = 10, 0.037, 60
    if motion == "views":
        rig.add_views(random, 30)
    elif motion == "axis":
        about = exp(random.normal(0, 1, 3))[0]
        start = rig.view(random, "cam", "board", (2.0, 2.2), tilt=0.2)
        while len(rig.frames) < 25:
            turn = transform(np.eye(3), rig.boards["board"].centre) @ transform(exp(about * random.uniform(-0.5, 0.5)), random.uniform(-0.03, 0.03, 3))
            T = start @ turn @ transform(np.eye(3), -rig.boards["board"].centre)
            if not np.isnan(rig.seen("cam", T, "board")).any():
                rig.frames[f"{len(rig.frames):03}"] = T
    else:
        pose = hand(random, rig.boards["board"])
        rig.frames = {f"{k:03}": pose(k / rate) for k in range(count)}
    rows = rig.measure(random)
    truth, rig.boards["board"] = rig.boards["board"], stated
    rig.write(folder / "set", rows)
    rig.boards["board"] = truth
    out = program.calibrate(folder / "set")

    def gripper(T_rig_target):
        T = Z @ np.linalg.inv(T_rig_target) @ np.linalg.inv(X)
        errors.append((random.normal(0, 3e-4, 3), random.normal(0, 3e-4, 3)))
        return transform(T[:3, :3] @ exp(errors[-1][1]), T[:3, 3] + errors[-1][0])

    errors, more = [], ["--scale"] if scale else []
    if log_rate:
        # An image at time t of its clock is at t + shift of the robot's.
        times = np.arange(-0.5, count / rate + 0.5, 1 / log_rate)
        if not in_step:
            times += (random.uniform() + random.uniform(-0.2, 0.2, len(times))) / log_rate
        (folder / "log.txt").write_text("".join(f"{100 + t + shift:.9f} {pose_text(gripper(pose(t)), ' ')}\n" for t in times))
        (folder / "times.txt").write_text("".join(f"{k:03} {100 + k / rate:.9f}\n" for k in range(count)))
        more += ["--times", folder / "times.txt"]
    else:
        lines = [f"{name},{pose_text(gripper(T), ',')}" for name, T in rig.frames.items()]
        (folder / "log.txt").write_text("\n".join(["frame,x,y,z,qx,qy,qz,qw", *lines]) + "\n")
    program("handeye", out, "--poses", folder / "log.txt", "-o", folder / "handeye.yaml", *more)
    found = load(folder / "handeye.yaml")
    values = {"handeye": pair([], [])}
    for name, true in (("gripper_rig", X), ("base_target", Z)):
        e, s = hp.chart(np.array(found[f"T_{name}"], float), true), numbers(found[f"sigma_{name}"])
        values["handeye"] = pair([*values["handeye"][0], *e], [*values["handeye"][1], *s])
    if scale:
        values["handeye scale"] = pair([float(found["scale"]) - 1 / 1.01], [float(found["sigma_scale"])])
    if log_rate and "time_shift" in found:
        values["handeye time shift"] = pair([float(found["time_shift"]) - shift], [float(found["sigma_time_shift"])])
    if not log_rate:
        values["handeye scatter"] = pair([errors], [[[float(found["scatter"]["translation"])] * 3, [float(found["scatter"]["rotation"])] * 3]] * len(errors))
    return values


for name, title, rows, runs, quick, options in [
        ("robot", "a camera on a robot, poses with errors of 0.3 mm", ["handeye", "handeye scatter"], 200, 15, {"motion": "views"}),
        ("robot, scale", "a camera on a robot, target of unknown size", ["handeye", "handeye scale"], 400, 15, {"motion": "views", "scale": True}),
        ("robot, one axis", "a gripper that turns about one axis", ["handeye"], 100, 20, {"motion": "axis"}),
        *((f"robot, {rate} Hz", f"a robot's log of {rate} Hz with errors of 0.3 mm", ["handeye", "handeye time shift"], 400, 8,
           {"motion": "hand", "log_rate": rate}) for rate in (50, 100, 200)),
        ("robot, 100 Hz, in step", "a robot's log of 100 Hz, each image at the time of a logged pose", ["handeye", "handeye time shift"], 400, 8,
         {"motion": "hand", "log_rate": 100, "in_step": True})]:
    case(name, title, rows, runs, quick)(lambda program, folder, seed, options=options: handeye(program, folder, seed, **options))


# --- calibrations from calibrations ---

def days(program, folder, random, names="ab", moved=False):
    """One rig, calibrated once a day; `moved`: its right camera elsewhere on the second day."""
    rig, places, results = Rig(pair_of_cameras(random), {"board": Board()}), [], []
    for day in names:
        if day == "b" and moved:
            rig.cameras["right"].T = hp.retract(rig.cameras["right"].T, np.full(6, 0.002))
        places.append(rig.cameras["right"].T)
        rig.frames = {}
        rig.add_views(random, 12)
        rig.write(folder / day, rig.measure(random))
        results.append(program.calibrate(folder / day, f"../out_{day}"))
    return rig, places, results


@case("merged", "two calibrations of a pair, merged", ["parameters", "extrinsics", "merge", "predicted"], 200, 12)
def _(program, folder, seed):
    random = np.random.default_rng([seed, 11])
    rig, _, (a, b) = days(program, folder, random)
    program("merge", a, b, "-o", folder / "merged")
    values = hp.compare(folder / "merged", rig)
    rows = read_table(folder / "merged/merge.csv")
    values["merge"] = pair([float(r["deviation"]) for r in rows], [float(r["sigma"]) for r in rows])
    program("compare", a / "calibration.yaml", b / "calibration.yaml", "-o", folder / "compared", statuses=(0, 1))
    rows = [r for r in read_table(folder / "compared/compare.csv") if r["part"] == "all" and r["predicted"]]
    values["predicted"] = pair([float(r["rms"]) for r in rows], [float(r["predicted"]) for r in rows])
    return values


@case("merged, moved", "a camera that was moved between them, `merge --moved`", ["mounts"], 200, 8)
def _(program, folder, seed):
    random = np.random.default_rng([seed, 12])
    _, places, (a, b) = days(program, folder, random, moved=True)
    program("merge", a, b, "--moved", "right", "-o", folder / "merged")
    errors, sigmas = [], []
    for row, T in zip(read_table(folder / "merged/mounts.csv"), places):
        errors += [float(row[k]) - v for k, v in zip(SIX, hp.se3_log(T))]
        sigmas += [float(row[f"sigma_{k}"]) for k in SIX]
    return {"mounts": pair(errors, sigmas)}


@case("from", "a pair calibrated `from` an earlier calibration, 5 frames", RIG, 200, 10)
def _(program, folder, seed):
    random = np.random.default_rng([seed, 13])
    rig, *_ = days(program, folder, random, "a")
    rig.frames = {}
    rig.add_views(random, 5)
    return measured(program, folder, random, rig, session={"from": "../out_a/calibration.yaml"})


@case("prior", "one camera, 4 frames, a prior on `f_x` and `c_x`", ["parameters", "joint"], 200, 12)
def _(program, folder, seed):
    random = np.random.default_rng([seed, 14])
    camera = Camera(random=random)
    prior = {k: {"value": float(camera.p[k] + random.normal(0, s)), "sigma": s} for k, s in (("f_x", 1.0), ("c_x", 0.5))}
    rig = Rig({"cam": camera}, {"board": Board()})
    rig.add_views(random, 4)
    return measured(program, folder, random, rig, cameras={"cam": {"prior": prior}})


# --- what a calibration predicts ---

def projection_error(camera, parameters, distances, pixels):
    """RMS length by which the camera's projection is off there, less the best small motion of the camera."""
    rays = hp.rays(camera, pixels)
    rays = rays[np.isfinite(rays[:, 0])]
    X = np.vstack([np.hstack([rays, np.ones((len(rays), 1))]) * d for d in distances])
    difference = hp.project(camera.model, parameters, X) - hp.project(camera.model, camera.p, X)
    J = []
    for j in range(6):
        d = 1e-6 * np.eye(6)[j]
        moved = [hp.project(camera.model, camera.p, X @ exp(s * d[3:]).T + s * d[:3]) for s in (1, -1)]
        J.append(((moved[0] - moved[1]) / 2e-6).ravel())
    d, J = difference.ravel(), np.array(J).T
    keep = np.isfinite(d) & np.isfinite(J).all(1)
    rest = d[keep] - J[keep] @ np.linalg.lstsq(J[keep], d[keep], rcond=None)[0]
    return np.sqrt(2 * np.mean(rest**2))


def grid_of(camera, columns, rows):
    w, h = camera.size
    return [((i + 0.5) * w / columns - 0.5, (j + 0.5) * h / rows - 0.5) for j in range(rows) for i in range(columns)]


def parameters_of(out, name):
    return {k: float(v) for k, v in load(out / "calibration.yaml")["cameras"][name]["parameters"].items()}


@case("suggest", "one camera, 6 frames, then the view that is suggested", ["sigma_now", "sigma_after"], 200, 20)
def _(program, folder, seed):
    random = np.random.default_rng([seed, 15])
    rig = Rig({"cam": Camera(random=random)}, {"board": Board()})
    rig.add_views(random, 6)
    rig.write(folder / "set", rig.measure(random))
    out = program.calibrate(folder / "set")
    found = json.loads(program("suggest", out, "--count", 1, "--json"))
    if not found["views"] or found["views"][0]["criterion"] != "sigma":
        return {}
    where = (found["distances"], grid_of(rig.cameras["cam"], 16, 12))
    values = {"sigma_now": pair([projection_error(rig.cameras["cam"], parameters_of(out, "cam"), *where)], [found["sigma_now"]])}
    rig.frames["next"] = np.array(found["views"][0]["T_camera_target"], float)
    rig.write(folder / "set", rig.measure(random))
    after = program.calibrate(folder / "set", "after")
    values["sigma_after"] = pair([projection_error(rig.cameras["cam"], parameters_of(after, "cam"), *where)], [found["views"][0]["sigma_after"]])
    return values


@case("try", "one camera, 12 frames, three models", ["model sigma", "image_sigma", "held out"], 200, 20)
def _(program, folder, seed):
    random = np.random.default_rng([seed, 16])
    camera = Camera("pinhole-radtan", random=np.random.default_rng(16))
    rig = Rig({"cam": camera}, {"board": Board()})
    rig.add_views(random, 12)
    rows = rig.measure(random)
    rig.write(folder / "set", rows)
    program("try", folder / "set/session.yaml", "--models", "pinhole-radtan,pinhole-radtan4,pinhole-radial3", "-o", folder / "tried")
    model = load(folder / "tried/try.yaml")["models"]["pinhole-radtan"]
    distances = np.concatenate([(rig.boards["board"].points @ T[2, :3] + T[2, 3]) for T in rig.frames.values()])
    found = parameters_of(program.calibrate(folder / "set"), "cam")
    # Supported: cells of a grid of 30 x 20 with points, and gaps between them.
    size = np.array(camera.size) / [30, 20]
    cells = np.zeros((30, 20), bool)
    for _, _, x, y, _ in rows["cam"]:
        cells[tuple(np.clip(((np.array([x, y]) + 0.5) / size).astype(int), 0, [29, 19]))] = True
    grown = lambda c: np.any([np.roll(np.pad(c, 2), (i, j), (0, 1))[2:-2, 2:-2] for i in (-1, 0, 1) for j in (-1, 0, 1)], 0)
    supported = ~grown(~grown(cells)) | cells
    inside = [((i + 0.5) * size[0] - 0.5, (j + 0.5) * size[1] - 0.5) for i, j in np.argwhere(supported)]
    values = {"image_sigma": pair([projection_error(camera, found, [np.median(distances)], grid_of(camera, 30, 20))], [model["image_sigma"]]),
              "model sigma": pair([projection_error(camera, found, np.quantile(distances, [0.1, 0.9]), inside)], [model["sigma"]])}
    values["held out"] = pair([model["held_out"]["rms"]], [model["held_out"]["sigma"]])
    return values


@case("locate", "a pose before 40 known points, 0.3 px", ["locate"], 100, 10)
def _(program, folder, seed):
    random = np.random.default_rng([seed, 17])
    camera, points = Camera(random=random), random.uniform([-2, -1.5, 2.5], [2, 1.5, 6], (40, 3))
    (folder / "map.csv").write_text("marker,x,y,z\n" + "".join(f"{i},{x:.9f},{y:.9f},{z:.9f}\n" for i, (x, y, z) in enumerate(points)))
    save(folder / "calibration.yaml", {"cameras": {"cam": {
        "model": camera.model, "image_size": list(camera.size), "parameters": {k: float(v) for k, v in camera.p.items()},
        "T_camera_rig": np.eye(4).tolist()}}})
    lines, truth = ["frame,marker,x,y,sigma"], {}
    for k in range(8):
        T = transform(exp(random.normal(0, 0.15, 3)), random.normal(0, 0.3, 3))  # T_camera_map
        truth[f"{k:03}"] = np.linalg.inv(T)
        u = camera.points(points @ T[:3, :3].T + T[:3, 3])
        lines += [f"{k:03},{i},{x:.5f},{y:.5f},0.3" for i, (x, y) in enumerate(u + random.normal(0, 0.3, u.shape)) if np.isfinite(x)]
    (folder / "points.csv").write_text("\n".join(lines) + "\n")
    errors = []
    for found in json.loads(program("locate", folder / "calibration.yaml", folder / "map.csv", folder / "points.csv", "--json")):
        q = found["quaternion"]
        w, v = q[3], np.array(q[:3])
        angle = 2 * np.arctan2(np.linalg.norm(v), w)
        T = transform(exp(v / np.linalg.norm(v) * angle), found["translation"])
        e = hp.se3_log(T) - hp.se3_log(truth[found["image"]])
        errors.append(np.linalg.solve(np.linalg.cholesky(np.array(found["covariance"])), e))
    return {"locate": pair(errors, np.ones((len(errors), 6)))}


# --- plenoptic camera, points ---

class Plenoptic(Camera):
    """A hexagonal array before a thin lens (docs/plenoptic.md)."""
    pixel, pitch = 7.4e-6, 19.0

    def __init__(self, random):
        self.model, self.size, self.T = "focused-plenoptic", (1500, 1500), np.eye(4)
        self.p = {"f_L": 0.016, "b_L0": 0.015254, "B": 0.000378, "c_x": 749.5 + 4 * random.normal(), "c_y": 749.5 + 4 * random.normal(),
                  "A_0": -100.0, "A_1": 4e5, "B_0": 0.03, "B_1": -0.02}
        basis = self.pitch * self.pixel * np.array([[1, 0.5], [0, np.sqrt(0.75)]])
        nodes = np.stack(np.meshgrid(np.arange(-60, 61), np.arange(-60, 61)), -1).reshape(-1, 2)
        self.centres = nodes @ basis.T
        self.centres = self.centres[np.abs(self.centres).max(1) < 740 * self.pixel]

    def pixels(self, x):
        return (x + plenoptic_distortion(x, self.p)) / self.pixel + [self.p["c_x"], self.p["c_y"]]

    def seen(self, X):
        """Image points and centres of the micro images that show one point within 0.35 pitches of their centres."""
        p = self.p
        b_L = p["f_L"] * X[2] / (X[2] - p["f_L"])
        v = (b_L - p["b_L0"]) / p["B"]
        x_R = X[:2] * b_L / X[2] / v + self.centres * p["b_L0"] / (p["b_L0"] + p["B"]) * (1 - 1 / v)
        near = np.linalg.norm(x_R - self.centres, axis=1) < 0.35 * self.pitch * self.pixel
        return self.pixels(x_R[near]), self.pixels(self.centres[near])


@case("plenoptic", "a plenoptic camera, 15 frames, points of a marker with a common error", ["parameters", "joint", "common noise"], 150, 12)
def _(program, folder, seed):
    random = np.random.default_rng([seed, 18])
    camera, board, own, common = Plenoptic(random), Board(8, 6, 0.02), 0.1, 0.05
    rig, shared = Rig({"cam": camera}, {"board": board}), []
    lines = ["frame,marker,x,y,lens_x,lens_y,sigma"]
    for k in range(15):
        z, around = random.uniform(0.3, 0.9), random.uniform(0, 2 * np.pi)
        R = exp(random.uniform(0, 0.7) * np.array([np.cos(around), np.sin(around), 0])) @ exp([0, 0, random.uniform(-1, 1)])
        t = np.array([*(random.uniform(-0.18, 0.18, 2) * z), z]) - R @ board.centre
        for number, X in enumerate(board.points @ R.T + t):
            u, lens = camera.seen(X)
            if len(u) < 2:
                continue
            shared.append(random.normal(0, common, 2))
            for a, b in zip(u + random.normal(0, own, u.shape) + shared[-1], lens):
                lines.append(f"{k:03},{number},{a[0]:.5f},{a[1]:.5f},{b[0]:.5f},{b[1]:.5f},{own}")
    rig.truth = {}
    rig.write(folder / "set", {"cam": []}, cameras={"cam": {"pixel_size": camera.pixel}})
    (folder / "set/detections_cam.csv").write_text("\n".join(lines) + "\n")
    out = program.calibrate(folder / "set")
    stated = float(load(out / "calibration.yaml")["cameras"]["cam"]["residuals"]["common_noise"])
    return {**hp.compare(out, rig), "common noise": pair(shared, np.full((len(shared), 2), stated))}


# --- images ---

@functools.lru_cache(maxsize=4)
def sub_rays(size, parameters, samples):
    camera = Camera(size=size)
    camera.p = dict(parameters)
    x, y = np.meshgrid(*((np.arange(n * samples) + 0.5) / samples - 0.5 for n in size))
    return hp.rays(camera, np.stack([x, y], -1).reshape(-1, 2))


def picture(random, camera, T, colour, samples=3, blur=0.6, full_well=10000):
    """Grey image of 8 bits of a plane whose light is `colour(x, y, width of a sample)`, with photon noise; T_camera_plane."""
    m = sub_rays(camera.size, tuple(camera.p.items()), samples)
    ray = np.hstack([m, np.ones((len(m), 1))])
    R, t = T[:3, :3], T[:3, 3]
    z = (R[:, 2] @ t) / (ray @ R[:, 2])
    X = (ray * z[:, None] - t) @ R
    w, h = camera.size
    light = colour(X[:, 0], X[:, 1], z / camera.p["f_x"] / samples).reshape(h, samples, w, samples).mean((1, 3))
    taps = np.exp(-0.5 * (np.arange(-3, 4) / blur)**2)
    for axis in (0, 1):
        padded = np.pad(light, [(3, 3) if a == axis else (0, 0) for a in (0, 1)], mode="edge")
        light = sum(k * np.take(padded, np.arange(i, i + light.shape[axis]), axis) for i, k in enumerate(taps / taps.sum()))
    electrons = 0.8 * full_well * light
    electrons += random.normal(0, 1, light.shape) * np.sqrt(electrons + 64)
    return np.clip(np.rint(electrons * 255 / full_well), 0, 255).astype(np.uint8)


def chessboard(square, columns, rows):
    def wave(x, width):  # +-1 by turns, over the edges a ramp as wide as a sample
        nearest = np.rint(x / square)
        return (1 - 2 * (nearest % 2)) * np.clip(2 * (x - nearest * square) / width, -1, 1)

    def colour(x, y, width):
        inside = (x > -square) & (y > -square) & (x < columns * square) & (y < rows * square)
        return np.where(inside, 0.48 - 0.42 * wave(x, width) * wave(y, width), 0.9)
    return colour


def circles(spacing, columns, rows):
    def colour(x, y, width):
        i, j = np.clip(np.rint(x / spacing), 0, columns - 1), np.clip(np.rint(y / spacing), 0, rows - 1)
        return 0.48 + 0.42 * np.clip(2 * (np.hypot(x - i * spacing, y - j * spacing) - 0.3 * spacing) / width, -1, 1)
    return colour


def images_case(program, folder, seed, kind):
    random = np.random.default_rng([seed, 19])
    camera = Camera("pinhole-radial3", (480, 360), 420, random=np.random.default_rng(19))  # one, as its rays take long
    rig = Rig({"cam": camera}, {"board": Board(8, 5, 0.03)})
    rig.add_views(random, 10, distance=(1.5, 2.8), tilt=0.6, roll=0.3)
    rig.measure(random, noise=0)
    board = rig.boards["board"]
    colour = (chessboard if kind == "chessboard" else circles)(board.square, board.columns, board.rows)
    (folder / "images").mkdir()
    for name, T in rig.frames.items():
        hp.write_png(folder / f"images/{name}.png", picture(random, rig.cameras["cam"], T, colour))
    target = board.yaml()
    if kind == "circles":
        target = {"type": "circles", "columns": 8, "rows": 5, "spacing": 0.03, "pattern": "symmetric"}
    save(folder / "session.yaml", {"target": target, "cameras": {"cam": {"model": "pinhole-radial3", "images": "images/*.png"}},
                                   "options": {"refine_target": False}})
    out = program.calibrate(folder)
    errors, sigmas = [], []
    for r in read_table(out / "detections_cam.csv"):
        true = rig.truth.get(("cam", r["frame"], int(r["marker"])))
        if true is not None:
            errors.append(np.array([float(r["x"]), float(r["y"])]) - true[0])
            sigmas.append([float(r["sigma"])] * 2)
    stated = float(load(out / "calibration.yaml")["cameras"]["cam"]["residuals"]["detector_sigma"])
    rig.truth = {key: (u, u) for key, (u, _) in rig.truth.items()}
    values = hp.compare(out, rig)
    return {**values, "detections": pair(errors, sigmas), "detector": pair(errors, np.full((len(errors), 2), stated))}


for kind in ("chessboard", "circles"):
    case(f"images of a {kind}" if kind == "chessboard" else "images of circles", f"10 images of {'a chessboard' if kind == 'chessboard' else 'circles'}, 480 x 360 px",
         ["detections", "detector", "parameters"], 100, 8)(lambda program, folder, seed, kind=kind: images_case(program, folder, seed, kind))


@case("images of tags", "12 images of tags", ["detections"], 12, 1, simulated=True)
def _(program, folder, seed):
    board, lens = list(tags.BOARDS)[seed % 3], list(tags.LENSES)[seed % 2]
    tags.simulate(program.path, folder, tags.loose_tags(*tags.BOARDS[board]), lens, 0.7, seed, tags.POSES)
    program("detect", "set/session.yaml", "-o", "out", folder=folder)
    truth, found = (tags.read_corners(folder / f) for f in ("set/truth/detections_cam.csv", "out/detections_cam.csv"))
    rows = [(x - truth[c][0], y - truth[c][1], s) for c, (x, y, s) in found.items() if c in truth]
    rows = [r for r in rows if np.hypot(*r[:2]) < tags.WRONG]
    return {"detections": pair([r[:2] for r in rows], [[r[2]] * 2 for r in rows])}


def inside_board(T_camera_target, m, size, margin):
    """Depth z of the target's plane on rays (m, 1), and which of them meet the board."""
    ray = np.hstack([m, np.ones((len(m), 1))])
    R, t = T_camera_target[:3, :3], T_camera_target[:3, 3]
    z = (R[:, 2] @ t) / (ray @ R[:, 2])
    X = (ray * z[:, None] - t) @ R
    return z, ((X[:, :2] > margin) & (X[:, :2] < np.array(size) - margin)).all(1)


@case("plenoptic images", "12 images of tags before a plenoptic camera of 480 x 480 px", ["parameters", "detections", "lens types", "apertures",
                                                                                         "virtual depth", "depth"], 45, 1, simulated=True)
def _(program, folder, seed):
    import cv2  # of float TIFF
    camera = copy.deepcopy(SIMULATED["cameras"]["plenoptic"])
    camera.pop("xi_camera_rig")
    board = {"type": "aprilgrid", "columns": 5, "rows": 5, "size": 0.05, "spacing": 0.3}
    common.simulate(program.path, folder, {"seed": seed, "white_images": 3, "target_error": 0, "cameras": {"cam": camera}, "poses": {
        "frames": 12, "distance": [0.36, 0.6], "partial": 0}}, "--threads", 1, target=board)
    out = program.calibrate(folder / "set")
    rig = Rig({"cam": Camera()}, {})
    rig.truth, rig.cameras["cam"].p = {}, camera["parameters"]
    values, p = hp.compare(out, rig), camera["parameters"]
    key = lambda r: (r["frame"], r["marker"], round(float(r["lens_x"]) / 4), round(float(r["lens_y"]) / 4))
    truth = {key(r): r for r in read_table(folder / "set/truth/detections_cam.csv")}
    rows = [(r, truth[key(r)]) for r in read_table(out / "detections_cam.csv") if key(r) in truth]
    values["detections"] = pair([[float(r[k]) - float(t[k]) for k in "xy"] for r, t in rows], [[float(r["sigma"])] * 2 for r, _ in rows])
    types = load(out / "calibration.yaml")["cameras"]["cam"].get("lens_types", [])
    shrink = p["b_L0"] / (p["b_L0"] + p["B"])
    true_f = np.sort([p["B"] * shrink / (1 - 1 / v) for v in camera["micro_lenses"]["focus"]])
    if len(types) == 3:
        types.sort(key=lambda t: float(t["focal_length"]))
        values["lens types"] = pair([float(t["focal_length"]) - f for t, f in zip(types, true_f)], [t["sigma_focal_length"] for t in types])
        D = 0.7 * camera["micro_lenses"]["pitch"] * camera["pixel_size"] * shrink
        values["apertures"] = pair([float(t["aperture"]) - D for t in types], [t["sigma_aperture"] for t in types])
    frame = sorted((folder / "set/cam").glob("*.png"))[0]
    T = np.linalg.inv(read_poses(folder / "set/truth/poses.csv")[frame.stem])
    size = np.full(2, 5 * 0.05 + 4 * 0.015)
    program("focus", frame, "--white", folder / "set/cam_white", "-o", folder / "focus")
    depth, sigma = (cv2.imread(str(folder / f"focus/{n}.tiff"), -1).astype(float) for n in ("virtual_depth", "virtual_depth_sigma"))
    at = load(folder / "focus/focused.yaml")
    y, x = np.nonzero(np.isfinite(depth))
    raw = numbers(at["offset"]) + float(at["scale"]) * np.stack([x, y], 1)
    m = (raw - [p["c_x"], p["c_y"]]) * camera["pixel_size"] / (p["b_L0"] + p["B"])
    z, inside = inside_board(T, m, size, 0.005)
    v = (p["b_L0"] + p["B"]) / p["B"] * (1 - p["b_L0"] / p["f_L"] + p["b_L0"] / z)
    thin = np.flatnonzero(inside)[::37]
    values["virtual depth"] = pair((depth[y, x] - v)[thin], sigma[y, x][thin])
    program("undistort", folder / "set/truth/calibration.yaml", frame, "-o", folder / "flat")
    depth, sigma = (cv2.imread(str(folder / f"flat/{frame.stem}_{n}.tiff"), -1).astype(float) for n in ("depth", "depth_sigma"))
    new = load(folder / "flat/calibration.yaml")["cameras"]["cam"]["parameters"]
    y, x = np.nonzero(np.isfinite(depth))
    z, inside = inside_board(T, np.stack([(x - new["c_x"]) / new["f_x"], (y - new["c_y"]) / new["f_y"]], 1), size, 0.005)
    thin = np.flatnonzero(inside)[::37]
    values["depth"] = pair((depth[y, x] - z)[thin], sigma[y, x][thin])
    return values


@case("sensor", "5 white images, gain and read noise", ["gain", "levels"], 250, 20)
def _(program, folder, seed):
    random = np.random.default_rng([seed, 20])
    gain, read, (w, h) = 0.05, 1.2, (200, 150)
    x, y = np.meshgrid(np.linspace(-1, 1, w), np.linspace(-1, 1, h))
    mean = 180 * (1 - 0.6 * (x**2 + y**2) / 2)
    (folder / "white").mkdir()
    for k in range(5):
        grey = mean + random.normal(0, 1, mean.shape) * np.sqrt(gain * mean + read**2)
        hp.write_png(folder / f"white/{k}.png", np.clip(np.rint(grey), 0, 255).astype(np.uint8))
    program("white", folder / "white", "--model", "pinhole", "--camera", "cam", "-o", folder / "out")
    found = load(folder / "out/noise_cam.yaml")
    rounding = 1 / 12  # variance of rounding to whole grey values
    truth = (gain, np.sqrt(read**2 + rounding))
    values = {"gain": pair([float(found[k]["value"]) - t for k, t in zip(("gain", "read"), truth)], [found[k]["sigma"] for k in ("gain", "read")])}
    levels = np.array(found["levels"], float)
    values["levels"] = pair(levels[:, 1] - (gain * levels[:, 0] + read**2 + rounding), levels[:, 2])
    return values


# --- loops ---

def similarity_values(folder, truth_scale=True):
    d, C, scale, sigma = scene.compare(folder)
    values = {"segments": pair(np.linalg.solve(np.linalg.cholesky(C), d), np.ones(7))}
    if truth_scale:
        values["truth scale"] = pair([scale], [sigma])
    return values


def metrics(program, folder, estimate, truth):
    text = program("evaluate", "--estimate", estimate, "--truth", truth, "--json", folder=folder)
    return json.loads(text)


def simulated_loop(program, folder, seed, wrong_matches=0, moving=0):
    (folder / "loop.yaml").write_text(scene.SPECIFICATION.format(seed=seed, points=250, frames=60, camera=scene.CAMERA, wrong_matches=wrong_matches,
                                                                 moving=moving))
    program("simulate", "loop.yaml", "--points", "-o", "recording", folder=folder)
    program("groundtruth", "recording", "-o", "out", folder=folder)


METRICS = ("scale_drift", "rotation_drift_deg", "translation_drift", "alignment_error", "absolute_scale")


@case("loop", "a stereo pair on a loop, 2 x 60 frames of 250 points", ["segments", "truth scale", "poses", "floor", "truth metric"], 100, 4, simulated=True)
def _(program, folder, seed):
    simulated_loop(program, folder, seed)
    values = similarity_values(folder)
    found_times, p, R = read_trajectory(folder / "out/segments_left.txt")
    times, true_p, true_R = read_trajectory(folder / "recording/truth/segments_left.txt")
    covariances = np.genfromtxt(folder / "out/covariance.csv", delimiter=",", skip_header=1)
    at = [int(np.argmin(abs(times - t))) for t in found_times]
    first = transform(true_R[at[0]], true_p[at[0]])
    errors = []
    for k in (len(at) // 4, len(at) - 1):
        C = np.zeros((6, 6))
        C[np.triu_indices(6)] = covariances[k, -21:]
        C += np.triu(C, 1).T
        truth = np.linalg.inv(first) @ transform(true_R[at[k]], true_p[at[k]])
        d = hp.se3_log(transform(R[k], p[k])) - hp.se3_log(truth)
        errors.append(np.linalg.solve(np.linalg.cholesky(C), d))
    values["poses"] = pair(errors, np.ones((2, 6)))
    # The floor: the true path as the estimate. The sigma: a path whose end has drifted, against the exact truth.
    exact = metrics(program, folder, "path=recording/truth/trajectory_left.txt", "out/groundtruth.yaml")
    ideal = dict(zip(METRICS, (1, 0, 0, 0, 1)))
    values["floor"] = pair([exact[m] - ideal[m] for m in METRICS], [exact["errors_by_truth"][m]["floor"] for m in METRICS])
    rows = np.loadtxt(folder / "recording/truth/trajectory_left.txt")
    share = (np.arange(len(rows)) / len(rows))[:, None]
    rows[:, 1:4] = rows[:, 1:4] * (1 + 0.03 * share) + share * [0.4, -0.3, 0.2]
    np.savetxt(folder / "drifted.txt", rows, fmt="%.12g")
    exact = [np.linalg.inv(first) @ transform(true_R[i], true_p[i]) for i in at]  # in the truth's own world
    (folder / "exact.txt").write_text("".join(f"{times[i]:.6f} {pose_text(T, ' ')}\n" for i, T in zip(at, exact)))
    by_truth, by_exact = (metrics(program, folder, "path=drifted.txt", t) for t in ("out/groundtruth.yaml", "exact.txt"))
    resolved = [m for m in METRICS if by_truth["errors_by_truth"][m]["resolved"]]
    values["truth metric"] = pair([by_truth[m] - by_exact[m] for m in resolved], [by_truth["errors_by_truth"][m]["sigma"] for m in resolved])
    return values


@case("loop, wrong matches", "a loop with 10 % wrong matches and 20 % moving points", ["segments", "truth scale"], 100, 4, simulated=True)
def _(program, folder, seed):
    simulated_loop(program, folder, seed, wrong_matches=0.1, moving=0.2)
    return similarity_values(folder)


def shelves(program, folder, seed, copies, straight=False):
    """A pair that passes shelves of equal bays of 1.5 m; of the points that start and end have in common, the share `copies` has
    in the end the numbers of the next bay's. The calibration is exact."""
    random = np.random.default_rng([seed, 21])
    cameras = {"left": Camera("pinhole", random=random), "right": Camera("pinhole", T=transform(np.eye(3), [-0.1, 0, 0]), random=random)}
    bay, bays, each = 1.5, 22, 25
    base = random.uniform([0, -1.5, 2], [bay, 1.5, 5], (each, 3))
    if copies:
        points = {1000 * b + i: base[i] + [bay * (b - 6), 0, 0] for b in range(bays) for i in range(each)}
    else:
        points = dict(enumerate(random.uniform([-9, -1.5, 2], [24, 1.5, 5], (bays * each, 3))))
    taken = set(random.permutation(each)[:round(copies * each)].tolist())
    number, X = np.array(list(points)), np.array(list(points.values()))
    lines = {name: ["frame,marker,x,y,sigma"] for name in cameras}
    times, truth = ["# frame time_s exposure_ms"], []
    phase = random.uniform(0, 2 * np.pi, (2, 3))
    for segment, begin in ((0, 0.0), (1, 100.0)):
        for k in range(40):
            t, wind = k * 0.375, 0.0 if straight else 1.0
            place = [t, wind * 0.6 * np.sin(0.8 * t + phase[segment, 0]), wind * 0.3 * np.sin(0.8 * t + phase[segment, 1])]
            T_world_rig = transform(exp(0.05 * wind * np.sin(1.3 * t + phase[segment])), np.array(place) + [0, 0.1 * segment, 0.1 * segment])
            name = f"{len(truth):04}"
            times.append(f"{name} {begin + t:.6f} 5")
            truth.append(f"{begin + t:.6f} {pose_text(T_world_rig, ' ')}")
            for c, camera in cameras.items():
                T = camera.T @ np.linalg.inv(T_world_rig)
                u = camera.points(X @ T[:3, :3].T + T[:3, 3])
                u += random.normal(0, 0.3, u.shape)
                for n, (x, y) in zip(number, u):
                    if np.isfinite(x):
                        n = n + 1000 if copies and segment and n % 1000 in taken else n
                        lines[c].append(f"{name},{n},{x:.4f},{y:.4f},0.3")
    recording = folder / "recording"
    (recording / "truth").mkdir(parents=True)
    calibration = {"cameras": {}}
    for c, camera in cameras.items():
        (recording / f"tracks_{c}.csv").write_text("\n".join(lines[c]) + "\n")
        calibration["cameras"][c] = {"model": camera.model, "image_size": list(camera.size), "T_camera_rig": camera.T.tolist(),
                                     "parameters": {k: float(v) for k, v in camera.p.items()}}
    (recording / "times.txt").write_text("\n".join(times) + "\n")
    (recording / "truth/segments_left.txt").write_text("\n".join(truth) + "\n")
    save(recording / "calibration.yaml", calibration)
    save(recording / "recording.yaml", {"calibration": "calibration.yaml", "pairing": {"by": "name"}, "cameras": {
        c: {"tracks": f"tracks_{c}.csv", "times": "times.txt", "exposure_unit": "ms"} for c in cameras}})
    if not copies:
        program("groundtruth", "recording", "-o", "out", folder=folder)
        return similarity_values(folder, truth_scale=False)
    try:
        program("groundtruth", "recording", "-o", "out", folder=folder)
    except Failed as failure:
        if "fits the start in two ways" not in str(failure):
            raise
        return {"ambiguous end": pair([0], [1])}
    z, _ = similarity_values(folder, truth_scale=False)["segments"]
    far = 24.3  # chi-square with 7 degrees of freedom exceeds this once in a thousand
    return {"ambiguous end": pair([float(np.dot(z, z) > far)], [1])}


for name, title, runs, quick, options in [
        ("shelves", "a pair past different shelves, exact calibration, points in numpy", 100, 8, {"copies": 0.0}),
        ("straight", "a pair on a straight line without turning, exact calibration", 100, 8, {"copies": 0.0, "straight": True}),
        ("repeated 20 %", "equal bays of 1.5 m, 20 % of the common points on copies", 60, 8, {"copies": 0.2}),
        ("repeated 60 %", "equal bays of 1.5 m, 60 % of the common points on copies", 60, 8, {"copies": 0.6})]:
    case(name, title, ["ambiguous end" if options["copies"] else "segments"], runs, quick)(lambda program, folder, seed, options=options: shelves(program, folder, seed, **options))


@case("two truths", "two pairs on one loop, each a truth of its own, `compare`", ["two truths"], 100, 3, simulated=True)
def _(program, folder, seed):
    text = scene.SPECIFICATION.format(seed=seed, points=250, frames=60, camera=scene.CAMERA, wrong_matches=0, moving=0)
    for name, x in (("up", -0.02), ("down", -0.12)):
        text += f"  {name}:\n{scene.CAMERA}    xi_camera_rig: [{x}, 0.08, 0, 0, 0, 0]\n"
    (folder / "loop.yaml").write_text(text)
    program("simulate", "loop.yaml", "--points", "-o", "recording", folder=folder)
    program("groundtruth", "recording", "--cameras", "left,right", "-o", "a", folder=folder)
    program("groundtruth", "recording", "--cameras", "up,down", "-o", "b", folder=folder)
    program("compare", "a/groundtruth.yaml", "b/groundtruth.yaml", "-o", "compared", folder=folder, statuses=(0, 1))
    rows = read_table(folder / "compared/groundtruth_compare.csv")
    return {"two truths": pair([float(r["difference"]) for r in rows], [float(r["sigma"]) for r in rows])}


# --- photometry: bench/accuracy/photometry.py's cameras (needs OpenCV's Python module and `time`) ---

def photometry(program, folder, method, *arguments, **more):
    try:
        from accuracy import photometry as bench
    except ImportError as missing:
        raise Failed(f"needs a Python module: {missing}")
    with contextlib.redirect_stdout(io.StringIO()):
        b = bench.Bench(types.SimpleNamespace(program=program.path, out=folder / "bench"))
        return getattr(b, method)(*arguments, **more)


@case("response", "response of 120 exposures of 320 x 256 px", ["response"], 60, 2, simulated=True)
def _(program, folder, seed):
    _, ratio = photometry(program, folder, "response", "sweep", seed, (320, 256), "{file: measured.txt}")
    return {"response": pair([np.sqrt(ratio)], [1])}


@case("vignette", "vignetting from 40 images of 320 x 256 px", ["vignetting", "exposures", "vignetting ratio"], 60, 1, simulated=True)
def _(program, folder, seed):
    wall, ratio = photometry(program, folder, "vignette", "wall", seed, (320, 256), "{file: measured.txt}", 40, structure=0.016)
    values = {"vignetting": pair([np.sqrt(ratio)], [1])}
    rows = read_table(wall / "vignette/exposures.csv")
    relative = np.array([float(r["relative"]) for r in rows])
    values["exposures"] = pair(relative - relative.mean(), [float(r["sigma"]) for r in rows])
    rows = [r for r in read_table(wall / "vignette/vignetting_compare.csv") if r["sigma"]]
    values["vignetting ratio"] = pair([float(r["ratio"]) - 1 for r in rows], [float(r["sigma"]) for r in rows])
    return values

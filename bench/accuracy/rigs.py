#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Rigs whose cameras share no view, and calibrations that build on calibrations, against simulated truth.

    bench/rigs --program build/release/apps/plenocal                       # all cases, 100 seeds
    bench/rigs --program build/release/apps/plenocal --seeds 20 --cases ring sequence

ring      six cameras without a common view, two boards whose mutual pose is unknown, 60 frames, 0.1 px
          (examples/simulate/ring): errors of extrinsics and of the boards' pose in their standard errors
axis      the same ring turned about one axis only, three frames of motion each way: what is open and what is not
handeye   a camera on a robot whose poses have errors of 0.2 mm and 0.02 degrees, 30 frames, target of unmeasured size (1 %
          too large): mount and scale in their standard errors, and the mount against OpenCV's methods (python3-opencv)
sequence  a pair of cameras calibrated in two halves, the second from the first or both merged, against both together
shift     a pair that a hand moves, 80 frames at 20 Hz, the right camera 12 ms (which times state) and 4 ms (which they do not)
          later: the shift and the extrinsics in their standard errors, and against cameras that are triggered together
sixteen   16 cameras and 500 frames, in a ring without common views between two boards, and in an array that sees one board:
          seconds, memory, and extrinsics in their standard errors (one seed)
alike     two grids of tags in 14 simulated images of a camera: without common ids, of other counts, of another
          spacing, half of the ids in common, of one print and, before a pair of cameras, of one print: points on the right and
          the wrong board, and the boards' pose in its standard errors
Points without images, but for alike. Prints Markdown tables. Needs python3-numpy, python3-yaml and, for handeye, python3-opencv.
"""
import pathlib
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from accuracy.geometry import difference, exp_rotation, log_rotation, numbers, quaternion, read_poses, transform
from common import load, run, save

RING = common.ROOT / "examples/simulate/ring"
CAMERA = {"model": "pinhole-radial3", "image_size": [1280, 1024],
          "parameters": {"f_x": 1100, "f_y": 1101, "c_x": 640, "c_y": 512, "A_0": -0.2, "A_1": 0.06, "A_2": -0.01}}
BOARD = "plenocal: 1\ntype: chessboard\ncolumns: 9\nrows: 7\nsquare: 30 mm\n"


def report(title, rows):
    print(f"\n{title}\n")
    common.head("", "value")
    for name, value in rows:
        common.row(name, value)


def calibrated(program, folder, spec):
    """Result and truth of the points that `simulate` makes of `spec` (a dictionary), which names files of `folder`."""
    common.simulate(program, folder, spec, "--points")
    return (common.calibrate(program, folder / "set/session.yaml", folder / "out", "--threads", 1),
            load(folder / "set/truth/calibration.yaml"))


def ring_spec(folder, seed):
    for name in ("front.yaml", "side.yaml"):
        (folder / name).write_text((RING / name).read_text())
    return {**load(RING / "ring.yaml"), "seed": seed}


def ring(program, folder, seed):
    """(error, sigma) of the six numbers of each mount and of the second board's pose."""
    result, truth = calibrated(program, folder, ring_spec(folder, seed))
    found = {}
    for name, camera in result["cameras"].items():
        if name == "cam0":
            continue
        error = difference(numbers(camera["xi_camera_rig"]), numbers(truth["cameras"][name]["xi_camera_rig"]))
        found[name] = (error, numbers(camera["sigma_xi"]))
    side = result["targets"]["side"]
    error = numbers(side["xi_target_own"]) - numbers(truth["targets"]["side"]["xi_target_own"])
    found["side"] = (error, numbers(side["sigma_xi"]))
    return found


def ring_case(program, seeds, jobs):
    results = each_seed(ring, program, seeds, jobs)
    names = results[0].keys()
    rows = []
    for name in names:
        ratio = np.array([r[name][0] / r[name][1] for r in results])
        shift = np.array([np.linalg.norm(r[name][0][:3]) for r in results])
        turn = np.array([np.linalg.norm(r[name][0][3:]) for r in results])
        rows.append((name, f"(error / sigma)^2 {np.mean(ratio**2):.2f}, largest {np.abs(ratio).max():.1f} sigma; "
                           f"RMS {1e3 * np.sqrt(np.mean(shift**2)):.3f} mm, "
                           f"{np.degrees(np.sqrt(np.mean(turn**2))):.4f} degrees"))
    every = np.concatenate([np.concatenate([r[n][0] / r[n][1] for n in names]) for r in results])
    rows.append(("all", f"(error / sigma)^2 {np.mean(every**2):.3f}; beyond 3 sigma: "
                        f"{100 * np.mean(np.abs(every) > 3):.2f} % of {every.size} numbers"))
    report(f"Ring of six cameras without a common view, {len(results)} seeds", rows)


GRID = "plenocal: 1\ntype: aprilgrid\nfamily: tag36h11\nborder_bits: 1\nsize: 40 mm\n"
SIX = "columns: 6\nrows: 6\nspacing: 0.3\n"
ALIKE = {"no ids in common": (SIX, SIX + "first_id: 36\n", 1),
         "other counts (6 x 6 and 5 x 7)": (SIX, "columns: 5\nrows: 7\nspacing: 0.3\n", 1),
         "other spacing (0.3 and 0.2)": (SIX, "columns: 6\nrows: 6\nspacing: 0.2\n", 1),
         "18 of 36 ids in common": (SIX, SIX + "first_id: 18\n", 1),
         "one print": (SIX, SIX, 1),
         "one print, a pair of cameras": (SIX, SIX, 2)}


def read_points(path):
    return {(row["frame"], int(row["marker"])): np.array([float(row["x"]), float(row["y"])]) for row in common.read_table(path)}


def alike(program, folder, seed, floor, wall, cameras):
    """Points on the right board, on the wrong one, not found; (error, sigma) of the wall's pose."""
    (folder / "floor.yaml").write_text(GRID + floor)
    (folder / "wall.yaml").write_text(GRID + wall)
    def camera(**extrinsics):
        return {"model": "pinhole-radial3", "image_size": [640, 480], **extrinsics,
                "parameters": {"f_x": 560, "f_y": 561, "c_x": 318, "c_y": 241, "A_0": -0.15, "A_1": 0.05, "A_2": 0}}
    T = [[0.8660254, 0, -0.5, 0.36], [0, 1, 0, 0.02], [0.5, 0, 0.8660254, 0.02], [0, 0, 0, 1]]
    spec = {"seed": seed, "targets": {"floor": "floor.yaml", "wall": {"target": "wall.yaml", "T_target_own": T}},
            "cameras": {"left": camera(), "right": camera(xi_camera_rig=[0.15, 0, 0, 0, 0.2, 0])},
            "poses": {"frames": 14, "distance": [0.5, 1.0], "tilt": 0.5, "roll": 0.5, "aim": "all"}}
    if cameras == 1:
        del spec["cameras"]["right"]
    common.simulate(program, folder, spec)
    pose = common.calibrate(program, folder / "set/session.yaml", folder / "out")["targets"]["wall"]
    counts = np.zeros(3, int)
    for name in spec["cameras"]:
        truth = read_points(folder / f"set/truth/detections_{name}.csv")
        found = read_points(folder / f"out/detections_{name}.csv")
        # Corners beyond the image's border are not in the truth.
        near = [np.linalg.norm(p - truth[key]) < 1 for key, p in found.items() if key in truth]
        counts += [sum(near), len(near) - sum(near), len(truth) - len(near)]
    truth = load(folder / "set/truth/calibration.yaml")["targets"]["wall"]
    return counts, numbers(pose["xi_target_own"]) - numbers(truth["xi_target_own"]), numbers(pose["sigma_xi"])


def alike_case(program, seeds, jobs):
    rows = []
    for name, (floor, wall, cameras) in ALIKE.items():
        results = each_seed(lambda *at: alike(*at, floor, wall, cameras), program, seeds, jobs)
        right, wrong, missing = sum(r[0] for r in results)
        ratio = np.array([r[1] / r[2] for r in results])
        rows.append((name, f"{right} right, {wrong} wrong, {missing} left out or not found; wall: (error / sigma)^2 "
                           f"{np.mean(ratio**2):.2f}, at most {np.abs(ratio).max():.1f} sigma"))
    report(f"Two boards that share ids, {seeds} seeds", rows)


def each_seed(case, program, seeds, jobs):
    def one(seed):
        with common.folder() as folder:
            try:
                return case(program, folder, seed)
            except common.Failed as error:
                print(f"seed {seed} failed: {error}", flush=True)
                return None
    return [result for result in common.in_threads(jobs, one, range(1, seeds + 1)) if result is not None]


def pair(seed, poses, **right):
    return {"seed": seed, "target": "board.yaml", "poses": poses,
            "cameras": {"left": CAMERA, "right": {**CAMERA, "xi_camera_rig": [-0.1, 0, 0, 0, 0.02, 0], **right}}}


def half(program, folder, name, seed, frames):
    common.simulate(program, folder, pair(seed, {"frames": frames, "distance": [0.4, 1.2]}), "--points", out=name)
    return load(folder / name / "session.yaml")


def calibrate(program, folder, session, name, out):
    path = folder / f"{name}/session_{out}.yaml"
    save(path, session)
    return common.calibrate(program, path, folder / out, "--threads", 1)


def unknowns(calibration):
    values, sigmas = [], []
    for name, camera in calibration["cameras"].items():
        values += list(camera["parameters"].values())
        sigmas += list(camera["sigma"].values())
        if name != "left":
            values += camera["xi_camera_rig"]
            sigmas += camera["sigma_xi"]
    return numbers(values), numbers(sigmas)


def sequence(program, folder, seed):
    """For A then B, and for A and B merged: difference from both together, in sigmas; ratio of sigmas."""
    (folder / "board.yaml").write_text(BOARD)
    a = half(program, folder, "a", 2 * seed, 20)
    b = half(program, folder, "b", 2 * seed + 1, 20)
    calibrate(program, folder, a, "a", "out_a")
    b["from"] = "../out_a/calibration.yaml"
    then = unknowns(calibrate(program, folder, b, "b", "out_b"))
    joint = folder / "joint"
    joint.mkdir()
    (joint / "target.yaml").write_text((folder / "a/target.yaml").read_text())
    del b["from"]
    calibrate(program, folder, b, "b", "out_b_alone")
    run(program, "merge", folder / "out_a", folder / "out_b_alone", "-o", folder / "merged")
    merged = unknowns(load(folder / "merged/calibration.yaml"))
    for name in ("left", "right"):
        rows = (folder / f"a/detections_{name}.csv").read_text().splitlines()
        more = (folder / f"b/detections_{name}.csv").read_text().splitlines()[1:]
        (joint / f"detections_{name}.csv").write_text(
            "\n".join(rows[:1] + ["a" + r for r in rows[1:]] + ["b" + r for r in more]) + "\n")
    together = unknowns(calibrate(program, folder, b, "joint", "out_joint"))
    return [(np.abs(found[0] - together[0]) / together[1], found[1] / together[1]) for found in (then, merged)]


def sequence_case(program, seeds, jobs):
    results = each_seed(sequence, program, seeds, jobs)
    for k, title in enumerate(("A then B", "A and B merged")):
        away = np.array([r[k][0] for r in results])
        ratio = np.array([r[k][1] for r in results])
        report(f"{title} against both together, {len(results)} seeds", [
            ("difference of an unknown", f"{np.sqrt(np.mean(away**2)):.3f} sigma RMS, at most {away.max():.3f}"),
            ("its standard error", f"{100 * (ratio.mean() - 1):+.2f} % on average, "
                                   f"{100 * (ratio.min() - 1):+.1f} to {100 * (ratio.max() - 1):+.1f} %")])


def moving_pair(program, folder, seed, keys):
    """Result and truth of the right camera."""
    spec = pair(seed, {"kind": "moving", "frames": 80, "rate": 20, "distance": [0.5, 1.0]}, **keys)
    (folder / "board.yaml").write_text(BOARD)
    return [calibration["cameras"]["right"] for calibration in calibrated(program, folder, spec)]


def shift(program, folder, seed):
    """(error, sigma) of the time shift, those of the extrinsics, and errors of the extrinsics of a synchronous rig."""
    together, truth = moving_pair(program, folder, seed, {})
    synchronous = difference(numbers(together["xi_camera_rig"]), numbers(truth["xi_camera_rig"]))
    found, truth = moving_pair(program, folder, seed, {"time_offset": 0.012, "time_shift": 0.004})
    if "time_shift" not in found:
        raise common.Failed("found no time shift")
    of_shift = (float(found["time_shift"]) - 0.004, float(found["sigma_time_shift"]))
    of_mount = difference(numbers(found["xi_camera_rig"]), numbers(truth["xi_camera_rig"]))
    return of_shift, (of_mount, numbers(found["sigma_xi"])), synchronous


def shift_case(program, seeds, jobs):
    results = each_seed(shift, program, seeds, jobs)
    times = np.array([r[0] for r in results])
    ratio = np.array([r[1][0] / r[1][1] for r in results])
    mount, synchronous = np.array([r[1][0] for r in results]), np.array([r[2] for r in results])

    def rms(x):
        return np.sqrt(np.mean(x**2))
    report(f"A pair whose cameras are 12 + 4 ms apart, {len(results)} seeds", [
        ("time shift", f"{1e6 * rms(times[:, 0]):.1f} us RMS, (error / sigma)^2 "
                       f"{np.mean((times[:, 0] / times[:, 1])**2):.2f}, largest "
                       f"{np.abs(times[:, 0] / times[:, 1]).max():.1f} sigma"),
        ("extrinsics", f"{1e3 * rms(mount[:, :3]):.4f} mm, {np.degrees(rms(mount[:, 3:])):.5f} degrees RMS; "
                       f"(error / sigma)^2 {np.mean(ratio**2):.2f}"),
        ("synchronous rig", f"{1e3 * rms(synchronous[:, :3]):.4f} mm, "
                            f"{np.degrees(rms(synchronous[:, 3:])):.5f} degrees RMS")])


def axis_case(program, seeds, jobs):
    """Rotation about the vertical axis only, on a table: the mounts' heights are open."""
    def one(program, folder, seed):
        spec = ring_spec(folder, seed)
        # Two cameras and a turntable: the rig stands still and turns about y.
        spec["cameras"] = {k: v for k, v in spec["cameras"].items() if k in ("cam0", "cam1")}
        rows = ["frame,x,y,z,qx,qy,qz,qw"]
        for f in range(12):
            # The rig looks along -z of the front board, upside up.
            angle = np.pi + np.radians(-22 + 2 * f)
            turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
            flip = np.diag([-1.0, -1.0, 1.0])
            q = quaternion(turn @ flip)
            rows.append(f"{f:03},0.2,0,1.3," + ",".join(f"{v:.12g}" for v in q))
        (folder / "poses.csv").write_text("\n".join(rows) + "\n")
        spec["poses"] = {"file": "poses.csv"}
        result, _ = calibrated(program, folder, spec)
        codes = {f["code"]: f["what"] for f in result["verdict"]["findings"]}
        return codes.get("one_rotation_axis", ""), numbers(result["cameras"]["cam1"]["sigma_xi"])
    results = each_seed(one, program, seeds, jobs)
    named = sum(1 for what, _ in results if what)
    sigma = np.array([s for _, s in results])
    report(f"Turned about one axis only, {len(results)} seeds", [
        ("finding one_rotation_axis", f"in {named} of {len(results)}"),
        ("standard errors of the mount", ", ".join(f"{v:.2g}" for v in np.median(sigma, axis=0)))])


def handeye(program, folder, seed):
    """Errors of T_gripper_rig in standard errors, of the scale, and of OpenCV's methods (mm)."""
    import cv2
    random = np.random.default_rng(seed)
    (folder / "board.yaml").write_text(BOARD)
    calibrated(program, folder, {"seed": seed, "target": "board.yaml", "cameras": {"eye": CAMERA},
                                 "poses": {"frames": 30, "distance": [0.4, 0.9]}})
    # The session believes in a target that is 1 % too large.
    stated = folder / "set/target.yaml"
    session = load(folder / "set/session.yaml")
    (folder / "set/large.yaml").write_text(stated.read_text().replace("30 mm", "30.3 mm").replace("0.03", "0.0303"))
    session["target"] = "large.yaml"
    save(folder / "set/large_session.yaml", session)
    common.calibrate(program, folder / "set/large_session.yaml", folder / "large", "--threads", 1)
    X = transform(exp_rotation(random.normal(0, 1, 3)), random.normal(0, 0.08, 3))   # T_gripper_rig
    Z = transform(exp_rotation(random.normal(0, 1, 3)), random.normal(0, 0.5, 3))    # T_base_target
    rows = ["frame,x,y,z,qx,qy,qz,qw"]
    robot = {}
    for name, T_target_rig in read_poses(folder / "set/truth/poses.csv").items():
        T = Z @ T_target_rig @ np.linalg.inv(X)
        T = transform(T[:3, :3] @ exp_rotation(random.normal(0, np.radians(0.02), 3)),
                      T[:3, 3] + random.normal(0, 2e-4, 3))
        robot[name] = T
        rows.append(f"{name}," + ",".join(f"{v:.12g}" for v in [*T[:3, 3], *quaternion(T[:3, :3])]))
    (folder / "robot.csv").write_text("\n".join(rows) + "\n")
    run(program, "handeye", folder / "out", "--poses", folder / "robot.csv", "-o", folder / "handeye.yaml", "--quiet")
    found = load(folder / "handeye.yaml")
    T = np.array(found["T_gripper_rig"], float)
    error = np.concatenate([T[:3, 3] - X[:3, 3], log_rotation(T[:3, :3] @ X[:3, :3].T)])
    run(program, "handeye", folder / "large", "--poses", folder / "robot.csv", "--scale", "-o", folder / "scale.yaml", "--quiet")
    scaled = load(folder / "scale.yaml")
    scale = (float(scaled["scale"]) - 1 / 1.01, float(scaled["sigma_scale"]))
    poses = read_poses(folder / "out/poses.csv")
    names = [n for n in robot if n in poses]
    cameras = [np.linalg.inv(poses[n]) for n in names]
    methods = {}
    for method in ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS"):
        R, t = cv2.calibrateHandEye([robot[n][:3, :3] for n in names], [robot[n][:3, 3] for n in names],
                                    [c[:3, :3] for c in cameras], [c[:3, 3] for c in cameras],
                                    method=getattr(cv2, "CALIB_HAND_EYE_" + method))
        methods[method] = (np.linalg.norm(t.ravel() - X[:3, 3]), np.linalg.norm(log_rotation(R @ X[:3, :3].T)))
    return error, numbers(found["sigma_gripper_rig"]), scale, methods


def handeye_case(program, seeds, jobs):
    results = each_seed(handeye, program, seeds, jobs)
    ratio = np.array([r[0] / r[1] for r in results])
    shift = np.sqrt(np.mean([np.sum(r[0][:3]**2) for r in results]))
    turn = np.sqrt(np.mean([np.sum(r[0][3:]**2) for r in results]))
    scale = np.array([r[2] for r in results])
    rows = [("plenocal handeye", f"{1e3 * shift:.3f} mm, {np.degrees(turn):.4f} degrees RMS; (error / sigma)^2 {np.mean(ratio**2):.2f}")]
    for method in results[0][3]:
        away = np.array([r[3][method] for r in results])
        away = np.sqrt(np.mean(away**2, axis=0))
        rows.append((f"OpenCV {method}", f"{1e3 * away[0]:.3f} mm, {np.degrees(away[1]):.4f} degrees RMS"))
    rows.append(("scale of a target that is 1 % too large",
                 f"{100 * np.sqrt(np.mean(scale[:, 0]**2)):.3f} % RMS; (error / sigma)^2 {np.mean((scale[:, 0] / scale[:, 1])**2):.2f}"))
    report(f"Camera on a robot, {len(results)} seeds", rows)


def sixteen_cameras(place):
    """Cameras of a specification; `place`: rotation about y and position in the rig of camera number i."""
    cameras = {}
    for i in range(16):
        angle, position = place(i)
        R = exp_rotation(np.array([0, -angle, 0]))
        T = transform(R, -R @ position)
        cameras[f"cam{i:02}"] = {
            "model": "pinhole-radial3", "image_size": [640, 480], "T_camera_rig": T.tolist(),
            "parameters": {"f_x": 900 + 3 * i, "f_y": 901 + 3 * i, "c_x": 318, "c_y": 241, "A_0": -0.12, "A_1": 0.05, "A_2": 0}}
    del cameras["cam00"]["T_camera_rig"]
    return cameras


def sixteen_case(program, _seeds, _jobs):
    on_circle = lambda i: (np.pi * i / 8, 0.1 * np.array([np.sin(np.pi * i / 8), 0, np.cos(np.pi * i / 8) - 1]))
    in_array = lambda i: (0.0, 0.05 * np.array([i % 4, i // 4, 0]))
    specs = {
        "ring, two boards": lambda ring: {**ring, "cameras": sixteen_cameras(on_circle), "poses": {**ring["poses"], "frames": 500}},
        "array, one board": lambda _: {"seed": 1, "target": "board.yaml", "cameras": sixteen_cameras(in_array),
                                       "poses": {"frames": 500, "distance": [0.6, 1.2]}}}
    rows = []
    for name, spec in specs.items():
        with common.folder() as folder:
            (folder / "board.yaml").write_text(BOARD)
            common.simulate(program, folder, spec(ring_spec(folder, 1)), "--points")
            timed = run("/usr/bin/time", "-f", "%e %M", program, "calibrate", folder / "set/session.yaml", "-o", folder / "out", "--quiet")
            seconds, kilobytes = timed.stderr.split()[-2:]
            result, truth = load(folder / "out/calibration.yaml"), load(folder / "set/truth/calibration.yaml")
            ratios = [difference(numbers(camera["xi_camera_rig"]), numbers(truth["cameras"][camera_name]["xi_camera_rig"])) /
                      numbers(camera["sigma_xi"])
                      for camera_name, camera in result["cameras"].items() if camera_name != "cam00"]
            points = sum(camera["residuals"]["points"] for camera in result["cameras"].values())
            rows.append((name, f"{points} points, {float(seconds):.0f} s, {int(kilobytes) / 1000:.0f} MB; extrinsics (error / sigma)^2 "
                               f"{np.mean(np.square(ratios)):.2f}, largest {np.abs(ratios).max():.1f} sigma"))
    report("16 cameras, 500 frames", rows)


CASES = {"ring": ring_case, "axis": axis_case, "handeye": handeye_case, "sequence": sequence_case,
         "shift": shift_case, "alike": alike_case, "sixteen": sixteen_case}


def main():
    parser = common.parser(__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    arguments = parser.parse_args()
    for name in arguments.cases:
        CASES[name](arguments.program, arguments.seeds, arguments.jobs)


if __name__ == "__main__":
    main()

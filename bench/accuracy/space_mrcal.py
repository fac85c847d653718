# SPDX-License-Identifier: Apache-2.0
"""`bench/space PLENOCAL mrcal`: standard errors of points and lengths beside those of mrcal 2.2 (Debian's python3-mrcal).

One simulated pair, held board, equal noise, no outliers: both calibrate from the same corners and triangulate the same new ones
in the frame of the first camera.
"""
import pathlib
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from accuracy.geometry import read_poses

COLUMNS, ROWS, SQUARE, NOISE = 10, 7, 0.05, 0.1


def session(plenocal, place):
    (place / "target.yaml").write_text(f"plenocal: 1\ntype: chessboard\ncolumns: {COLUMNS}\nrows: {ROWS}\nsquare: {SQUARE}\n")
    camera = {"model": "pinhole-radtan4", "image_size": [1280, 960], "detection_sigma": NOISE}
    parameters = {"f_x": 900.0, "f_y": 902.0, "c_x": 645.0, "c_y": 475.0, "k_1": -0.1, "k_2": 0.02, "p_1": 1e-4, "p_2": -2e-4}
    cameras = {"left": {**camera, "parameters": parameters},
               "right": {**camera, "parameters": {**parameters, "f_x": 905.0, "f_y": 906.0},
                         "xi_camera_rig": [-0.12, 0.002, 0.001, 0.01, -0.02, 0.015]}}
    for name, seed, frames, distance in (("set", 1, 40, [0.5, 1.2]), ("new", 2, 6, [0.8, 4.0])):
        poses = {"kind": "varied", "frames": frames, "distance": distance, "partial": 0.0}
        common.save(place / f"{name}.yaml", {"plenocal": 1, "seed": seed, "target": "target.yaml", "poses": poses, "cameras": cameras})
        common.run(plenocal, "simulate", place / f"{name}.yaml", "--points", "-o", place / name)
    text = common.load(place / "set/session.yaml")
    text["options"] = {**text.get("options", {}), "refine_target": False, "loss": "none"}
    common.save(place / "set/session.yaml", text)
    common.run(plenocal, "calibrate", place / "set/session.yaml", "-o", place / "result", "--no-report")


def corners(place, name):
    """By frame: (rows, columns, 2) of each camera that sees the whole board."""
    boards = {}
    for camera in ("left", "right"):
        for row in common.read_table(place / name / f"detections_{camera}.csv"):
            board = boards.setdefault(row["frame"], {}).setdefault(camera, np.full((ROWS * COLUMNS, 2), np.nan))
            board[int(row["marker"])] = float(row["x"]), float(row["y"])
    return boards


def solved_by_mrcal(place):
    """The models of both cameras, from the same corners, our result as start."""
    import mrcal
    boards, poses = corners(place, "set"), read_poses(place / "set/truth/poses.csv")
    calibrated = common.load(place / "result/calibration.yaml")["cameras"]
    intrinsics = [[float(v) for v in list(calibrated[name]["parameters"].values())[:8]] for name in ("left", "right")]
    T = np.array(calibrated["right"]["T_camera_rig"], float).reshape(-1, 4)[:3]
    observations, indices, frames = [], [], []
    for frame, cameras in boards.items():
        for c, name in enumerate(("left", "right")):
            if name not in cameras:
                continue
            q = cameras[name].reshape(ROWS, COLUMNS, 2)
            weight = np.where(np.isnan(q[..., :1]), -1.0, 1.0)
            observations.append(np.concatenate([np.nan_to_num(q), weight], axis=-1))
            indices.append((len(frames), c, c - 1))
        frames.append(mrcal.rt_from_Rt(mrcal.invert_Rt(np.vstack([poses[frame][:3, :3], poses[frame][:3, 3]]))))
    inputs = dict(lensmodel="LENSMODEL_OPENCV4", intrinsics=np.array(intrinsics), imagersizes=np.array([[1280, 960]] * 2, np.int32),
                  extrinsics_rt_fromref=mrcal.rt_from_Rt(np.vstack([T[:, :3], T[:, 3]]))[None], frames_rt_toref=np.array(frames),
                  points=None, observations_board=np.array(observations), observations_point=None,
                  indices_frame_camintrinsics_camextrinsics=np.array(indices, np.int32), indices_point_camintrinsics_camextrinsics=None,
                  calibration_object_spacing=SQUARE, calobject_warp=None, do_optimize_intrinsics_core=True,
                  do_optimize_intrinsics_distortions=True, do_optimize_extrinsics=True, do_optimize_frames=True,
                  do_optimize_calobject_warp=False, do_apply_outlier_rejection=False, do_apply_regularization=False, verbose=False)
    mrcal.optimize(**inputs)
    return [mrcal.cameramodel(optimization_inputs=inputs, icam_intrinsics=c) for c in (0, 1)]


def run(plenocal):
    import mrcal
    with common.folder() as place:
        session(plenocal, place)
        models = solved_by_mrcal(place)
        pairs = [(frame, marker, np.stack([cameras["left"][marker], cameras["right"][marker]]))
                 for frame, cameras in corners(place, "new").items() if len(cameras) == 2 for marker in (0, 9, 35, 60, 69)]
        pairs = [pair for pair in pairs if np.isfinite(pair[2]).all()]
        tables = [f"{name}={place / 'new' / f'detections_{name}.csv'}" for name in ("left", "right")]
        common.run(plenocal, "triangulate", place / "result", *tables, "--sigma", NOISE, "--frame", "rig", "--all-lengths", "-o", place / "tri")
        ours = {(row["frame"], int(row["marker"])): row for row in common.read_table(place / "tri/points.csv")}
        lengths = {(row["frame"], row["of"]): row for row in common.read_table(place / "tri/measures.csv")}
        q = np.array([pair[2] for pair in pairs])
        p, calibration, noise, _ = mrcal.triangulate(q, models, q_calibration_stdev=-1, q_observation_stdev=NOISE, stabilize_coords=False)
    z = {"noise": [], "calibration": []}
    for i, (frame, marker, _) in enumerate(pairs):
        row = ours[frame, marker]
        z["noise"].append(float(row["sigma_z_noise"]) / np.sqrt(noise[i, 2, 2]))
        z["calibration"].append(float(row["sigma_z_calibration"]) / np.sqrt(calibration[i, 2, i, 2]))
    length = []
    for i, (frame, a, _) in enumerate(pairs):
        for j, (other, b, _) in enumerate(pairs):
            if frame != other or a >= b:
                continue
            u = (p[i] - p[j]) / np.linalg.norm(p[i] - p[j])
            shared = calibration[i, :, i] + calibration[j, :, j] - calibration[i, :, j] - calibration[j, :, i]
            length.append(float(lengths[frame, f"{a} {b}"]["sigma_calibration"]) / np.sqrt(u @ shared @ u))
    common.head("ours / mrcal", "number", "median", "least", "largest")
    for name, ratios in (("sigma of z, noise", z["noise"]), ("sigma of z, calibration", z["calibration"]), ("length, calibration", length)):
        common.row(name, len(ratios), *(f"{value:.3f}" for value in (np.median(ratios), min(ratios), max(ratios))))

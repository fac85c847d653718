#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""mrcal_solve.py FOLDER: what make_problem wrote, solved by mrcal with board warp.

The stages are those of mrcal-calibrate-cameras. Prints the CPU seconds of all mrcal.optimize calls, of
the last one (every unknown, from the stages' result) and the RMS in px.
"""
import csv
import os
import sys
import time

import mrcal
import numpy as np

COLUMNS, ROWS, SQUARE, IMAGE_SIZE = 10, 7, 0.03, (1280, 960)


def read_cameras(folder):
    """{(frame, camera): points as mrcal wants them}, weight -1 where there is none."""
    boards, camera = {}, 0
    while os.path.exists(path := os.path.join(folder, f"cam{camera}.csv")):
        with open(path, newline="") as file:
            for row in csv.DictReader(file):
                board = boards.setdefault((row["frame"], camera), np.full((ROWS, COLUMNS, 3), -1.0))
                board[divmod(int(row["marker"]), COLUMNS)] = float(row["x"]), float(row["y"]), 1
        camera += 1
    return boards, camera


def main():
    boards, cameras = read_cameras(sys.argv[1])
    keys = sorted(boards)
    frame_index = {frame: i for i, frame in enumerate(sorted({frame for frame, _ in keys}))}
    frame_camera = np.array([(frame_index[frame], camera) for frame, camera in keys], dtype=np.int32)
    observations = np.array([boards[key] for key in keys])
    image_sizes = np.array([IMAGE_SIZE] * cameras, dtype=np.int32)

    intrinsics, extrinsics, frames = mrcal.seed_stereographic(
        imagersizes=image_sizes,
        focal_estimate=1000,
        indices_frame_camera=frame_camera,
        observations=observations,
        object_spacing=SQUARE)
    problem = dict(
        extrinsics_rt_fromref=extrinsics,
        frames_rt_toref=frames,
        points=None,
        observations_board=observations,
        indices_frame_camintrinsics_camextrinsics=np.ascontiguousarray(
            np.column_stack((frame_camera, frame_camera[:, 1] - 1)), dtype=np.int32),
        observations_point=None,
        indices_point_camintrinsics_camextrinsics=None,
        imagersizes=image_sizes,
        calibration_object_spacing=SQUARE)

    seconds = []

    def optimize(lensmodel, intrinsics_data, **options):
        start = time.process_time()
        stats = mrcal.optimize(lensmodel=lensmodel, intrinsics=intrinsics_data, **problem, **options)
        seconds.append(time.process_time() - start)
        return stats

    early = dict(do_apply_outlier_rejection=False, do_optimize_calobject_warp=False)
    for core in (False, True):
        optimize("LENSMODEL_STEREOGRAPHIC", intrinsics,
                 do_optimize_intrinsics_core=core, do_optimize_intrinsics_distortions=False,
                 do_apply_regularization=False, **early)
    lensmodel = "LENSMODEL_OPENCV5"
    distortions = mrcal.lensmodel_num_params(lensmodel) - intrinsics.shape[1]
    noise = np.random.default_rng(1).uniform(-0.5e-6, 0.5e-6, (cameras, distortions))
    intrinsics = np.ascontiguousarray(np.hstack((intrinsics, noise)))
    optimize(lensmodel, intrinsics, do_apply_regularization=True, **early)
    stats = optimize(lensmodel, intrinsics, calobject_warp=np.array((1e-3, 1e-3)),
                     do_apply_regularization=True, do_apply_outlier_rejection=True)
    # mrcal's RMS is over coordinates; ours over points.
    print(f"{sum(seconds):.6f} {seconds[-1]:.6f} "
          f"{stats['rms_reproj_error__pixels'] * np.sqrt(2):.4f}")


main()

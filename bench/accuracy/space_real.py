# SPDX-License-Identifier: Apache-2.0
"""`bench/space PLENOCAL real`: predicted over observed scatter of distances between markers in held-out frames of real sets.

Four folds of frames. Each fold's lengths between pairs of markers, less their mean over its frames, have by the covariance of
noise, calibration and jitter over the frames a predicted sum of squares; printed is the root of predicted over observed by thirds of
the length, and where it lies by chance for all lengths (draws; folds are independent in them). $PLENOCAL_DATA (docs/data.md).
"""
import itertools
import os
import pathlib
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common

DATA = pathlib.Path(os.environ.get("PLENOCAL_DATA", "$PLENOCAL_DATA")).absolute()
FOLDS, DRAWS, PAIRS = 4, 300, 300


def chessboard(columns, rows, square):
    return {"plenocal": 1, "type": "chessboard", "columns": columns, "rows": rows, "square": square, "tolerance": square / 100}


# name: folder, target; left*, right*
SETS = {
    "stereo_chess_opencv": ("frames/stereo_chess_opencv", chessboard(9, 6, 0.025)),
    "stereo_chess_anamorphic_drobotics": ("frames/stereo_chess_anamorphic_drobotics", chessboard(11, 8, 0.1)),
    "stereo_calib_bumblebee2": ("scene_real/stereo_calib_bumblebee2", chessboard(6, 4, 0.03)),
    "stereo_fisheye_ros (not synchronous)": ("frames/stereo_fisheye_ros", chessboard(8, 6, 0.0389)),
}
CALISCOPE = "rig4_charuco_caliscope (not synchronous)"
# The upper half of left08.jpg shows the board elsewhere than the lower one: residuals jump by 0.6 px between two rows of corners.
TORN = {"stereo_chess_opencv": ["08"]}


def detected(plenocal, place, name):
    """Tables of the set's cameras, by camera."""
    if name == CALISCOPE:
        target = {"plenocal": 1, "type": "charuco", "columns": 4, "rows": 5, "square": 0.054, "marker": 0.0405,
                  "dictionary": "DICT_4X4_1000", "tolerance": 0.0005}
        tables = {}
        for row in common.read_table(DATA / "frames/rig4_charuco_caliscope/calibration/extrinsic/CHARUCO/xy_CHARUCO.csv"):
            camera = row.get("cam_id") or row.get("port")
            tables.setdefault(f"cam{camera}", []).append((row["sync_index"], row.get("keypoint_id") or row["point_id"], row["img_loc_x"], row["img_loc_y"]))
        return target, [1280, 720], tables
    folder, target = SETS[name]
    common.save(place / "target.yaml", target)
    cameras = {side: {"model": "auto", "images": str(DATA / folder / f"{side}*.[pj][np]g")} for side in ("left", "right")}
    common.save(place / "session.yaml", {"plenocal": 1, "target": "target.yaml", "cameras": cameras})
    common.run(plenocal, "detect", place / "session.yaml", "-o", place / "detected")
    tables = {}
    for side in cameras:
        rows = common.read_table(place / f"detected/detections_{side}.csv")
        tables[side] = [(row["frame"], row["marker"], row["x"], row["y"], row["sigma"]) for row in rows]
    tables["right"] = alike(tables["left"], tables["right"], target["columns"] * target["rows"])
    import cv2
    first = sorted((DATA / folder).glob("left*.[pj][np]g"))[0]
    height, width = cv2.imread(str(first), cv2.IMREAD_GRAYSCALE).shape
    return target, [width, height], tables


def alike(left, right, count):
    """The right table with the corners of a board that a rotation by 180 degrees does not change numbered as in the left one."""
    def axis(table, frame):
        seen = {int(row[1]): np.array([float(row[2]), float(row[3])]) for row in table if row[0] == frame}
        return sum(((2 * marker - count + 1) * place for marker, place in seen.items()), np.zeros(2))
    turned = {frame for frame in {row[0] for row in right} if axis(left, frame) @ axis(right, frame) < 0}
    return [(row[0], str(count - 1 - int(row[1])) if row[0] in turned else row[1], *row[2:]) for row in right]


def write(place, tables, frames):
    for camera, rows in tables.items():
        lines = [",".join(row) for row in rows if row[0] in frames]
        head = "frame,marker,x,y,sigma" if len(rows[0]) == 5 else "frame,marker,x,y"
        (place / f"{camera}.csv").write_text("\n".join([head, *lines]) + "\n")


def sums(place, random):
    """Length, observed and drawn sums of squares of pairs of markers of a fold, (pairs,), (pairs,), (DRAWS, pairs)."""
    points, roots = {}, {}
    for row in common.read_table(place / "tri/points.csv"):
        if row["used"] == "1":
            N = np.array([[float(row[f"noise_{min(a, b)}_{max(a, b)}"]) for b in "xyz"] for a in "xyz"])
            points.setdefault(row["frame"], {})[int(row["marker"])] = np.array([float(row[c]) for c in "xyz"]), N
    for row in common.read_table(place / "tri/shared.csv"):
        of_all, of_frame = ([float(v) for k, v in row.items() if k.startswith(kind)] for kind in ("c_", "jitter_"))
        roots.setdefault((row["frame"], int(row["marker"])), []).append((of_all, of_frame))
    markers = sorted({marker for seen in points.values() for marker in seen})
    pairs = list(itertools.combinations(markers, 2))
    if len(pairs) > PAIRS:
        pairs = [pairs[i] for i in random.choice(len(pairs), PAIRS, replace=False)]
    found = np.full((len(points), len(pairs)), np.nan)
    drawn = np.full((DRAWS, *found.shape), np.nan)
    by_all = random.standard_normal((DRAWS, len(next(iter(roots.values()))[0][0])))
    for f, (frame, seen) in enumerate(points.items()):
        by_frame = random.standard_normal((DRAWS, len(next(iter(roots.values()))[0][1])))
        errors = {}
        for marker, (_, N) in seen.items():
            of_all, of_frame = (np.array(part) for part in zip(*roots[frame, marker]))
            errors[marker] = random.standard_normal((DRAWS, 3)) @ np.linalg.cholesky(N).T + by_all @ of_all.T + by_frame @ of_frame.T
        for k, (a, b) in enumerate(pairs):
            if a in seen and b in seen:
                between = seen[a][0] - seen[b][0]
                found[f, k] = np.linalg.norm(between)
                drawn[:, f, k] = (errors[a] - errors[b]) @ between / found[f, k]
    seen_twice = np.isfinite(found).sum(axis=0) > 1
    found, drawn = found[:, seen_twice], drawn[:, :, seen_twice]
    scatter = lambda of, axis: np.nansum((of - np.nanmean(of, axis=axis, keepdims=True)) ** 2, axis=axis)
    return np.nanmean(found, axis=0), scatter(found, 0), scatter(drawn, 1)


def one_set(plenocal, name, left_out):
    random = np.random.default_rng(1)
    folds = []
    with common.folder() as place:
        target, size, tables = detected(plenocal, place, name)
        common.save(place / "target.yaml", target)
        frames = sorted({row[0] for rows in tables.values() for row in rows} - set(left_out))
        for fold in range(FOLDS):
            held = set(frames[fold::FOLDS])
            write(place, tables, set(frames) - held)
            cameras = {camera: {"model": "auto", "detections": f"{camera}.csv", "image_size": size} for camera in tables}
            common.save(place / "session.yaml", {"plenocal": 1, "target": "target.yaml", "cameras": cameras})
            common.run(plenocal, "calibrate", place / "session.yaml", "-o", place / "result", "--no-report", statuses=(0, 1))
            write(place, tables, held)
            given = [f"{camera}={place / camera}.csv" for camera in tables]
            common.run(plenocal, "triangulate", place / "result", *given, "-o", place / "tri")
            folds.append(sums(place, random))
    length, observed, drawn = (np.concatenate(part, axis=-1) for part in zip(*folds))
    order = np.argsort(length)
    cells = []
    for part in [*np.array_split(order, 3), order]:
        of_draws = drawn[:, part].sum(axis=1)
        predicted = of_draws.mean()
        cells.append(f"{np.sqrt(predicted / observed[part].sum()):.2f}")
    chance = np.sqrt(predicted / np.percentile(of_draws, [99.5, 0.5]))
    without = f" without {', '.join(left_out)}" if left_out else ""
    common.row(name + without, len(frames), *cells, "{:.2f} to {:.2f}".format(*chance))


def run(plenocal):
    if not DATA.is_dir():
        sys.exit(f"no folder {DATA}: set PLENOCAL_DATA to the folder of the optional data sets (docs/data.md)")
    common.head("set", "frames", "short", "middle", "long", "all", "by chance (99 %)")
    for name in [*SETS, CALISCOPE]:
        one_set(plenocal, name, [])
        if name in TORN:
            one_set(plenocal, name, TORN[name])

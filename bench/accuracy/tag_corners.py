#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Corners of tags against the truth, in simulated images of a pinhole camera with radial distortion and of a fisheye.

    bench/accuracy/tag_corners.py build/release/apps/plenocal [--seed 5]

Boards of 2 x 2, 4 x 3 and 9 x 6 tags (tag36h11) in 12 images of 1280 x 1024 each: tags of 150 to 300, 80 to 180 and 40 to 90 px.
Prints the RMS error of a coordinate, the median, the mean of (error / sigma)^2 and the CPU time of `detect`. Then, of an
AprilGrid near a blurred camera, how many of the tags are found that are wholly in the image.
"""
import pathlib
import statistics
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common

BOARDS = {"2 x 2": (2, 2, 0.12), "4 x 3": (4, 3, 0.06), "9 x 6": (9, 6, 0.03)}  # columns, rows, m
LENSES = {
    "pinhole": {"model": "pinhole-radtan", "parameters": {
        "f_x": 1000, "f_y": 1000, "c_x": 640, "c_y": 511, "k_1": -0.25, "k_2": 0.1, "p_1": 0, "p_2": 0, "k_3": 0}},
    "fisheye": {"model": "kannala-brandt4", "parameters": {
        "f_x": 420, "f_y": 420, "c_x": 640, "c_y": 511, "k_1": 0.01, "k_2": -0.005, "k_3": 0.001, "k_4": 0}},
}
GRID = {"type": "aprilgrid", "columns": 6, "rows": 6, "size": 0.055, "spacing": 0.3}
POSES = {"frames": 12, "distance": [0.35, 0.8]}
WRONG = 0.5  # px: a corner of something else


def simulate(program, folder, target, lens, blur, seed, poses):
    spec = {"seed": seed, "poses": {"kind": "varied", **poses}, "cameras": {"cam": {**LENSES[lens], "image_size": [1280, 1024], "blur": blur}}}
    common.simulate(program, folder, spec, target=target)


def loose_tags(columns, rows, size):
    tags = []
    for k in range(columns * rows):
        x, y = k % columns * 1.4 * size, k // columns * 1.4 * size
        corners = [[x, y + size, 0], [x + size, y + size, 0], [x + size, y, 0], [x, y, 0]]
        tags.append({"id": k, "corners": [[round(v, 6) for v in c] for c in corners]})
    return {"type": "apriltag", "family": "tag36h11", "tags": tags}


def read_corners(path):
    return {(row["frame"], row["marker"]): (float(row["x"]), float(row["y"]), float(row["sigma"] or 0))
            for row in common.read_table(path)}


def measure(program, board, lens, seed):
    with common.folder() as folder:
        simulate(program, folder, loose_tags(*BOARDS[board]), lens, 0.7, seed, POSES)
        _, _, seconds = common.timed(program, "detect", "set/session.yaml", "-o", "out", "--threads", 1, "--quiet", cwd=folder)
        truth = read_corners(folder / "set/truth/detections_cam.csv")
        found = read_corners(folder / "out/detections_cam.csv")
    squares, ratios = [], []
    for corner, (x, y, sigma) in found.items():
        square = ((x - truth[corner][0])**2 + (y - truth[corner][1])**2) / 2 if corner in truth else WRONG**2
        if square < WRONG**2:
            squares.append(square)
            ratios.append(square / sigma**2)
    common.row(board, lens, f"{len(found)} of {len(truth)}, {len(found) - len(squares)} wrong", f"{statistics.fmean(squares)**0.5:.4f}",
               f"{statistics.median_high(squares)**0.5:.4f}", f"{statistics.fmean(ratios):.2f}", f"{seconds:.2f}")


def count_found(program, lens, blur, seed):
    """Tags wholly in the image, at least 2 px from its border, and how many of them have a corner that was measured."""
    with common.folder() as folder:
        simulate(program, folder, GRID, lens, blur, seed, {"frames": 20, "distance": [0.2, 0.9], "partial": 0.5})
        common.run(program, "detect", "set/session.yaml", "-o", "out", "--quiet", cwd=folder)
        truth = read_corners(folder / "set/truth/detections_cam.csv")
        found = {(frame, int(marker) // 4) for frame, marker in read_corners(folder / "out/detections_cam.csv")}
    inside = {}
    for (frame, marker), (x, y, _) in truth.items():
        inside[frame, int(marker) // 4] = inside.get((frame, int(marker) // 4), 0) + (2 <= x <= 1277 and 2 <= y <= 1021)
    whole = [tag for tag, corners in inside.items() if corners == 4]
    common.row(lens, blur, len(whole), len(whole) - len(found.intersection(whole)))


def main():
    parser = common.parser(__doc__, "program")
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--boards", nargs="+", choices=BOARDS, default=list(BOARDS))
    parser.add_argument("--no-missed", action="store_true", help="the first table alone")
    options = parser.parse_args()
    common.head("board", "lens", "corners found", "RMS, px", "median, px", "(error / sigma)^2", "CPU s")
    for board in options.boards:
        for lens in LENSES:
            measure(options.program, board, lens, options.seed)
    if options.no_missed:
        return
    print()
    common.head("lens", "blur, px", "whole tags", "missed")
    for lens in LENSES:
        for blur in (0.7, 1.5):
            count_found(options.program, lens, blur, options.seed)


if __name__ == "__main__":
    main()

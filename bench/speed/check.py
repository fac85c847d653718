#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs two builds of Plenocal in turn, stage by stage, and fails when the second is 5 % slower in one of them.

    bench/check OLD/apps/plenocal build/release/apps/plenocal                     # exit status 1: slower
    bench/check OLD/apps/plenocal build/release/apps/plenocal --record REMARK     # adds a line a stage to bench/speed/history.csv

CPU seconds (user and system) of whole processes without their cache; the ratio is the median over pairs of runs that
follow each other, because the speed of a machine drifts. Needs the preset dev (build/release/bench).
"""
import csv
import datetime
import pathlib
import statistics
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from common import run
from data.small_sessions import make_sessions

LIMIT = 1.05
HISTORY = pathlib.Path(__file__).resolve().with_name("history.csv")
# Arguments before "-o out --quiet --fresh".
STAGES = {
    "100 frames of 70 markers": ["calibrate", "1x100/session.yaml"],
    "1000 frames of 70 markers": ["calibrate", "1x1000/session.yaml"],
    "1000 stereo frames of 70 markers": ["calibrate", "2x1000/session.yaml"],
    "12 images of 54 tags": ["calibrate", "tags/session.yaml"],
    "8 small chessboards": ["calibrate", "ordinary/session.yaml"],
    "3 small raw plenoptic images": ["calibrate", "plenoptic/session.yaml"],
}


def cpu_seconds(build, arguments, folder):
    return common.timed(build, *arguments, "-o", "out", "--quiet", "--fresh", cwd=folder)[2]


def make_inputs(programs, new, folder):
    for cameras, frames in ((1, 100), (1, 1000), (2, 1000)):
        problem = folder / f"{cameras}x{frames}"
        problem.mkdir()
        run(programs / "make_problem", cameras, frames, "bent", problem)
    (folder / "tags").mkdir()
    run(programs / "render_tags", 6, folder / "tags")
    make_sessions(new, folder)


def record(rows, remark):
    commit = run("git", "rev-parse", "--short=10", "HEAD", cwd=common.ROOT).stdout.strip()
    is_new = not HISTORY.exists()
    with HISTORY.open("a", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if is_new:
            writer.writerow(["date", "commit", "stage", "cpu_s", "ratio_to_old", "remark"])
        for stage, _, new, ratio in rows:
            writer.writerow([datetime.date.today(), commit, stage, f"{new:.3f}", f"{ratio:.3f}", remark])


def main():
    parser = common.parser(__doc__, plenocal=None)
    parser.add_argument("old", type=common.program)
    parser.add_argument("new", type=common.program)
    parser.add_argument("--pairs", type=int, default=7, help="of runs (default 7)")
    parser.add_argument("--programs", type=pathlib.Path, default=common.BUILD / "bench")
    parser.add_argument("--record", metavar="REMARK", help="add the figures to bench/speed/history.csv")
    options = parser.parse_args()
    rows = []
    with common.folder() as folder:
        make_inputs(options.programs.resolve(), options.new, folder)
        for stage, arguments in STAGES.items():
            pairs = [[cpu_seconds(build, arguments, folder) for build in (options.old, options.new)]
                     for _ in range(options.pairs)]
            ratio = statistics.median(after / before for before, after in pairs)
            rows.append((stage, *(statistics.median(times) for times in zip(*pairs)), ratio))
    common.head("stage", "old, CPU s", "new, CPU s", "ratio")
    for stage, *figures in rows:
        common.row(stage, *(f"{figure:.3f}" for figure in figures))
    if options.record:
        record(rows, options.record)
    slower = [stage for stage, _, _, ratio in rows if ratio > LIMIT]
    if slower:
        sys.exit(f"slower than {LIMIT:g} times the old: {', '.join(slower)}")


if __name__ == "__main__":
    main()

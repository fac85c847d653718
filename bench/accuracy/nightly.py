#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A seeded slice of every bench of accuracy and of bench/faults, two at a time: is a result wrong that no test sees?

    bench/nightly                                  # about ten minutes
    bench/nightly scene rigs                       # these alone, as in .ci/run
    bench/nightly --minutes 5                      # starts no slice after five minutes

A slice fails when its bench does, or when a figure that it prints is outside of the limits below. Its output stays in build/nightly.
Slices that lack something (OpenCV's Python module, PLENOCAL_DATA, mrcal) are named. Needs python3-numpy, python3-yaml. Exit status 1
when a slice failed.
"""
import dataclasses
import importlib.util
import os
import pathlib
import re
import subprocess
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common

OUT = common.ROOT / "build/nightly"
HERE = pathlib.Path(__file__).resolve().parent
NUMBER = r"(-?[\d.]+)"
# Mean (error / sigma)^2 of some ten values: beyond once in thousands of slices.
SQUARES = (0.05, 4)
HONEST = ["ordinary", "fisheye", "few frames", "outliers 20 %", "uneven", "misstated", "refined", "jackknife", "frames share",
          "markers share", "no tilt", "pair", "collinear", "ring", "ring, refined", "one axis", "jitter", "clocks, 20 Hz", "robot",
          "robot, scale", "robot, one axis", "merged", "merged, moved", "from", "prior", "suggest", "try", "locate", "plenoptic",
          "sensor", "loop", "shelves"]


@dataclasses.dataclass
class Slice:
    arguments: list
    limits: dict = dataclasses.field(default_factory=dict)  # pattern of figures in the output -> lowest and highest
    needs: tuple = ()
    program: tuple = ("--program",)  # before the program's name


DATA = pathlib.Path(os.environ.get("PLENOCAL_DATA", ""))
PRESCRIPTIONS = DATA / "plenoptic_real/lens_prescriptions/csv"


def folder(name):
    return OUT / "work" / name


SLICES = {
    "honest": Slice(["--runs", 8, "--jobs", 1, "--cases", *HONEST]),
    "scene": Slice(["--seeds", 3, "--cases", "clean", "vergence 2 sigma off"], {rf"of 3 \| {NUMBER} \+-": SQUARES}),
    "scene_free": Slice([folder("scene_free"), "--seeds", 1, "--cases", "A-stereo,A-ordinary"], {rf"{NUMBER} \|$": (0, 11)}, (), ()),
    "rigs": Slice(["--seeds", 3, "--cases", "ring", "axis", "sequence", "shift"], {
        rf"\(error / sigma\)\^2 {NUMBER}": SQUARES, rf"one_rotation_axis \| in {NUMBER}": (3, 3), rf"{NUMBER} sigma RMS": (0, 0.2)}),
    "double_sphere_starts": Slice(["--lenses", 10]),
    "try_simulated": Slice(["--cases", 4, "--threads", 1]),
    "plenoptic_tilt": Slice([folder("plenoptic_tilt"), "--seeds", 2, "--tilts", 0.8], {
        rf"^ +0\.8 +2 +{NUMBER}": (0, 4), rf"^ +0\.8 +2 +[\d.]+ +{NUMBER}": SQUARES, r"(\d+) +\d+ +[\d.]+%$": (2, 2),
        r"(\d+) +[\d.]+%$": (1, 2)}, (), ()),
    "plenoptic_lattices": Slice(["--only", "square"], {
        rf"of \d+ \| {NUMBER}": (0, 0.01), rf"\| {NUMBER} \([\d.]+\) \| [-\d.]+ \(": (-0.1, 0.1), rf"\| {NUMBER} \([\d.]+\) \|$": (-0.5, 0.5)},
        (), ()),
    "tag_corners": Slice(["--boards", "2 x 2", "--no-missed"], {
        rf"wrong \| {NUMBER}": (0, 0.01), rf"\| {NUMBER} \| [\d.]+ \|$": (0.3, 2.5)}, (), ()),
    "suggest": Slice(["--cameras", 1, "--jobs", 1], {rf"^all +[\d.]+ +[\d.]+ +{NUMBER}": (0, 10)}, ("build/release/bench/suggest_views",),
                     None),
    "plenoptic_nees": Slice([folder("plenoptic_nees"), "--sets", 1], {rf"NEES / n {NUMBER}": SQUARES}, ("cv2", "numba", "scipy"), ()),
    "photometry": Slice([folder("photometry"), "--seeds", 0, "--views", 40, "--size", "320x256"],
                        {rf"\(error/sigma\)\^2 {NUMBER}": (0.2, 3)}, ("cv2",), ()),
    "sim_twin": Slice([DATA / "sim_small", folder("sim_twin"), "--sampling-noise"],
                      {rf"noise.* {NUMBER}$": (0.8, 1.25)}, ("cv2", "scipy", "PLENOCAL_DATA"), ()),
    "try_real_sets": Slice(["--only", "circles_visp"], {rf"\| {NUMBER} \([\d.]+\) \| [\d.]+ \(": (0, 0.35)}, ("PLENOCAL_DATA",)),
    "faults": Slice(["--seeds", 1, "--good", 4, "--jobs", 1], {r"^\| `\w+` \| 1 \| (\d)": (1, 1), r"^(\d) of 4 good": (4, 4)}),
    "missing": Slice(["--cases", 2, "--correct", 3, "--families", "radial", "skew", "none", "--jobs", 1], {
        rf"^(?:radial|skew) +2 +{NUMBER}": (0.5, 1)}),
    "stress": Slice(["--cases", 4, "--jobs", 1], {r"^any: (\d)": (0, 2), rf" {NUMBER} +[\d.]+$": (0.6, 1.6)}),
    "space": Slice(["--rigs", 2, "--kinds", "pinhole", "mixed"], {rf"^\| \w+ \| 2 \| {NUMBER}": (0.65, 1.45)}, ("scipy",), ()),
    "lens_trace": Slice([PRESCRIPTIONS, folder("lens_trace"), "--sets", 2], {rf"^mean of all {NUMBER}": (0.02, 4)}, ("PLENOCAL_DATA",),
                        ("--check",)),
    "splined_mrcal": Slice([], {rf"held out.*RMS {NUMBER}": (0.4, 0.65)}, ("mrcal", "PLENOCAL_DATA")),
}


def lacking(needs):
    """What is not there of a slice's needs: variables, files, Python modules."""
    there = lambda need: (bool(os.environ.get(need)) if need.isupper() else
                          (common.ROOT / need).exists() if "/" in need else importlib.util.find_spec(need) is not None)
    return [need for need in needs if not there(need)]


def figures_outside(text, limits):
    """In words; a pattern that is nowhere in the text is one, too."""
    for pattern, (lowest, highest) in limits.items():
        found = [float(value) for value in re.findall(pattern, text, re.M)]
        if not found:
            yield f"no figure {pattern}"
        yield from (f"{value:g} is not within {lowest:g} and {highest:g}" for value in found if not lowest <= value <= highest)


def measure(name, program):
    """Seconds, and what is wrong with a slice."""
    part = SLICES[name]
    OUT.joinpath("work", name).mkdir(parents=True, exist_ok=True)
    before = [] if part.program is None else [*part.program, program]
    start = time.monotonic()
    done = subprocess.run([sys.executable, next(HERE.parent.glob(f"*/{name}.py")), *map(str, [*before, *part.arguments])], cwd=common.ROOT,
                          capture_output=True, text=True)
    (OUT / f"{name}.txt").write_text(done.stdout + done.stderr)
    wrong = [f"exit status {done.returncode}"] if done.returncode else []
    return time.monotonic() - start, wrong + list(figures_outside(done.stdout, part.limits))


def main():
    parser = common.parser(__doc__)
    parser.add_argument("--minutes", type=float, default=10, help="no slice starts later")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("slices", nargs="*", metavar="slice", help=f"default: all of {', '.join(SLICES)}")
    options = parser.parse_args()
    if unknown := set(options.slices) - set(SLICES):
        parser.error(f"unknown: {', '.join(sorted(unknown))}")
    OUT.mkdir(parents=True, exist_ok=True)
    end, failed = time.monotonic() + 60 * options.minutes, False

    def run(name):
        if missing := lacking(SLICES[name].needs):
            return name, "", f"left out: no {', '.join(missing)}", False
        if time.monotonic() > end:
            return name, "", "left out: no time", False
        seconds, wrong = measure(name, options.program)
        return name, f"{seconds:.0f}", "; ".join(wrong) or "good", bool(wrong)
    common.head("slice", "s", "result")
    for *cells, bad in common.in_threads(options.jobs, run, options.slices or SLICES):
        common.row(*cells)
        failed |= bad
    sys.exit(f"see {OUT}" if failed else 0)


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: Apache-2.0
"""Simulated sessions of a few small images, and commands on them, for benches that run the program hundreds of times."""
import random
import shutil

import common
from common import run

BOARD = "plenocal: 1\ntype: chessboard\ncolumns: 7\nrows: 5\nsquare: 0.04\n"
ORDINARY = """plenocal: 1
seed: 3
target: board.yaml
white_images: 1
poses: {kind: varied, frames: 8, distance: [0.35, 0.6], partial: 0}
cameras:
  cam:
    model: pinhole-radial3
    image_size: [320, 240]
    parameters: {f_x: 260, f_y: 261, c_x: 159, c_y: 121, A_0: -0.2, A_1: 0.06, A_2: -0.01}
"""
TAGS = "plenocal: 1\ntype: aprilgrid\ncolumns: 4\nrows: 4\nsize: 0.03\nspacing: 0.3\n"
PLENOPTIC = """plenocal: 1
seed: 7
target: tags.yaml
white_images: 2
poses: {kind: varied, frames: 3, distance: [0.3, 0.6], partial: 0}
cameras:
  cam:
    model: focused-plenoptic
    image_size: [300, 300]
    pixel_size: 1.48e-5
    parameters: {f_L: 0.0122, b_L0: 0.01166, B: 0.00026, c_x: 151, c_y: 148}
    blur: 0.35
    micro_lenses: {pitch: 13, rotation: 0.006, focus: [2.4, 3.0, 3.9], aperture: 0.7, fill: 0.92}
"""

# Commands that write many files: arguments before "-o out", and a result.
COMMANDS = {
    "calibrate": (["calibrate", "ordinary/session.yaml"], "calibration.yaml"),
    "try": (["try", "ordinary/session.yaml", "--models", "pinhole,pinhole-radial3"], "models/pinhole/calibration.yaml"),
    "detect": (["detect", "ordinary/session.yaml"], "detections_cam.csv"),
    "simulate": (["simulate", "ordinary.yaml"], "truth/calibration.yaml"),
    "undistort": (["undistort", "given/calibration.yaml", "ordinary/cam/*.png"], "calibration.yaml"),
}


def make_sessions(program, folder):
    """Writes ordinary.yaml and plenoptic.yaml, and the sessions ordinary/ and plenoptic/ that are simulated from them."""
    for name, text in {"board": BOARD, "tags": TAGS, "ordinary": ORDINARY, "plenoptic": PLENOPTIC}.items():
        (folder / f"{name}.yaml").write_text(text)
    for name in ("ordinary", "plenoptic"):
        run(program, "simulate", f"{name}.yaml", "-o", name, "--quiet", cwd=folder)


def results(out):
    """Path and content of each result; without the cache, which a killed run may leave fuller or emptier."""
    files = (path for path in out.rglob("*") if path.is_file())
    contents = {str(path.relative_to(out)): path.read_bytes() for path in files}
    return {name: content for name, content in contents.items() if not name.startswith(".cache/")}


class Command:
    """A command that replaces old results in folder/out by new ones, and a command that reads one of them."""

    def __init__(self, program, folder, name, *more):
        arguments, result = COMMANDS[name]
        self.words = [program, *arguments, "-o", "out", "--quiet", *more]
        self.reader = [program, "compare", f"out/{result}", f"out/{result}"]
        self.folder, self.out = folder, folder / "out"
        self.write({})
        self.run()
        self.new = results(self.out)
        self.old = {path: b"old " + path.encode() for path in self.new}

    def run(self):
        run(*self.words, cwd=self.folder)

    def write(self, files):
        """Exactly these files; those without content are folders."""
        shutil.rmtree(self.out, ignore_errors=True)
        self.out.mkdir()
        for path, content in files.items():
            (self.out / path if content is None else (self.out / path).parent).mkdir(parents=True, exist_ok=True)
            if content is not None:
                (self.out / path).write_bytes(content)

    def read(self):
        """The results that are there once a reader has opened one."""
        run(*self.reader, cwd=self.folder, statuses=common.ANY_STATUS)  # refuses most, but opens them
        return {path: content for path, content in results(self.out).items() if not path.startswith(".partial/")}


def parser(text, commands=COMMANDS):
    arguments = common.parser(text)
    arguments.add_argument("--seed", type=int, default=1, help="of what is done at random")
    arguments.add_argument("commands", nargs="*", metavar="command", help=f"default: all of {'; '.join(commands)}")
    return arguments


def parse(arguments, commands=COMMANDS):
    options = arguments.parse_args()
    if set(options.commands) - set(commands):
        arguments.error(f"known commands: {'; '.join(commands)}")
    options.commands = options.commands or list(commands)
    return options


def test_commands(options, kind, test):
    """Prints a row for each command, a `kind` of Command, whose last cells are the numbers of its cases and failures; ends as
    `common.finish`."""
    rng, cases, failures = random.Random(options.seed), 0, 0
    with common.folder() as folder:
        make_sessions(options.program, folder)
        run(options.program, "calibrate", "ordinary/session.yaml", "-o", "given", "--quiet", cwd=folder)
        for name in options.commands:
            cells = test(kind(options.program, folder, name), rng)
            common.row(name, *cells)
            cases, failures = cases + cells[-2], failures + cells[-1]
    common.finish(cases - failures, cases)

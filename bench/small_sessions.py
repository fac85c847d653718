# SPDX-License-Identifier: Apache-2.0
"""Simulated sessions of a few small images, for benchmarks that run the program hundreds of times."""
import pathlib
import subprocess

ROOT = pathlib.Path(__file__).resolve().parent.parent

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


def run(program, arguments, folder, emulator=(), **options):
    """Runs the program in `folder`; raises RuntimeError with its messages when it fails."""
    done = subprocess.run([*emulator, program, *arguments], cwd=folder, capture_output=True, text=True, **options)
    if done.returncode != 0:
        raise RuntimeError(f"plenocal {' '.join(arguments)}: exit status {done.returncode}\n{done.stderr}")


def make_sessions(program, folder):
    """Writes ordinary.yaml and plenoptic.yaml, and the sessions ordinary/ and plenoptic/ that are simulated from them."""
    for name, text in {"board": BOARD, "tags": TAGS, "ordinary": ORDINARY, "plenoptic": PLENOPTIC}.items():
        (folder / f"{name}.yaml").write_text(text)
    for name in ("ordinary", "plenoptic"):
        run(program, ["simulate", f"{name}.yaml", "-o", name, "--quiet"], folder)


def results(out):
    """Path and content of each result; without the cache, which a killed run may leave fuller or emptier."""
    files = (path for path in out.rglob("*") if path.is_file())
    contents = {str(path.relative_to(out)): path.read_bytes() for path in files}
    return {name: content for name, content in contents.items() if not name.startswith(".cache/")}

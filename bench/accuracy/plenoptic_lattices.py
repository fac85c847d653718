#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Plenoptic cameras with other lattices and patterns of lens types, from simulated images to the calibration.

    bench/plenoptic_lattices build/release/apps/plenocal

The camera of examples/simulate/plenoptic_stereo.yaml alone, with other micro lenses. Prints the distance of the micro-image
centres from the true ones and the errors of f_L and B. Three minutes.
"""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common

EXAMPLE = common.ROOT / "examples/simulate"
LATTICES = {
    "square": dict(lattice="rectangular", focus=[3.0]),
    "square, turned by 20 degrees": dict(lattice="rectangular", focus=[3.0], rotation=0.35),
    "rectangular, 19 x 23 px": dict(lattice="rectangular", row_pitch=23, focus=[3.0]),
    "square, two types as on a chessboard": dict(lattice="rectangular", focus=[2.6, 3.4]),
    "square, four types": dict(lattice="rectangular", focus=[2.4, 2.8, 3.2, 3.6]),
    "hexagonal, rows of two types": dict(focus=[2.6, 3.4], pattern=[[0], [1]]),
    "hexagonal, one in four": dict(focus=[2.6, 3.4], pattern=[[0, 0], [0, 1]]),
}


def centres(path):
    return [(float(row["x"]), float(row["y"])) for row in common.read_table(path)]


def measure(program, name, lenses):
    with common.folder() as folder:
        spec = common.load(EXAMPLE / "plenoptic_stereo.yaml")
        camera = spec["cameras"]["plenoptic"]
        for key in ("rotation", "focus"):
            lenses.setdefault(key, camera["micro_lenses"][key])
        camera["micro_lenses"].update(lenses)
        del camera["xi_camera_rig"]  # the first camera is the rig
        spec["cameras"] = {"plenoptic": camera}
        common.simulate(program, folder, spec, target=common.load(EXAMPLE / "target.yaml"))
        found = common.calibrate(program, folder / "set/session.yaml", folder / "out")["cameras"]["plenoptic"]
        true = common.load(folder / "set/truth/calibration.yaml")["cameras"]["plenoptic"]["parameters"]
        truth = centres(folder / "set/truth/micro_lenses_plenoptic.csv")
        found_lenses = list(common.read_table(folder / "out/micro_lenses_plenoptic.csv"))
        squares = [min((x - u)**2 + (y - v)**2 for u, v in truth) for x, y in centres(folder / "out/micro_lenses_plenoptic.csv")]
    with_sigma = lambda key: (f"{100 * (found['parameters'][key] / true[key] - 1):.3f} "
                              f"({abs(found['parameters'][key] - true[key]) / found['sigma'][key]:.1f})")
    types = len(set(number for row in lenses.get("pattern", [range(len(lenses["focus"]))]) for number in row))
    numbers = len({row["type"] for row in found_lenses})
    rms = (sum(squares) / len(squares) / 2)**0.5
    common.row(name, f"{numbers} of {types}", f"{len(squares)} of {len(truth)}", f"{rms:.4f}", with_sigma("f_L"), with_sigma("B"))


def main():
    parser = common.parser(__doc__, "program")
    parser.add_argument("--only", choices=LATTICES, nargs="+", default=LATTICES)
    options = parser.parse_args()
    common.head("lattice", "types", "micro lenses", "centres, px RMS", "f_L - truth, % (sigmas)", "B - truth, % (sigmas)")
    for name in options.only:
        measure(options.program, name, dict(LATTICES[name]))


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""CPU time of calibrations by models that are formulas, beside that of the headers of the same lenses.

    bench/speed/formulas.py build/release/apps/plenocal      # whole processes, 100 frames of 140 points, median of 5
"""
import pathlib
import statistics
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common

# Header: its formula and a lens.
LENSES = {
    "kannala-brandt4": ({
        "params": {"k_1": {"scale": 0.41}, "k_2": {"scale": 0.16}, "k_3": {"scale": 0.067}, "k_4": {"scale": 0.027}},
        "radius": "theta*(1 + sum(i, 1, 4, k_i*theta^(2*i)))",
    }, {"f_x": 210, "f_y": 212, "c_x": 322, "c_y": 243, "k_1": -0.01, "k_2": 0.003, "k_3": -0.0002, "k_4": 1e-05}),
    "pinhole-radtan8": ({
        "params": {"k_1": {}, "k_2": {}, "p_1": {}, "p_2": {}, "k_3": {}, "k_4": {}, "k_5": {}, "k_6": {}},
        "let": {"u": "X/Z", "v": "Y/Z", "q": "u^2 + v^2",
                "g": "(1 + q*(k_1 + q*(k_2 + q*k_3)))/(1 + q*(k_4 + q*(k_5 + q*k_6)))"},
        "map": ["u*g + 2*p_1*u*v + p_2*(q + 2*u^2)", "v*g + p_1*(q + 2*v^2) + 2*p_2*u*v"],
    }, {"f_x": 400, "f_y": 402, "c_x": 320, "c_y": 241, "k_1": 0.15, "k_2": 0.06, "p_1": 0.0008, "p_2": -0.0005, "k_3": -0.008,
        "k_4": 0.33, "k_5": 0.05, "k_6": -0.004}),
    "double-sphere": ({
        "params": {"xi": {"bounds": [-1, 1], "start": [0, -0.3, 0.5]}, "alpha": {"bounds": [0, 1], "start": 0.5}},
        "let": {"r2": "X^2 + Y^2", "d_1": "sqrt(r2 + Z^2)", "z_1": "xi*d_1 + Z",
                "h": "alpha*sqrt(r2 + z_1^2) + (1 - alpha)*z_1",
                "w_1": "if(alpha <= 0.5, alpha/(1 - alpha), (1 - alpha)/alpha)",
                "w_2": "(w_1 + xi)/sqrt(2*w_1*xi + xi^2 + 1)"},
        "map": ["X/h", "Y/h"], "domain": ["Z > -w_2*d_1", "h > 0"],
    }, {"f_x": 190, "f_y": 191, "c_x": 322, "c_y": 243, "xi": -0.18, "alpha": 0.59}),
    "division": ({
        "params": {"lambda": {}}, "ray": ["x", "y", "1 + lambda*(x^2 + y^2)"],
    }, {"f_x": 250, "f_y": 252, "c_x": 322, "c_y": 243, "lambda": -0.22}),
}
TARGET = {"type": "chessboard", "columns": 14, "rows": 10, "square": 0.03}
FORMULA = "of-the-header"


def main():
    parser = common.parser(__doc__, "plenocal")
    parser.add_argument("--repeats", default=5, type=int)
    options = parser.parse_args()
    print(f"{'lens':16} {'form':7} {'header, s':>10} {'formula, s':>11} {'ratio':>6}")
    for name, (formula, values) in LENSES.items():
        with common.folder() as folder:
            data = common.simulate(options.plenocal, folder, {
                "seed": 2, "cameras": {"camera": {"model": name, "image_size": [640, 480], "parameters": values, "detection_sigma": 0.05}},
                "poses": {"frames": 100, "distance": [0.25, 0.6], "partial": 0.3}}, "--points", target=TARGET)
            session = common.load(data / "session.yaml")
            session["models"] = {FORMULA: formula | {"example": list(values.values())}}
            session["cameras"]["camera"]["model"] = FORMULA
            common.save(data / "formula.yaml", session)
            times = {file: [] for file in ("session.yaml", "formula.yaml")}
            for _ in range(options.repeats):
                for file, seconds in times.items():
                    seconds.append(common.timed(options.plenocal, "calibrate", data / file, "-o", folder / file, "--no-report",
                                                "--quiet", "--threads", 1)[2])
            header, own = (statistics.median(seconds) for seconds in times.values())
            form = next(key for key in ("radius", "map", "ray") if key in formula)
            print(f"{name:16} {form:7} {header:10.2f} {own:11.2f} {own / header:6.2f}", flush=True)


if __name__ == "__main__":
    main()

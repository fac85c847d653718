#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Does `plenocal try` name what a camera model lacks, and nothing that is there?

    bench/missing --program build/release/apps/plenocal                  # 200 cameras of each family, 500 that lack nothing
    bench/missing --families tilt skew --cases 20

A camera of a model with a part is simulated (0.05 px noise, 30 frames of 140 points), and calibrated by the model without it.
The part is as large as `--sigmas` standard errors that the calibration by the true model states for it (in a random direction of
its parameters). Printed beside the share of cameras whose first named family is the right one: the power of the ideal test, which
is given the family and its fields, at 5 % / 8. Decentring, prism and tilt are one family, `asymmetric`, within which they differ
little; `member` is the share that has the very member first. `board` is a bent target, `none` a camera that lacks nothing.
"""
import collections
import math
import pathlib
import random
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
import numpy as np
from scipy import stats

SIZE = [640, 480]
COLUMNS, ROWS, SQUARE = 14, 10, 0.03
ASYMMETRIC = {"decentring", "prism", "tilt"}
FAMILIES_TESTED = 8

# Family: model without it, model with it, its parameters.
LENSES = {
    "radial": ("ucm", "ucm+radial4", ["k_1", "k_2"]),
    "decentring": ("pinhole-radial3", "pinhole-radial3+decentring", ["p_1", "p_2"]),
    "prism": ("pinhole-radtan8", "pinhole-radtan12", ["s_1", "s_2", "s_3", "s_4"]),
    "tilt": ("pinhole-radtan", "pinhole-radtan+tilt", ["tau_x", "tau_y"]),
    "skew": ("pinhole-radtan", "pinhole-radtan+skew", ["alpha_s"]),
    "pupil": ("kannala-brandt4", "kannala-brandt4+pupil", ["e_0", "e_1", "e_2"]),
}


def lens(model, rng):
    """Parameters of a plausible lens of a model without parts."""
    u = rng.uniform
    focal = u(200, 320) if model in ("ucm", "kannala-brandt4") else u(330, 600)
    values = {"f_x": focal, "f_y": focal * u(0.98, 1.02), "c_x": 319.5 + u(-12, 12), "c_y": 239.5 + u(-12, 12)}
    if model == "ucm":
        values |= {"alpha": u(0.4, 0.7)}
    if model == "kannala-brandt4":
        values |= {"k_1": u(-0.05, 0.05), "k_2": u(-0.01, 0.01), "k_3": 0.0, "k_4": 0.0}
    if model == "pinhole-radial3":
        values |= {"A_0": u(-0.3, -0.1), "A_1": u(0.03, 0.12), "A_2": u(-0.03, 0)}
    if model == "pinhole-radtan":
        values |= {"k_1": u(-0.3, -0.1), "k_2": u(0.03, 0.12), "k_3": u(-0.03, 0)}
    if model == "pinhole-radtan8":
        values |= {"k_1": u(0.2, 0.6), "k_2": u(0, 0.1), "k_3": u(0, 0.01),
                   "k_4": u(0.5, 0.9), "k_5": u(0.05, 0.2), "k_6": u(0, 0.02)}
    if "radtan" in model:
        values |= {"p_1": u(-2e-3, 2e-3), "p_2": u(-2e-3, 2e-3)}
    return values


def board(bend=0.0):
    """A chessboard whose corners stand out of its plane by `bend`, m."""
    flat = {"type": "chessboard", "columns": COLUMNS, "rows": ROWS, "square": SQUARE}
    if not bend:
        return flat
    middle = np.array([COLUMNS - 1, ROWS - 1]) / 2
    markers = {}
    for i in range(ROWS * COLUMNS):
        place = np.array([i % COLUMNS, i // COLUMNS])
        out = float(bend * np.sum((place - middle) ** 2) / np.sum(middle ** 2))
        markers[i] = [float(SQUARE * place[0]), float(SQUARE * place[1]), out]
    return flat | {"markers": markers}


def simulate(program, folder, model, values, seed, target):
    spec = {"seed": seed, "target_error": 0,
            "cameras": {"camera": {"model": model, "image_size": SIZE, "parameters": values, "detection_sigma": 0.05}},
            "poses": {"frames": 30, "distance": [0.25, 0.6], "partial": 0.3}}
    return common.simulate(program, folder, spec, "--points", target=target, out=f"set_{seed}")


def sized(program, folder, family, values, rng, sigmas):
    """The part's parameters, as large as `sigmas` of the calibration of a camera whose part is neutral."""
    _, model, names = LENSES[family]
    neutral = simulate(program, folder, model, values | dict.fromkeys(names, 0.0), 1, board())
    camera = common.calibrate(program, neutral / "session.yaml", folder / "neutral")["cameras"]["camera"]
    order = list(camera["parameters"])
    sigma, places = [camera["sigma"][name] for name in order], [order.index(name) for name in names]
    of_part = np.array([[camera["correlation"][max(i, j)][min(i, j)] * sigma[i] * sigma[j] for j in places] for i in places])
    if not np.all(np.isfinite(of_part)):
        raise common.Failed("the images leave the part open")
    direction = np.array([rng.gauss(0, 1) for _ in names])
    squares, axes = np.linalg.eigh(of_part)  # of rounded correlations: may be below zero by rounding
    direction = axes @ (np.sqrt(np.maximum(squares, 0)) * direction / np.linalg.norm(direction))
    return dict(zip(names, map(float, sigmas * direction)))


def named(program, folder, data, model, target):
    """The families that `try` names, the first first, with this target in the session."""
    common.save(data / "target.yaml", target)
    common.run(program, "try", data / "session.yaml", "--models", model, "-o", folder / "out", "--quiet", "--threads", 1)
    return [each["family"] for each in common.load(folder / "out/try.yaml").get("missing", [])]


def case(options, family, number):
    rng = random.Random(f"{options.seed} {family} {number}")
    model = LENSES.get(family, rng.choice(list(LENSES.values())))[0]
    with common.folder() as folder:
        for _ in range(20):  # lenses whose image folds are drawn again
            values = lens(model, rng)
            try:
                if family in LENSES:
                    more = sized(options.program, folder, family, values, rng, options.sigmas)
                    data = simulate(options.program, folder, LENSES[family][1], values | more, 2, board())
                else:
                    bend = options.bend * rng.choice([-1, 1]) if family == "board" else 0
                    data = simulate(options.program, folder, model, values, 2, board(bend))
            except common.Failed as error:
                failed = error
                continue
            return named(options.program, folder, data, model, board())
        raise failed


def main():
    parser = common.parser(__doc__)
    parser.add_argument("--cases", default=200, type=int, help="of each family")
    parser.add_argument("--correct", default=500, type=int, help="cameras that lack nothing")
    parser.add_argument("--families", nargs="+", default=[*LENSES, "board", "none"])
    parser.add_argument("--sigmas", default=4.1, type=float)
    parser.add_argument("--bend", default=0.0005, type=float, help="of the bent target's corners, m")
    parser.add_argument("--seed", default=1, type=int)
    parser.add_argument("--jobs", default=2, type=int)
    options = parser.parse_args()
    print(f"{'family':12} {'cases':>6} {'right':>7} {'ideal':>7} {'member':>7} {'other':>7} {'silent':>7}  first")
    for family in options.families:
        count = options.correct if family == "none" else options.cases
        group = ASYMMETRIC if family in ASYMMETRIC else {family}
        found = list(common.in_threads(options.jobs, lambda number: case(options, family, number), range(count)))
        right = sum(bool(names) and names[0] in group for names in found)
        member = sum(bool(names) and names[0] == family for names in found)
        silent = sum(not names for names in found)
        first = " ".join(f"{name}:{n}" for name, n in collections.Counter(names[0] for names in found if names).most_common())
        ideal = math.nan
        if family in LENSES:
            degrees = len(LENSES[family][2])
            ideal = stats.ncx2.sf(stats.chi2.isf(0.05 / FAMILIES_TESTED, degrees), degrees, options.sigmas ** 2)
        print(f"{family:12} {count:6d} {right / count:7.3f} {ideal:7.3f} {member / count:7.3f} {(count - right - silent) / count:7.3f} "
              f"{silent / count:7.3f}  {first}", flush=True)


if __name__ == "__main__":
    main()

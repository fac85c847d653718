#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Do the start values of `double-sphere` lead to the best of its minima?

    bench/accuracy/double_sphere_starts.py --program build/release/apps/plenocal        # 100 lenses

Random lenses over the model's range, seen in 20 views of noisy points, are calibrated without start values and from the
true ones. A calibration counts as good when its RMS is not above that from the truth (by 0.05 %) with no more points rejected.
"""
import math
import pathlib
import random
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common

TARGET = {"type": "chessboard", "columns": 14, "rows": 10, "square": 0.03}
RADIUS_PX = 400  # from the image's middle to its corners


def radius(xi, alpha, theta):
    """Distance from the principal point for f = 1; nothing outside the domain."""
    z = xi + math.cos(theta)
    h = alpha * math.hypot(math.sin(theta), z) + (1 - alpha) * z
    return math.sin(theta) / h if h > 0 else None


def lens(rng):
    """Parameters of a lens whose image grows up to its corners."""
    while True:
        xi, alpha = rng.uniform(-0.6, 0.9), rng.uniform(0.1, 0.8)
        to_corner = math.radians(rng.uniform(40, 95))
        radii = [radius(xi, alpha, to_corner * i / 100) for i in range(101)]
        if None in radii or any(b <= a for a, b in zip(radii, radii[1:])):
            continue
        f = RADIUS_PX / radii[-1]
        if f < 60:  # the middle of the image would shrink to a few pixels
            continue
        return {"f_x": f, "f_y": f * rng.uniform(0.98, 1.02), "c_x": 319.5 + rng.uniform(-12, 12),
                "c_y": 239.5 + rng.uniform(-12, 12), "xi": xi, "alpha": alpha}


def calibrate(program, folder, session, result):
    try:
        return common.calibrate(program, folder / "set" / session, folder / result)["cameras"]["camera"]
    except common.Failed:
        return None


def main():
    parser = common.parser(__doc__)
    parser.add_argument("--lenses", default=100, type=int)
    parser.add_argument("--seed", default=1, type=int)
    parser.add_argument("--noise", default=0.05, type=float, help="px")
    options = parser.parse_args()
    rng, done, good = random.Random(options.seed), 0, 0
    while done < options.lenses:
        parameters = lens(rng)
        near = rng.uniform(0.15, 0.25) * parameters["f_x"] / 200
        spec = {"seed": rng.randrange(1 << 30), "target_error": 0,
                "cameras": {"camera": {"model": "double-sphere", "image_size": [640, 480], "parameters": parameters,
                                       "detection_sigma": options.noise}},
                "poses": {"frames": 20, "distance": [near, 2.5 * near], "partial": 0.3}}
        with common.folder() as folder:
            try:
                common.simulate(options.program, folder, spec, "--points", target=TARGET)
            except common.Failed:
                continue  # no view shows enough of the target
            done += 1
            session = common.load(folder / "set/session.yaml")
            session["cameras"]["camera"]["initial"] = parameters
            common.save(folder / "set/from_truth.yaml", session)
            found = calibrate(options.program, folder, "session.yaml", "found")
            known = calibrate(options.program, folder, "from_truth.yaml", "known")
        if found and (known is None or
                      found["residuals"]["rms"] <= 1.0005 * known["residuals"]["rms"] + 1e-6 and
                      found["residuals"]["rejected"] <= known["residuals"]["rejected"] + 1):
            good += 1
            continue
        print({key: round(value, 4) for key, value in parameters.items()})
        for title, camera in (("found", found), ("from the truth", known)):
            if camera:
                print(f"  {title}: RMS {camera['residuals']['rms']:.4f} px, {camera['residuals']['rejected']} rejected, "
                      f"{camera['parameters']}", flush=True)
    print(f"as good as from the truth: {good} of {options.lenses}")
    sys.exit(0 if good >= 0.99 * options.lenses else 1)


if __name__ == "__main__":
    main()

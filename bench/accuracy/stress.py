#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How often do the stress tests of `plenocal try` fail on cameras that lack nothing?

    bench/stress --program build/release/apps/plenocal --cases 150

The cameras are those of bench/missing: 0.05 px noise, 30 frames of 140 points. Per test: how many of the sessions fail in it
(corrected by Holm), rows without a result, and the RMS of difference over predicted.
"""
import collections
import math
import pathlib
import random
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
import missing


def case(options, number):
    rng = random.Random(f"{options.seed} {number}")
    model = rng.choice(list(missing.LENSES.values()))[0]
    with common.folder() as folder:
        for _ in range(20):  # lenses whose image folds are drawn again
            try:
                values = missing.lens(model, rng)
                data = missing.simulate(options.program, folder, model, values, number + 1, missing.board())
            except common.Failed as error:
                failed = error
                continue
            common.run(options.program, "try", data / "session.yaml", "--models", model, "-o", folder / "out", "--stress",
                       "--quiet", "--threads", 1)
            return model, common.load(folder / "out/try.yaml")["stress"]
        raise failed


def main():
    parser = common.parser(__doc__)
    parser.add_argument("--cases", default=150, type=int)
    parser.add_argument("--seed", default=1, type=int)
    parser.add_argument("--jobs", default=2, type=int)
    options = parser.parse_args()
    found = list(common.in_threads(options.jobs, lambda number: case(options, number), range(options.cases)))
    rows = collections.defaultdict(list)
    for _, tests in found:
        for test in tests:
            rows[test["what"]].append(test)
    print(f"{'test':14} {'fail':>6} {'without':>8} {'difference/predicted':>21} {'factor':>7}")
    for what, tests in rows.items():
        done = [test for test in tests if "failure" not in test]
        fail = sum(test["probability"] < 0.05 for test in done)
        ratio = math.sqrt(sum((test["difference"] / test["predicted"]) ** 2 for test in done) / len(done))
        factor = sum(test["factor"] for test in done) / len(done)
        print(f"{what:14} {fail:6d} {len(tests) - len(done):8d} {ratio:21.3f} {factor:7.2f}")
    alarms = [model for model, tests in found if any(test.get("probability", 1) < 0.05 for test in tests)]
    print(f"any: {len(alarms)} of {len(found)}: {dict(collections.Counter(alarms))}")


if __name__ == "__main__":
    main()

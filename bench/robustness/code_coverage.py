#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Lines, branches and functions of the product that its tests run, by room, counted by Clang 14.

    bench/code_coverage            # the whole suite
    bench/code_coverage -L fast    # words for ctest

Builds preset `clang` in build/coverage, without the server of the workbench and its tests. Only the project's sources have
counters: with those of Eigen's headers the tests take ten times as long. Each test runs on one processor, since threads
that share counters are slow as well. Branches of exceptions do not count. A test that fails does not stop the command.
"""
import collections
import json
import os
import pathlib
import re
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from common import ROOT

FOLDER = ROOT / "build/coverage"
PROFILES = FOLDER / "profiles"
ROOMS = ["calib", "targets", "models", "detectors", "assess", "engine", "apps"]
KINDS = ["lines", "branches", "functions"]


def build():
    subprocess.run([ROOT / "scripts/install_packages", "clang-14", "libclang-rt-14-dev", "llvm-14", "libgmock-dev", "libgtest-dev"],
                   check=True)
    PROFILES.mkdir(parents=True, exist_ok=True)
    counted = FOLDER / "counted.txt"
    counted.write_text(f"src:{ROOT}/*\n!src:/usr/*\n")
    flags = f"-fprofile-instr-generate -fcoverage-mapping -fprofile-list={counted}"
    subprocess.run(["cmake", "--preset", "clang", "-B", FOLDER, f"-DCMAKE_CXX_FLAGS={flags}",
                    "-DCMAKE_CXX_FLAGS_RELEASE=-O2 -DNDEBUG"], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    subprocess.run(["cmake", "--build", FOLDER], check=True)


def test(words):
    """Runs each n-th test on one of n processors."""
    for old in PROFILES.iterdir():
        old.unlink()
    processors = sorted(os.sched_getaffinity(0))
    runs = [subprocess.Popen(["taskset", "-c", str(processor), "ctest", "--output-on-failure", "-I", f"{first},,{len(processors)}",
                              *words], cwd=FOLDER, env={**os.environ, "LLVM_PROFILE_FILE": f"{PROFILES}/{first}_%2m.profraw"})
            for first, processor in enumerate(processors, 1)]
    for run in runs:
        run.wait()


def report():
    """{room: {kind: (covered, all)}}."""
    merged = FOLDER / "all.profdata"
    common.run("llvm-profdata-14", "merge", "-sparse", *PROFILES.iterdir(), "-o", merged)
    programs = [FOLDER / "apps/plenocal", *sorted(FOLDER.glob("tests/**/*_tests"))]
    objects = [word for path in programs for word in ("-object", path)]
    text = common.run("llvm-cov-14", "export", "-summary-only", "-instr-profile", merged, *objects).stdout
    rooms = collections.defaultdict(lambda: {kind: (0, 0) for kind in KINDS})
    for file in json.loads(text)["data"][0]["files"]:
        found = re.match(rf"{re.escape(str(ROOT))}/(\w+)/", file["filename"])
        if not found or found[1] not in ROOMS:
            continue
        for room in (found[1], "all"):
            for kind in KINDS:
                covered, count = rooms[room][kind]
                own = file["summary"][kind]
                rooms[room][kind] = covered + own["covered"], count + own["count"]
    return rooms


def main():
    if sys.argv[1:2] in (["-h"], ["--help"]):
        print(__doc__)
        return
    build()
    test(sys.argv[1:])
    rooms = report()
    common.head("room", *KINDS)
    for room in [*ROOMS, "all"]:
        common.row(room, *(f"{100 * covered / max(count, 1):.1f} % of {count}" for covered, count in rooms[room].values()))


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Does the same input give the same bytes?

    bench/robustness/same_bytes.py --program build/release/apps/plenocal               # 100 runs with 1, 2 and 3 threads: an hour of one core
    bench/robustness/same_bytes.py --program build/release/apps/plenocal --runs 5

Each command runs on 1, 2 and 3 threads, from the cache, in another folder, locale and time zone: the table has the number of
different results, which must be one. Then on an emulated processor without AVX2 and FMA: the bytes differ, and parameters may
by a hundredth of their standard errors. Exit status 1 where they differ by more. Installs QEMU; needs python3-yaml.
"""
import hashlib
import os
import pathlib
import shutil
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from data import small_sessions

COMMANDS = {
    "detect, plenoptic": ["detect", "plenoptic/session.yaml"],
    "focus": ["focus", "plenoptic/cam", "--white", "plenoptic/cam_white"],
    "calibrate, plenoptic": ["calibrate", "plenoptic/session.yaml"],
    "calibrate, ordinary": ["calibrate", "ordinary/session.yaml"],
    "try, ordinary": ["try", "ordinary/session.yaml", "--models", "pinhole,pinhole-radial3"],
    "simulate": ["simulate", "plenoptic.yaml"],
}
SURROUNDINGS = [{"LC_ALL": "comma"}, {"TZ": "Pacific/Chatham"}, {"TZ": "Asia/Tokyo", "LC_ALL": "comma"}]
NO_AVX2 = ["qemu-x86_64", "-cpu", "Nehalem"]
MOST_SIGMAS = 0.01
COMMA = 'comment_char %\nescape_char /\nLC_NUMERIC\ndecimal_point ","\nthousands_sep "."\ngrouping 3\nEND LC_NUMERIC\n'


class Bench:
    def __init__(self, program, folder):
        self.program, self.folder = program, folder
        small_sessions.make_sessions(program, folder)
        (folder / "locales").mkdir()
        (folder / "locales/source").write_text(COMMA)
        os.system(f"localedef -c -i {folder}/locales/source {folder}/locales/comma >/dev/null 2>&1")
        if not (folder / "locales/comma").is_dir():
            sys.exit("localedef makes no locale with a decimal comma")

    def run(self, arguments, folder, fresh=True, threads=1, variables={}, emulator=()):
        """Hash of the results in folder/out; without the cache, and with the folder's path, which stands in `provenance`, masked."""
        if fresh:
            shutil.rmtree(folder / "out", ignore_errors=True)
        common.run(*emulator, self.program, *arguments, "-o", "out", "--threads", threads, "--quiet", cwd=folder,
                   env={**os.environ, "LOCPATH": str(self.folder / "locales"), **variables})
        digest = hashlib.sha256()
        for path in sorted((folder / "out").rglob("*")):
            name = str(path.relative_to(folder / "out"))
            if path.is_file() and not name.startswith(".cache/"):
                digest.update(name.encode() + b"\0" + path.read_bytes().replace(str(folder).encode(), b"FOLDER"))
        return digest.hexdigest()

    def results(self, arguments, runs):
        """Hashes of all runs."""
        found = []
        for _ in range(runs):
            found += [self.run(arguments, self.folder, threads=threads) for threads in (1, 2, 3)]
            found.append(self.run(arguments, self.folder, fresh=False, threads=2))
        found += [self.run(arguments, self.folder, variables=variables) for variables in SURROUNDINGS]
        other = self.folder / "another folder/with ümlaut"
        shutil.copytree(self.folder / "plenoptic", other / "plenoptic", dirs_exist_ok=True)
        shutil.copytree(self.folder / "ordinary", other / "ordinary", dirs_exist_ok=True)
        for path in self.folder.glob("*.yaml"):
            shutil.copy(path, other)
        return found + [self.run(arguments, other)]

    def calibrated(self, arguments, emulator=()):
        """Parameters and their standard errors of a calibration."""
        self.run(arguments, self.folder, emulator=emulator)
        camera = common.load(self.folder / "out/calibration.yaml")["cameras"]["cam"]
        return camera["parameters"], camera["sigma"]


def main():
    parser = small_sessions.parser(__doc__, COMMANDS)
    parser.add_argument("--runs", type=int, default=100, help="for each number of threads, and from the cache")
    options = small_sessions.parse(parser, COMMANDS)
    subprocess.run([common.ROOT / "scripts/install_packages", "qemu-user"], check=True)
    passed = cases = 0
    with common.folder() as folder:
        bench = Bench(options.program, folder)
        common.head("command", "runs", "results", "without AVX2")
        for name in options.commands:
            arguments = COMMANDS[name]
            found = bench.results(arguments, options.runs)
            same = bench.run(arguments, bench.folder, emulator=NO_AVX2) == found[0]
            without = "the same bytes" if same else "other bytes"
            if arguments[0] == "calibrate":
                (with_it, sigma), (without_it, _) = bench.calibrated(arguments), bench.calibrated(arguments, NO_AVX2)
                most = max(abs(with_it[key] - without_it[key]) / sigma[key] for key in sigma if sigma[key])
                without += f", parameters within {most:.1g} standard errors"
                passed, cases = passed + (most <= MOST_SIGMAS), cases + 1
            common.row(name, len(found), len(set(found)), without)
            passed, cases = passed + found.count(found[0]), cases + len(found)
    common.finish(passed, cases)


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs what docs/reliability.md names as the tests of its promises, and prints its table: promise, test, cases, passed.

    bench/faults_of_machine                       # all
    bench/faults_of_machine --only power          # rows that match this expression
    bench/faults_of_machine --write               # also puts the numbers of these rows into the page
    bench/faults_of_machine --short --seed 1      # one test in eight, few kills, power cuts and runs
    bench/faults_of_machine --check               # runs nothing: does each row name tests that exist?

A test is a bench, or a program of tests with its filter. A case of a program is a test, or what it prints as "N of M passed", as
benches do. Exit status 1 when a case failed or a row names what does not exist.
"""
import os
import pathlib
import random
import re
import shlex
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common

PAGE = common.ROOT / "docs/reliability.md"
HEAD = "| promise | test | cases | passed |"
SHARE = 8  # of the tests, in the short run
SHORT = {
    "bench/kills": ["--kills", "2", "undistort"],
    "bench/robustness/power_cuts.py": ["--share", "0.05", "undistort"],
    "bench/robustness/same_bytes.py": ["--runs", "1", "calibrate, ordinary"],
    "bench/fuzz": ["--commands", "1"],
}


def rows():
    """Promise and commands of each row of the page, and the row itself."""
    table = PAGE.read_text().split(HEAD)[1].split("\n\n")[0]
    for row in table.splitlines()[2:]:
        promise, test = row.split(" | ")[:2]
        yield promise.removeprefix("| "), re.findall(r"`([^`]+)`", test), row


class Machine:
    def __init__(self, options):
        self.build, self.short, self.seed, self.done = options.build, options.short, options.seed, {}

    def tests(self, words):
        """Program and names of the tests of a command; None of a bench."""
        if words[0].startswith("bench/"):
            return None
        program = next(self.build.glob(f"tests/*/{words[0]}"), None)
        if not program:
            raise common.Failed(f"{words[0]}: no such program in {self.build}")
        names, suite = [], ""
        for line in common.run(program, "--gtest_list_tests", *words[1:]).stdout.splitlines()[1:]:
            if line.startswith("  "):
                names.append(suite + line.split()[0])
            else:
                suite = line.split()[0]
        if not names:
            raise common.Failed(f"{shlex.join(words)}: no such test")
        return program, names

    def check(self, command):
        words = shlex.split(command)
        if not self.tests(words) and not (common.ROOT / words[0]).exists():
            raise common.Failed(f"{words[0]}: no such bench")

    def run(self, command):
        """Numbers of cases passed and run; each command runs once."""
        if command not in self.done:
            words, passed, cases = shlex.split(command), 0, 0
            if found := self.tests(words):
                program, names = found
                if self.short:
                    names = random.Random(f"{self.seed} {command}").sample(names, -(-len(names) // SHARE))
                words = [program, f"--gtest_filter={':'.join(names)}"]
            else:
                words = [common.ROOT / words[0], *(SHORT.get(words[0], []) if self.short else words[1:]), "--seed", str(self.seed)]
            done = subprocess.run(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
                                  cwd=common.ROOT, env={**os.environ, "PLENOCAL_FUZZ_RUNS": "2"} if self.short else None)
            for good, count in re.findall(r"\b(\d+) of (\d+) passed", done.stdout):
                passed, cases = passed + int(good), cases + int(count)
            if not cases:
                skipped = re.findall(r"^\[  SKIPPED \].* ms\)", done.stdout, re.M)
                cases = len(re.findall(r"^\[ RUN ", done.stdout, re.M)) - len(skipped)
                passed = len(re.findall(r"^\[       OK", done.stdout, re.M))
            if done.returncode or passed < cases or not cases:
                print(f"{command}: exit status {done.returncode}\n{done.stdout[-4000:]}", file=sys.stderr)
                cases = max(cases, passed + 1)
            self.done[command] = passed, cases
        return self.done[command]


def main():
    parser = common.parser(__doc__, plenocal=None)
    parser.add_argument("--build", type=pathlib.Path, default=common.BUILD)
    parser.add_argument("--only", default="", help="rows that match this expression")
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--seed", type=int, default=1, help="of what is done at random")
    parser.add_argument("--write", action="store_true", help="numbers into the page")
    parser.add_argument("--check", action="store_true", help="that all tests exist")
    options = parser.parse_args()
    if options.write and options.short:
        parser.error("the page has the numbers of the long run")
    machine, failed, text = Machine(options), False, PAGE.read_text()
    chosen = [row for row in rows() if re.search(options.only, row[-1])]
    if not chosen:
        parser.error(f"no row matches {options.only}")
    if options.check:
        for _, commands, row in chosen:
            if not commands or row.count("|") != HEAD.count("|"):
                raise common.Failed(f"a row is not of the form {HEAD}: {row}")
            for command in commands:
                machine.check(command)
        return
    print(f"{HEAD}\n| --- | --- | --- | --- |")
    for promise, commands, row in chosen:
        results = [machine.run(command) for command in commands]
        passed, cases = (sum(column) for column in zip(*results))
        new = f"| {promise} | {row.split(' | ')[1]} | {cases} | {'all' if passed == cases else passed} |"
        print(new, flush=True)
        text = text.replace(row, new)
        failed |= passed < cases
    if options.write:
        PAGE.write_text(text)
    sys.exit(failed)


if __name__ == "__main__":
    main()

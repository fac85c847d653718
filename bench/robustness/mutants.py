#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Changes single operators, literals, conditions, statements and arguments of the code: does a test fail?

    bench/mutants assess/missing calib/noise --work /tmp/mutants
    bench/mutants calib/prior --work /tmp/mutants --count 40 --seed 2 --tests '^(calib|engine)/'
    bench/mutants apps/cli,detectors,targets --work /tmp/mutants --count 300 --units 80 --slow
    bench/mutants --mistakes 20 --work /tmp/mutants --seed 7   # made by hand: a wrong unit, a dropped covariance, ...

A room is a folder of the source tree, or several folders and files, joined by commas. A seeded sample of the places in its
functions that can be changed is compiled, all behind switches, into the tests of a copy of the tree, in the folder --work. Each test runs once without a mutant, which
tells the places that it reaches. Then each mutant is switched on, and the tests that reach it run, quickest first, until one
fails or takes ten times its time and 10 s more. A mutant that passes them is a survivor: no test notices the change. The library's
assertions are on, as in the preset asan, so that an index past the end fails.
Needs GCC and libclang (Debian: python3-clang-14 with /usr/bin/python3); tests of optional data sets and of browsers do not run.
"""
import collections
import concurrent.futures
import json
import os
import pathlib
import random
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import time

import clang.cindex

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from robustness import mistakes, mutation_points

HEADER = """// SPDX-License-Identifier: Apache-2.0
#pragma once
// A mutant may lack the statement that returns or throws at a function's end.
#pragma GCC diagnostic ignored "-Wreturn-type"
#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>
#include <cstdlib>
struct PlenocalMutants {
  int active = -1;
  volatile char* reached = nullptr;
  PlenocalMutants() {
    if (const char* const number = std::getenv("PLENOCAL_MUTANT")) active = std::atoi(number);
    const char* const name = std::getenv("PLENOCAL_MUTANT_REACHED");
    const int file = name == nullptr ? -1 : open(name, O_RDWR | O_CLOEXEC);
    if (file < 0) return;
    void* const bytes = mmap(nullptr, COUNT, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (bytes != MAP_FAILED) reached = static_cast<volatile char*>(bytes);
    close(file);
  }
};
inline const PlenocalMutants plenocal_mutants;
inline bool plenocal_mutant(int n) {
  if (plenocal_mutants.reached != nullptr) plenocal_mutants.reached[n] = 1;
  return plenocal_mutants.active == n;
}
"""
MEMORY = 8 << 30  # bytes of address space of a test: a mutant may allocate without end


def joined(paths):
    """A source that includes others: common headers are read once."""
    return "".join(f'#include "{path}"\n' for path in paths)


def parse(paths, words):
    kept = [word for before, word in zip(["", *words], words)
            if word.startswith(("-I", "-D", "-std", "-isystem")) or before == "-isystem"]
    unit = clang.cindex.Index.create().parse("joined.cc", args=kept, unsaved_files=[("joined.cc", joined(paths))])
    errors = [each for each in unit.diagnostics if each.severity >= clang.cindex.Diagnostic.Error]
    if errors:
        raise common.Failed(f"{errors[0].location.file}:{errors[0].location.line}: {errors[0].spelling}")
    return unit


def finders_of(words, paths):
    """Finders of sources that one unit includes; none of a unit that libclang cannot read."""
    try:
        unit = parse(paths, words)
    except common.Failed as error:
        print(f"left out: {', '.join(path.name for path in paths)}: {error}", file=sys.stderr)
        return []
    return [mutation_points.Finder(path, unit) for path in paths]


def write_compiled(words, sources, points):
    """Writes the files of a room (path -> source) with its points (number -> point); returns those that the compiler takes."""
    while True:
        own = {path: [each for each in points.items() if each[1].path == path] for path in sources}
        rewritten = {path: mutation_points.rewrite(source, own[path]) for path, source in sources.items()}
        for path, (text, _) in rewritten.items():
            path.write_bytes(text.encode("latin-1"))
        check = ["-fsyntax-only", "-Wno-subobject-linkage", "-Wno-invalid-pch", "-fdiagnostics-color=never", "-x", "c++", "-"]
        done = subprocess.run([*words, *check], input=joined(sources), capture_output=True, text=True)
        if done.returncode == 0:
            return points
        refused = set().union(*(mutation_points.refused(path, *each, done.stderr) for path, each in rewritten.items()))
        if not refused:
            raise common.Failed(done.stderr[:4000])
        points = {number: point for number, point in points.items() if number not in refused}


def copy_tree(work):
    """Makes `work` a copy of the sources; files that are the same keep their times, those of an earlier copy go."""
    names = common.run("git", "ls-files", "-co", "--exclude-standard", cwd=common.ROOT).stdout.splitlines()
    for path in {work / name.split("/")[0] for name in names if "/" in name}:
        for file in path.rglob("*"):
            if file.is_file() and str(file.relative_to(work)) not in names:
                file.unlink()
    for name in names:
        source, copy = common.ROOT / name, work / name
        if source.is_symlink() or not source.is_file() or copy.is_file() and copy.read_bytes() == source.read_bytes():
            continue
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(source.read_bytes())
        copy.chmod(source.stat().st_mode)


def unity_of(path, entries):
    """The unity source that includes a source file, and the words that compile it, without output and input."""
    for file, command in entries:
        if file == path or file.suffix == ".cxx" and f'"{path}"' in file.read_text():
            words = shlex.split(command)
            return file, tuple(words[words.index("ccache") + 1 if "ccache" in words else 0:words.index("-o")])
    raise common.Failed(f"{path}: no target compiles it")


class Suite:
    """Tests of a build: name -> words of its command."""

    def __init__(self, build, options):
        shown = json.loads(common.run("ctest", "--test-dir", build, "--show-only=json-v1").stdout)
        self.commands, self.seconds, self.noticed = {}, {}, collections.Counter()
        for test in shown["tests"]:
            labels = next((each["value"] for each in test["properties"] if each["name"] == "LABELS"), [])
            wanted = re.search(options.tests, test["name"]) and (options.slow or "slow" not in labels)
            if wanted and "command" in test and test["command"][0].endswith("_tests"):
                self.commands[test["name"]] = test["command"]

    def run(self, name, seconds, **environment):
        """Whether a test passes within this time, and its seconds."""
        start = time.monotonic()
        with tempfile.TemporaryDirectory(prefix="mutant_") as folder:
            variables = {**os.environ, "TMPDIR": folder, "GTEST_FAIL_FAST": "1", **environment}
            variables.pop("PLENOCAL_DATA", None)
            words = ["prlimit", f"--as={MEMORY}", f"--fsize={MEMORY}", "--core=0", *self.commands[name]]
            test = subprocess.Popen(words, cwd=folder, env=variables, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                                    stderr=subprocess.DEVNULL, start_new_session=True)
            try:
                passed = test.wait(timeout=seconds) == 0
            except subprocess.TimeoutExpired:
                passed = False
            try:
                os.killpg(test.pid, signal.SIGKILL)
            except ProcessLookupError:
                pass
            test.wait()
        return passed, time.monotonic() - start

    def reach(self, name, count):
        """The points that a test reaches, none if it fails; learns its time."""
        with tempfile.NamedTemporaryFile() as file:
            file.truncate(count)
            passed, self.seconds[name] = self.run(name, 600, PLENOCAL_MUTANT_REACHED=file.name)
            if not passed:
                print(f"{name} fails without a mutant", file=sys.stderr)
                return set()
            return {n for n, byte in enumerate(pathlib.Path(file.name).read_bytes()) if byte}

    def try_mutant(self, number, path, top, names, seconds):
        """Whether a test notices a mutant of a file below the folder `top`, and how many have run.

        Those first that have noticed others of the file, and those of the folder itself, in which most are noticed.
        """
        start = time.monotonic()
        foreign_factor = 10
        cost = {name: self.seconds[name] / (1 + self.noticed[path, name]) * (1 if name.startswith(f"{top}/") else foreign_factor)
                for name in names}
        for ran, name in enumerate(sorted(names, key=cost.get)):
            if time.monotonic() - start > seconds:
                return False, ran
            if not self.run(name, 10 * self.seconds[name] + 10, PLENOCAL_MUTANT=str(number))[0]:
                self.noticed[path, name] += 1
                return True, ran + 1
        return False, len(names)


def sampled_of(count):
    """Places to sample for so many mutants: some do not compile."""
    return count + count // 4 + 5


def by_unity(paths, entries):
    """Files that one unity source includes, with the words that compile it."""
    unities = collections.defaultdict(list)
    for path in paths:
        unities[unity_of(path, entries)].append(path)
    return [(words, files) for (_, words), files in unities.items()]


def choose(room, first, options, entries):
    """Of a room: the sampled points that compile, numbered from `first`, and how many it has; its files are written with them."""
    names = [options.work / name for name in room.split(",")]
    unities = by_unity(sorted(path for name in names for path in ([name] if name.is_file() else name.rglob("*.cc"))), entries)
    draw = random.Random(f"{options.seed} {room}")
    if options.units:
        unities = draw.sample(unities, min(len(unities), options.units))
    with concurrent.futures.ProcessPoolExecutor(options.jobs) as pool:
        finders = [finder for own in pool.map(finders_of, *zip(*unities)) for finder in own]
    points = [point for finder in finders for point in finder.points]
    compiled = dict(enumerate(draw.sample(points, min(len(points), sampled_of(options.count))), first))
    changed = {point.path for point in compiled.values()}
    for words, paths in unities:
        if changed.intersection(paths):
            compiled = write_compiled(words, {finder.path: finder.source for finder in finders if finder.path in paths}, compiled)
    compiled = dict(sorted(compiled.items()))
    return dict(list(compiled.items())[:options.count]), len(points)


def draw_mistakes(options, entries):
    """Points (number -> point) of a seeded sample of mistakes, and the numbers of each kind; their files are written."""
    drawn = random.Random(options.seed).sample(
        [(kind, *each) for kind, those in mistakes.MISTAKES.items() for each in those], options.mistakes)
    sources = {path: path.read_bytes().decode("latin-1") for path in {options.work / name for _, name, _, _ in drawn}}
    points, kinds = {}, collections.defaultdict(list)
    for number, (kind, name, text, mistaken) in enumerate(drawn):
        path = options.work / name
        points[number] = mutation_points.replaced(path, sources[path], text, mistaken)
        kinds[kind].append(number)
    headers = [path for path in sources if path.suffix == ".h"]
    for path in headers:
        own = [each for each in points.items() if each[1].path == path]
        path.write_bytes(mutation_points.rewrite(sources[path], own)[0].encode("latin-1"))
    for words, paths in by_unity(sorted(sources.keys() - set(headers)), entries):
        if write_compiled(words, {path: sources[path] for path in paths}, points) != points:
            raise common.Failed(f"a mistake does not compile in {', '.join(path.name for path in paths)}")
    return points, {kind: (len(mistakes.MISTAKES[kind]), numbers) for kind, numbers in kinds.items()}


def show(rooms, results):
    print()
    common.head("room", "places", "mutants", "never reached", "survivors", "noticed", "of those reached")
    for room, (places, own) in rooms.items():
        tried = [n for n in own if n in results]
        noticed = sum(results[n][0] for n in tried)
        common.row(room, places, len(own), len(own) - len(tried), len(tried) - noticed,
                   *(f"{100 * noticed / max(count, 1):.0f} %" for count in (len(own), len(tried))))


def main():
    parser = common.parser(__doc__, plenocal=None)
    parser.add_argument("rooms", nargs="*", metavar="ROOM", help="folder of the tree")
    parser.add_argument("--mistakes", type=int, default=0, metavar="N", help="no rooms but N of the mistakes of robustness/mistakes.py")
    parser.add_argument("--work", type=pathlib.Path, required=True, help="folder of the copy, which is kept for the next run")
    parser.add_argument("--count", type=int, default=100, help="mutants of a room")
    parser.add_argument("--units", type=int, default=0, metavar="N", help="translation units drawn from a room; 0: all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=60, help="of tests of one mutant; it survives when they are over")
    parser.add_argument("--tests", default="", help="expression that the tests' names match")
    parser.add_argument("--targets", nargs="+", help="test programs to build instead of all")
    parser.add_argument("--slow", action="store_true", help="tests of the label slow, too")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    if bool(options.rooms) == bool(options.mistakes):
        parser.error("give rooms or --mistakes")
    build = options.work / "build/release"
    start = time.monotonic()

    def end(stage):
        print(f"{time.monotonic() - start:.0f} s: {stage}", file=sys.stderr, flush=True)

    copy_tree(options.work)
    common.run("cmake", "--preset", "dev", "-DPLENOCAL_PYTHON=OFF", "-DCMAKE_CXX_FLAGS=-D_GLIBCXX_ASSERTIONS", cwd=options.work)
    end("copied and configured")
    commands = json.loads((build / "compile_commands.json").read_text())
    entries = [(pathlib.Path(each["file"]), each["command"]) for each in commands]
    mutants, rooms, count = {}, {}, len(options.rooms) * sampled_of(options.count) + options.mistakes
    (options.work / "plenocal_mutant.h").write_text(HEADER.replace("COUNT", str(count)))
    if options.mistakes:
        mutants, rooms = draw_mistakes(options, entries)
        end(f"{options.mistakes} mistakes drawn by seed {options.seed}")
    for index, room in enumerate(options.rooms):
        points, places = choose(room, index * sampled_of(options.count), options, entries)
        rooms[room] = places, list(points)
        mutants |= points
        end(f"{len(points)} of {places} places in {room} chosen")
    all_targets = common.run("ninja", "-C", build, "-t", "targets", "all").stdout
    targets = options.targets or re.findall(r"^(?:.*/)?(\w+_tests): CXX_EXECUTABLE", all_targets, re.M)
    common.run("cmake", "--build", build, "-j", options.jobs, "--target", *targets)
    end("built")
    suite = Suite(build, options)
    results = {}
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        tests = dict(zip(suite.commands, pool.map(lambda name: suite.reach(name, count), suite.commands)))
        end(f"{len(tests)} tests without a mutant")
        order = sorted(mutants, key=lambda n: (str(mutants[n].path), mutants[n].line))
        reached = {n: [name for name, points in tests.items() if n in points] for n in order}

        def attempt(n):
            path = mutants[n].path
            return suite.try_mutant(n, path, path.relative_to(options.work).parts[0], reached[n], options.seconds)
        for n, (noticed, ran) in zip(order, pool.map(attempt, order)):
            point = mutants[n]
            if reached[n]:
                results[n] = noticed, ran
            if options.mistakes and noticed:
                print(f"{point.path.relative_to(options.work)}:{point.line}: `{point.original}` -> `{point.mutated}`: noticed")
            if not noticed:
                passed = f"passes {ran} of {len(reached[n])} tests" if reached[n] else "never reached"
                place = f"{point.path.relative_to(options.work)}:{point.line}"
                print(f"{place}: `{point.original}` -> `{point.mutated}`: {passed}", flush=True)
    end(f"{len(results)} mutants")
    show(rooms, results)


if __name__ == "__main__":
    main()

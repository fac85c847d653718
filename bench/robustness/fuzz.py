#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Coverage-guided fuzzing of every reader, with address and undefined-behaviour sanitizers (libFuzzer); commands on changed sessions.

    bench/fuzz 8                    # 8 hours, equal shares for all readers
    bench/fuzz 0.1 session target   # these alone
    bench/fuzz --runs 1000000       # at least so many inputs for each reader, whatever the time
    bench/fuzz --quick --runs 2000 --seed 1   # of .ci/run: soon built, the same inputs in every run
    bench/fuzz --commands 1000 --seed 1       # 1000 inputs for each command (tests/fuzz/commands.cc), no readers
    bench/fuzz 0 run_calibrate_stereo run_try --commands 1000   # for these alone
    bench/fuzz --commands 1000 --assertions   # with the assertions of Eigen and the standard library (8 minutes to build)
    bench/fuzz 1 run_calibrate_stereo   # a command guided by coverage

Installs Clang, builds preset `fuzz`, and starts from tests/fuzz/corpus. An input fails that crashes the reader, is read for
more than 10 s or with more than 1 GB, leaks memory, gives a number that is not finite, or is refused without the file's name.
Inputs that found new code stay in build/fuzz/inputs for the next run; those that fail are put into build/fuzz/failures: mend
the reader, then move them into the corpus. Exit status 1 when an input failed. As many readers run at once as there are
processors. --quick compiles without optimization and without the sanitizer for undefined behaviour (in build/fuzz-quick).

--commands takes the optimized program of the tests (preset `dev`), without sanitizers and coverage: a command takes some 50
ms, of which sanitizers would make a second. Input k is made of the number SEED + k. A run fails that crashes, throws, takes
20 s of CPU or more than 1 GB, or has NaN, or infinity where none is declared, in a result.
"""
import concurrent.futures
import hashlib
import os
import pathlib
import re
import shutil
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from common import ROOT

CORPUS = ROOT / "tests/fuzz/corpus"
LONGEST_S, MOST_MEMORY_MB, LONGEST_INPUT = 10, 1024, 8192

# What breaks readers of numbers and of structure.
HOSTILE = ["nan", ".nan", "inf", "-inf", "-1", "0", "1e308", "1e-320", "1e9", "2147483647", "2147483648", "-2147483649",
           "4294967296", "18446744073709551616", "null", "~", "&a", "*a", "!!binary", "---", "? ", "|", ">", "{}", "[]", "''",
           '""', "\t", "\r\n", "#", "%YAML", "..", "/", "<![CDATA[", "&lt;", "<!--", "\u00e9", "\x1b"]


def build(quick):
    """The folder of the build."""
    folder = ROOT / ("build/fuzz-quick" if quick else "build/fuzz")
    variables = ["-DCMAKE_CXX_FLAGS_RELWITHDEBINFO=-O0 -gline-tables-only",
                 "-DPLENOCAL_SANITIZE=address,fuzzer-no-link"] if quick else []
    subprocess.run([ROOT / "scripts/install_packages", "clang-14", "libclang-rt-14-dev", "libfuzzer-14-dev"], check=True)
    subprocess.run(["cmake", "--preset", "fuzz", "-B", folder, *variables], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    subprocess.run(["cmake", "--build", folder, "--target", "fuzz"], cwd=ROOT, check=True)
    return folder


def write_dictionary(path, corpus):
    """The words of the reader's corpus, the keys that docs/formats.md has, and hostile ones."""
    words = set(HOSTILE) | set(re.findall(r"`([a-z][a-zA-Z0-9_]*)`", (ROOT / "docs/formats.md").read_text()))
    for file in corpus.iterdir() if corpus.exists() else ():
        words |= set(re.findall(r"[A-Za-z_][A-Za-z0-9_]{1,31}", file.read_bytes().decode("latin-1")))
    lines = ("".join(chr(b) if 32 < b < 127 and chr(b) not in '"\\' else f"\\x{b:02x}" for b in word.encode())
             for word in sorted(words))
    path.write_text("".join(f'"{line}"\n' for line in lines))


def program_in(folder):
    return folder / "tests/fuzz/fuzz"


def fuzz(folder, reader, options, seconds):
    """Inputs run, edges found beyond those of the corpus, and failures of one reader."""
    corpus, inputs, failures = CORPUS / reader, folder / "inputs" / reader, folder / "failures" / reader
    for place in (inputs, failures):
        place.mkdir(parents=True, exist_ok=True)
    before = set(failures.iterdir())
    dictionary = folder / "inputs" / f"{reader}.dict"
    write_dictionary(dictionary, corpus)
    limit = [f"-runs={options.runs}"] if options.runs else [f"-max_total_time={max(1, round(seconds))}"]
    command = [program_in(folder), inputs, *([corpus] if corpus.exists() else []), *limit, f"-timeout={LONGEST_S}",
               f"-rss_limit_mb={MOST_MEMORY_MB}", f"-max_len={LONGEST_INPUT}", f"-dict={dictionary}", f"-artifact_prefix={failures}/", "-print_final_stats=1",
               f"-seed={options.seed}", "-verbosity=1", "-close_fd_mask=1"]
    log = folder / "inputs" / f"{reader}.log"
    with open(log, "w") as out:
        # The sanitizer's store of freed memory, 256 MB otherwise, counts as memory of the reader.
        run = subprocess.Popen([str(word) for word in command], stdout=out, stderr=out,
                               env={**os.environ, "PLENOCAL_READER": reader, "ASAN_OPTIONS": "quarantine_size_mb=32"})
        run.wait()
    shutil.rmtree(f"/dev/shm/plenocal_fuzz_{run.pid}", ignore_errors=True)  # of a run that crashed
    text = log.read_text(errors="replace")
    edges = [int(count) for count in re.findall(r"cov: (\d+)", text)] or [0]
    runs = re.findall(r"number_of_executed_units: +(\d+)", text) or re.findall(r"^#(\d+)", text, re.M) or ["0"]
    failed = sorted(set(failures.iterdir()) - before)
    if "number_of_executed_units" not in text and not failed:
        raise RuntimeError(f"{reader}: the fuzzer did not run, see {log}")
    return int(runs[-1]), edges[-1] - edges[0], failed


def build_commands(assertions):
    """The folder of the build."""
    folder = ROOT / "build/fuzz-assertions" if assertions else common.BUILD
    variables = ["-DCMAKE_CXX_FLAGS_RELEASE=-O1", "-DCMAKE_CXX_FLAGS=-D_GLIBCXX_ASSERTIONS", "-DPLENOCAL_WEB=OFF",
                 "-DPLENOCAL_WERROR=OFF"] if assertions else []
    subprocess.run(["cmake", "--preset", "dev", "-B", folder, *variables], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    subprocess.run(["cmake", "--build", folder, "--target", "fuzz_tests"], cwd=ROOT, check=True)
    return folder


def fuzz_command(tests, name, options):
    """CPU seconds and failed inputs of one command."""
    failures = ROOT / "build/fuzz/failures" / name
    failures.mkdir(parents=True, exist_ok=True)
    test = f"Fuzz/EveryCommand.RunsOrRefusesChangedSessions/{name.replace('-', '_')}"
    run = subprocess.Popen([tests, f"--gtest_filter={test}"], stdout=subprocess.PIPE, text=True, errors="replace",
                           env={**os.environ, "PLENOCAL_FUZZ_RUNS": str(options.commands),
                                "PLENOCAL_FUZZ_SEED": str(options.seed)})
    text = run.stdout.read()
    _, status, usage = os.wait4(run.pid, 0)
    folder = pathlib.Path(f"/dev/shm/plenocal_fuzz_{run.pid}")
    failed = [bytes.fromhex(word) for word in re.findall(r"^input: ([0-9a-f]+)$", text, re.M)]
    if (folder / "choices").exists():  # of a run that crashed
        failed.append((folder / "choices").read_bytes())
        text += (folder / "session/console").read_text(errors="replace")
    shutil.rmtree(folder, ignore_errors=True)
    if status and not failed or "[ RUN " not in text:
        raise RuntimeError(f"{name}: {text[-2000:]}")
    paths = [failures / hashlib.sha1(content).hexdigest() for content in failed]
    for path, content in zip(paths, failed):
        path.write_bytes(content)
    (failures / "log").write_text(text)
    return usage.ru_utime + usage.ru_stime, paths


def fuzz_commands(names, options):
    """Failed inputs of all."""
    tests = build_commands(options.assertions) / "tests/fuzz/fuzz_tests"
    listed = common.run(tests, "--gtest_list_tests", "--gtest_filter=*EveryCommand*").stdout
    known = sorted(set(re.findall(r"GetParam\(\) = \"([^\"]+)\"", listed)))
    common.head("command", "inputs", "CPU s", "failures")
    failures = []
    with concurrent.futures.ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        results = [(name, pool.submit(fuzz_command, tests, name, options)) for name in names or known]
        for name, result in results:
            seconds, failed = result.result()
            common.row(name, options.commands, round(seconds), len(failed))
            failures += failed
    inputs = options.commands * len(results)
    print(f"\n{inputs - len(failures)} of {inputs} passed")
    return failures


def finish(failures):
    for path in failures:
        print(path, file=sys.stderr)
    sys.exit(1 if failures else 0)


def main():
    parser = common.parser(__doc__, plenocal=None)
    parser.add_argument("hours", type=float, nargs="?", default=0.1, help="for all readers together")
    parser.add_argument("readers", nargs="*", help="readers or commands (default: all readers; with --commands all commands)")
    parser.add_argument("--runs", type=int, help="inputs for each reader in place of a time")
    parser.add_argument("--seed", type=int, default=0, help="of libFuzzer's random numbers; 0: another one each time")
    parser.add_argument("--quick", action="store_true", help="build faster, find less")
    parser.add_argument("--commands", type=int, help="inputs for each command; no reader is fuzzed")
    parser.add_argument("--assertions", action="store_true", help="of Eigen and the standard library, for --commands")
    options = parser.parse_args()
    if options.commands:
        finish(fuzz_commands(options.readers, options))
    folder = build(options.quick)
    names = common.run(program_in(folder)).stdout.splitlines()
    known = [name.removeprefix("command ") for name in names]
    unknown = set(options.readers) - set(known)
    if unknown:
        parser.error(f"unknown: {', '.join(sorted(unknown))}; known: {', '.join(known)}")
    readers = options.readers or [name for name in names if " " not in name]
    common.head("reader", "inputs", "new edges", "failures")
    failures = []
    jobs = min(len(os.sched_getaffinity(0)), len(readers))
    with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
        results = [pool.submit(fuzz, folder, reader, options, jobs * options.hours * 3600 / len(readers)) for reader in readers]
        for reader, result in zip(readers, results):
            runs, edges, failed = result.result()
            common.row(reader, runs, edges, len(failed))
            failures += failed
    finish(failures)


if __name__ == "__main__":
    main()

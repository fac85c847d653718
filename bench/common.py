# SPDX-License-Identifier: Apache-2.0
"""What the benches share: arguments, running the program, folders, files, tables, times and means of errors.

A bench in a folder beside this module finds it by

    sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
"""
import argparse
import concurrent.futures
import contextlib
import csv
import pathlib
import resource
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
BUILD = ROOT / "build/release"


ANY_STATUS = range(-255, 256)


class Failed(SystemExit):
    """A command has failed. Not caught, it ends the bench with its message and exit status 1."""


def program(text):
    """The type of an argument that names a program."""
    path = pathlib.Path(text).resolve()
    if not path.is_file():
        raise argparse.ArgumentTypeError(f"no such program: {text}")
    return path


def parser(text, plenocal="--program"):
    """Parser of the arguments of a bench whose help is `text`; `plenocal`: the argument that names the program, None: there is none."""
    arguments = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    if plenocal:
        default = {"default": str(BUILD / "apps/plenocal")} if plenocal.startswith("-") else {}
        arguments.add_argument(plenocal, type=program, **default)
    return arguments


def run(*command, statuses=(0,), **more):
    """Runs a command with its output caught; raises Failed with its messages when it ends with another status."""
    words = [str(word) for word in command]
    done = subprocess.run(words, capture_output=True, text=True, **more)
    if done.returncode not in statuses:
        raise Failed(f"{' '.join(words)[:400]}: exit status {done.returncode}\n{done.stderr.strip() or done.stdout.strip()}")
    return done


def processor_seconds():
    """Of this process and of those that it has waited for, user and system."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def timed(*command, **more):
    """What `run` gives, seconds by the clock, and CPU seconds of the command."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    done = run(*command, **more)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return done, time.monotonic() - start, sum(after[:2]) - sum(before[:2])


def peak_megabytes():
    """Of the largest process that this one has waited for."""
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024


@contextlib.contextmanager
def folder(prefix="plenocal_"):
    """A folder that is deleted at the end."""
    with tempfile.TemporaryDirectory(prefix=prefix) as name:
        yield pathlib.Path(name)


def in_threads(jobs, function, items):
    """function(item) of each item in their order, `jobs` at a time, each as soon as it and those before it are there."""
    with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
        yield from pool.map(function, items)


# ---- files

def load(path):
    import yaml
    return yaml.load(path.read_text(), Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))


def save(path, content):
    """A file of Plenocal with these keys."""
    import yaml
    yaml.SafeDumper.ignore_aliases = lambda *_: True  # which Plenocal does not read
    path.write_text(yaml.safe_dump({"plenocal": 1, **content}, sort_keys=False, default_flow_style=None, width=1 << 20))


def read_table(path):
    """The rows of a CSV file by the names of its columns."""
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def simulate(plenocal, place, spec, *options, target=None, out="set"):
    """The folder place/out that `simulate` makes of `spec` and `target`, two dictionaries."""
    if target:
        save(place / "target.yaml", target)
        spec = {"target": "target.yaml", **spec}
    save(place / "spec.yaml", spec)
    run(plenocal, "simulate", place / "spec.yaml", "-o", place / out, "--quiet", *options)
    return place / out


def calibrate(plenocal, session, out, *options):
    """The calibration of a session, whose results are in the folder `out`."""
    run(plenocal, "calibrate", session, "-o", out, "--no-report", "--quiet", *options)
    return load(out / "calibration.yaml")


# ---- tables in Markdown

def row(*cells):
    print("| " + " | ".join(map(str, cells)) + " |", flush=True)


def head(*cells):
    row(*cells)
    row(*("---" for _ in cells))


def finish(passed, cases):
    """Ends a bench with the line that bench/faults_of_machine reads, and with exit status 1 unless all cases have passed."""
    print(f"\n{passed} of {cases} passed")
    sys.exit(passed < cases)


def mean_square(values):
    return statistics.fmean(value * value for value in values)


def errors_in_sigmas(camera, truth):
    """Of a camera's parameters in calibration.yaml: (estimate - truth) / sigma of each, and chi-square over their number (its mean is 1)."""
    import numpy as np
    z = {key: (camera["parameters"][key] - truth["parameters"][key]) / sigma for key, sigma in camera["sigma"].items() if sigma}
    kept = [i for i, sigma in enumerate(camera["sigma"].values()) if sigma]
    correlation = np.zeros((len(camera["sigma"]),) * 2)
    for i, row in enumerate(camera["correlation"]):
        correlation[i, :i + 1] = correlation[:i + 1, i] = row
    values = np.array(list(z.values()))
    return z, values @ np.linalg.solve(correlation[np.ix_(kept, kept)], values) / len(values)


def rms(values):
    return mean_square(values)**0.5

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Is every standard error true that Plenocal writes? One Monte Carlo case or more for each of them.

    bench/honest --program build/release/apps/plenocal --all --results FILE     # six hours of two cores
    bench/honest --program build/release/apps/plenocal --quick                  # ten minutes
    bench/honest --program build/release/apps/plenocal --cases ordinary ring --runs 50
    bench/honest --results FILE --write docs/uncertainty.md                     # the table between its marks

Runs are seeded and independent of each other; their results stand in FILE, a line a run, and are not repeated for the same
program. Values of one run are correlated: the standard errors of a mean and of a share are those of the runs'. A row is OUTSIDE where
its mean is not within 0.8 and 1.25, or less than 92 % of its values are within 1.96 sigma: the share of normal errors with a mean of
1.25. The share counts where few values have by far the largest errors, which make the mean's own standard error large. Exit
status 1 where one of 8 runs or more is outside by more than 2.6 of its standard errors and REASONS has no reason. Times are
those of the processor. Cases are in honest_cases.py, what makes their points in honest_points.py. Needs numpy and PyYAML; cases
from images (named in the list of a run that lacks it) OpenCV's Python module.
"""
import concurrent.futures
import hashlib
import json
import math
import os
import pathlib
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # two processes at most
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from accuracy import honest_cases

LOW, HIGH, LIMIT = 0.8, 1.25, 2.6
COVERED = math.erf(1.96 / math.sqrt(2 * HIGH))  # share of normal errors within 1.96 sigma whose mean is HIGH
FEWEST = 8  # runs whose scatter is a standard error
BEGIN, END = "<!-- bench/honest: begin -->\n", "<!-- bench/honest: end -->\n"


def run(job):
    program, name, seed = job
    record = {"case": name, "seed": seed}
    start = common.processor_seconds()
    with common.folder() as folder:
        try:
            record["values"] = honest_cases.CASES[name].function(honest_cases.Program(program), folder, seed)
        except common.Failed as failure:
            record["failed"] = str(failure).splitlines()[-1][:200]
        except (KeyError, ValueError, OSError, np.linalg.LinAlgError) as failure:  # results that lack what the case expects
            record["failed"] = f"{type(failure).__name__}: {failure}"
    return {**record, "seconds": round(common.processor_seconds() - start, 2)}


def error_of_runs(sums, counts):
    """Standard error of sum(sums) / sum(counts), the runs being independent."""
    n, share = len(counts), np.sum(sums) / np.sum(counts)
    return np.sqrt(np.sum((sums - share * counts)**2) * n / (n - 1)) / np.sum(counts)


class Row:
    """Statistics of one standard error in one case."""

    def __init__(self, case, what, records):
        self.case, self.what = case, what
        runs = [r["values"][what] for r in records if what in r.get("values", {})]
        self.open = sum(int(np.sum(np.isinf(s))) for _, s in runs)
        self.of_rms = what in honest_cases.OF_RMS
        if what in honest_cases.OF_SCATTER and runs:  # the truth is the mean of all runs
            middle, unbiased = np.mean([e for e, _ in runs], axis=0), np.sqrt(len(runs) / max(1, len(runs) - 1))
            runs = [(unbiased * (np.array(e) - middle), s) for e, s in runs]
        squares = []
        for errors, sigmas in runs:
            errors, sigmas = np.asarray(errors, float), np.asarray(sigmas, float)
            keep = np.isfinite(sigmas)
            with np.errstate(divide="ignore", invalid="ignore"):
                z2 = np.where(errors[keep] == 0, 0, (errors[keep] / sigmas[keep])**2)
            squares.append(z2)
        squares = [z for z in squares if len(z)]
        self.runs, counts = len(squares), np.array([len(z) for z in squares])
        self.values = int(counts.sum())
        self.failed = sum("failed" in r for r in records)
        if self.runs < 2:
            return
        if what in honest_cases.OF_SHARE:
            self.of_rms, self.mean = True, np.concatenate(squares).mean()
            self.error = np.sqrt(max(self.mean * (1 - self.mean), 1 / self.runs) / self.runs)
            self.z_outside = (self.mean - honest_cases.MOST_WRONG) / self.error
            return
        sums, inside = (np.array([f(z) for z in squares]) for f in (np.sum, lambda z: np.sum(z < 1.96**2)))
        self.mean, self.coverage = sums.sum() / self.values, inside.sum() / self.values
        # Few runs may scatter too little by chance: not less than independent values.
        self.error = max(error_of_runs(sums, counts), self.mean * np.sqrt(2 / self.values) if not self.of_rms else 0)
        self.z_outside = max(self.mean - HIGH, LOW - self.mean) / self.error
        if not self.of_rms:
            self.coverage_error = max(error_of_runs(inside, counts), np.sqrt(COVERED * (1 - COVERED) / self.values))
            self.z_outside = max(self.z_outside, (COVERED - self.coverage) / self.coverage_error)

    def reason(self):
        return honest_cases.REASONS.get((self.case, self.what)) or honest_cases.REASONS.get((None, self.what))

    def fails(self):
        return self.runs >= FEWEST and self.z_outside > LIMIT and not self.reason()

    def cells(self, notes):
        """Of the table, without those of the standard error; `notes` gets the reasons that the row refers to."""
        if self.runs < 2:
            return [self.case, f"{self.runs}", "", "no result" if self.failed else "one run" if self.runs else "not run"]
        remarks = []
        if self.runs < FEWEST:
            remarks.append("few runs")
        elif self.z_outside > 0:
            remarks.append(f"OUTSIDE by {self.z_outside:.1f}")
            if self.reason():
                notes.append(self.reason())
                remarks[-1] += f" [{len(notes)}]"
        if self.open:
            remarks.append(f"{self.open} `.inf`")
        if self.failed:
            remarks.append(f"{self.failed} runs failed")
        mean = f"wrong in {100 * self.mean:.0f} %" if self.what in honest_cases.OF_SHARE else f"{self.mean:.2f} ({self.error:.2f})"
        share = [] if self.of_rms else [f"{100 * self.coverage:.0f} ({100 * self.coverage_error:.0f})"]
        return [self.case, f"{self.runs}, {self.values}", mean, "; ".join(share + remarks)]


def rows_of(records):
    by_case = {}
    for record in records:
        by_case.setdefault(record["case"], []).append(record)
    return [Row(name, what, by_case.get(name, [])) for name, case in honest_cases.CASES.items() for what in case.rows]


def table(rows):
    """Under each standard error its rows; then the cases, and keys without a row."""
    line = lambda *cells: "| " + " | ".join(cells) + " |\n"
    head = lambda *cells: line(*cells) + line(*("---" for _ in cells))
    named = lambda heading, names: f"{heading}: {', '.join(f'`{n}`' for n in names)}"  # a test reads it (tests/structure)
    order, notes, last = list(honest_cases.KEYS), [], None
    # All parameters together stand behind single ones: the same runs.
    joint = {row.case: row for row in rows if row.what == "joint"}
    alone = [row for row in rows if row.what != "joint"]
    text = head("standard error, cases", "runs, values", "mean (error / sigma)^2", "within 1.96 sigma, %")
    for row in sorted(alone, key=lambda r: order.index(r.what)):
        key = "joint" if row.what == "parameters" else row.what
        if row.what != last:
            text += line(named(*honest_cases.KEYS[key]) + (" (behind the comma: all together)" if key == "joint" else ""), "", "", "")
        last = row.what
        cells = row.cells(notes)
        if key == "joint" and row.case in joint:
            cells[2:] = [", ".join(pair) for pair in zip(cells[2:], joint[row.case].cells(notes)[2:])]
        text += line(*cells)
    text += "\n" + "".join(f"{number}. {note}\n" for number, note in enumerate(notes, 1))
    text += "\nThe cases (*: images or points by `simulate`):\n\n" + head("case", "what it is")
    for name in dict.fromkeys(row.case for row in rows):
        case = honest_cases.CASES[name]
        text += line(name + ("*" if case.simulated else ""), case.title)
    text += "\nNo standard error of a result, so without a row:\n\n" + head("key", "what it is")
    for heading, names, why in honest_cases.OTHERS:
        text += line(named(heading, names), why)
    return text


def write(path, text):
    page = path.read_text()
    head, rest = page.split(BEGIN)
    path.write_text(head + BEGIN + "\n" + text + "\n" + END + rest.split(END)[1])


def main():
    parser = common.parser(__doc__, plenocal=None)
    parser.add_argument("--program", type=common.program, help="without: the table of the results")
    parser.add_argument("--results", type=pathlib.Path, help="file of results, made or continued")
    parser.add_argument("--all", action="store_true", help="runs for the table in docs/uncertainty.md")
    parser.add_argument("--quick", action="store_true", help="few runs of each case")
    parser.add_argument("--cases", nargs="+", choices=list(honest_cases.CASES))
    parser.add_argument("--runs", type=int, help="of each case")
    parser.add_argument("--jobs", type=int, default=2, choices=[1, 2])
    parser.add_argument("--write", type=pathlib.Path, help="page that gets the table")
    arguments = parser.parse_args()
    records, identity = [], None
    lines = arguments.results.read_text().splitlines() if arguments.results and arguments.results.exists() else []
    if arguments.program:
        program = arguments.program
        identity = hashlib.sha256(program.read_bytes()).hexdigest()[:16]
        records = [r for r in map(json.loads, lines) if r["program"] == identity]
        names = arguments.cases or list(honest_cases.CASES)
        done = {(r["case"], r["seed"]) for r in records}
        jobs = []
        for name in names:
            case = honest_cases.CASES[name]
            count = arguments.runs or (case.quick if arguments.quick else case.runs)
            jobs += [(program, name, seed) for seed in range(1, count + 1) if (name, seed) not in done]
        with concurrent.futures.ProcessPoolExecutor(arguments.jobs) as pool:
            for record in pool.map(run, jobs):
                record["program"] = identity
                records.append(record)
                if arguments.results:
                    with open(arguments.results, "a") as file:
                        file.write(json.dumps(record) + "\n")
        chosen = [r for r in records if r["case"] in names]
        rows = [row for row in rows_of(chosen) if row.case in names]
    else:
        records = list(map(json.loads, lines))
        rows = rows_of([r for r in records if r["program"] == records[-1]["program"]])
    text = table(rows)
    print(text)
    for name in sorted({r["case"] for r in records}):
        of_case = [r for r in records if r["case"] == name]
        failures = {r["failed"] for r in of_case if "failed" in r}
        print(f"{name}: {len(of_case)} runs, {np.mean([r['seconds'] for r in of_case]):.1f} s a run"
              + "".join(f"\n  {f}" for f in sorted(failures)[:3]), file=sys.stderr)
    if arguments.write:
        write(arguments.write, text)
    failing = [row for row in rows if row.fails()]
    for row in failing:
        print("OUTSIDE without a reason: " + " | ".join([row.what, *row.cells([])]), file=sys.stderr)
    return 1 if failing else 0


if __name__ == "__main__":
    sys.exit(main())

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Kills runs at each call that changes files and at random moments: are the old results left, or the new ones?

    bench/kills --program build/release/apps/plenocal                     # at each call and 120 random kills of each of five commands
    bench/kills --program build/release/apps/plenocal --kills 20 try      # of `try` alone

A run is killed (SIGKILL) with the process that moves its files: before each system call that changes a file
(tests/apps/files/failing_calls.cc), at a random moment of its time, or, every second time, of the time in which it moves its
files. Then a reader opens a result, and the run is repeated. A kill fails if the reader finds other files than all old or all
new ones, or if the repeated run does not write the new ones. After every third kill at random the run that mends the folder is
killed, too. Exit status 1 when a kill failed.
"""
import ctypes
import itertools
import os
import pathlib
import signal
import subprocess
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from data import small_sessions
from data.small_sessions import results

PR_SET_CHILD_SUBREAPER = 36


def kill_children():
    """Kills all processes below this one: also those that outlive the one which started them come to this process."""
    while children := pathlib.Path(f"/proc/self/task/{os.getpid()}/children").read_text().split():
        for child in map(int, children):
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)


class Command(small_sessions.Command):
    def __init__(self, program, folder, name):
        start = time.monotonic()
        super().__init__(program, folder, name)
        self.seconds = time.monotonic() - start
        self.complete = self.out / ".partial/complete"
        self.moving = max(self.time_moves() for _ in range(3))

    def start(self, more=(), **variables):
        return subprocess.Popen([*self.words, *more], cwd=self.folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                                start_new_session=True, env={**os.environ, **variables})

    def wait_for_moves(self, process):
        while not self.complete.exists() and process.poll() is None:
            time.sleep(5e-5)

    def time_moves(self):
        """Seconds from the announcement of the moves to the last."""
        self.write(self.old)
        process = self.start()
        self.wait_for_moves(process)
        start = time.monotonic()
        while self.complete.exists():
            pass
        seconds = time.monotonic() - start
        process.wait()
        return seconds

    def kill(self, rng, while_moving):
        process = self.start()
        if while_moving:
            self.wait_for_moves(process)
            time.sleep(rng.uniform(0, 1.2 * self.moving))
        else:
            time.sleep(rng.uniform(0, 1.1 * self.seconds))
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        kill_children()
        process.returncode = 0  # is waited for

    def kill_at_call(self, number):
        """Kills a run of one thread before its call of this number that changes files; whether it has so many."""
        mark = self.folder / "mark"
        mark.unlink(missing_ok=True)
        process = self.start(("--threads", "1"), LD_PRELOAD=str(common.BUILD / "tests/apps/libfailing_calls.so"),
                             PLENOCAL_FAIL_CALL=str(number), PLENOCAL_FAIL_MARK=str(mark), PLENOCAL_STOP_AT_CALL="1")
        while not mark.exists() and process.poll() is None:
            time.sleep(1e-3)
        kill_children()
        process.returncode = 0
        return mark.exists()

    def is_mixed(self, committed):
        """Whether a reader sees anything but all old or all new results; only new ones where they were `committed`."""
        return self.read() not in ([self.new] if committed else [self.old, self.new])


def test(command, kills, rng):
    """Numbers of kills before a call, at random, of those that met a run which had announced its moves, that met one which wrote
    files, of all, and of those that failed."""
    failed = moving = writing = calls = 0
    for kill in itertools.count(-kills):
        command.write(command.old)
        committed = False
        if kill >= 0:
            if not command.kill_at_call(kill + 1):
                break
            calls += 1
        for _ in range(0 if kill >= 0 else 2 if kill % 3 == 2 else 1):
            command.kill(rng, while_moving=rng.random() < 0.5)
            committed |= command.complete.exists()
        moving += command.complete.exists()
        writing += command.complete.parent.exists() and not command.complete.exists()
        mixed = command.is_mixed(committed or command.complete.exists())
        command.run()
        if mixed or results(command.out) != command.new:
            failed += 1
            print(f"kill {kill}: {'mixed results' if mixed else 'the next run wrote other results'}", file=sys.stderr)
    return calls, kills, moving, writing, calls + kills, failed


def main():
    parser = small_sessions.parser(__doc__)
    parser.add_argument("--kills", type=int, default=120, help="at random, of each command")
    options = small_sessions.parse(parser)
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    common.head("command", "at a call", "at random", "with moves announced", "while writing files", "kills", "failed")
    small_sessions.test_commands(options, Command, lambda command, rng: test(command, options.kills, rng))


if __name__ == "__main__":
    main()

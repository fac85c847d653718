#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Kills runs at random moments and looks at what is left: the old results or the new ones?

    bench/kills --program build/release/apps/plenocal                     # 120 kills of each of five commands
    bench/kills --program build/release/apps/plenocal --kills 20 try      # of `try` alone

A run is killed (SIGKILL) with the process that moves its files, at a random moment of its time, or, every second time, of the
time in which it moves its files. Then a reader opens a result, and the run is repeated. A kill fails if the reader finds other
files than all old or all new ones, or if the repeated run does not write the new ones. After every third kill the run
that mends the folder is killed, too. Exit status 1 when a kill failed.
"""
import ctypes
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
    while True:
        children = pathlib.Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
        for child in children:
            try:
                os.kill(int(child), signal.SIGKILL)
            except ProcessLookupError:
                pass
        try:
            while os.waitpid(-1, 0):
                pass
        except ChildProcessError:
            if not children:
                return


class Command(small_sessions.Command):
    def __init__(self, program, folder, name):
        start = time.monotonic()
        super().__init__(program, folder, name)
        self.seconds = time.monotonic() - start
        self.complete = self.out / ".partial/complete"
        self.moving = max(self.time_moves() for _ in range(3))

    def start(self):
        return subprocess.Popen(self.words, cwd=self.folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                                start_new_session=True)

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

    def is_mixed(self, committed):
        """Whether a reader sees anything but all old or all new results; only new ones where they were `committed`."""
        return self.read() not in ([self.new] if committed else [self.old, self.new])


def test(command, kills, rng):
    """Numbers of kills, of those that met a run which had announced its moves, that met one which wrote files, and that failed."""
    failed = moving = writing = 0
    for kill in range(kills):
        command.write(command.old)
        committed = False
        for _ in range(2 if kill % 3 == 2 else 1):
            command.kill(rng, while_moving=rng.random() < 0.5)
            committed |= command.complete.exists()
        moving += command.complete.exists()
        writing += command.complete.parent.exists() and not command.complete.exists()
        mixed = command.is_mixed(committed)
        command.run()
        if mixed or results(command.out) != command.new:
            failed += 1
            print(f"kill {kill}: {'mixed results' if mixed else 'the next run wrote other results'}", file=sys.stderr)
    return kills, moving, writing, failed


def main():
    parser = small_sessions.parser(__doc__)
    parser.add_argument("--kills", type=int, default=120, help="of each command")
    options = small_sessions.parse(parser)
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    common.head("command", "kills", "with moves announced", "while writing files", "failed")
    small_sessions.test_commands(options, Command, lambda command, rng: test(command, options.kills, rng))


if __name__ == "__main__":
    main()

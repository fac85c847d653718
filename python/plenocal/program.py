# SPDX-License-Identifier: Apache-2.0
"""Runs the program as a child process; messages and progress of runs in this process."""

from __future__ import annotations

import os
import tempfile
from typing import TYPE_CHECKING, Callable, Sequence

from .errors import GradeError, InputError, JobError

if TYPE_CHECKING:
    from . import _core
    from .arrays import PathLike

Progress = Callable[[str], object]


def message(line: str, warning: bool) -> None:
    """Passes a line of a run to the logger "plenocal"."""
    import logging

    logging.getLogger("plenocal").log(logging.WARNING if warning else logging.INFO, "%s", line.strip())


def caller(threads: int, progress: Progress | None) -> _core.Caller:
    """Settings of a run of the engine by its caller. Raises `InputError` for an invalid number of threads."""
    most = 1024
    if not 0 <= threads <= most:
        raise InputError(f"threads: expected a number from 0 to {most}, found {threads}")
    return threads, progress, message


def run(arguments: Sequence[PathLike], *, progress: Progress | None = None) -> str:
    """Runs the program as a child process and returns its output. Models of `register` are not available there.

    Args:
        arguments: words of the command line, without the program's name.
        progress: called with each line of the program's messages.

    Raises `InputError`, `JobError`, `GradeError` (exit statuses 2, 1, 3) with the message of the program, and
    `KeyboardInterrupt` after Ctrl-C; no result files are written then.

    >>> print(run(["models"]).splitlines()[0])
    division
    """
    import subprocess
    import sys

    if isinstance(arguments, (str, bytes)):
        raise InputError("arguments: expected a list of words, found one text")
    words = [os.fspath(argument) for argument in arguments]
    for word in words:
        if not isinstance(word, str) or "\0" in word:
            raise InputError(f"arguments: expected texts, found {word!r}")
    folder = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    path = os.pathsep.join([folder, os.environ["PYTHONPATH"]]) if "PYTHONPATH" in os.environ else folder
    last = ""
    with tempfile.TemporaryFile("w+", encoding="utf-8") as output, subprocess.Popen(
        [sys.executable, "-m", "plenocal", *words],
        stdout=output,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": path},
        text=True,
        encoding="utf-8",
        errors="replace",
    ) as child:
        assert child.stderr is not None
        try:
            for line in child.stderr:
                last = line.rstrip("\n")
                message(last.strip(), last.startswith("  warning: "))
                if progress is not None:
                    progress(last.strip())
        except BaseException:
            child.terminate()
            raise
        status = child.wait()
        output.seek(0)
        printed = output.read()
    if status in (130, -2):
        raise KeyboardInterrupt(last)
    if status:
        kind = {2: InputError, 3: GradeError}.get(status, JobError)
        error = kind(last.removeprefix("plenocal: ") or f"plenocal ended with status {status}")
        error.output = printed
        raise error
    return printed

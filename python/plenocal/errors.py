# SPDX-License-Identifier: Apache-2.0
"""Exceptions, whose messages are those of the command line."""

from __future__ import annotations


class Error(Exception):
    """Base of plenocal's exceptions. The message is one line: location, what was expected and found, remedy."""

    #: Output of the program before the failure (of `run`).
    output: str = ""


class InputError(Error, ValueError):
    """An argument or an input file is wrong (exit status 2 of the program)."""


class JobError(Error, RuntimeError):
    """The inputs are readable, but the job cannot be done with them (exit status 1)."""


class GradeError(Error):
    """The results are written, but their grade is worse than `require` (exit status 3)."""

# SPDX-License-Identifier: Apache-2.0
"""Exceptions, whose messages are those of the command line."""

from __future__ import annotations


class Error(Exception):
    """What plenocal raises: one line that says where, what was expected and found, and what to do."""

    #: What the command printed before it failed.
    output: str = ""


class InputError(Error, ValueError):
    """An argument or an input file is wrong (exit status 2 of the program)."""


class JobError(Error, RuntimeError):
    """The inputs are readable, but the job cannot be done with them (exit status 1)."""


class GradeError(Error):
    """The results are written, but worse than `require` asks for (exit status 3)."""

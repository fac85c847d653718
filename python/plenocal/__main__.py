# SPDX-License-Identifier: Apache-2.0
"""The program: `plenocal`, or `python -m plenocal`."""

from __future__ import annotations

import sys

from . import _core


def main() -> int:
    """Runs the command line; returns its exit status."""
    return _core.run_as_program(["plenocal", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())

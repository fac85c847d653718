# SPDX-License-Identifier: Apache-2.0
"""Calibration of plenoptic and ordinary cameras in one bundle adjustment.

    import plenocal
    calibration = plenocal.calibrate("session.yaml", "OUT")
    calibration[0].project(points)

docs/python.md has a guide. Lengths are in metres, image points in pixels with (0, 0) at the centre
of the top-left pixel; T_a_b maps coordinates in frame b to frame a (docs/conventions.md).
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from . import _core
from .calibration import Calibration
from .camera import Camera, Conversion, Difference, Projection, Rays
from .commands import (
    calibrate,
    check,
    compare,
    detect_session,
    locate,
    simulate,
    suggest,
    try_models,
    weigh,
)
from .errors import Error, GradeError, InputError, JobError
from .images import Focused, Rectified, White, focus, rectify, rectify_maps, undistort, undistort_maps, white
from .model import INTRINSICS, CameraModel, Param, register
from .program import run
from .session import Session
from .space import Measured, Plane, SpacePoints, triangulate
from .target import Target, detect

if TYPE_CHECKING:
    from .arrays import PathLike

__version__: str = _core.__version__


def models() -> list[str]:
    """Names of all camera models, those of plug-ins and of `register` included.

    >>> "pinhole-radtan" in models()
    True
    """
    return _core.models()


def model_info(name: str) -> dict[str, Any]:
    """Properties of the camera model of this name: source, params (name, unit, lower, upper, scale), measured, context,
    example, example_config, example_size, centre (as `Camera.centre`), plenoptic. Raises `InputError`."""
    info = _core.model_info(name)
    if not info:
        raise InputError(f"unknown camera model '{name}'; known: {', '.join(models())}")
    return info


def check_model(name: str) -> str:
    """Tests whether projection, inverse and derivatives of the camera model of this name agree (`plenocal
    models check`). Returns a line "holds" or "VIOLATED" for each property. Raises `InputError`."""
    return _core.check_model(name)


def load_plugin(path: PathLike) -> None:
    """Adds the camera models of the shared library at this path (docs/new_model.md). Raises
    `InputError`."""
    _core.load_plugin(os.fspath(path))


__all__ = [
    "INTRINSICS",
    "Calibration",
    "Camera",
    "CameraModel",
    "Conversion",
    "Difference",
    "Error",
    "Focused",
    "GradeError",
    "InputError",
    "JobError",
    "Measured",
    "Param",
    "Plane",
    "Projection",
    "Rays",
    "Rectified",
    "Session",
    "SpacePoints",
    "Target",
    "White",
    "calibrate",
    "check",
    "check_model",
    "compare",
    "detect",
    "detect_session",
    "focus",
    "load_plugin",
    "locate",
    "model_info",
    "models",
    "rectify",
    "rectify_maps",
    "register",
    "run",
    "simulate",
    "suggest",
    "triangulate",
    "try_models",
    "undistort",
    "undistort_maps",
    "weigh",
    "white",
]

# SPDX-License-Identifier: Apache-2.0
"""Sessions: cameras, images and target of a calibration."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any, Mapping, Sequence

from . import _core
from .arrays import floats, images_in_memory, pixels
from .errors import InputError
from .target import Target

if TYPE_CHECKING:
    from .arrays import PathLike


class Session:
    """A session.yaml (docs/formats.md)."""

    _native: _core.Session
    _images: Any = None  # kept alive for `_native`, which does not copy the pixels

    def __init__(self, path: PathLike) -> None:
        """Reads and checks the session file at this path. Raises `InputError` with file, line and key."""
        self._native = _core.Session.load(os.fspath(path))

    @classmethod
    def from_points(
        cls,
        folder: PathLike | None,
        target: Target | PathLike,
        cameras: Mapping[str, Mapping[str, Any]],
        *,
        options: Mapping[str, Any] | None = None,
    ) -> Session:
        """A session of measured points.

        Args:
            folder: folder for session.yaml, target.yaml and the tables; None: the session stays in memory.
            target: a `Target`, a target in one word, or a target's file.
            cameras: for each name `{"model": ..., "image_size": (width, height), "points": {frame: table}}`; the first
                is the rig's master. A table has the columns marker, x, y (px) and may have sigma (px), as that of
                `detect`. Frames of one name were taken at once.
            options: the session's `options` (docs/formats.md); they need a folder.

        Raises `InputError`.
        """
        import numpy as np

        target = target if isinstance(target, Target) else Target(target)
        if folder is None and options:
            raise InputError("from_points: options need a folder")
        files = {"target.yaml": target.yaml}
        entries = {}
        native: list[Any] = []
        for name, camera in cameras.items():
            if missing := {"model", "image_size", "points"} - set(camera):
                raise InputError(f"{name}: has no '{min(missing)}'")
            views = []
            for frame, points in camera["points"].items():
                try:
                    numbers = floats(points["marker"], f"{name}: {frame}: marker")
                    sigma = points["sigma"] if "sigma" in points.dtype.names else np.ones(len(points))
                    columns = [floats(column, f"{name}: {frame}") for column in (points["x"], points["y"], sigma)]
                except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
                    raise InputError(
                        f"{name}: {frame}: expected a table with the columns marker, x, y "
                        f"(and sigma), as plenocal.detect returns it"
                    ) from error
                if not (numbers == np.clip(np.floor(numbers), 0, 2**31 - 1)).all():
                    raise InputError(f"{name}: {frame}: marker: expected whole numbers from 0 on")
                rows = np.stack(columns, axis=1)
                if not np.isfinite(rows).all() or not (rows[:, 2] > 0).all():
                    raise InputError(f"{name}: {frame}: expected finite numbers and positive sigmas")
                views.append((str(frame), numbers.astype(np.int32).tolist(), rows))
            if not any(numbers for _, numbers, _ in views):
                raise InputError(f"{name}: has no points")
            size = list(pixels(camera["image_size"], f"{name}: image_size"))
            native.append((str(name), camera["model"], size, [], views))
            files[f"points_{name}.csv"] = _core.detections_table(views)
            entries[name] = {
                "model": camera["model"],
                "detections": f"points_{name}.csv",
                "image_size": size,
            }
        if folder is None:
            found = cls.__new__(cls)
            found._native = _core.session_of_arrays(target.yaml, native)
            return found
        folder = os.fspath(folder)
        os.makedirs(folder, exist_ok=True)
        session: dict[str, Any] = {"plenocal": 1, "target": "target.yaml", "cameras": entries}
        if options:
            session["options"] = dict(options)
        files["session.yaml"] = json.dumps(session, indent=1)  # JSON is YAML
        for file, text in files.items():
            with open(os.path.join(folder, file), "w", encoding="utf-8") as stream:
                stream.write(text)
        return cls(os.path.join(folder, "session.yaml"))

    @classmethod
    def from_images(cls, target: Target | PathLike, images: Any, *, model: str = "") -> Session:
        """A session of images in memory.

        Args:
            target: a `Target`, a target in one word, or a target's file.
            images: arrays: a sequence for one camera, `{name: {frame: array}}` for several; the first is the rig's
                master. An array has the shape (H, W), or (H, W, 3) in the order blue, green, red, and 8 or 16 bits.
                It must not change while the session is used.
            model: camera model of all cameras (`models()`); empty: `calibrate` chooses it by cross-validation.

        Raises `InputError`.
        """
        cameras = images_in_memory(images)
        if not any(frames for _, frames in cameras):
            raise InputError("from_images: expected arrays of images")
        target = target if isinstance(target, Target) else Target(target)
        found = cls.__new__(cls)
        found._images = cameras
        native: list[Any] = [(name, model, [], frames, []) for name, frames in cameras]
        found._native = _core.session_of_arrays(target.yaml, native)
        return found

    @property
    def path(self) -> str:
        """Path of the session file; empty for a session in memory."""
        return self._native.path

    @property
    def text(self) -> str:
        """Content of the session file; empty for a session in memory."""
        return self._native.text

    @property
    def cameras(self) -> list[dict[str, Any]]:
        """For each camera: name, model, images, white_images (globs, folders, files), detections."""
        return self._native.cameras()

    @property
    def target(self) -> Target:
        """The session's target. Raises `InputError`."""
        return Target._of(self._native.target())

    def __repr__(self) -> str:
        cameras: Sequence[str] = [f"{c['name']} ({c['model']})" for c in self.cameras]
        return f"<plenocal.Session {self.path}: {', '.join(cameras)}>"

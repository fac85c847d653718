# SPDX-License-Identifier: Apache-2.0
"""The result of a calibration: cameras, poses, target, residuals, verdict."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any, Iterator, Sequence

from . import _core
from .arrays import table
from .camera import Camera
from .errors import InputError
from .program import caller

if TYPE_CHECKING:
    from .arrays import FloatArray, PathLike, Table


class Calibration:
    """Calibrated cameras and, if read from a folder of `calibrate`, all its other results.

    >>> from plenocal import Camera
    >>> camera = Camera("pinhole", (640, 480), [500.0, 500.0, 319.5, 239.5], name="left")
    >>> calibration = Calibration.of_cameras([camera])
    >>> calibration["left"].model
    'pinhole'
    """

    _native: _core.Record

    def __init__(self, path: PathLike) -> None:
        """As `Calibration.load` of this path."""
        self._set(_core.Record.load(os.fspath(path)))

    def _set(self, native: _core.Record) -> None:
        self._native = native
        self._cameras = [Camera._of(camera) for camera in native.cameras]
        #: Parameters and fit as text; empty for a calibration that was read from files.
        self.summary = ""

    @classmethod
    def _of(cls, native: _core.Record) -> Calibration:
        calibration = cls.__new__(cls)
        calibration._set(native)
        return calibration

    @classmethod
    def load(cls, path: PathLike) -> Calibration:
        """Reads a calibration.

        Args:
            path: a folder of results of `plenocal calibrate`, or a calibration.yaml (without frames, markers and
                residuals).

        Raises `InputError` with file, line and key.
        """
        return cls(path)

    @classmethod
    def of_cameras(cls, cameras: Sequence[Camera]) -> Calibration:
        """A rig of these cameras; the first is the master. Raises `InputError`."""
        names = [camera.name for camera in cameras]
        if not names or len(set(names)) < len(names):
            raise InputError(f"cameras: expected cameras with different names, found {names}")
        return cls._of(_core.Record.of_cameras([camera._native for camera in cameras]))

    def save(self, path: PathLike) -> None:
        """Writes calibration.yaml, with all digits of parameters and poses, to this path."""
        self._native.save(os.fspath(path))

    @property
    def path(self) -> str:
        """The calibration.yaml that was read; empty: it is in memory."""
        return self._native.path

    @property
    def cameras(self) -> list[Camera]:
        """All cameras, the rig's master first."""
        return list(self._cameras)

    def __getitem__(self, name: str | int) -> Camera:
        """A camera by name or index."""
        if isinstance(name, int):
            return self._cameras[name]
        for camera in self._cameras:
            if camera.name == name:
                return camera
        raise KeyError(f"no camera '{name}'; known: {', '.join(c.name for c in self._cameras)}")

    def __len__(self) -> int:
        return len(self._cameras)

    def __iter__(self) -> Iterator[Camera]:
        return iter(self._cameras)

    @property
    def verdict(self) -> dict[str, Any] | None:
        """`{"grade": "good", "findings": [...]}` (docs/diagnosis.md); None: not graded."""
        verdict: dict[str, Any] | None = json.loads(self._native.verdict())
        return verdict

    @property
    def poses(self) -> Table:
        """One row per frame: frame, T_target_rig (4, 4), p_target = T_target_rig p_rig, m."""
        return table(self._native.poses())

    @property
    def markers(self) -> Table:
        """One row per marker of the target: marker, position (3,), sigma (3,), m; NaN: not estimated."""
        return table(self._native.markers())

    def residuals(self, camera: str | int = 0) -> Table:
        """One row per observation of a camera (its name or index): frame, marker, measured coordinates and
        context (px), residual_x, residual_y (measured minus predicted, px; NaN outside the model's
        domain), noise_sigma (px) and used (false: rejected). Fits pandas.DataFrame as it is."""
        columns = self._native.residuals(self._index(camera))
        columns["used"] = columns["used"].astype(bool)
        return table(columns)

    def projection_sigma(
        self, pixels: Any, distance: float, camera: str | int = 0, context: Any = None
    ) -> FloatArray:
        """(N,): standard error of the projection in its worst direction, px, less the part that a motion of the camera's
        frame compensates: as the report's maps. NaN where the model forms no image.

        Args:
            pixels: image points (N, M), px.
            distance: of the points on their rays, m.
            camera: its name or index.
            context: as of `Camera.project`.

        Raises `InputError`, also for a calibration without standard errors or without its residuals.
        """
        if not 0 < distance < float("inf"):
            raise InputError(f"distance: expected a positive number of metres, found {distance}")
        return _core.projection_sigma(
            self._native, self._index(camera), self[camera]._values(pixels, context), distance
        )

    def _index(self, camera: str | int) -> int:
        return [c.name for c in self._cameras].index(self[camera].name)

    @property
    def correlations(self) -> tuple[list[str], FloatArray]:
        """Names of all unknowns and the (K, K) matrix of their correlations."""
        return self._native.correlations

    @property
    def left_out(self) -> list[str]:
        """Images and points that were left out, with reasons."""
        return self._native.left_out

    @property
    def target_scale(self) -> dict[str, tuple[float, float]]:
        """Relative deviations of targets from their nominal sizes and their standard errors, by name: of sessions with
        `scale_sigma` or `distances`."""
        return self._native.target_scale

    @property
    def provenance(self) -> dict[str, str]:
        """Origin of the calibration: version of the program, command line, session, target (docs/formats.md)."""
        return self._native.provenance

    def report(self, path: PathLike) -> None:
        """Writes the report to this path: one HTML page that needs no network. Not for a calibration.yaml alone."""
        page = self._native.report()
        with open(path, "w", encoding="utf-8") as file:
            file.write(page)

    def export(
        self, path: PathLike, format: str, *, cameras: Sequence[str] = (), response: PathLike = ""
    ) -> list[str]:
        """Writes another tool's file (`plenocal export`).

        Args:
            path: the file. Formats with one file per camera write several cameras to FILE_<camera>. With "colmap" and a
                folder (no extension), poses and points are written too.
            format: name of the other tool (docs/exchange.md).
            cameras: names of the cameras, in this order; empty: all.
            response: pcalib.txt, for formats that hold a vignetting; empty: none.

        Returns the files written. Raises `InputError` or `JobError` for what the format cannot hold.
        """
        request = _core.ExportRequest()
        request.format = format
        request.cameras = list(cameras)
        request.response = os.fspath(response)
        request.out = os.fspath(path)
        return [str(file) for file in _core.export(self._native, request, caller(0, None))]

    def to_opencv(self, path: PathLike) -> list[str]:
        """Writes a cv::FileStorage (path: .yml, .xml or .json)."""
        return self.export(path, "opencv")

    def to_ros(self, path: PathLike, camera: str = "") -> list[str]:
        """Writes camera_info of one camera (its name; empty: the only one) to this path."""
        return self.export(path, "ros", cameras=[camera] if camera else [])

    def to_kalibr(self, path: PathLike) -> list[str]:
        """Writes camchain.yaml to this path."""
        return self.export(path, "kalibr")

    def to_mrcal(self, path: PathLike) -> list[str]:
        """Writes a .cameramodel to this path."""
        return self.export(path, "mrcal")

    def to_colmap(self, path: PathLike) -> list[str]:
        """Writes cameras.txt to this path."""
        return self.export(path, "colmap")

    def _repr_html_(self) -> str:
        """For notebooks: the verdict, the parameters and the mean residuals over the images."""
        import base64
        from html import escape

        html = []
        verdict = self.verdict
        if verdict is not None:
            findings = "".join(f"<li>{escape(f['what'])}</li>" for f in verdict["findings"])
            html.append(f"<p><b>verdict: {escape(verdict['grade'])}</b></p><ul>{findings}</ul>")
        for index, camera in enumerate(self._cameras):
            width, height = camera.image_size
            fit = camera.fit
            points = f", RMS {fit['rms']:.4f} px over {fit['points']} points" if fit["points"] else ""
            html.append(
                f"<h4>{escape(camera.name)}</h4><p>{escape(camera.model)}, {width} x {height} px"
                f"{points}</p><table><tr><th>parameter</th><th>value</th><th>sigma</th><th>unit</th></tr>"
            )
            many = 40  # coefficients of a splined model are no table
            for row in camera.parameters[:many]:
                html.append(
                    f"<tr><td>{row['name']}</td><td>{row['value']:.8g}</td>"
                    f"<td>{row['sigma']:.2g}</td><td>{row['unit']}</td></tr>"
                )
            html.append("</table>")
            picture = self._native.residual_picture(index)
            if picture:
                data = base64.b64encode(picture).decode()
                html.append(f'<img alt="mean residuals" style="max-width: 40em" src="data:image/png;base64,{data}">')
        return "".join(html)

    def __repr__(self) -> str:
        verdict = self.verdict
        grade = f", {verdict['grade']}" if verdict else ""
        names = ", ".join(f"{c.name} ({c.model})" for c in self._cameras)
        return f"<plenocal.Calibration {names}{grade}>"

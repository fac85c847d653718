# SPDX-License-Identifier: Apache-2.0
"""The program's commands on images as functions: white images, raw plenoptic images, images of calibrated cameras.

Each function is a run of the engine in this process, as in `plenocal.commands`.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, NamedTuple, Sequence

from . import _core
from .arrays import table
from .calibration import Calibration
from .camera import Camera
from .commands import image_size, load, paths
from .errors import InputError
from .program import Progress, caller
from .session import Session

if TYPE_CHECKING:
    from .arrays import FloatArray, PathLike, Table


class White(NamedTuple):
    """Results of the white images of one camera."""

    camera: str
    attenuation: Any  #: (H, W) float32, from 0 to 1
    micro_lenses: Table | None  #: x, y (px), type, row, column, usable; None for an ordinary camera
    #: gain, read (grey values), their gain_sigma and read_sigma, saturation, misfit (relative); None with one image
    noise: dict[str, float] | None
    summary: str  #: as the program prints it


class Focused(NamedTuple):
    """Totally focused image and virtual depth of a raw plenoptic image."""

    frame: str
    image: Any  #: (H, W) or (H, W, 3), blue, green, red: totally focused image; None if written into a folder
    depth: Any  #: (H, W) float32: virtual depth, NaN where unknown; None likewise
    depth_sigma: Any  #: (H, W) float32: its standard error; None likewise
    summary: str  #: one line


class Rectified(NamedTuple):
    """Rectified images of a stereo pair."""

    cameras: tuple[Camera, Camera]  #: the cameras of the written images
    baseline: float  #: m, negative when the second camera lies on the left
    images: tuple[int, int]  #: number written
    #: points, frames, rms, mean_absolute, largest (px): rows of the calibration's own detections
    epipolar: dict[str, float]


def white(
    images: Session | PathLike | Sequence[PathLike],
    out: PathLike | None = None,
    *,
    model: str = "",
    camera: str = "",
    bayer: str = "",
    grid: PathLike = "",
    threads: int = 0,
    progress: Progress | None = None,
) -> list[White]:
    """Micro-lens grid, attenuation and noise from white images (`plenocal white`).

    Args:
        images: a `Session` or its file; or, with `model`, a folder, a glob or files of one camera.
        out: folder for vignetting_<camera>.tiff, noise_<camera>.yaml, micro_lenses_<camera>.csv,
            lattice_<camera>.yaml and grid_<camera>.png; None: none are written.
        model: camera model of the images (`models()`); empty: `images` is a session.
        camera: name for the results; empty: that of the images' folder.
        bayer: colours of the top-left 2 x 2 pixels of raw mosaics (RGGB, BGGR, GRBG or GBRG); empty: no mosaics.
        grid: RayCalibData XML with the micro-lens grid; empty: it is estimated from the images.
        threads: number of threads; 0: one a core.
        progress: called with a text on the present stage, from any thread.

    Returns the results of each camera. Raises `InputError`, and `JobError` if images show no grid.
    """
    request = _core.WhiteRequest()
    request.inputs = [images.path] if isinstance(images, Session) else paths(images)
    request.model = model
    request.camera = camera
    request.set_bayer(bayer)
    request.grid = os.fspath(grid) or None
    request.out = "" if out is None else os.fspath(out)
    cameras = []
    for name, attenuation, lenses, noise, summary in _core.white(request, caller(threads, progress)):
        if lenses is not None:
            lenses["usable"] = lenses["usable"].astype(bool)
        found = None if lenses is None else table(lenses)
        cameras.append(White(name, attenuation, found, noise, summary))
    return cameras


def focus(
    images: PathLike | Sequence[PathLike],
    out: PathLike | None = None,
    *,
    white: PathLike | Sequence[PathLike] = (),
    grid: PathLike = "",
    vignetting: PathLike = "",
    bayer: str = "",
    markers: PathLike = "",
    scale: float = 2,
    threads: int = 0,
    progress: Progress | None = None,
) -> list[Focused]:
    """Totally focused image and virtual depth of raw plenoptic images (`plenocal focus`).

    Args:
        images: raw images: folders, globs and files.
        out: folder for the results (several images: for a folder of each); None: they are returned.
        white: white images of the camera: folders, globs and files.
        grid: in place of white images: micro_lenses_<camera>.csv or RayCalibData XML.
        vignetting: in place of white images: the attenuation, a TIFF file.
        bayer: colours of the top-left 2 x 2 pixels of raw mosaics (RGGB, BGGR, GRBG or GBRG); empty: no mosaics.
        markers: file of a target in the images: a plane is fitted to the depth of each of its markers; empty: none.
        scale: raw pixels per pixel of the results, 0.5 to 16.
        threads: number of threads; 0: one a core.
        progress: called with a text on the present stage, from any thread.

    Returns the result of each image that could be focused. Raises `InputError`, and `JobError` if none could.
    """
    request = _core.FocusRequest()
    request.raw = paths(images)
    _set_lenses(request.camera, white, grid, vignetting, bayer)
    request.markers = os.fspath(markers)
    request.scale = scale
    request.out = "" if out is None else os.fspath(out)
    return [Focused(*found) for found in _core.focus(request, caller(threads, progress))]


def rectify(
    calibration: Calibration | PathLike,
    left: PathLike,
    right: PathLike,
    out: PathLike,
    *,
    cameras: Sequence[str] = (),
    size: Sequence[int] | None = None,
    fov: float | None = None,
    balance: float | None = None,
    distance: float | None = None,
    interpolation: str = "linear",
    keep_vignetting: bool = False,
    maps: bool = False,
    preview: bool = False,
    threads: int = 0,
    progress: Progress | None = None,
) -> Rectified:
    """Writes images of a stereo pair with corresponding points in equal rows (`plenocal rectify`).

    `rectify_maps` returns tables instead.

    Args:
        calibration: a `Calibration`, its folder or its calibration.yaml.
        left: images of the first camera: a folder, a glob or a file.
        right: images of the second camera, likewise.
        out: folder for <camera>/<frame>.png, calibration.yaml and rectification.yaml.
        cameras: names of the first and the second camera; empty: the calibration's two.
        size: width and height of the results, px; None: the first camera's.
        fov: horizontal field of view, degrees (1 to 175); None: the cameras' scale on the optical axis.
        balance: 0: every pixel has a source, 1: all of the cameras' images is visible; None: as by `fov`.
        distance: of cameras without a single centre, where the results are exact, m; None: the target's.
        interpolation: "linear", "nearest", "cubic" or "lanczos".
        keep_vignetting: do not correct the calibrated vignetting.
        maps: write remap tables, too.
        preview: write pictures of the pairs, too.
        threads: number of threads; 0: one a core.
        progress: called with a text on the present stage, from any thread.

    Raises `InputError` for images that do not fit the calibration.
    """
    request = _core.RectifyRequest()
    request.left = os.fspath(left)
    request.right = os.fspath(right)
    request.cameras = list(cameras)
    _set_view(request.view, size, fov, balance, distance)
    request.settings.interpolation = interpolation
    request.settings.keep_vignetting = keep_vignetting
    request.maps = maps
    request.preview = preview
    request.out = os.fspath(out)
    views, baseline, counts, epipolar = _core.rectify(load(calibration)._native, request, caller(threads, progress))
    return Rectified((Camera._of(views[0]), Camera._of(views[1])), baseline, (counts[0], counts[1]), epipolar)


def undistort(
    calibration: Calibration | PathLike,
    images: PathLike | Sequence[PathLike],
    out: PathLike,
    *,
    camera: str = "",
    size: Sequence[int] | None = None,
    fov: float | None = None,
    balance: float | None = None,
    distance: float | None = None,
    interpolation: str = "linear",
    bayer: str = "",
    keep_vignetting: bool = False,
    threads: int = 0,
    progress: Progress | None = None,
) -> tuple[Camera, int]:
    """Writes images of a camera as those of a pinhole camera (`plenocal undistort`); `undistort_maps` returns tables.

    Args:
        calibration: a `Calibration`, its folder or its calibration.yaml.
        images: folders, globs and files; of a plenoptic camera raw images.
        out: folder for <frame>.png, of a plenoptic camera also the depth, and calibration.yaml.
        camera: the camera of the images; empty: the calibration's only one.
        size: width and height of the results, px; None: the camera's.
        fov: horizontal field of view, degrees (1 to 175); None: the camera's scale on the optical axis.
        balance: 0: every pixel has a source, 1: all of the camera's image is visible; None: as by `fov`.
        distance: of cameras without a single centre, where the results are exact, m; None: the target's.
        interpolation: "linear", "nearest", "cubic" or "lanczos".
        bayer: colours of the top-left 2 x 2 pixels of raw mosaics (RGGB, BGGR, GRBG or GBRG); empty: no mosaics.
        keep_vignetting: do not correct the calibrated vignetting.
        threads: number of threads; 0: one a core.
        progress: called with a text on the present stage, from any thread.

    Returns the camera of the written images, and their number. Raises `InputError` for images that do not fit the
    calibration.
    """
    request = _core.UndistortRequest()
    request.images = paths(images)
    request.camera = camera
    _set_view(request.view, size, fov, balance, distance)
    request.settings.interpolation = interpolation
    request.settings.keep_vignetting = keep_vignetting
    request.settings.set_bayer(bayer)
    request.out = os.fspath(out)
    view, count = _core.undistort(load(calibration)._native, request, caller(threads, progress))
    return Camera._of(view), count


def undistort_maps(
    camera: Camera,
    *,
    size: Sequence[int] | None = None,
    fov: float | None = None,
    balance: float | None = None,
    distance: float | None = None,
    threads: int = 0,
) -> tuple[FloatArray, FloatArray, Camera]:
    """Tables for cv2.remap to the images of a pinhole camera, and that camera (`plenocal map`).

    Args:
        camera: an ordinary camera.
        size: width and height of the new images, px; None: the camera's.
        fov: horizontal field of view, degrees (1 to 175); None: the camera's scale on the optical axis.
        balance: 0: every pixel has a source, 1: all of the camera's image is visible; None: as by `fov`.
        distance: of cameras without a single centre, where the results are exact, m; None: these are refused.
        threads: number of threads; 0: one a core.

    Returns map_x and map_y, (H, W) float32, px, -1 where the camera has no image point, and the new camera.
    """
    options = _set_view(_core.ViewOptions(), size, fov, balance, distance)
    x, y, view = _core.undistort_maps(camera._native, options, threads)
    return x, y, Camera._of(view)


def rectify_maps(
    first: Camera,
    second: Camera,
    *,
    size: Sequence[int] | None = None,
    fov: float | None = None,
    balance: float | None = None,
    distance: float | None = None,
    threads: int = 0,
) -> tuple[tuple[FloatArray, FloatArray, Camera], tuple[FloatArray, FloatArray, Camera], float]:
    """Tables for cv2.remap that rectify a stereo pair: corresponding points then lie in equal rows.

    Args:
        first: an ordinary camera of a rig.
        second: another camera of the same rig.
        size: width and height of the new images, px; None: the first camera's.
        fov: horizontal field of view, degrees (1 to 175); None: the cameras' scale on the optical axis.
        balance: 0: every pixel has a source, 1: all of the cameras' images is visible; None: as by `fov`.
        distance: of cameras without a single centre, where the results are exact, m; None: these are refused.
        threads: number of threads; 0: one a core.

    Returns for each camera map_x, map_y and the new camera, as `undistort_maps` does, and the baseline, m (negative if
    the second camera is on the left).
    """
    options = _set_view(_core.ViewOptions(), size, fov, balance, distance)
    one, two, baseline = _core.rectify_maps(first._native, second._native, options, threads)
    return (*one[:2], Camera._of(one[2])), (*two[:2], Camera._of(two[2])), baseline


def _set_view(
    options: _core.ViewOptions,
    size: Sequence[int] | None,
    fov: float | None,
    balance: float | None,
    distance: float | None,
) -> _core.ViewOptions:
    if fov is not None and balance is not None:
        raise InputError("balance: goes without fov")
    options.size = image_size(size)
    options.fov = fov
    options.balance = balance
    options.distance = distance
    return options


def _set_lenses(
    lenses: _core.PlenopticInputs,
    white: PathLike | Sequence[PathLike],
    grid: PathLike,
    vignetting: PathLike,
    bayer: str,
) -> None:
    lenses.white = paths(white)
    lenses.grid = os.fspath(grid)
    lenses.vignetting = os.fspath(vignetting)
    lenses.set_bayer(bayer)

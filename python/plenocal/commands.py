# SPDX-License-Identifier: Apache-2.0
"""The program's commands on sessions and calibrations as functions.

Each function is a run of the engine in this process. Several threads may have runs at the same time. Ctrl-C in the
main thread, or an exception in `progress`, which is passed on, stops its own run only. Files are written only if `out`
is given, the same as by the program. Messages go to the logger "plenocal". Errors are those of `plenocal.errors`.
"""

from __future__ import annotations

import csv
import json
import os
from typing import TYPE_CHECKING, Any, Mapping, Sequence, TypeVar

from . import _core
from .arrays import images_in_memory, pixels, table
from .calibration import Calibration
from .errors import GradeError, InputError
from .program import Progress, caller
from .session import Session
from .target import Target

if TYPE_CHECKING:
    from .arrays import PathLike, Table


def calibrate(
    session: Session | PathLike | None = None,
    out: PathLike | None = None,
    *,
    images: PathLike | Sequence[Any] | Mapping[str, Any] = (),
    target: Target | PathLike = "",
    model: str = "auto",
    jackknife: bool = False,
    exclude: Sequence[str] = (),
    frames: int = 0,
    all_frames: bool = False,
    keep: bool = False,
    fresh: bool = False,
    report: bool = True,
    require: str = "",
    threads: int = 0,
    progress: Progress | None = None,
) -> Calibration:
    """Calibrates the cameras of a session, or cameras from images and a target (`plenocal calibrate`).

    Args:
        session: a `Session` or its file; None: `images` and `target` are given.
        out: folder for the results; None: none are written.
        images: a folder, a glob or files of one camera; `{name: glob}` of several, the first is the rig's master; or
            arrays: a sequence for one camera, `{name: {frame: array}}` for several. An array has the shape (H, W), or
            (H, W, 3) in the order blue, green, red, and 8 or 16 bits. Images of one frame were taken at once.
        target: with images: a `Target`, a target in one word ("chessboard:9x6:25mm"), or a file.
        model: with images: a camera model (`models()`); "auto": chosen by cross-validation.
        jackknife: also estimate standard errors by leaving out groups of frames.
        exclude: rules for images to leave out, in YAML ("camera: left, frame: '07'"), in addition to the session's.
        frames: largest number of frames to use; 0: as in the session.
        all_frames: use all frames of a long recording.
        keep: write pictures of the stages into `out`/images.
        fresh: detect again, even if an earlier run into `out` has cached its detections.
        report: write `out`/report.html.
        require: "good" or "usable"; a worse verdict raises `GradeError`, after the files are written.
        threads: number of threads; 0: one a core.
        progress: called with a text on the present stage, from any thread.

    Raises `InputError` if session, images or target are wrong, `JobError` if they determine no calibration.
    """
    if (session is None) == (not isinstance(images, os.PathLike) and len(images) == 0):
        raise InputError("calibrate: give a session, or images with a target")
    if require not in ("", *_GRADES[:2]):
        raise InputError(f"require: expected 'good' or 'usable', found '{require}'")
    if frames < 0:
        raise InputError(f"frames: expected a positive number, found {frames}")
    request = _with_options(_core.CalibrateRequest(), out, keep, fresh)
    request.exclude = list(exclude)
    request.frames = frames
    request.all = all_frames
    request.model = model
    request.jackknife = jackknife
    if session is not None:
        if target or model != "auto":
            raise InputError("calibrate: a session has target and model itself; they go with images")
        request.session = _open(session)._native
    elif images_in_memory(images):
        if not target:
            raise InputError("calibrate: images in memory need a target")
        session = Session.from_images(target, images)  # holds copies of images until the run ends
        request.session = session._native
    else:
        if isinstance(images, Mapping):
            request.images.cameras = [f"{name}={os.fspath(glob)}" for name, glob in images.items()]
        else:
            request.images.images = paths(images)
        request.images.target = _target_text(target)
    record, summary = _core.calibrate(request, report, caller(threads, progress))
    calibration = Calibration._of(record) if out is None else Calibration(out)
    calibration.summary = summary
    verdict = calibration.verdict or {}
    if require and _GRADES.index(verdict["grade"]) > _GRADES.index(require):
        raise GradeError(f"the calibration is {verdict['grade']}, not {require}: {verdict['findings'][0]['what']}")
    return calibration


def detect_session(
    session: Session | PathLike,
    out: PathLike | None = None,
    *,
    keep: bool = False,
    fresh: bool = False,
    threads: int = 0,
    progress: Progress | None = None,
) -> dict[str, Table]:
    """Detects the target in all images of a session (`plenocal detect`).

    Args:
        session: a `Session` or its file.
        out: folder for detections_<camera>.csv; None: none is written.
        keep: write pictures of the stages into `out`/images.
        fresh: detect again, even if an earlier run into `out` has cached its detections.
        threads: number of threads; 0: one a core.
        progress: called with a text on the present stage, from any thread.

    Returns for each camera a table with one row per point: frame, marker, measured coordinates and context (px), sigma
    (of each coordinate, px). Raises `InputError`, and `JobError` if no image of a camera shows the target.
    """
    options = _with_options(_core.SessionOptions(), out, keep, fresh)
    found = _core.detect_session(_open(session)._native, options, caller(threads, progress))
    return {name: table(columns) for name, columns in found.items()}


def try_models(
    session: Session | PathLike,
    out: PathLike | None = None,
    *,
    models: Sequence[str] = (),
    camera: str = "",
    folds: int = 5,
    stress: bool = False,
    threads: int = 0,
    progress: Progress | None = None,
) -> list[dict[str, Any]]:
    """Compares camera models by their errors in held-out frames (`plenocal try`).

    Args:
        session: a `Session` or its file.
        out: folder for try.csv, try.yaml and the page try.html; None: none are written.
        models: names of the models; empty: all that have the same measured coordinates as the cameras.
        camera: the camera whose model is varied; empty: all of one type.
        folds: number of parts of the cross-validation, 2 or more.
        stress: stress tests of the recommended model, written to try.yaml and try.html.
        threads: number of threads; 0: one a core.
        progress: called with a text on the present stage, from any thread.

    Returns the rows of try.csv: model, parameters, held_out_rms (px), recommended, judgement, ... Raises `InputError`,
    and `JobError` for too few frames.
    """
    request = _with_options(_core.TryRequest(), out)
    request.models = list(models)
    request.camera = camera
    request.folds = folds
    request.stress = stress
    return _rows(_core.try_models(_open(session)._native, request, caller(threads, progress)))


def check(
    calibration: Calibration | PathLike,
    session: Session | PathLike,
    out: PathLike | None = None,
    *,
    map: Mapping[str, str] | None = None,
    threads: int = 0,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Tests whether a calibration is still valid for new images (`plenocal compare --check`).

    Args:
        calibration: a `Calibration`, its folder or its calibration.yaml.
        session: a `Session` of the new images or its file.
        out: folder for check.json, compare.csv and difference.png; None: none are written.
        map: for cameras with different names: `{name in the session: name in the calibration}`.
        threads: number of threads; 0: one a core.
        progress: called with a text on the present stage, from any thread.

    Returns the content of check.json (docs/formats.md): valid, frames, cameras (RMS in px, rotations in radians,
    translations in metres), verdict. Raises `InputError`, and `JobError` if the new images determine no poses.
    """
    request = _with_options(_core.CheckRequest(), out)
    request.map = [f"{a}={b}" for a, b in (map or {}).items()]
    result: dict[str, Any] = json.loads(
        _core.check(load(calibration)._native, _open(session)._native, request, caller(threads, progress))
    )
    return result


def compare(
    a: Calibration | PathLike,
    b: Calibration | PathLike,
    out: PathLike | None = None,
    *,
    distances: Sequence[float] = (),
    map: Mapping[str, str] | None = None,
) -> list[dict[str, Any]]:
    """Difference of two calibrations over the image (`plenocal compare`).

    Args:
        a: a `Calibration`, its folder or its calibration.yaml.
        b: another one, with any camera models.
        out: folder for compare.csv and difference.png; None: none are written.
        distances: of the scene, m, `inf` for far away; empty: 1 m and far away.
        map: for cameras with different names: `{name in a: name in b}`.

    Returns the rows of compare.csv: camera, distance (m), part, rms, largest, predicted (px), probability, pixels,
    differs. Raises `InputError` for calibrations that cannot be compared.
    """
    pairs = [f"{own}={other}" for own, other in (map or {}).items()]
    values = [float(distance) for distance in distances]
    folder = "" if out is None else os.fspath(out)
    return _rows(_core.compare(load(a)._native, load(b)._native, pairs, values, folder))


def suggest(
    source: Calibration | Session | PathLike | None = None,
    *,
    target: Target | PathLike = "",
    size: Sequence[int] | None = None,
    model: str = "pinhole-radtan4",
    angle: float | None = None,
    count: int = 5,
    near: float | None = None,
    far: float | None = None,
    tilt: float = 50,
    goal: float = 0.05,
    depth_at: float | None = None,
    picture: PathLike = "",
    threads: int = 0,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Poses of the target whose images would lower the projection's standard error most (`plenocal suggest`).

    Args:
        source: a `Calibration` or its folder, a `Session` or its file; None: there is no image yet, and target, size
            and angle are given.
        target: before the first image: a `Target`, a target in one word, or a file.
        size: before the first image: width and height, px.
        model: before the first image: a camera model (`models()`).
        angle: horizontal field of view, degrees (1 to 300): before the first image, and while images do not determine
            it; None: not given.
        count: number of suggestions, 1 to 100.
        near: smallest distance of the target, m; None: as target and lens allow.
        far: largest distance of the target, m; None: likewise.
        tilt: largest tilt of the target against the line of sight, degrees (0 to 75).
        goal: standard error of the projection that suffices, px; with `depth_at` that of z, mm.
        depth_at: views lower the standard error of z of points at this distance, m; None: that of the projection.
        picture: SVG or PNG file with a drawing of the suggested images; empty: none is written.
        threads: number of threads; 0: one a core.
        progress: called with a text on the present stage, from any thread.

    Returns what docs/suggest.md lists under JSON: sigma_now (px), views with words, T_camera_target (4 x 4),
    sigma_after (px), ... Raises `InputError`, and `JobError` if the images determine no calibration and no angle is
    given.
    """
    request = _core.SuggestRequest()
    request.target = _target_text(target)
    request.size = image_size(size)
    request.model = model
    request.angle = _positive(angle, "angle")
    request.count = count
    request.near = _positive(near, "near")
    request.far = _positive(far, "far")
    request.tilt = tilt
    request.goal = goal
    request.depth_at = _positive(depth_at, "depth_at")
    given: list[_core.Session | _core.Record] = []
    if isinstance(source, Session):
        given.append(_open(source)._native)
    elif isinstance(source, Calibration) and not source.path:
        given.append(source._native)
    elif source is not None:
        request.input = source.path if isinstance(source, Calibration) else os.fspath(source)
    printed = _core.suggest(request, os.fspath(picture), caller(threads, progress), *given)
    suggestions: dict[str, Any] = json.loads(printed)
    return suggestions


def weigh(
    calibration: PathLike,
    pictures: Mapping[str, PathLike] | PathLike,
    *,
    threads: int = 0,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Predicts how much a picture of the target would improve a calibration (`plenocal suggest --image`).

    Args:
        calibration: the folder of results of `calibrate`.
        pictures: an image file for a single camera, or `{camera: file}` for pictures that were taken at once.
        threads: number of threads; 0: one a core.
        progress: called with a text on the present stage, from any thread.

    Returns points, words, sigma_now and sigma_after (px), share (of the improvement by the best view); None: not known.
    Raises `InputError` for a picture of another size or of an unknown camera.
    """
    named = pictures if isinstance(pictures, Mapping) else {"": pictures}
    files = {name: os.fspath(path) for name, path in named.items()}
    result: dict[str, Any] = json.loads(_core.weigh(os.fspath(calibration), files, caller(threads, progress)))
    return result


def locate(
    calibration: Calibration | PathLike,
    map: Target | PathLike,
    images: PathLike | Sequence[Any] | Mapping[str, Any],
    out: PathLike | None = None,
    *,
    camera: str = "",
    white: PathLike | Sequence[PathLike] = (),
    threads: int = 0,
    progress: Progress | None = None,
) -> list[dict[str, Any]]:
    """Pose of each image relative to a target or the points of a map (`plenocal locate`).

    Args:
        calibration: a `Calibration`, its folder or its calibration.yaml.
        map: a `Target`, a target in one word, a target's file, or points.csv of an earlier run.
        images: folders, globs, image files or tables of detections (CSV); or arrays: a sequence, or `{name: array}`,
            of the shape (H, W), or (H, W, 3) in the order blue, green, red, and 8 or 16 bits.
        out: table for the poses (CSV); None: none is written.
        camera: the camera of the images; required if the calibration has several.
        white: white images of a plenoptic camera: folders, globs and files.
        threads: number of threads; 0: one a core.
        progress: called with a text on the present stage, from any thread.

    Returns for each image that has a pose a dict: image, points, used, rms (px), translation (3,) (m) and quaternion
    (4,) (x, y, z, w) of T_map_camera, T_map_camera (4, 4), covariance (6, 6) (se(3): x, y, z in m, then rotations in
    radians). Raises `InputError`, and `JobError` if no image has a pose.
    """
    request = _core.LocateRequest()
    if isinstance(map, Target) or not os.fspath(map).endswith(".csv"):
        request.target = (map if isinstance(map, Target) else Target(map))._native
    else:
        request.map = os.fspath(map)
    arrays = images_in_memory({"image": images})
    request.images = [] if arrays else paths(images)  # type: ignore[arg-type]
    request.camera = camera
    request.white = paths(white)
    request.out = "" if out is None else os.fspath(out)
    frames = arrays[0][1] if arrays else []
    return _core.locate(load(calibration)._native, request, frames, caller(threads, progress))


def simulate(
    specification: PathLike,
    out: PathLike,
    *,
    points: bool = False,
    threads: int = 0,
    progress: Progress | None = None,
) -> Session:
    """Makes a session with known truth (`plenocal simulate`).

    Args:
        specification: file with the specification (docs/simulate.md).
        out: folder for the session, its images and its truth.
        points: write noisy detections in place of images.
        threads: number of threads; 0: one a core.
        progress: called with a text on the present stage, from any thread.

    Returns the session. Raises `InputError` with file, line and key.
    """
    _core.simulate(os.fspath(specification), os.fspath(out), points, caller(threads, progress))
    return Session(os.path.join(os.fspath(out), "session.yaml"))


_GRADES = ("good", "usable", "bad")


def paths(given: PathLike | Sequence[PathLike]) -> list[str]:
    """One or several paths as a list of texts."""
    if isinstance(given, (str, os.PathLike)):
        return [os.fspath(given)]
    return [os.fspath(path) for path in given]


def load(calibration: Calibration | PathLike) -> Calibration:
    """The calibration, read where a path is given."""
    return calibration if isinstance(calibration, Calibration) else Calibration(calibration)


def image_size(size: Sequence[int] | None) -> tuple[int, int] | None:
    """Width and height of new images. Raises `InputError`."""
    return None if size is None else pixels(size, "size", 2**15)


def _target_text(target: Target | PathLike) -> str:
    return target.yaml if isinstance(target, Target) else os.fspath(target)


def _positive(number: float | None, name: str) -> float:
    if number is not None and not number > 0:
        raise InputError(f"{name}: expected a positive number, found {number}")
    return number or 0


def _rows(text: str) -> list[dict[str, Any]]:
    """The rows of a CSV table; cells with numbers but those of names become floats, empty ones None."""

    def value(key: str, text: str) -> Any:
        if key in ("camera", "model", "part"):
            return text or None
        try:
            return float(text) if text else None
        except ValueError:
            return text

    return [{key: value(key, text) for key, text in row.items()} for row in csv.DictReader(text.splitlines())]


def _open(session: Session | PathLike) -> Session:
    """The session, read again if it has a file."""
    if isinstance(session, Session):
        return Session(session.path) if session.text else session
    return Session(session)


Request = TypeVar("Request", bound=_core.SessionOptions)


def _with_options(request: Request, out: PathLike | None, keep: bool = False, fresh: bool = False) -> Request:
    request.out = "" if out is None else os.fspath(out)
    request.keep = keep
    request.fresh = fresh
    return request

# SPDX-License-Identifier: Apache-2.0
"""What the commands of the program do.

`calibrate`, `detect_session`, `try_models` and `simulate` call the engine: runs of several threads
go on side by side, and nothing is written unless `out` is given. The others run the program.
Files are those of the program, byte for byte. The options of all are

out: folder for the results; None: none are written.
threads: 0: all cores. progress: called with a text on the present stage, from any thread
(`tqdm.set_description` fits); an exception in it stops the run. Ctrl-C stops it as well.

Messages go to the logger "plenocal".
"""

from __future__ import annotations

import csv
import json
import os
import tempfile
from typing import TYPE_CHECKING, Any, Callable, Mapping, Sequence

from . import _core
from .calibration import Calibration
from .camera import Camera
from .errors import GradeError, InputError, JobError
from .session import Session
from .target import Target

if TYPE_CHECKING:
    from .arrays import FloatArray, PathLike

Progress = Callable[[str], object]


def run(arguments: Sequence[PathLike], *, progress: Progress | None = None) -> str:
    """Runs the program and returns what it prints; `progress` gets the lines of its messages.

    Camera models of `register` are not known there. Raises `InputError`, `JobError`, `GradeError`
    (exit statuses 2, 1, 3) with the message of the program, and `KeyboardInterrupt` after Ctrl-C; no
    result files are written then.

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
                _message(last.strip(), last.startswith("  warning: "))
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


def calibrate(
    session: Session | PathLike | None = None,
    out: PathLike | None = None,
    *,
    images: PathLike | Sequence[Any] | Mapping[str, Any] = (),
    target: Target | PathLike = "",
    model: str = "auto",
    jackknife: bool = False,
    keep: bool = False,
    fresh: bool = False,
    report: bool = True,
    require: str = "",
    threads: int = 0,
    progress: Progress | None = None,
) -> Calibration:
    """Calibrates the cameras of a session, or cameras from images and a target.

    images: a folder, a glob or files of one camera; or arrays in memory: of one camera a sequence,
    of several `{name: {frame: array}}`, the first being the rig's master. An array has shape (H, W),
    or (H, W, 3) in the order blue, green, red, of 8 or 16 bits. require: "good" or "usable"; a worse
    verdict raises `GradeError`, after the files are written. Raises what `Error` lists.
    """
    if (session is None) == (_is_empty(images)):
        raise InputError("calibrate: give a session, or images with a target")
    files: list[str] = []
    if session is not None:
        native = _open(session)._native
        if target or model != "auto":
            raise InputError("calibrate: a session has target and model itself; they go with images")
    elif arrays := _arrays(images):
        if not target:
            raise InputError("calibrate: images in memory need a target")
        given = target if isinstance(target, Target) else Target(target)
        native = _core.session_of_arrays(given.yaml, [(name, "", [], frames, []) for name, frames in arrays])
    else:
        native, files = None, _paths(images)  # type: ignore[arg-type]
    with tempfile.TemporaryDirectory() as folder:
        word = _target_file(target, folder) if isinstance(target, Target) else os.fspath(target)
        record, summary = _core.calibrate(
            native, files, word, model, jackknife, report, _options(out, keep, fresh), threads, progress, _message
        )
    calibration = Calibration._of(record) if out is None else Calibration(out)
    calibration.summary = summary
    verdict = calibration.verdict or {}
    grades = ["good", "usable", "bad"]
    if require not in ("", *grades[:2]):
        raise InputError(f"require: expected 'good' or 'usable', found '{require}'")
    if require and grades.index(verdict["grade"]) > grades.index(require):
        raise GradeError(f"the calibration is {verdict['grade']}, not {require}: {verdict['findings'][0]['what']}")
    return calibration


def detect_session(
    session: Session | PathLike,
    out: PathLike,
    *,
    keep: bool = False,
    fresh: bool = False,
    threads: int = 0,
    progress: Progress | None = None,
) -> dict[str, int]:
    """Detects the target in all images of a session: OUT/detections_<camera>.csv.

    Returns the number of points of each camera.
    """
    options = _options(out, keep, fresh)
    return dict(_core.detect_session(_open(session)._native, options, threads, progress, _message))


def try_models(
    session: Session | PathLike,
    out: PathLike | None = None,
    *,
    models: Sequence[str] = (),
    camera: str = "",
    folds: int = 5,
    threads: int = 0,
    progress: Progress | None = None,
) -> list[dict[str, Any]]:
    """Which camera model predicts frames that it has not seen best (`plenocal try`).

    Returns the rows of try.csv: model, parameters, held_out_rms (px), recommended, judgement, ...
    """
    table = _core.try_models(
        _open(session)._native, list(models), camera, folds, _options(out), threads, progress, _message
    )
    return _rows(table)


def check(
    calibration: Calibration | PathLike,
    session: Session | PathLike,
    *,
    threads: int = 0,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Whether a calibration still holds for new images (`plenocal compare --check`).

    Returns the content of check.json: valid, cameras, verdict.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "out")
        words = ["compare", _calibration(calibration, folder), "--check", _session(session), "-o", path]
        try:
            run([*words, *_threads(threads)], progress=progress)
        except Exception:
            # A calibration that does not hold is exit status 1 of the program.
            if not os.path.exists(os.path.join(path, "check.json")):
                raise
        with open(os.path.join(path, "check.json"), encoding="utf-8") as file:
            result: dict[str, Any] = json.load(file)
            return result


def compare(
    a: Calibration | PathLike, b: Calibration | PathLike, *, distances: Sequence[float] = ()
) -> list[dict[str, Any]]:
    """How far two calibrations differ in the image (`plenocal compare`).

    Returns the rows of compare.csv: camera, distance (m), part, rms, largest, predicted (px),
    probability, pixels, differs.
    """
    with tempfile.TemporaryDirectory() as folder:
        files = [_calibration(c, os.path.join(folder, name)) for c, name in ((a, "a"), (b, "b"))]
        words = ["compare", *files, "-o", os.path.join(folder, "out")]
        for distance in distances:
            words += ["--distance", repr(float(distance))]
        run(words)
        with open(os.path.join(folder, "out", "compare.csv"), encoding="utf-8") as file:
            return _rows(file.read())


def suggest(
    source: Calibration | Session | PathLike | None = None,
    *,
    target: Target | PathLike = "",
    size: Sequence[int] | None = None,
    model: str = "",
    angle: float | None = None,
    count: int = 5,
    near: float | None = None,
    far: float | None = None,
    tilt: float | None = None,
    goal: float | None = None,
    picture: PathLike = "",
    threads: int = 0,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Poses of the target whose images would lower the projection's sigma most (`plenocal suggest`).

    source: a calibration's folder or a session; None: before the first image, from target, size
    (width, height, px), model and angle. angle: horizontal field of view, degrees. near, far: m.
    tilt: degrees. goal: px. picture: SVG or PNG file. Returns what docs/suggest.md lists under
    JSON: sigma_now (px), views with words, T_camera_target (4 x 4), sigma_after (px), ...
    """
    words: list[PathLike] = ["suggest", "--json", "--count", str(int(count))]
    numbers = {"--angle": angle, "--near": near, "--far": far, "--tilt": tilt, "--goal": goal}
    for option, number in numbers.items():
        words += [option, repr(float(number))] if number is not None else []
    words += ["--model", model] if model else []
    words += ["--picture", picture] if picture else []
    if (of_size := _size(size)) is not None:
        words += ["--size", f"{of_size[0]}x{of_size[1]}"]
    with tempfile.TemporaryDirectory() as folder:
        if isinstance(target, Target):
            words += ["--target", _target_file(target, folder)]
        elif target:
            words += ["--target", target]
        if isinstance(source, Calibration):
            words.append(os.path.dirname(source.path))
        elif source is not None:
            words.append(_session(source))
        printed = run([*words, *_threads(threads)], progress=progress)
    suggestions: dict[str, Any] = json.loads(printed)
    return suggestions


def locate(
    calibration: Calibration | PathLike,
    map: Target | PathLike,
    images: PathLike | Sequence[PathLike],
    *,
    camera: str = "",
    white: PathLike | Sequence[PathLike] = (),
    threads: int = 0,
    progress: Progress | None = None,
) -> list[dict[str, Any]]:
    """Pose of each image before a target or the points of a map (`plenocal locate`).

    map: a target, or points.csv of a ground truth. images: images, or one table of detections.
    camera: needed if the calibration has several. Returns for each image that has a pose: image,
    points, used, rms (px), translation (m) and quaternion (x, y, z, w) of T_map_camera,
    covariance (6 x 6, se(3): x, y, z in m, then rotations in radians).
    """
    with tempfile.TemporaryDirectory() as folder:
        given = _target_file(map, folder) if isinstance(map, Target) else os.fspath(map)
        words = ["locate", _calibration(calibration, folder), given, *_paths(images), "--json"]
        words += ["--camera", camera] if camera else []
        for item in _paths(white):
            words += ["--white", item]
        printed = run([*words, *_threads(threads)], progress=progress)
    poses: list[dict[str, Any]] = json.loads(printed)
    return poses


def simulate(
    specification: PathLike,
    out: PathLike,
    *,
    points: bool = False,
    threads: int = 0,
    progress: Progress | None = None,
) -> Session:
    """Makes a session with known truth (`plenocal simulate`); points: detections, no images."""
    _core.simulate(os.fspath(specification), os.fspath(out), points, threads, progress, _message)
    return Session(os.path.join(os.fspath(out), "session.yaml"))


def white(
    images: Session | PathLike | Sequence[PathLike],
    out: PathLike,
    *,
    model: str = "",
    camera: str = "",
    threads: int = 0,
    progress: Progress | None = None,
) -> str:
    """Micro-lens grid and attenuation from white images (`plenocal white`)."""
    inputs = [images.path] if isinstance(images, Session) else _paths(images)
    words = ["white", *inputs, "-o", os.fspath(out)]
    words += ["--model", model] if model else []
    words += ["--camera", camera] if camera else []
    return run([*words, *_threads(threads)], progress=progress)


def focus(
    images: PathLike | Sequence[PathLike],
    out: PathLike,
    *,
    white: PathLike | Sequence[PathLike] = (),
    grid: PathLike = "",
    vignetting: PathLike = "",
    scale: float = 2,
    threads: int = 0,
    progress: Progress | None = None,
) -> str:
    """Totally focused image and virtual depth of raw plenoptic images (`plenocal focus`)."""
    words = ["focus", *_paths(images), "-o", os.fspath(out), "--scale", repr(float(scale))]
    for folder in _paths(white):
        words += ["--white", folder]
    words += ["--grid", os.fspath(grid)] if grid else []
    words += ["--vignetting", os.fspath(vignetting)] if vignetting else []
    return run([*words, *_threads(threads)], progress=progress)


def rectify(
    calibration: Calibration | PathLike,
    left: PathLike,
    right: PathLike,
    out: PathLike,
    *,
    threads: int = 0,
    progress: Progress | None = None,
) -> str:
    """Rectified stereo pairs of image files (`plenocal rectify`); `rectify_maps` gives the tables."""
    with tempfile.TemporaryDirectory() as folder:
        words = ["rectify", _calibration(calibration, folder), left, right, "-o", out]
        return run([*words, *_threads(threads)], progress=progress)


def undistort_maps(
    camera: Camera,
    *,
    size: Sequence[int] | None = None,
    fov: float | None = None,
    balance: float | None = None,
    threads: int = 0,
) -> tuple[FloatArray, FloatArray, Camera]:
    """Tables for cv2.remap, and the pinhole camera whose images they make (`plenocal map`).

    size: width, height, px (None: the camera's). fov: horizontal field of view, degrees. balance:
    0: every pixel has a source, 1: all that the camera images. Returns map_x and map_y, (H, W)
    float32, px, -1 where the camera images nothing.
    """
    x, y, view = _core.undistort_maps(camera._native, _size(size), fov, balance, threads)
    return x, y, Camera._of(view)


def rectify_maps(
    first: Camera,
    second: Camera,
    *,
    size: Sequence[int] | None = None,
    fov: float | None = None,
    balance: float | None = None,
    threads: int = 0,
) -> tuple[tuple[FloatArray, FloatArray, Camera], tuple[FloatArray, FloatArray, Camera], float]:
    """Tables for cv2.remap of a stereo pair, whose points then lie in equal rows.

    Returns for each camera map_x, map_y, new camera as `undistort_maps` does, and the baseline, m
    (negative when the second camera lies on the left).
    """
    one, two, baseline = _core.rectify_maps(
        first._native, second._native, _size(size), fov, balance, threads
    )
    return (*one[:2], Camera._of(one[2])), (*two[:2], Camera._of(two[2])), baseline


def _paths(paths: PathLike | Sequence[PathLike]) -> list[str]:
    if isinstance(paths, (str, os.PathLike)):
        return [os.fspath(paths)]
    return [os.fspath(path) for path in paths]


def _session(session: Session | PathLike) -> str:
    return session.path if isinstance(session, Session) else os.fspath(session)


def _target_file(target: Target, folder: str) -> str:
    path = os.path.join(folder, "given_target.yaml")
    with open(path, "w", encoding="utf-8") as stream:
        stream.write(target.yaml)
    return path


def _calibration(calibration: Calibration | PathLike, folder: str) -> str:
    """The calibration.yaml, written into the folder if the object has none."""
    if not isinstance(calibration, Calibration):
        path = os.fspath(calibration)
        return os.path.join(path, "calibration.yaml") if os.path.isdir(path) else path
    if os.path.exists(calibration.path):
        return calibration.path
    os.makedirs(folder, exist_ok=True)
    path = os.path.join(folder, "calibration.yaml")
    calibration.save(path)
    return path


def _flags(**flags: bool) -> list[str]:
    return ["--" + name.replace("_", "-") for name, wanted in flags.items() if wanted]


def _threads(threads: int) -> list[str]:
    return ["--threads", str(int(threads))] if threads else []


def _size(size: Sequence[int] | None) -> list[int] | None:
    if size is None:
        return None
    values = [int(v) for v in size]
    if len(values) != 2 or not all(0 < v < 2**15 for v in values):
        raise InputError(f"size: expected width and height in pixels, found {size}")
    return values


def _rows(table: str) -> list[dict[str, Any]]:
    """The rows of a CSV table with its numbers as numbers."""

    def value(text: str) -> Any:
        try:
            return float(text) if text else None
        except ValueError:
            return text

    return [{key: value(text) for key, text in row.items()} for row in csv.DictReader(table.splitlines())]


def _message(line: str, warning: bool) -> None:
    import logging

    logging.getLogger("plenocal").log(logging.WARNING if warning else logging.INFO, "%s", line.strip())


def _open(session: Session | PathLike) -> Session:
    """The session as its file is now, or the one in memory."""
    if isinstance(session, Session) and not session.text:
        return session
    return Session(_session(session))


def _options(out: PathLike | None, keep: bool = False, fresh: bool = False) -> tuple[str, bool, bool, list[str]]:
    return ("" if out is None else os.fspath(out), keep, fresh, [])


def _is_empty(images: Any) -> bool:
    return hasattr(images, "__len__") and len(images) == 0


def _arrays(images: Any) -> list[tuple[str, list[tuple[str, Any]]]]:
    """Cameras with their frames, of images in memory; none of paths."""
    import numpy as np

    if isinstance(images, (str, os.PathLike)):
        return []
    if isinstance(images, Mapping):
        cameras = images
    elif isinstance(images[0], (str, os.PathLike)):
        return []
    else:
        cameras = {"cam": images}
    found = []
    for name, frames in cameras.items():
        named = frames.items() if isinstance(frames, Mapping) else ((f"{i:04}", f) for i, f in enumerate(frames))
        rows = []
        for frame, pixels in named:
            array = np.asarray(pixels)
            shape_fits = array.ndim == 2 or (array.ndim == 3 and array.shape[2] == 3)
            if not shape_fits or array.size == 0 or array.dtype not in (np.uint8, np.uint16):
                raise InputError(
                    f"{name}: frame {frame}: expected (H, W) or (H, W, 3), uint8 or uint16, found "
                    f"{array.dtype} of shape {array.shape}"
                )
            if array.strides[-1] != array.itemsize or (array.ndim == 3 and array.strides[1] != 3 * array.itemsize):
                array = np.ascontiguousarray(array)
            if array.strides[0] < 0:
                array = np.ascontiguousarray(array)
            rows.append((str(frame), array))
        found.append((str(name), rows))
    return found

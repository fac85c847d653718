# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import filecmp
import json
import os
import pathlib
import re
import resource
import signal
import subprocess
import sys
import threading
from typing import Any, Callable

import numpy as np
import pytest

import plenocal

from conftest import CHESSBOARDS, ROOT

PROGRAM = os.environ.get("PLENOCAL_PROGRAM", "")


def _specification(folder: pathlib.Path, seed: int) -> pathlib.Path:
    """A simulated camera before a chessboard, in a file."""
    examples = ROOT / "examples/simulate"
    text = (examples / "one_camera.yaml").read_text().replace("frames: 30", "frames: 12")
    path = folder / f"spec_{seed}.yaml"
    path.write_text(re.sub(r"seed: \d+", f"seed: {seed}", text))
    (folder / "board.yaml").write_text((examples / "board.yaml").read_text())
    return path


def test_finds_the_simulated_camera(
    session: plenocal.Session, calibration: plenocal.Calibration
) -> None:
    truth = plenocal.Calibration(
        pathlib.Path(session.path).parent / "truth" / "calibration.yaml"
    )
    camera = calibration[0]
    error = (camera.params - truth[0].params) / np.sqrt(np.diag(camera.covariance))
    assert np.abs(error).max() < 4
    assert calibration.verdict is not None and calibration.verdict["grade"] in ("good", "usable")
    assert "verdict" in calibration.summary
    table = camera.parameters
    assert list(table.dtype.names or ()) == ["name", "value", "sigma", "unit"]
    assert (table["value"] == camera.params).all()


def test_residuals_and_poses_are_tables(calibration: plenocal.Calibration) -> None:
    residuals = calibration.residuals()
    assert {"frame", "marker", "x", "y", "residual_x", "residual_y", "used"} <= set(
        residuals.dtype.names or ()
    )
    poses = calibration.poses
    camera = calibration[0]
    positions = {row["marker"]: row["position"] for row in calibration.markers}
    T_target_rig = {row["frame"]: row["T_target_rig"] for row in poses}
    p = np.array(
        [
            np.linalg.inv(T_target_rig[row["frame"]]) @ [*positions[row["marker"]], 1]
            for row in residuals
        ]
    )[:, :3]
    predicted = camera.project(p @ camera.T_camera_rig[:3, :3].T + camera.T_camera_rig[:3, 3])
    measured = np.stack([residuals["x"], residuals["y"]], axis=1)
    found = np.stack([residuals["residual_x"], residuals["residual_y"]], axis=1)
    np.testing.assert_allclose(measured - predicted, found, atol=1e-4)  # as files round them
    used = residuals["used"]
    rms = np.sqrt(np.mean(np.sum(found[used] ** 2, axis=1)))
    assert rms == pytest.approx(camera.fit["rms"], abs=1e-4)


@pytest.mark.skipif(not PROGRAM, reason="PLENOCAL_PROGRAM names no program")
def test_writes_the_files_of_the_program_byte_for_byte(
    session: plenocal.Session, tmp_path: pathlib.Path
) -> None:
    out = tmp_path / "out"
    subprocess.run(
        [PROGRAM, "calibrate", session.path, "-o", out], check=True, capture_output=True
    )
    program = tmp_path / "program"
    out.rename(program)
    plenocal.calibrate(session, out)
    names = sorted(p.name for p in program.iterdir() if p.is_file())
    assert "calibration.yaml" in names and "residuals.csv" in names
    match, mismatch, errors = filecmp.cmpfiles(program, out, names, shallow=False)
    assert not mismatch and not errors


def test_a_calibration_of_real_images(tmp_path: pathlib.Path) -> None:
    stages: list[str] = []
    result = plenocal.calibrate(
        images=sorted(CHESSBOARDS.glob("left*.jpg")),
        target="chessboard:9x6:25mm",
        model="pinhole-radtan",
        progress=stages.append,
        report=False,
    )
    assert result[0].fit["rms"] < 0.3
    assert result[0].params[0] == pytest.approx(536, abs=3)
    assert len(stages) > 3


def test_points_from_detect_calibrate_a_camera(tmp_path: pathlib.Path) -> None:
    target = plenocal.Target("chessboard:9x6:25mm")
    files = sorted(CHESSBOARDS.glob("left*.jpg"))[:5]
    points = {file.stem: plenocal.detect(file, target) for file in files}
    assert all(len(table) == 54 for table in points.values())
    cameras = {"left": {"model": "pinhole-radtan4", "image_size": (640, 480), "points": points}}
    session = plenocal.Session.from_points(tmp_path / "session", target, cameras)
    result = plenocal.calibrate(session, report=False)
    assert result["left"].params[0] == pytest.approx(536, abs=5)


def test_detect_takes_arrays() -> None:
    size, square = 480, 40
    board = np.indices((size, size)).sum(axis=0) * 0
    for row in range(7):
        for column in range(10):
            if (row + column) % 2 == 0:
                y, x = 60 + row * square, 40 + column * square
                board[y : y + square, x : x + square] = 1
    image = np.full((size, size), 230, dtype=np.uint8)
    image[board == 1] = 20
    found = plenocal.detect(image, "chessboard:9x6:25mm")
    # Corners lie between pixels.
    assert sorted(set(np.round(found["x"] - 0.5 + 1e-9).astype(int) % square)) == [39]
    wide = (image.astype(np.uint16)) * 16
    again = plenocal.detect(wide, "chessboard:9x6:25mm")
    np.testing.assert_allclose(again["x"], found["x"], atol=0.01)
    with pytest.raises(plenocal.JobError, match="image: "):
        plenocal.detect(np.zeros((100, 100), np.uint8), "chessboard:9x6:25mm")
    with pytest.raises(plenocal.InputError, match="gray image"):
        plenocal.detect(np.zeros((100, 100, 3), np.uint8), "chessboard:9x6:25mm")


def test_files_come_back(calibration: plenocal.Calibration, tmp_path: pathlib.Path) -> None:
    calibration.save(tmp_path / "calibration.yaml")
    again = plenocal.Calibration.load(tmp_path / "calibration.yaml")
    np.testing.assert_array_equal(again[0].params, calibration[0].params)
    np.testing.assert_array_equal(again[0].T_camera_rig, calibration[0].T_camera_rig)
    calibration.to_opencv(tmp_path / "camera.yml")
    assert "camera_matrix" in (tmp_path / "camera.yml").read_text()
    calibration.report(tmp_path / "report.html")
    assert "<html" in (tmp_path / "report.html").read_text()
    html = calibration._repr_html_()
    assert "verdict" in html and "data:image/png;base64," in html


def test_given_cameras_are_exported(tmp_path: pathlib.Path) -> None:
    camera = plenocal.Camera("pinhole", (640, 480), [500, 500, 320, 240], name="left")
    calibration = plenocal.Calibration.of_cameras([camera])
    calibration.export(tmp_path / "cameras.txt", "colmap")
    assert "PINHOLE 640 480" in (tmp_path / "cameras.txt").read_text()


def test_models_are_tried(session: plenocal.Session, calibration: plenocal.Calibration, tmp_path: pathlib.Path) -> None:
    rows = plenocal.try_models(session, tmp_path / "out", models=["pinhole", calibration[0].model], folds=2, stress=True)
    assert "\nstress:\n" in (tmp_path / "out/try.yaml").read_text()
    assert {row["model"] for row in rows} == {"pinhole", calibration[0].model}
    with pytest.raises(plenocal.InputError, match="folds: expected a number from 2"):
        plenocal.try_models(session, folds=1)


def test_a_session_is_detected_into_tables(session: plenocal.Session, tmp_path: pathlib.Path) -> None:
    points = plenocal.detect_session(session, tmp_path / "out")
    (name,) = points
    assert points[name].dtype.names == ("frame", "marker", "x", "y", "sigma")
    frames = {
        str(frame): points[name][points[name]["frame"] == frame] for frame in np.unique(points[name]["frame"])
    }
    again = plenocal.Session.from_points(
        None, session.target, {name: {"model": "pinhole-radtan", "image_size": (640, 480), "points": frames}}
    )
    assert sum(len(table) for table in plenocal.detect_session(again).values()) == len(points[name])


def test_a_check_is_data_and_files_where_they_are_wanted(
    session: plenocal.Session, calibration: plenocal.Calibration, tmp_path: pathlib.Path
) -> None:
    check = plenocal.check(calibration, session)
    assert check["valid"] is True
    out = tmp_path / "out"
    again = plenocal.check(plenocal.calibrate(session), session, out)
    assert again["valid"] is True and again["frames"] == check["frames"]
    assert again["cameras"][0]["rms_expected"] == pytest.approx(check["cameras"][0]["rms_expected"], rel=1e-6)
    assert sorted(file.name for file in out.iterdir() if not file.name.startswith(".")) == [
        "check.json",
        "compare.csv",
        "difference.png",
    ]
    assert json.loads((out / "check.json").read_text()) == again
    with pytest.raises(plenocal.InputError, match="other=left"):
        plenocal.check(calibration, session, map={"other": "left"})


def test_differences_of_calibrations_in_memory_are_those_of_files(
    session: plenocal.Session,
    calibration: plenocal.Calibration,
    tmp_path: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # A calibration of that name in the working folder is another one.
    (tmp_path / "calibration.yaml").write_text("no calibration")
    monkeypatch.chdir(tmp_path)
    found = plenocal.calibrate(session)
    assert found.path == ""
    assert plenocal.compare(found, found)[0]["largest"] < 1e-9
    camera = found[0]
    moved = plenocal.Camera(camera.model, camera.image_size, camera.params + 1e-3, covariance=camera.covariance)
    other = plenocal.Calibration.of_cameras([moved])
    rows = plenocal.compare(found, other, "out", distances=[0.5, float("inf")])
    assert {row["distance"] for row in rows} == {0.5, float("inf")}
    assert (tmp_path / "out/compare.csv").exists() and (tmp_path / "out/difference.png").exists()
    of_files = plenocal.compare(pathlib.Path(calibration.path).parent, other, distances=[0.5, float("inf")])
    for row, of_file in zip(rows, of_files):
        assert row["largest"] == pytest.approx(of_file["largest"], abs=1e-5)
    with pytest.raises(plenocal.InputError, match="distances: expected positive"):
        plenocal.compare(found, other, distances=[-1])


def test_suggested_views_lower_sigma(calibration: plenocal.Calibration) -> None:
    found = plenocal.suggest(calibration, count=1, goal=1e-6)
    (view,) = found["views"]
    assert np.array(view["T_camera_target"]).shape == (4, 4)
    assert 0 < view["sigma_after"] < view["sigma_before"] == found["sigma_now"]
    with pytest.raises(plenocal.InputError, match="tilt: expected a number from 0 to 75, found 80"):
        plenocal.suggest(calibration, tilt=80)
    with pytest.raises(plenocal.InputError, match="near: expected a positive number"):
        plenocal.suggest(calibration, near=-1)
    first = plenocal.suggest(target="chessboard:9x6:25mm", size=(1280, 960), angle=70, count=1)
    assert first["frames"] == 0 and first["views"][0]["criterion"] == "undetermined"
    with pytest.raises(plenocal.InputError, match="size: expected width and height"):
        plenocal.suggest(target="chessboard:9x6:25mm", size=(1280,))


def test_suggestions_in_memory_are_those_of_files(
    session: plenocal.Session, calibration: plenocal.Calibration, tmp_path: pathlib.Path
) -> None:
    picture = tmp_path / "next.svg"
    of_files = plenocal.suggest(calibration, count=2, goal=1e-6, picture=picture)
    assert "<svg" in picture.read_text()
    found = plenocal.suggest(plenocal.calibrate(session), count=2, goal=1e-6)
    assert [view["words"] for view in found["views"]] == [view["words"] for view in of_files["views"]]
    assert found["sigma_now"] == pytest.approx(of_files["sigma_now"], rel=1e-6)
    of_session = plenocal.suggest(session, count=1, goal=1e-6)
    # The session's target is the one as stated, that of the files the refined one.
    assert of_session["views"][0]["sigma_after"] == pytest.approx(of_files["views"][0]["sigma_after"], rel=0.02)
    given = plenocal.Calibration.of_cameras([calibration[0]])
    with pytest.raises(plenocal.InputError, match="the calibration has no target"):
        plenocal.suggest(given)


def test_a_picture_is_weighed(tmp_path: pathlib.Path) -> None:
    files = sorted(CHESSBOARDS.glob("left*.jpg"))
    plenocal.calibrate(
        images=files[:6], target="chessboard:9x6:25mm", model="pinhole-radtan4", out=tmp_path / "out", report=False
    )
    worth = plenocal.weigh(tmp_path / "out", files[7])
    assert worth["points"] == 54 and worth["sigma_after"] < worth["sigma_now"]
    with pytest.raises(plenocal.InputError, match="no camera 'right'"):
        plenocal.weigh(tmp_path / "out", {"right": files[7]})


def test_an_image_in_memory_is_located() -> None:
    cv2 = pytest.importorskip("cv2")
    files = sorted(CHESSBOARDS.glob("left*.jpg"))
    target = plenocal.Target("chessboard:9x6:25mm")
    calibration = plenocal.calibrate(images=files, target=target, model="pinhole-radtan4")
    image = cv2.imread(str(files[0]), cv2.IMREAD_GRAYSCALE)
    (found,) = plenocal.locate(calibration, target, {"now": image})
    (of_file,) = plenocal.locate(calibration, target, files[0])
    assert found["image"] == "now" and of_file["image"] == str(files[0])
    assert found["covariance"].shape == (6, 6)
    np.testing.assert_allclose(found["T_map_camera"], of_file["T_map_camera"], atol=1e-12)
    np.testing.assert_allclose(found["T_map_camera"][:3, 3], found["translation"])
    pose = calibration.poses[0]["T_target_rig"]
    np.testing.assert_allclose(found["T_map_camera"], pose, atol=2e-3)
    with pytest.raises(plenocal.InputError, match="frame now: 700 x 480 px, but the calibration"):
        plenocal.locate(calibration, target, {"now": np.pad(image, ((0, 0), (0, 60)))})


def test_located_views_are_where_the_calibration_has_them(
    session: plenocal.Session, calibration: plenocal.Calibration
) -> None:
    table = next(pathlib.Path(session.path).parent.glob("detections_*.csv"))
    target = pathlib.Path(calibration.path).parent / "target.yaml"
    located = {view["image"]: view for view in plenocal.locate(calibration, target, table)}
    for pose in calibration.poses:
        found = located[pose["frame"]]
        error = np.array(found["translation"]) - pose["T_target_rig"][:3, 3]
        sigma = np.sqrt(np.diag(found["covariance"])[:3].sum())
        assert np.linalg.norm(error) < 4 * sigma


# Python ignores SIGXFSZ, which would end the process; the module changes no handler.
def test_a_limit_for_the_size_of_files_is_an_exception(
    calibration: plenocal.Calibration, tmp_path: pathlib.Path
) -> None:
    before = signal.getsignal(signal.SIGXFSZ), signal.getsignal(signal.SIGPIPE)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, limits[1]))
    try:
        with pytest.raises(plenocal.JobError, match="c.yaml: cannot be written: File too large"):
            calibration.save(tmp_path / "c.yaml")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert (signal.getsignal(signal.SIGXFSZ), signal.getsignal(signal.SIGPIPE)) == before
    assert list(tmp_path.iterdir()) == []


def test_arguments_out_of_range_are_refused(session: plenocal.Session) -> None:
    with pytest.raises(plenocal.InputError, match="threads: expected a number from 0 to 1024, found -1"):
        plenocal.calibrate(session, threads=-1)
    with pytest.raises(plenocal.InputError, match="require: expected 'good' or 'usable'"):
        plenocal.calibrate(session, require="bad")


def test_messages_are_those_of_the_program(tmp_path: pathlib.Path) -> None:
    with pytest.raises(plenocal.InputError, match="missing.yaml"):
        plenocal.calibrate(tmp_path / "missing.yaml")
    with pytest.raises(plenocal.InputError, match="unknown command 'calibrat'; did you mean 'calibrate'?"):
        plenocal.run(["calibrat"])
    with pytest.raises(plenocal.InputError, match="unknown option"):
        plenocal.run(["calibrate", "x.yaml", "--outt", "y"])
    broken = tmp_path / "session.yaml"
    broken.write_text("plenocal: 1\ncameras: 3\n")
    with pytest.raises(plenocal.InputError, match=r"session\.yaml:1:1: target: this key is missing"):
        plenocal.Session(broken)
    assert "plenocal" in plenocal.run(["--help"])


def test_an_exception_in_a_callback_stops_the_command(
    session: plenocal.Session, tmp_path: pathlib.Path
) -> None:
    def fail(stage: str) -> None:
        raise ZeroDivisionError(stage)

    out = tmp_path / "out"
    with pytest.raises(ZeroDivisionError):
        plenocal.calibrate(session, out, progress=fail)
    assert not (out / "calibration.yaml").exists()

    # A callback may start another run.
    models: list[str] = []
    plenocal.calibrate(session, progress=lambda stage: models.append(plenocal.run(["models"])) if not models else None)
    assert "pinhole" in models[0]


def test_ctrl_c_stops_a_command(session: plenocal.Session, tmp_path: pathlib.Path) -> None:
    pressed: list[str] = []

    def press(stage: str) -> None:
        if not pressed:
            os.kill(os.getpid(), signal.SIGINT)
        pressed.append(stage)

    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        plenocal.calibrate(session, out, progress=press)
    assert not (out / "calibration.yaml").exists()
    # Then Python's own handler is back.
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)
        signal.sigtimedwait([], 1)


@pytest.mark.skipif(not PROGRAM, reason="PLENOCAL_PROGRAM names no program")
def test_two_threads_calibrate_two_sets_at_once_as_the_program_one_after_the_other(
    session: plenocal.Session, tmp_path: pathlib.Path
) -> None:
    other = plenocal.simulate(_specification(tmp_path, seed=8), tmp_path / "other", points=True)
    sets = {"a": session, "b": other}
    running: list[str] = []
    together: list[bool] = []

    def work(name: str) -> None:
        def progress(stage: str) -> None:
            if name not in running:
                running.append(name)
            together.append(len(running) == 2)

        plenocal.calibrate(sets[name], tmp_path / "out" / name, progress=progress)
        running.remove(name)

    # The program, one set after the other.
    for name, each in sets.items():
        subprocess.run(
            [PROGRAM, "calibrate", each.path, "-o", tmp_path / "out" / name], check=True, capture_output=True
        )
    (tmp_path / "out").rename(tmp_path / "program")

    threads = [threading.Thread(target=work, args=(name,)) for name in sets]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert any(together)
    for name in sets:
        found, expected = (tmp_path / how / name for how in ("out", "program"))
        names = sorted(p.name for p in expected.iterdir() if p.is_file())
        assert {"calibration.yaml", "poses.csv", "residuals.csv", "correlations.csv", "target.yaml"} <= set(names)
        _, mismatch, errors = filecmp.cmpfiles(found, expected, names, shallow=False)
        assert not mismatch and not errors


def test_a_run_is_stopped_alone(session: plenocal.Session) -> None:
    results: list[object] = []

    def fail(stage: str) -> None:
        raise ZeroDivisionError(stage)

    def work(progress: Callable[[str], None] | None) -> None:
        try:
            results.append(plenocal.calibrate(session, progress=progress))
        except ZeroDivisionError as error:
            results.append(error)

    threads = [threading.Thread(target=work, args=(progress,)) for progress in (fail, None)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(type(result).__name__ for result in results) == ["Calibration", "ZeroDivisionError"]


def test_calibrates_in_memory_as_from_files(
    session: plenocal.Session, calibration: plenocal.Calibration, tmp_path: pathlib.Path
) -> None:
    before = set(tmp_path.iterdir())
    found = plenocal.calibrate(session)
    assert set(tmp_path.iterdir()) == before
    np.testing.assert_allclose(found[0].params, calibration[0].params, rtol=1e-12)
    assert found.verdict == calibration.verdict
    assert len(found.residuals()) == len(calibration.residuals())
    found.report(tmp_path / "report.html")
    assert (tmp_path / "report.html").read_text().startswith("<!doctype html>")


def test_calibrates_from_arrays_of_images(tmp_path: pathlib.Path) -> None:
    pillow = pytest.importorskip("PIL.Image")
    small = _specification(tmp_path, seed=3)
    text = small.read_text().replace("[1280, 960]", "[640, 480]").replace("frames: 12", "frames: 8")
    small.write_text(re.sub(r"f_x: .* c_y: \d+", "f_x: 450, f_y: 451, c_x: 318, c_y: 241", text))
    made = plenocal.simulate(small, tmp_path / "images")
    files = sorted((tmp_path / "images").glob("**/*.png"))
    of_files = plenocal.calibrate(images=files, target=made.target, model="pinhole-radtan", report=False)
    arrays = [np.asarray(pillow.open(file)) for file in files]
    wide = np.zeros((arrays[0].shape[0], arrays[0].shape[1] + 7, *arrays[0].shape[2:]), arrays[0].dtype)
    wide[:, :-7] = arrays[0]  # rows with a gap between them
    arrays[0] = wide[:, :-7]
    of_arrays = plenocal.calibrate(images=arrays, target=made.target, model="pinhole-radtan")
    np.testing.assert_allclose(of_arrays[0].params, of_files[0].params, rtol=1e-12)
    by_columns = [np.asfortranarray(array) for array in arrays]  # need copies
    of_copies = plenocal.calibrate(images=by_columns, target=made.target, model="pinhole-radtan")
    np.testing.assert_allclose(of_copies[0].params, of_files[0].params, rtol=1e-12)
    with pytest.raises(plenocal.InputError, match="cam: frame 0001: expected .* found float64"):
        plenocal.calibrate(images=[arrays[0], arrays[1].astype(float)], target=made.target)


def test_points_in_memory_need_no_folder(session: plenocal.Session) -> None:
    table = plenocal.calibrate(session).residuals()
    points = {
        frame: np.array([(r["marker"], r["x"], r["y"]) for r in table[table["frame"] == frame]],
                        dtype=[("marker", int), ("x", float), ("y", float)])
        for frame in np.unique(table["frame"])
    }
    camera = {"model": "pinhole-radtan", "image_size": (640, 480), "points": points}
    found = plenocal.calibrate(plenocal.Session.from_points(None, session.target, {"left": camera}))
    assert found["left"].fit["points"] == len(table)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"image_size": (0, 0)}, r"left: image_size: expected width and height in pixels, found \(0, 0\)"),
        ({"image_size": (640, 480, 3)}, "left: image_size"),
        ({"marker": 0.5}, "left: a: marker: expected whole numbers from 0 on"),
        ({"marker": float("nan")}, "left: a: marker: expected whole numbers"),
        ({"marker": 2**32 + 1}, "left: a: marker: expected whole numbers"),
        ({"marker": -1}, "left: a: marker: expected whole numbers"),
        ({"model": None}, "left: has no 'model'"),
    ],
)
def test_points_that_are_none_are_refused(change: dict[str, Any], message: str) -> None:
    points = np.array([(change.pop("marker", 3), 10, 20)], dtype=[("marker", float), ("x", float), ("y", float)])
    camera = {"model": "pinhole", "image_size": (640, 480), "points": {"a": points}, **change}
    if camera["model"] is None:
        del camera["model"]
    with pytest.raises(plenocal.InputError, match=message):
        plenocal.Session.from_points(None, "chessboard:9x6:25mm", {"left": camera})


def test_names_that_look_like_numbers_stay_text(session: plenocal.Session) -> None:
    table = plenocal.calibrate(session).residuals()
    points = {frame: table[table["frame"] == frame][["marker", "x", "y"]] for frame in np.unique(table["frame"])}
    camera = {"model": "pinhole-radtan", "image_size": (640, 480), "points": points}
    found = plenocal.calibrate(plenocal.Session.from_points(None, session.target, {"0": camera}))
    assert {row["camera"] for row in plenocal.compare(found, found)} == {"0"}


def test_the_package_is_a_program() -> None:
    version = subprocess.run(
        [sys.executable, "-m", "plenocal", "--version"], check=True, capture_output=True, text=True
    )
    assert plenocal.__version__ in version.stdout
    wrong = subprocess.run(
        [sys.executable, "-m", "plenocal", "calibrat"], capture_output=True, text=True
    )
    assert wrong.returncode == 2 and "unknown command" in wrong.stderr


def test_import_does_not_load_numpy() -> None:
    code = "import sys, plenocal; sys.exit('numpy' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_transforms_json_has_the_poses_of_the_images(
    calibration: plenocal.Calibration, tmp_path: pathlib.Path
) -> None:
    calibration.export(tmp_path / "transforms.json", "nerfstudio")
    content = json.loads((tmp_path / "transforms.json").read_text())
    poses = calibration.poses
    assert [f["file_path"] for f in content["frames"]] == [
        f"images/{frame}.png" for frame in poses["frame"]
    ]
    # The points of the target fall where the calibration has seen them, by OpenGL's axes.
    positions = {row["marker"]: row["position"] for row in calibration.markers}
    residuals = calibration.residuals()
    for frame in content["frames"][:3]:
        world_from_camera = np.array(frame["transform_matrix"])
        seen = residuals[residuals["frame"] == pathlib.Path(frame["file_path"]).stem]
        p = np.array([[*positions[marker], 1] for marker in seen["marker"]])
        x, y, z, _ = np.linalg.inv(world_from_camera) @ p.T
        x, y = x / -z, y / z
        r2 = x * x + y * y
        radial = 1 + r2 * (content["k1"] + r2 * (content["k2"] + r2 * content["k3"]))
        u = content["fl_x"] * x * radial + content["cx"] - 0.5
        v = content["fl_y"] * y * radial + content["cy"] - 0.5
        np.testing.assert_allclose(u, seen["x"] - seen["residual_x"], atol=1e-3)
        np.testing.assert_allclose(v, seen["y"] - seen["residual_y"], atol=1e-3)

# SPDX-License-Identifier: Apache-2.0
"""White, plenoptic, rectified and undistorted images."""

from __future__ import annotations

import pathlib

import numpy as np
import pytest

import plenocal

from conftest import CHESSBOARDS, ROOT

SPECIFICATION = """
plenocal: 1
seed: 7
target: target.yaml
poses: {kind: varied, frames: 1, distance: [0.36, 0.5], aim: plenoptic}
white_images: 2
cameras:
  plenoptic:
    model: focused-plenoptic
    image_size: [240, 240]
    pixel_size: 7.4e-6
    parameters: {f_L: 0.0122, b_L0: 0.01166, B: 0.00026, c_x: 122, c_y: 117, A_0: -210, A_1: 1.2e6, B_0: 0.03, B_1: -0.02}
    blur: 0.35
    micro_lenses: {pitch: 19, rotation: 0.006, focus: [2.4, 3.0, 3.9], aperture: 0.7}
"""


@pytest.fixture(scope="module")
def plenoptic(tmp_path_factory: pytest.TempPathFactory) -> plenocal.Session:
    """A raw image and two white ones."""
    folder = tmp_path_factory.mktemp("plenoptic")
    (folder / "target.yaml").write_text((ROOT / "examples/simulate/target.yaml").read_text())
    (folder / "spec.yaml").write_text(SPECIFICATION)
    return plenocal.simulate(folder / "spec.yaml", folder / "set")


def test_an_array_is_one_image_in_grey_or_colours() -> None:
    for shape in ((4, 5), (4, 5, 3)):
        ((name, frames),) = plenocal.arrays.images_in_memory(np.zeros(shape, np.uint8))
        assert name == "cam" and [pixels.shape for _, pixels in frames] == [shape]
    assert len(plenocal.arrays.images_in_memory(np.zeros((7, 4, 5), np.uint8))[0][1]) == 7


def test_white_images_give_grid_attenuation_and_noise(plenoptic: plenocal.Session, tmp_path: pathlib.Path) -> None:
    (found,) = plenocal.white(plenoptic)
    assert found.camera == "plenoptic" and "hexagonal lattice" in found.summary
    assert found.attenuation.shape == (240, 240) and found.attenuation.dtype == np.float32
    assert 0 <= found.attenuation.min() < found.attenuation.max() <= 1.01
    assert found.micro_lenses is not None and found.noise is not None
    assert len(found.micro_lenses) > 100 and found.micro_lenses["usable"].dtype == bool
    assert set(found.micro_lenses["type"]) == {0, 1, 2}
    raw = pathlib.Path(plenoptic.path).parent / "plenoptic_white"
    (again,) = plenocal.white(raw, tmp_path / "out", model="focused-plenoptic", camera="plenoptic")
    np.testing.assert_array_equal(again.attenuation, found.attenuation)
    assert (tmp_path / "out/micro_lenses_plenoptic.csv").exists()
    with pytest.raises(plenocal.InputError, match="bayer: expected RGGB"):
        plenocal.white(raw, model="focused-plenoptic", bayer="RGB")


def test_a_raw_image_is_focused_in_memory_or_into_a_folder(
    plenoptic: plenocal.Session, tmp_path: pathlib.Path
) -> None:
    raw, white = (pathlib.Path(plenoptic.path).parent / name for name in ("plenoptic", "plenoptic_white"))
    (found,) = plenocal.focus(raw, white=white)
    assert found.image.shape == found.depth.shape == found.depth_sigma.shape
    assert found.image.dtype == np.uint8 and found.depth.dtype == np.float32
    assert 2 < np.nanmedian(found.depth) < 5
    (written,) = plenocal.focus(raw, tmp_path / "out", white=white)
    assert written.image is None and written.summary == found.summary
    assert (tmp_path / "out/virtual_depth.tiff").exists()
    with pytest.raises(plenocal.InputError, match="scale: expected a number from 0.5 to 16, found 0.1"):
        plenocal.focus(raw, white=white, scale=0.1)


def test_stereo_images_are_rectified_and_undistorted(tmp_path: pathlib.Path) -> None:
    out = tmp_path / "out"
    calibration = plenocal.calibrate(
        images={"left": CHESSBOARDS / "left*.jpg", "right": CHESSBOARDS / "right*.jpg"},
        target="chessboard:9x6:25mm",
        model="pinhole-radtan4",
        out=out,
        report=False,
    )
    assert [camera.name for camera in calibration] == ["left", "right"]
    pair = plenocal.rectify(calibration, CHESSBOARDS / "left*.jpg", CHESSBOARDS / "right*.jpg", tmp_path / "pairs")
    assert pair.images == (13, 13) and pair.epipolar["rms"] < 0.5
    assert pair.baseline == pytest.approx(-calibration["right"].T_camera_rig[0, 3], abs=2e-3)
    assert len(list((tmp_path / "pairs/left").glob("*.png"))) == 13
    view, count = plenocal.undistort(calibration, CHESSBOARDS / "left01.jpg", tmp_path / "flat", camera="left")
    assert view.model == "pinhole" and count == 1
    # The calibration's own folder keeps its calibration.yaml, from a path or from what was read before.
    for given in (calibration, out):
        with pytest.raises(plenocal.InputError, match="the results would replace this input"):
            plenocal.undistort(given, CHESSBOARDS / "left01.jpg", out, camera="left")
    with pytest.raises(plenocal.InputError, match="interpolation: expected one of linear"):
        plenocal.undistort(calibration, CHESSBOARDS / "left01.jpg", tmp_path / "flat", camera="left", interpolation="x")
    with pytest.raises(plenocal.InputError, match="balance: expected a number from 0 to 1, found 2"):
        plenocal.undistort_maps(calibration[0], balance=2)
    with pytest.raises(plenocal.InputError, match="balance: goes without fov"):
        plenocal.undistort_maps(calibration[0], fov=60, balance=0)

#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""PNG folders, MCAP files, bags, databases of ROS 2 and videos of the same images give the same calibration bit for bit.

    python3 -m venv V && V/bin/pip install mcap mcap-ros2-support rosbags opencv-python-headless pyyaml
    V/bin/python bench/data/sources.py [build/release/apps/plenocal]

Writes the stereo pairs of tests/data as recordings of every kind (write_recordings.py), calibrates each by the command of
docs/guide.md and compares parameters, standard errors and extrinsics with those of the PNG files. Exit status 1: one differs.
"""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common

IMAGES = common.ROOT / "tests/data/frames/stereo_chess_opencv"
MESSAGES = ["plain.mcap", "lz4.mcap", "zstd.mcap", "png.mcap", "ros2.mcap", "ros2_mcap", "db3", "db3/db3.db3", "db3_packed",
            "plain.bag", "lz4.bag", "bz2.bag"]


def calibrate(program, left, right, out):
    common.run(program, "calibrate", left, "--right", right, "--target", "chessboard:9x6:25mm", "--model", "pinhole-radtan", "-o", out)
    result = common.load(out / "calibration.yaml")
    return {name: {key: camera.get(key) for key in ("parameters", "sigma", "T_camera_rig", "xi_camera_rig", "noise", "fit")}
            for name, camera in result["cameras"].items()}


def main():
    import cv2
    parser = common.parser(__doc__, plenocal=None)
    parser.add_argument("program", type=common.program, nargs="?", default=str(common.BUILD / "apps/plenocal"))
    program = parser.parse_args().program
    with common.folder() as work:
        for camera in ("left", "right"):
            (work / "png" / camera).mkdir(parents=True)
            for file in sorted(IMAGES.glob(f"{camera}[0-9]*.jpg")):
                image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
                cv2.imwrite(str(work / "png" / camera / f"{file.stem[len(camera):]}.png"), image)
        common.run(sys.executable, pathlib.Path(__file__).with_name("write_recordings.py"), work / "png", work / "recorded")
        recorded = work / "recorded"
        expected = calibrate(program, f"{work}/png/left/*.png", f"{work}/png/right/*.png", work / "out")
        differ = False
        for name in MESSAGES:
            path = recorded / name
            same = calibrate(program, path / "left/image_raw", path / "right/image_raw", work / "out") == expected
            differ |= not same
            print(f"{name:12} {'the same, bit for bit' if same else 'DIFFERS'}")
        video = calibrate(program, recorded / "left.avi", recorded / "right.avi", work / "out")
        change = max(abs(video[c]["parameters"][p] - value) for c in expected for p, value in expected[c]["parameters"].items())
        print(f"{'left.avi':12} {'the same, bit for bit' if video == expected else f'largest change of a parameter {change:.3g}'} (FFV1)")
    return 1 if differ else 0


if __name__ == "__main__":
    sys.exit(main())

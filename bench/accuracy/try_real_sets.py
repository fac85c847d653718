#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""`plenocal try` on the optional real sets (docs/data.md), beside OpenCV's calibrations in their reference_opencv.json.

    export PLENOCAL_DATA=...   # folder of the sets
    bench/accuracy/try_real_sets.py --program build/release/apps/plenocal     # the last section of docs/data.md
    bench/accuracy/try_real_sets.py --frames 4 --only fisheye      # what is recommended by so few images

Targets are held as they are published, as the references do; without a size one square counts as 30 mm.
"""
import json
import os
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from common import save

FRAMES = pathlib.Path(os.environ.get("PLENOCAL_DATA", "$PLENOCAL_DATA")).absolute() / "frames"


def chessboard(columns, rows, square=0.03):
    return {"type": "chessboard", "columns": columns, "rows": rows, "square": square}


def lifecam(legacy=False):
    return {"type": "charuco", "columns": 8, "rows": 8, "square": 0.0254, "marker": 0.01905,
            "dictionary": "DICT_4X4_1000", **({"legacy": True} if legacy else {})}


APRILGRID = {"type": "aprilgrid", "columns": 6, "rows": 6, "size": 0.088, "spacing": 0.3, "border_bits": 2}

# folder, images, target, where reference_opencv.json has the reference's RMS, which model that is, lens
SETS = [
    ("aprilgrid_d435i_mocap", "cam0/data/*.jpg", APRILGRID, "shipped_corners_csv.pinhole_5_all", "pinhole-radtan", "normal"),
    ("aprilgrid_tag36h11_phone4", "*.jpg", {**APRILGRID, "size": 0.022}, "pinhole_5.result", "pinhole-radtan", "normal"),
    ("charuco_lifecam", "2024-05-07_lifecam_1280/*", lifecam(), "2024-05-07_lifecam_1280.pinhole_5", "pinhole-radtan", "normal"),
    ("charuco_lifecam", "2024-05-07_lifecam_480/*", lifecam(), "2024-05-07_lifecam_480.pinhole_5", "pinhole-radtan", "normal"),
    ("charuco_lifecam", "2024-06-19_lifecam_1280_Old_Pattern/*", lifecam(True),
     "2024-06-19_lifecam_1280_Old_Pattern.pinhole_5", "pinhole-radtan", "normal"),
    ("circles_visp", "*.jpg", {"type": "circles", "columns": 6, "rows": 6, "spacing": 0.034, "pattern": "symmetric"},
     "circles.pinhole_5", "pinhole-radtan", "normal"),
    ("mono_fisheye_camodocal", "img*.png", chessboard(9, 6), "classic_plus_subpix_fisheye_KB4", "kannala-brandt4", "fisheye"),
    ("mono_fisheye_ocamcalib", "fisheye1/*.jpg", chessboard(8, 6), "fisheye1.fisheye_KB4", "kannala-brandt4", "fisheye"),
    ("mono_fisheye_ocamcalib", "fisheye2/*.jpg", chessboard(8, 6), "fisheye2.fisheye_KB4", "kannala-brandt4", "fisheye"),
    ("stereo_fisheye_ros", "left*.png", chessboard(8, 6), "left.fisheye_KB4", "kannala-brandt4", "fisheye"),
    ("stereo_fisheye_ros", "right*.png", chessboard(8, 6), "right.fisheye_KB4", "kannala-brandt4", "fisheye"),
    ("stereo_chess_anamorphic_drobotics", "left*.png", chessboard(11, 8, 0.1), "left.pinhole_rational_8", "pinhole-radtan8", "wide"),
    ("stereo_chess_anamorphic_drobotics", "right*.png", chessboard(11, 8, 0.1), "right.pinhole_rational_8", "pinhole-radtan8", "wide"),
    ("stereo_chess_opencv", "left*.jpg", chessboard(9, 6), "left.pinhole_5", "pinhole-radtan", "normal"),
    ("stereo_chess_opencv", "right*.jpg", chessboard(9, 6), "right.pinhole_5", "pinhole-radtan", "normal"),
]


HEAD = """## Which model describes the real cameras

`PLENOCAL_DATA=... bench/accuracy/try_real_sets.py` prints this section: `plenocal try` over all models, without initial guess, with
the published target fixed. RMS in px, of the residuals' length, held out (in sample). The reference is OpenCV's
calibration (`reference_opencv.json`), in sample over all points that its detector found, with its model in brackets.
`calibrate` with `model: auto` takes the recommended model unless another is named. 90 %: standard error of the projection that
nine tenths of the image keep, px. Runners-up: the next two in held-out RMS, their projection's difference from the best
where the image has points, and their own 90 %, px.
"""
REMARKS = """
- No fisheye gets a pinhole without distortion, not even from four images (`--frames 4`). A rational pinhole
  (`pinhole-radtan8`) describes a fisheye only where the target stays near the middle of the image.
- Four and five images (`aprilgrid_tag36h11_phone4`, `circles_visp`) are too few to choose a model; `try` prints so.
- Most of the other flat boards are found bent. Refined, they predict held-out frames better (`stereo_chess_opencv`:
  0.07 to 0.09 px in place of 0.16 px). Compare models with the target refined."""


def ovcube(folder):
    """The five-board set: the corners of all its views, published with it (its tags are of another family)."""
    markers, text = {}, "frame,marker,x,y\n"
    for part in ("train", "test"):
        for line in (FRAMES / f"fisheye_3plane_ovcube/corners_{part}.csv").read_text().splitlines():
            if line.startswith("#") or not line[:1].isdigit():
                continue
            cells = line.split(",")
            place = tuple(round(0.01 * float(cell), 9) for cell in cells[2:5])  # 0.01 m a unit
            number = markers.setdefault(place, len(markers))
            text += f"{part}{cells[0]},{number},{cells[5]},{cells[6]}\n"
    (folder / "points.csv").write_text(text)
    target = {"type": "markers", "markers": {number: list(place) for place, number in markers.items()}}
    camera = {"detections": "points.csv", "image_size": [1280, 800]}
    return target, camera


def attempt(program, folder, target, camera, threads):
    save(folder / "target.yaml", target)
    save(folder / "session.yaml", {"target": "target.yaml", "cameras": {"camera": {"model": "auto", **camera}},
                                   "options": {"refine_target": False}})
    try:
        done = common.run(program, "try", folder / "session.yaml", "-o", folder / "out", *threads)
    except common.Failed as failure:
        return None, str(failure).splitlines()[-1]
    print(done.stdout, file=sys.stderr, flush=True)
    taken = common.calibrate(program, folder / "session.yaml", folder / "auto", *threads)["cameras"]["camera"]["model"]
    return {**common.load(folder / "out/try.yaml"), "auto": taken}, None


def evenly(images, count, folder):
    """A pattern for `count` images, spread evenly over those of the pattern `images`."""
    files = sorted(images.parent.glob(images.name))
    (folder / "few").mkdir()
    for i in range(min(count, len(files))):
        file = files[i * len(files) // count]
        (folder / "few" / file.name).symlink_to(file)
    return folder / "few/*"


def reference(name, path):
    value = json.loads((FRAMES / name / "reference_opencv.json").read_text())
    for key in path.split("."):
        value = value[key]
    return value["rms_px"]


def figures(result, model):
    """'held-out (in sample)' of one model."""
    row = result["models"].get(model, {})
    if "failure" in row:
        return "fails"
    held_out = f"{row['held_out']['rms']:.3f}" if "held_out" in row else "misses points"
    return f"{held_out} ({row['in_sample_rms']:.3f})"


def runners_up(result):
    """The two next models: name, difference and 90 % of the image, px."""
    rows = [(row["held_out"]["rms"], name, row) for name, row in result["models"].items()
            if "held_out" in row and name != result["recommended"]]
    return ", ".join(f"{name} {row['difference']:.2f}, {row['projection']:.2g}" for _, name, row in sorted(rows, key=lambda r: r[0])[:2])


def main():
    parser = common.parser(__doc__)
    parser.add_argument("--only", default="", help="sets whose name holds this")
    parser.add_argument("--frames", default=0, type=int, help="so many images of each set (default: all)")
    parser.add_argument("--threads", default=0, type=int, help="of plenocal (default: all cores)")
    options = parser.parse_args()
    if not FRAMES.is_dir():
        sys.exit(f"no folder {FRAMES}: set PLENOCAL_DATA to the folder of the optional data sets (docs/data.md)")
    threads = ["--threads", options.threads] if options.threads else []

    print(HEAD)
    common.head("set", "images", "lens", "recommended", "held out (in sample)", "reference's model", "reference", "90 %", "runners-up")
    sets = list(SETS) + [("fisheye_3plane_ovcube", None, None, "KB4_rigid_multi_plane", "kannala-brandt4", "fisheye, 190 degrees")]
    for name, images, target, path, model, lens in sets:
        if options.only not in name:
            continue
        with common.folder() as folder:
            if images is None:
                target, camera = ovcube(folder)
                figure = json.loads((FRAMES / name / "reference_opencv.json").read_text())[path]
                quoted = f"{figure['train_rms_px']:.3f} ({model}; held out {figure['test_rms_px']:.3f})"
            else:
                pattern = FRAMES / name / images
                camera = {"images": str(evenly(pattern, options.frames, folder) if options.frames else pattern)}
                quoted = f"{reference(name, path):.3f} ({model})"
            result, failure = attempt(options.program, folder, target, camera, threads)
        if failure:
            common.row(name, images or "", lens, failure, "", "", quoted, "", "")
            continue
        best = result["recommended"]
        taken = best if result["auto"] == best else f"{best} (auto: {result['auto']})"
        common.row(name, images or "points", lens, taken, figures(result, best), figures(result, model), quoted,
                   f"{result['models'][best]['projection']:.2g}", runners_up(result))
    print(REMARKS)


if __name__ == "__main__":
    main()

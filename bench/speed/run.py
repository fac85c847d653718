#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Builds the preset dev and measures Plenocal against OpenCV, mrcal and libapriltag in one run.

    bench/run            # a few minutes; tables on standard output
    bench/run --all      # OpenCV on 1000 frames as well: many minutes a repetition

Needs python3-mrcal and python3-opencv. Machines differ: quote ratios of one run.
"""
import pathlib
import shutil
import signal
import statistics
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import common
from common import ROOT


def run(programs, *command):
    """(standard output, wall s, CPU s of user and system, peak memory in MB) of a command."""
    output, usage = common.run(programs / "bench/measure", *command).stdout.rstrip().rsplit("\n", 1)
    wall, cpu, kilobytes = (float(word) for word in usage.split())
    return output, wall, cpu, kilobytes / 1024


def table(header, rows):
    common.head(*header)
    for row in rows:
        common.row(*row)
    print()


def number(value, digits=3):
    return "-" if value is None else f"{value:.{digits}f}"


def ratio(a, b, digits=2):
    return "-" if a is None or b is None else f"{a / b:.{digits}f}"


def rms_of(result):
    """RMS of all of Plenocal's cameras, from residuals.csv."""
    return statistics.fmean(float(row["dx"])**2 + float(row["dy"])**2
                            for row in common.read_table(result / "residuals.csv") if row["used"] == "1")**0.5


def solves(programs, temp, options):
    sizes = [(cameras, frames) for cameras in (1, 2) for frames in options.frames]
    folders, samples, rms = {}, {size: {} for size in sizes}, {}
    for size in sizes:
        folders[size] = temp / "{}x{}".format(*size)
        folders[size].mkdir()
        run(programs, programs / "bench/make_problem", *size, options.markers, folders[size])

    def add(size, **values):
        for key, value in values.items():
            samples[size].setdefault(key, []).append(value)

    for _ in range(options.repeat):
        for size in sizes:
            folder = folders[size]
            result = folder / "out"
            _, wall, cpu, memory = run(programs, programs / "apps/plenocal", "calibrate",
                                       folder / "session.yaml", "-o", result, "--quiet")
            add(size, plenocal=cpu, plenocal_wall=wall, plenocal_memory=memory)
            rms.setdefault((size, "plenocal"), rms_of(result))
            output, _, _, memory = run(programs, "/usr/bin/python3", pathlib.Path(__file__).resolve().with_name("mrcal_solve.py"), folder)
            total, last, rms[size, "mrcal"] = (float(word) for word in output.split())
            add(size, mrcal=total, mrcal_last=last, mrcal_memory=memory)
            if size[1] < 1000 or options.all:
                output, _, _, memory = run(programs, programs / "bench/opencv_solve", folder)
                cpu, rms[size, "opencv"] = (float(word) for word in output.split())
                add(size, opencv=cpu, opencv_memory=memory)

    median = {size: {key: statistics.median(values) for key, values in samples[size].items()}
              for size in sizes}
    print(f"\n## Solves: 70 markers ({options.markers}), 0.2 px noise, "
          f"median of {options.repeat}\n")
    print("CPU s: the whole `plenocal calibrate` process with free markers and all sigmas; OpenCV's and "
          "mrcal's solve alone\n(mrcal: all stages of mrcal-calibrate-cameras; last: only its final "
          "stage, board warp and outliers).\n")
    rows = []
    for size in sizes:
        value = median[size].get
        rows.append([f"{size[0]}", f"{size[1]}",
                     number(value("plenocal")), number(value("plenocal_wall")),
                     number(value("opencv")), number(value("mrcal")), number(value("mrcal_last")),
                     ratio(value("plenocal"), value("opencv")),
                     ratio(value("plenocal"), value("mrcal")),
                     ratio(value("plenocal"), value("mrcal_last"))])
    table(["cameras", "frames", "plenocal", "plenocal wall", "OpenCV", "mrcal", "mrcal last",
           "plenocal / OpenCV", "plenocal / mrcal", "plenocal / mrcal last"], rows)

    print("Peak memory of the whole process, MB, and RMS of the points used, px.\n")
    rows = []
    for size in sizes:
        value = median[size].get
        rows.append([f"{size[0]}", f"{size[1]}",
                     *(number(value(f"{name}_memory"), 0) for name in ("plenocal", "opencv", "mrcal")),
                     ratio(value("plenocal_memory"), value("opencv_memory")),
                     ratio(value("plenocal_memory"), value("mrcal_memory")),
                     *(number(rms.get((size, name))) for name in ("plenocal", "opencv", "mrcal"))])
    table(["cameras", "frames", "plenocal", "OpenCV", "mrcal", "plenocal / OpenCV",
           "plenocal / mrcal", "RMS plenocal", "RMS OpenCV", "RMS mrcal"], rows)

    growths = [(few, 10 * few) for few in options.frames if 10 * few in options.frames]
    if growths:
        print("Ten times the frames take so many times the CPU time.\n")
        table(["cameras", "frames", "plenocal", "mrcal", "OpenCV"],
              [[f"{cameras}", f"{many} / {few}",
                *(ratio(median[cameras, many].get(name), median[cameras, few].get(name), 1)
                  for name in ("plenocal", "mrcal", "opencv"))]
               for cameras in (1, 2) for few, many in growths])


def images(programs, temp, options):
    folder = temp / "images"
    folder.mkdir()
    run(programs, programs / "bench/render_tags", options.pairs, folder)
    files = sorted(folder.glob("*/*.png"))
    samples, tags = [], 0
    for _ in range(options.repeat):
        output, _, _, memory = run(programs, programs / "bench/apriltag_detect", *files)
        wall, cpu, tags = output.split()
        samples.append([float(wall), float(cpu), memory,
                        *run(programs, programs / "apps/plenocal", "calibrate", folder / "session.yaml", "-o",
                             folder / "out", "--quiet", "--fresh")[1:]])
    reference_wall, reference_cpu, reference_memory, wall, cpu, memory = (
        statistics.median(column) for column in zip(*samples))
    points = (folder / "out/residuals.csv").read_text().count("\n") - 1
    print(f"## Images: {options.pairs} stereo pairs of 1280 x 1024, 54 tags, "
          f"median of {options.repeat}\n")
    print("libapriltag: reading and decimate 2, images in parallel, without start-up; plenocal: the "
          f"whole `calibrate` process.\nCorners: libapriltag {4 * int(tags)}, plenocal {points} "
          f"of {len(files) * 216}; plenocal's RMS {rms_of(folder / 'out'):.3f} px.\n")
    table(["", "libapriltag", "plenocal", "ratio"],
          [["wall s", number(reference_wall), number(wall), ratio(wall, reference_wall)],
           ["CPU s", number(reference_cpu), number(cpu), ratio(cpu, reference_cpu)],
           ["peak MB", number(reference_memory, 0), number(memory, 0),
            ratio(memory, reference_memory)]])


BOARD = "plenocal: 1\ntype: chessboard\ncolumns: {}\nrows: {}\nsquare: {}\n"
CAMERA = """  {}:
    model: pinhole-radtan
    image_size: [1280, 1024]
    parameters: {{f_x: 1000, f_y: 1000, c_x: 640, c_y: 512, k_1: -0.2, k_2: 0.05, p_1: 0.0005, p_2: -0.0003}}
    xi_camera_rig: [{}, 0, 0, 0, 0, 0]
    detection_sigma: 0.2
"""
LARGE_CAMERA = """  left:
    model: pinhole-radtan
    image_size: [4000, 3000]
    parameters: {f_x: 3100, f_y: 3100, c_x: 2000, c_y: 1500, k_1: -0.2, k_2: 0.05, p_1: 0.0005, p_2: -0.0003}
"""
PLENOPTIC = """plenocal: 1
seed: 7
target: {target}
poses: {{frames: 1, distance: [0.36, 0.7], aim: plenoptic}}
white_images: 10
cameras:
  plenoptic:
    model: focused-plenoptic
    image_size: [2048, 2048]
    pixel_size: 5.5e-6
    parameters: {{f_L: 0.0162, b_L0: 0.0156, B: 0.00036, c_x: 1026, c_y: 1017, A_0: -110, A_1: 1.0e5, B_0: 0.03, B_1: -0.02}}
    micro_lenses: {{pitch: 21, rotation: 0.006, focus: [2.4, 3.0, 3.9], aperture: 0.7, fill: 0.92}}
"""
# Reads images and finds the corners; prints found images and CPU seconds: all, median and most of an image.
OPENCV_CORNERS = """
import statistics, sys, time, cv2
find, found, seconds = getattr(cv2, sys.argv[1]), 0, []
for name in sys.argv[2:]:
    begin = time.process_time()
    image = cv2.imread(name, cv2.IMREAD_GRAYSCALE)
    ok, corners = find(image, (10, 7))
    if ok and sys.argv[1] == "findChessboardCorners":
        cv2.cornerSubPix(image, corners, (5, 5), (-1, -1), (3, 30, 1e-3))
    found += ok
    seconds.append(time.process_time() - begin)
print(found, sum(seconds), statistics.median(seconds), max(seconds))
"""


def simulate(programs, folder, spec, *options):
    folder.mkdir()
    for name, text in spec.items():
        (folder / name).write_text(text)
    run(programs, programs / "apps/plenocal", "simulate", folder / "spec.yaml", "-o", folder, "--quiet", *options)


def boards(programs, temp, options):
    """Chessboards from images, beside both of OpenCV's detectors."""
    folder = temp / "boards"
    spec = f"plenocal: 1\nseed: 3\ntarget: board.yaml\nposes: {{frames: 24, distance: [0.5, 0.9]}}\ncameras:\n{CAMERA.format('left', 0)}"
    simulate(programs, folder, {"spec.yaml": spec, "board.yaml": BOARD.format(10, 7, 0.03)})
    shutil.rmtree(folder / "left_white")
    session = (folder / "session.yaml").read_text()
    (folder / "session.yaml").write_text("".join(line for line in session.splitlines(True) if "white" not in line))
    files = sorted((folder / "left").glob("*.png"))
    rows = []
    for name in ("plenocal", "findChessboardCornersSB", "findChessboardCorners"):
        samples, found, median, most = [], None, None, None
        for _ in range(options.repeat):
            if name == "plenocal":
                command = (programs / "apps/plenocal", "detect", folder / "session.yaml", "-o", folder / "out", "--quiet", "--fresh")
                samples.append(run(programs, *command)[2])
                lines = (folder / "out/detections_left.csv").read_text().splitlines()[1:]
                found = len({line.split(",")[0] for line in lines})
            else:
                found, seconds, median, most = run(programs, "/usr/bin/python3", "-c", OPENCV_CORNERS, name, *files)[0].split()
                samples.append(float(seconds))
                median, most = float(median), float(most)
        rows.append([name, number(statistics.median(samples) / len(files)), number(median), number(most), f"{found}"])
    print(f"## Chessboards: {len(files)} images of 1280 x 1024, median of {options.repeat}\n")
    print("CPU s an image: of plenocal the whole `detect` process, of OpenCV reading and finding, `cornerSubPix` included.\n"
          "Some images show the board cut off.\n")
    table(["", "CPU s an image, mean", "median", "most", "found"], rows)


def white(programs, temp, options):
    folder = temp / "white"
    simulate(programs, folder, {"spec.yaml": PLENOPTIC.format(target=ROOT / "examples/simulate/target.yaml")})
    print(f"## Plenoptic images of 2048 x 2048, median of {options.repeat}\n")
    rows = []
    grid = ["--grid", folder / "white/micro_lenses_plenoptic.csv", "--vignetting", folder / "white/vignetting_plenoptic.tiff"]
    for name, command in {"`white`: ten white images": ["white", folder / "session.yaml", "-o", folder / "white"],
                          "`focus`: one raw image": ["focus", folder / "plenoptic", *grid, "-o", folder / "focus"]}.items():
        samples = [run(programs, programs / "apps/plenocal", *command, "--quiet")[1:] for _ in range(options.repeat)]
        wall, cpu, memory = (statistics.median(column) for column in zip(*samples))
        rows.append([name, number(cpu, 2), number(wall, 2), number(memory, 0)])
    table(["", "CPU s", "wall s", "peak MB"], rows)


def floors(programs, temp, options):
    """Images to results, beside what the same images cost at least; the programs take turns."""
    tags, boards, raw = temp / "stereo_tags", temp / "large_boards", temp / "raw"
    tags.mkdir()
    run(programs, programs / "bench/render_tags", options.pairs, tags)
    spec = f"plenocal: 1\nseed: 3\ntarget: board.yaml\nposes: {{frames: 20, distance: [0.5, 0.9]}}\ncameras:\n{LARGE_CAMERA}"
    simulate(programs, boards, {"spec.yaml": spec, "board.yaml": BOARD.format(10, 7, 0.03)})
    run(programs, programs / "bench/read_images", "--jpeg", *(boards / "left").glob("*.png"))
    (boards / "session.yaml").write_text("plenocal: 1\ntarget: target.yaml\ncameras:\n  left: {model: pinhole-radtan, images: left/*.jpg}\n")
    simulate(programs, raw, {"spec.yaml": PLENOPTIC.format(target=ROOT / "examples/simulate/target.yaml")})
    white = sorted((raw / "plenoptic_white").glob("*.png"))

    def calibrate(folder):
        return ["calibrate", folder / "session.yaml", "-o", folder / "out", "--fresh"]

    def read(files):
        return lambda: float(run(programs, programs / "bench/read_images", *files)[0])

    rows = []
    for name, command, other, other_seconds, aim in [
            (f"{options.pairs} stereo pairs of tags: `calibrate`", calibrate(tags), "OpenCV: ArUco, sub-pixel, `stereoCalibrate`",
             lambda: run(programs, programs / "bench/opencv_tags", tags)[2], 0.9),
            ("20 chessboards of 12 megapixels, JPEG: `calibrate`", calibrate(boards), "reading",
             read(sorted((boards / "left").glob("*.jpg"))), 2.5),
            ("4 megapixels, ten white images: `focus`",
             ["focus", *sorted((raw / "plenoptic").glob("*.png")), "--white", *white, "-o", raw / "focus"], "reading",
             read([*(raw / "plenoptic").glob("*.png"), *white]), 4)]:
        samples = [(run(programs, programs / "apps/plenocal", *command, "--quiet")[2], other_seconds()) for _ in range(options.repeat)]
        own, least = (statistics.median(column) for column in zip(*samples))
        rows.append([name, number(own, 2), other, number(least, 2), ratio(own, least), f"{aim}"])
    print(f"## Images to results: CPU s of whole processes beside a floor, median of {options.repeat}\n")
    print("Reading by `cv::imread` without start-up.\n")
    table(["", "CPU s", "floor", "CPU s", "ratio", "aim"], rows)


def large(programs, temp, options):
    print("## Large sets: a stereo pair and a board of 17 x 11 markers, free markers, all sigmas\n")
    rows = []
    for frames in (1000, 5000):
        folder = temp / f"large{frames}"
        spec = (f"plenocal: 1\nseed: 3\ntarget: board.yaml\nposes: {{frames: {frames}, distance: [0.4, 0.9]}}\n"
                f"cameras:\n{CAMERA.format('left', 0)}{CAMERA.format('right', -0.1)}")
        simulate(programs, folder, {"spec.yaml": spec, "board.yaml": BOARD.format(17, 11, 0.02) + "tolerance: 0.0005\n"}, "--points")
        result = folder / "out"
        _, wall, cpu, memory = run(programs, programs / "apps/plenocal", "calibrate", folder / "session.yaml", "-o", result, "--quiet")
        points = sum(1 for _ in open(result / "residuals.csv")) - 1
        rows.append([f"{frames}", f"{points}", number(cpu, 1), number(wall, 1), number(memory, 0)])
    table(["frames", "points", "CPU s", "wall s", "peak MB"], rows)


def focus(programs, temp, options):
    print("## Focus: stages of `plenocal focus` beside cv::StereoSGBM, CPU time\n")
    output = run(programs, programs / "bench/focus_stages")[0]
    print(f"```\n{output.rstrip()}\n```\n", flush=True)


def plenoptic(programs, temp, options):
    print("## Plenoptic camera: 208 markers, markers free, 0.2 px noise, one thread, "
          f"median of {options.repeat}\n")
    rows = []
    for frames in (10, 30, 90):
        samples = []
        for _ in range(options.repeat):
            output = run(programs, programs / "bench/plenoptic_solve", frames)[0]
            samples.append([float(word) for word in output.split()])
        points, whole, iterations, solve = (statistics.median(column) for column in zip(*samples))
        rows.append([f"{frames}", f"{points:.0f}", number(whole, 2), number(1e6 * whole / points, 1),
                     f"{iterations:.0f}", number(solve, 2),
                     number(1e6 * solve / points / iterations, 2)])
    table(["frames", "points", "whole calibration, CPU s", "us a point", "iterations of one solve",
           "CPU s", "us a point and iteration"], rows)


PARTS = [solves, large, images, boards, floors, focus, white, plenoptic]


def main():
    parser = common.parser(__doc__, plenocal=None)
    parser.add_argument("--all", action="store_true", help="OpenCV on 1000 frames as well")
    parser.add_argument("--repeat", type=int, default=5, help="repetitions (default 5)")
    parser.add_argument("--frames", type=int, nargs="+", default=[20, 100, 1000])
    parser.add_argument("--markers", choices=["bent", "exact"], default="bent",
                        help="true markers: 0.5 mm about their nominal places, or at them, as a rigid "
                        "board of OpenCV or mrcal assumes (default bent)")
    parser.add_argument("--pairs", type=int, default=30, help="stereo pairs of images")
    parser.add_argument("--only", choices=[part.__name__ for part in PARTS])
    parser.add_argument("--programs", type=pathlib.Path,
                        help="a build folder to use as it is, in place of build/release")
    options = parser.parse_args()
    programs = options.programs
    if programs is None:
        programs = common.BUILD
        for command in (["cmake", "--preset", "dev"],
                        ["cmake", "--build", "--preset", "dev", "--target", "plenocal", "bench/all"]):
            subprocess.run(command, cwd=ROOT, check=True, stdout=sys.stderr)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("stopped"))  # so that the folder goes
    with common.folder() as temp:
        for part in PARTS:
            if options.only in (None, part.__name__):
                part(programs, temp, options)


if __name__ == "__main__":
    main()

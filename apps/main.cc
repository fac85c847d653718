// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <glog/logging.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <exception>
#include <functional>
#include <new>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

#include "apps/commands.h"
#include "apps/console.h"
#include "apps/undistort/resample_images.h"
#include "calib/error.h"
#include "models/registry.h"

namespace {

constexpr int kDone = 0;
constexpr int kJobFailed = 1;
constexpr int kWrongInput = 2;
constexpr int kInterrupted = 130;  // the shell's code for a command that Ctrl-C ended

int Fail(int status, const std::string& message) {
  fmt::print(stderr, "plenocal: {}\n", message);
  return status;
}

int RunAndMapErrors(const std::function<void()>& run) {
  try {
    run();
    // Results on standard output count as results: a full disk behind a redirection is a failure.
    if (std::fflush(stdout) != 0) return Fail(kJobFailed, "cannot write to standard output");
    return kDone;
  } catch (const plenocal::Error& error) {
    return Fail(error.kind() == plenocal::ErrorKind::kInput ? kWrongInput : kJobFailed,
                error.what());
  } catch (const plenocal::Stopped&) {
    return Fail(kInterrupted, "interrupted; no result files were written");
  } catch (const std::bad_alloc&) {
    return Fail(kJobFailed, "out of memory");
  } catch (const std::system_error& error) {
    // What fmt::print throws; files have their own errors.
    return Fail(kJobFailed, fmt::format("standard output: {}", error.what()));
  } catch (const std::exception& error) {
    return Fail(kJobFailed, fmt::format("internal error: {}", error.what()));
  }
}

void AddThreads(CLI::App* command, int* threads) {
  command->add_option("--threads", *threads, "number of threads (default: all cores)")
      ->check(CLI::Range(1, 1024));
}

void AddQuiet(CLI::App* command, bool* quiet) {
  command->add_flag("--quiet", *quiet, "no messages and no progress, only errors");
}

}  // namespace

// Declaring the commands throws only when memory is short or one is declared twice.
int main(int argc, char** argv) {  // NOLINT(bugprone-exception-escape)
  // Ceres warns of every step that it has to repeat; what a solver ends with is in its summary.
  FLAGS_minloglevel = google::GLOG_FATAL;
  CLI::App app{
      "Plenocal calibrates ordinary and focused plenoptic cameras, alone or on one rig, from "
      "images of a "
      "target.\n\n  plenocal calibrate session.yaml -o OUT"};
  app.name("plenocal");
  app.set_version_flag("--version", PLENOCAL_VERSION);
  app.require_subcommand(1);

  std::vector<std::string> plugins;
  app.add_option("--plugin",
                 plugins,
                 "shared library with more camera models (docs/new_model.md); before the command, "
                 "may stand several times")
      ->allow_extra_args(false);

  plenocal::ConsoleOptions options;
  plenocal::SessionCommand session_command;
  std::function<void()> run;
  const auto add_session_command =
      [&](const char* name,
          const char* description,
          void (*command)(const plenocal::SessionCommand&, const plenocal::ConsoleOptions&)) {
        CLI::App* sub = app.add_subcommand(name, description);
        sub->add_option("session", session_command.session, "session.yaml: cameras, images, target")
            ->required();
        sub->add_option("-o,--out", session_command.out, "folder for the results")->required();
        AddThreads(sub, &options.threads);
        AddQuiet(sub, &options.quiet);
        sub->add_flag("--keep",
                      session_command.keep,
                      "write pictures of the stages into OUT/images/<camera>: markers drawn, of a "
                      "plenoptic camera focused image, depth and micro-lens grid as well");
        sub->add_flag("--fresh",
                      session_command.fresh,
                      "detect again in all images (default: detections of earlier runs into OUT "
                      "are reused where nothing has changed)");
        sub->callback([&, command] { run = [&, command] { command(session_command, options); }; });
        return sub;
      };
  CLI::App* calibrate = add_session_command(
      "calibrate",
      "From images (or detections) to camera parameters, poses and target.\n\n"
      "  plenocal calibrate session.yaml -o OUT\n\n"
      "writes OUT/calibration.yaml, target.yaml, poses.csv, view_poses.csv (of a rig), "
      "residuals.csv, correlations.csv, detections_<camera>.csv and report.html, "
      "and prints a summary.",
      plenocal::RunCalibrate);
  calibrate->add_flag("--jackknife",
                      session_command.jackknife,
                      "print beside each sigma that of a jackknife over frames");
  calibrate->add_flag("!--no-report", session_command.report, "do not write OUT/report.html");
  add_session_command(
      "detect", "Only find the markers: writes OUT/detections_<camera>.csv.", plenocal::RunDetect);
  plenocal::WhiteCommand white_command;
  CLI::App* white =
      app.add_subcommand("white",
                         "From white images to micro-image centres and attenuation.\n\n"
                         "  plenocal white session.yaml -o OUT\n"
                         "  plenocal white FOLDER --model focused-plenoptic -o OUT\n\n"
                         "writes OUT/vignetting_<camera>.tiff and, for a plenoptic camera, "
                         "micro_lenses_<camera>.csv and "
                         "grid_<camera>.png.");
  white
      ->add_option(
          "input", white_command.inputs, "session.yaml; with --model a folder, glob or files")
      ->required();
  white->add_option("-o,--out", white_command.out, "folder for the results")->required();
  white->add_option("--model", white_command.model, "camera model of the images")->expected(1);
  white->add_option(
      "--camera", white_command.camera, "name for the results (default: the folder's)");
  white
      ->add_option(
          "--bayer", white_command.bayer, "colours of the top-left 2 x 2 pixels of raw mosaics")
      ->check(CLI::IsMember({"RGGB", "BGGR", "GRBG", "GBRG"}));
  white->add_option("--grid", white_command.grid, "RayCalibData XML with the micro-lens grid");
  AddThreads(white, &options.threads);
  AddQuiet(white, &options.quiet);
  white->callback([&] { run = [&] { RunWhite(white_command, options); }; });
  plenocal::FocusCommand focus_command;
  CLI::App* focus = app.add_subcommand(
      "focus",
      "From raw images of a plenoptic camera to totally focused images and virtual depth.\n\n"
      "  plenocal focus RAW --white WHITE... -o OUT\n\n"
      "writes OUT/focused.png, virtual_depth.tiff, virtual_depth_sigma.tiff, virtual_depth.png and "
      "focused.yaml; of several raw images OUT/<frame>/...");
  focus->add_option("raw", focus_command.raw, "raw images: files, globs or folders")->required();
  focus->add_option("-o,--out", focus_command.out, "folder for the results")->required();
  focus->add_option("--white", focus_command.white, "white images of the camera, likewise");
  focus->add_option("--grid",
                    focus_command.grid,
                    "instead of white images: micro_lenses_<camera>.csv or RayCalibData XML");
  focus->add_option(
      "--vignetting",
      focus_command.vignetting,
      "with --grid: attenuation TIFF (default: the raw images are corrected already)");
  focus->add_option("--markers",
                    focus_command.markers,
                    "target.yaml: make the depth of each marker found a plane and focus again");
  focus
      ->add_option(
          "--bayer", focus_command.bayer, "colours of the top-left 2 x 2 pixels of raw mosaics")
      ->check(CLI::IsMember({"RGGB", "BGGR", "GRBG", "GBRG"}));
  focus->add_option("--scale", focus_command.scale, "raw pixels a pixel of the results")
      ->check(CLI::Range(0.5, 16.0))
      ->capture_default_str();
  AddThreads(focus, &options.threads);
  AddQuiet(focus, &options.quiet);
  focus->callback([&] { run = [&] { RunFocus(focus_command, options); }; });
  plenocal::SimulateCommand simulate_command;
  CLI::App* simulate = app.add_subcommand(
      "simulate",
      "A session with known truth: images, white images, target and truth.\n\n"
      "  plenocal simulate spec.yaml -o DIR\n\n"
      "then 'plenocal calibrate DIR/session.yaml -o OUT' can be compared with DIR/truth. "
      "docs/simulate.md describes the "
      "specification.");
  simulate->add_option("spec", simulate_command.spec, "spec.yaml: cameras, target, poses")
      ->required();
  simulate->add_option("-o,--out", simulate_command.out, "folder for the session")->required();
  simulate->add_flag(
      "--points", simulate_command.points, "detections with noise in place of images");
  AddThreads(simulate, &options.threads);
  AddQuiet(simulate, &options.quiet);
  simulate->callback([&] { run = [&] { RunSimulate(simulate_command, options); }; });
  plenocal::PrintCommand print_command;
  CLI::App* target = app.add_subcommand(
      "target",
      "A printable target at true scale, with a ruler to check the printer.\n\n"
      "  plenocal target target.yaml -o FILE.svg|.pdf|.png\n\n"
      "Tags that are arranged in space are laid out one by one, with ids and cut marks.");
  target->add_option("target", print_command.target, "target.yaml")->required();
  target->add_option("-o,--out", print_command.out, "FILE.svg, FILE.pdf or FILE.png")->required();
  target
      ->add_option("--paper",
                   print_command.paper,
                   "fit (as large as needed), a0 to a5, letter, legal or tabloid")
      ->capture_default_str();
  target->add_option("--dpi", print_command.dpi, "pixels an inch of PNG")
      ->check(CLI::Range(30.0, 2400.0))
      ->capture_default_str();
  bool quiet_target = false;  // it has nothing to say; accepted as on each command
  AddQuiet(target, &quiet_target);
  target->callback([&] { run = [&] { RunTarget(print_command); }; });
  plenocal::EvaluateCommand evaluate_command;
  CLI::App* evaluate = app.add_subcommand(
      "evaluate",
      "Drift of visual odometry over one large loop, ATE and RPE.\n\n"
      "  plenocal evaluate --estimate TRAJ --truth SEGMENTS --json\n"
      "  plenocal evaluate --estimate DSO=dso.txt ORB2=orb2.txt --monocular DSO --truth SEGMENTS "
      "--chart drift.svg\n\n"
      "Trajectories in the forms of TUM, ORB-SLAM, EuRoC and KITTI; docs/exchange.md.");
  evaluate
      ->add_option("--estimate",
                   evaluate_command.estimates,
                   "estimated trajectories, each FILE or NAME=FILE")
      ->required();
  evaluate->add_option("--truth",
                       evaluate_command.truth,
                       "truth of start and end in one file, parted at its largest gap; or of the "
                       "whole path");
  evaluate->add_option("--start", evaluate_command.start, "truth of the start segment");
  evaluate->add_option("--end", evaluate_command.end, "truth of the end segment");
  evaluate->add_option("--times", evaluate_command.times, "times of KITTI poses, s, one a line");
  evaluate
      ->add_option("--tolerance",
                   evaluate_command.tolerance,
                   "s between a pose and the truth that belongs to it")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  evaluate->add_option("--delta", evaluate_command.delta, "poses between the ends of RPE's pairs")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  std::vector<std::string> monocular;
  CLI::Option* monocular_option =
      evaluate
          ->add_option(
              "--monocular", monocular, "runs that have no scale (without names: all of them)")
          ->expected(0, -1);
  evaluate->add_flag("--json", evaluate_command.json, "JSON on standard output");
  evaluate->add_option("--chart", evaluate_command.chart, "bar chart: FILE.svg or FILE.png");
  AddQuiet(evaluate, &options.quiet);
  evaluate->callback([&] {
    if (monocular_option->count() > 0) {
      // CLI11 stands for "no names" with one empty name.
      std::erase(monocular, "");
      evaluate_command.monocular = monocular;
    }
    run = [&] { RunEvaluate(evaluate_command, options); };
  });
  plenocal::ExportCommand export_command;
  CLI::App* exporter = app.add_subcommand(
      "export",
      "A calibration as another tool's file.\n\n"
      "  plenocal export calibration.yaml --format kalibr -o camchain.yaml\n\n"
      "Formats: opencv, ros, kalibr, mrcal, colmap, orbslam2, orbslam3, dso, basalt, matlab (FILE "
      "or FILE.mat), lifcal; docs/exchange.md. Of tools with one file a camera, several become "
      "FILE_<camera>.");
  exporter->add_option("calibration", export_command.calibration, "calibration.yaml")->required();
  exporter->add_option("--format", export_command.format, "the other tool")->required();
  exporter->add_option(
      "--camera", export_command.cameras, "cameras to export, in this order (default: all)");
  exporter->add_option("-o,--out", export_command.out, "file to write")->required();
  AddQuiet(exporter, &options.quiet);
  exporter->callback([&] { run = [&] { RunExport(export_command, options); }; });
  plenocal::ImportCommand import_command;
  CLI::App* importer = app.add_subcommand(
      "import",
      "Another tool's file as ours.\n\n"
      "  plenocal import camchain.yaml --format kalibr -o OUT\n\n"
      "Formats: those of 'plenocal export' give OUT/calibration.yaml; kalibr-target "
      "OUT/target.yaml; mrcal-corners (corners.vnl) OUT/detections_<file>.csv; raytrix "
      "(RayCalibData XML) OUT/micro_lenses_<file>.csv.");
  importer->add_option("file", import_command.files, "the other tool's file; of mrcal one a camera")
      ->required();
  importer->add_option("--format", import_command.format, "the other tool")->required();
  importer->add_option(
      "--size", import_command.size, "WIDTHxHEIGHT of the images where the file does not say it");
  importer->add_flag("--fisheye",
                     import_command.fisheye,
                     "opencv: the coefficients are cv::fisheye's where the file does not say so");
  importer->add_option("-o,--out", import_command.out, "folder, or the file to write")->required();
  AddQuiet(importer, &options.quiet);
  importer->callback([&] { run = [&] { RunImport(import_command, options); }; });
  std::filesystem::path report_folder;
  CLI::App* report = app.add_subcommand(
      "report",
      "The report of a calibration once more, from the files in its folder alone.\n\n"
      "  plenocal report OUT\n\n"
      "writes OUT/report.html: one page that opens in any browser, without network.");
  report->add_option("out", report_folder, "folder that 'plenocal calibrate' wrote")->required();
  bool quiet_report = false;  // it has nothing to say; accepted as on each command
  AddQuiet(report, &quiet_report);
  report->callback([&] { run = [&] { plenocal::RunReport(report_folder); }; });
  plenocal::TryCommand try_command;
  CLI::App* tries = app.add_subcommand(
      "try",
      "Which camera model describes the cameras: each is calibrated and judged by frames that it "
      "has not seen.\n\n"
      "  plenocal try session.yaml --models A,B,C -o OUT\n\n"
      "writes OUT/try.csv, try.yaml, try.html and models/<model>/calibration.yaml.");
  tries->add_option("session", try_command.session, "session.yaml: cameras, images, target")
      ->required();
  tries
      ->add_option("--models",
                   try_command.models,
                   "camera models, separated by commas (default: all of the cameras' kind)")
      ->delimiter(',');
  tries->add_option("--camera",
                    try_command.camera,
                    "of a rig: whose model is varied (default: all ordinary cameras)");
  tries->add_option("--folds", try_command.folds, "parts of the frames that are held out in turn")
      ->check(CLI::Range(2, 1000))
      ->capture_default_str();
  tries->add_option("-o,--out", try_command.out, "folder for the results")->required();
  AddThreads(tries, &options.threads);
  AddQuiet(tries, &options.quiet);
  tries->add_flag("--fresh", try_command.fresh, "detect again in all images");
  tries->callback([&] { run = [&] { RunTry(try_command, options); }; });
  plenocal::CompareCommand compare_command;
  CLI::App* compare = app.add_subcommand(
      "compare",
      "How far two calibrations differ in the image, beside what their sigmas predict.\n\n"
      "  plenocal compare A/calibration.yaml B/calibration.yaml\n"
      "  plenocal compare A/calibration.yaml --check session.yaml\n\n"
      "The turn and shift of the cameras' frames that the difference of the intrinsics implies is "
      "taken out first.");
  compare->add_option("a", compare_command.a, "calibration.yaml")->required();
  compare->add_option("b", compare_command.b, "another, of any models");
  compare->add_option("--check",
                      compare_command.session,
                      "instead of another: session.yaml with new images of the same cameras. Does "
                      "the calibration still hold for them (only poses free)? Exit status 1: no");
  compare->add_option("-o,--out", compare_command.out, "folder for difference.png and compare.csv");
  compare->add_flag("--json", compare_command.json, "with --check: JSON on standard output");
  AddThreads(compare, &options.threads);
  compare->add_option("--distance",
                      compare_command.distances,
                      "distances of what is seen, m, or inf (default: 1 inf)");
  AddQuiet(compare, &options.quiet);
  compare->callback([&] { run = [&] { RunCompare(compare_command, options); }; });
  plenocal::ConvertCommand convert_command;
  CLI::App* convert =
      app.add_subcommand("convert",
                         "Fits one camera model to another over the image.\n\n"
                         "  plenocal convert calibration.yaml --camera NAME --to MODEL -o OUT\n\n"
                         "writes OUT/calibration.yaml and the errors at pixels over the image, "
                         "conversion_errors.csv and .png.");
  convert->add_option("calibration", convert_command.calibration, "calibration.yaml")->required();
  convert->add_option("--camera", convert_command.camera, "its camera (default: the only one)");
  convert->add_option("--to", convert_command.model, "camera model")->required();
  convert->add_option("-o,--out", convert_command.out, "folder for the results")->required();
  AddQuiet(convert, &options.quiet);
  convert->callback([&] { run = [&] { RunConvert(convert_command); }; });
  const auto add_view_options = [](CLI::App* sub, plenocal::ViewArguments* view) {
    sub->add_option("--size", view->size, "WIDTHxHEIGHT of the result (default: the camera's)");
    CLI::Option* fov =
        sub->add_option("--fov", view->fov, "horizontal field of view, degrees, square pixels")
            ->check(CLI::Range(1.0, 175.0));
    sub->add_option("--balance",
                    view->balance,
                    "0: largest view of which every pixel has a source, 1: all that the camera "
                    "sees (default: the camera's scale on the optical axis)")
        ->check(CLI::Range(0.0, 1.0))
        ->excludes(fov);
  };
  const auto add_resample_options = [](CLI::App* sub, plenocal::ResampleArguments* resample) {
    sub->add_option("--interpolation", resample->interpolation, "between pixels")
        ->check(CLI::IsMember(std::vector<std::string>(plenocal::kInterpolations.begin(),
                                                       plenocal::kInterpolations.end())))
        ->capture_default_str();
    sub->add_option("--bayer",
                    resample->bayer,
                    "colours of the top-left 2 x 2 pixels of raw mosaics, which become colour "
                    "images")
        ->check(CLI::IsMember({"RGGB", "BGGR", "GRBG", "GBRG"}));
    sub->add_flag("--keep-vignetting",
                  resample->keep_vignetting,
                  "leave it in the images (default: removed where the calibration has it)");
    sub->add_flag(
        "--mask", resample->mask, "write mask.png: 255 where pixels have a source, else 0");
  };
  const auto add_resample_common = [&](CLI::App* sub) {
    AddThreads(sub, &options.threads);
    AddQuiet(sub, &options.quiet);
  };
  plenocal::UndistortCommand undistort_command;
  CLI::App* undistort = app.add_subcommand(
      "undistort",
      "Images without distortion, as a pinhole camera takes them.\n\n"
      "  plenocal undistort calibration.yaml --camera NAME IMAGES... -o DIR\n\n"
      "writes DIR/<image>.png (depth and colours of the image; black without source) and "
      "DIR/calibration.yaml, the new camera; of raw plenoptic images the totally focused image, "
      "DIR/<image>_depth.tiff and _depth_sigma.tiff (z and its sigma in metres, NaN unknown).");
  undistort->add_option("calibration", undistort_command.calibration, "calibration.yaml")
      ->required();
  undistort->add_option("images", undistort_command.images, "images: files, globs or folders")
      ->required();
  undistort
      ->add_option("--camera", undistort_command.camera, "camera of the images (default: the only)")
      ->expected(1);
  undistort->add_option(
      "--cloud", undistort_command.cloud, "FILE.ply: point cloud of one raw plenoptic image, m");
  undistort->add_option("-o,--out", undistort_command.out, "folder for the results")->required();
  add_view_options(undistort, &undistort_command.view);
  add_resample_options(undistort, &undistort_command.resample);
  add_resample_common(undistort);
  undistort->callback([&] { run = [&] { RunUndistort(undistort_command, options); }; });
  plenocal::MapCommand map_command;
  CLI::App* map = app.add_subcommand(
      "map",
      "Remap tables that undistort a camera's images, for cv::remap.\n\n"
      "  plenocal map calibration.yaml --camera NAME -o DIR | FILE.yaml | FILE.xml\n\n"
      "writes DIR/map_x.tiff, map_y.tiff (32-bit floats, px, -1 both where the camera images "
      "nothing), mask.png and calibration.yaml, the new camera; or one cv::FileStorage.");
  map->add_option("calibration", map_command.calibration, "calibration.yaml")->required();
  map->add_option("--camera", map_command.camera, "its camera (default: the only one)");
  map->add_option("-o,--out", map_command.out, "folder, or file of OpenCV")->required();
  add_view_options(map, &map_command.view);
  add_resample_common(map);
  map->callback([&] { run = [&] { RunMap(map_command, options); }; });
  plenocal::RectifyCommand rectify_command;
  CLI::App* rectify = app.add_subcommand(
      "rectify",
      "Stereo pairs whose points lie in equal rows.\n\n"
      "  plenocal rectify calibration.yaml 'left/*.png' 'right/*.png' -o DIR\n"
      "  plenocal rectify OUT/calibration.yaml --session session.yaml -o DIR\n\n"
      "writes DIR/<camera>/<frame>.png, DIR/calibration.yaml (two pinhole cameras of equal "
      "parameters, baseline along x) and rectification.yaml (R1 R2 P1 P2 Q of OpenCV); prints "
      "the epipolar error of the calibration's detections.");
  rectify->add_option("calibration", rectify_command.calibration, "calibration.yaml")->required();
  rectify->add_option(
      "left", rectify_command.left, "images of the first camera: glob, folder, file");
  rectify->add_option("right", rectify_command.right, "images of the second camera, likewise");
  rectify->add_option("--session", rectify_command.session, "session.yaml that names the images")
      ->excludes("left");
  rectify
      ->add_option(
          "--cameras", rectify_command.cameras, "first and second camera (default: the two)")
      ->expected(2);
  rectify->add_option("--detections",
                      rectify_command.detections,
                      "folder of detections_<camera>.csv (default: that of the calibration)");
  rectify->add_option("-o,--out", rectify_command.out, "folder for the results")->required();
  rectify->add_flag("--maps", rectify_command.maps, "write <camera>/map_x.tiff and map_y.tiff");
  add_view_options(rectify, &rectify_command.view);
  add_resample_options(rectify, &rectify_command.resample);
  add_resample_common(rectify);
  rectify->callback([&] { run = [&] { RunRectify(rectify_command, options); }; });
  CLI::App* models =
      app.add_subcommand("models", "List the camera models, their parameters, units and source.");
  models->require_subcommand(0, 1);
  std::string checked_model;
  CLI::App* check_model = models->add_subcommand(
      "check",
      "Whether a model's projection, inverse and derivatives agree with each other.\n\n"
      "  plenocal --plugin ./libmine.so models check NAME\n\n"
      "runs the tests of the models of this project on any model, at its example parameters.");
  check_model->add_option("name", checked_model, "camera model")->required();
  models->callback([&] {
    run = check_model->parsed() ? [&] { plenocal::RunModelCheck(checked_model); }
                                : std::function<void()>(plenocal::RunModels);
  });

  // CLI11 would only say that a command is required.
  int first = 1;
  while (first + 1 < argc && argv[first] == std::string_view("--plugin")) first += 2;
  if (first < argc && argv[first][0] != '-') {
    const std::vector<CLI::App*> commands =
        app.get_subcommands([](const CLI::App*) { return true; });
    std::vector<std::string> kept;
    kept.reserve(commands.size());
    for (const CLI::App* command : commands) kept.push_back(command->get_name());
    const std::vector<std::string_view> names(kept.begin(), kept.end());
    if (std::find(names.begin(), names.end(), argv[first]) == names.end()) {
      return Fail(kWrongInput,
                  fmt::format("unknown command '{}'{}; see 'plenocal --help'",
                              argv[first],
                              plenocal::SuggestName(argv[first], names)));
    }
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::CallForHelp& help) {
    return app.exit(help);
  } catch (const CLI::CallForVersion& version) {
    return app.exit(version);
  } catch (const CLI::ParseError& error) {
    const auto command = app.get_subcommands();
    const bool late = std::any_of(argv + first, argv + argc, [](const char* argument) {
      return std::string_view(argument).starts_with("--plugin");
    });
    return Fail(
        kWrongInput,
        late ? "--plugin stands before the command: plenocal --plugin ./libmine.so COMMAND ..."
             : fmt::format("{}; see 'plenocal {}--help'",
                           error.what(),
                           command.empty() ? "" : command[0]->get_name() + " "));
  }
  plenocal::CatchInterrupts();
  return RunAndMapErrors([&] {
    for (const std::string& plugin : plugins) {
      plenocal::AddCameraModels(plugin);
      options.program += " --plugin " + plugin;
    }
    run();
  });
}

// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <numbers>
#include <optional>

#include "apps/cli/command.h"
#include "apps/cli/image_inputs.h"
#include "apps/cli/options.h"
#include "apps/suggest/suggestions_json.h"
#include "apps/suggest/view_sheet.h"
#include "assess/verdict.h"
#include "assess/views/view_information.h"
#include "calib/base/error.h"
#include "calib/base/number_text.h"
#include "calib/estimate/describe.h"
#include "calib/io/output_folder.h"
#include "engine/observe/session_observations.h"
#include "engine/session/earlier_session.h"
#include "engine/session/open_session.h"
#include "engine/suggest/calibrated_rig.h"
#include "engine/suggest/first_rig.h"
#include "engine/suggest/picture_scale.h"
#include "engine/suggest/view_target.h"
#include "models/registry.h"

namespace plenocal {
namespace {

struct SuggestArguments {
  std::filesystem::path input;  ///< session.yaml or a calibration's folder; empty: no images yet
  std::string model = "pinhole-radtan4", target, size;  ///< before the first image
  double angle = 0;                                     ///< likewise, degrees; 0: not given
  int count = 5;
  double nearest = 0, farthest = 0;  ///< m; 0: as target and lens allow
  double tilt = 50;                  ///< degrees
  double goal = 0.05;                ///< px
  bool json = false;
  std::filesystem::path picture;  ///< empty: none
  /// Pictures taken at once that are to be weighed, "left=look.png"; empty: views are suggested.
  std::vector<std::string> images;
};

/// What suggestions start from.
struct SuggestBasis {
  RigKnowledge rig;
  ViewTarget shape;
  std::optional<Verdict> verdict;  ///< of the calibration so far
};

double Radians(double degrees) { return degrees * std::numbers::pi / 180; }

PictureFormat PictureFormatOf(const std::filesystem::path& picture) {
  if (picture.extension() == ".svg") return PictureFormat::kSvg;
  if (picture.extension() == ".png") return PictureFormat::kPng;
  throw Error(ErrorKind::kInput,
              fmt::format("{}: a picture's name ends in .svg or .png", picture.string()));
}

// The points of a calibration's camera, as its images had them.
std::vector<View> ViewsOf(const CalibrationRecord& calibration, const CalibratedCamera& camera) {
  std::map<int, View> views;
  for (const ResidualRow& row : camera.residuals) {
    View& view = views[row.frame];
    view.frame = calibration.frames[static_cast<size_t>(row.frame)].name;
    view.observations.push_back(
        {.marker = row.marker, .values = row.values, .detector_sigma = row.noise_sigma});
  }
  std::vector<View> list;
  for (auto& [frame, view] : views) list.push_back(std::move(view));
  return list;
}

// What the images of a calibration tell of lenses of a known angle: parameters that they do not
// determine may be anywhere in the calibration.
SuggestBasis BasisOfImages(const CalibrationRecord& calibration,
                           const Target& target,
                           double angle_deg) {
  std::vector<FirstCamera> cameras;
  for (const CalibratedCamera& camera : calibration.cameras) {
    cameras.push_back({.name = camera.name,
                       .model = camera.model,
                       .image_size = camera.image_size,
                       .angle = Radians(angle_deg),
                       .views = ViewsOf(calibration, camera)});
  }
  const double marker_sigma = calibration.adjustment ? calibration.adjustment->marker_sigma : 0;
  return {
      FirstRig(cameras, target.markers, marker_sigma), ViewTargetOf(target), calibration.verdict};
}

SuggestBasis BasisOfCalibration(const std::filesystem::path& folder, double angle_deg) {
  const CalibrationRecord calibration = ReadTargetCalibration(folder);
  const Target target = ReadTarget(folder / "target.yaml");
  if (angle_deg > 0) return BasisOfImages(calibration, target, angle_deg);
  ViewTarget shape = ViewTargetOf(target);
  RigKnowledge rig = KnowledgeOf(folder, calibration, shape);
  return {std::move(rig), std::move(shape), calibration.verdict};
}

std::vector<FirstCamera> FirstCameras(const Session& session,
                                      const std::vector<CameraInput>& cameras,
                                      const SuggestArguments& arguments) {
  std::vector<FirstCamera> first;
  const std::optional<ImageSize> size =
      arguments.size.empty() ? std::nullopt : ParseImageSize(arguments.size);
  for (size_t c = 0; c < session.cameras.size(); ++c) {
    const SessionCamera& camera = session.cameras[c];
    ImageSize of_camera = size.value_or(camera.image_size);
    if (c < cameras.size()) of_camera = cameras[c].image_size;
    if (of_camera == ImageSize{}) {
      throw Error(ErrorKind::kInput,
                  fmt::format("{}: give --size WxH, the size of its images", camera.name));
    }
    first.push_back({.name = camera.name,
                     .model = camera.model,
                     .image_size = of_camera,
                     .angle = Radians(arguments.angle),
                     .views = c < cameras.size() ? cameras[c].views : std::vector<View>()});
  }
  return first;
}

// The calibration of a session, or, where its images do not suffice for one and the lens angle is
// given, what these images tell of a lens of that angle.
SuggestBasis BasisOfSession(const SuggestArguments& arguments,
                            const ConsoleOptions& shared,
                            Console* console) {
  const Session session = OpenSession(arguments.input);
  RefuseSeveralTargets(session, "suggest");
  if (session.scene) {
    throw Error(ErrorKind::kInput,
                fmt::format("{}: has a scene in place of a target; next views are for a target",
                            arguments.input.string()));
  }
  const Target target = ReadTarget(session.target);
  const Run run = console->NewRun();
  const SessionObservations observations = CollectObservations(session, target, run, {});
  const CalibrationInput input =
      MakeInputOnEarlier(session, target, observations.cameras, run).input;
  try {
    const Calibration calibration =
        Calibrate(input, {.threads = shared.threads, .progress = [&](const std::string& stage) {
                            return console->Progress(stage);
                          }});
    CalibrationRecord record = Describe(calibration);
    SuggestBasis basis{KnowledgeOf(record), ViewTargetOf(target), Judge(record)};
    SetFactors(record, basis.shape, &basis.rig);
    for (const CameraInput& camera : input.cameras) {
      if (!camera.model->plenoptic) continue;
      throw Error(ErrorKind::kInput,
                  fmt::format("{}: suggestions for a plenoptic camera need its micro lenses; run "
                              "'plenocal calibrate {} -o OUT', then 'plenocal suggest OUT'",
                              camera.name,
                              arguments.input.string()));
    }
    return basis;
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::kJob) throw;
    if (arguments.angle == 0) {
      throw Error(ErrorKind::kJob,
                  fmt::format("{}; for suggestions from so few images give --angle DEGREES, the "
                              "lens' horizontal field of view",
                              error.what()));
    }
    console->Message(
        fmt::format("{}; a lens of {:.0f} degrees is assumed", error.what(), arguments.angle));
  }
  return {FirstRig(FirstCameras(session, observations.cameras, arguments),
                   target.markers,
                   input.marker_sigma),
          ViewTargetOf(target),
          std::nullopt};
}

// Before the first image.
SuggestBasis BasisOfLens(const SuggestArguments& arguments) {
  if (arguments.target.empty() || arguments.size.empty() || arguments.angle == 0) {
    throw Error(ErrorKind::kInput,
                "suggest: give session.yaml or the folder of a calibration; before the first image "
                "--target, --size and --angle");
  }
  const bool is_file = std::filesystem::exists(arguments.target);
  const Target target = is_file ? ReadTarget(std::filesystem::path(arguments.target))
                                : TargetOfWord(arguments.target);
  return {FirstRig({{.name = "camera",
                     .model = ModelNamed("--model", arguments.model),
                     .image_size = *ParseImageSize(arguments.size),
                     .angle = Radians(arguments.angle)}},
                   target.markers,
                   0),
          ViewTargetOf(target),
          std::nullopt};
}

// The folder of a calibration; empty: the input is none.
std::filesystem::path FolderOf(const std::filesystem::path& input) {
  if (std::filesystem::is_directory(input)) return input;
  if (input.filename() != "calibration.yaml") return {};
  return input.parent_path().empty() ? std::filesystem::path(".") : input.parent_path();
}

SuggestBasis BasisOf(const SuggestArguments& arguments,
                     const ConsoleOptions& shared,
                     Console* console) {
  if (arguments.input.empty()) return BasisOfLens(arguments);
  const std::filesystem::path folder = FolderOf(arguments.input);
  return folder.empty() ? BasisOfSession(arguments, shared, console)
                        : BasisOfCalibration(folder, arguments.angle);
}

// By camera; one without a name is the calibration's only camera.
std::map<std::string, FrameImage> PicturesOf(const SuggestArguments& arguments) {
  std::map<std::string, FrameImage> pictures;
  for (const std::string& word : arguments.images) {
    const size_t equals = word.find('=');
    const std::string camera = equals == std::string::npos ? "" : word.substr(0, equals);
    const std::filesystem::path path = word.substr(equals == std::string::npos ? 0 : equals + 1);
    if (path.empty()) {
      throw Error(ErrorKind::kInput, fmt::format("--image: '{}' names no file", word));
    }
    if (!pictures.emplace(camera, FrameImage{.frame = path.stem().string(), .path = path}).second) {
      throw Error(ErrorKind::kInput,
                  fmt::format("--image: two pictures of camera '{}'; give one", camera));
    }
  }
  return pictures;
}

void WeighPictures(const SuggestArguments& arguments, const ConsoleOptions& shared) {
  const std::filesystem::path folder = FolderOf(arguments.input);
  if (folder.empty()) {
    throw Error(ErrorKind::kInput,
                "--image: pictures are weighed against a calibration: give the folder that "
                "'plenocal calibrate' wrote");
  }
  PictureScale scale(folder, shared.threads);
  const PictureWorth worth = scale.Weigh(PicturesOf(arguments));
  if (arguments.json) {
    fmt::print("{}\n",
               WorthJson(worth).dump(2, ' ', false, nlohmann::json::error_handler_t::replace));
    return;
  }
  Console(shared).Print(WordsOf(worth) + "\n");
}

std::string SuggestionsText(const NextViews& suggestions,
                            const SuggestBasis& basis,
                            bool assumed_angle) {
  std::string text =
      std::isfinite(suggestions.sigma)
          ? fmt::format("{}; sigma of the projection {:.2g} px, goal {:.2g} px\n",
                        Counted(suggestions.frames, "frame"),
                        suggestions.sigma,
                        suggestions.goal)
          : fmt::format("{}; they do not determine all parameters yet{}\n",
                        Counted(suggestions.frames, "frame"),
                        assumed_angle
                            ? ""
                            : ", so distances are uncertain as well: --angle DEGREES, the "
                              "lens' horizontal field of view, makes them better");
  if (suggestions.reached) text += "the goal is reached; these views would add most:\n";
  if (!suggestions.reached && suggestions.exhausted) {
    text +=
        "more views of this target at these distances add little; allow nearer ones (--near), "
        "or take a larger target:\n";
  }
  for (size_t i = 0; i < suggestions.views.size(); ++i) {
    text += fmt::format("  {}. {}\n", i + 1, WordsOf(suggestions.views[i], basis.rig));
  }
  if (!suggestions.views.empty() && suggestions.views.back().criterion == ViewCriterion::kSigma) {
    text += fmt::format("with all of them: sigma of the projection {:.2g} px\n",
                        suggestions.views.back().sigma_after);
  }
  // Sigmas say nothing about errors of the model.
  if (basis.verdict && basis.verdict->grade == Grade::kBad) {
    const std::vector<Finding>& findings = basis.verdict->findings;
    text += fmt::format("the calibration so far is bad, and more views may not help{}\n",
                        findings.empty() ? "" : ": " + findings.front().what);
  }
  return text;
}

void RunSuggest(const SuggestArguments& arguments, const ConsoleOptions& shared) {
  if (!arguments.images.empty()) return WeighPictures(arguments, shared);
  Console console(shared);
  std::optional<PictureFormat> format;
  if (!arguments.picture.empty()) format = PictureFormatOf(arguments.picture);
  const SuggestBasis basis = BasisOf(arguments, shared, &console);
  console.Progress("views");
  const NextViews suggestions = ChooseNextViews(basis.rig,
                                                basis.shape,
                                                {.count = arguments.count,
                                                 .range = {arguments.nearest, arguments.farthest},
                                                 .largest_tilt = Radians(arguments.tilt),
                                                 .goal = arguments.goal,
                                                 .threads = shared.threads});
  if (format) {
    WriteOutput(arguments.picture, DrawViewSheet(suggestions, basis.rig, basis.shape, *format));
  }
  if (arguments.json) {
    nlohmann::json result = SuggestionsJson(suggestions, basis.rig);
    result["verdict"] =
        basis.verdict ? nlohmann::json(GradeName(basis.verdict->grade)) : nlohmann::json(nullptr);
    fmt::print("{}\n", result.dump(2, ' ', false, nlohmann::json::error_handler_t::replace));
    return;
  }
  console.Print(SuggestionsText(suggestions, basis, arguments.angle > 0));
}

constexpr const char* kSuggestHelp =
    "What to record next: the poses of the target that lower the projection's sigma most.\n\n"
    "  plenocal suggest OUT\n"
    "  plenocal suggest session.yaml --picture next.svg\n"
    "  plenocal suggest OUT --image left=now.png\n"
    "  plenocal suggest --target chessboard:9x6:25mm --size 1280x960 --angle 70\n\n"
    "OUT is the folder that 'plenocal calibrate' wrote. The last form is for the time before the first image. docs/suggest.md explains the choice.";

RunCommand DeclareSuggest(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<SuggestArguments>();
  app->add_option("input",
                  arguments->input,
                  "folder that 'plenocal calibrate' wrote, or session.yaml; none: no image yet");
  app->add_option(
      "--target", arguments->target, "before the first image: chessboard:9x6:25mm, or a file");
  app->add_option("--size", arguments->size, "before the first image: size of images, 1280x960");
  app->add_option(
         "--angle",
         arguments->angle,
         "horizontal field of view of the lens, degrees, of the data sheet: before the first image, and while images do not determine it")
      ->check(CLI::Range(1.0, 300.0));
  app->add_option("--model", arguments->model, "before the first image: camera model")
      ->capture_default_str();
  app->add_option("--count", arguments->count, "number of suggestions")
      ->check(CLI::Range(1, 100))
      ->capture_default_str();
  app->add_option("--near", arguments->nearest, "least distance of the target, m")
      ->check(CLI::PositiveNumber);
  app->add_option("--far", arguments->farthest, "largest distance of the target, m")
      ->check(CLI::PositiveNumber);
  app->add_option("--tilt", arguments->tilt, "largest tilt against the line of sight, degrees")
      ->check(CLI::Range(0.0, 75.0))
      ->capture_default_str();
  app->add_option("--goal", arguments->goal, "sigma of the projection that suffices, px")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app->add_option("--picture", arguments->picture, "FILE.svg or FILE.png: what images should show");
  app->add_option(
      "--image",
      arguments->images,
      "[CAMERA=]FILE: a picture (of a rig one of each camera, taken at once); what it adds, against what the best view would");
  app->add_flag("--json", arguments->json, "the suggestions as JSON on standard output");
  AddThreads(app, shared);
  AddQuiet(app, shared);
  return [arguments, shared] { RunSuggest(*arguments, *shared); };
}

}  // namespace

Command SuggestCommand() { return {"suggest", kSuggestHelp, DeclareSuggest}; }

}  // namespace plenocal

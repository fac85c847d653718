// SPDX-License-Identifier: Apache-2.0
#include "engine/rigs/predict_accuracy.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "calib/base/format_error.h"
#include "calib/base/json_text.h"
#include "calib/base/quoted_text.h"
#include "calib/io/input_file.h"
#include "engine/json/accuracy_json.h"
#include "engine/session/calibration_folder.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

void Check(const AccuracyRequest& request, const CalibrationRecord& calibration) {
  for (const double distance : request.distances) {
    if (!(distance > 0)) throw InputError("--distances: expected lengths above 0 m");
  }
  for (const auto& [name, sigma] : request.noise) FindCamera(calibration, name);
  for (const std::vector<std::string>& set : request.sets) {
    for (const std::string& name : set) {
      FindCamera(calibration, name);
      if (std::ranges::count(set, name) > 1) {
        throw InputError("--pair {}: camera '{}' stands there twice", fmt::join(set, ","), name);
      }
    }
  }
}

std::string Cell(const std::optional<ErrorBudget>& budget) {
  return budget ? fmt::format(",{:.6g}", budget->Sigma()) : ",";
}

std::string AccuracyCsv(const std::vector<RigAccuracy>& accuracies) {
  std::string text =
      "cameras,distance,x,y,sigma_z,sigma_z_noise,sigma_z_calibration,sigma_lateral,"
      "sigma_lateral_noise,sigma_lateral_calibration,sigma_bar_across,sigma_bar_along,seen_at\n";
  for (const RigAccuracy& accuracy : accuracies) {
    for (const AccuracyAtDistance& at : accuracy.distances) {
      for (const AccuracyCell& cell : at.cells) {
        const Eigen::Vector2d u = accuracy.grid.Middle(cell.cell);
        text += fmt::format("{},{:.6g},{:.6g},{:.6g}",
                            CsvCell(fmt::format("{}", fmt::join(accuracy.cameras, "+"))),
                            at.distance,
                            u.x(),
                            u.y());
        for (const ErrorBudget* budget : {&cell.z, &cell.lateral}) {
          if (budget == &cell.z && !accuracy.has_depth) {
            text += ",,,";
            continue;
          }
          text += fmt::format(",{:.6g},{:.6g},{:.6g}",
                              budget->Sigma(),
                              budget->noise,
                              std::hypot(budget->calibration, budget->scale));
        }
        text += Cell(cell.across) + Cell(cell.along);
        text += at.seen_at ? fmt::format(",{:.4g}\n", *at.seen_at) : ",\n";
      }
    }
  }
  return text;
}

}  // namespace

std::vector<MicroLensVisibility> ReadVisibility(const fs::path& folder,
                                                const CalibrationRecord& calibration) {
  std::vector<MicroLensVisibility> lenses;
  for (const CalibratedCamera& camera : calibration.cameras) {
    MicroLensVisibility& of_camera = lenses.emplace_back();
    const fs::path file = folder / camera.micro_lenses;
    if (camera.micro_lenses.empty() || !fs::exists(file)) continue;
    of_camera = MicroLensVisibility(ReadMicroLenses(file, camera.image_size));
  }
  return lenses;
}

std::vector<RigAccuracy> PredictAccuracy(const AccuracyRequest& request, const Run& run) {
  const RunScope inputs;
  const bool is_folder = fs::is_directory(request.calibration);
  const CalibrationRecord calibration = is_folder ? OpenCalibrationFolder(request.calibration)
                                                  : OpenWithCorrelations(request.calibration);
  Check(request, calibration);
  const fs::path folder = is_folder ? request.calibration : request.calibration.parent_path();
  const std::vector<MicroLensVisibility> lenses = ReadVisibility(folder, calibration);
  if (!request.sets.empty()) {
    std::vector<RigAccuracy> accuracies;
    for (const auto& set : request.sets) {
      accuracies.push_back(PredictAccuracy(calibration, set, lenses, request));
    }
    return accuracies;
  }
  std::vector<RigAccuracy> accuracies;
  for (const auto& set : CameraSets(calibration)) {
    try {
      accuracies.push_back(PredictAccuracy(calibration, set, lenses, request));
    } catch (const Error& error) {
      // One set alone has no others to go on with.
      if (CameraSets(calibration).size() == 1) throw;
      run.Message(fmt::format("{}: left out: {}", CamerasText(set), error.what()));
    }
  }
  if (accuracies.empty()) {
    throw InputError("{}: nothing can be predicted", request.calibration.string());
  }
  return accuracies;
}

OutputContents AccuracyFiles(const AccuracyRequest& request,
                             const std::vector<RigAccuracy>& accuracies) {
  const nlohmann::json json{
      {"plenocal", 1},
      {"calibration", request.calibration.string()},
      {"frame_of_reference", request.frame == SpaceFrame::kRig ? "rig" : "housing"},
      {"accuracy", AccuracyJson(accuracies)}};
  return {{"accuracy.csv", AccuracyCsv(accuracies)}, {"accuracy.json", JsonText(json) + "\n"}};
}

std::string AccuracyText(const std::vector<RigAccuracy>& accuracies) {
  std::string text;
  for (const RigAccuracy& accuracy : accuracies) {
    for (const AccuracyAtDistance& at : accuracy.distances) {
      text += AccuracyLine(accuracy, at) + "\n";
    }
    if (!accuracy.open.empty()) {
      text += fmt::format("  left open by the calibration and taken as exact: {}\n",
                          fmt::join(accuracy.open, ", "));
    }
    for (const Finding& finding : accuracy.findings) {
      text += fmt::format("  {}: {} {}\n", finding.code, finding.what, finding.remedy);
    }
  }
  return text;
}

std::vector<RigAccuracy> AccuracyInBrief(const CalibrationRecord& calibration,
                                         const std::vector<MicroLensVisibility>& lenses) {
  constexpr size_t kMostSets = 4;
  AccuracyOptions options;
  options.cells = 6;
  std::vector<RigAccuracy> accuracies;
  if (calibration.cameras.size() == 1 && !calibration.cameras[0].model->plenoptic) return {};
  std::vector<std::vector<std::string>> sets = CameraSets(calibration);
  sets.resize(std::min(sets.size(), kMostSets));
  for (const auto& set : sets) {
    try {
      accuracies.push_back(PredictAccuracy(calibration, set, lenses, options));
    } catch (const Error&) {
      continue;  // imported, or a parameter that nothing determines
    }
  }
  return accuracies;
}

}  // namespace plenocal

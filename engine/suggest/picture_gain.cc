// SPDX-License-Identifier: Apache-2.0
#include "engine/suggest/picture_gain.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "detectors/detect.h"
#include "engine/scene/locate_view.h"
#include "engine/suggest/read_rig_estimate.h"
#include "engine/suggest/view_target.h"

namespace plenocal {
namespace {

FrameGainEvaluator MakeEvaluator(const SuggestedViews& suggested) {
  return {suggested.rig, suggested.shape, suggested.views};
}

LiveCalibration MakeLive(const std::filesystem::path& folder, int threads) {
  CalibrationRecord calibration = ReadTargetCalibration(folder);
  const Target target = ReadTarget(folder / "target.yaml");
  RigEstimate rig = MakeRigEstimate(folder, calibration, MakeViewTarget(target));
  return {std::move(calibration), target, std::move(rig), {.count = 1, .threads = threads}};
}

}  // namespace

std::string PictureGainText(const PictureGain& pictures) {
  if (!pictures.gain) {
    std::string words = pictures.points == 0 ? "the target was not found"
                                             : fmt::format("{}: they determine no pose",
                                                           Counted(pictures.points, "point"));
    for (const auto& [camera, why] : pictures.why) words += fmt::format("; {}: {}", camera, why);
    return words;
  }
  const FrameInformationGain& gain = *pictures.gain;
  std::string words = Counted(pictures.points, "point");
  if (std::isfinite(gain.sigma_before)) {
    words += fmt::format(
        "; sigma of the projection {:.2g} -> {:.2g} px", gain.sigma_before, gain.sigma_after);
  }
  return words + fmt::format("; it adds {:.0f} % of what the best view would", 100 * gain.share);
}

nlohmann::json PictureGainJson(const PictureGain& pictures) {
  const auto finite = [](double value) {
    return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr);
  };
  nlohmann::json json = {{"points", pictures.points},
                         {"words", PictureGainText(pictures)},
                         {"sigma_now", nullptr},
                         {"sigma_after", nullptr},
                         {"share", nullptr}};
  if (pictures.gain) {
    json["sigma_now"] = finite(pictures.gain->sigma_before);
    json["sigma_after"] = finite(pictures.gain->sigma_after);
    json["share"] = pictures.gain->share;
  }
  return json;
}

PictureGainEvaluator::PictureGainEvaluator(const std::filesystem::path& folder, int threads)
    : target_(ReadTarget(folder / "target.yaml")),
      live_(MakeLive(folder, threads)),
      evaluator_(MakeEvaluator(live_.Suggested())),
      threads_(threads) {}

const CalibratedCamera& PictureGainEvaluator::CameraOf(const std::string& name) const {
  const auto& cameras = Calibration().cameras;
  const auto found = name.empty() && cameras.size() == 1
                         ? cameras.begin()
                         : std::ranges::find(cameras, name, &CalibratedCamera::name);
  if (found == cameras.end()) {
    std::vector<std::string> names;
    for (const CalibratedCamera& camera : cameras) names.push_back(camera.name);
    const std::string what = name.empty()
                                 ? "which camera took the picture?"
                                 : fmt::format("the calibration has no camera '{}'.", name);
    throw InputError("{} The calibration's cameras: {}", what, fmt::join(names, ", "));
  }
  if (found->model->plenoptic) {
    throw InputError(
        "{}: pictures of plenoptic cameras are not weighed one by one; "
        "calibrate with them",
        found->name);
  }
  return *found;
}

View PictureGainEvaluator::PointsIn(const CalibratedCamera& camera,
                                    const FrameImage& picture,
                                    std::string* why) const {
  ImageSketch sketch =
      SketchImages({picture}, target_, {.threads = threads_, .progress = {}}).front();
  if (sketch.size == ImageSize{}) throw Error(ErrorKind::kInput, sketch.why);
  if (sketch.size != camera.image_size) {
    throw InputError("{}: {} x {} px, but the calibration of '{}' is for {} x {}",
                     picture.path.string(),
                     sketch.size[0],
                     sketch.size[1],
                     camera.name,
                     camera.image_size[0],
                     camera.image_size[1]);
  }
  *why = std::move(sketch.why);
  return {.frame = picture.frame, .observations = std::move(sketch.points)};
}

PictureGain PictureGainEvaluator::Evaluate(const std::map<std::string, FrameImage>& pictures) {
  last_.reset();
  PictureGain result;
  std::vector<View> views(Calibration().cameras.size());
  size_t fullest = 0;  // the camera with most points
  for (const auto& [name, picture] : pictures) {
    const CalibratedCamera& camera = CameraOf(name);
    const auto c = static_cast<size_t>(&camera - Calibration().cameras.data());
    std::string why;
    views[c] = PointsIn(camera, picture, &why);
    if (!why.empty()) result.why[camera.name] = why;
    result.points += views[c].observations.size();
    if (views[c].observations.size() > views[fullest].observations.size()) fullest = c;
  }
  const CalibratedCamera& camera = Calibration().cameras[fullest];
  std::map<int, Eigen::Vector3d> points;
  for (const auto& [number, marker] : Calibration().markers) points[number] = marker.position;
  const auto located = LocateView(camera, views[fullest], points, Numbering::kByMarker);
  if (!located) return result;
  last_ = {camera.T_camera_rig.Inverse() * located->T_map_camera.Inverse(), std::move(views)};
  result.gain = evaluator_.Evaluate(last_->T_rig_target, last_->views);
  return result;
}

void PictureGainEvaluator::Keep(const std::string& frame) {
  if (!last_) return;
  const std::vector<View> views = std::move(last_->views);
  last_.reset();
  live_.Add(frame, views);
  evaluator_ = MakeEvaluator(live_.Suggested());
}

}  // namespace plenocal

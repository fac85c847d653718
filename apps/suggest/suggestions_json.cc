// SPDX-License-Identifier: Apache-2.0
#include "apps/suggest/suggestions_json.h"

#include <cmath>

namespace plenocal {
namespace {

using Json = nlohmann::json;

Json Matrix(const RigidTransform& T) {
  Json rows = Json::array();
  for (int r = 0; r < 3; ++r) rows.push_back({T.R(r, 0), T.R(r, 1), T.R(r, 2), T.t[r]});
  rows.push_back({0, 0, 0, 1});
  return rows;
}

Json Outlines(const NextView& view, const RigEstimate& rig) {
  constexpr double kPlaces = 100;  // of a pixel
  Json cameras = Json::object();
  for (const auto& [camera, outlines] : view.outlines) {
    Json drawn = Json::array();
    for (const auto& outline : outlines) {
      Json points = Json::array();
      for (const Eigen::Vector2d& u : outline) {
        points.push_back(
            {std::round(kPlaces * u.x()) / kPlaces, std::round(kPlaces * u.y()) / kPlaces});
      }
      drawn.push_back(std::move(points));
    }
    cameras[rig.bundle.cameras[camera].name] = std::move(drawn);
  }
  return cameras;
}

}  // namespace

Json SuggestionsJson(const SuggestedViews& suggested) {
  const NextViews& suggestions = suggested.views;
  const RigEstimate& rig = suggested.rig;
  constexpr double kDegrees = 57.29577951308232;
  Json views = Json::array();
  for (const NextView& view : suggestions.views) {
    const bool sigma = view.criterion == ViewCriterion::kSigma;
    const BundleCamera& camera = rig.bundle.cameras[view.pose.camera];
    Json seen = Json::array();
    for (const size_t c : view.cameras) seen.push_back(rig.bundle.cameras[c].name);
    views.push_back({{"words", NextViewText(view, rig, suggestions.lowered)},
                     {"camera", camera.name},
                     {"cameras", seen},
                     {"T_camera_target", Matrix(camera.T_camera_rig * view.T_rig_target)},
                     {"T_rig_target", Matrix(view.T_rig_target)},
                     {"distance", view.pose.distance},
                     {"tilt", kDegrees * view.pose.tilt},
                     {"criterion", sigma ? "sigma" : "undetermined"},
                     {"sigma_before", sigma ? Json(view.sigma_before) : Json()},
                     {"sigma_after", sigma ? Json(view.sigma_after) : Json()},
                     {"region", RegionName(view.region)},
                     {"region_sigma_before", sigma ? Json(view.region_before) : Json()},
                     {"region_sigma_after", sigma ? Json(view.region_after) : Json()},
                     {"outline", Outlines(view, rig)}});
  }
  Json bound;
  if (suggestions.bound) {
    bound = {{"words", ViewBoundText(suggestions)},
             {"sigma", suggestions.bound->sigma},
             {"further", suggestions.reached ? 0 : suggestions.bound->WholeFurther()},
             {"suggested", suggestions.suggested ? Json(*suggestions.suggested) : Json()}};
  }
  return {{"verdict", suggested.verdict ? Json(GradeName(suggested.verdict->grade)) : Json()},
          {"frames", suggestions.frames},
          {"sigma_now", suggestions.sigma},
          {"goal", suggestions.goal},
          {"of", suggestions.lowered.of},
          {"unit", suggestions.lowered.unit},
          {"reached", suggestions.reached},
          {"exhausted", suggestions.exhausted},
          {"bound", bound},
          {"distances", suggestions.distances},
          {"views", views}};
}

}  // namespace plenocal

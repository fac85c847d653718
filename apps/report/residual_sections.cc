// SPDX-License-Identifier: Apache-2.0
#include "apps/report/residual_sections.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/json/calibration_json.h"

namespace plenocal {
namespace {

using Json = nlohmann::json;

// Part of the noise that is left in residuals; the unknowns absorb the rest. Refined markers do not
// count, since they have as many priors.
double NoiseInResiduals(const CalibrationRecord& calibration) {
  double coordinates = 0, unknowns = 6.0 * static_cast<double>(calibration.frames.size());
  for (const CalibratedCamera& camera : calibration.cameras) {
    coordinates += 2.0 * camera.fit.points;
    for (size_t i = 0; i < camera.params.size(); ++i) unknowns += camera.Sigma(i) > 0 ? 1 : 0;
    for (const double sigma : camera.sigma_xi) unknowns += sigma > 0 ? 1 : 0;
  }
  return coordinates > unknowns ? 1 - unknowns / coordinates : 1;
}

// Coordinates of used residuals divided by their noise sigma, with the normal density.
Json Histogram(const CalibratedCamera& camera, double noise_left) {
  constexpr int kBins = 49;
  constexpr double kReach = 4.9;  // sigmas
  constexpr double kWidth = 2 * kReach / kBins;
  std::vector<int> counts(kBins, 0);
  int outside = 0, all = 0;
  const auto add = [&](double in_sigmas) {
    ++all;
    const double bin = std::floor((in_sigmas + kReach) / kWidth);
    if (bin >= 0 && bin < kBins) {
      ++counts[static_cast<size_t>(bin)];
    } else {
      ++outside;
    }
  };
  for (const ResidualRow& row : camera.residuals) {
    const double sigma = row.noise_sigma > 0 ? row.noise_sigma : camera.fit.noise_sigma;
    if (!row.used || !(sigma > 0)) continue;
    add(row.Error().x() / sigma);
    add(row.Error().y() / sigma);
  }
  Json middles = Json::array(), expected = Json::array();
  for (int bin = 0; bin < kBins; ++bin) {
    const double left = -kReach + bin * kWidth;
    const auto below = [&](double x) {
      return 0.5 * std::erfc(-x / std::sqrt(noise_left) / std::numbers::sqrt2);
    };
    middles.push_back(std::round(100 * (left + kWidth / 2)) / 100);
    expected.push_back(Short(all * (below(left + kWidth) - below(left))));
  }
  return {{"sigmas", middles},
          {"counts", counts},
          {"expected", expected},
          {"noise_left", Short(noise_left, 2)},
          {"outside", outside},
          {"coordinates", all}};
}

Json Sample(const CalibrationRecord& calibration,
            size_t c,
            const std::vector<double>& depths,
            size_t most_points) {
  const CalibratedCamera& camera = calibration.cameras[c];
  const size_t step =
      std::max<size_t>(1, (camera.residuals.size() + most_points - 1) / most_points);
  Json x = Json::array(), y = Json::array(), dx = Json::array(), dy = Json::array(),
       used = Json::array(), frame = Json::array(), marker = Json::array(), depth = Json::array();
  for (size_t i = 0; i < camera.residuals.size(); i += step) {
    const ResidualRow& row = camera.residuals[i];
    if (!row.Error().allFinite()) continue;
    x.push_back(std::round(row.values[0] * 10) / 10);
    y.push_back(std::round(row.values[1] * 10) / 10);
    dx.push_back(Short(row.Error().x()));
    dy.push_back(Short(row.Error().y()));
    used.push_back(row.used ? 1 : 0);
    frame.push_back(row.frame);
    marker.push_back(row.marker);
    depth.push_back(Short(depths[i]));
  }
  return {{"all", camera.residuals.size()},
          {"step", step},
          {"x", x},
          {"y", y},
          {"dx", dx},
          {"dy", dy},
          {"used", used},
          {"frame", frame},
          {"marker", marker},
          {"depth", depth}};
}

Json DepthHistogram(const CalibratedCamera& camera, const std::vector<double>& depths) {
  constexpr int kBins = 30;
  double nearest = std::numeric_limits<double>::infinity(), farthest = -nearest;
  for (size_t i = 0; i < depths.size(); ++i) {
    if (!camera.residuals[i].used) continue;
    nearest = std::min(nearest, depths[i]);
    farthest = std::max(farthest, depths[i]);
  }
  if (!(nearest <= farthest)) return nullptr;
  const double width = std::max((farthest - nearest) / kBins, 1e-9);
  std::vector<int> counts(kBins, 0);
  for (size_t i = 0; i < depths.size(); ++i) {
    if (!camera.residuals[i].used) continue;
    const int bin = static_cast<int>((depths[i] - nearest) / width);
    ++counts[static_cast<size_t>(std::clamp(bin, 0, kBins - 1))];
  }
  Json middles = Json::array();
  for (int bin = 0; bin < kBins; ++bin) middles.push_back(Short(nearest + (bin + 0.5) * width));
  return {{"middles", middles}, {"counts", counts}};
}

}  // namespace

Json SumsJson(const CalibratedCamera& camera, const char* key, const GroupOf& group_of) {
  struct Sums {
    int points = 0, rejected = 0;
    double square = 0;
  };
  std::map<int, Sums> groups;
  for (size_t i = 0; i < camera.residuals.size(); ++i) {
    const ResidualRow& row = camera.residuals[i];
    const int group = group_of(i);
    if (group < 0) continue;
    Sums& sums = groups[group];
    ++(row.used ? sums.points : sums.rejected);
    if (row.used) sums.square += row.Error().squaredNorm();
  }
  Json names = Json::array(), points = Json::array(), rejected = Json::array(), rms = Json::array();
  for (const auto& [group, sums] : groups) {
    names.push_back(group);
    points.push_back(sums.points);
    rejected.push_back(sums.rejected);
    rms.push_back(sums.points > 0 ? Short(std::sqrt(sums.square / sums.points)) : Json());
  }
  return {{key, names}, {"points", points}, {"rejected", rejected}, {"rms", rms}};
}

Json ResidualSections(const CalibrationRecord& calibration,
                      size_t c,
                      size_t most_points,
                      const std::vector<int>& lens_types) {
  const CalibratedCamera& camera = calibration.cameras[c];
  const std::vector<ResidualRow>& rows = camera.residuals;
  std::map<int, RigidTransform> T_camera_target;  // by frame
  std::vector<double> depths;
  depths.reserve(rows.size());
  for (const ResidualRow& row : rows) {
    auto T = T_camera_target.find(row.frame);
    if (T == T_camera_target.end()) {
      T = T_camera_target.emplace(row.frame, calibration.CameraFromTarget(c, row.frame)).first;
    }
    depths.push_back((T->second * calibration.markers.at(row.marker).position).z());
  }
  return {
      {"sample", Sample(calibration, c, depths, most_points)},
      {"field", FieldJson(camera)},
      {"histogram", Histogram(camera, NoiseInResiduals(calibration))},
      {"frames", SumsJson(camera, "frame", [&](size_t i) { return rows[i].frame; })},
      {"markers", SumsJson(camera, "marker", [&](size_t i) { return rows[i].marker; })},
      {"types",
       SumsJson(camera, "type", [&](size_t i) { return lens_types.empty() ? -1 : lens_types[i]; })},
      {"depth", DepthHistogram(camera, depths)}};
}

}  // namespace plenocal

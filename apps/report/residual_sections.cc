// SPDX-License-Identifier: Apache-2.0
#include "apps/report/residual_sections.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace plenocal {
namespace {

using Json = nlohmann::json;

/// Sums over the used observations of a frame, a marker or a lens type.
struct Sums {
  int points = 0, rejected = 0;
  double square = 0;
  Eigen::Vector2d sum{0, 0};

  void Add(const ResidualRow& row) {
    if (!row.used) {
      ++rejected;
      return;
    }
    ++points;
    square += row.Error().squaredNorm();
    sum += row.Error();
  }
  [[nodiscard]] double Rms() const { return points > 0 ? std::sqrt(square / points) : 0; }
};

Json SumsJson(const std::map<int, Sums>& groups, const char* key, auto name_of) {
  Json names = Json::array(), points = Json::array(), rejected = Json::array(), rms = Json::array(),
       mean_x = Json::array(), mean_y = Json::array();
  for (const auto& [group, sums] : groups) {
    names.push_back(name_of(group));
    points.push_back(sums.points);
    rejected.push_back(sums.rejected);
    rms.push_back(sums.points > 0 ? Short(sums.Rms()) : Json());
    mean_x.push_back(sums.points > 0 ? Short(sums.sum.x() / sums.points) : Json());
    mean_y.push_back(sums.points > 0 ? Short(sums.sum.y() / sums.points) : Json());
  }
  return {{key, names},
          {"points", points},
          {"rejected", rejected},
          {"rms", rms},
          {"mean_x", mean_x},
          {"mean_y", mean_y}};
}

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
    const int bin = static_cast<int>(std::floor((in_sigmas + kReach) / kWidth));
    if (bin < 0 || bin >= kBins) {
      ++outside;
    } else {
      ++counts[static_cast<size_t>(bin)];
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
  size_t without = 0;
  for (size_t i = 0; i < camera.residuals.size(); i += step) {
    const ResidualRow& row = camera.residuals[i];
    if (!row.Error().allFinite()) {
      ++without;
      continue;
    }
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
          {"without_prediction", without},
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
  if (!(nearest <= farthest)) return Json::object();
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

nlohmann::json Short(double value, int digits) {
  if (!std::isfinite(value)) return nullptr;
  if (value == 0) return 0;
  const double scale = std::pow(10, digits - 1 - std::floor(std::log10(std::abs(value))));
  // Dividing by a power of ten gives the double nearest to the short decimal number.
  return scale >= 1 ? std::round(value * scale) / scale
                    : std::round(value * scale) * std::round(1 / scale);
}

Json FieldJson(const ResidualField& field) {
  Json mean_x = Json::array(), mean_y = Json::array(), rms = Json::array();
  for (size_t cell = 0; cell < field.grid.Cells(); ++cell) {
    const bool any = field.points[cell] > 0;
    mean_x.push_back(any ? Short(field.mean[cell].x()) : Json());
    mean_y.push_back(any ? Short(field.mean[cell].y()) : Json());
    rms.push_back(any ? Short(std::sqrt(field.square[cell])) : Json());
  }
  return {{"columns", field.grid.Columns()},
          {"rows", field.grid.Rows()},
          {"points", field.points},
          {"mean_x", mean_x},
          {"mean_y", mean_y},
          {"rms", rms}};
}

Json ResidualSections(const CalibrationRecord& calibration,
                      size_t c,
                      size_t most_points,
                      const std::vector<int>& lens_types) {
  const CalibratedCamera& camera = calibration.cameras[c];
  std::map<int, Sums> frames, markers, types;
  std::map<int, RigidTransform> T_camera_target;  // by frame
  std::vector<double> depths;
  depths.reserve(camera.residuals.size());
  for (size_t i = 0; i < camera.residuals.size(); ++i) {
    const ResidualRow& row = camera.residuals[i];
    frames[row.frame].Add(row);
    markers[row.marker].Add(row);
    if (!lens_types.empty() && lens_types[i] >= 0) types[lens_types[i]].Add(row);
    auto T = T_camera_target.find(row.frame);
    if (T == T_camera_target.end()) {
      T = T_camera_target.emplace(row.frame, calibration.CameraFromTarget(c, row.frame)).first;
    }
    depths.push_back((T->second * calibration.markers.at(row.marker).position).z());
  }
  return {{"sample", Sample(calibration, c, depths, most_points)},
          {"field", FieldJson(FieldOf(camera))},
          {"histogram", Histogram(camera, NoiseInResiduals(calibration))},
          {"frames", SumsJson(frames, "frame", [](int frame) { return frame; })},
          {"markers", SumsJson(markers, "marker", [](int marker) { return marker; })},
          {"types", SumsJson(types, "type", [](int type) { return type; })},
          {"depth", DepthHistogram(camera, depths)}};
}

}  // namespace plenocal

// SPDX-License-Identifier: Apache-2.0
#include "assess/compare_calibrations.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <limits>
#include <map>

#include "calib/base/format_error.h"
#include "calib/base/names.h"

namespace plenocal {
namespace {

// Gives a camera another name, in the correlations too.
void Rename(const std::string& from, const std::string& to, CalibrationRecord* calibration) {
  const auto camera = std::ranges::find(calibration->cameras, from, &CalibratedCamera::name);
  camera->name = to;
  for (std::string& name : calibration->correlations.names) {
    if (name.starts_with(from + ".")) name.replace(0, from.size(), to);
  }
}

// Names of the cameras that are not among `others`.
std::vector<std::string> NamesWithout(const std::vector<CalibratedCamera>& cameras,
                                      const std::vector<CalibratedCamera>& others) {
  std::vector<std::string> names;
  for (const CalibratedCamera& camera : cameras) {
    if (std::ranges::find(others, camera.name, &CalibratedCamera::name) == others.end()) {
      names.push_back(camera.name);
    }
  }
  return names;
}

// An exact calibration has no correlations.
bool HasCorrelations(const CalibrationRecord& calibration) {
  return !calibration.correlations.names.empty() ||
         std::ranges::all_of(calibration.cameras, [](const CalibratedCamera& camera) {
           return camera.covariance.isZero(0) && camera.sigma_xi.isZero(0);
         });
}

}  // namespace

void RenameCameras(const std::vector<std::string>& map,
                   const std::vector<std::string_view>& others,
                   CalibrationRecord* calibration) {
  // Copies, since cameras are renamed below.
  const std::vector<std::string_view> before = NamesOf(calibration->cameras);
  const std::vector<std::string> own(before.begin(), before.end());
  const auto require = [](const std::string& entry, const std::string& name, const auto& names) {
    if (std::ranges::find(names, name) != names.end()) return;
    const std::vector<std::string_view> known(names.begin(), names.end());
    throw InputError("--map {}: no camera '{}'{}", entry, name, SuggestName(name, known));
  };
  std::map<std::string, std::string> renamed;  // own name -> new one
  for (const std::string& entry : map) {
    const size_t equals = entry.find('=');
    if (equals == std::string::npos) {
      throw InputError(
          "--map {}: expected NAME=NAME, a camera of the first file and its "
          "counterpart",
          entry);
    }
    const std::string other = entry.substr(0, equals), name = entry.substr(equals + 1);
    require(entry, other, others);
    require(entry, name, own);
    if (!renamed.emplace(name, other).second) {
      throw InputError("--map {}: '{}' stands twice", entry, name);
    }
  }
  for (const auto& [name, other] : renamed) {
    if (std::ranges::find(own, other) == own.end() || renamed.contains(other)) continue;
    throw InputError("--map {}={}: {} has a camera '{}' already; map that one too",
                     other,
                     name,
                     calibration->path.string(),
                     other);
  }
  // By way of names that no camera has, since names may be exchanged.
  for (const auto& [name, other] : renamed) Rename(name, "=" + other, calibration);
  for (const auto& [name, other] : renamed) Rename("=" + other, other, calibration);
}

std::string MapSuggestion(const std::vector<std::string>& a, const std::vector<std::string>& b) {
  std::vector<std::string> pairs;
  for (size_t c = 0; c < std::min(a.size(), b.size()); ++c) {
    pairs.push_back(fmt::format("{}={}", a[c], b[c]));
  }
  return fmt::format("name counterparts by --map, for instance --map {}", fmt::join(pairs, ","));
}

CalibrationComparison CompareCalibrations(const CalibrationRecord& a,
                                          const CalibrationRecord& b,
                                          std::vector<double> distances) {
  if (distances.empty()) distances = {1, std::numeric_limits<double>::infinity()};
  for (const double distance : distances) {
    if (!(distance > 0)) {
      throw InputError("distances: expected positive numbers of metres, or inf, found {}",
                       distance);
    }
  }
  CalibrationComparison comparison;
  for (const CalibratedCamera& camera : a.cameras) {
    const bool single = a.cameras.size() == 1 && b.cameras.size() == 1;
    const auto other = std::ranges::find_if(b.cameras, [&](const CalibratedCamera& each) {
      return single || each.name == camera.name;
    });
    if (other == b.cameras.end()) continue;
    comparison.a.push_back(camera);
    comparison.b.push_back(*other);
    comparison.differences.push_back(CompareCameras(camera, *other, distances));
  }
  comparison.only_a = NamesWithout(a.cameras, comparison.a);
  comparison.only_b = NamesWithout(b.cameras, comparison.b);
  if (comparison.a.empty()) {
    throw InputError("{}: has no camera of the other calibration; {}",
                     b.path.string(),
                     MapSuggestion(comparison.only_a, comparison.only_b));
  }
  comparison.has_correlations = HasCorrelations(a) && HasCorrelations(b);
  const auto counterparts = [&](size_t c) {
    return Counterparts{comparison.a[c], comparison.b[c], comparison.differences[c]};
  };
  for (size_t c = 1; c < comparison.a.size(); ++c) {
    comparison.extrinsics.push_back(
        CompareExtrinsics(counterparts(0), counterparts(c), a.correlations, b.correlations));
  }
  return comparison;
}

}  // namespace plenocal

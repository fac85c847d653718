// SPDX-License-Identifier: Apache-2.0
//
// Acceptance of a calibration by lengths that are known, after VDI/VDE 2634 part 1 (docs/space.md).
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "calib/files/scene_keys.h"
#include "calib/io/output_folder.h"
#include "engine/rigs/triangulate_points.h"

namespace plenocal {

/// A length between two points, from its calibration certificate.
struct ReferenceLength {
  std::string line;    ///< of the measuring line on which it lies
  ScenePosition a, b;  ///< its ends
  double length = 0;   ///< at the temperature of the test, m
  double sigma = 0;    ///< m; 0: exact

  [[nodiscard]] std::string Of() const { return a.name + " - " + b.name; }
};

/// bars.yaml.
struct AcceptanceTest {
  /// The limit of a deviation: least of constant + per_metre L and at_most, m.
  double constant = 0, per_metre = 0;
  std::optional<double> at_most;
  bool guarded = true;  ///< the limit less two standard deviations of the reference length
  bool bundle = false;  ///< all frames together, as the guideline has it; else each by itself
  std::vector<ReferenceLength> lengths;

  [[nodiscard]] double LimitOf(const ReferenceLength& length) const;
};

/// Throws `Error` of kind kInput with file, line and key.
AcceptanceTest ReadAcceptanceTest(const std::filesystem::path& path);

struct AcceptedLength {
  const ReferenceLength* reference = nullptr;  ///< of the test
  std::string frame;
  double measured = 0, sigma = 0;  ///< with its standard error by noise and calibration, m
  double limit = 0;                ///< m

  [[nodiscard]] double Deviation() const { return measured - reference->length; }
  [[nodiscard]] bool Passes() const { return std::abs(Deviation()) <= limit; }
  /// Deviation over its standard error, with that of the reference.
  [[nodiscard]] double InSigmas() const;
};

struct Acceptance {
  std::vector<AcceptedLength> lengths;  ///< each of each frame that shows it
  bool passes = false;                  ///< all of them do
  std::vector<std::string> lacks;       ///< requirements of the guideline that are not met
  double largest = 0, rms = 0;          ///< of the deviations, m
  int lines = 0;
  Eigen::Vector3d volume{0, 0, 0};  ///< sides of the box around all ends in the rig's frame, m
  /// Of all deviations by their joint covariance: whether the stated standard errors hold.
  double chi_square = 0, probability = 1;
  double scale = 0, scale_sigma = 0;  ///< relative deviation that all lengths share
  std::vector<Finding> findings;
  std::vector<std::string> left_out;  ///< lengths that no frame shows
};

/// `made`: the points of the images, in the rig's frame. Throws `Error` of kind kJob when no frame
/// shows a length.
Acceptance AcceptLengths(const AcceptanceTest& test, const Triangulation& made);

/// Content of acceptance.json.
nlohmann::json AcceptanceJson(const Acceptance& acceptance);
/// acceptance.csv and acceptance.json (docs/formats.md).
OutputContents AcceptanceFiles(const Acceptance& acceptance);
/// Pass or fail, and why, some lines.
std::string AcceptanceText(const Acceptance& acceptance);

}  // namespace plenocal

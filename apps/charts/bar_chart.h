// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace plenocal {

/// One metric of all runs, lower is better.
struct BarPanel {
  std::string title;
  double base;  ///< value of a perfect run, where the bars begin
  /// One a run: nothing where the run has no such metric; infinite where it failed.
  std::vector<std::optional<double>> values;
};

/// Panels side by side, the same runs in each.
struct BarChart {
  std::vector<std::string> runs;
  std::vector<BarPanel> panels;
};

enum class PictureFormat { kSvg, kPng };

/// The content of a picture file. As in the paper's figure the bar of a failed run reaches the
/// upper border; here it is hatched and says so as well.
std::string DrawBarChart(const BarChart& chart, PictureFormat format);

}  // namespace plenocal

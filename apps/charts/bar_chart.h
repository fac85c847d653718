// SPDX-License-Identifier: Apache-2.0
//
// Bar charts that compare metrics of several runs.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "apps/charts/picture.h"

namespace plenocal {

/// One metric of all runs, lower is better.
struct BarPanel {
  std::string title;
  double base;  ///< value of a perfect run, where the bars begin
  /// One per run: nothing where the run has no such metric; infinite where it failed.
  std::vector<std::optional<double>> values;
};

/// Panels side by side, the same runs in each.
struct BarChart {
  std::vector<std::string> runs;
  std::vector<BarPanel> panels;
};

/// The content of a picture file. The bar of a failed run is hatched, reaches the upper border and
/// is labelled.
std::string DrawBarChart(const BarChart& chart, PictureFormat format);

}  // namespace plenocal

// SPDX-License-Identifier: Apache-2.0
//
// Seconds in which a model's example camera projects the points of a file (64-bit x y z), best of
// 15:
//   project_points MODEL FILE
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <vector>

#include "models/registry.h"

int main(int argc, char** argv) {
  using Clock = std::chrono::steady_clock;
  if (argc != 3) return 2;
  const plenocal::CameraModel* const model = plenocal::FindModel(plenocal::CameraModels(), argv[1]);
  std::vector<Eigen::Vector3d> points(std::filesystem::file_size(argv[2]) / sizeof(points[0]));
  std::ifstream file(argv[2], std::ios::binary);
  if (model == nullptr || points.empty() ||
      !file.read(reinterpret_cast<char*>(points.data()),
                 static_cast<std::streamsize>(points.size() * sizeof(points[0])))) {
    return 2;
  }
  constexpr int kRepetitions = 15;
  double best = std::numeric_limits<double>::infinity(), sum = 0;
  for (int i = 0; i < kRepetitions; ++i) {
    const auto start = Clock::now();
    // New memory each time, as an array that is returned.
    const std::unique_ptr<double[]> pixels(new double[2 * points.size()]);
    std::array<double, plenocal::kMaxObservationSize> values{};
    for (size_t k = 0; k < points.size(); ++k) {
      model->Project(model->example.data(),
                     model->example_config.data(),
                     values.data(),
                     points[k],
                     pixels.get() + 2 * k);
    }
    best = std::min(best, std::chrono::duration<double>(Clock::now() - start).count());
    sum += pixels[0];  // so that nothing is left out
  }
  fmt::print("{}\n", sum == 0 ? 0 : best);
}

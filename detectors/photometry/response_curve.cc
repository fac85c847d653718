// SPDX-License-Identifier: Apache-2.0
#include "detectors/photometry/response_curve.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <string_view>
#include <vector>

#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "calib/io/input_file.h"

namespace plenocal {
namespace {

constexpr double kFullScale = 255;

std::vector<std::string_view> WordsOf(std::string_view text) {
  std::vector<std::string_view> words;
  while (true) {
    const size_t first = text.find_first_not_of(" \t\r\n");
    if (first == std::string_view::npos) return words;
    text.remove_prefix(first);
    const size_t length = std::min(text.find_first_of(" \t\r\n"), text.size());
    words.push_back(text.substr(0, length));
    text.remove_prefix(length);
  }
}

[[noreturn]] void Refuse(const std::filesystem::path& path, const std::string& message) {
  throw InputError(
      "{}: {}; a response holds 256 numbers in one row, light by grey value, "
      "as 'plenocal response' writes it",
      path.string(),
      message);
}

}  // namespace

ResponseCurve::ResponseCurve() {
  for (size_t k = 0; k < kValues; ++k) light_[k] = static_cast<double>(k);
}

ResponseCurve::ResponseCurve(const Table& light) {
  const double zero = light.front(), scale = kFullScale / (light.back() - zero);
  for (size_t k = 0; k < kValues; ++k) light_[k] = (light[k] - zero) * scale;
}

double ResponseCurve::Slope(std::size_t grey) const {
  const size_t low = grey == 0 ? 0 : grey - 1, high = std::min(grey + 1, kValues - 1);
  return (light_[high] - light_[low]) / static_cast<double>(high - low);
}

ResponseCurve::Borders ResponseCurve::MakeBorders() const {
  Borders borders;
  for (size_t k = 0; k + 1 < kValues; ++k) {
    const double a = light_[k], b = light_[k + 1];
    borders[k] = (a + b) / 2;
    if (k == 0 || k + 2 == kValues) continue;
    const double cubic = (9 * (a + b) - light_[k - 1] - light_[k + 2]) / 16;
    if (cubic > a && cubic < b) borders[k] = cubic;
  }
  return borders;
}

ResponseCurve ReadResponse(const std::filesystem::path& path) {
  const std::string text = ReadTextFile(path, InputLimit::kDocument);
  const std::vector<std::string_view> words = WordsOf(text);
  if (words.size() != ResponseCurve::kValues) {
    Refuse(path, fmt::format("expected 256 numbers, found {}", words.size()));
  }
  ResponseCurve::Table light;
  for (size_t k = 0; k < words.size(); ++k) {
    const std::optional<double> value = ParseDouble(words[k]);
    if (!value || !std::isfinite(*value)) {
      Refuse(path, fmt::format("value {}: expected a number, found '{}'", k, words[k]));
    }
    light[k] = *value;
    if (k > 0 && !(light[k] > light[k - 1])) {
      Refuse(path,
             fmt::format(
                 "value {} ({}) does not exceed the one before ({})", k, light[k], light[k - 1]));
    }
  }
  if (!std::isnormal(kFullScale / (light.back() - light.front()))) {
    Refuse(path, fmt::format("its values, {} to {}, have no scale", light.front(), light.back()));
  }
  return ResponseCurve(light);
}

std::string PcalibText(const ResponseCurve& response) {
  std::string text;
  for (size_t k = 0; k < ResponseCurve::kValues; ++k) {
    text += fmt::format("{}{:.9g}", k == 0 ? "" : " ", response.Light(k));
  }
  return text + '\n';
}

cv::Mat LightOf(const cv::Mat& image, const ResponseCurve& response) {
  cv::Mat table(1, static_cast<int>(ResponseCurve::kValues), CV_32F);
  for (size_t k = 0; k < ResponseCurve::kValues; ++k) {
    table.at<float>(static_cast<int>(k)) = static_cast<float>(response.Light(k));
  }
  cv::Mat light;
  cv::LUT(image, table, light);
  return light;
}

}  // namespace plenocal

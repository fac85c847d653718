// SPDX-License-Identifier: Apache-2.0
#include "apps/photometry/attenuation_compare.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "apps/report/page.h"
#include "calib/base/format_error.h"
#include "detectors/images/image.h"

namespace plenocal {
namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

// The mean of several positions.
struct RowSum {
  double count = 0, x = 0, first = 0, second = 0, variance = 0;

  void Add(double at, double a, double b, double sigma) {
    count += 1;
    x += at;
    first += a;
    second += b;
    variance += sigma * sigma;
  }
  // Neighbouring positions have the same error, so the mean of many is not better known than one.
  [[nodiscard]] AttenuationComparison::Row Mean() const {
    return {x / count, first / count, second / count, std::sqrt(variance / count)};
  }
};

nlohmann::json RowsJson(const std::vector<AttenuationComparison::Row>& rows) {
  nlohmann::json x, first, second, sigma;
  for (const AttenuationComparison::Row& row : rows) {
    x.push_back(row.x);
    first.push_back(row.first);
    second.push_back(row.second);
    sigma.push_back(std::isnan(row.sigma) ? nlohmann::json() : nlohmann::json(row.sigma));
  }
  return {{"x", x}, {"first", first}, {"second", second}, {"sigma", sigma}};
}

void AppendRows(const std::string& section,
                const std::vector<AttenuationComparison::Row>& rows,
                std::string* text) {
  for (const AttenuationComparison::Row& row : rows) {
    const auto [x, first, second, sigma] = row;
    *text +=
        fmt::format("{},{:.6g},{:.7g},{:.7g},{:.7g},", section, x, first, second, first / second);
    *text += std::isnan(sigma) ? "\n" : fmt::format("{:.4g}\n", sigma);
  }
}

Attenuation ReadAttenuationWithSigma(const std::filesystem::path& path) {
  Attenuation attenuation{ReadAttenuation(path), {}};
  double least = 0;
  cv::minMaxLoc(attenuation.values, &least);
  if (!(least > 0)) {
    throw InputError(
        "{}: has values that are not positive; an attenuation is the share of "
        "light that reaches each pixel",
        path.string());
  }
  constexpr std::string_view kPrefix = "vignetting_";
  const std::string name = path.filename().string();
  if (!name.starts_with(kPrefix)) return attenuation;
  const std::filesystem::path beside =
      path.parent_path() / fmt::format("vignetting_sigma_{}", name.substr(kPrefix.size()));
  if (!std::filesystem::exists(beside)) return attenuation;
  attenuation.sigma = ReadAttenuation(beside);
  if (attenuation.sigma.size() != attenuation.values.size()) {
    throw InputError("{}: has another size than {}", beside.string(), path.string());
  }
  return attenuation;
}

}  // namespace

AttenuationComparison CompareAttenuations(const Attenuation& first, const Attenuation& second) {
  const cv::Mat &a = first.values, &b = second.values;
  double logs = 0;
  for (int y = 0; y < a.rows; ++y) {
    for (int x = 0; x < a.cols; ++x) logs += std::log(a.at<float>(y, x) / b.at<float>(y, x));
  }
  const double factor = std::exp(logs / static_cast<double>(a.total()));
  const auto sigma_at = [&](int x, int y) -> double {
    if (first.sigma.empty() || second.sigma.empty()) return kUnknown;
    return std::hypot(first.sigma.at<float>(y, x), second.sigma.at<float>(y, x));
  };
  constexpr int kSteps = 100;  // of the radius
  const double radius = std::hypot(a.cols, a.rows) / 2;
  std::vector<RowSum> radial(kSteps);
  AttenuationComparison comparison;
  double squares = 0, variances = 0, chi_square = 0;
  for (int y = 0; y < a.rows; ++y) {
    for (int x = 0; x < a.cols; ++x) {
      const double v = a.at<float>(y, x), w = b.at<float>(y, x) * factor, sigma = sigma_at(x, y);
      const double difference = v / w - 1;
      squares += difference * difference;
      variances += sigma * sigma;
      chi_square += difference * difference / (sigma * sigma);
      comparison.largest = std::max(comparison.largest, std::abs(difference));
      const double r = std::hypot(x - (a.cols - 1) / 2.0, y - (a.rows - 1) / 2.0);
      const auto step = static_cast<size_t>(r / radius * kSteps);
      radial[std::min<size_t>(step, kSteps - 1)].Add(r, v, w, sigma);
      if (y == a.rows / 2) comparison.middle_row.push_back({static_cast<double>(x), v, w, sigma});
    }
  }
  const auto count = static_cast<double>(a.total());
  comparison.rms = std::sqrt(squares / count);
  comparison.expected = std::sqrt(variances / count);
  comparison.chi_square = chi_square / count;
  // The last rings are a few pixels in the corners.
  constexpr double kFewest = 50;
  for (const RowSum& ring : radial) {
    if (ring.count > 0) comparison.radial.push_back(ring.Mean());
    if (ring.count >= kFewest) comparison.border = ring.Mean();
  }
  return comparison;
}

std::string ComparisonCsv(const AttenuationComparison& comparison) {
  std::string text = "section,x,first,second,ratio,sigma\n";
  AppendRows("row", comparison.middle_row, &text);
  AppendRows("radial", comparison.radial, &text);
  return text;
}

std::string ComparisonText(const AttenuationComparison& comparison,
                           const std::string& first,
                           const std::string& second) {
  const bool known = !std::isnan(comparison.expected);
  const AttenuationComparison::Row& border = comparison.border;
  return fmt::format(
      "{} against {}: RMS {:.3f} %{}, largest {:.3f} %\n"
      "  in the corners {:+.3f} %{}\n",
      first,
      second,
      100 * comparison.rms,
      known ? fmt::format(" (by noise {:.3f} %)", 100 * comparison.expected) : "",
      100 * comparison.largest,
      100 * (border.first / border.second - 1),
      known ? fmt::format(" +- {:.3f} %", 100 * border.sigma) : "");
}

nlohmann::json ComparisonJson(const AttenuationComparison& comparison,
                              const std::string& first,
                              const std::string& second) {
  return {{"first", first},
          {"second", second},
          {"rms", comparison.rms},
          {"largest", comparison.largest},
          {"row", RowsJson(comparison.middle_row)},
          {"radial", RowsJson(comparison.radial)}};
}

std::string ComparisonPage(const AttenuationComparison& comparison,
                           const std::string& first,
                           const std::string& second) {
  PageText text;
  text.Paragraph(ComparisonText(comparison, first, second));
  return MakePage("Two vignettings",
                  text,
                  {{"kind", "photometry"},
                   {"camera", first + ", " + second},
                   {"headline", ""},
                   {"findings", nlohmann::json::array()},
                   {"comparison", ComparisonJson(comparison, first, second)}});
}

bool IsAttenuation(const std::filesystem::path& path) {
  return path.extension() == ".tiff" || path.extension() == ".tif";
}

AttenuationComparison CompareAttenuationFiles(const std::filesystem::path& first,
                                              const std::filesystem::path& second) {
  const Attenuation a = ReadAttenuationWithSigma(first), b = ReadAttenuationWithSigma(second);
  if (a.values.size() == b.values.size()) return CompareAttenuations(a, b);
  throw InputError("{} is {} x {} pixels, {} is {} x {}; they must be of one camera",
                   first.string(),
                   a.values.cols,
                   a.values.rows,
                   second.string(),
                   b.values.cols,
                   b.values.rows);
}

}  // namespace plenocal

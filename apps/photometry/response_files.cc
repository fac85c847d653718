// SPDX-License-Identifier: Apache-2.0
#include "apps/photometry/response_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "apps/photometry/images/exposed_images.h"
#include "apps/report/page.h"
#include "calib/base/error.h"
#include "calib/base/number_text.h"
#include "calib/base/parallel.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"
#include "detectors/images/image.h"

namespace plenocal {
namespace {

using Json = nlohmann::json;

constexpr double kWantedPixels = 50000;
constexpr std::uint8_t kSaturated = 255;

// Values of an image at every `step`-th pixel in both directions.
struct SampledImage {
  std::vector<std::uint8_t> grey;
  std::vector<bool> near_full;  // one of the neighbours is saturated
};

SampledImage SampleImage(const cv::Mat& image, int step) {
  constexpr int kReach = 2;  // px, as far as charge of a full pixel flows
  cv::Mat neighbours = cv::Mat::ones(2 * kReach + 1, 2 * kReach + 1, CV_8U), around;
  neighbours.at<std::uint8_t>(kReach, kReach) = 0;
  cv::dilate(image == kSaturated, around, neighbours);
  SampledImage sampled;
  for (int y = step / 2; y < image.rows; y += step) {
    for (int x = step / 2; x < image.cols; x += step) {
      sampled.grey.push_back(image.at<std::uint8_t>(y, x));
      sampled.near_full.push_back(around.at<std::uint8_t>(y, x) != 0);
    }
  }
  return sampled;
}

// Charge flows from pixels with much more light than they hold, which are full at half the exposure
// too. Neighbours that are just not full would choose pixels by their light.
void SetBesideSaturated(const std::vector<std::vector<bool>>& near_full, ExposureSweep* sweep) {
  constexpr double kMuchMore = 2;
  for (const double exposure : sweep->exposures) {
    std::optional<size_t> longest;
    for (size_t i = 0; i < near_full.size(); ++i) {
      if (sweep->exposures[i] > exposure / kMuchMore) continue;
      if (!longest || sweep->exposures[i] > sweep->exposures[*longest]) longest = i;
    }
    sweep->beside_saturated.push_back(longest ? near_full[*longest]
                                              : std::vector<bool>(sweep->grey[0].size()));
  }
}

}  // namespace

ExposureSweep ReadExposureSweep(const Recording& recording,
                                const RecordedCamera& camera,
                                int threads,
                                const ImageProgress& progress,
                                std::vector<LeftOut>* left_out) {
  const std::vector<double> exposures =
      ExposuresOf(recording, camera, "as cameras and TUM monoVO recordings do");
  const double pixels = static_cast<double>(camera.image_size[0]) * camera.image_size[1];
  const int step = std::max(1, static_cast<int>(std::lround(std::sqrt(pixels / kWantedPixels))));
  const size_t count = camera.images.size();
  std::vector<SampledImage> sampled(count);
  std::vector<std::optional<Error>> failures(count);
  std::atomic<size_t> done = 0;
  ParallelFor(count, threads, [&](size_t i) {
    try {
      sampled[i] = SampleImage(ReadExposed(camera, i), step);
    } catch (const Error& error) {
      failures[i] = error;
    }
    if (!progress(++done, count)) throw Stopped();
  });
  ExposureSweep sweep;
  std::vector<std::vector<bool>> near_full;
  for (size_t i = 0; i < count; ++i) {
    if (failures[i]) {
      left_out->push_back(
          {.where = camera.images[i].path.string(),
           .reason = WithoutPath(failures[i]->what(), camera.images[i].path.string()),
           .whole = true,
           .camera = camera.name,
           .frame = camera.images[i].frame});
      continue;
    }
    sweep.frames.push_back(camera.images[i].frame);
    sweep.exposures.push_back(exposures[i]);
    sweep.grey.push_back(std::move(sampled[i].grey));
    near_full.push_back(std::move(sampled[i].near_full));
  }
  if (sweep.grey.empty()) throw Error(*failures[0]);
  SetBesideSaturated(near_full, &sweep);
  return sweep;
}

std::vector<std::string> FindingsOf(const ResponseEstimate& estimate, const ExposureSweep& sweep) {
  std::vector<std::string> findings;
  // The borders of the values beyond are covered by saturated pixels and by noise about zero.
  constexpr int kLowest = 5, kHighest = 250;
  if (estimate.first > kLowest || estimate.last < kHighest) {
    findings.push_back(fmt::format(
        "grey values below {} or above {} were hardly seen and are extrapolated; add shorter and "
        "longer exposures",
        estimate.first + 1,
        estimate.last));
  }
  std::vector<double> sizes;
  for (const double error : estimate.exposure_errors) sizes.push_back(std::abs(error));
  // A flickering lamp or a shutter that is not exact scatter; a step of the gain stands out.
  const double sigma = std::max(kSigmaPerMad * Median(sizes), 1e-3);
  constexpr double kFarOff = 5;
  std::vector<std::string> off;
  for (size_t i = 0; i < sizes.size(); ++i) {
    if (sizes[i] > kFarOff * sigma) {
      off.push_back(
          fmt::format("{} ({:+.1f} %)", sweep.frames[i], 100 * estimate.exposure_errors[i]));
    }
  }
  if (!off.empty()) {
    const size_t shown = std::min<size_t>(off.size(), 5);
    findings.push_back(
        fmt::format("{} brighter or darker than exposure and other images have it: {}{}; the gain "
                    "must be fixed and the lamp must not flicker",
                    Counted(off.size(), "image is", "images are"),
                    fmt::join(off.begin(), off.begin() + static_cast<std::ptrdiff_t>(shown), ", "),
                    shown < off.size() ? ", ..." : ""));
  }
  constexpr double kManyMoving = 0.02;
  if (static_cast<double>(estimate.moving) >
      kManyMoving * static_cast<double>(estimate.moving + estimate.pixels)) {
    findings.push_back(fmt::format("{:.1f} % of the pixels were left out: the scene moved there",
                                   100.0 * static_cast<double>(estimate.moving) /
                                       static_cast<double>(estimate.moving + estimate.pixels)));
  }
  return findings;
}

std::string ResponseCsv(const ResponseEstimate& estimate) {
  std::string text = "value,U,sigma,count\n";
  for (size_t k = 0; k < ResponseCurve::kValues; ++k) {
    const double sigma = estimate.sigma[k];
    const std::string known = std::isnan(sigma) ? "" : fmt::format("{:.4g}", sigma);
    text += fmt::format("{},{:.9g},{},{}\n", k, estimate.curve.Light(k), known, estimate.count[k]);
  }
  return text;
}

namespace {

double LargestSigma(const ResponseEstimate& estimate) {
  double largest = 0;
  for (const double sigma : estimate.sigma) {
    if (!std::isnan(sigma)) largest = std::max(largest, sigma);
  }
  return largest;
}

}  // namespace

std::string ResponseSummary(const ResponseEstimate& estimate, const std::string& camera) {
  const double largest = LargestSigma(estimate);
  const double electrons = estimate.noise.gain > 0 ? 255 / estimate.noise.gain : 0;
  return fmt::format(
      "{}: response from {} at {}\n"
      "  grey values {} to {} measured, sigma up to {:.3f} % of full scale\n"
      "  noise of a pixel: full at {:.0f} electrons, read noise {:.3f} % of full scale\n"
      "  single exposures are wrong by {:.2f} %\n",
      camera,
      Counted(estimate.pixels, "pixel"),
      Counted(estimate.exposure_errors.size(), "exposure"),
      estimate.first + 1,
      estimate.last,
      100 * largest / 255,
      electrons,
      100 * estimate.noise.read / 255,
      100 * estimate.exposure_sigma);
}

std::string ResponsePage(const ResponseEstimate& estimate,
                         const ExposureSweep& sweep,
                         const std::string& camera,
                         const std::vector<std::string>& findings) {
  Json sigma = Json::array();
  for (const double value : estimate.sigma) {
    sigma.push_back(std::isnan(value) ? Json() : Json(value));
  }
  const std::string headline =
      fmt::format("Light by grey value: standard deviation up to {} % of full scale",
                  BriefNumber(100 * LargestSigma(estimate) / 255, 2));
  PageText text;
  text.Paragraph(camera);
  text.Box(findings.empty() ? "good" : "usable", headline, findings);
  const Json data{{"kind", "photometry"},
                  {"camera", camera},
                  {"headline", headline},
                  {"findings", findings},
                  {"response",
                   {{"U", estimate.curve.Values()},
                    {"sigma", sigma},
                    {"count", estimate.count},
                    {"gain", estimate.noise.gain},
                    {"read", estimate.noise.read},
                    {"rms", estimate.rms},
                    {"pixels", estimate.pixels},
                    {"moving", estimate.moving},
                    {"exposure_sigma", estimate.exposure_sigma},
                    {"frames", sweep.frames},
                    {"exposures", sweep.exposures},
                    {"exposure_errors", estimate.exposure_errors}}}};
  return MakePage("Response of a camera", text, data);
}

}  // namespace plenocal

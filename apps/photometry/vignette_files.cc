// SPDX-License-Identifier: Apache-2.0
#include "apps/photometry/vignette_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>

#include "apps/photometry/images/exposed_images.h"
#include "apps/report/page.h"
#include "calib/base/number_text.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"
#include "detectors/images/image.h"

namespace plenocal {
namespace {

using Json = nlohmann::json;

// Means of the cells of a coarse grid, row by row.
Json CellsJson(const cv::Mat& image) {
  constexpr int kColumns = 32;
  const int rows = std::max(1, kColumns * image.rows / image.cols);
  cv::Mat cells;
  cv::resize(image, cells, {kColumns, rows}, 0, 0, cv::INTER_AREA);
  return {{"columns", kColumns},
          {"rows", rows},
          {"values", std::vector<float>(cells.begin<float>(), cells.end<float>())}};
}

// The middle row or column.
Json SectionJson(const VignetteEstimate& estimate, bool row) {
  const auto section = [row](const cv::Mat& image) {
    const cv::Mat line =
        row ? image.row(image.rows / 2).clone() : image.col(image.cols / 2).clone();
    return std::vector<float>(line.begin<float>(), line.end<float>());
  };
  return {{"values", section(estimate.attenuation)}, {"sigma", section(estimate.sigma)}};
}

// The wall's brightness, 0 where it was not seen; y of the wall points up.
cv::Mat WallPicture(const VignetteEstimate& estimate) {
  cv::Mat wall;
  cv::flip(estimate.wall, wall, 0);
  cv::patchNaNs(wall, 0);
  return wall;
}

double MeanSigma(const cv::Mat& sigma) { return std::sqrt(cv::mean(sigma.mul(sigma))[0]); }

}  // namespace

std::string ExposuresCsv(const VignetteEstimate& estimate,
                         const std::string& camera,
                         const std::vector<std::string>& frames,
                         const std::vector<double>& exposures) {
  std::string text = kExposuresHead;
  for (size_t i = 0; i < frames.size(); ++i) {
    const double gain = estimate.gains[i];
    text += ExposureRow(frames[i], camera, exposures[i] * gain, gain - 1, estimate.gain_sigma[i]);
  }
  return text;
}

std::vector<std::string> FindingsOf(const VignetteEstimate& estimate,
                                    const std::vector<std::string>& frames) {
  std::vector<std::string> findings;
  for (const std::string& frame : estimate.misplaced) {
    findings.push_back(fmt::format(
        "{} shows another part of the wall than the pose from its marker predicts, and "
        "is left out: the tilt of a small marker is ambiguous; use a larger one, or go nearer",
        frame));
  }
  // Gains that are wrong stand out from their median, which has the error that all share.
  const double usual = Median(estimate.gains);
  std::vector<double> distances;
  for (const double gain : estimate.gains) distances.push_back(std::abs(gain - usual));
  constexpr double kFarOff = 5, kLeast = 0.005;
  const double limit = std::max(kFarOff * kSigmaPerMad * Median(distances), kLeast);
  std::vector<std::string> off;
  for (size_t i = 0; i < frames.size(); ++i) {
    if (distances[i] > std::max(limit, kFarOff * estimate.gain_sigma[i])) {
      off.push_back(fmt::format("{} ({:+.1f} %)", frames[i], 100 * (estimate.gains[i] - usual)));
    }
  }
  if (!off.empty() && 2 * off.size() < frames.size()) {
    findings.push_back(
        fmt::format("exposures differ from those recorded in {}; exposures.csv has "
                    "them",
                    fmt::join(off, ", ")));
  }
  for (const OpenMode& open : estimate.open) {
    findings.push_back(
        fmt::format("{} of the vignetting is known to {:.1f} % only; turn the camera by 90 degrees "
                    "about its axis in some images, and give exposure times",
                    open.name,
                    100 * open.sigma));
  }
  constexpr double kUneven = 10;
  if (estimate.unevenness > kUneven) {
    findings.push_back(
        fmt::format("residuals of parts of the wall have {:.0f} times the variance of others: the "
                    "wall is not flat, something moved before it, or it shines; use a flat, matt "
                    "part of it",
                    estimate.unevenness));
  }
  const auto [least, largest] = std::ranges::minmax(estimate.by_angle);
  constexpr double kGlossy = 0.01;
  if (largest - least > kGlossy) {
    findings.push_back(
        fmt::format("brightness depends on the angle of view ({:+.1f} % to {:+.1f} %): the wall is "
                    "glossy; use a matt one, or light from the side",
                    100 * least,
                    100 * largest));
  }
  if (!estimate.shading.tested) {
    findings.push_back(
        "light that goes with the camera (its shadow, a lamp on it) was not tested; that needs "
        "eight images with the camera turned by 90 or 180 degrees about its axis");
  } else {
    constexpr double kChance = 1e-3, kLarge = 0.003;
    if (estimate.shading.chance < kChance && estimate.shading.difference > kLarge) {
      findings.push_back(fmt::format(
          "views that are turned about the axis give a vignetting that differs by {:.2f} "
          "% (noise: {:.2f} %): light goes with the camera; keep its shadow off the wall",
          100 * estimate.shading.difference,
          100 * estimate.shading.sigma));
    }
  }
  return findings;
}

std::string VignetteSummary(const VignetteEstimate& estimate,
                            const std::string& camera,
                            std::size_t views) {
  double darkest = 0;
  cv::minMaxLoc(estimate.attenuation, &darkest);
  return fmt::format(
      "{}: vignetting from {} and {}\n"
      "  attenuation from {:.3f} to 1, sigma {:.3f} %\n"
      "  residuals {:.2f} %, {:.1f} % beyond 3 sigma; worst against best parts of the wall {:.1f}\n",
      camera,
      Counted(views, "image"),
      Counted(estimate.measurements, "measurement"),
      darkest,
      100 * MeanSigma(estimate.sigma),
      100 * estimate.residual,
      100 * estimate.outliers,
      estimate.unevenness);
}

std::string VignettePage(const VignetteEstimate& estimate,
                         const std::string& camera,
                         const std::vector<std::string>& frames,
                         const std::vector<std::string>& findings,
                         const AttenuationComparison* comparison) {
  const ImageSize size{estimate.attenuation.cols, estimate.attenuation.rows};
  const std::string headline = fmt::format("Attenuation with a standard deviation of {} %",
                                           BriefNumber(100 * MeanSigma(estimate.sigma), 2));
  Json page{{"kind", "photometry"},
            {"camera", camera},
            {"headline", headline},
            {"findings", findings},
            {"vignette",
             {{"image_size", size},
              {"row", SectionJson(estimate, true)},
              {"column", SectionJson(estimate, false)},
              {"attenuation", CellsJson(estimate.attenuation)},
              {"sigma", CellsJson(estimate.sigma)},
              {"measurements", estimate.measurements},
              {"residual", estimate.residual},
              {"expected", estimate.expected},
              {"outliers", estimate.outliers},
              {"frames", frames},
              {"gains", estimate.gains},
              {"angles", estimate.angle_limits},
              {"by_angle", estimate.by_angle},
              {"wall", CellsJson(WallPicture(estimate))}}}};
  if (comparison != nullptr)
    page["comparison"] = ComparisonJson(*comparison, "wall", "white images");
  PageText text;
  text.Paragraph(camera);
  text.Box(findings.empty() ? "good" : "usable", headline, findings);
  return MakePage("Vignetting of a camera", text, page);
}

std::string WallPng(const VignetteEstimate& estimate) {
  cv::Mat grey;
  WallPicture(estimate).convertTo(grey, CV_8U, 255);
  return EncodeImage(".png", grey);
}

}  // namespace plenocal

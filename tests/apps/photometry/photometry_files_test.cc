// SPDX-License-Identifier: Apache-2.0
//
// Comparisons of attenuations, and texts and pages of responses and vignettings.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <random>

#include "apps/photometry/attenuation_compare.h"
#include "apps/photometry/images/exposed_images.h"
#include "apps/photometry/response_files.h"
#include "apps/photometry/vignette_files.h"
#include "apps/photometry/white_attenuation.h"
#include "calib/base/error.h"
#include "detectors/images/image.h"
#include "tests/apps/workspace.h"
#include "tests/refusal.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using Json = nlohmann::json;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

template <typename Value>
cv::Mat Image(int columns, int rows, const Value& value) {
  cv::Mat image(rows, columns, CV_32F);
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < columns; ++x) image.at<float>(y, x) = static_cast<float>(value(x, y));
  }
  return image;
}

// What a page shows beside its text.
Json DataOf(const std::string& page) {
  const size_t begin = page.find("{\"camera\":");
  return Json::parse(page.substr(begin, page.find("</script>", begin) - begin));
}

class AttenuationFiles : public Workspace {
 protected:
  void WriteTiff(const std::string& name, const cv::Mat& image) const {
    Write(name, EncodeImage(".tiff", image));
  }
  // A message without the folder.
  [[nodiscard]] std::string Short(std::string message) const {
    const std::string folder = Path("").string();
    for (size_t at = message.find(folder); at != std::string::npos; at = message.find(folder)) {
      message.erase(at, folder.size());
    }
    return message;
  }
};

constexpr int kColumns = 60, kRows = 40;
double First(int x, int y) { return 0.5 + 0.004 * x + 0.001 * y; }
double Second(int x, int y) { return 0.3 * First(x, y) * (1 + 0.01 * std::sin(0.3 * x + 0.2 * y)); }

TEST(AttenuationComparison, IsOfTheRatioWithoutTheCommonFactor) {
  const Attenuation first{Image(kColumns, kRows, First),
                          Image(kColumns, kRows, [](int x, int) { return 0.003 + 1e-5 * x; })};
  const Attenuation second{Image(kColumns, kRows, Second),
                           Image(kColumns, kRows, [](int, int y) { return 0.004 + 1e-5 * y; })};
  const AttenuationComparison found = CompareAttenuations(first, second);
  double logs = 0;
  for (int i = 0; i < 2400; ++i)
    logs += std::log(First(i % 60, i / 60) / Second(i % 60, i / 60)) / 2400;
  const double factor = std::exp(logs);
  double squares = 0, variances = 0, chi_square = 0, largest = 0;
  struct Ring {
    double count = 0, r = 0, first = 0, second = 0, variance = 0;
  };
  std::vector<Ring> rings(100);
  for (int y = 0; y < kRows; ++y) {
    for (int x = 0; x < kColumns; ++x) {
      const double difference = First(x, y) / (factor * Second(x, y)) - 1;
      const double variance = std::pow(0.003 + 1e-5 * x, 2) + std::pow(0.004 + 1e-5 * y, 2);
      squares += difference * difference / 2400, variances += variance / 2400;
      chi_square += difference * difference / variance / 2400;
      largest = std::max(largest, std::abs(difference));
      const double r = std::hypot(x - 29.5, y - 19.5);
      Ring& ring = rings[static_cast<size_t>(r / (std::hypot(60, 40) / 2) * 100)];
      ring.count += 1, ring.r += r, ring.first += First(x, y), ring.second += factor * Second(x, y),
          ring.variance += variance;
    }
  }
  EXPECT_NEAR(found.rms, std::sqrt(squares), 1e-7);
  EXPECT_NEAR(found.expected, std::sqrt(variances), 1e-7);
  EXPECT_NEAR(found.chi_square, chi_square, 1e-4);
  EXPECT_NEAR(found.largest, largest, 1e-6);
  ASSERT_EQ(found.middle_row.size(), 60u);
  for (int x = 0; x < 60; ++x) {
    const AttenuationComparison::Row& row = found.middle_row[static_cast<size_t>(x)];
    EXPECT_EQ(row.x, x);
    EXPECT_NEAR(row.first, First(x, 20), 1e-6);
    EXPECT_NEAR(row.second, factor * Second(x, 20), 1e-6);
    EXPECT_NEAR(row.sigma, std::hypot(0.003 + 1e-5 * x, 0.0042), 1e-7);
  }
  std::erase_if(rings, [](const Ring& ring) { return ring.count == 0; });
  ASSERT_EQ(found.radial.size(), rings.size());
  const Ring* border = nullptr;
  for (size_t i = 0; i < rings.size(); ++i) {
    const auto& [count, r, a, b, variance] = rings[i];
    EXPECT_NEAR(found.radial[i].x, r / count, 1e-9);
    EXPECT_NEAR(found.radial[i].first, a / count, 1e-6);
    EXPECT_NEAR(found.radial[i].second, b / count, 1e-6);
    EXPECT_NEAR(found.radial[i].sigma, std::sqrt(variance / count), 1e-7);
    if (count >= 50) border = &rings[i];
  }
  ASSERT_NE(border, nullptr);
  EXPECT_NEAR(found.border.x, border->r / border->count, 1e-9);

  const AttenuationComparison unknown = CompareAttenuations({first.values, {}}, second);
  EXPECT_TRUE(std::isnan(unknown.expected) && std::isnan(unknown.chi_square) &&
              std::isnan(unknown.middle_row[3].sigma));
  EXPECT_EQ(unknown.rms, found.rms);
  EXPECT_TRUE(std::isnan(CompareAttenuations(first, {second.values, {}}).expected));
}

AttenuationComparison SmallComparison() {
  AttenuationComparison comparison;
  comparison.middle_row = {{0, 0.5, 0.4, 0.01}, {1, 0.75, 0.5, kNaN}};
  comparison.radial = {{2.5, 1, 0.8, 0.002}};
  comparison.rms = 0.0123456;
  comparison.largest = 0.25;
  comparison.expected = 0.004;
  comparison.border = {9, 0.45, 0.5, 0.0007};
  return comparison;
}

TEST(AttenuationComparison, IsWrittenAsTableTextAndPage) {
  AttenuationComparison comparison = SmallComparison();
  EXPECT_EQ(ComparisonCsv(comparison),
            "section,x,first,second,ratio,sigma\nrow,0,0.5,0.4,1.25,0.01\nrow,1,0.75,0.5,1.5,\n"
            "radial,2.5,1,0.8,1.25,0.002\n");
  EXPECT_EQ(
      ComparisonText(comparison, "a", "b"),
      "a against b: RMS 1.235 % (by noise 0.400 %), largest 25.000 %\n  in the corners -10.000 % +- 0.070 %\n");
  const Json json = ComparisonJson(comparison, "a", "b");
  EXPECT_EQ(json, Json::parse(R"({"first": "a", "second": "b", "rms": 0.0123456, "largest": 0.25,
      "row": {"x": [0.0, 1.0], "first": [0.5, 0.75], "second": [0.4, 0.5], "sigma": [0.01, null]},
      "radial": {"x": [2.5], "first": [1.0], "second": [0.8], "sigma": [0.002]}})"));
  const std::string page = ComparisonPage(comparison, "a", "b");
  EXPECT_THAT(page, HasSubstr("a against b: RMS 1.235 %"));
  EXPECT_THAT(page, HasSubstr("Two vignettings"));
  const Json data = DataOf(page);
  EXPECT_EQ(data["kind"], "photometry");
  EXPECT_EQ(data["camera"], "a, b");
  EXPECT_EQ(data["headline"], "");
  EXPECT_EQ(data["findings"], Json::array());
  EXPECT_EQ(data["comparison"]["row"]["first"], Json({0.5, 0.75}));
  comparison.expected = kNaN;
  EXPECT_EQ(ComparisonText(comparison, "a", "b"),
            "a against b: RMS 1.235 %, largest 25.000 %\n  in the corners -10.000 %\n");
  EXPECT_TRUE(IsAttenuation("a/b.tiff") && IsAttenuation("b.tif"));
  EXPECT_FALSE(IsAttenuation("b.png") || IsAttenuation("tiff"));
}

TEST_F(AttenuationFiles, AreComparedWithTheSigmasBesideThem) {
  const cv::Mat values = Image(12, 8, [](int x, int) { return 0.5 + 0.01 * x; });
  const cv::Mat sigma(8, 12, CV_32F, cv::Scalar(0.003));
  for (const char* name : {"vignetting_left.tiff", "b/vignetting_right.tiff", "other.tiff"})
    WriteTiff(name, values);
  const auto compare = [&](const std::string& a, const std::string& b) {
    return CompareAttenuationFiles(Path(a), Path(b));
  };
  EXPECT_TRUE(std::isnan(compare("vignetting_left.tiff", "b/vignetting_right.tiff").expected));
  WriteTiff("vignetting_sigma_left.tiff", sigma);
  WriteTiff("vignetting_sigma_other.tiff", sigma);
  WriteTiff("b/vignetting_sigma_right.tiff", sigma * (4.0 / 3));
  const AttenuationComparison found = compare("vignetting_left.tiff", "b/vignetting_right.tiff");
  EXPECT_EQ(found.rms, 0);
  EXPECT_NEAR(found.expected, 0.005, 1e-8);
  EXPECT_TRUE(std::isnan(compare("other.tiff", "b/vignetting_right.tiff").expected));

  WriteTiff("small.tiff", Image(10, 8, [](int, int) { return 1; }));
  EXPECT_EQ(Short(RefusalOf([&] { compare("other.tiff", "small.tiff"); })),
            "other.tiff is 12 x 8 pixels, small.tiff is 10 x 8; they must be of one camera");
  WriteTiff("zero.tiff", Image(12, 8, [](int x, int y) { return (x + y) / 20.0; }));
  EXPECT_EQ(
      Short(RefusalOf([&] { compare("zero.tiff", "other.tiff"); })),
      "zero.tiff: has values that are not positive; an attenuation is the share of light that reaches each pixel");
  WriteTiff("vignetting_sigma_left.tiff", Image(12, 9, [](int, int) { return 1; }));
  EXPECT_EQ(Short(RefusalOf([&] { compare("vignetting_left.tiff", "other.tiff"); })),
            "vignetting_sigma_left.tiff: has another size than vignetting_left.tiff");
}

VignetteEstimate SmallEstimate() {
  VignetteEstimate estimate;
  estimate.attenuation = Image(64, 48, [](int x, int y) { return 1 - 0.005 * x - 0.002 * y; });
  estimate.sigma = Image(64, 48, [](int x, int) { return x < 32 ? 0.003 : 0.004; });
  estimate.wall =
      Image(40, 30, [](int x, int y) { return x == 0 ? std::nanf("") : 0.02 * x + 0.001 * y; });
  estimate.gains = {1.01, 1.012, 1.008, 1.01, 1.011};
  estimate.gain_sigma = {0.001, 0.001, 0.001, 0.002, 0.001};
  estimate.residual = 0.0123;
  estimate.expected = 0.011;
  estimate.outliers = 0.0456;
  estimate.unevenness = 2.5;
  estimate.measurements = 54321;
  estimate.by_angle = {0.001, 0, -0.002, 0, 0};
  estimate.shading = {.tested = true, .difference = 0.001, .sigma = 0.001, .chance = 0.5};
  return estimate;
}

TEST(VignetteFiles, NameWhatTheUserShouldKnow) {
  const std::vector<std::string> frames{"a", "b", "c", "d", "e"};
  const VignetteEstimate good = SmallEstimate();
  EXPECT_THAT(FindingsOf(good, frames), IsEmpty());
  VignetteEstimate e = good;
  e.misplaced = {"b"};
  EXPECT_THAT(
      FindingsOf(e, frames),
      ElementsAre(
          "b shows another part of the wall than the pose from its marker predicts, and is left out: "
          "the tilt of a small marker is ambiguous; use a larger one, or go nearer"));
  // Gains: median absolute deviation 0.001, limit 5 * 1.4826 of it = 0.0074.
  e = good;
  e.gains[4] = 1.01 + 0.0073;
  EXPECT_THAT(FindingsOf(e, frames), IsEmpty());
  e.gains[4] = 1.01 + 0.0151;
  e.gains[0] = 1.008;  // the deviations are now 0.002, 0.002, 0.002, 0 and 0.0151
  EXPECT_THAT(
      FindingsOf(e, frames),
      ElementsAre("exposures differ from those recorded in e (+1.5 %); exposures.csv has them"));
  e.gain_sigma[4] = 0.00303;
  EXPECT_THAT(FindingsOf(e, frames), IsEmpty());
  e = good;
  e.gains = {1, 1, 1, 0.9949, 1.0049};  // at least 0.5 % off
  e.gain_sigma.assign(5, 1e-4);
  EXPECT_THAT(
      FindingsOf(e, frames),
      ElementsAre("exposures differ from those recorded in d (-0.5 %); exposures.csv has them"));
  EXPECT_THAT(FindingsOf(e, {}), IsEmpty());  // exposures that are not known
  e.gains = {1, 1, 1, 1.02, 0.97};
  EXPECT_THAT(
      FindingsOf(e, frames),
      ElementsAre(
          "exposures differ from those recorded in d (+2.0 %), e (-3.0 %); exposures.csv has them"));
  // Not of as many as half of the frames.
  e.gains = {1, 1, 1.1, 1.2};
  e.gain_sigma.assign(4, 1e-4);
  EXPECT_THAT(FindingsOf(e, {"a", "b", "c", "d"}), IsEmpty());
  e = good;
  e.open = {{"a tilt along x", 0.0123}, {"a tilt along y", 0.006}};
  EXPECT_THAT(
      FindingsOf(e, frames),
      ElementsAre(
          "a tilt along x of the vignetting is known to 1.2 % only; turn the camera by 90 degrees about "
          "its axis in some images, and give exposure times",
          HasSubstr("a tilt along y of the vignetting is known to 0.6 % only")));
  e = good;
  e.unevenness = 10;
  EXPECT_THAT(FindingsOf(e, frames), IsEmpty());
  e.unevenness = 10.6;
  EXPECT_THAT(
      FindingsOf(e, frames),
      ElementsAre(
          "residuals of parts of the wall have 11 times the variance of others: the wall is not flat, "
          "something moved before it, or it shines; use a flat, matt part of it"));
  e = good;
  e.by_angle = {0.001, 0.0, -0.002, 0.0079, 0.0};
  EXPECT_THAT(FindingsOf(e, frames), IsEmpty());
  e.by_angle[3] = 0.0081;
  EXPECT_THAT(
      FindingsOf(e, frames),
      ElementsAre(
          "brightness depends on the angle of view (-0.2 % to +0.8 %): the wall is glossy; use a matt "
          "one, or light from the side"));
  e = good;
  e.shading.tested = false;
  EXPECT_THAT(
      FindingsOf(e, frames),
      ElementsAre(
          "light that goes with the camera (its shadow, a lamp on it) was not tested; that needs eight "
          "images with the camera turned by 90 or 180 degrees about its axis"));
  e.shading = {.tested = true, .difference = 0.0123, .sigma = 0.0011, .chance = 0.9e-3};
  EXPECT_THAT(
      FindingsOf(e, frames),
      ElementsAre(
          "views that are turned about the axis give a vignetting that differs by 1.23 % (noise: 0.11 %): "
          "light goes with the camera; keep its shadow off the wall"));
  e.shading.chance = 1.1e-3;
  EXPECT_THAT(FindingsOf(e, frames), IsEmpty());
  e.shading = {.tested = true, .difference = 0.0029, .sigma = 0, .chance = 0};
  EXPECT_THAT(FindingsOf(e, frames), IsEmpty());
}

TEST(VignetteFiles, AreTablesTextsAndPages) {
  const VignetteEstimate estimate = SmallEstimate();
  EXPECT_EQ(
      ExposuresCsv(estimate, "left", {"a", "b"}, {2, 4}),
      "frame,camera,exposure_ms,relative,sigma\na,left,2.02,0.01,0.001\nb,left,4.048,0.012,0.001\n");
  const double mean = std::sqrt((9 + 16) / 2.0) / 10;  // %
  const std::string expected = fmt::format(
      "left: vignetting from 5 images and 54321 measurements\n"
      "  attenuation from 0.591 to 1, sigma {:.3f} %\n"
      "  residuals 1.23 %, 4.6 % beyond 3 sigma; worst against best parts of the wall 2.5\n",
      mean);
  EXPECT_EQ(VignetteSummary(estimate, "left", 5), expected);
  const AttenuationComparison comparison = SmallComparison();
  const std::string page = VignettePage(estimate, "left", {"a", "b"}, {"one finding"}, &comparison);
  EXPECT_THAT(page, HasSubstr("Attenuation with a standard deviation of 0.35 %"));
  EXPECT_THAT(page, HasSubstr("Vignetting of a camera"));
  EXPECT_THAT(page, HasSubstr("<p>left</p>"));
  const Json data = DataOf(page);
  EXPECT_EQ(data["kind"], "photometry");
  EXPECT_EQ(data["camera"], "left");
  EXPECT_EQ(data["findings"], Json({"one finding"}));
  EXPECT_EQ(data["comparison"]["first"], "wall");
  EXPECT_EQ(data["comparison"]["second"], "white images");
  const Json& v = data["vignette"];
  EXPECT_EQ(v["image_size"], Json({64, 48}));
  EXPECT_EQ(v["measurements"], 54321);
  EXPECT_EQ(v["residual"], 0.0123);
  EXPECT_EQ(v["expected"], 0.011);
  EXPECT_EQ(v["outliers"], 0.0456);
  EXPECT_EQ(v["frames"], Json({"a", "b"}));
  EXPECT_EQ(v["gains"], Json(estimate.gains));
  EXPECT_EQ(v["by_angle"], Json(estimate.by_angle));
  EXPECT_EQ(v["angles"].size(), 6u);
  ASSERT_EQ(v["row"]["values"].size(), 64u);
  ASSERT_EQ(v["column"]["values"].size(), 48u);
  EXPECT_NEAR(v["row"]["values"][10].get<double>(), 1 - 0.05 - 0.048, 1e-6);    // row 24
  EXPECT_NEAR(v["column"]["values"][10].get<double>(), 1 - 0.16 - 0.02, 1e-6);  // column 32
  EXPECT_NEAR(v["row"]["sigma"][10].get<double>(), 0.003, 1e-6);
  EXPECT_NEAR(v["column"]["sigma"][10].get<double>(), 0.004, 1e-6);
  EXPECT_EQ(v["attenuation"]["columns"], 32);
  EXPECT_EQ(v["attenuation"]["rows"], 24);
  // Cells of 2 x 2 px, row by row.
  EXPECT_NEAR(
      v["attenuation"]["values"][32 * 3 + 5].get<double>(), 1 - 0.005 * 10.5 - 0.002 * 6.5, 1e-6);
  EXPECT_EQ(v["sigma"]["values"].size(), 32u * 24);
  EXPECT_EQ(v["wall"]["rows"], 24);
  const double first = v["wall"]["values"][31].get<double>(),
               last = v["wall"]["values"][32 * 23 + 31].get<double>();
  EXPECT_GT(first, last);  // y of the wall points up
  EXPECT_NEAR(first - last, 0.001 * 30 * 23 / 24, 2e-4);
  EXPECT_THAT(page, HasSubstr("verdict usable"));
  const std::string good = VignettePage(estimate, "left", {}, {}, nullptr);
  EXPECT_THAT(good, HasSubstr("verdict good"));
  EXPECT_FALSE(DataOf(good).contains("comparison"));
  EXPECT_NE(VignettePage(estimate, "left", {"a", "b"}, {}, &comparison), page);
}

TEST_F(AttenuationFiles, ShowTheWallWithItsYUpwards) {
  Write("wall.png", WallPng(SmallEstimate()));
  const cv::Mat wall = ReadImage(Path("wall.png"));
  ASSERT_EQ(wall.size(), cv::Size(40, 30));
  EXPECT_EQ(wall.at<std::uint8_t>(5, 0), 0);  // not seen
  EXPECT_EQ(wall.at<std::uint8_t>(0, 30), std::lround(255 * (0.6 + 0.029)));
  EXPECT_EQ(wall.at<std::uint8_t>(29, 30), std::lround(255 * 0.6));
}

ResponseEstimate SmallResponse() {
  ResponseEstimate estimate;
  estimate.sigma.fill(0.1);
  estimate.sigma[3] = kNaN;
  estimate.sigma[100] = 0.51;
  for (size_t k = 0; k < 256; ++k) estimate.count[k] = k;
  estimate.noise = {.gain = 0.0255, .read = 0.7};
  estimate.exposure_sigma = 0.0123;
  estimate.exposure_errors = {0.001, -0.001, 0.001, -0.001, 0.001, -0.001, 0.001};
  estimate.rms = 0.6;
  estimate.pixels = 980;
  estimate.moving = 20;
  estimate.first = 5;
  estimate.last = 250;
  return estimate;
}

TEST(ResponseFiles, NameWhatTheUserShouldKnow) {
  ExposureSweep sweep;
  for (int i = 0; i < 7; ++i) sweep.frames.push_back(fmt::format("f{}", i));
  const ResponseEstimate good = SmallResponse();
  EXPECT_THAT(FindingsOf(good, sweep), IsEmpty());
  ResponseEstimate e = good;
  e.first = 6;
  EXPECT_THAT(
      FindingsOf(e, sweep),
      ElementsAre(
          "grey values below 7 or above 250 were hardly seen and are extrapolated; add shorter and longer exposures"));
  e.first = 5, e.last = 249;
  EXPECT_THAT(FindingsOf(e, sweep),
              ElementsAre(HasSubstr("below 6 or above 249 were hardly seen")));
  // Five times 1.4826 of the median size of the errors, at least 0.5 %.
  e = good;
  e.exposure_errors[2] = -0.0073;
  EXPECT_THAT(FindingsOf(e, sweep), IsEmpty());
  e.exposure_errors[2] = -0.0075;
  EXPECT_THAT(
      FindingsOf(e, sweep),
      ElementsAre(
          "1 image is brighter or darker than exposure and other images have it: f2 (-0.8 %); the gain must "
          "be fixed and the lamp must not flicker"));
  e.exposure_errors = {0, 0, 0, 0.0051, 0, 0.0049, 0};
  EXPECT_THAT(FindingsOf(e, sweep), ElementsAre(HasSubstr(": f3 (+0.5 %); the gain")));
  for (int i = 0; i < 13; ++i)
    e.exposure_errors.push_back(i < 5 ? 0.02 : 0), sweep.frames.push_back(fmt::format("g{}", i));
  EXPECT_THAT(
      FindingsOf(e, sweep),
      ElementsAre(
          "6 images are brighter or darker than exposure and other images have it: f3 (+0.5 %), g0 (+2.0 %), "
          "g1 (+2.0 %), g2 (+2.0 %), g3 (+2.0 %), ...; the gain must be fixed and the lamp must not flicker"));
  e.exposure_errors[3] = 0;
  EXPECT_THAT(FindingsOf(e, sweep), ElementsAre(HasSubstr("g4 (+2.0 %); the gain")));
  e = good;
  e.moving = 21;
  e.pixels = 979;
  EXPECT_THAT(FindingsOf(e, sweep),
              ElementsAre("2.1 % of the pixels were left out: the scene moved there"));
}

TEST(ResponseFiles, AreTablesTextsAndPages) {
  const ResponseEstimate estimate = SmallResponse();
  const std::vector<std::string> lines = Lines(ResponseCsv(estimate));
  ASSERT_EQ(lines.size(), 257u);
  EXPECT_EQ(lines[0], "value,U,sigma,count");
  EXPECT_EQ(lines[4], "3,3,,3");
  EXPECT_EQ(lines[101], "100,100,0.51,100");
  EXPECT_EQ(ResponseSummary(estimate, "left"),
            "left: response from 980 pixels at 7 exposures\n"
            "  grey values 6 to 250 measured, sigma up to 0.200 % of full scale\n"
            "  noise of a pixel: full at 10000 electrons, read noise 0.275 % of full scale\n"
            "  single exposures are wrong by 1.23 %\n");
  ResponseEstimate silent = estimate;
  silent.noise.gain = 0;
  EXPECT_THAT(ResponseSummary(silent, "left"), HasSubstr("full at 0 electrons"));
  ExposureSweep sweep;
  sweep.frames = {"a", "b"};
  sweep.exposures = {1, 2.5};
  const std::string page = ResponsePage(estimate, sweep, "left", {});
  EXPECT_THAT(page, HasSubstr("Light by grey value: standard deviation up to 0.2"));
  EXPECT_THAT(page, HasSubstr("Response of a camera"));
  EXPECT_THAT(page, HasSubstr("<p>left</p>"));
  EXPECT_THAT(page, HasSubstr("verdict good"));
  EXPECT_THAT(ResponsePage(estimate, sweep, "left", {"one"}), HasSubstr("verdict usable"));
  const Json data = DataOf(page);
  EXPECT_EQ(data["kind"], "photometry");
  EXPECT_EQ(data["findings"], Json::array());
  const Json& r = data["response"];
  EXPECT_EQ(r["U"].size(), 256u);
  EXPECT_EQ(r["sigma"][3], nullptr);
  EXPECT_EQ(r["sigma"][100], 0.51);
  EXPECT_EQ(r["count"][7], 7);
  EXPECT_EQ(r["gain"], 0.0255);
  EXPECT_EQ(r["read"], 0.7);
  EXPECT_EQ(r["rms"], 0.6);
  EXPECT_EQ(r["pixels"], 980);
  EXPECT_EQ(r["moving"], 20);
  EXPECT_EQ(r["exposure_sigma"], 0.0123);
  EXPECT_EQ(r["frames"], Json({"a", "b"}));
  EXPECT_EQ(r["exposures"], Json({1, 2.5}));
  EXPECT_EQ(r["exposure_errors"].size(), 7u);
}

class RecordedExposures : public AttenuationFiles {
 protected:
  RecordedExposures() {
    recording_.path = "recording.yaml";
    recording_.cameras.resize(1);
    recording_.cameras[0].name = "left";
  }
  void Add(const std::string& frame, const cv::Mat& image, std::optional<double> exposure) {
    Write(frame + ".png", EncodeImage(".png", image));
    RecordedImage recorded;
    recorded.frame = frame;
    recorded.path = Path(frame + ".png");
    recorded.exposure = exposure;
    Camera().images.push_back(recorded);
    Camera().image_size = {image.cols, image.rows};
  }
  RecordedCamera& Camera() { return recording_.cameras[0]; }
  ExposureSweep Read(int threads = 1) {
    left_out_.clear();
    return ReadExposureSweep(
        recording_, Camera(), threads, [&](size_t, size_t) { return true; }, &left_out_);
  }

  Recording recording_;
  std::vector<LeftOut> left_out_;
};

TEST_F(RecordedExposures, AreSampledEvenlyAndMarkedBesideSaturatedPixels) {
  // 240,000 px: every second one in both directions, from the second on.
  cv::Mat image(400, 600, CV_8U);
  for (int y = 0; y < 400; ++y) {
    for (int x = 0; x < 600; ++x)
      image.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>((3 * x + 7 * y) % 251);
  }
  cv::Mat full = image.clone();
  full.at<std::uint8_t>(101, 201) = 255;
  Add("b", full, 2);
  Add("a", image, 1);
  Add("c", image, 4.1);
  Add("d", full, 1.9);
  const ExposureSweep sweep = Read(2);
  EXPECT_THAT(sweep.frames, ElementsAre("b", "a", "c", "d"));
  EXPECT_THAT(sweep.exposures, ElementsAre(2, 1, 4.1, 1.9));
  ASSERT_EQ(sweep.grey[0].size(), 300u * 200);
  EXPECT_EQ(sweep.grey[1][300 * 10 + 20], (3 * 41 + 7 * 21) % 251);
  // Near: two pixels around, but not the pixel itself. Charge is that of the longest exposure of at
  // most half.
  const auto marked = [&](size_t i) {
    std::vector<std::pair<int, int>> at;
    for (size_t k = 0; k < sweep.beside_saturated[i].size(); ++k) {
      if (sweep.beside_saturated[i][k])
        at.emplace_back(2 * static_cast<int>(k % 300) + 1, 2 * static_cast<int>(k / 300) + 1);
    }
    return at;
  };
  ASSERT_EQ(sweep.beside_saturated.size(), 4u);
  EXPECT_THAT(marked(0), IsEmpty());
  EXPECT_THAT(marked(1), IsEmpty());  // of a, which has no full pixel
  EXPECT_THAT(marked(3), IsEmpty());
  using Pair = std::pair<int, int>;
  EXPECT_THAT(marked(2),
              ElementsAre(Pair(199, 99),
                          Pair(201, 99),
                          Pair(203, 99),
                          Pair(199, 101),
                          Pair(203, 101),
                          Pair(199, 103),
                          Pair(201, 103),
                          Pair(203, 103)));  // of b, not of d
  EXPECT_EQ(Read(1).grey, sweep.grey);
}

TEST_F(RecordedExposures, AreRefusedOrLeftOutWithTheirReason) {
  const cv::Mat small(20, 30, CV_8U, cv::Scalar(9));
  Add("a", small, 1);
  Add("b", cv::Mat(20, 30, CV_16U, cv::Scalar(9)), 2);
  Add("c", small, 4);
  std::vector<std::string> steps;
  const ExposureSweep sweep = ReadExposureSweep(
      recording_,
      Camera(),
      1,
      [&](size_t done, size_t total) {
        return steps.push_back(fmt::format("{}/{}", done, total)), true;
      },
      &left_out_);
  EXPECT_THAT(steps, ElementsAre("1/3", "2/3", "3/3"));
  EXPECT_THAT(sweep.frames, ElementsAre("a", "c"));
  EXPECT_THAT(sweep.exposures, ElementsAre(1, 4));
  EXPECT_EQ(sweep.grey[0].size(), 600u);  // all pixels of a small image
  ASSERT_EQ(left_out_.size(), 1u);
  EXPECT_EQ(left_out_[0].where, Path("b.png").string());
  EXPECT_EQ(left_out_[0].reason,
            "has 16 bits; a response holds 256 values: record with 8 bits a pixel");
  EXPECT_TRUE(left_out_[0].whole);
  EXPECT_EQ(left_out_[0].camera + left_out_[0].frame, "leftb");
  EXPECT_THROW(ReadExposureSweep(
                   recording_, Camera(), 1, [](size_t, size_t) { return false; }, &left_out_),
               Stopped);
  Camera().images.erase(Camera().images.begin());
  Camera().images.erase(Camera().images.begin() + 1);
  EXPECT_EQ(Short(RefusalOf([&] { Read(); })),
            "b.png: has 16 bits; a response holds 256 values: record with 8 bits a pixel");
  Camera().images.push_back(Camera().images[0]);
  Camera().images.push_back(Camera().images[0]);
  Camera().images[1].exposure.reset();
  EXPECT_EQ(
      RefusalOf([&] { Read(); }),
      "recording.yaml: camera left: 1 of 3 images have no exposure time; write lines 'name time exposure' into the "
      "file that 'times' names, as cameras and TUM monoVO recordings do");
}

TEST_F(RecordedExposures, BelongToACameraOfTheRecording) {
  EXPECT_EQ(ChooseRecordedCamera(recording_, "").name, "left");
  EXPECT_EQ(ChooseRecordedCamera(recording_, "left").name, "left");
  recording_.cameras.resize(2);
  recording_.cameras[1].name = "right";
  EXPECT_EQ(&ChooseRecordedCamera(recording_, "right"), &recording_.cameras[1]);
  EXPECT_EQ(RefusalOf([&] { ChooseRecordedCamera(recording_, ""); }),
            "recording.yaml: has 2 cameras (left, right); choose one with --camera");
  EXPECT_EQ(RefusalOf([&] { ChooseRecordedCamera(recording_, "rigth"); }),
            "recording.yaml: has no camera 'rigth'; did you mean 'right'?");
  EXPECT_EQ(ExposureRow("a,b", "left", 1.5, -0.25, 0.0125), "\"a,b\",left,1.5,-0.25,0.0125\n");
  EXPECT_EQ(ExposureRow("a", "left", kNaN, 0, 0), "a,left,,0,0\n");
  recording_.left_out = {{.where = "1", .reason = "", .camera = "left"},
                         {.where = "2", .reason = "", .camera = "right"}};
  const std::vector<LeftOut> of_right = LeftOutOf(recording_, recording_.cameras[1]);
  ASSERT_EQ(of_right.size(), 1u);
  EXPECT_EQ(of_right[0].where, "2");
}

class WhiteImages : public RecordedExposures {
 protected:
  [[nodiscard]] std::vector<FrameImage> White() {
    std::vector<FrameImage> images;
    for (const RecordedImage& image : Camera().images) images.push_back(image);
    return images;
  }
};

TEST_F(WhiteImages, GiveTheAttenuationWithTheSigmaOfTheirNoise) {
  const auto truth = [](double x, double y) {
    return 1 - 1e-5 * (std::pow(x - 90, 2) + std::pow(y - 10, 2));
  };
  std::mt19937 engine(1);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 4; ++i) {
    cv::Mat image(28, 160, CV_8U);
    for (int y = 0; y < 28; ++y) {
      for (int x = 0; x < 160; ++x) {
        image.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(
            std::lround((180 + 5 * i) * truth(x, y) + 3 * normal(engine)));
      }
    }
    Add(std::to_string(i), image, 1);
  }
  const Attenuation found = MeasureAttenuation(White(), {}, {160, 28}, 2);
  ASSERT_EQ(found.values.size(), cv::Size(160, 28));
  ASSERT_EQ(found.sigma.size(), cv::Size(160, 28));
  double largest = 0, squares = 0, variances = 0, mean = 0;
  for (int y = 0; y < 28; ++y) {
    for (int x = 0; x < 160; ++x)
      mean += std::log(found.values.at<float>(y, x) / truth(x, y)) / 4480;
  }
  for (int y = 0; y < 28; ++y) {
    for (int x = 0; x < 160; ++x) {
      largest = std::max<double>(largest, found.values.at<float>(y, x));
      squares += std::pow(std::log(found.values.at<float>(y, x) / truth(x, y)) - mean, 2);
      variances += std::pow(found.sigma.at<float>(y, x), 2);
    }
  }
  EXPECT_EQ(largest, 1);
  EXPECT_LT(std::sqrt(squares / 4480), 0.006);
  EXPECT_TRUE(squares / variances > 0.5 && squares / variances < 4) << squares / variances;
  EXPECT_NEAR(std::sqrt(variances / 4480), 0.00201, 3e-5);
  // Of one image the noise is not known.
  const std::vector<FrameImage> one{White()[0]};
  EXPECT_TRUE(MeasureAttenuation(one, {}, {160, 28}, 1).sigma.empty());
}

TEST_F(WhiteImages, AreRefusedWithWhatIsWrong) {
  const auto refuse = [&](const cv::Mat& image, const ImageSize& size) {
    Camera().images.clear();
    Add("w", image, 1);
    return Short(RefusalOf([&] { MeasureAttenuation(White(), {}, size, 1); }));
  };
  const cv::Mat grey(8, 250, CV_8U, cv::Scalar(100));
  EXPECT_EQ(refuse(grey, {250, 9}),
            "w.png: is 250 x 8 pixels, but the camera's images are 250 x 9");
  EXPECT_EQ(refuse(grey, {251, 8}),
            "w.png: is 250 x 8 pixels, but the camera's images are 251 x 8");
  EXPECT_EQ(
      refuse(cv::Mat(8, 250, CV_16U, cv::Scalar(100)), {250, 8}),
      "w.png: has 16 bits; a response holds 256 values: give white images of 8 bits, as the wall's");
  EXPECT_EQ(refuse(cv::Mat(8, 250, CV_8U, cv::Scalar(0)), {250, 8}), "w.png: is black");
  cv::Mat bright = grey.clone();
  bright.at<std::uint8_t>(3, 4) = bright.at<std::uint8_t>(7, 40) = 255;
  EXPECT_EQ(refuse(bright, {250, 8}), "no refusal");  // a thousandth of its pixels
  bright.at<std::uint8_t>(5, 9) = 255;
  EXPECT_EQ(refuse(bright, {250, 8}), "w.png: is saturated; use a shorter exposure");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing

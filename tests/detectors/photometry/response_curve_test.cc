// SPDX-License-Identifier: Apache-2.0
#include "detectors/photometry/response_curve.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <string>

#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::HasSubstr;

/// A curve along k^2 + 3 k with an offset, and the same from 0 to 255.
double Light(double k) { return 0.5 + 2e-4 * (k * k + 3 * k); }
double Normalised(double k) { return 255 * (k * k + 3 * k) / (255 * 258.0); }

ResponseCurve::Table Table() {
  ResponseCurve::Table light;
  for (size_t k = 0; k < light.size(); ++k) light[k] = Light(static_cast<double>(k));
  return light;
}

TEST(ResponseCurve, IsProportionalToTheLightByDefault) {
  const ResponseCurve curve;
  for (size_t k = 0; k < ResponseCurve::kValues; ++k) {
    EXPECT_EQ(curve.Light(k), static_cast<double>(k));
    EXPECT_EQ(curve.Slope(k), 1);
  }
}

TEST(ResponseCurve, IsScaledTo255) {
  const ResponseCurve curve(Table());
  for (size_t k = 0; k < ResponseCurve::kValues; ++k) {
    const auto grey = static_cast<double>(k);
    EXPECT_NEAR(curve.Light(k), Normalised(grey), 1e-9);
    // The mean slope to both neighbours, at the ends to one.
    const double low = std::max(0.0, grey - 1), high = std::min(255.0, grey + 1);
    EXPECT_NEAR(curve.Slope(k), (Normalised(high) - Normalised(low)) / (high - low), 1e-9);
  }
}

TEST(ResponseCurve, HasItsBordersBetweenTheValues) {
  const ResponseCurve::Borders borders = ResponseCurve(Table()).MakeBorders();
  for (size_t k = 0; k < borders.size(); ++k) {
    const auto grey = static_cast<double>(k);
    const bool at_end = k == 0 || k == 254;
    // A cubic is exact for a square; at the ends the mean of two values stands.
    const double expected =
        at_end ? (Normalised(grey) + Normalised(grey + 1)) / 2 : Normalised(grey + 0.5);
    EXPECT_NEAR(borders[k], expected, 1e-9) << k;
  }
  // Beside a step a cubic would leave the interval: a straight line then.
  ResponseCurve::Table step = Table();
  for (size_t k = 0; k < step.size(); ++k) step[k] = static_cast<double>(k) + (k > 100 ? 1000 : 0);
  const ResponseCurve stepped(step);
  const ResponseCurve::Borders of_step = stepped.MakeBorders();
  for (size_t k = 99; k < 103; ++k) {
    EXPECT_GT(of_step[k], stepped.Light(k));
    EXPECT_LT(of_step[k], stepped.Light(k + 1));
  }
  EXPECT_NEAR(of_step[99], (stepped.Light(99) + stepped.Light(100)) / 2, 1e-9);
}

TEST(ResponseCurve, IsReadAsItIsWritten) {
  const testing::TemporaryFolder files;
  const auto read = [&](const std::string& text) {
    return ReadResponse(files.Write("curve.txt", text));
  };
  const ResponseCurve curve(Table());
  const std::string text = PcalibText(curve);
  const ResponseCurve again = read(text);
  for (size_t k = 0; k < ResponseCurve::kValues; ++k) {
    EXPECT_NEAR(again.Light(k), curve.Light(k), 1e-6);
  }
  const auto refused = [&](const std::string& wrong) {
    return testing::RefusalOf([&] { read(wrong); });
  };
  EXPECT_THAT(refused("1 2 3"), HasSubstr("expected 256 numbers, found 3"));
  std::string row;
  const auto with = [&](size_t place, const std::string& value) {
    row.clear();
    for (size_t k = 0; k < ResponseCurve::kValues; ++k) {
      row += (k == place ? value : std::to_string(k)) + " ";
    }
    return refused(row);
  };
  EXPECT_EQ(with(0, "0"), "no refusal");
  EXPECT_THAT(with(7, "seven"), HasSubstr("value 7: expected a number, found 'seven'"));
  EXPECT_THAT(with(7, "nan"), HasSubstr("value 7"));
  EXPECT_THAT(with(7, "6"), HasSubstr("value 7 (6) does not exceed the one before (6)"));
  EXPECT_THAT(with(1, "-1"), HasSubstr("value 1 (-1) does not exceed the one before (0)"));
  EXPECT_THAT(with(255, "1e320"), HasSubstr("255"));
  // Of any unit that numbers can be scaled to.
  const auto with_unit = [&](double unit) {
    row.clear();
    for (size_t k = 0; k < ResponseCurve::kValues; ++k) {
      row += fmt::format("{} ", static_cast<double>(k) * unit);
    }
    return refused(row);
  };
  EXPECT_EQ(with_unit(1e305), "no refusal");
  EXPECT_EQ(with_unit(1e-300), "no refusal");
  EXPECT_THAT(with_unit(1e-320), HasSubstr("have no scale"));
}

TEST(LightOf, IsTheLightOfEachPixelAndChannel) {
  const ResponseCurve curve(Table());
  cv::Mat image(2, 3, CV_8UC3);
  cv::randu(image, 0, 256);
  const cv::Mat light = LightOf(image, curve);
  ASSERT_EQ(light.type(), CV_32FC3);
  for (int i = 0; i < 18; ++i) {
    EXPECT_FLOAT_EQ(light.ptr<float>()[i], static_cast<float>(curve.Light(image.ptr<uchar>()[i])));
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal

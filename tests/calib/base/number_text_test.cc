// SPDX-License-Identifier: Apache-2.0
#include "calib/base/number_text.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <string>

namespace plenocal::testing {
namespace TEST_FILE {

TEST(Counted, HasTheSingularForOneOnly) {
  EXPECT_EQ(Counted(0, "image"), "0 images");
  EXPECT_EQ(Counted(1, "image"), "1 image");
  EXPECT_EQ(Counted(2, "image"), "2 images");
  EXPECT_EQ(Counted(1, "micro lens", "micro lenses"), "1 micro lens");
  EXPECT_EQ(Counted(3, "micro lens", "micro lenses"), "3 micro lenses");
}

TEST(ParseLength, TakesASignOnce) {
  EXPECT_EQ(ParseLength("+2 m").value().metres, 2);
  EXPECT_EQ(ParseLength("-2 m").value().metres, -2);
  EXPECT_EQ(ParseLength("+5").value().metres, 5);
  EXPECT_FALSE(ParseLength("+-2 m"));
  EXPECT_FALSE(ParseLength("++2 m"));
  EXPECT_FALSE(ParseLength("+"));
}

TEST(ParseLength, KnowsTheUnits) {
  const auto metres = [](const char* text) { return ParseLength(text).value().metres; };
  EXPECT_DOUBLE_EQ(metres("25 mm"), 0.025);
  EXPECT_DOUBLE_EQ(metres("2.5cm"), 0.025);
  EXPECT_DOUBLE_EQ(metres("5 um"), 5e-6);
  EXPECT_DOUBLE_EQ(metres("5 \u00b5m"), 5e-6);
  EXPECT_DOUBLE_EQ(metres("5 \u03bcm"), 5e-6);
  EXPECT_DOUBLE_EQ(metres("5 nm"), 5e-9);
  EXPECT_DOUBLE_EQ(metres("2 in"), 0.0508);
  EXPECT_DOUBLE_EQ(metres("2 inch"), 0.0508);
  EXPECT_TRUE(ParseLength("1 m").value().has_unit);
  EXPECT_FALSE(ParseLength("1").value().has_unit);
  for (const char* text : {"", "m", "1 km", "inf", "nan m", "1 m m", "1 2"})
    EXPECT_FALSE(ParseLength(text)) << text;
}

std::string Fixed(double value, int decimals) {
  std::string text;
  AppendFixed(value, decimals, &text);
  return text;
}

TEST(AppendFixed, WritesTheNearestDecimalNumber) {
  EXPECT_EQ(Fixed(12.5, 8), "12.5");
  EXPECT_EQ(Fixed(-12, 8), "-12");
  EXPECT_EQ(Fixed(0, 4), "0");
  EXPECT_EQ(Fixed(-0.0, 4), "0");
  EXPECT_EQ(Fixed(-1e-9, 4), "0");
  EXPECT_EQ(Fixed(-0.05, 2), "-0.05");
  EXPECT_EQ(Fixed(1e-8, 8), "0.00000001");
  EXPECT_EQ(Fixed(0.99999, 4), "1");
  EXPECT_EQ(Fixed(1e300, 2), fmt::format("{:.0f}", 1e300));
  EXPECT_EQ(Fixed(std::numeric_limits<double>::infinity(), 2), "inf");
  std::minstd_rand random(1);
  std::uniform_real_distribution<double> exponent(-10, 8), sign(-1, 1);
  for (int i = 0; i < 20000; ++i) {
    // Every other one has few decimals, so that rounding meets ties.
    double value = std::copysign(std::pow(10, exponent(random)), sign(random));
    if (i % 2 == 0) value = std::round(value * 1024) / 1024;
    const int decimals = i % 11;
    std::string expected = fmt::format("{:.{}f}", value, decimals);
    if (decimals > 0) {
      expected.erase(expected.find_last_not_of('0') + 1);
      if (expected.back() == '.') expected.pop_back();
    }
    EXPECT_EQ(Fixed(value, decimals), expected == "-0" ? "0" : expected) << value;
  }
}

TEST(YamlNumber, IsANumberForYaml11) {
  EXPECT_EQ(YamlNumber(1e-8), "1.0e-08");
  EXPECT_EQ(YamlNumber(-1.5e-8), "-1.5e-08");
  EXPECT_EQ(YamlNumber(1e20), "1.0e+20");
  EXPECT_EQ(YamlNumber(-0.0), "0");
  EXPECT_EQ(YamlNumber(12), "12");
  EXPECT_EQ(YamlNumber(std::nan("")), ".nan");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing

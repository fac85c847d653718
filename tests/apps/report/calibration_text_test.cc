// SPDX-License-Identifier: Apache-2.0
#include "apps/report/calibration_text.h"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>
#include <string>

namespace plenocal {
namespace TEST_FILE {

using ::testing::HasSubstr;
using ::testing::Not;
using Json = nlohmann::json;

Json Camera(const char* name, int index) {
  return {{"name", name},
          {"index", index},
          {"model", "focused-plenoptic"},
          {"image_size", {640, 480}},
          {"summary", std::string(name) + ": 0.2 px"},
          {"units",
           Json::array({Json::array({"f_L", "m"}),
                        Json::array({"s", "m^-12"}),
                        Json::array({"k", "1"}),
                        Json::array({"n", "px^2"})})},
          {"parameters", {{"f_L", 0.0351}, {"s", 2.0}, {"k", 0.5}, {"n", 7.25}, {"knot", 3.0}}},
          {"sigma", {{"f_L", 0.0002}, {"s", 0.0}, {"k", nullptr}, {"n", 0.01}, {"knot", 1.0}}},
          {"extrinsics",
           {{{"name", "x"}, {"unit", "mm"}, {"value", -100.25}, {"sigma", 0.02}},
            {{"name", "w_x"}, {"unit", "mrad"}, {"value", 3.5}, {"sigma", nullptr}}}},
          {"residual_table", {{"RMS", 0.123456789, "px"}, {"points", 70, ""}}}};
}

std::string Html() {
  const Json report{
      {"verdict",
       {{"grade", "usable"},
        {"findings", {{{"grade", "bad"}, {"what", "a < b"}, {"remedy", "more images"}}}}}},
      {"headline", "two & three"},
      {"cameras", {{"a", Camera("right", 1)}, {"b", Camera("left", 0)}}}};
  return CalibrationText(report).Html();
}

TEST(CalibrationText, BeginsWithTheVerdictAndTheMaster) {
  const std::string html = Html();
  EXPECT_THAT(html,
              HasSubstr("<h2>Verdict</h2>\n<div class=\"verdict usable\"><strong>usable: two &amp; "
                        "three</strong>\n<div>left: 0.2 px</div>\n<div>right: 0.2 px</div>\n"));
  EXPECT_THAT(html, HasSubstr("<li class=\"bad\">a &lt; b <em>more images</em></li>"));
  EXPECT_LT(html.find("<h3>left: focused-plenoptic, 640 x 480 px</h3>"), html.find("<h3>right: "));
}

TEST(CalibrationText, HasParametersWithTheirUnits) {
  const std::string html = Html();
  const auto row = [&](const std::string& name) {
    const size_t begin = html.find("<tr><th scope=\"row\">" + name + "</th>");
    return html.substr(begin, html.find("</tr>", begin) - begin);
  };
  EXPECT_THAT(row("f_L"), HasSubstr("<td>0.03510</td><td>0.00020</td><td>m</td>"));
  EXPECT_THAT(row("s"), HasSubstr("<td>2</td><td>fixed</td><td>m⁻¹²</td>"));
  EXPECT_THAT(row("n"), HasSubstr("<td>7.250</td><td>0.010</td><td>px²</td>"));
  EXPECT_THAT(row("k"), HasSubstr("<td>0.5</td><td>not determined</td><td></td>"));
  EXPECT_THAT(html, Not(HasSubstr("knot"))) << "no number of the model's equations";
  EXPECT_THAT(row("RMS"), HasSubstr("<td>0.123457</td><td>px</td>"));
  EXPECT_THAT(row("points"), HasSubstr("<td>70</td><td></td>"));
}

TEST(CalibrationText, HasThePosesInTheMastersFrame) {
  const std::string html = Html();
  EXPECT_THAT(html, HasSubstr("<caption>poses in the frame of left ± standard errors</caption>"));
  EXPECT_THAT(html, HasSubstr("<th scope=\"row\">x</th><td>-100.250 ± 0.020</td><td>mm</td>"));
  EXPECT_THAT(html, HasSubstr("<th scope=\"row\">w_x</th><td>3.5, not determined</td>"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
